//! Bounds of the kinematics' bend against forward kinematics: never exceeded, and with the worst weights more than half used, so that
//! half of a bound would not do.

#![allow(clippy::unwrap_used, reason = "a test's helper fails by panicking")]

use bonemill_arm::ToolMount;
use bonemill_arm::ur::UrModel;
use bonemill_geometry::Rigid;

use super::*;
use crate::stream::simulated::fault::SeededDraws;

fn arm() -> Arm {
    let flange_from_burr = Rigid::new(nalgebra::Rotation3::identity(), Vector3::new(20.0, 0.0, 180.0));
    Arm::ur(UrModel::Ur5e, None).unwrap().with_mount(ToolMount { flange_from_burr })
}

/// That, and one whose first three joints slide.
fn arms() -> [Arm; 2] {
    [arm(), Arm::bone_attached().unwrap()]
}

/// Joints of a short piece of path at two times: along a direction, bent, with some noise.
struct Piece {
    from: Vec<Joints>,
    to: Vec<Joints>,
    direction: Joints,
}

fn piece(draws: &mut SeededDraws, noise: f64) -> Piece {
    let mut some = |size: f64| -> Joints { std::array::from_fn(|_| draws.between(-size, size)) };
    let (start, direction, turn, moved) = (some(2.0), some(0.1), some(0.01), some(0.01));
    let steps: Vec<Joints> = (0..=8).map(|_| some(noise)).collect();
    let at = |k: usize, later: f64| -> Joints {
        let t = k as f64 / 8.0;
        std::array::from_fn(|j| {
            start[j]
                + t * direction[j]
                + t * t * turn[j]
                + later * (0.5 * direction[j] + moved[j])
                + steps[k][j]
        })
    };
    Piece {
        from: (0..=8).map(|k| at(k, 0.0)).collect(),
        to: (0..=8).map(|k| at(k, 1.0)).collect(),
        direction,
    }
}

impl Piece {
    fn curvature(&self, arm: &Arm) -> Curvature {
        Curvature::around(arm, &[&self.from[..], &self.to[..]].concat(), self.direction)
    }

    fn between(&self, k: usize, later: f64) -> Joints {
        std::array::from_fn(|j| self.from[k][j] + later * (self.to[k][j] - self.from[k][j]))
    }
}

fn burr_mm(arm: &Arm, q: &Joints) -> Vector3<f64> {
    arm.tool_at(q).translation_mm
}

#[test]
fn means_with_any_weights_keep_to_the_bound_and_the_worst_use_it() {
    let mut draws = SeededDraws::new(1);
    for arm in arms() {
        let mut fullest: f64 = 0.0;
        for draw in 0..2000 {
            let piece = piece(&mut draws, if draw % 2 == 0 { 0.0 } else { 1e-3 });
            let bound_mm = piece.curvature(&arm).mean_mm(&piece.from, &piece.to);
            let later = draws.between(0.0, 1.0);
            // both ends of the range with half of the weight have the greatest mean square; others are drawn
            let weights: Vec<f64> = if draw % 3 == 0 {
                (0..=8).map(|k| if k % 8 == 0 { 0.5 } else { 0.0 }).collect()
            } else {
                (0..=8).map(|_| draws.between(0.0, 1.0).powi(4)).collect()
            };
            let sum: f64 = weights.iter().sum();
            let (mut mean, mut mean_mm) = ([0.0; 6], Vector3::zeros());
            for (k, weight) in weights.iter().enumerate() {
                let q = piece.between(k, later);
                mean_mm += burr_mm(&arm, &q) * (weight / sum);
                mean = std::array::from_fn(|j| mean[j] + weight / sum * q[j]);
            }
            let share = (burr_mm(&arm, &mean) - mean_mm).norm() / bound_mm;
            assert!(share <= 1.0, "draw {draw}: {share} of {bound_mm} mm");
            fullest = fullest.max(share);
        }
        assert!(fullest > 0.6, "{fullest}: half of the bound would not be exceeded");
    }
}

#[test]
fn second_derivatives_along_vectors_keep_to_the_bound_and_the_worst_use_it() {
    let (arm, mut draws) = (arm(), SeededDraws::new(2));
    let mut fullest: f64 = 0.0;
    for draw in 0..2000 {
        let piece = piece(&mut draws, 0.0);
        let aside: Joints = std::array::from_fn(|_| draws.between(-0.02, 0.02));
        let v: Joints = std::array::from_fn(|j| 0.3 * piece.direction[j] + aside[j]);
        let bound_mm = piece.curvature(&arm).along_mm(&[v, aside]);
        let (k, later, h) = (draws.below(9), draws.between(0.0, 1.0), 1e-3);
        let q = piece.between(k, later);
        let at = |h: f64| burr_mm(&arm, &std::array::from_fn(|j| q[j] + h * v[j]));
        let second_mm = (at(h) + at(-h) - 2.0 * at(0.0)) / (h * h);
        let share = second_mm.norm() / bound_mm;
        assert!(share <= 1.0 + 1e-3, "draw {draw}: {share} of {bound_mm} mm");
        fullest = fullest.max(share);
    }
    assert!(fullest > 0.6, "{fullest}: half of the bound would not be exceeded");
}

#[test]
fn an_errors_turn_keeps_to_the_bound_and_the_worst_use_it() {
    let mut draws = SeededDraws::new(3);
    for arm in arms() {
        let mut fullest: f64 = 0.0;
        for draw in 0..500 {
            let piece = piece(&mut draws, 0.0);
            let error_rad = 3e-3;
            let bound_mm =
                piece.curvature(&arm).error_mm(&[&piece.from[..], &piece.to[..]].concat(), &[error_rad; 6]);
            let (a, b) = (piece.from[0], piece.to[8]);
            for signs in 0..64 {
                let with = |q: &Joints, sign: f64| -> Joints {
                    std::array::from_fn(|j| {
                        q[j] + sign * error_rad * if signs >> j & 1 == 1 { 1.0 } else { -1.0 }
                    })
                };
                let moved = |q: &Joints, sign: f64| burr_mm(&arm, &with(q, sign)) - burr_mm(&arm, q);
                // the same error there, and one of the other sign
                let same_mm = (moved(&b, 1.0) - moved(&a, 1.0)).norm();
                let other_mm = (moved(&b, -1.0) + moved(&a, 1.0)).norm();
                let share = same_mm.max(other_mm) / bound_mm;
                assert!(share <= 1.0, "draw {draw}: {share} of {bound_mm} mm");
                fullest = fullest.max(share);
            }
        }
        assert!(fullest > 0.5, "{fullest}: half of the bound would not be exceeded");
    }
}
