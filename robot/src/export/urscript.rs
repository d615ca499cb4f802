//! URScript: a program that runs the whole cut on the controller, in m, rad and s.
//!
//! `servoj` follows the planned joint positions at the planned times. Linear moves are not used, because the controller
//! would time them anew without the plan's speed caps. Before every step the program checks whether the pose is within the
//! safety limits, whether the stop input is set, and how many mm the burr's centre is beside its planned path. If that is more
//! than the room to structures allows at that place, if another check fails, and at the end, it stops the arm softly and
//! switches the spindle off. The arm moves to the start only after the operator has confirmed, with the spindle off.
//!
//! `servoj` lags by tens of milliseconds. So the burr is compared with the part of the path of the last [`LATE_S`], not with
//! one place on it. An arm that lags more than that counts as off its path. Both the burr's place and the path come from
//! the controller's own forward kinematics, so the check does not depend on a calibration.
//!
//! The controller's speed slider stretches the time of all steps equally. Speeds are checked here, so that no step exceeds
//! a joint's limit.

use crate::stream::{TOOL_MM, TOOL_RAD};
use std::io::Write;

use bonemill_arm::RobotError;
use bonemill_arm::{JointKind, ToolMount};

use super::ros::list;
use super::rows::ExportRows;

/// Settings of a program.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UrScript {
    /// The tool on the flange.
    pub mount: ToolMount,
    /// Digital output that switches the spindle on.
    pub spindle_output: u8,
    /// Digital input that stops the program.
    pub stop_input: u8,
    /// Time that the spindle needs to reach its speed, s.
    pub run_up_s: f64,
    /// Whether joint positions were planned with this arm's own calibration.
    pub calibrated: bool,
}

impl UrScript {
    /// Default settings: the first output and the first input, and 3 s for the spindle. Assumed.
    pub fn with_mount(mount: ToolMount) -> Self {
        Self { mount, spindle_output: 0, stop_input: 0, run_up_s: 3.0, calibrated: false }
    }
}

/// What is written besides the motion.
#[derive(Debug, Clone, Copy)]
pub struct ScriptNotes<'a> {
    /// Comments at its head, a line each: what must hold.
    pub lines: &'a [String],
    /// Where the plan has the tool at the first row, in base: m, and the rotation vector, rad. The controller's own must agree.
    pub start_pose: [f64; 6],
    /// By row.
    pub holds: &'a [ScriptHold],
}

/// A place where the arm goes back, switches the spindle off and waits for the user.
#[derive(Debug, Clone, PartialEq)]
pub struct ScriptHold {
    /// The exported row at which it stops.
    pub row: usize,
    /// The exported row to which it goes back along its path.
    pub back_row: usize,
    /// What the user reads.
    pub why: String,
}

/// Farthest of a joint from the first row that the program moves it by itself, rad. Assumed.
const START_RAD: f64 = 0.35;
/// Largest lag of the arm on its path, s: several times the 34 ms that users measured for `servoj`. Assumed.
const LATE_S: f64 = 0.2;
/// Number of past places of the path that the program keeps.
const REMEMBERED: usize = 8;
/// Limits are rounded down to multiples of this, so that a program says few of them, mm.
const ASIDE_STEP_MM: f64 = 0.05;
/// The least distance beside its path that an arm which follows well can keep, mm; assumed.
const LEAST_ASIDE_MM: f64 = 0.1;

