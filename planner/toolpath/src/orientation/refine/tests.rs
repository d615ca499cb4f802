//! Tests of `refine`.

use super::*;
use crate::orientation::directions::{angle_between, tilt_rad};
use crate::orientation::{Directions, FreeSets, TurnLimits, TurnPrice};
use proptest::prelude::*;

fn family() -> TiltFamily {
    TiltFamily { hinge: Vector3::x_axis(), zero: Vector3::z_axis(), lower_rad: -1.0, upper_rad: 1.0 }
}

const WEIGHT_MM: f64 = 0.3;
const RATE: TurnLimits = TurnLimits { price: TurnPrice::Smoothness(WEIGHT_MM), most_rad_per_mm: 0.4 };

/// The preferred axis of waypoint i, which moves along the path; C_i(a) is the squared distance from it.
fn wish(i: usize) -> Unit<Vector3<f64>> {
    let s = i as f64 * 0.07;
    Unit::new_normalize(Vector3::new(0.2 * (1.3 * s).cos(), 0.35 * s.sin(), 1.0))
}

fn cost_at(i: usize, axis: &Vector3<f64>) -> f64 {
    angle_between(axis, &wish(i)).powi(2)
}

struct Setup {
    directions: Directions,
    cost: Vec<f32>,
    free: FreeSets,
    length_mm: Vec<f64>,
}

impl Setup {
    fn new(
        directions: Directions,
        waypoints: usize,
        is_free: impl Fn(usize, &Vector3<f64>) -> bool + Sync,
    ) -> Self {
        let axes = directions.axes();
        let cost = (0..waypoints).flat_map(|i| axes.iter().map(move |a| cost_at(i, a) as f32)).collect();
        let free = FreeSets::fill(waypoints, directions.len(), |i, n| is_free(i, &axes[n]));
        Self { cost, free, length_mm: vec![0.25; waypoints], directions }
    }

    fn problem<'a>(&'a self, forbidden: &'a Forbidden) -> Problem<'a> {
        Problem {
            directions: &self.directions,
            cost: &self.cost,
            free: &self.free,
            length_mm: &self.length_mm,
            turns: RATE,
            forbidden,
        }
    }

    fn total(&self, axes: &[Unit<Vector3<f64>>]) -> f64 {
        (0..axes.len())
            .map(|i| {
                let turn = if i > 0 { angle_between(&axes[i - 1], &axes[i]) } else { 0.0 };
                cost_at(i, &axes[i]) * 0.25 + WEIGHT_MM * turn * turn / 0.25
            })
            .sum()
    }
}

fn sequence_of(found: BestSequence) -> Vec<u16> {
    match found {
        BestSequence::Sequence { directions, .. } => directions,
        BestSequence::Blocked(i) => panic!("blocked at {i}"),
    }
}

#[test]
fn refinement_lowers_the_cost_and_calms_the_turns_in_a_plane_and_on_a_cap() {
    let family = family();
    for (directions, chart) in [
        (Directions::in_plane(&family, 0.06, 1.0), Chart::Plane(&family)),
        (Directions::cap(0.12, 0.8), Chart::Sphere),
    ] {
        let setup = Setup::new(directions, 120, |_, _| true);
        let none = Forbidden::default();
        let problem = setup.problem(&none);
        let sequence = sequence_of(best_sequence(&problem));
        let on_set: Vec<_> = sequence.iter().map(|n| setup.directions.axes()[usize::from(*n)]).collect();
        let refined = refine(&problem, &sequence, chart, |_, _| true, |_, _, _| true);
        let (before, after) = (setup.total(&on_set), setup.total(&refined.axes));
        assert!(after < before, "{before} to {after}");
        let fastest = |axes: &[Unit<Vector3<f64>>]| {
            axes.windows(2).map(|w| angle_between(&w[0], &w[1])).fold(0.0, f64::max)
        };
        assert!(fastest(&refined.axes) < 0.7 * fastest(&on_set));
        assert_eq!(refined.held, 0);
        let near = refined
            .axes
            .iter()
            .zip(&on_set)
            .all(|(a, b)| angle_between(a, b) <= 0.51 * setup.directions.spacing_rad());
        assert!(near, "stays within half a spacing");
        assert_eq!(refined.angles_rad.is_some(), matches!(chart, Chart::Plane(_)));
    }
}

/// An arm's tilt ends between two directions of the set; the wished axes lie beyond.
#[test]
fn refinement_stays_in_the_range_of_the_arm_s_tilt() {
    let family = TiltFamily { lower_rad: -0.195, upper_rad: 0.213, ..family() };
    let setup = Setup::new(Directions::in_plane(&family, 0.06, 1.0), 120, |_, _| true);
    let none = Forbidden::default();
    let problem = setup.problem(&none);
    let sequence = sequence_of(best_sequence(&problem));
    let refined = refine(&problem, &sequence, Chart::Plane(&family), |_, _| true, |_, _, _| true);
    let angles = refined.angles_rad.unwrap();
    let (least, most) = angles.iter().fold((f64::MAX, f64::MIN), |(a, b), q| (q.min(a), q.max(b)));
    assert!(least >= family.lower_rad && most <= family.upper_rad, "{least} to {most}");
    let last = setup.directions.angles_rad().unwrap().iter().fold(f64::MIN, |most, q| q.max(most));
    assert!(most > last + 1e-3, "the range is used beyond the last direction: {most}, {last}");
}

