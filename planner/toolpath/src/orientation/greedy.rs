//! D's method: the best direction of each waypoint alone, then a low-pass (D7, II-G).
//!
//! For each waypoint, the free directions are scanned, the exact ends of their interval are found (where 95 % of the optima
//! lie), and argmin's bounded Brent refines the best between its neighbours; with two angles a compass search refines it. If
//! every free direction costs the same, the waypoint keeps the direction of the one before it.
//!
//! The low-pass is a zero-phase moving average of the angles θ, or θ and φ. Its result is not permissible at many waypoints;
//! there the axis is set to the nearest free direction, and the waypoint is counted. As in the paper, turns between
//! waypoints are not tested; [`super::sequence`] and [`super::refine`] do that.
//!
//! **Source:** Dillon et al. 2016, equation (7) and II-G; docs/force-model.md 8, resolution 17.

use argmin::core::{CostFunction, Error, Executor, State};
use argmin::solver::brent::BrentOpt;
use bonemill_geometry::basis;
use nalgebra::{Unit, Vector3};

use super::{Directions, TiltFamily, moving_average};

/// Iterations of Brent's method: from 2° to below 0.01°.
const BRENT_ITERATIONS: u64 = 12;
/// Halvings that find the end of an interval: from 2° to 0.03°.
const END_HALVINGS: usize = 6;
/// Costs that differ by less than this are equal: in a symmetric body rounding must not choose.
const EQUAL: f64 = 1e-6;

/// The best axis of one waypoint alone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum BestAxis {
    /// This axis.
    Axis(Unit<Vector3<f64>>),
    /// Every free direction costs the same.
    Any,
    /// No direction is free.
    Nothing,
}

/// Axes after the low-pass.
#[derive(Debug, Clone, PartialEq)]
pub struct Greedy {
    /// Axis of each waypoint.
    pub axes: Vec<Unit<Vector3<f64>>>,
    /// Angle of each waypoint in the family, rad; for a plane.
    pub angles_rad: Option<Vec<f64>>,
    /// Number of waypoints at which the filtered axis was not free and was set to the nearest free direction.
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

/// One waypoint: its free directions, the access test and the cost of any axis.
#[derive(Debug, Clone, Copy)]
pub struct LoneWaypoint<'a, Set, Free, Cost> {
    /// The directions.
    pub directions: &'a Directions,
    /// The family of a plane; `None` for a cap.
    pub family: Option<&'a TiltFamily>,
    /// Whether direction n is free.
    pub in_set: Set,
    /// Whether an arbitrary axis is free.
    pub is_free: Free,
    /// Cost C of an axis.
    pub cost: Cost,
}

impl<Set, Free, Cost> LoneWaypoint<'_, Set, Free, Cost>
where
    Set: Fn(usize) -> bool,
    Free: Fn(&Unit<Vector3<f64>>) -> bool,
    Cost: Fn(&Unit<Vector3<f64>>) -> f64,
{
    /// The axis of least cost among the free ones.
    pub fn wish(&self) -> BestAxis {
        let (mut best, mut least, mut most) = (None, f64::INFINITY, f64::NEG_INFINITY);
        for n in (0..self.directions.len()).filter(|n| (self.in_set)(*n)) {
            let c = (self.cost)(&self.directions.axes()[n]);
            most = most.max(c);
            if c < least - EQUAL {
                (best, least) = (Some(n), c);
            }
        }
        match (best, self.family, self.directions.angles_rad()) {
            (None, ..) => BestAxis::Nothing,
            _ if most - least <= EQUAL => BestAxis::Any,
            (Some(n), Some(family), Some(angles)) => BestAxis::Axis(self.in_plane(n, least, family, angles)),
            (Some(n), ..) => BestAxis::Axis(self.compass(n, least)),
        }
    }

    /// Refines the best scanned angle between its neighbours, or the exact ends of the free interval.
    fn in_plane(&self, n: usize, least: f64, family: &TiltFamily, angles: &[f64]) -> Unit<Vector3<f64>> {
        let q = angles[n];
        let limit = |m: Option<usize>| {
            let Some(m) = m.filter(|m| *m < angles.len()) else { return q };
            if (self.in_set)(m) { angles[m] } else { self.end_of_interval(q, angles[m], family) }
        };
        let (lower, upper) = (limit(n.checked_sub(1)), limit(Some(n + 1)));
        let cost = |q: f64| (self.cost)(&family.axis(q));
        let mut best = (q, least);
        let mut consider = |q: f64| {
            let c = cost(q);
            if c < best.1 - EQUAL && (self.is_free)(&family.axis(q)) {
                best = (q, c);
            }
        };
        // Brent never returns the ends
        consider(lower);
        consider(upper);
        if lower < upper {
            let solver = BrentOpt::new(lower, upper);
            let run = Executor::new(Along(&cost), solver).configure(|s| s.max_iters(BRENT_ITERATIONS)).run();
            // if the refinement fails, the scanned angle is kept; a NaN cost gives no parameter
            if let Some(q) = run.ok().and_then(|r| r.state().get_best_param().copied()) {
                consider(q);
            }
        }
        family.axis(best.0)
    }

    /// The last free angle from `free` towards `blocked`, by END_HALVINGS halvings.
    fn end_of_interval(&self, free: f64, blocked: f64, family: &TiltFamily) -> f64 {
        let (mut inside, mut outside) = (free, blocked);
        for _ in 0..END_HALVINGS {
            let middle = 0.5 * (inside + outside);
            if (self.is_free)(&family.axis(middle)) { inside = middle } else { outside = middle }
        }
        inside
    }

    /// Compass search: steps to lower cost in six directions, halved when none lowers the cost.
    fn compass(&self, n: usize, least: f64) -> Unit<Vector3<f64>> {
        let mut best = (self.directions.axes()[n], least);
        let mut step = 0.5 * self.directions.spacing_rad();
        for _ in 0..4 {
            let [theta, phi] = <[f64; 2]>::from(basis::angles_from_axis(&best.0));
            let around = (0..6).map(|k| {
                let (s, c) = (f64::from(k) * std::f64::consts::FRAC_PI_3).sin_cos();
                axis_from_angles(theta + step * s, phi + step * c)
            });
            let found = around
                .map(|axis| ((self.cost)(&axis), axis))
                .filter(|(c, a)| *c < best.1 - EQUAL && (self.is_free)(a));
            match found.min_by(|a, b| a.0.total_cmp(&b.0)) {
                Some((c, axis)) => best = (axis, c),
                None => step *= 0.5,
            }
        }
        best.0
    }
}

