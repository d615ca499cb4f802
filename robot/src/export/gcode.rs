//! G-code for Cartesian machines: three linear axes, with or without a tilt. mm, degrees, minutes.
//!
//! X, Y and Z are the machine's linear joints in their order, A is its rotary joint. Cuts are G1. Links and retracts,
//! which stay in free space, are G0 if the caller says that the machine drives G0 straight, else G1 at their own speed.
//! Feeds: without a tilt, units per minute (G94) and F in mm/min. With a tilt, inverse time (G93), F = 1/minutes of the
//! move, because machines differ in the meaning of F for linear and rotary axes together.
//!
//! **Source:** words and modes: ISO 6983-1 and RS274/NGC; G0/G1 with F per move: Castelli et al., section 4.3.

use std::io::Write;

use bonemill_arm::RobotError;
use bonemill_arm::arm::{Joint, JointKind};

use super::decimal::{push_fixed, push_units};

/// One straight move of the machine's axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GcodeMove<'a> {
    /// Where it ends, mm or rad by joint.
    pub q: &'a [f64],
    /// Duration, s; above 0 unless nothing moves.
    pub duration_s: f64,
    /// Whether it cuts.
    pub cuts: bool,
}

/// Settings of a program.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gcode {
    /// Spindle speed, rpm.
    pub spindle_rpm: f64,
    /// Whether the burr turns clockwise seen from the handpiece (M3), else counter-clockwise (M4).
    pub clockwise: bool,
    /// Whether links are written as G0; only for machines that drive G0 straight.
    pub rapid: bool,
}

/// Whether an arm can be driven by G-code: three linear axes, then at most one rotary axis.
pub fn is_cartesian(joints: &[Joint]) -> bool {
    let linear = joints.iter().take_while(|joint| joint.kind == JointKind::Prismatic).count();
    linear == 3 && joints.len() <= 4
}

/// Writes a program. The machine is driven to the end of the first move with the spindle off.
///
/// Returns the number of motion blocks. If rounding in the text would make an axis faster than its limit, the move is
/// lengthened in time so that it is not.
///
/// # Errors
/// [`RobotError::NotCartesian`] if [`is_cartesian`] is false for the arm; [`RobotError::EmptyPath`] without a move;
/// [`RobotError::Value`] where a move takes no time; [`RobotError::Write`] when the writer fails.
pub fn write_gcode<'a>(
    out: &mut impl Write,
    joints: &[Joint],
    options: &Gcode,
    moves: impl IntoIterator<Item = GcodeMove<'a>>,
) -> Result<u64, RobotError> {
    if !is_cartesian(joints) {
        return Err(RobotError::NotCartesian { joints: joints.len() });
    }
    let mut moves = moves.into_iter();
    let first = moves.next().ok_or(RobotError::EmptyPath)?;
    let tilts = joints.len() == 4;
    let mode = if tilts { "G93 (inverse time: F is 1/minutes of its move)" } else { "G94 (F is mm/min)" };
    let failed = |rows_written: u64| move |source| RobotError::Write { rows_written, source };
    let mut text =
        format!("(bonemill: X Y Z in mm{})\n", if tilts { ", A in degrees" } else { "" }).into_bytes();
    text.extend_from_slice(format!("G21 G90 G17 {}\nM5\nG0", mode).as_bytes());
    push_axes(&mut text, first.q, &[]);
    let turn = if options.clockwise { "M3" } else { "M4" };
    text.extend_from_slice(format!("\nS{:.0} {turn}\nG4 P3\n", options.spindle_rpm).as_bytes());
    out.write_all(&text).map_err(failed(0))?;
    let mut before = first.q.to_vec();
    let mut blocks = 0;
    let mut waited_s = 0.0;
    for GcodeMove { q, duration_s, cuts } in moves {
        if rounded(q) == rounded(&before) {
            waited_s += duration_s;
            continue;
        }
        if !(duration_s.is_finite() && duration_s > 0.0) {
            let (what, unit, expected) = ("duration of move", "s", "a finite number above 0");
            return Err(RobotError::Value {
                what,
                index: blocks as usize + 1,
                value: duration_s,
                unit,
                expected,
            });
        }
        text.clear();
        if options.rapid && !cuts {
            text.extend_from_slice(b"G0");
            push_axes(&mut text, q, &before);
        } else {
            text.extend_from_slice(b"G1");
            push_axes(&mut text, q, &before);
            let way_mm = (0..3).map(|j| (q[j] - before[j]).powi(2)).sum::<f64>().sqrt();
            let duration_s = (duration_s + waited_s).max(least_s(joints, q, &before));
            let per_minute = if tilts { 60.0 / duration_s } else { 60.0 * way_mm / duration_s };
            text.extend_from_slice(b" F");
            push_rounded_down(&mut text, per_minute);
        }
        text.push(b'\n');
        out.write_all(&text).map_err(failed(blocks))?;
        blocks += 1;
        waited_s = 0.0;
        before.clear();
        before.extend_from_slice(q);
    }
    out.write_all(b"M5\nG94\nM2\n").map_err(failed(blocks))?;
    Ok(blocks)
}