/// Writes a program.
///
/// `aside_mm` holds for every exported row how far the burr's centre may be beside its path on the way from the row before,
/// mm, at least 0.1. Since the arm may be late, the program compares with the smallest of the last 0.2 s.
///
/// # Errors
/// [`RobotError::Length`] where the arm has other than six joints, or there is not one limit a row; [`RobotError::Value`] where
/// a joint is not revolute, a step is faster than its joint's limit or a limit beside the path is less than an arm can keep;
/// [`RobotError::Write`] when the writer fails.
pub fn write_urscript(
    out: &mut impl Write,
    rows: &ExportRows<'_>,
    options: &UrScript,
    aside_mm: &[f64],
    notes: ScriptNotes<'_>,
) -> Result<(), RobotError> {
    if aside_mm.len() != rows.count() {
        let (what, got, expected) = ("limits beside the path", aside_mm.len(), rows.count());
        return Err(RobotError::Length { what, got, expected });
    }
    if rows.joints().len() != 6 {
        return Err(RobotError::Length {
            what: "joints of a UR program",
            got: rows.joints().len(),
            expected: 6,
        });
    }
    if let Some(index) = rows.joints().iter().position(|joint| joint.kind != JointKind::Revolute) {
        let (what, unit, expected) = ("joint of a UR program", "(prismatic)", "a revolute joint");
        return Err(RobotError::Value { what, index, value: index as f64, unit, expected });
    }
    rows.check_speeds()?;
    let limits_mm = limits_mm(rows, aside_mm)?;
    let failed =
        |rows_written: usize| move |source| RobotError::Write { rows_written: rows_written as u64, source };
    let (_, start, _) = rows.row(0);
    out.write_all(head(options, &notes, &list(start)).as_bytes()).map_err(failed(0))?;
    let (mut before_s, mut before_mm) = (0.0, f64::NAN);
    for (n, &limit_mm) in limits_mm.iter().enumerate().skip(1) {
        let (time_s, q, _) = rows.row(n);
        let mut line = String::new();
        for hold in notes.holds.iter().filter(|hold| hold.row + 1 == n) {
            let narrow = limits_mm[hold.back_row..=n].iter().copied().fold(limit_mm, f64::min);
            line += &hold_lines(rows, hold, narrow);
            before_mm = f64::NAN;
        }
        if limit_mm != before_mm {
            before_mm = limit_mm;
            line += &format!("  allow({before_mm:.2})\n");
        }
        line += &format!("  step({}, {:.9})\n", list(q), time_s - before_s);
        out.write_all(line.as_bytes()).map_err(failed(n))?;
        before_s = time_s;
    }
    out.write_all(b"  safe_stop(\"done\")\nend\nbonemill()\n").map_err(failed(rows.count()))
}

/// What the program compares with at each row: the smallest limit from [`LATE_S`] before the row before it, rounded down.
fn limits_mm(rows: &ExportRows<'_>, aside_mm: &[f64]) -> Result<Vec<f64>, RobotError> {
    if let Some((index, value)) =
        aside_mm.iter().copied().enumerate().find(|(_, a)| a.is_nan() || *a < LEAST_ASIDE_MM)
    {
        let (what, unit, expected) =
            ("limit beside the path, row", "mm", "at least 0.1 mm, which an arm can keep");
        return Err(RobotError::Value { what, index, value, unit, expected });
    }
    let least = |n: usize| {
        let from_s = rows.row(n.saturating_sub(1)).0 - LATE_S;
        let recent = (0..=n).rev().take_while(|k| rows.row(*k).0 >= from_s);
        let least_mm = recent.map(|k| aside_mm[k]).fold(f64::INFINITY, f64::min);
        (least_mm / ASIDE_STEP_MM * (1.0 + 1e-9)).floor() * ASIDE_STEP_MM
    };
    Ok((0..rows.count()).map(least).collect())
}

/// Stops, goes back along the path at half the speed, waits with the spindle off, and comes again.
fn hold_lines(rows: &ExportRows<'_>, hold: &ScriptHold, allowed_mm: f64) -> String {
    let step = |n: usize, from: usize| {
        let ((t0, ..), (t1, q, _)) = (rows.row(from), rows.row(n));
        format!("  step({}, {:.9})\n", list(q), 2.0 * (t1 - t0).abs())
    };
    let mut text = format!("  allow({allowed_mm:.2})\n  stopj(2.0)\n");
    text.extend((hold.back_row..hold.row).rev().map(|n| step(n, n + 1)));
    text += &format!("  hold(\"{}\")\n", hold.why.replace(['"', '\n'], "'"));
    text.extend((hold.back_row + 1..=hold.row).map(|n| step(n, n - 1)));
    text
}

