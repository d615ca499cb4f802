//! How long the moves take: by constant speeds, and by axes whose velocity, acceleration and jerk are limited.
//!
//! The published estimate is Σ length/speed. The limited law is that of `bonemill-motion`, with the machine's axes X, Y, Z and A as joints: it cuts corners
//! by at most [`CORNER_MM`], keeps every axis' limits at every instant and stands still while the block is turned.
//!
//! **Source:** Castelli et al. 2020, section 4.3, for constant speeds.

use bonemill_robot::timelaw::{CornerTolerance, JointPath, PathLimits, PreparedPath};
use nalgebra::Vector3;

use crate::machining::MachiningError;
use bonemill_case::prosthesis::MachineSpec;

use crate::machining::job::MachiningJob;
use crate::machining::moves::{Facing, TipMove};

/// How far the axes may cut corners, mm: with the moves' own 0.005 mm below the tolerance for gouges.
pub const CORNER_MM: f64 = 0.01;

/// Times of a program.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Times {
    /// By constant speeds, s.
    pub constant_s: f64,
    /// With limited acceleration and jerk, s.
    pub limited_s: f64,
    /// Of `constant_s`: at feed, s.
    pub cutting_s: f64,
}

/// Enters into every move when it ends by constant speeds, and gives the times.
///
/// # Errors
/// [`MachiningError::Motion`] where the time law takes no such path.
pub fn times(moves: &mut [TipMove], job: &MachiningJob) -> Result<Times, MachiningError> {
    let (mut constant_s, mut cutting_s) = (0.0, 0.0);
    let mut before: Option<TipMove> = None;
    for step in moves.iter_mut() {
        let took = before.map_or(0.0, |before| duration_s(&before, step, &job.machine));
        constant_s += took;
        if step.kind.cuts() {
            cutting_s += took;
        }
        step.time_s = constant_s;
        before = Some(*step);
    }
    Ok(Times { constant_s, limited_s: limited_s(moves, &job.machine)?, cutting_s })
}

/// Of a move by constant speeds, s.
fn duration_s(from: &TipMove, to: &TipMove, machine: &MachineSpec) -> f64 {
    let turn_s = (to.a_rad - from.a_rad).abs() / machine.rotary_rad_s;
    in_machine(from, to).norm() / to.feed_mm_min * 60.0 + turn_s
}

/// The tip's way in the machine's axes, mm.
fn in_machine(from: &TipMove, to: &TipMove) -> Vector3<f64> {
    let at = |m: &TipMove| Facing::of(m.a_rad).from_block(&m.tip_mm);
    at(to) - at(from)
}

fn limited_s(moves: &[TipMove], machine: &MachineSpec) -> Result<f64, MachiningError> {
    let Some(first) = moves.first() else { return Ok(0.0) };
    Ok(prepared(first, moves, machine)?.duration_s(&caps_mm_s(moves, 1.0))?)
}

/// The speed of every move, that of cuts `by` times as fast, mm/s.
fn caps_mm_s(moves: &[TipMove], by: f64) -> Vec<f64> {
    let cap = |m: &TipMove| (if m.kind.cuts() { m.feed_mm_min * by } else { m.feed_mm_min }) / 60.0;
    moves.iter().map(cap).collect()
}

/// The least factor of the feed, to a hundredth, with which the moves take no longer than `most_s` under the machine's accelerations; `None` where
/// `most` is not enough.
pub(crate) fn faster(moves: &[TipMove], machine: &MachineSpec, most: f64, most_s: f64) -> Option<f64> {
    let path = prepared(moves.first()?, moves, machine).ok()?;
    let meets = |by: f64| path.duration_s(&caps_mm_s(moves, by)).is_ok_and(|takes_s| takes_s <= most_s);
    let (mut low, mut high) = (1.0, most);
    if !(high > low && meets(high)) {
        return None;
    }
    while high - low > 0.01 {
        let middle = 0.5 * (low + high);
        if meets(middle) { high = middle } else { low = middle }
    }
    Some(high)
}

/// The machine's axes along the moves.
fn prepared(
    first: &TipMove,
    moves: &[TipMove],
    machine: &MachineSpec,
) -> Result<PreparedPath, MachiningError> {
    let fastest = machine.rapid_mm_min.max(machine.max_feed_mm_min) / 60.0;
    let rotary = machine.rotary_rad_s;
    // the rotary axis reaches its speed within the same time as the linear ones
    let share = rotary / fastest;
    let (a, j) = (machine.acceleration_mm_s2, machine.jerk_mm_s3);
    let corner = CornerTolerance { burr_mm: CORNER_MM, axis_rad: 1e-3 };
    let limits = PathLimits::new(
        &[fastest, fastest, fastest, rotary],
        &[a, a, a, a * share],
        &[j, j, j, j * share],
        corner,
    )?;
    let (mut q, mut length, mut pose, mut stops) = (vec![], vec![], vec![], vec![]);
    let mut before = first;
    for (n, step) in moves.iter().enumerate() {
        let at = Facing::of(step.a_rad).from_block(&step.tip_mm);
        q.extend([at.x, at.y, at.z, step.a_rad]);
        length.push(in_machine(before, step).norm());
        pose.push([at.x, at.y, at.z, 0.0, 0.0, 1.0]);
        if step.a_rad != before.a_rad {
            stops.extend([n - 1, n]);
        }
        before = step;
    }
    let path = JointPath { q: &q, burr_mm: &length, pose: &pose, stops: &stops };
    Ok(PreparedPath::new(&path, &limits)?)
}
