//! The input of a time law, checked once on entry.

use bonemill_arm::RobotError;
use bonemill_arm::arm::{Arm, check_positive};

/// Largest accepted joint position, mm or rad; beyond it rounding errors become too large.
const ABSURD_POSITION: f64 = 1e9;

/// A polyline of joint positions.
#[derive(Debug, Clone, Copy)]
pub struct JointPath<'a> {
    /// Waypoints one after the other, mm or rad by joint, shape (n × dof).
    pub q: &'a [f64],
    /// Path length of the burr in the move that ENDS at each waypoint, mm, 0 for a pure rotation, shape (n); the first
    /// is ignored.
    pub burr_mm: &'a [f64],
    /// The burr's centre (mm) and the shaft's axis (unit) at each waypoint, all in one frame, shape (n). A corner's tolerance
    /// is measured on them.
    pub pose: &'a [[f64; 6]],
    /// Waypoints to stop at, besides the first and the last; in any order.
    pub stops: &'a [usize],
}

/// The joints' limits and the tolerance of corners.
#[derive(Debug, Clone, PartialEq)]
pub struct PathLimits {
    pub(super) velocity: Vec<f64>,
    pub(super) acceleration: Vec<f64>,
    pub(super) jerk: Vec<f64>,
    pub(super) corner: CornerTolerance,
}

/// Largest deviation of a plan's trajectory from its waypoints' polyline, mm: the distance by which it may cut a corner between
/// waypoints, plus the deviation of a chord between two waypoints around a structure's edge. Added to every structure's clearance.
pub const TRAJECTORY_TOLERANCE_MM: f64 = 0.025;

/// Largest deviation at a rounded corner.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CornerTolerance {
    /// Distance of the burr's centre from the polyline, mm, at least 0; at 0 the arm stops at corners.
    pub burr_mm: f64,
    /// Angle between the shaft's axis and the polyline's at the same place, rad, at least 0.
    pub axis_rad: f64,
}

impl Default for CornerTolerance {
    /// A tolerance inside the 0.05 mm and 5 mrad by which a plan's trajectory may deviate.
    fn default() -> Self {
        Self { burr_mm: 0.04, axis_rad: 3e-3 }
    }
}

impl PathLimits {
    /// Limits per joint, shape (dof) each, all above 0: mm/s or rad/s, mm/s² or rad/s², mm/s³ or rad/s³.
    ///
    /// # Errors
    /// [`RobotError::Length`] or [`RobotError::Value`] where a list has another length or a number is out of range.
    pub fn new(
        velocity: &[f64],
        acceleration: &[f64],
        jerk: &[f64],
        corner: CornerTolerance,
    ) -> Result<Self, RobotError> {
        let dof = velocity.len().max(1);
        check_positive("velocity limit", velocity, dof, "mm/s or rad/s")?;
        check_positive("acceleration limit", acceleration, dof, "mm/s² or rad/s²")?;
        check_positive("jerk limit", jerk, dof, "mm/s³ or rad/s³")?;
        check_not_negative("corner tolerance", corner.burr_mm, "mm")?;
        check_not_negative("corner tolerance of the axis", corner.axis_rad, "rad")?;
        Ok(Self {
            velocity: velocity.to_vec(),
            acceleration: acceleration.to_vec(),
            jerk: jerk.to_vec(),
            corner,
        })
    }

    /// The limits of an arm.
    ///
    /// # Errors
    /// As [`PathLimits::new`]; an arm's own limits are in range.
    pub fn of_arm(arm: &Arm, corner: CornerTolerance) -> Result<Self, RobotError> {
        let each = |of: fn(&bonemill_arm::Joint) -> f64| arm.joints().iter().map(of).collect::<Vec<f64>>();
        let velocity = each(|joint| joint.velocity_limit);
        Self::new(&velocity, &each(|joint| joint.acceleration_limit), &each(|joint| joint.jerk_limit), corner)
    }

    /// Number of joints.
    pub fn dof(&self) -> usize {
        self.velocity.len()
    }
}

/// Checks that `path` is a polyline of joint vectors with finite values; returns its number of waypoints.
pub(super) fn check_path(path: &JointPath<'_>, dof: usize) -> Result<usize, RobotError> {
    let count = path.burr_mm.len();
    if count == 0 {
        return Err(RobotError::EmptyPath);
    }
    if path.q.len() != count * dof {
        return Err(RobotError::Length { what: "joint path", got: path.q.len(), expected: count * dof });
    }
    if path.pose.len() != count {
        return Err(RobotError::Length { what: "burr's place", got: path.pose.len(), expected: count });
    }
    let in_range = |v: &f64| (-ABSURD_POSITION..=ABSURD_POSITION).contains(v);
    let places = path.pose.iter().enumerate();
    let bad_place =
        places.filter_map(|(index, pose)| Some((index, *pose.iter().find(|v| !in_range(v))?))).next();
    if let Some((index, value)) = bad_place {
        let (what, unit, expected) = ("burr's place at waypoint", "mm or 1", "a number within ±1e9");
        return Err(RobotError::Value { what, index, value, unit, expected });
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

/// Checks that there is one finite cap above 0 per waypoint except the first.
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

fn check_not_negative(what: &'static str, value: f64, unit: &'static str) -> Result<(), RobotError> {
    if value.is_finite() && value >= 0.0 {
        return Ok(());
    }
    Err(RobotError::Value { what, index: 0, value, unit, expected: "a finite number, at least 0" })
}
