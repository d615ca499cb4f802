//! The moves by an arm, with the spindle or the block on its flange: what the joints do, seen by forward kinematics alone, is what was programmed.

#![allow(clippy::unwrap_used, reason = "a test's helper fails by panicking")]

#[allow(dead_code, reason = "these tests need no proof")]
mod common;

use bonemill_arm::arm::{Arm, BlockMount};
use bonemill_arm::ur::UrModel;
use bonemill_geometry::Rigid;
use bonemill_prosthesis::machining::trajectory::{block_on_flange, spindle_on_flange};
use bonemill_prosthesis::machining::{Facing, MachiningJob, TipMove, plan};
use bonemill_robot::timelaw::{CornerTolerance, PathLimits, TimeLaw};
use common::{Shell, flat, job};
use nalgebra::{Rotation3, Vector3};

/// A row is looked at this often, 1/s.
const RATE_HZ: f64 = 200.0;

/// A small part with a coarse finishing step, so that the test is quick, and its moves.
fn milled() -> (MachiningJob, Vec<TipMove>) {
    let shell =
        Shell { outer_mm: 40.0, inner_mm: 36.0, outline_mm: 5.0, bevel_mm: 0.5, thickness_mm: 3.0, rings: 8 };
    let part = shell.mesh();
    let mut job = job(&part, flat());
    job.process.finishing_step_mm = 0.15;
    let moves = plan(&part, &job).unwrap().moves;
    (job, moves)
}

fn within_limits(arm: &Arm, law: &TimeLaw) {
    let limits = PathLimits::of_arm(arm, CornerTolerance { burr_mm: 0.01, axis_rad: 1e-3 }).unwrap();
    let ratios = law.limit_ratios(&limits);
    let most = ratios.velocity.max(ratios.acceleration).max(ratios.jerk);
    assert!(most <= 1.0 + 1e-9, "{ratios:?}");
}

/// Distance of a point from the segment between two others, mm.
fn from_segment(p: &Vector3<f64>, [a, b]: [Vector3<f64>; 2]) -> f64 {
    let (along, from) = (b - a, p - a);
    let t = if along.norm() > 0.0 { (from.dot(&along) / along.norm_squared()).clamp(0.0, 1.0) } else { 0.0 };
    (from - along * t).norm()
}

#[test]
fn an_arm_follows_the_moves_within_its_limits_or_says_where_it_cannot() {
    let (_, moves) = milled();
    let arm = Arm::ur(UrModel::Ur5e, None).unwrap();
    let base_from_machine = nalgebra::Isometry3::translation(450.0, 0.0, 200.0);
    let motion = spindle_on_flange(&arm, &base_from_machine, &moves).unwrap().unwrap();
    within_limits(&arm, &motion.law);
    // the tip keeps to the polyline in the machine's axes, and its axis upright
    let tips: Vec<Vector3<f64>> = moves
        .iter()
        .map(|m| bonemill_prosthesis::machining::Facing::of(m.a_rad).from_block(&m.tip_mm))
        .collect();
    for k in 0..60 {
        let tool = arm.tool_at(&motion.law.sample(motion.law.duration_s() * f64::from(k) / 59.0).q);
        let tip = tool.translation_mm - base_from_machine.translation.vector;
        let off = tips.windows(2).map(|ends| from_segment(&tip, [ends[0], ends[1]]));
        assert!(off.fold(f64::INFINITY, f64::min) < 0.02, "at {k}");
        assert!(tool.rotation.matrix().column(2).z > 1.0 - 1e-5);
    }
    let far = nalgebra::Isometry3::translation(2000.0, 0.0, 200.0);
    let out = spindle_on_flange(&arm, &far, &moves).unwrap().unwrap_err();
    assert!(out.pose < moves.len());
}

/// The block 100 mm before the flange, by its lower end in z, and the spindle upright below its cutter's tip.
fn held(job: &MachiningJob) -> BlockMount {
    let grip = Vector3::new(0.0, 0.0, job.block.low_mm.z);
    BlockMount {
        flange_from_block: Rigid::new(Rotation3::identity(), Vector3::new(0.0, 0.0, 100.0) - grip),
        base_from_tool: Rigid::new(
            Rotation3::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI),
            Vector3::new(425.0, 0.0, 212.0),
        ),
    }
}

