//! The family of levels against brute force over small paths.

use std::convert::Infallible;

use proptest::prelude::*;

use super::*;
use crate::speed::{CutMoves, LimitedProfile, last_within};

const RANGE_MM_S: [f64; 2] = [0.5, 4.0];
/// Speeds that the brute force tries at every place, mm/s.
const TRIED: [f64; 5] = [0.5, 1.0, 1.7, 2.6, 4.0];

/// Cuts with forces and one to two structures each.
#[derive(Debug, Clone)]
struct Path {
    pushes: Vec<CutPushes>,
    length_mm: Vec<f64>,
    acceleration_mm_s2: f64,
}

impl Path {
    fn moves(&self) -> CutMoves<'_> {
        CutMoves {
            is_cut: vec![true; self.pushes.len()],
            length_mm: &self.length_mm,
            range_mm_s: RANGE_MM_S,
            link_mm_s: 10.0,
            acceleration_mm_s2: self.acceleration_mm_s2,
        }
    }

    fn family(&self) -> LevelFamily {
        LevelFamily::new(self.pushes.iter(), RANGE_MM_S)
    }

    fn profile(&self, levels: &Levels) -> LimitedProfile {
        self.moves().profile(|i| levels.fastest_mm_s(Some(&self.pushes[i]))).unwrap()
    }

    /// The goals in their order, each to be least.
    fn goals(&self, move_mm_s: &[f64]) -> [f64; 5] {
        let mut goals = [0.0f64; 5];
        for (pushes, v) in self.pushes.iter().zip(move_mm_s) {
            let (toward, overall) = (pushes.toward(*v).map_or(0.0, |(w, _)| w), pushes.overall(*v));
            let is_faster = *v > RANGE_MM_S[0] + 1e-9;
            let above = |push: f64| if is_faster { push } else { 0.0 };
            let found = [toward, overall, above(toward), above(overall), *v];
            goals.iter_mut().zip(found).for_each(|(goal, found)| *goal = goal.max(found));
        }
        goals
    }

    /// Speeds of the moves of every profile over the tried speeds that keeps the acceleration and the time.
    fn tried(&self, total_s: f64) -> Vec<Vec<f64>> {
        let (n, choices) = (self.pushes.len(), TRIED.len());
        let places = |code: usize| -> Vec<f64> {
            (0..n).map(|i| TRIED[code / choices.pow(i as u32) % choices]).collect()
        };
        let keeps = |u: &[f64]| {
            let gain = |i: usize| (u[i].powi(2) - u[i - 1].powi(2)).abs();
            let time_s: f64 = (1..n).map(|i| 2.0 * self.length_mm[i] / (u[i] + u[i - 1])).sum();
            time_s <= total_s && (1..n).all(|i| gain(i) <= 2.0 * self.acceleration_mm_s2 * self.length_mm[i])
        };
        let of_moves = |u: Vec<f64>| (0..n).map(|i| u[i].max(u[i.saturating_sub(1)])).collect();
        (0..choices.pow(n as u32)).map(places).filter(|u| keeps(u)).map(of_moves).collect()
    }
}

/// Whether `a` is less than `b` in the first goal in which they differ.
fn is_better(a: &[f64; 5], b: &[f64; 5]) -> bool {
    let differing = a.iter().zip(b).find(|(a, b)| **a < **b - 1e-6 || **a > **b + 1e-9);
    differing.is_some_and(|(a, b)| a < b)
}

fn vector(size: f64) -> impl Strategy<Value = Vector3<f64>> {
    prop::array::uniform3(-size..size).prop_map(Vector3::from)
}

fn pushes(edge_n: f64) -> impl Strategy<Value = CutPushes> {
    let structures = prop::collection::vec((0.1f64..1.0, vector(1.0)), 0..3);
    (vector(0.6), vector(1.0), structures).prop_map(move |(cut, edge, structures)| {
        let force = EngagedForce { cut_n_per_mm_s: cut, edge_n: edge * edge_n, ..EngagedForce::ZERO };
        let toward = structures.into_iter().filter_map(|(w, u)| Some((w, Unit::try_new(u, 1e-3)?)));
        CutPushes::new(&force, None, toward)
    })
}

fn path(edge_n: f64) -> impl Strategy<Value = Path> {
    let acceleration = prop_oneof![Just(f64::INFINITY), 0.5f64..20.0];
    (3usize..6, acceleration).prop_flat_map(move |(n, acceleration_mm_s2)| {
        (prop::collection::vec(pushes(edge_n), n), prop::collection::vec(0.2f64..2.0, n))
            .prop_map(move |(pushes, length_mm)| Path { pushes, length_mm, acceleration_mm_s2 })
    })
}

/// The least force within a time, by the family alone.
fn least_force(path: &Path, share: f64) -> (f64, LimitedProfile) {
    let family = path.family();
    let time_s = |p: f64| path.profile(&family.at(p)).time_s;
    let (shortest_s, longest_s) = (time_s(0.0), time_s(family.slowest()));
    let total_s = shortest_s + share * (longest_s - shortest_s);
    let bracket = [(0.0, shortest_s), (family.slowest(), longest_s)];
    let found = last_within(bracket, total_s, 1e-11, 100, |p| Ok::<_, Infallible>(time_s(p))).unwrap();
    (total_s, path.profile(&family.at(found)))
}

