//! `trajectory_msgs/JointTrajectory`, as JSON and as the YAML that `ros2 topic pub` reads, in m and rad.
//!
//! Every point has positions and velocities, so that a controller may interpolate with cubics; the command writes enough points for a
//! controller that joins them by straight lines in the joints, too. Times are from the start, in
//! whole seconds and nanoseconds. The header is empty, because a controller takes a time stamp of 0 as "now".

use std::fmt::Write as _;
use std::io::Write;

use bonemill_arm::RobotError;

use super::decimal::push_fixed;
use super::rows::ExportRows;

/// Decimals of a number, for 1 nm and 1 nrad.
const DECIMALS: u32 = 9;

/// Writes one JSON object.
///
/// # Errors
/// [`RobotError::Value`] where a step is faster than its joint's limit, [`RobotError::Write`] when the writer fails.
pub fn write_ros_json(out: &mut impl Write, rows: &ExportRows<'_>) -> Result<(), RobotError> {
    rows.check_speeds()?;
    let names: Vec<String> = rows.joints().iter().map(|joint| quoted(&joint.name)).collect();
    let head = format!(
        "{{\"header\": {{\"stamp\": {{\"sec\": 0, \"nanosec\": 0}}, \"frame_id\": \"\"}},\n\"joint_names\": [{}],\n\"points\": [\n",
        names.join(", ")
    );
    write_points(out, rows, &head, "]}\n", |text, n, last| {
        let (q, qd, sec, nanosec) = point(rows, n);
        let _ = writeln!(
            text,
            "{{\"positions\": {q}, \"velocities\": {qd}, \"time_from_start\": {{\"sec\": {sec}, \"nanosec\": {nanosec}}}}}{}",
            if last { "" } else { "," }
        );
    })
}

/// Writes one YAML document, with notes as comments before it: `ros2 topic pub -1 --yaml-file FILE /TOPIC trajectory_msgs/msg/JointTrajectory`.
///
/// # Errors
/// [`RobotError::Value`] where a step is faster than its joint's limit, [`RobotError::Write`] when the writer fails.
pub fn write_ros_yaml(
    out: &mut impl Write,
    rows: &ExportRows<'_>,
    notes: &[String],
) -> Result<(), RobotError> {
    rows.check_speeds()?;
    let notes: String = notes.iter().map(|note| format!("# {note}\n")).collect();
    let names: String = rows.joints().iter().map(|joint| format!("- {}\n", quoted(&joint.name))).collect();
    let head = format!(
        "{notes}header:\n  stamp: {{sec: 0, nanosec: 0}}\n  frame_id: \"\"\njoint_names:\n{names}points:\n"
    );
    write_points(out, rows, &head, "", |text, n, _| {
        let (q, qd, sec, nanosec) = point(rows, n);
        let _ = writeln!(
            text,
            "- positions: {q}\n  velocities: {qd}\n  time_from_start: {{sec: {sec}, nanosec: {nanosec}}}"
        );
    })
}

fn write_points(
    out: &mut impl Write,
    rows: &ExportRows<'_>,
    head: &str,
    tail: &str,
    mut push: impl FnMut(&mut String, usize, bool),
) -> Result<(), RobotError> {
    let failed =
        |rows_written: usize| move |source| RobotError::Write { rows_written: rows_written as u64, source };
    out.write_all(head.as_bytes()).map_err(failed(0))?;
    let mut text = String::new();
    for n in 0..rows.count() {
        text.clear();
        push(&mut text, n, n + 1 == rows.count());
        out.write_all(text.as_bytes()).map_err(failed(n))?;
    }
    out.write_all(tail.as_bytes()).map_err(failed(rows.count()))
}

/// Positions, velocities, seconds and nanoseconds of a point, as text.
fn point(rows: &ExportRows<'_>, n: usize) -> (String, String, u64, u32) {
    let (time_s, q, qd) = rows.row(n);
    let nanoseconds = (time_s * 1e9).round() as u64;
    let list = |values: &[f64]| list(&rows.si(values));
    (list(q), list(qd), nanoseconds / 1_000_000_000, (nanoseconds % 1_000_000_000) as u32)
}

/// A list such as `[1.5, -2.0]`, always with decimal points, because ROS reads `1` as an integer and refuses it.
pub(super) fn list(values: &[f64]) -> String {
    let mut text = String::from("[");
    for (k, value) in values.iter().enumerate() {
        let mut digits = Vec::new();
        push_fixed(&mut digits, *value, DECIMALS);
        if !digits.contains(&b'.') {
            digits.extend_from_slice(b".0");
        }
        text.push_str(if k == 0 { "" } else { ", " });
        text.push_str(&String::from_utf8_lossy(&digits));
    }
    text.push(']');
    text
}

/// A name as a JSON string, which is also valid YAML.
pub(super) fn quoted(name: &str) -> String {
    let mut text = String::from("\"");
    for c in name.chars() {
        match c {
            '"' | '\\' => text.extend(['\\', c]),
            c if c.is_control() => {
                let _ = write!(text, "\\u{:04x}", u32::from(c));
            }
            c => text.push(c),
        }
    }
    text.push('"');
    text
}

#[cfg(test)]
mod tests;
