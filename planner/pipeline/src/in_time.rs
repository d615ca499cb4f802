//! Axes for the lowest levels of force that fit a time: the time of cuts and of turns is one currency.
//!
//! For given levels the dynamic program ([`bonemill_toolpath::orientation::sequence`]) finds the sequence that takes the least time.
//! The levels are those of a straight shaft in the same time, both times one factor κ, and κ is lowered until the least time is the one
//! that may be taken. A straight shaft along the plan's own lines is among the sequences, so a turn is made only where the cuts gain more than
//! it takes; the reference's lines may be others. Each factor that is tried costs one run of the program over pushes that are computed once.

use bonemill_cutting::burr::EngagedSamples;
use bonemill_cutting::speed::Levels;
use bonemill_geometry::cancel;
use bonemill_toolpath::orientation::sequence::{BestSequence, Forbidden, Problem, best_sequence};
use bonemill_toolpath::orientation::{Directions, FreeSets, TurnLimits, TurnPrice, TurnTime};
use rayon::prelude::*;

use super::axis_cost::{AxisLevels, AxisPush, CostField, LevelTimes};
use super::free_axes::FreeAxes;

/// Runs of the dynamic program until the factor is known.
const FACTORS_TRIED: usize = 6;
/// The least and the largest factor.
const FACTORS: [f64; 2] = [0.2, 3.0];
/// A level toward structures is at least this share of the largest push toward them of the straight shaft, and at least [`NOTHING_SHARE`].
const LEAST_TOWARD: f64 = 0.2;
/// A push toward structures up to this share of the largest push in any direction counts as none.
pub(super) const NOTHING_SHARE: f64 = 1e-3;
/// How near the least time must come to the one that may be taken, as a share of it.
const NEAR_SHARE: f64 = 2e-3;

/// What axes are chosen for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Goal {
    /// The levels of a straight shaft in the same time.
    pub levels: Levels,
    /// The largest pushes of that shaft, cuts at the least speed included: no axis is chosen with which a cut pushes more.
    pub most: Levels,
    /// Time that the moves may take at their caps under the levels, s.
    pub seconds: f64,
    /// Time at the caps over the time that is driven, without turns.
    pub caps_over_driven: f64,
    /// How long turns take.
    pub turn: TurnTime,
}

/// Levels, and the best sequence of the set under them.
pub(super) struct UnderLevels {
    pub levels: AxisLevels,
    pub cost: Vec<f32>,
    pub found: BestSequence,
    /// Time of its moves, and the part of it in which turns keep them waiting, s.
    pub seconds: [f64; 2],
}

impl Goal {
    /// The reference's levels, times a factor.
    pub fn levels(&self, factor: f64) -> AxisLevels {
        let Levels { toward, overall, speed_mm_s } = self.levels;
        let nothing = NOTHING_SHARE * self.most.overall;
        let toward = toward.max(LEAST_TOWARD * self.most.toward).max(nothing);
        let levels = Levels { toward: factor * toward, overall: factor * overall, speed_mm_s };
        AxisLevels { levels, most: Levels { toward: self.most.toward.max(nothing), ..self.most } }
    }

    /// The price of turns on a set whose directions are `coarser` times as far apart as those of the finest: there a turn of one
    /// spacing stands for a way over several.
    pub fn limits(&self, limits: TurnLimits, coarser: f64) -> TurnLimits {
        let turn = TurnTime { factor: self.turn.factor / coarser, ..self.turn };
        TurnLimits { price: TurnPrice::Time(turn), ..limits }
    }
}