/// The least time in which no axis exceeds its speed limit between two positions as they are written, s.
fn least_s(joints: &[Joint], q: &[f64], before: &[f64]) -> f64 {
    let unit = |j: usize| if j < 3 { 1.0 / LINEAR_UNITS } else { (1.0 / ROTARY_UNITS).to_radians() };
    let ways = rounded(q).into_iter().zip(rounded(before)).enumerate();
    let ways = ways.map(|(j, (to, from))| (to - from).abs() as f64 * unit(j));
    joints.iter().zip(ways).map(|(joint, way)| way / joint.velocity_limit).fold(0.0, f64::max)
}

/// Appends a feed with at least six digits, rounded down.
fn push_rounded_down(text: &mut Vec<u8>, value: f64) {
    let decimals = (5.0 - value.log10().floor()).clamp(4.0, 9.0);
    let scale = 10f64.powf(decimals);
    push_units(text, (value * scale * (1.0 - 1e-15)).floor() as i64, decimals as u32);
}

/// Number of units of the last decimal in 1 mm (0.1 µm) and in 1 degree (1e-6 degrees).
const LINEAR_UNITS: f64 = 1e4;
const ROTARY_UNITS: f64 = 1e6;

fn rounded(q: &[f64]) -> Vec<i64> {
    let unit = |(j, q): (usize, &f64)| if j < 3 { q * LINEAR_UNITS } else { q.to_degrees() * ROTARY_UNITS };
    q.iter().enumerate().map(unit).map(|v| v.round() as i64).collect()
}