fn axis_from_angles(theta_rad: f64, phi_rad: f64) -> Unit<Vector3<f64>> {
    Unit::new_normalize(basis::axis_from_angles(theta_rad, phi_rad))
}

/// The axis of every waypoint from its best axis. A waypoint without a preference keeps the axis of the one before it, or
/// gets the nearest free direction.
///
/// `in_set(i, n)`: whether direction n is free at waypoint i. Before the first waypoint the axis is the approach.
pub fn settle(
    directions: &Directions,
    wishes: &[BestAxis],
    in_set: impl Fn(usize, usize) -> bool,
    is_free: impl Fn(usize, &Unit<Vector3<f64>>) -> bool,
) -> Vec<Unit<Vector3<f64>>> {
    let upright = directions.axes()[directions.nearest(&Vector3::z())];
    let mut before = upright;
    let mut settled = Vec::with_capacity(wishes.len());
    for (i, wish) in wishes.iter().enumerate() {
        before = match wish {
            BestAxis::Axis(axis) => *axis,
            BestAxis::Any if is_free(i, &before) => before,
            _ => {
                let nearest = directions.nearest_of(directions.nearest(&before), |n| in_set(i, n));
                nearest.map_or(before, |n| directions.axes()[n])
            }
        };
        settled.push(before);
    }
    settled
}

