//! Improves the best sequence on a coarse cap to the best one near it on a finer cap.
//!
//! Halving the spacing of a cap's directions makes four times as many, and access and cost take four times as long, while
//! the best sequence on the fine cap stays near the one on the coarse cap. So only a corridor around the smoothed coarse
//! sequence is tested: at every waypoint the fine directions within `CORRIDOR_SPACINGS` spacings of its own direction and of
//! its neighbours' directions. Where the best sequence in the corridor runs along the corridor's edge, or no sequence gets
//! through, the corridor is widened, until the sequence hardly touches the edge or `MOST_WIDENINGS` is reached.
//!
//! The result is the best sequence within its corridor, so no small change improves it. Alternatives that pass an obstacle
//! on another side are searched on the coarse cap only.

use rayon::prelude::*;

use super::sequence::{BestSequence, Forbidden, Problem, best_sequence, blocked_waypoints};
use super::{Directions, FreeSets, TurnLimits};

/// Number of waypoints to either side over which the coarse sequence is smoothed.
const GLIDE: usize = 10;
/// Half-width of the corridor in the fine cap's spacings: one ring, 7 directions.
const CORRIDOR_SPACINGS: f64 = 1.6;
/// Number of waypoints before and after an unreachable one at which the corridor is widened too.
const BESIDE: usize = 16;
/// Largest number of widenings.
const MOST_WIDENINGS: usize = 16;
/// The corridor is wide enough when the sequence runs along its edge at no more than one in this many waypoints.
const FEW: usize = 8;

/// The tested directions of a fine cap, and the best sequence among them.
#[derive(Debug, Clone)]
pub struct Corridor {
    /// Directions that were tested at each waypoint.
    pub asked: FreeSets,
    /// The tested directions that are free.
    pub free: FreeSets,
    /// C of the free directions, in the layout of [`Problem::cost`].
    pub cost: Vec<f32>,
    /// The best sequence.
    pub found: BestSequence,
}

/// The best sequence of the `fine` cap near a given sequence of it; `None` where none gets through the corridor.
///
/// `ask(i, directions)` returns C of each of the directions at waypoint i, `None` for one that is not free. It is called in
/// parallel, and for no direction twice. Lengths and rate are as in [`Problem`].
pub fn best_near(
    fine: &Directions,
    sequence: &[u16],
    length_mm: &[f64],
    turns: TurnLimits,
    ask: impl Fn(usize, &[usize]) -> Vec<Option<f32>> + Sync,
) -> Option<Corridor> {
    let (waypoints, count) = (sequence.len(), fine.len());
    let [mut asked, mut free] = [FreeSets::none(waypoints, count), FreeSets::none(waypoints, count)];
    let mut cost = vec![0f32; waypoints * count];
    let start = smoothed(fine, sequence);
    // where the corridor is widened: around which directions, and how far
    let beside = |sequence: &[u16], i: usize| sequence[i.saturating_sub(1)..(i + 2).min(waypoints)].to_vec();
    let mut grow: Vec<Growth> = (0..waypoints)
        .map(|i| Growth { i, middles: beside(&start, i), spacings: CORRIDOR_SPACINGS })
        .collect();
    let (nothing, mut round) = (Forbidden::default(), 0);
    loop {
        let answers: Vec<(usize, Vec<usize>, Vec<Option<f32>>)> = grow
            .par_iter()
            .map(|Growth { i, middles, spacings }| {
                let within = |n: &u16| fine.within(usize::from(*n), spacings * fine.spacing_rad());
                let mut wanted: Vec<usize> = middles.iter().flat_map(within).collect();
                wanted.sort_unstable();
                wanted.dedup();
                wanted.retain(|n| !asked.contains(*i, *n));
                let answers = if wanted.is_empty() { Vec::new() } else { ask(*i, &wanted) };
                (*i, wanted, answers)
            })
            .collect();
        for (i, wanted, answers) in answers {
            for (n, answer) in wanted.into_iter().zip(answers) {
                asked.insert(i, n);
                if let Some(c) = answer {
                    free.insert(i, n);
                    cost[i * count + n] = c;
                }
            }
        }
        let problem =
            Problem { directions: fine, cost: &cost, free: &free, length_mm, turns, forbidden: &nothing };
        let found = best_sequence(&problem);
        round += 1;
        grow = match &found {
            BestSequence::Sequence { directions, .. } => {
                let is_inside =
                    |i: usize| fine.neighbours(usize::from(directions[i])).all(|n| asked.contains(i, n));
                let edge = (0..waypoints).filter(|i| !is_inside(*i));
                edge.map(|i| Growth { i, middles: vec![directions[i]], spacings: CORRIDOR_SPACINGS })
                    .collect()
            }
            // there the coarse sequence turns past directions that are blocked on the fine cap, or faster than allowed
            BestSequence::Blocked(_) => {
                let spacings = CORRIDOR_SPACINGS * (1 + round) as f64;
                let around = |i: usize| i.saturating_sub(BESIDE)..(i + BESIDE).min(waypoints);
                let mut near: Vec<usize> = blocked_waypoints(&problem).into_iter().flat_map(around).collect();
                near.sort_unstable();
                near.dedup();
                let middles = |i: usize| [beside(&start, i), beside(sequence, i)].concat();
                near.into_iter().map(|i| Growth { i, middles: middles(i), spacings }).collect()
            }
        };
        let is_blocked = matches!(found, BestSequence::Blocked(_));
        if round > MOST_WIDENINGS || (!is_blocked && grow.len() * FEW <= waypoints) {
            return (!is_blocked).then_some(Corridor { asked, free, cost, found });
        }
    }
}