/// Appends the axes that move; all of them where `before` is empty.
fn push_axes(text: &mut Vec<u8>, q: &[f64], before: &[f64]) {
    let (now, then) = (rounded(q), rounded(before));
    for (j, name) in b"XYZA".iter().enumerate().take(q.len()) {
        if then.get(j) != Some(&now[j]) {
            text.extend_from_slice(&[b' ', *name]);
            let (value, decimals) = if j < 3 { (q[j], 4) } else { (q[j].to_degrees(), 6) };
            push_fixed(text, value, decimals);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bonemill_arm::Arm;

    /// Reads a program as a machine does: positions, feeds and modes, block by block.
    fn driven(text: &str) -> Vec<([f64; 4], Option<f64>, bool)> {
        let mut at = [0.0; 4];
        let mut blocks = Vec::new();
        for line in text.lines().filter(|line| line.starts_with("G0 ") || line.starts_with("G1 ")) {
            let mut feed = None;
            for word in line.split(' ').skip(1) {
                let value: f64 = word[1..].parse().unwrap();
                match &word[..1] {
                    "X" => at[0] = value,
                    "Y" => at[1] = value,
                    "Z" => at[2] = value,
                    "A" => at[3] = value,
                    "F" => feed = Some(value),
                    other => panic!("{other}"),
                }
            }
            blocks.push((at, feed, line.starts_with("G0")));
        }
        blocks
    }

    const RAPID: Gcode = Gcode { spindle_rpm: 60_000.0, clockwise: true, rapid: true };
    const STRAIGHT: Gcode = Gcode { spindle_rpm: 1.0, clockwise: false, rapid: false };

    fn joints(count: usize) -> Vec<Joint> {
        Arm::bone_attached().unwrap().joints()[..count].to_vec()
    }

    #[test]
    fn the_blocks_read_back_as_the_motion() {
        let q: Vec<[f64; 4]> = (0..200)
            .map(|k| {
                let t = f64::from(k) * 0.1;
                [10.0 * t.sin(), 5.0 * t.cos(), -0.01 * t, 0.3 * (0.2 * t).sin()]
            })
            .collect();
        for count in [3, 4] {
            let moves = q.iter().enumerate().map(|(k, q)| GcodeMove {
                q: &q[..count],
                duration_s: 0.1 + 0.001 * k as f64,
                cuts: k % 5 != 0,
            });
            let mut out = Vec::new();
            assert_eq!(write_gcode(&mut out, &joints(count), &RAPID, moves).unwrap(), 199);
            let text = String::from_utf8(out).unwrap();
            assert!(
                text.contains("S60000 M3") && text.contains("G21 G90") && text.trim_end().ends_with("M2")
            );
            assert!(text.contains(if count == 3 { "G94" } else { "G93" }));
            let blocks = driven(&text);
            assert_eq!(blocks.len(), 200);
            for (k, (at, feed, rapid)) in blocks.iter().enumerate() {
                for j in 0..3 {
                    assert!((at[j] - q[k][j]).abs() <= 0.5e-4 + 1e-12);
                }
                if count == 4 {
                    assert!((at[3].to_radians() - q[k][3]).abs() < 1e-8);
                }
                assert_eq!(*rapid, k % 5 == 0);
                if let (Some(feed), true) = (feed, k > 0) {
                    let way: f64 = (0..3).map(|j| (q[k][j] - q[k - 1][j]).powi(2)).sum::<f64>().sqrt();
                    let seconds = if count == 3 { 60.0 * way / feed } else { 60.0 / feed };
                    let expected = 0.1 + 0.001 * k as f64;
                    assert!((seconds / expected - 1.0).abs() < 1e-5, "block {k}: {seconds} s for {expected}");
                }
            }
        }
    }

    #[test]
    fn a_move_that_goes_nowhere_is_no_block_and_one_without_time_is_refused() {
        let at = |q: &'static [f64; 3], duration_s: f64| GcodeMove { q, duration_s, cuts: true };
        let mut out = Vec::new();
        let moves = [at(&[0.0; 3], 0.0), at(&[1e-6, 0.0, 0.0], 0.0), at(&[1.0, 0.0, 0.0], 1.0)];
        assert_eq!(write_gcode(&mut out, &joints(3), &STRAIGHT, moves).unwrap(), 1);
        assert!(String::from_utf8(out).unwrap().contains("S1 M4\n"));
        let hasty = [at(&[0.0; 3], 0.0), at(&[1.0, 0.0, 0.0], 0.0)];
        assert!(matches!(
            write_gcode(&mut Vec::new(), &joints(3), &STRAIGHT, hasty),
            Err(RobotError::Value { .. })
        ));
        assert!(matches!(
            write_gcode(&mut Vec::new(), &joints(3), &STRAIGHT, []),
            Err(RobotError::EmptyPath)
        ));
        let ur = Arm::ur(bonemill_arm::ur::UrModel::Ur5e, None).unwrap();
        let refused = write_gcode(&mut Vec::new(), ur.joints(), &STRAIGHT, []).unwrap_err();
        assert!(refused.to_string().contains("three linear axes"), "{refused}");
    }

    #[test]
    fn no_axis_is_asked_for_more_than_its_limit() {
        let joints = joints(4);
        let limits: Vec<f64> = joints.iter().map(|joint| joint.velocity_limit).collect();
        // each axis in turn moves at its limit, in steps so short that the last decimal decides; one step has no length
        let mut q = vec![vec![0.0; 4]];
        for k in 0..400 {
            let mut next = q[k].clone();
            next[k % 4] += limits[k % 4] * if k % 7 == 0 { 1e-9 } else { 0.002_013 };
            q.push(next);
        }
        let moves = q.iter().map(|q| GcodeMove { q, duration_s: 0.002, cuts: true });
        let mut out = Vec::new();
        write_gcode(&mut out, &joints, &STRAIGHT, moves).unwrap();
        let blocks = driven(&String::from_utf8(out).unwrap());
        let mut all_s = 0.0;
        for pair in blocks.windows(2) {
            let seconds = 60.0 / pair[1].1.unwrap();
            all_s += seconds;
            #[allow(clippy::needless_range_loop, reason = "three lists by axis")]
            for j in 0..4 {
                let way = (pair[1].0[j] - pair[0].0[j]).abs();
                let speed = if j < 3 { way } else { way.to_radians() } / seconds;
                assert!(speed <= limits[j] * (1.0 + 1e-9), "axis {j}: {speed} of {}", limits[j]);
            }
        }
        assert!((all_s / 0.8 - 1.0).abs() < 0.02, "{all_s} s");
    }
}
