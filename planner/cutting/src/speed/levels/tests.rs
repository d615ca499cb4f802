//! The least levels against brute force over small paths.

use std::convert::Infallible;

use proptest::prelude::*;

use super::*;
use crate::speed::{CutMoves, LimitedProfile};

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
    fn top(&self) -> Levels {
        Levels::above_all(self.pushes.iter(), RANGE_MM_S)
    }

    fn profile(&self, levels: &Levels) -> LimitedProfile {
        let moves = CutMoves {
            is_cut: vec![true; self.pushes.len()],
            length_mm: &self.length_mm,
            slowest_mm_s: &vec![RANGE_MM_S[0]; self.pushes.len()],
            max_mm_s: RANGE_MM_S[1],
            link_mm_s: 10.0,
            acceleration_mm_s2: self.acceleration_mm_s2,
        };
        moves.profile(|i| levels.fastest_mm_s(Some(&self.pushes[i]))).unwrap()
    }

    fn time_s(&self, levels: &Levels) -> Result<f64, Infallible> {
        Ok(self.profile(levels).time_s)
    }

    /// A time between the shortest and the longest.
    fn limit(&self, share: f64) -> TimeLimit {
        let slowest = Levels { toward: 0.0, overall: 0.0, ..self.top() };
        let [Ok(shortest_s), Ok(longest_s)] = [self.time_s(&self.top()), self.time_s(&slowest)];
        let total_s = shortest_s + share * (longest_s - shortest_s);
        TimeLimit { total_s, tolerance_s: 1e-9, evaluations: 100 }
    }

    /// Largest push toward structures and overall of the moves faster than the least speed.
    fn levels_of(&self, move_mm_s: &[f64]) -> [f64; 2] {
        let faster = self.pushes.iter().zip(move_mm_s).filter(|(_, v)| **v > RANGE_MM_S[0] + 1e-9);
        faster.fold([0.0; 2], |most, (pushes, v)| {
            let toward = pushes.toward(*v).map_or(0.0, |(push, _)| push);
            [most[0].max(toward), most[1].max(pushes.overall(*v))]
        })
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

fn vector(size: f64) -> impl Strategy<Value = Vector3<f64>> {
    prop::array::uniform3(-size..size).prop_map(Vector3::from)
}

/// What pushes at some places, each with the same structures.
fn pushed<'a>(
    forces: impl IntoIterator<Item = &'a EngagedForce>,
    compliance: Option<&Matrix3<f64>>,
    toward: &[(f64, Unit<Vector3<f64>>)],
) -> CutPushes {
    CutPushes::new(forces.into_iter().map(|force| (force, toward.to_vec())), compliance)
}

/// One or two places within a cut, with edge forces up to `edge_n`.
fn pushes(edge_n: f64) -> impl Strategy<Value = CutPushes> {
    let force = (vector(0.5), vector(edge_n.max(1e-12))).prop_map(move |(cut_n_per_mm_s, edge)| {
        let edge_n = if edge_n > 0.0 { edge } else { Vector3::zeros() };
        EngagedForce { cut_n_per_mm_s, edge_n, ..EngagedForce::ZERO }
    });
    let near = prop::collection::vec((0.1f64..1.0, vector(1.0)), 1..3);
    (prop::collection::vec(force, 1..3), near).prop_map(|(forces, near)| {
        let toward: Vec<_> =
            near.into_iter().filter_map(|(weight, u)| Some((weight, Unit::try_new(u, 1e-3)?))).collect();
        pushed(&forces, None, &toward)
    })
}

fn path(edge_n: f64) -> impl Strategy<Value = Path> {
    let acceleration = prop_oneof![Just(f64::INFINITY), 0.5f64..20.0];
    (3usize..6, acceleration).prop_flat_map(move |(n, acceleration_mm_s2)| {
        (prop::collection::vec(pushes(edge_n), n), prop::collection::vec(0.2f64..2.0, n))
            .prop_map(move |(pushes, length_mm)| Path { pushes, length_mm, acceleration_mm_s2 })
    })
}

