//! The whole sequence at once: dynamic programming over the scanned angles.
//!
//! J = Σ C_i(q_i) Δs_i + λ Σ (q_i − q_{i−1})²/Δs_i, subject to: q_i free at i, |q_i − q_{i−1}| within what the tilt joint
//! can turn during the move, and every scanned angle passed over free before or after the move. The second term is
//! ∫ (dq/ds)² ds, so the weight does not depend on the step. Edges are evaluated, never stored; one byte per state
//! remembers where its best sequence came from.

use super::Scan;

/// A sequence, or where none gets through.
#[derive(Debug, Clone, PartialEq)]
pub enum Sequence {
    /// Index into the scan, per waypoint.
    Found(Vec<usize>),
    /// No free angle of this waypoint can be reached from the waypoints before it.
    Blocked(usize),
}

/// Weights and limits of the sequence.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RateLimit {
    /// λ, mm/rad² per unit of cost.
    pub weight_mm: f64,
    /// Largest change of the angle per mm of path, rad/mm.
    pub most_rad_per_mm: f64,
}

/// The sequence with the least J.
///
/// `cost`: C of waypoint i and angle n at `i * scan.len() + n`, read only where free; `free`: bits per waypoint;
/// `length_mm[i]`: length of the move that ends at i. Ties go to the smaller change of angle.
pub fn best_sequence(
    scan: &Scan,
    cost: &[f32],
    free: &[u128],
    length_mm: &[f64],
    rate: RateLimit,
) -> Sequence {
    let angles = scan.len();
    let center = scan.nearest(0.0);
    let mut came_from = vec![0u8; free.len() * angles];
    let mut best = vec![f64::INFINITY; angles];
    for (i, &free_here) in free.iter().enumerate() {
        let costs = &cost[i * angles..(i + 1) * angles];
        let length = length_mm[i].max(1e-3);
        let own = |n: usize| f64::from(costs[n]) * length;
        let mut next = vec![f64::INFINITY; angles];
        if i == 0 {
            for n in bits(free_here) {
                // nothing decides the first angle but its cost; a hair for upright, so that ties stand upright
                next[n] = own(n) + 1e-9 * n.abs_diff(center) as f64;
            }
        } else {
            let reach = reach(scan, rate, length);
            let passable = free_here | free[i - 1];
            let turn = rate.weight_mm * scan.step_rad * scan.step_rad / length;
            for n in bits(free_here) {
                let (from, least) = best_predecessor(&best, n, reach, passable, turn);
                if least.is_finite() {
                    next[n] = least + own(n);
                    came_from[i * angles + n] = from as u8;
                }
            }
        }
        if next.iter().all(|v| v.is_infinite()) {
            return Sequence::Blocked(i);
        }
        best = next;
    }
    Sequence::Found(trace_back(&best, &came_from, free.len(), angles))
}

/// Largest change in scan steps over a move; at least one, or nothing could ever turn: the time law slows such a move.
fn reach(scan: &Scan, rate: RateLimit, length_mm: f64) -> usize {
    ((rate.most_rad_per_mm * length_mm / scan.step_rad) as usize).clamp(1, scan.len())
}

/// The best angle before, with its cost so far, walking outwards from n as long as angles are passable.
#[inline]
fn best_predecessor(best: &[f64], n: usize, reach: usize, passable: u128, turn: f64) -> (usize, f64) {
    let (mut from, mut least) = (n, best[n]);
    let mut consider = |m: usize, steps: usize| {
        let total = best[m] + turn * (steps * steps) as f64;
        if total < least {
            (from, least) = (m, total);
        }
    };
    for steps in 1..=reach.min(n) {
        if passable >> (n - steps) & 1 == 0 {
            break;
        }
        consider(n - steps, steps);
    }
    for steps in 1..=reach.min(best.len() - 1 - n) {
        if passable >> (n + steps) & 1 == 0 {
            break;
        }
        consider(n + steps, steps);
    }
    (from, least)
}

fn trace_back(best: &[f64], came_from: &[u8], waypoints: usize, angles: usize) -> Vec<usize> {
    let mut here = (0..angles).min_by(|a, b| best[*a].total_cmp(&best[*b])).unwrap_or(0);
    let mut sequence = vec![0; waypoints];
    for i in (0..waypoints).rev() {
        sequence[i] = here;
        here = usize::from(came_from[i * angles + here]);
    }
    sequence
}