/// Half of the sphere is not free; every refined axis is free, and so is every axis between two of them.
#[test]
fn refinement_stays_inside_the_permissible_set_between_waypoints_too() {
    let family = family();
    for (directions, chart) in [
        (Directions::in_plane(&family, 0.06, 1.0), Chart::Plane(&family)),
        (Directions::cap(0.12, 0.8), Chart::Sphere),
    ] {
        let is_free = |i: usize, a: &Vector3<f64>| a.y < 0.11 + 0.001 * (i % 9) as f64;
        let setup = Setup::new(directions, 150, is_free);
        let none = Forbidden::default();
        let problem = setup.problem(&none);
        let turn_free = |i: usize, a: &Unit<Vector3<f64>>, b: &Unit<Vector3<f64>>| {
            (0..=8).all(|k| {
                let between = Unit::new_normalize(a.lerp(b, f64::from(k) / 8.0));
                is_free(i, &between) || is_free(i - 1, &between)
            })
        };
        let axes = setup.directions.axes();
        let checked = best_checked(&problem, best_sequence(&problem), |i, m, n| {
            turn_free(i, &axes[usize::from(m)], &axes[usize::from(n)])
        });
        assert!(checked.failing.is_empty());
        let refined = refine(&problem, &sequence_of(checked.found), chart, is_free, turn_free);
        for (i, axis) in refined.axes.iter().enumerate() {
            assert!(is_free(i, axis), "{i}");
            assert!(i == 0 || turn_free(i, &refined.axes[i - 1], axis), "{i}");
        }
        let outside = (0..150).filter(|i| !is_free(*i, &wish(*i))).count();
        assert!(outside > 30, "the wish lies outside often, and pulls");
        let at_edge = |(i, a): (usize, &Unit<Vector3<f64>>)| !is_free(i, &wish(i)) && a.y > 0.0;
        assert!(refined.axes.iter().enumerate().filter(|(i, a)| at_edge((*i, *a))).count() > 20);
    }
}

#[test]
fn turns_that_fail_between_waypoints_are_taken_elsewhere_or_named() {
    let setup = Setup::new(Directions::in_plane(&family(), 0.06, 1.0), 60, |_, _| true);
    let none = Forbidden::default();
    let problem = setup.problem(&none);
    let free_choice = sequence_of(best_sequence(&problem));
    let turning: Vec<usize> = (1..60).filter(|i| free_choice[*i] != free_choice[i - 1]).collect();
    assert!(turning.len() > 3);
    // turns are blocked where the sequence would turn
    let checked = best_checked(&problem, best_sequence(&problem), |i, a, b| a == b || !turning.contains(&i));
    assert!(checked.is_free() && checked.forbidden.len() >= turning.len());
    let found = sequence_of(checked.found);
    assert!(turning.iter().all(|i| found[*i] == found[i - 1]));
    // no turn is free in move 7: it is reported as failing
    let stuck = best_checked(&problem, best_sequence(&problem), |i, _, _| i != 7);
    assert!(stuck.failing.contains(&7));
}

proptest! {
    #![proptest_config(bonemill_geometry::fixed!(128))]

    #[test]
    fn tangents_and_axes_are_inverse(x in -0.7f64..0.7, y in -0.7f64..0.7, u in -0.5f64..0.5, v in -0.5f64..0.5) {
        let from = Unit::new_normalize(Vector3::new(x, y, 1.0));
        let t = Vector2::new(u, v);
        let axis = from_tangent(&from, &t);
        prop_assert!((to_tangent(&from, &axis) - t).norm() < 1e-9);
        prop_assert!((angle_between(&from, &axis) - t.norm()).abs() < 1e-12);
        prop_assert!((from_tangent(&from, &Vector2::zeros()).into_inner() - from.into_inner()).norm() < 1e-15);
        prop_assert!(tilt_rad(&axis) < 2.0);
    }

    /// The fit reproduces the gradient and curvature of a quadratic.
    #[test]
    fn a_bowl_is_fitted_exactly(gx in -1.0f64..1.0, gy in -1.0f64..1.0, h in 0.0f64..3.0) {
        let at = |k: usize| Vector2::new((k as f64).cos(), (k as f64).sin()) * 0.1;
        let points: Vec<_> = (0..6).map(|k| (at(k), gx * at(k).x + gy * at(k).y + 0.5 * h * at(k).norm_squared())).collect();
        let (g, c) = fitted(&points);
        prop_assert!((g - Vector2::new(gx, gy)).norm() < 1e-9 && (c[(0, 0)] - h).abs() < 1e-7);
    }
}