/// The low-pass: a zero-phase moving average of the angles over 2·`half` + 1 waypoints; axes that are not free are replaced by
/// the nearest free directions.
///
/// `is_free(i, axis)`: the access test; `in_set(i, n)`: whether direction n is free.
pub fn low_pass(
    (directions, family): (&Directions, Option<&TiltFamily>),
    raw: &[Unit<Vector3<f64>>],
    half: usize,
    in_set: impl Fn(usize, usize) -> bool,
    is_free: impl Fn(usize, &Unit<Vector3<f64>>) -> bool,
) -> Greedy {
    let filtered: Vec<_> = match family {
        Some(family) => {
            let angles: Vec<f64> = raw.iter().map(|a| family.angle(a)).collect();
            moving_average(&angles, half).into_iter().map(|q| family.axis(q)).collect()
        }
        None => {
            let (theta, phi): (Vec<_>, Vec<_>) = raw.iter().map(|a| basis::angles_from_axis(a)).unzip();
            let smooth = moving_average(&theta, half).into_iter().zip(moving_average(&phi, half));
            smooth.map(|(theta, phi)| axis_from_angles(theta, phi)).collect()
        }
    };
    let mut held = 0;
    let axes: Vec<_> = filtered
        .into_iter()
        .enumerate()
        .map(|(i, axis)| {
            if is_free(i, &axis) {
                return axis;
            }
            held += 1;
            let nearest = directions.nearest_of(directions.nearest(&axis), |n| in_set(i, n));
            nearest.map_or(raw[i], |n| directions.axes()[n])
        })
        .collect();
    let angles_rad = family.map(|family| axes.iter().map(|a| family.angle(a)).collect());
    Greedy { axes, angles_rad, held }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn family() -> TiltFamily {
        TiltFamily { hinge: Vector3::x_axis(), zero: Vector3::z_axis(), lower_rad: -1.0, upper_rad: 1.0 }
    }

    fn set() -> Directions {
        Directions::in_plane(&family(), 2f64.to_radians(), 1.0)
    }

    /// The best axis for a cost of the family's angle, among angles for which `is_free` is true.
    fn wish(cost: impl Fn(f64) -> f64, is_free: impl Fn(f64) -> bool + Copy) -> BestAxis {
        let (family, set) = (family(), set());
        let in_set = |n: usize| is_free(family.angle(&set.axes()[n]));
        LoneWaypoint {
            directions: &set,
            family: Some(&family),
            in_set,
            is_free: |a: &Unit<Vector3<f64>>| is_free(family.angle(a)),
            cost: |a: &Unit<Vector3<f64>>| cost(family.angle(a)),
        }
        .wish()
    }

    fn angle(wish: BestAxis) -> f64 {
        match wish {
            BestAxis::Axis(axis) => family().angle(&axis),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn the_best_angle_is_refined_between_the_scan() {
        assert!((angle(wish(|q| (q - 0.1234).powi(2), |_| true)) - 0.1234).abs() < 1e-3);
    }

    #[test]
    fn the_ends_of_the_free_interval_are_found_to_a_fraction_of_the_scan() {
        let lowest = angle(wish(|q| q, |q| q > -0.3217 && q < 0.4));
        assert!((-0.3217..-0.32).contains(&lowest), "{lowest}");
        // two intervals far apart: the result is the end of the better one
        let upper = angle(wish(|q| -q.abs(), |q| !(-0.5..0.6).contains(&q) && q < 0.777));
        assert!((upper + 1.0).abs() < 1e-9, "{upper}");
        assert_eq!(wish(|q| q, |_| false), BestAxis::Nothing);
    }

    #[test]
    fn rounding_does_not_choose_in_a_symmetric_body() {
        for sign in [1.0, -1.0] {
            let found = angle(wish(|q| (q.abs() - 0.4).powi(2) + sign * 1e-9 * q, |_| true));
            assert!((found + 0.4).abs() < 0.02, "{found}");
        }
    }

    #[test]
    fn equal_costs_move_least() {
        assert_eq!(wish(|_| 0.5, |_| true), BestAxis::Any);
        let (set, family) = (set(), family());
        let wishes = [
            BestAxis::Axis(family.axis(0.4)),
            BestAxis::Any,
            BestAxis::Any,
            BestAxis::Nothing,
            BestAxis::Any,
        ];
        let free = |i: usize, q: f64| i != 2 || q > 0.5;
        let settled = settle(
            &set,
            &wishes,
            |i, n| free(i, family.angle(&set.axes()[n])),
            |i, a| free(i, family.angle(a)),
        );
        let q: Vec<f64> = settled.iter().map(|a| family.angle(a)).collect();
        assert!((q[0] - 0.4).abs() < 1e-12 && q[1] == q[0]);
        // the axis moves away once, by as little as the set allows, and does not move back
        assert!(q[2] > 0.5 && q[2] < 0.54 && (q[4] - q[2]).abs() < 1e-12, "{q:?}");
    }

    #[test]
    fn the_low_pass_is_held_inside_the_free_angles_and_counted() {
        let (set, family) = (set(), family());
        let raw: Vec<_> = (0..40).map(|i| family.axis(if i < 20 { -0.5 } else { 0.5 })).collect();
        // angles around the middle are blocked, and the average would cross them
        let free = |a: &Vector3<f64>| family.angle(a).abs() > 0.3;
        let out = low_pass((&set, Some(&family)), &raw, 4, |_, n| free(&set.axes()[n]), |_, a| free(a));
        assert!(out.axes.iter().all(|a| free(a)) && (4..10).contains(&out.held), "{}", out.held);
        assert_eq!(out.angles_rad.map(|q| q.len()), Some(40));
    }

    #[test]
    fn two_angles_are_searched_around_the_best_and_filtered_each() {
        let cap = Directions::cap(6f64.to_radians(), 1.0);
        let wanted = axis_from_angles(0.31, -0.22);
        let at = LoneWaypoint {
            directions: &cap,
            family: None,
            in_set: |_| true,
            is_free: |_: &Unit<Vector3<f64>>| true,
            cost: |a: &Unit<Vector3<f64>>| 1.0 - a.dot(&wanted),
        };
        let BestAxis::Axis(found) = at.wish() else { panic!("no axis") };
        assert!(found.angle(&wanted) < 0.03, "{}", found.angle(&wanted));
        let out = low_pass((&cap, None), &[wanted; 9], 2, |_, _| true, |_, _| true);
        assert!(out.held == 0 && out.axes.iter().all(|a| a.angle(&wanted) < 1e-7));
    }
}