proptest! {
    #![proptest_config(bonemill_testkit::fixed(128))]

    /// No profile that keeps the time and the acceleration has less force, goal by goal.
    #[test]
    fn no_other_profile_has_less_force_in_the_time(
        path in prop_oneof![path(0.0), path(0.1)], share in 0.01f64..0.99,
    ) {
        let (total_s, found) = least_force(&path, share);
        prop_assert!(found.time_s <= total_s);
        prop_assert!(found.move_mm_s.iter().all(|v| (0.5 - 1e-12..=4.0 + 1e-12).contains(v)));
        let ours = path.goals(&found.move_mm_s);
        for other in path.tried(total_s) {
            let theirs = path.goals(&other);
            prop_assert!(!is_better(&theirs, &ours), "{other:?} {theirs:?}, found {:?} {ours:?}", found.move_mm_s);
        }
    }

    /// The time never falls along the family, and is used up but for what a jump leaves.
    #[test]
    fn the_time_grows_along_the_family(path in path(0.0), share in 0.01f64..0.99) {
        let family = path.family();
        let steps = 40.0 * family.slowest();
        let times: Vec<f64> =
            (0..=steps as usize).map(|n| path.profile(&family.at(n as f64 / 40.0)).time_s).collect();
        prop_assert!(times.windows(2).all(|w| w[1] >= w[0] - 1e-12), "{times:?}");
        let (total_s, found) = least_force(&path, share);
        prop_assert!(total_s - found.time_s < 1e-6, "{} of {total_s}", found.time_s);
    }

    /// At the speed found the levels hold, and a little faster one does not.
    #[test]
    fn the_speed_under_levels_is_tight(p in pushes(0.1), toward in 0.0f64..1.0, overall in 0.0f64..1.0) {
        let levels = Levels { toward, overall, speed_mm_s: 4.0 };
        let v = p.fastest_mm_s(&levels);
        let keeps = |v: f64, room: f64| {
            p.toward(v).map_or(0.0, |(w, _)| w) <= toward + room && p.overall(v) <= overall + room
        };
        prop_assert!(v == 0.0 || keeps(v, 1e-9));
        prop_assert!(v == 4.0 || !keeps(v + 1e-6, -1e-12));
    }
}

#[test]
fn levels_fall_one_after_the_other_and_empty_legs_are_left_out() {
    let along = |cut: Vector3<f64>| EngagedForce { cut_n_per_mm_s: cut, ..EngagedForce::ZERO };
    let near = [(0.5, Vector3::x_axis())];
    let pushes = [
        CutPushes::new(&along(Vector3::x() * 0.4), None, near.into_iter()),
        CutPushes::new(&along(Vector3::y()), None, near.into_iter()),
    ];
    let family = LevelFamily::new(pushes.iter(), RANGE_MM_S);
    let at = |parameter: f64| {
        let levels = family.at(parameter);
        [levels.toward, levels.overall, levels.speed_mm_s].map(|x| (x * 1e9).round() / 1e9)
    };
    assert_eq!(family.slowest(), 5.0);
    assert_eq!([0.0, 1.0, 2.0].map(at), [[0.8, 4.0, 4.0], [0.1, 4.0, 4.0], [0.1, 0.5, 4.0]]);
    assert_eq!([3.0, 4.0, 5.0].map(at), [[0.0, 0.5, 4.0], [0.0, 0.0, 4.0], [0.0, 0.0, 0.5]]);
    assert_eq!((at(0.5), at(9.0)), ([0.45, 4.0, 4.0], at(5.0)));
    // the first cut slows down for the structure, the second for the whole force, and one without force only at the end
    let speeds = |parameter: f64| pushes.each_ref().map(|p| family.at(parameter).fastest_mm_s(Some(p)));
    assert_eq!(speeds(1.0), [0.5, 4.0]);
    assert_eq!(speeds(2.0), [0.5, 0.5]);
    assert_eq!([4.0, 4.5, 5.0].map(|p| family.at(p).fastest_mm_s(None)), [4.0, 2.25, 0.5]);
    // without structures two legs and the last, without anything the last alone
    let free = [CutPushes::new(&along(Vector3::y()), None, std::iter::empty())];
    assert_eq!(LevelFamily::new(free.iter(), RANGE_MM_S).slowest(), 3.0);
    assert_eq!(LevelFamily::new(std::iter::empty(), RANGE_MM_S).slowest(), 1.0);
    assert_eq!(LevelFamily::new(std::iter::empty(), [1.0, 1.0]).slowest(), 0.0);
}

#[test]
fn a_compliance_makes_deflections_of_forces() {
    let force = EngagedForce { cut_n_per_mm_s: Vector3::new(1.0, 0.0, 0.0), ..EngagedForce::ZERO };
    let c = Matrix3::new(0.02, 0.01, 0.0, 0.01, 0.05, 0.0, 0.0, 0.0, 0.01);
    let p = CutPushes::new(&force, Some(&c), [(0.5, Vector3::y_axis())].into_iter());
    assert!((p.toward(2.0).unwrap().0 - 0.01).abs() < 1e-15);
    assert!((p.overall(2.0) - 2.0 * 0.02f64.hypot(0.01)).abs() < 1e-15);
    assert_eq!(CutPushes::new(&force, None, [(0.5, Vector3::y_axis())].into_iter()).toward(2.0), None);
}

#[test]
fn a_push_that_falls_with_the_speed_counts_from_rest() {
    let force =
        EngagedForce { cut_n_per_mm_s: -Vector3::x(), edge_n: Vector3::x() * 0.6, ..EngagedForce::ZERO };
    let p = CutPushes::new(&force, None, [(0.5, Vector3::x_axis())].into_iter());
    assert_eq!((p.toward(0.5), p.toward(4.0), p.overall(1.0)), (Some((0.3, 0)), Some((0.3, 0)), 0.6));
    let levels = |toward: f64| Levels { toward, overall: 9.0, speed_mm_s: 4.0 };
    assert_eq!((p.fastest_mm_s(&levels(0.29)), p.fastest_mm_s(&levels(0.3))), (0.0, 4.0));
}