/// Searches the factor on the directions of a set.
pub(super) fn least_levels(
    room: &FreeAxes,
    field: &CostField,
    times: &LevelTimes,
    goal: &Goal,
    (coarser, kept): (f64, Option<&[EngagedSamples]>),
) -> UnderLevels {
    let pushes = field.axis_pushes(times, room.directions, &room.reached.free, kept);
    let turns = goal.limits(room.turns, coarser);
    let none = Forbidden::default();
    let run = |factor: f64| {
        let levels = goal.levels(factor);
        let mut cost = costs(field, times, &levels, &pushes, room.directions.len());
        let axes = room.directions.axes();
        for i in (0..room.kept.len()).filter(|i| room.kept[*i].is_some()) {
            let row = cost[i * axes.len()..].iter_mut().zip(axes);
            row.for_each(|(cost, axis)| *cost += room.leaves_kept(i, axis) as f32);
        }
        let problem = room.problem(&cost, turns, &none);
        let found = best_sequence(&problem);
        let seconds = match &found {
            BestSequence::Sequence { directions, .. } => {
                seconds(&problem, field, times, (&levels, &pushes), directions)
            }
            BestSequence::Blocked(_) => [f64::INFINITY, 0.0],
        };
        (seconds[0], UnderLevels { levels, cost, found, seconds })
    };
    least_factor(goal.seconds, run)
}

/// The result at the least factor that is found whose time may be taken, or at a factor of 1 where none may; `run` gives the time under a
/// factor, s. The time is nearly linear in 1/factor.
fn least_factor<T>(seconds: f64, run: impl Fn(f64) -> (f64, T)) -> T {
    let is_fit = |took_s: f64| took_s <= seconds * (1.0 + NEAR_SHARE);
    let (mut factor, (mut took_s, mut best)) = (1.0, run(1.0));
    let (mut least, mut fits) = (factor, is_fit(took_s));
    let mut tried = vec![[1.0 / factor, took_s]];
    while tried.len() < FACTORS_TRIED && took_s.is_finite() && (took_s - seconds).abs() > NEAR_SHARE * seconds
    {
        cancel::poll();
        factor = next_factor(&tried, seconds);
        let found;
        (took_s, found) = run(factor);
        if is_fit(took_s) && (!fits || factor < least) {
            (best, least, fits) = (found, factor, true);
        }
        tried.push([1.0 / factor, took_s]);
    }
    best
}

/// The best sequence under the reference's levels over some waypoints of a draft; none where no sequence gets through.
pub(super) fn best_under(
    field: &CostField,
    times: &LevelTimes,
    goal: &Goal,
    (set, free, length_mm): (&Directions, &FreeSets, &[f64]),
    waypoints: &[usize],
) -> Option<Vec<u16>> {
    let pushes = field.axis_pushes(times, set, free, None);
    let count = set.len();
    let cost = costs(field, times, &goal.levels(1.0), &pushes, count);
    let rows: Vec<f32> = waypoints.iter().flat_map(|i| &cost[i * count..(i + 1) * count]).copied().collect();
    let kept: Vec<f64> = waypoints.iter().map(|i| length_mm[*i]).collect();
    let turns = TurnLimits { price: TurnPrice::Time(goal.turn), most_rad_per_mm: f64::INFINITY };
    let problem = Problem {
        directions: set,
        cost: &rows,
        free: &FreeSets::fill(waypoints.len(), count, |i, n| free.contains(waypoints[i], n)),
        length_mm: &kept,
        turns,
        forbidden: &Forbidden::default(),
    };
    match best_sequence(&problem) {
        BestSequence::Sequence { directions, .. } => Some(directions),
        BestSequence::Blocked(_) => None,
    }
}

/// The factor at which the line through the last two times, or through the last and a guess, meets the time that may be taken.
fn next_factor(tried: &[[f64; 2]], seconds: f64) -> f64 {
    let [x, t] = tried[tried.len() - 1];
    let slope = match tried.len().checked_sub(2).map(|n| tried[n]) {
        Some([before, took_s]) if (x - before).abs() > 1e-6 && (t - took_s) / (x - before) > 0.0 => {
            (t - took_s) / (x - before)
        }
        // most of the time is inverse to the levels
        _ => 0.8 * t / x,
    };
    let inverse = (x + (seconds - t) / slope).clamp(1.0 / FACTORS[1], 1.0 / FACTORS[0]);
    1.0 / inverse
}

