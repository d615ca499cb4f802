//! The tube around the path: means of targets, and stops from them, stay in it; a straight path makes none beyond the tolerance.

#![allow(clippy::unwrap_used, reason = "a test's helper fails by panicking")]

mod common;

use bonemill_arm::arm::{ToolGoal, dls};
use bonemill_geometry::Rigid;
use bonemill_robot::stream::bound::tube;
use bonemill_robot::stream::simulated::fault::SeededDraws;
use bonemill_robot::stream::{Joints, StreamPlan};
use common::{PERIOD_S, settings, values};
use nalgebra::{Rotation3, Vector3};

/// A plan along a burr's way, mm by time, with the shaft turning by so many rad/s.
fn plan(seconds: f64, turn_rad_s: f64, way_mm: impl Fn(f64) -> Vector3<f64>) -> StreamPlan {
    let mut made = values(seconds, 1.0, 8.0);
    let first: Joints = made.q[..6].try_into().unwrap();
    let start = made.arm.tool_at(&first);
    let mut q = first;
    for (row, joints) in made.q.chunks_exact_mut(6).enumerate() {
        let time_s = row as f64 * PERIOD_S;
        let turn = Rotation3::from_axis_angle(&Vector3::x_axis(), turn_rad_s * time_s);
        let pose = Rigid::new(turn * start.rotation, start.translation_mm + way_mm(time_s));
        q = dls::solve(&made.arm, &ToolGoal::Pose(pose), &q).q.try_into().unwrap();
        joints.copy_from_slice(&q);
    }
    made.plan(settings())
}

/// The farthest from the path that drawn means of targets, and stops from them, lead, as a share of what the tube leaves beside the tolerance.
fn fullest(plan: &StreamPlan, rate: f64, seed: u64) -> f64 {
    let (timing, q) = (plan.settings().timing, plan.track.q());
    let mut draws = SeededDraws::new(seed);
    let backlog = (rate * timing.backlog_s() / plan.period_s) as usize;
    let mut fullest: f64 = 0.0;
    for _ in 0..4000 {
        let newest = backlog + draws.below(q.len() - 2 * backlog - 2);
        // few targets with most of the weight are the hull's corners
        let chosen: Vec<(usize, f64)> =
            (0..3).map(|_| (newest - draws.below(backlog + 1), draws.between(0.0, 1.0).powi(3))).collect();
        let sum: f64 = chosen.iter().map(|(_, w)| w).sum();
        let mean = |of: &dyn Fn(usize, usize) -> f64| -> Joints {
            std::array::from_fn(|j| chosen.iter().map(|(n, w)| w / sum * of(*n, j)).sum())
        };
        let at = mean(&|n, j| q[n][j]);
        let velocity = mean(&|n, j| rate * (q[n + 1][j] - q[n][j]) / plan.period_s);
        let fastest_rad_s = velocity.iter().fold(0.0f64, |most, v| most.max(v.abs()));
        let stop_s = draws.between(0.0, 1.0) * fastest_rad_s / (2.0 * timing.stop_rad_s2);
        let stopped: Joints = std::array::from_fn(|j| at[j] + velocity[j] * stop_s);
        let burr_mm = plan.arm.tool_at(&stopped).translation_mm;
        let near = plan.track.nearest(0.0, plan.track.last_row(), &burr_mm);
        let beside_mm = tube(plan, newest, rate).off_mm - plan.tolerance_mm(newest);
        fullest = fullest.max(near.distance_mm / beside_mm);
    }
    fullest
}

#[test]
fn means_of_targets_and_stops_from_them_stay_in_the_tube() {
    let circle = |t: f64| 3.0 * Vector3::new((4.0 * t).sin(), 1.0 - (4.0 * t).cos(), 0.0);
    let corner = |t: f64| Vector3::new(20.0 * t.min(0.3), 20.0 * (t - 0.3).max(0.0), 0.0);
    let straight = |t: f64| Vector3::new(15.0 * t, 5.0 * t, 0.0);
    for (name, plan) in [
        ("circle", plan(0.6, 0.0, circle)),
        ("circle, shaft turning", plan(0.6, 0.8, circle)),
        ("corner", plan(0.6, 0.0, corner)),
        ("straight, shaft turning", plan(0.6, 1.0, straight)),
    ] {
        for rate in [1.0, 0.4] {
            let share = fullest(&plan, rate, 3);
            println!("{name} at {rate}: {share:.3} of the tube");
            assert!(share <= 1.0, "{name} at {rate}: {share} of the tube");
        }
        // a tube that nothing comes near would tell nothing
        let share = fullest(&plan, 1.0, 4);
        assert!(share > 0.01, "{name}: {share} of the tube");
    }
}

#[test]
fn a_straight_path_needs_no_more_than_an_arm_at_rest() {
    let standing = plan(0.6, 0.0, |_| Vector3::zeros());
    let plan = plan(0.6, 0.0, |t| Vector3::new(10.0 * t, 0.0, 0.0));
    for row in (50..250).step_by(10) {
        let beside_mm = tube(&plan, row, 1.0).off_mm - tube(&standing, row, 1.0).off_mm;
        assert!(beside_mm < 0.05, "row {row}: {beside_mm} mm");
    }
    // beside the tolerance, what joints that are within their own limits can move the burr by when their error's sign changes
    let beside_mm = tube(&standing, 100, 1.0).off_mm - standing.tolerance_mm(100);
    assert!(beside_mm < 0.1, "{beside_mm} mm");
}

#[test]
fn the_widest_place_is_its_own_tubes_though_most_rows_share_a_wider_one() {
    let blocks = 5;
    for (most_mm_s, gap_mm, is_slowed) in [(4.0, 0.6, false), (10.0, 0.6, true), (3.0, 8.0, false)] {
        let plan = values(3.0, most_mm_s, gap_mm).plan(settings());
        assert_eq!(plan.rate.iter().any(|rate| *rate < 1.0), is_slowed, "{gap_mm}");
        let rows = plan.track.rows();
        let piece = plan.piece(0, rows);
        let most = |of: &[f64]| of.iter().copied().fold(0.0, f64::max);
        assert_eq!(most(&plan.off_mm), most(&piece.off_mm));
        let shared = (0..rows).filter(|row| plan.off_mm[*row] != piece.off_mm[*row]).count();
        assert!(shared > 0 && (0..rows).all(|row| plan.off_mm[row] <= most(&piece.off_mm)), "{shared}");
        for row in (0..rows).step_by(blocks) {
            let full = tube(&plan, row, 1.0);
            // a row whose own tube fits is passed at full speed, unless a slower one is near
            assert!(full.off_mm <= full.gap_mm || plan.rate[row] < 1.0, "row {row}: {full:?}");
            assert!(piece.off_mm[row] <= full.gap_mm, "row {row}: {}", piece.off_mm[row]);
        }
    }
}
