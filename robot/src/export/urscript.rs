//! URScript: a program that runs the whole cut on the controller. m, rad, s.
//!
//! `servoj` follows the planned joint positions on the planned clock; linear moves would be timed anew by the controller,
//! which knows nothing of the caps. Before every step it asks whether the pose is within the safety limits, whether the stop
//! input is set and whether the arm is where the plan has it; if not, and at the end, it stops the arm softly and switches
//! the spindle off. The arm moves to the start only after the operator has confirmed, with the spindle off.
//!
//! The controller's speed slider stretches the clock evenly. Speeds are checked here, so that no step asks for more than a
//! joint's limit.

use std::io::Write;

use super::ros::list;
use super::rows::ExportRows;
use crate::error::RobotError;
use crate::{JointKind, ToolMount};

/// What a program needs beside the motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UrScript {
    /// The tool on the flange.
    pub mount: ToolMount,
    /// Digital output that switches the spindle on.
    pub spindle_output: u8,
    /// Digital input that stops the program.
    pub stop_input: u8,
    /// Time that the spindle needs to run up, s.
    pub run_up_s: f64,
    /// Whether joint positions were planned with this arm's own calibration.
    pub calibrated: bool,
    /// Farthest that a joint may be from its plan before the program stops, rad.
    pub most_lag_rad: f64,
}

impl UrScript {
    /// Outputs and inputs as numbered first; 3 s to run up; 0.05 rad, twice what `servoj` lags at a joint's fastest cut.
    /// Assumed.
    pub fn with_mount(mount: ToolMount) -> Self {
        Self { mount, spindle_output: 0, stop_input: 0, run_up_s: 3.0, calibrated: false, most_lag_rad: 0.05 }
    }
}

/// Writes a program.
///
/// # Errors
/// [`RobotError::Length`] where the arm has other than six joints; [`RobotError::Value`] where a joint is not revolute, a
/// step is faster than its joint's limit or longer than what the program lets a joint lag by; [`RobotError::Write`] when the writer fails.
pub fn write_urscript(
    out: &mut impl Write,
    rows: &ExportRows<'_>,
    options: &UrScript,
) -> Result<(), RobotError> {
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
    check_steps(rows, options.most_lag_rad)?;
    let failed =
        |rows_written: usize| move |source| RobotError::Write { rows_written: rows_written as u64, source };
    let (_, start, _) = rows.row(0);
    out.write_all(head(options, &list(start)).as_bytes()).map_err(failed(0))?;
    let mut before_s = 0.0;
    for n in 1..rows.count() {
        let (time_s, q, _) = rows.row(n);
        let line = format!("  step({}, {:.9})\n", list(q), time_s - before_s);
        out.write_all(line.as_bytes()).map_err(failed(n))?;
        before_s = time_s;
    }
    out.write_all(b"  safe_stop(\"done\")\nend\nbonemill()\n").map_err(failed(rows.count()))
}

/// No step asks for more than a joint's speed limit, nor is so long that the program would stop in it.
fn check_steps(rows: &ExportRows<'_>, most_lag_rad: f64) -> Result<(), RobotError> {
    for n in 1..rows.count() {
        let ((t0, from, _), (t1, to, _)) = (rows.row(n - 1), rows.row(n));
        for (joint, (a, b)) in rows.joints().iter().zip(from.iter().zip(to)) {
            let step = (b - a).abs();
            if step > most_lag_rad {
                let (what, unit, expected) =
                    ("joint's way in step", "rad", "at most what the program lets a joint lag by: more rows");
                return Err(RobotError::Value { what, index: n, value: step, unit, expected });
            }
            let speed = step / (t1 - t0);
            if !speed.is_finite() || speed > joint.velocity_limit * (1.0 + 1e-6) {
                let (what, unit, expected) = ("joint speed in step", "rad/s", "at most the joint's limit");
                return Err(RobotError::Value { what, index: n, value: speed, unit, expected });
            }
        }
    }
    Ok(())
}