/// Cost of every waypoint and free direction under levels, s per mm.
fn costs(
    field: &CostField,
    times: &LevelTimes,
    levels: &AxisLevels,
    pushes: &[AxisPush],
    directions: usize,
) -> Vec<f32> {
    let mut cost = vec![0f32; pushes.len()];
    cost.par_chunks_mut(directions).zip(pushes.par_chunks(directions)).enumerate().for_each(
        |(i, (row, pushes))| {
            if field.cuts(i) {
                row.iter_mut()
                    .zip(pushes)
                    .for_each(|(cost, push)| *cost = push.cost(levels, times.range_mm_s) as f32);
            } else {
                row.fill((1.0 / times.link_mm_s) as f32);
            }
        },
    );
    cost
}

/// Time of a sequence with its cuts within the range of speeds, and the part of it in which turns keep the moves waiting, s.
fn seconds(
    problem: &Problem,
    field: &CostField,
    times: &LevelTimes,
    (levels, pushes): (&AxisLevels, &[AxisPush]),
    sequence: &[u16],
) -> [f64; 2] {
    let TurnPrice::Time(turn) = problem.turns.price else { return [f64::INFINITY, 0.0] };
    let of = |i: usize| {
        let (n, length_mm) = (usize::from(sequence[i]), problem.length_mm[i]);
        let push = &pushes[i * problem.directions.len() + n];
        let own = if field.cuts(i) {
            push.seconds(&levels.levels, times.range_mm_s)
        } else {
            1.0 / times.link_mm_s
        };
        let angle_rad =
            if i > 0 { problem.directions.angle_rad(usize::from(sequence[i - 1]), n) } else { 0.0 };
        let waits_s = (turn.seconds(angle_rad) - own * length_mm).max(0.0);
        [own * length_mm + waits_s, waits_s]
    };
    (0..sequence.len()).map(of).fold([0.0; 2], |sum, of| [sum[0] + of[0], sum[1] + of[1]])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The factor that is found, and how many are tried.
    fn found(time_s: impl Fn(f64) -> f64, seconds: f64) -> (f64, usize) {
        let tried = std::cell::Cell::new(0);
        let factor = least_factor(seconds, |factor| {
            tried.set(tried.get() + 1);
            (time_s(factor), factor)
        });
        (factor, tried.get())
    }

    #[test]
    fn the_least_factor_whose_time_may_be_taken_is_found() {
        let smooth = |factor: f64| 300.0 + 500.0 / factor;
        // turns keep the cuts waiting, and some cuts are as fast as they may be
        let bent = |factor: f64| 200.0 + 300.0 / factor.powf(0.6) + 100.0 * (0.8 / factor).max(1.0);
        for time_s in [&smooth as &dyn Fn(f64) -> f64, &bent] {
            for seconds in [600.0, 700.0, 800.0, 1000.0] {
                let (factor, tried) = found(time_s, seconds);
                let took_s = time_s(factor);
                assert!(
                    (took_s / seconds - 1.0).abs() <= 2.0 * NEAR_SHARE,
                    "{seconds}: {took_s} s at {factor}"
                );
                assert!(took_s <= seconds * (1.0 + NEAR_SHARE) && tried <= FACTORS_TRIED);
            }
        }
    }

    #[test]
    fn where_no_time_or_every_time_may_be_taken_the_search_ends() {
        assert_eq!(found(|_| f64::INFINITY, 100.0), (1.0, 1));
        // all fit: the least factor
        assert_eq!(found(|_| 50.0, 100.0).0, FACTORS[0]);
        // none fits: the one that was tried first
        assert_eq!(found(|factor| 1000.0 + 1.0 / factor, 100.0).0, 1.0);
    }
}