fn head(options: &UrScript, notes: &ScriptNotes<'_>, start: &str) -> String {
    let planned = list(&notes.start_pose);
    let lines: String = notes.lines.iter().map(|line| format!("  # {line}\n")).collect();
    let tool = &options.mount.flange_from_burr;
    let turn = tool.rotation.scaled_axis();
    let p = tool.translation_mm * 1e-3;
    let tcp = list(&[p.x, p.y, p.z, turn.x, turn.y, turn.z]);
    let UrScript { spindle_output, stop_input, run_up_s, .. } = options;
    let kinematics = if options.calibrated {
        "this arm's own calibration"
    } else {
        "nominal kinematics, 1-2 mm off the real arm"
    };
    // least time between two places that are kept: steps last differently long
    let kept_s = LATE_S / (REMEMBERED - 1) as f64;
    let zeros = list(&[0.0; REMEMBERED]);
    format!(
        "def bonemill():
  # a planned cut, followed on its own clock; m, rad, s. Planned with {kinematics}.
  # Joint positions are what counts; the tool's pose follows from the arm's own calibration.
  # The program stops where the burr's centre is farther beside the path of the last {LATE_S:?} s than the last allow(mm) says:
  # a share of the room that structures leave at that place. Being late on the path by less than that is no fault: servoj
  # follows late. Both places are the controller's own forward kinematics.
{lines}  global reason = \"\"
  # where the plan had the burr's centre, oldest first, m
  global path_x = {zeros}
  global path_y = {zeros}
  global path_z = {zeros}
  global since_s = 0.0
  global most_aside_mm = 0.0
  def allow(mm):
    most_aside_mm = mm
  end
  def safe_stop(why):
    reason = why
    stopj(2.0)
    set_standard_digital_out({spindle_output}, False)
    textmsg(\"bonemill: \", why)
    if why != \"done\":
      popup(why, title=\"bonemill stopped\", error=True, blocking=True)
      halt
    end
  end
  def plan_at(q, k):
    local burr = get_forward_kin(q)
    path_x[k] = burr[0]
    path_y[k] = burr[1]
    path_z[k] = burr[2]
  end
  def remember(q, dt):
    local k = 1
    since_s = since_s + dt
    if since_s >= {kept_s:.4}:
      since_s = 0.0
      while k < {REMEMBERED}:
        path_x[k - 1] = path_x[k]
        path_y[k - 1] = path_y[k]
        path_z[k - 1] = path_z[k]
        k = k + 1
      end
    end
    plan_at(q, {last})
  end
  def aside_mm():
    local burr = get_actual_tcp_pose()
    local least = 1000.0
    local k = 1
    while k < {REMEMBERED}:
      local wx = path_x[k] - path_x[k - 1]
      local wy = path_y[k] - path_y[k - 1]
      local wz = path_z[k] - path_z[k - 1]
      local dx = burr[0] - path_x[k - 1]
      local dy = burr[1] - path_y[k - 1]
      local dz = burr[2] - path_z[k - 1]
      local way = wx * wx + wy * wy + wz * wz
      local share = 0.0
      if way > 0.0:
        share = (dx * wx + dy * wy + dz * wz) / way
      end
      if share < 0.0:
        share = 0.0
      end
      if share > 1.0:
        share = 1.0
      end
      dx = dx - share * wx
      dy = dy - share * wy
      dz = dz - share * wz
      local off = 1000.0 * sqrt(dx * dx + dy * dy + dz * dz)
      if off < least:
        least = off
      end
      k = k + 1
    end
    return least
  end
  def step(q, dt):
    if get_standard_digital_in({stop_input}):
      safe_stop(\"the stop input is set\")
    end
    if not is_within_safety_limits(q):
      safe_stop(\"the next pose is outside the safety limits\")
    end
    if aside_mm() > most_aside_mm:
      textmsg(\"bonemill: mm beside the path that the structures allow here: \", most_aside_mm)
      safe_stop(\"the tool is farther beside its path than the structures allow here\")
    end
    servoj(q, t=dt, lookahead_time=0.1, gain=300)
    remember(q, dt)
  end
  def hold(why):
    stopj(2.0)
    set_standard_digital_out({spindle_output}, False)
    sync()
    if get_standard_digital_out({spindle_output}):
      safe_stop(\"the spindle's output does not switch off\")
    end
    popup(str_cat(\"The spindle's output is off. Go on? Held: \", why), title=\"bonemill\", blocking=True)
    set_standard_digital_out({spindle_output}, True)
    sleep({run_up_s:?})
  end
  set_tcp(p{tcp})
  set_standard_digital_out({spindle_output}, False)
  local apart = pose_trans(pose_inv(p{planned}), get_forward_kin({start}))
  if 1000.0 * sqrt(apart[0] * apart[0] + apart[1] * apart[1] + apart[2] * apart[2]) > {TOOL_MM}:
    safe_stop(\"the tool would not be where the plan has it: another arm, another calibration or another tool\")
  end
  if sqrt(apart[3] * apart[3] + apart[4] * apart[4] + apart[5] * apart[5]) > {TOOL_RAD}:
    safe_stop(\"the tool would be turned against the plan: another arm, another calibration or another tool\")
  end
  local here = get_actual_joint_positions()
  local start = {start}
  local joint = 0
  while joint < 6:
    if here[joint] - start[joint] > {START_RAD} or start[joint] - here[joint] > {START_RAD}:
      safe_stop(\"a joint is more than {START_RAD} rad from where the cut begins: bring the arm there by the pendant\")
    end
    joint = joint + 1
  end
  popup(str_cat(\"The mass on the flange is right? As the controller has it, kg: \", get_target_payload()), title=\"bonemill\", blocking=True)
  popup(\"The arm moves to the start of the cut. Is the way free?\", title=\"bonemill\", blocking=True)
  movej({start}, a=0.5, v=0.2)
  local place = 0
  while place < {REMEMBERED}:
    plan_at({start}, place)
    place = place + 1
  end
  popup(\"The spindle starts, then the cut.\", title=\"bonemill\", warning=True, blocking=True)
  set_standard_digital_out({spindle_output}, True)
  sleep({run_up_s:?})
",
        last = REMEMBERED - 1,
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use bonemill_arm::Arm;
    use bonemill_arm::ur::UrModel;
    use bonemill_geometry::Rigid;
    use nalgebra::{Rotation3, Vector3};

    fn written_past(speed_rad_s: f64, narrow_mm: f64, holds: bool) -> Result<String, RobotError> {
        let arm = Arm::ur(UrModel::Ur5e, None).unwrap();
        let time_s: Vec<f64> = (0..=500).map(|k| f64::from(k) * 0.002).collect();
        let q: Vec<f64> =
            time_s.iter().flat_map(|t| [0.3, -1.2, 1.4 + speed_rad_s * t, -0.7, -1.5, -0.1 * t]).collect();
        let qd = vec![0.0; q.len()];
        let rows = ExportRows::new(arm.joints(), &time_s, &q, &qd, 20)?;
        let turn = Rotation3::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
        let mount = ToolMount { flange_from_burr: Rigid::new(turn, Vector3::new(0.0, 0.0, 180.0)) };
        let mut out = Vec::new();
        // half a second of room, then a narrow place
        let aside_mm: Vec<f64> = (0..rows.count()).map(|n| if n < 13 { 0.5 } else { narrow_mm }).collect();
        let hold = ScriptHold { row: 12, back_row: 10, why: "2 mm from \"nerve\"".into() };
        let holds = if holds { vec![hold] } else { vec![] };
        let lines = ["NOT VERIFIED: a reason".to_owned()];
        let notes = ScriptNotes { lines: &lines, start_pose: [0.1, 0.2, 0.3, 0.0, 3.0, 0.0], holds: &holds };
        write_urscript(&mut out, &rows, &UrScript::with_mount(mount), &aside_mm, notes)?;
        Ok(String::from_utf8(out).unwrap())
    }

    fn written(speed_rad_s: f64) -> Result<String, RobotError> {
        written_past(speed_rad_s, 0.23, false)
    }

    /// The numbers of a `[..]` list.
    fn numbers(text: &str) -> Vec<f64> {
        let (_, rest) = text.split_once('[').unwrap();
        rest.split_once(']').unwrap().0.split(", ").map(|cell| cell.parse().unwrap()).collect()
    }

    #[test]
    fn the_steps_read_back_as_the_motion() {
        let text = written(0.2).unwrap();
        let steps: Vec<&str> = text.lines().filter(|line| line.starts_with("  step(")).collect();
        assert_eq!(steps.len(), 25);
        let mut time_s = 0.0;
        for line in &steps {
            let dt: f64 = line.rsplit_once(", ").unwrap().1.trim_end_matches(')').parse().unwrap();
            time_s += dt;
            let expected = [0.3, -1.2, 1.4 + 0.2 * time_s, -0.7, -1.5, -0.1 * time_s];
            for (read, expected) in numbers(line).iter().zip(expected) {
                assert!((read - expected).abs() < 1e-9, "{line}");
            }
        }
        assert!((time_s - 1.0).abs() < 1e-9);
        let start = text.lines().find(|line| line.starts_with("  movej(")).unwrap();
        assert_eq!(numbers(start), [0.3, -1.2, 1.4, -0.7, -1.5, 0.0]);
        let tcp = numbers(text.lines().find(|line| line.contains("set_tcp")).unwrap());
        assert!((tcp[2] - 0.18).abs() < 1e-9 && (tcp[3].abs() - std::f64::consts::PI).abs() < 1e-8);
    }

    #[test]
    fn blocks_are_closed_and_the_spindle_is_off_first_and_last() {
        let text = written_past(0.2, 0.23, true).unwrap();
        let words = |line: &str| line.trim_start().split([' ', '(']).next().unwrap_or("").to_owned();
        let opened = text.lines().filter(|line| ["def", "if", "while"].contains(&&words(line)[..])).count();
        let closed = text.lines().filter(|line| words(line) == "end").count();
        assert_eq!(opened, closed);
        let place = |what: &str| text.find(what).unwrap();
        assert!(place("set_tcp(") < place("\n  set_standard_digital_out(0, False)\n  local"));
        assert!(place("\n  set_standard_digital_out(0, False)\n  local") < place("movej("));
        assert!(place("movej(") < place("\n  set_standard_digital_out(0, True)"));
        assert!(text.trim_end().ends_with("safe_stop(\"done\")\nend\nbonemill()"));
    }

    #[test]
    fn what_is_remembered_of_the_path_lasts_as_long_as_the_arm_may_be_late() {
        let text = written(0.2).unwrap();
        let (_, rest) = text.split_once("if since_s >= ").unwrap();
        let kept_s: f64 = rest.split_once(':').unwrap().0.parse().unwrap();
        // whatever the steps' durations, the places lie at least so far apart in time
        assert!(kept_s * (REMEMBERED - 1) as f64 >= LATE_S - 1e-3, "{kept_s} s");
        assert!(text.contains("since_s = since_s + dt") && text.contains("    remember(q, dt)\n"));
    }

    #[test]
    fn what_must_hold_is_said_and_tested_before_the_arm_moves() {
        let text = written(0.2).unwrap();
        let place = |what: &str| text.find(what).unwrap_or_else(|| panic!("{what}"));
        let moves = place("\n  movej(");
        assert!(place("# NOT VERIFIED: a reason") < place("global reason"));
        for test in [
            "pose_trans(pose_inv(p[0.1, 0.2, 0.3, 0.0, 3.0, 0.0]), get_forward_kin([0.3, -1.2, 1.4, -0.7, -1.5, 0.0]))",
            "> 0.1:",
            "> 0.002:",
            "get_actual_joint_positions()",
            "get_target_payload()",
        ] {
            assert!(place(test) < moves, "{test}");
        }
    }

    #[test]
    fn a_hold_goes_back_waits_with_the_spindle_off_and_comes_again() {
        let text = written_past(0.2, 0.23, true).unwrap();
        let (before, after) = text.split_once("\n  hold(\"2 mm from 'nerve'\")\n").unwrap();
        let lines = |text: &str| text.lines().map(str::to_owned).collect::<Vec<_>>();
        let (before, after) = (lines(before), lines(after));
        let joint = |line: &str| numbers(line)[2];
        // up to row 12, back over 11 to 10, and over 11 to 12 again, at half the speed
        let rows: Vec<f64> = before[before.len() - 2..].iter().chain(&after[..2]).map(|l| joint(l)).collect();
        let expected = [11.0, 10.0, 11.0, 12.0].map(|row| 1.4 + 0.2 * 0.04 * row);
        assert!(rows.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-8), "{rows:?}");
        assert!(after[..2].iter().all(|line| line.ends_with("0.080000000)")), "{:?}", &after[..2]);
        assert_eq!(before[before.len() - 3], "  stopj(2.0)");
        let def = text.split_once("  def hold(why):").unwrap().1;
        let place = |what: &str| def.find(what).unwrap();
        let (off, seen) =
            (place("set_standard_digital_out(0, False)"), place("if get_standard_digital_out(0):"));
        assert!(off < seen && seen < place("popup(") && place("popup(") < place("(0, True)"));
    }

    #[test]
    fn what_a_controller_cannot_run_is_refused() {
        assert!(matches!(written(4.0), Err(RobotError::Value { what: "joint speed in step", .. })));
        assert!(written(1.2).is_ok());
        let bone = Arm::bone_attached().unwrap();
        let rows = ExportRows::new(bone.joints(), &[0.0], &[0.0; 4], &[0.0; 4], 1).unwrap();
        let options = UrScript::with_mount(ToolMount::default());
        assert!(matches!(
            write_urscript(
                &mut Vec::new(),
                &rows,
                &options,
                &[0.5],
                ScriptNotes { lines: &[], start_pose: [0.0; 6], holds: &[] }
            ),
            Err(RobotError::Length { expected: 6, .. })
        ));
    }

    #[test]
    fn the_limit_beside_the_path_follows_the_room_and_is_never_wider() {
        let text = written(0.2).unwrap();
        let (mut limit_mm, mut limits_mm) = (f64::NAN, Vec::new());
        for line in text.lines() {
            if let Some(mm) = line.strip_prefix("  allow(") {
                limit_mm = mm.trim_end_matches(')').parse().unwrap();
            } else if line.starts_with("  step([") {
                limits_mm.push(limit_mm);
            }
        }
        // row 13 is at 0.52 s: narrow from the step that leads there
        assert_eq!(limits_mm.len(), 25);
        assert!(limits_mm[..12].iter().all(|mm| *mm == 0.5) && limits_mm[12..].iter().all(|mm| *mm == 0.2));
        assert_eq!(text.matches("\n  allow(").count(), 2);
        assert!(text.contains("if aside_mm() > most_aside_mm:"));
        for too_narrow in [0.09, 0.0, -1.0, f64::NAN] {
            let refused = written_past(0.2, too_narrow, false).unwrap_err().to_string();
            assert!(refused.contains("limit beside the path, row[13]"), "{refused}");
        }
    }
}
