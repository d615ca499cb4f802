//! What a time law is asked for, checked on entry so that inner code need not.

use crate::arm::{Arm, check_positive};
use crate::error::RobotError;

/// Greatest joint position that is taken for one, mm or rad; beyond it numbers lose the digits that matter.
const ABSURD_POSITION: f64 = 1e9;

/// A polyline of joint positions.
#[derive(Debug, Clone, Copy)]
pub struct JointPath<'a> {
    /// Waypoints one after the other, mm or rad by joint, shape (n × dof).
    pub q: &'a [f64],
    /// Path length of the burr in the move that ENDS at each waypoint, mm, 0 for a pure rotation, shape (n); the first
    /// is ignored.
    pub burr_mm: &'a [f64],
    /// Waypoints to stop at, besides the first and the last; in any order.
    pub stops: &'a [usize],
}

/// What the joints can do and how far corners may be cut.
#[derive(Debug, Clone, PartialEq)]
pub struct PathLimits {
    pub(super) velocity: Vec<f64>,
    pub(super) acceleration: Vec<f64>,
    pub(super) lever_mm: Vec<f64>,
    pub(super) corner_tolerance_mm: f64,
}

impl PathLimits {
    /// How far corners are cut by default, mm at the burr: inside the 0.05 mm that a plan's trajectory may deviate.
    pub const CORNER_TOLERANCE_MM: f64 = 0.04;

    /// Limits per joint, shape (dof) each.
    ///
    /// - `velocity`: mm/s or rad/s, `acceleration`: mm/s² or rad/s², both above 0;
    /// - `lever_mm`: mm that the burr moves at most per unit of the joint, at least 0: 1 for a prismatic joint, the
    ///   distance from axis to burr for a revolute one;
    /// - `corner_tolerance_mm`: Σ lever |Δq| between trajectory and polyline, at least 0; at 0 the arm stops at corners.
    ///
    /// # Errors
    /// [`RobotError::Length`] or [`RobotError::Value`] where a list has another length or a number is out of range.
    pub fn new(
        velocity: &[f64],
        acceleration: &[f64],
        lever_mm: &[f64],
        corner_tolerance_mm: f64,
    ) -> Result<Self, RobotError> {
        let dof = velocity.len().max(1);
        check_positive("velocity limit", velocity, dof, "mm/s or rad/s")?;
        check_positive("acceleration limit", acceleration, dof, "mm/s² or rad/s²")?;
        check_not_negative("lever", lever_mm, dof)?;
        check_not_negative("corner tolerance", &[corner_tolerance_mm], 1)?;
        Ok(Self {
            velocity: velocity.to_vec(),
            acceleration: acceleration.to_vec(),
            lever_mm: lever_mm.to_vec(),
            corner_tolerance_mm,
        })
    }

    /// The limits of an arm, with its own bound on the levers.
    ///
    /// # Errors
    /// As [`PathLimits::new`]; an arm's own limits are in range.
    pub fn of_arm(arm: &Arm, corner_tolerance_mm: f64) -> Result<Self, RobotError> {
        let velocity: Vec<f64> = arm.joints().iter().map(|joint| joint.velocity_limit).collect();
        let acceleration: Vec<f64> = arm.joints().iter().map(|joint| joint.acceleration_limit).collect();
        Self::new(&velocity, &acceleration, &arm.lever_mm(), corner_tolerance_mm)
    }

    /// Number of joints.
    pub fn dof(&self) -> usize {
        self.velocity.len()
    }
}

/// `path` is a polyline of joint vectors with finite values; gives its number of waypoints.
pub(super) fn check_path(path: &JointPath<'_>, dof: usize) -> Result<usize, RobotError> {
    let count = path.burr_mm.len();
    if count == 0 {
        return Err(RobotError::EmptyPath);
    }
    if path.q.len() != count * dof {
        return Err(RobotError::Length { what: "joint path", got: path.q.len(), expected: count * dof });
    }
    let bad_q = path.q.iter().position(|q| !(-ABSURD_POSITION..=ABSURD_POSITION).contains(q));
    if let Some((at, &value)) = bad_q.and_then(|at| Some((at, path.q.get(at)?))) {
        let (what, unit, expected) = ("joint position at waypoint", "mm or rad", "a number within ±1e9");
        return Err(RobotError::Value { what, index: at / dof, value, unit, expected });
    }
    let lengths = path.burr_mm.get(1..).unwrap_or_default();
    if let Some((index, &value)) = lengths.iter().enumerate().find(|(_, ds)| !(0.0..=1e9).contains(*ds)) {
        let (what, unit, expected) = ("burr path length to waypoint", "mm", "a number in 0..1e9");
        return Err(RobotError::Value { what, index: index + 1, value, unit, expected });
    }
    if let Some(&stop) = path.stops.iter().find(|stop| **stop >= count) {
        let (what, unit, expected) = ("stop", "(waypoint)", "the index of a waypoint");
        return Err(RobotError::Value { what, index: 0, value: stop as f64, unit, expected });
    }
    Ok(count)
}

/// One finite cap above 0 per waypoint but the first.
pub(super) fn check_caps(caps_mm_s: &[f64], count: usize) -> Result<(), RobotError> {
    if caps_mm_s.len() != count {
        return Err(RobotError::Length { what: "speed cap", got: caps_mm_s.len(), expected: count });
    }
    let caps = caps_mm_s.iter().enumerate().skip(1);
    match caps.into_iter().find(|(_, cap)| !(cap.is_finite() && **cap > 0.0)) {
        None => Ok(()),
        Some((index, &value)) => Err(RobotError::Value {
            what: "speed cap of the move to waypoint",
            index,
            value,
            unit: "mm/s",
            expected: "a finite number above 0",
        }),
    }
}

fn check_not_negative(what: &'static str, values: &[f64], expected_len: usize) -> Result<(), RobotError> {
    if values.len() != expected_len {
        return Err(RobotError::Length { what, got: values.len(), expected: expected_len });
    }
    match values.iter().enumerate().find(|(_, value)| !(value.is_finite() && **value >= 0.0)) {
        None => Ok(()),
        Some((index, &value)) => {
            Err(RobotError::Value { what, index, value, unit: "mm", expected: "a finite number, at least 0" })
        }
    }
}