proptest! {
    #![proptest_config(bonemill_geometry::fixed!(128))]

    /// Without room, no profile that keeps time and acceleration has a lower level overall, and with it none under the raised level has
    /// a lower one toward structures.
    #[test]
    fn no_other_profile_keeps_lower_levels_in_the_time(
        path in prop_oneof![path(0.0), path(0.1)], share in 0.01f64..0.99, room in 0.0f64..0.3,
    ) {
        let limit = path.limit(share);
        let Ok(least) = least_levels(path.top(), RANGE_MM_S[0], 0.0, limit, |levels| path.time_s(levels));
        let Ok(found) = least_levels(path.top(), RANGE_MM_S[0], room, limit, |levels| path.time_s(levels));
        let profile = path.profile(&found);
        prop_assert!(profile.time_s <= limit.total_s);
        prop_assert!(profile.move_mm_s.iter().all(|v| (0.5 - 1e-12..=4.0 + 1e-12).contains(v)));
        prop_assert!(found.overall <= (1.0 + room) * least.overall + 1e-9 || found.toward == path.top().toward);
        for other in path.tried(limit.total_s) {
            let [toward, overall] = path.levels_of(&other);
            prop_assert!(overall >= least.overall - 1e-6, "{other:?} {overall}, found {least:?}");
            prop_assert!(overall > found.overall || toward >= found.toward - 1e-6, "{other:?} {toward}, found {found:?}");
        }
    }

    /// Beside a reference that takes no longer, neither level is above the reference's, and the time is used up but where all speeds are at
    /// an end of their range.
    #[test]
    fn levels_beside_a_reference_are_no_higher(path in path(0.0), share in 0.01f64..0.99, more in -0.9f64..3.0) {
        let limit = path.limit(share);
        let Ok(reference) = least_levels(path.top(), RANGE_MM_S[0], 0.1, limit, |levels| path.time_s(levels));
        prop_assume!(reference.toward > 1e-3 && reference.overall > 1e-3);
        let longer = TimeLimit { total_s: (1.0 + more) * limit.total_s, ..limit };
        let Ok(found) = least_along(reference, path.top(), 1e-9, longer, |levels| path.time_s(levels));
        let is_no_higher =
            found.toward <= reference.toward * (1.0 + 1e-6) && found.overall <= reference.overall * (1.0 + 1e-6);
        prop_assert!(more < 0.0 || is_no_higher);
        let ratio = found.toward * reference.overall - found.overall * reference.toward;
        prop_assert!(ratio.abs() < 1e-9 * reference.toward * reference.overall + 1e-12);
        let profile = path.profile(&found);
        let is_at = |end: f64| profile.move_mm_s.iter().all(|v| (v - end).abs() < 1e-9);
        prop_assert!(profile.time_s <= longer.total_s + 1e-9 || is_at(RANGE_MM_S[1]));
        prop_assert!(profile.time_s >= longer.total_s - longer.tolerance_s - 1e-9 || is_at(RANGE_MM_S[0]));
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
fn what_no_time_allows_stays_at_the_top_and_what_every_time_allows_at_the_least_speed() {
    let along = |cut: Vector3<f64>| EngagedForce { cut_n_per_mm_s: cut, ..EngagedForce::ZERO };
    let near = [(0.5, Vector3::x_axis())];
    let pushes =
        vec![pushed([&along(Vector3::x() * 0.4)], None, &near), pushed([&along(Vector3::y())], None, &near)];
    let path = Path { pushes, length_mm: vec![1.0; 2], acceleration_mm_s2: f64::INFINITY };
    let levels = |total_s: f64| {
        let limit = TimeLimit { total_s, tolerance_s: 1e-9, evaluations: 100 };
        let Ok(found) = least_levels(path.top(), RANGE_MM_S[0], 0.1, limit, |levels| path.time_s(levels));
        found
    };
    assert_eq!(levels(0.1), path.top());
    assert_eq!(levels(99.0), Levels { toward: 0.0, overall: 0.0, speed_mm_s: 0.5 });
    // without a structure the whole time lowers the level overall
    let free = pushed([&along(Vector3::y())], None, &[]);
    assert_eq!((free.toward(2.0), free.overall(2.0)), (None, 2.0));
}

#[test]
fn a_compliance_makes_deflections_of_forces() {
    let force = EngagedForce { cut_n_per_mm_s: Vector3::new(1.0, 0.0, 0.0), ..EngagedForce::ZERO };
    let c = Matrix3::new(0.02, 0.01, 0.0, 0.01, 0.05, 0.0, 0.0, 0.0, 0.01);
    let toward = [(0.5, Vector3::y_axis())];
    let p = pushed([&force], Some(&c), &toward);
    assert!((p.toward(2.0).unwrap().0 - 0.01).abs() < 1e-15);
    assert!((p.overall(2.0) - 2.0 * 0.02f64.hypot(0.01)).abs() < 1e-15);
    assert_eq!(pushed([&force], None, &toward).toward(2.0), None);
}

#[test]
fn a_push_that_falls_with_the_speed_counts_from_rest_and_the_worst_place_counts() {
    let force =
        EngagedForce { cut_n_per_mm_s: -Vector3::x(), edge_n: Vector3::x() * 0.6, ..EngagedForce::ZERO };
    let toward = [(0.5, Vector3::x_axis())];
    let p = pushed([&force], None, &toward);
    assert_eq!((p.toward(0.5), p.toward(4.0), p.overall(1.0)), (Some((0.3, 0)), Some((0.3, 0)), 0.6));
    let levels = |toward: f64| Levels { toward, overall: 9.0, speed_mm_s: 4.0 };
    assert_eq!((p.fastest_mm_s(&levels(0.29)), p.fastest_mm_s(&levels(0.3))), (0.0, 4.0));
    // two places: the stronger one decides, and structures are told by their number
    let weak = EngagedForce { cut_n_per_mm_s: Vector3::y() * 0.1, ..EngagedForce::ZERO };
    let strong = EngagedForce { cut_n_per_mm_s: Vector3::y() * 0.4, ..EngagedForce::ZERO };
    let two = [(1.0, Vector3::x_axis()), (0.5, Vector3::y_axis())];
    let p = pushed([&weak, &strong], None, &two);
    let (push, structure) = p.toward(2.0).unwrap();
    assert!((push - 0.4).abs() < 1e-12 && structure == 1 && (p.overall(2.0) - 0.8).abs() < 1e-12);
}
