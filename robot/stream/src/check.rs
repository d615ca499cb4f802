//! What must hold before the first motion. Every check says what was found, what was expected and what to do.
//!
//! The controller's own tool pose is compared with the plan's kinematics: that covers the arm's model, its calibration and the tool
//! centre point in one, at the pose where it counts.

use bonemill_arm::ur::UrModel;
use nalgebra::{UnitQuaternion, Vector3};

use crate::bound::{Tube, tube};
use crate::link::{ArmState, Identity, PLAYING, SAFETY_NORMAL};
use crate::plan::{Standing, StreamPlan};
use crate::tube::BLOCK;

/// How far the controller's tool pose may be from the plan's, mm. Assumed: a tenth of a common clearance.
const TOOL_MM: f64 = 0.1;
/// How far it may be turned, rad. Assumed: 0.1 mm at 50 mm.
const TOOL_RAD: f64 = 2e-3;
/// How far the payloads may differ, kg. Assumed.
const PAYLOAD_KG: f64 = 0.05;
/// Speed fraction above which the slider counts as being at 100 %.
pub(crate) const FULL_SPEED: f64 = 0.999;

/// The first thing that does not hold.
///
/// # Errors
/// It, in words.
pub fn ready(plan: &StreamPlan, state: &ArmState, identity: &Identity) -> Result<(), String> {
    if let (Standing::Unverified(why), false) = (&plan.standing, plan.settings().unverified) {
        return Err(format!("the plan is not verified: {why}; verify it, or say --unverified"));
    }
    speeds(plan)?;
    which_arm(plan, identity)?;
    if state.safety_mode != SAFETY_NORMAL {
        return Err(crate::Cause::SafetyMode(state.safety_mode).to_string());
    }
    if !(state.speed_fraction >= FULL_SPEED) {
        return Err(format!(
            "the speed slider is at {:.0} %: start with 100 %, the plan's times hold there",
            100.0 * state.speed_fraction
        ));
    }
    idle(state)?;
    payload(plan, state)?;
    tool(plan, state)
}

/// No other program moves the arm.
fn idle(state: &ArmState) -> Result<(), String> {
    if state.runtime_state == PLAYING {
        return Err("a program already runs on the controller: stop it, and let other clients go".into());
    }
    Ok(())
}

/// The bound is no larger than the clearance left, or the user wants to be slowed down, and that is enough.
fn speeds(plan: &StreamPlan) -> Result<(), String> {
    let rate = plan.rate.iter().copied().fold(1.0, f64::min);
    if rate >= 1.0 || (plan.settings().slow && rate > 0.0) {
        return Ok(());
    }
    // rows before a narrow place are slowed as well: the place itself is where the tube is widest for its room
    let slowed = (0..plan.rate.len()).step_by(BLOCK).filter(|row| plan.rate[*row] < 1.0);
    let tubes = slowed.map(|row| (row, tube(plan, row, 1.0)));
    let missing_mm = |of: &(usize, Tube)| of.1.off_mm - of.1.gap_mm;
    let Some((row, tube)) = tubes.max_by(|a, b| missing_mm(a).total_cmp(&missing_mm(b))) else {
        return Ok(());
    };
    let advice =
        if rate > 0.0 { "stream with --slow" } else { "no speed is slow enough: plan with more clearance" };
    Err(format!(
        "near row {row} ({:.1} s) a stop or a failure could bring the tool {:.2} mm off its path, with {:.2} mm left to the nearest \
         structure: {advice}",
        row as f64 * plan.period_s,
        tube.off_mm,
        tube.gap_mm,
    ))
}

/// The plan's model, and the serial number that the user states.
fn which_arm(plan: &StreamPlan, identity: &Identity) -> Result<(), String> {
    let Identity { model, serial } = identity;
    if model.is_empty() || serial.is_empty() {
        return Err(
            "the controller did not say its model and serial number: its dashboard (port 29999) must answer"
                .into(),
        );
    }
    let reach = |name: &str| name.chars().filter(char::is_ascii_digit).collect::<String>();
    // an arm of the user's own description has no model to compare
    if let Some(planned) =
        UrModel::by_name(&plan.model).filter(|planned| reach(planned.name()) != reach(model))
    {
        return Err(format!("the controller moves a {model}, the plan is for a {}", planned.name()));
    }
    if let Some(stated) = plan.settings().serial.as_ref().filter(|stated| *stated != serial) {
        return Err(format!("the controller's arm has the serial number {serial}, expected {stated}"));
    }
    Ok(())
}

fn payload(plan: &StreamPlan, state: &ArmState) -> Result<(), String> {
    let found_kg = state.payload_kg;
    match plan.settings().payload_kg {
        None => Err(format!(
            "the mass on the flange is not stated, and the controller says {found_kg:.2} kg: confirm it with --payload-kg {found_kg:.2}"
        )),
        Some(kg) if !((found_kg - kg).abs() <= PAYLOAD_KG) => Err(format!(
            "the controller carries {found_kg:.2} kg on its flange, expected {kg:.2} kg: set the payload on the pendant"
        )),
        Some(_) => Ok(()),
    }
}

fn tool(plan: &StreamPlan, state: &ArmState) -> Result<(), String> {
    let planned = plan.arm.tool_at(&state.q);
    let (place, turn) = state.tool_pose;
    let off_mm = (Vector3::from(place) - planned.translation_mm).norm();
    let burr = UnitQuaternion::from_rotation_matrix(&planned.rotation);
    let off_rad = UnitQuaternion::from_scaled_axis(Vector3::from(turn)).angle_to(&burr);
    if off_mm <= TOOL_MM && off_rad <= TOOL_RAD {
        return Ok(());
    }
    let p = planned.translation_mm;
    Err(format!(
        "the controller has its tool centre point at ({:.2}, {:.2}, {:.2}) mm in its base, the plan's arm has the tool at ({:.2}, {:.2}, {:.2}): \
         {off_mm:.2} mm and {:.1} mrad apart. Set the tool centre point to flange_from_burr, and plan with this arm's own calibration",
        place[0],
        place[1],
        place[2],
        p.x,
        p.y,
        p.z,
        1e3 * off_rad
    ))
}