fn head(options: &UrScript, start: &str) -> String {
    let tool = &options.mount.flange_from_burr;
    let turn = tool.rotation.scaled_axis();
    let p = tool.translation_mm * 1e-3;
    let tcp = list(&[p.x, p.y, p.z, turn.x, turn.y, turn.z]);
    let UrScript { spindle_output, stop_input, run_up_s, most_lag_rad, .. } = options;
    let kinematics = if options.calibrated {
        "this arm's own calibration"
    } else {
        "nominal kinematics, 1-2 mm off the real arm"
    };
    format!(
        "def bonemill():
  # a planned cut, followed on its own clock; m, rad, s. Planned with {kinematics}.
  # Joint positions are what counts; the tool's pose follows from the arm's own calibration.
  global reason = \"\"
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
  def lag(q):
    local now = get_actual_joint_positions()
    local most = 0
    local j = 0
    while j < 6:
      local off = norm(q[j] - now[j])
      if off > most:
        most = off
      end
      j = j + 1
    end
    return most
  end
  def step(q, dt):
    if get_standard_digital_in({stop_input}):
      safe_stop(\"the stop input is set\")
    end
    if not is_within_safety_limits(q):
      safe_stop(\"the next pose is outside the safety limits\")
    end
    if lag(q) > {most_lag_rad:?}:
      safe_stop(\"the arm is not where the plan has it\")
    end
    servoj(q, t=dt, lookahead_time=0.1, gain=300)
  end
  set_tcp(p{tcp})
  set_standard_digital_out({spindle_output}, False)
  popup(\"The arm moves to the start of the cut. Is the way free?\", title=\"bonemill\", blocking=True)
  movej({start}, a=0.5, v=0.2)
  popup(\"The spindle starts, then the cut.\", title=\"bonemill\", warning=True, blocking=True)
  set_standard_digital_out({spindle_output}, True)
  sleep({run_up_s:?})
"
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Arm;
    use crate::ur::UrModel;
    use bonemill_geometry::Rigid;
    use nalgebra::{Rotation3, Vector3};

    fn written(speed_rad_s: f64) -> Result<String, RobotError> {
        let arm = Arm::ur(UrModel::Ur5e, None).unwrap();
        let time_s: Vec<f64> = (0..=500).map(|k| f64::from(k) * 0.002).collect();
        let q: Vec<f64> =
            time_s.iter().flat_map(|t| [0.3, -1.2, 1.4 + speed_rad_s * t, -0.7, -1.5, -0.1 * t]).collect();
        let qd = vec![0.0; q.len()];
        let rows = ExportRows::new(arm.joints(), &time_s, &q, &qd, 20)?;
        let turn = Rotation3::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
        let mount = ToolMount { flange_from_burr: Rigid::new(turn, Vector3::new(0.0, 0.0, 180.0)) };
        let mut out = Vec::new();
        write_urscript(&mut out, &rows, &UrScript::with_mount(mount))?;
        Ok(String::from_utf8(out).unwrap())
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
        let text = written(0.2).unwrap();
        let words = |line: &str| line.trim_start().split([' ', '(']).next().unwrap_or("").to_owned();
        let opened = text.lines().filter(|line| ["def", "if", "while"].contains(&&words(line)[..])).count();
        let closed = text.lines().filter(|line| words(line) == "end").count();
        assert_eq!(opened, closed);
        let place = |what: &str| text.find(what).unwrap();
        assert!(place("set_standard_digital_out(0, False)\n  popup") < place("movej("));
        assert!(place("movej(") < place("set_standard_digital_out(0, True)"));
        assert!(text.trim_end().ends_with("safe_stop(\"done\")\nend\nbonemill()"));
    }

    #[test]
    fn what_a_controller_cannot_run_is_refused() {
        assert!(matches!(written(4.0), Err(RobotError::Value { what: "joint's way in step", .. })));
        assert!(written(1.2).is_ok());
        let bone = Arm::bone_attached().unwrap();
        let rows = ExportRows::new(bone.joints(), &[0.0], &[0.0; 4], &[0.0; 4], 1).unwrap();
        let options = UrScript::with_mount(ToolMount::default());
        assert!(matches!(
            write_urscript(&mut Vec::new(), &rows, &options),
            Err(RobotError::Length { expected: 6, .. })
        ));
    }
}
