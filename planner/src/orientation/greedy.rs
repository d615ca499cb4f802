//! D's way: the best angle of each waypoint alone, then a low-pass (D7, II-G).
//!
//! Per waypoint: a scan of the free angles, their interval's ends among them, then argmin's bounded Brent between the
//! neighbours of the best. The low-pass would leave the permissible interval at many waypoints; there it is held at the
//! nearest free angle, and counted.

use argmin::core::{CostFunction, Error, Executor, State};
use argmin::solver::brent::BrentOpt;

use super::{Scan, moving_average};

/// Iterations of Brent's method: 2° to below 0.01°.
const BRENT_ITERATIONS: u64 = 12;

/// Angles and what the low-pass did to them.
#[derive(Debug, Clone, PartialEq)]
pub struct Greedy {
    /// Angle per waypoint, rad.
    pub angles_rad: Vec<f64>,
    /// Waypoints at which the filtered angle was not free and was held back.
    pub held: usize,
}

struct Along<F>(F);

impl<F: Fn(f64) -> f64> CostFunction for Along<F> {
    type Param = f64;
    type Output = f64;
    fn cost(&self, angle: &f64) -> Result<f64, Error> {
        Ok((self.0)(*angle))
    }
}

/// The best free angle of one waypoint, rad; `None` when none is free.
///
/// `free`: bits of the scan; `cost(q)` and `is_free(q)` for any angle. Ties go to the angle nearest to `near_rad`.
pub fn best_angle(
    scan: &Scan,
    free: u128,
    near_rad: f64,
    cost: impl Fn(f64) -> f64,
    is_free: impl Fn(f64) -> bool,
) -> Option<f64> {
    let (mut best, mut least) = (None, f64::INFINITY);
    for n in (0..scan.len()).filter(|n| free >> n & 1 == 1) {
        let (q, c) = (scan.angles_rad[n], cost(scan.angles_rad[n]));
        let nearer = best.is_none_or(|b: f64| (q - near_rad).abs() < (b - near_rad).abs());
        if c < least - 1e-12 || (c <= least + 1e-12 && nearer) {
            (best, least) = (Some(q), c);
        }
    }
    let q = best?;
    let is_free_at = |n: Option<usize>| n.is_some_and(|n| n < scan.len() && free >> n & 1 == 1);
    let n = scan.nearest(q);
    let lower = if is_free_at(n.checked_sub(1)) { scan.angles_rad[n - 1] } else { q };
    let upper = if is_free_at(Some(n + 1)) { scan.angles_rad[n + 1] } else { q };
    if lower >= upper {
        return Some(q);
    }
    let solver = BrentOpt::new(lower, upper);
    let run = Executor::new(Along(&cost), solver).configure(|s| s.max_iters(BRENT_ITERATIONS)).run();
    // a failed refinement leaves the scan's answer; NaN cost gives no parameter
    let refined = run.ok().and_then(|r| r.state().get_best_param().copied());
    Some(refined.filter(|r| cost(*r) < least - 1e-12 && is_free(*r)).unwrap_or(q))
}

/// The low-pass: a zero-phase moving average over 2·`half` + 1 waypoints, held at free angles.
///
/// `is_free(i, q)`: the access test; `free[i]`: bits of the scan, not empty.
pub fn low_pass(
    scan: &Scan,
    raw_rad: &[f64],
    half: usize,
    free: &[u128],
    is_free: impl Fn(usize, f64) -> bool,
) -> Greedy {
    let filtered = moving_average(raw_rad, half);
    let mut held = 0;
    let angles_rad = filtered
        .into_iter()
        .enumerate()
        .map(|(i, q)| {
            if is_free(i, q) {
                return q;
            }
            held += 1;
            scan.nearest_free(free[i], q).map_or(raw_rad[i], |n| scan.angles_rad[n])
        })
        .collect();
    Greedy { angles_rad, held }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::orientation::TiltFamily;
    use nalgebra::Vector3;

    fn scan() -> Scan {
        let family =
            TiltFamily { hinge: Vector3::x_axis(), zero: Vector3::z_axis(), lower_rad: -1.0, upper_rad: 1.0 };
        Scan::new(&family, 2f64.to_radians(), 1.0)
    }

    #[test]
    fn the_best_angle_is_refined_between_the_scan() {
        let q = best_angle(&scan(), u128::MAX, 0.0, |q| (q - 0.1234).powi(2), |_| true).unwrap();
        assert!((q - 0.1234).abs() < 1e-3);
    }

    #[test]
    fn the_ends_of_the_interval_are_found() {
        let s = scan();
        let free = 0b111 << 10;
        let lowest = best_angle(&s, free, 0.0, |q| q, |q| q >= s.angles_rad[10] - 1e-12).unwrap();
        assert_eq!(lowest, s.angles_rad[10]);
        assert_eq!(best_angle(&s, 0, 0.0, |q| q, |_| true), None);
    }

    #[test]
    fn equal_costs_move_least() {
        let q = best_angle(&scan(), u128::MAX, 0.4, |_| 0.5, |_| true).unwrap();
        assert!((q - 0.4).abs() <= 1f64.to_radians() + 1e-9);
    }

    #[test]
    fn the_low_pass_is_held_inside_the_free_angles() {
        let s = scan();
        let raw = [vec![-0.5; 20], vec![0.5; 20]].concat();
        // a ban around the middle, which the average would cross
        let bits = (0..s.len()).filter(|n| s.angles_rad[*n].abs() > 0.3).fold(0u128, |m, n| m | 1 << n);
        let out = low_pass(&s, &raw, 4, &vec![bits; 40], |_, q| q.abs() > 0.3);
        assert!(out.angles_rad.iter().all(|q| q.abs() > 0.3));
        assert!(out.held > 0 && out.held < 10);
    }
}
