//! The way to the first place: straight for the burr, slow, from the side that the plan retracts to.
//!
//! The tool's whole pose goes from where it is to where the motion begins: its origin on a line, its rotation about one axis. Joints
//! follow by damped least squares from row to row, so the arm stays in its posture; one that begins in another posture is refused.
//! Whether the line is free of what the plan does not know is for the user to confirm.

use bonemill_arm::Arm;
use bonemill_arm::arm::ToolGoal;
use bonemill_arm::arm::dls;
use bonemill_geometry::Rigid;
use nalgebra::{UnitQuaternion, Vector3};

use crate::stream::link::{Joints, padded};
use crate::stream::plan::StreamPlan;
use crate::stream::track::Track;

/// How far a row's pose may be from the line, mm and rad.
const EXACT: f64 = 1e-6;
/// How far the last row may be from the place that it leads to, rad.
const SAME_RAD: f64 = 1e-4;

/// The way to a place of the plan.
#[derive(Debug, Clone, PartialEq)]
pub struct Approach {
    /// The rows, from where the arm is to where the plan is entered.
    pub track: Track,
    /// Its length, mm.
    pub length_mm: f64,
    /// Where the plan is entered, in rows.
    pub row: f64,
}

impl Approach {
    /// The way from joints to a place of the plan.
    ///
    /// # Errors
    /// Why there is none, in words: too far, from another side than the plan retracts to, another posture, out of reach.
    pub fn new(plan: &StreamPlan, from: &Joints, row: f64) -> Result<Self, String> {
        let settings = plan.settings();
        let to = plan.track.joints(row);
        let (start, end) = (plan.arm.tool_at(from), plan.arm.tool_at(&to));
        let way_mm = start.translation_mm - end.translation_mm;
        let length_mm = way_mm.norm();
        if length_mm > settings.approach_most_mm {
            return Err(format!(
                "the tool is {length_mm:.1} mm from where the motion begins, at most {:.0} mm: move the arm nearer",
                settings.approach_most_mm
            ));
        }
        let outward = end.rotation * Vector3::z();
        // as near as a stopped run leaves it: it came from there
        let touches = length_mm <= plan.left_mm(row);
        let aside_rad = if touches { 0.0 } else { way_mm.angle(&outward) };
        if aside_rad > settings.approach_cone_rad {
            return Err(format!(
                "the tool is {length_mm:.2} mm from where the motion begins, {:.0}° beside the shaft's way out: bring it within {:.0}° of it, on the handpiece's side",
                aside_rad.to_degrees(),
                settings.approach_cone_rad.to_degrees()
            ));
        }
        // a quaternion, since a rotation matrix's angle is lost to rounding near 0 and π
        let from_turn = UnitQuaternion::from_rotation_matrix(&start.rotation);
        let turn = from_turn.rotation_to(&UnitQuaternion::from_rotation_matrix(&end.rotation));
        let duration_s = (length_mm / settings.approach_mm_s).max(turn.angle() / settings.approach_rad_s);
        let steps = (duration_s / plan.period_s).ceil().max(1.0) as usize;
        let mut rows = Vec::with_capacity(steps + 1);
        rows.push(*from);
        for n in 1..=steps {
            let share = n as f64 / steps as f64;
            let at = start.translation_mm.lerp(&end.translation_mm, share);
            let rotation = UnitQuaternion::from_scaled_axis(turn.scaled_axis() * share) * from_turn;
            let before = rows[n - 1];
            rows.push(follow(&plan.arm, Rigid::new(rotation.to_rotation_matrix(), at), &before)?);
        }
        same_posture(&rows[steps], &to)?;
        rows[steps] = to;
        check_steps(plan, &rows)?;
        Ok(Self { track: Track::new(&plan.arm, plan.track.stops(), rows), length_mm, row })
    }

    /// The same way from where the arm is now: what it moved by since fades out evenly. It takes no inverse kinematics, which would hold up the
    /// first targets for longer than a controller's watchdog waits.
    pub fn begun_at(self, plan: &StreamPlan, q: &Joints) -> Self {
        let rows = self.track.q();
        let shifted = |n: usize| -> Joints {
            let left = 1.0 - n as f64 / self.track.last_row();
            std::array::from_fn(|j| rows[n][j] + left * (q[j] - rows[0][j]))
        };
        let track = Track::new(&plan.arm, plan.track.stops(), (0..rows.len()).map(shifted).collect());
        Self { track, ..self }
    }
}

fn follow(
    arm: &Arm,
    pose: Rigid<bonemill_geometry::Base, bonemill_geometry::Tool>,
    before: &Joints,
) -> Result<Joints, String> {
    let found = dls::solve(arm, &ToolGoal::Pose(pose), &before[..arm.dof()]);
    let joints = found.is_within(EXACT).then(|| padded(&found.q)).flatten();
    joints.ok_or_else(|| {
        format!(
            "the straight approach leads out of the arm's reach: {:.2} mm are missing; move the arm nearer to where the motion begins",
            found.short_mm
        )
    })
}

fn same_posture(found: &Joints, to: &Joints) -> Result<(), String> {
    let off = found.iter().zip(to).map(|(a, b)| (a - b).abs()).enumerate();
    match off.max_by(|a, b| a.1.total_cmp(&b.1)) {
        Some((joint, off)) if !(off <= SAME_RAD) => Err(format!(
            "the arm is in another posture than the plan: joint {} would end {off:.3} rad from its place; move the arm near {to:.4?} rad",
            joint + 1
        )),
        _ => Ok(()),
    }
}

fn check_steps(plan: &StreamPlan, rows: &[Joints]) -> Result<(), String> {
    for pair in rows.windows(2) {
        for (joint, (a, b)) in plan.arm.joints().iter().zip(pair[0].iter().zip(&pair[1])) {
            let speed = (b - a).abs() / plan.period_s;
            if !(speed <= joint.velocity_limit) {
                return Err(format!(
                    "the straight approach needs {speed:.2} rad/s of joint {}, limit {}: another start is needed",
                    joint.name, joint.velocity_limit
                ));
            }
        }
    }
    Ok(())
}
