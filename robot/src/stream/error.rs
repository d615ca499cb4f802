//! What cannot be streamed at all, and a log that is none. What happens while an arm is connected is a [`crate::stream::Cause`] instead.

use bonemill_arm::RobotError;
use thiserror::Error;

/// A plan, a setting or a log that is refused.
#[derive(Debug, Error)]
pub enum StreamError {
    /// Another arm than a UR.
    #[error("the plan is for an arm with joints {kinds}: streaming needs a UR arm, six revolute joints")]
    NotUr {
        /// Kinds of the plan's joints.
        kinds: String,
    },
    /// Nobody said where the patient is.
    #[error(
        "the case has no registration, so where the arm stands was assumed: give robot.base_from_ct and plan again"
    )]
    RegistrationAssumed,
    /// Too short to be followed.
    #[error("the trajectory has {rows} rows: expected at least 2")]
    TooFewRows {
        /// Its rows.
        rows: usize,
    },
    /// A rate that the controller does not have.
    #[error("the trajectory has a row every {period_s} s: the controller takes one every 0.002 to 0.01 s")]
    Period {
        /// The trajectory's period, s.
        period_s: f64,
    },
    /// A clock that does not run evenly.
    #[error("row {row} is at {time_s} s: expected even steps of {period_s} s")]
    Uneven {
        /// The row.
        row: usize,
        /// Its time, s.
        time_s: f64,
        /// The trajectory's period, s.
        period_s: f64,
    },
    /// A position outside a joint's range.
    #[error("row {row}: joint {joint} is {beyond_rad:.4} rad beyond its limit")]
    BeyondLimit {
        /// The row.
        row: usize,
        /// The joint's name.
        joint: String,
        /// How far outside, rad.
        beyond_rad: f64,
    },
    /// A step that is too fast for a joint.
    #[error("row {row}: joint {joint} at {speed_rad_s:.4} rad/s, limit {limit_rad_s} rad/s")]
    TooFast {
        /// The row that the step ends at.
        row: usize,
        /// The joint's name.
        joint: String,
        /// Its speed in the step, rad/s.
        speed_rad_s: f64,
        /// Its limit, rad/s.
        limit_rad_s: f64,
    },
    /// Waypoints that do not belong to the trajectory.
    #[error("waypoint {waypoint} is at {time_s} s: expected rising times within the trajectory's {end_s} s")]
    Waypoint {
        /// The waypoint.
        waypoint: usize,
        /// Its time, s.
        time_s: f64,
        /// The trajectory's last time, s.
        end_s: f64,
    },
    /// A setting outside its range.
    #[error("{name} = {value}: expected {low} to {high}")]
    Setting {
        /// Which.
        name: &'static str,
        /// As given.
        value: f64,
        /// Least value.
        low: f64,
        /// Greatest value.
        high: f64,
    },
    /// The arm's kinematics refuse a joint vector.
    #[error(transparent)]
    Arm(#[from] RobotError),
    /// Not a log, or not of this plan.
    #[error("line {line} of the log: found {found}, expected {expected}")]
    Log {
        /// Line, from 1.
        line: usize,
        /// What stands there.
        found: String,
        /// What should.
        expected: String,
    },
    /// A log whose run did not come to its first step.
    #[error("the log holds no step of a run: the run stopped before it began; begin anew, without --resume")]
    NoStep,
    /// A log of another plan.
    #[error("the log is of another plan (SHA-256 {found}, expected {expected})")]
    OtherPlan {
        /// Digest in the log.
        found: String,
        /// Digest of the plan at hand.
        expected: String,
    },
}