/// The sequence averaged over [`GLIDE`] waypoints before and after each, because the best sequence turns gradually where the
/// coarse one jumps.
fn smoothed(fine: &Directions, sequence: &[u16]) -> Vec<u16> {
    let axis = |n: &u16| fine.axes()[usize::from(*n)].into_inner();
    let mean = |i: usize| {
        let near = &sequence[i.saturating_sub(GLIDE)..(i + GLIDE + 1).min(sequence.len())];
        fine.nearest(&near.iter().map(axis).sum()) as u16
    };
    (0..sequence.len()).into_par_iter().map(mean).collect()
}

/// One widening of the corridor.
struct Growth {
    /// The waypoint.
    i: usize,
    /// The directions around which it is widened.
    middles: Vec<u16>,
    /// How far, in the fine cap's spacings.
    spacings: f64,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::orientation::TurnPrice;
    use std::sync::atomic::{AtomicUsize, Ordering};

    const RATE: TurnLimits = TurnLimits { price: TurnPrice::Smoothness(1.0), most_rad_per_mm: 2.0 };

    /// A cost with a valley that winds over the cap, a wall that the sequence must go around, and ripples of height `ripple`.
    fn cost_at(fine: &Directions, i: usize, n: usize, ripple: f64) -> Option<f32> {
        let axis = &fine.axes()[n];
        let t = i as f64 * 0.05;
        let off = (axis.x - 0.5 * t.sin()).hypot(axis.y - 0.3 * (1.7 * t).cos());
        let is_wall = (20..40).contains(&i) && axis.x > 0.35;
        (!is_wall).then_some((3.0 * off * off + ripple * (9.0 * axis.y).sin()) as f32)
    }

    /// The best sequence on the whole fine cap.
    fn whole(fine: &Directions, length_mm: &[f64], ripple: f64) -> BestSequence {
        let at = |k: usize| cost_at(fine, k / fine.len(), k % fine.len(), ripple);
        let cost: Vec<f32> = (0..length_mm.len() * fine.len()).map(|k| at(k).unwrap_or(0.0)).collect();
        let free = FreeSets::fill(length_mm.len(), fine.len(), |i, n| cost_at(fine, i, n, ripple).is_some());
        let forbidden = Forbidden::default();
        best_sequence(&Problem {
            directions: fine,
            cost: &cost,
            free: &free,
            length_mm,
            turns: RATE,
            forbidden: &forbidden,
        })
    }

    fn total(found: &BestSequence) -> f64 {
        match found {
            BestSequence::Sequence { total, .. } => *total,
            BestSequence::Blocked(i) => panic!("blocked at {i}"),
        }
    }

    /// If ripples are as wide as the first corridor, the sequence may stay in a ripple beside the best one.
    #[test]
    fn near_the_coarse_sequence_the_fine_caps_best_is_found_with_few_questions() {
        let coarse = Directions::cap(0.21, 1.05);
        let (fine, numbers) = coarse.finer(3).unwrap();
        let length_mm = vec![0.5; 80];
        for (ripple, above) in [(0.0, 1e-9), (0.01, 1e-9), (0.05, 1e-3)] {
            let found = whole(&coarse, &length_mm, ripple);
            let BestSequence::Sequence { directions, total: rough, .. } = found else { panic!() };
            let start: Vec<u16> = directions.iter().map(|n| numbers[usize::from(*n)]).collect();
            let asked = AtomicUsize::new(0);
            let ask = |i: usize, wanted: &[usize]| {
                asked.fetch_add(wanted.len(), Ordering::Relaxed);
                wanted.iter().map(|n| cost_at(&fine, i, *n, ripple)).collect()
            };
            let corridor = best_near(&fine, &start, &length_mm, RATE, ask).unwrap();
            let (best, found) = (total(&whole(&fine, &length_mm, ripple)), total(&corridor.found));
            assert!(found - best < above * best, "{found} of {best} with ripples of {ripple}");
            assert!(found < rough);
            let asked = asked.load(Ordering::Relaxed);
            assert!(asked < 80 * fine.len() / 10, "{asked}");
            let counted = (0..80).map(|i| corridor.asked.count(i)).sum::<usize>();
            assert_eq!(counted, asked, "nothing is asked twice");
            // the result is the best of the tested directions
            let free = &corridor.free;
            let forbidden = Forbidden::default();
            let cost = &corridor.cost;
            let again = Problem {
                directions: &fine,
                cost,
                free,
                length_mm: &length_mm,
                turns: RATE,
                forbidden: &forbidden,
            };
            assert_eq!(best_sequence(&again), corridor.found);
        }
    }

    /// The start is far from the valley, and the corridor grows towards it.
    #[test]
    fn the_corridor_grows_to_where_the_best_sequence_is() {
        let (fine, _) = Directions::cap(0.21, 1.05).finer(3).unwrap();
        let length_mm = vec![0.5; 12];
        let start = vec![fine.nearest(&nalgebra::Vector3::new(0.2, -0.1, 1.0).normalize()) as u16; 12];
        let ask = |i: usize, wanted: &[usize]| wanted.iter().map(|n| cost_at(&fine, i, *n, 0.05)).collect();
        let corridor = best_near(&fine, &start, &length_mm, RATE, ask).unwrap();
        assert!((total(&corridor.found) - total(&whole(&fine, &length_mm, 0.05))).abs() < 1e-9);
    }

    #[test]
    fn a_corridor_that_is_blocked_is_told() {
        let (fine, _) = Directions::cap(0.21, 1.05).finer(2).unwrap();
        let ask = |i: usize, wanted: &[usize]| vec![(i != 3).then_some(0.0); wanted.len()];
        assert!(best_near(&fine, &[0; 6], &[0.5; 6], RATE, ask).is_none());
    }
}