/// Numbers of the bits that are set, ascending.
fn bits(mut mask: u128) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let n = mask.trailing_zeros() as usize;
        (mask != 0).then(|| {
            mask &= mask - 1;
            n
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::orientation::TiltFamily;
    use nalgebra::Vector3;
    use proptest::prelude::*;

    fn scan(angles: usize) -> Scan {
        let half = 0.05 * (angles - 1) as f64;
        let family = TiltFamily {
            hinge: Vector3::x_axis(),
            zero: Vector3::z_axis(),
            lower_rad: -half - 1e-9,
            upper_rad: half + 1e-9,
        };
        Scan::new(&family, 0.1, 3.0)
    }

    /// Every sequence, one after the other.
    fn brute(scan: &Scan, cost: &[f32], free: &[u128], length: &[f64], rate: RateLimit) -> Option<f64> {
        let (k, n) = (scan.len(), free.len());
        let mut least: Option<f64> = None;
        for code in 0..k.pow(n as u32) {
            let at = |i: usize| code / k.pow(i as u32) % k;
            let total = (0..n).try_fold(0.0, |sum, i| {
                let q = at(i);
                if free[i] >> q & 1 == 0 {
                    return None;
                }
                let mut here = f64::from(cost[i * k + q]) * length[i];
                if i > 0 {
                    let (lo, hi) = (q.min(at(i - 1)), q.max(at(i - 1)));
                    let passable = (lo..=hi).all(|m| (free[i] | free[i - 1]) >> m & 1 == 1);
                    if hi - lo > reach(scan, rate, length[i]) || !passable {
                        return None;
                    }
                    let turn = (hi - lo) as f64 * scan.step_rad;
                    here += rate.weight_mm * turn * turn / length[i];
                }
                Some(sum + here)
            });
            least = match (least, total) {
                (Some(a), Some(b)) => Some(a.min(b)),
                (a, b) => a.or(b),
            };
        }
        least
    }

    proptest! {
        #[test]
        fn equals_brute_force(
            k in 3usize..7, n in 1usize..6,
            cost in prop::collection::vec(0.0f32..1.0, 48),
            masks in prop::collection::vec(1u128..256, 6),
            length in prop::collection::vec(0.1f64..1.5, 6),
            weight_mm in 0.0f64..3.0, most_rad_per_mm in 0.05f64..0.6,
        ) {
            let scan = scan(k);
            prop_assume!(scan.len() == k);
            let free: Vec<u128> = masks[..n].iter().map(|m| m & ((1 << k) - 1)).collect();
            let rate = RateLimit { weight_mm, most_rad_per_mm };
            let expected = brute(&scan, &cost, &free, &length[..n], rate);
            match best_sequence(&scan, &cost[..n * k], &free, &length[..n], rate) {
                Sequence::Blocked(_) => prop_assert!(expected.is_none()),
                Sequence::Found(q) => {
                    let mut total = 0.0;
                    for i in 0..n {
                        prop_assert!(free[i] >> q[i] & 1 == 1);
                        total += f64::from(cost[i * k + q[i]]) * length[i];
                        if i > 0 {
                            let turn = q[i].abs_diff(q[i - 1]) as f64 * scan.step_rad;
                            total += weight_mm * turn * turn / length[i];
                        }
                    }
                    prop_assert!((total - expected.unwrap()).abs() < 1e-6, "{total} {expected:?}");
                }
            }
        }
    }

    #[test]
    fn constant_cost_stands_still_and_upright() {
        let scan = scan(7);
        let found = best_sequence(
            &scan,
            &vec![0.3; 70],
            &[127; 10],
            &[0.25; 10],
            RateLimit { weight_mm: 1.0, most_rad_per_mm: 0.4 },
        );
        assert_eq!(found, Sequence::Found(vec![3; 10]));
    }

    #[test]
    fn an_empty_waypoint_is_named() {
        let scan = scan(5);
        let rate = RateLimit { weight_mm: 1.0, most_rad_per_mm: 0.4 };
        let mut free = vec![31; 6];
        free[4] = 0;
        assert_eq!(best_sequence(&scan, &[0.0; 30], &free, &[0.25; 6], rate), Sequence::Blocked(4));
        assert_eq!(best_sequence(&scan, &[], &[], &[], rate), Sequence::Found(vec![]));
    }
}