/// What part of a move the tip is on.
#[derive(Debug, Clone, Copy, PartialEq)]
enum On {
    Line,
    /// The half turn before the line.
    Turn,
}

/// Whether tip and axis, in the block, are where a move has them.
fn on([from, to]: [&TipMove; 2], tip: &Vector3<f64>, axis: &Vector3<f64>) -> Option<On> {
    let [before, after] = [from, to].map(|m| Facing::of(m.a_rad));
    let start = after.to_block(&before.from_block(&from.tip_mm));
    let upright = after.to_block(&Vector3::z());
    if from_segment(tip, [start, to.tip_mm]) < 0.02 && (axis - upright).norm() < 1e-3 {
        return Some(On::Line);
    }
    // the axis has gone from +y over +z to -y, or back, and the tip has gone with it
    let angle = axis.dot(&Vector3::y()).clamp(-1.0, 1.0).acos();
    let turned = Rotation3::from_axis_angle(&Vector3::x_axis(), angle);
    let at_front = Facing::Front.to_block(&before.from_block(&from.tip_mm));
    let is_there = (axis - turned * Vector3::y()).norm() < 1e-3 && (tip - turned * at_front).norm() < 0.05;
    (before != after && is_there).then_some(On::Turn)
}

#[test]
fn an_arm_that_holds_the_block_brings_it_to_the_spindle_as_programmed() {
    let (job, moves) = milled();
    let mount = held(&job);
    let arm = Arm::ur(UrModel::Ur5e, None).unwrap().with_mount(mount);
    let law = block_on_flange(&arm, &moves).unwrap().unwrap().law;
    within_limits(&arm, &law);

    let spindle = mount.base_from_tool.rotation * Vector3::z();
    let rows = (law.duration_s() * RATE_HZ).ceil() as usize;
    let (mut n, mut turning, mut before) = (1, 0, None::<(usize, Vector3<f64>)>);
    for row in 0..=rows {
        let flange = arm.forward(&law.sample(row as f64 / RATE_HZ).q).unwrap();
        let to_block = |v: &Vector3<f64>| {
            let block_from_flange = mount.flange_from_block.rotation.transpose();
            block_from_flange * (flange.rotation.transpose() * v)
        };
        let from_grip = mount.base_from_tool.translation_mm
            - flange.translation_mm
            - flange.rotation * mount.flange_from_block.translation_mm;
        let (tip, axis) = (to_block(&from_grip), to_block(&spindle));
        let ahead =
            (n..moves.len()).take(60).find_map(|n| Some((n, on([&moves[n - 1], &moves[n]], &tip, &axis)?)));
        let (at, part) =
            ahead.unwrap_or_else(|| panic!("row {row}, after move {n}: tip {tip:?}, axis {axis:?}"));
        n = at;
        if part == On::Turn {
            turning += 1;
            // the flange stays behind the tip, seen along the spindle
            let ahead_mm = spindle.dot(&(flange.translation_mm - mount.base_from_tool.translation_mm));
            assert!(ahead_mm < -job.block.high_mm.y, "{ahead_mm} mm in row {row}");
        }
        if let Some((last, last_tip)) = before {
            let feeds = moves[last - 1..(n + 2).min(moves.len())].iter().map(|m| m.feed_mm_min / 60.0);
            let (speed, most) = ((tip - last_tip).norm() * RATE_HZ, feeds.fold(0.0, f64::max));
            assert!(speed <= most * (1.0 + 1e-6), "{speed} mm/s in row {row}, at most {most} mm/s");
        }
        before = Some((n, tip));
    }
    assert_eq!(n, moves.len() - 1);
    // two half turns of a few seconds
    assert!(turning as f64 > 4.0 * RATE_HZ, "{turning} rows");

    let far = Rigid::new(mount.base_from_tool.rotation, Vector3::new(2000.0, 0.0, 212.0));
    let out = block_on_flange(&arm.with_mount(BlockMount { base_from_tool: far, ..mount }), &moves);
    assert!(out.unwrap().unwrap_err().pose < moves.len());
}
