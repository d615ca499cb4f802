//! What must hold before the first motion. Every check says what was found, what was expected and what to do.
//!
//! The controller's own tool pose is compared with the plan's kinematics: that covers the arm's model, its calibration and the tool
//! centre point in one, at the pose where it counts.

use bonemill_arm::ur::UrModel;
use nalgebra::{UnitQuaternion, Vector3};

use crate::stream::bound::{Tube, tube};
use crate::stream::link::{ArmState, Identity, PLAYING, ROBOT_RUNNING, SAFETY_NORMAL, STOPPED};
use crate::stream::plan::{Standing, StreamPlan};
use crate::stream::settings::StreamTiming;
use crate::stream::tube::BLOCK;
use crate::stream::watch::Watch;

/// How far the controller's tool pose may be from the plan's, mm. Assumed: a tenth of a common clearance.
pub(crate) const TOOL_MM: f64 = 0.1;
/// How far it may be turned, rad. Assumed: 0.1 mm at 50 mm.
pub(crate) const TOOL_RAD: f64 = 2e-3;
/// How far the payloads may differ, kg. Assumed.
const PAYLOAD_KG: f64 = 0.05;
/// Speed fraction above which the slider counts as being at 100 %.
pub(crate) const FULL_SPEED: f64 = 0.999;

/// How much longer than the plan's period a controller's may be.
const PERIODS: f64 = 1.5;
/// Of so many states one comes a period after the one before, however busy this PC is.
pub(crate) const RATE_STATES: u32 = 100;

/// The first of the start conditions that does not hold. They are looked at when the controller has answered, again when the user has
/// confirmed, and, but for [`idle`], once more when the program that follows targets runs.
///
/// # Errors
/// It, in words.
pub fn ready(plan: &StreamPlan, watch: &Watch, identity: &Identity) -> Result<(), String> {
    idle(state(watch)?)?;
    still_ready(plan, watch, identity)
}

/// All that must hold before the first motion but that no program runs.
///
/// # Errors
/// The first that does not, in words.
pub fn still_ready(plan: &StreamPlan, watch: &Watch, identity: &Identity) -> Result<(), String> {
    plan_ready(plan)?;
    let state = state(watch)?;
    which_arm(plan, identity)?;
    if identity.is_local {
        return Err("the controller is in local control: set remote control on the pendant".into());
    }
    if state.safety_mode != SAFETY_NORMAL {
        return Err(crate::stream::Cause::SafetyMode(state.safety_mode).to_string());
    }
    arm_on(state)?;
    rate(plan, watch)?;
    if state.spindle_on {
        return Err(
            "the spindle's output is on: switch it off, the arm first moves with the spindle off".into()
        );
    }
    if !(state.speed_fraction >= FULL_SPEED) {
        return Err(format!(
            "the speed slider is at {:.0} %: start with 100 %, the plan's times hold there",
            100.0 * state.speed_fraction
        ));
    }
    payload(plan, state)?;
    tool(plan, state)
}

/// What of the plan alone no run is begun with.
///
/// # Errors
/// The first, in words.
pub fn plan_ready(plan: &StreamPlan) -> Result<(), String> {
    if let (Standing::Unverified(why), false) = (&plan.standing, plan.settings().unverified) {
        return Err(format!("the plan is not verified: {why}; verify it, or say --unverified"));
    }
    speeds(plan)
}

fn state(watch: &Watch) -> Result<&ArmState, String> {
    if let Some(nonsense) = watch.nonsense() {
        return Err(nonsense.to_string());
    }
    watch.newest().ok_or_else(|| "the controller said nothing yet".into())
}

/// No other program is on the controller, running or paused: starting this one would end it.
fn idle(state: &ArmState) -> Result<(), String> {
    let what = match state.runtime_state {
        STOPPED => return Ok(()),
        PLAYING => "a program already runs".to_owned(),
        3 | 4 => "a program is paused".to_owned(),
        other => format!("a program is in runtime state {other}, expected 1 (stopped),"),
    };
    Err(format!("{what} on the controller: stop it, and let other clients go"))
}

/// The arm is on, its brakes are open, and nobody moves it by hand.
fn arm_on(state: &ArmState) -> Result<(), String> {
    if state.freedrive {
        return Err("the arm is in freedrive: let go of the button on the pendant".into());
    }
    let name = match state.robot_mode {
        ROBOT_RUNNING => return Ok(()),
        -1 => "no controller",
        0 => "disconnected",
        1 => "safety to be confirmed",
        2 => "booting",
        3 => "power off",
        4 => "power on",
        5 => "idle: the brakes are closed",
        6 => "backdrive: moved by hand",
        8 => "updating",
        _ => "unknown",
    };
    let mode = state.robot_mode;
    Err(format!(
        "the arm's robot mode is {mode} ({name}): expected 7 (running): start the arm on the pendant"
    ))
}

/// The controller takes targets as often as the plan has rows.
fn rate(plan: &StreamPlan, watch: &Watch) -> Result<(), String> {
    let (step_s, _) = watch.step_s();
    if step_s <= PERIODS * plan.period_s {
        return Ok(());
    }
    Err(format!(
        "the controller says its state every {:.1} ms ({:.0} Hz), the plan has a row every {:.1} ms: plan with robot.rate_hz = {:.0}",
        1e3 * step_s,
        1.0 / step_s,
        1e3 * plan.period_s,
        1.0 / step_s
    ))
}

/// Whether the controller's rate is known: a state came in time, or enough have come late.
pub(crate) fn rate_is_known(plan: &StreamPlan, watch: &Watch) -> bool {
    let (step_s, states) = watch.step_s();
    step_s <= PERIODS * plan.period_s || states >= RATE_STATES
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
    let is_later = plan.settings().timing.lag_s > StreamTiming::ASSUMED.lag_s;
    let advice = if rate > 0.0 {
        "stream with --slow"
    } else if is_later {
        "no speed is slow enough: follow more closely with a smaller --lookahead-s or a larger --gain, or plan with more clearance"
    } else {
        "no speed is slow enough: plan with more clearance"
    };
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
    let Identity { model, serial, .. } = identity;
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
