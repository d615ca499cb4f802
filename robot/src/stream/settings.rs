//! How a plan is streamed, and what is assumed of the controller and its network.
//!
//! Every number is checked once, in [`Settings::checked`].

use bonemill_arm::{Arm, JointKind};

use crate::stream::error::StreamError;
use crate::stream::link::Joints;

/// What is assumed of PC, network and controller. The bound stands on these numbers, and the simulated arm keeps them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StreamTiming {
    /// How far the arm may be behind its targets, s: servoJ with `lookahead_s` 0.03 was measured at 0.034. Assumed.
    pub lag_s: f64,
    /// An order or a state on its way, s: three periods of RTDE at 500 Hz. Assumed.
    pub transport_s: f64,
    /// Oldest state that a target may be sent on, s.
    pub state_age_s: f64,
    /// Time constant of the arm's last stage of following, s: half of what was measured as lag. Assumed.
    pub follow_s: f64,
    /// Least slowing of a joint that turns in any stop, rad/s²: half of servoStop's default. Assumed.
    pub stop_rad_s2: f64,
    /// How fast the controller's clock may run against the PC's. Assumed.
    pub clock_drift: f64,
}

/// servoJ's lookahead, s, and gain with which the lag was measured: the quickest that it takes.
const LOOKAHEAD_S: f64 = 0.03;
const GAIN: f64 = 2000.0;
/// What servoJ is late by, times its gain, s: 4 ms of the 34 that were measured at a gain of 2000. Assumed.
const GAIN_S: f64 = 8.0;

impl StreamTiming {
    /// The assumptions above.
    pub const ASSUMED: Self = Self {
        lag_s: 0.05,
        transport_s: 0.006,
        state_age_s: 0.02,
        follow_s: 0.017,
        stop_rad_s2: 5.0,
        clock_drift: 2e-4,
    };

    /// The same with other values of servoJ than those that were measured: it is later by what it looks further ahead, and by
    /// `GAIN_S`·(1/gain − 1/2000). Assumed: only one pair of values was measured.
    ///
    /// # Errors
    /// [`StreamError::Setting`] for a value that the controller does not take.
    pub fn of_servo(lookahead_s: f64, gain: f64) -> Result<Self, StreamError> {
        for (name, value, low, high) in
            [("lookahead_s", lookahead_s, LOOKAHEAD_S, 0.2), ("gain", gain, 100.0, GAIN)]
        {
            if !(low..=high).contains(&value) {
                return Err(StreamError::Setting { name, value, low, high });
            }
        }
        let later_s = lookahead_s - LOOKAHEAD_S + GAIN_S * (1.0 / gain - 1.0 / GAIN);
        let assumed = Self::ASSUMED;
        Ok(Self { lag_s: assumed.lag_s + later_s, follow_s: assumed.follow_s + 0.5 * later_s, ..assumed })
    }

    /// Least slowing a of each joint of an arm in any stop, rad/s², or mm/s² where it slides: there its acceleration limit.
    pub fn stops(&self, arm: &Arm) -> Joints {
        let mut stops = [1.0; 6];
        for (stop, joint) in stops.iter_mut().zip(arm.joints()) {
            *stop =
                if joint.kind == JointKind::Revolute { self.stop_rad_s2 } else { joint.acceleration_limit };
        }
        stops
    }

    /// How far a joint may be from what it was told lately, over its slowing a, s², where a stop from the planned speeds takes `stop_s`:
    /// 2 τ² at rest, less where a stop takes long.
    ///
    /// The last stage moves at e/τ for an error e. A stop that slows at a needs v²/(2a) = e²/(2aτ²) ≤ e at rest; from a speed q̇ it takes
    /// q̇/a, in which the error goes q̇/(2aτ) times as far.
    pub fn joint_error_s2(&self, stop_s: f64) -> f64 {
        2.0 * self.follow_s.powi(2) * self.joint_error_share(stop_s)
    }

    /// The share of the error at rest that is allowed where a stop takes so long.
    pub fn joint_error_share(&self, stop_s: f64) -> f64 {
        (2.0 * self.follow_s / stop_s).min(1.0)
    }

    /// How long ago a target may have been sent that the newest state still has before it, s.
    pub fn backlog_s(&self) -> f64 {
        self.lag_s + self.transport_s + self.state_age_s
    }
}

/// How the arm is streamed to.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Assumptions on the controller.
    pub timing: StreamTiming,
    /// Largest distance of the burr from its path, mm; less where less clearance is left.
    pub tolerance_mm: f64,
    /// Share of the clearance that is left which the burr may leave its path by.
    pub tolerance_share: f64,
    /// Where along the shaft a turn of the axis counts as much as the burr's place, mm.
    pub shaft_lever_mm: f64,
    /// Speed of the burr on the approach, mm/s.
    pub approach_mm_s: f64,
    /// Turn of the tool on the approach, rad/s.
    pub approach_rad_s: f64,
    /// Longest approach, mm.
    pub approach_most_mm: f64,
    /// Greatest angle between the approach and the shaft at its end, rad.
    pub approach_cone_rad: f64,
    /// Time that the spindle needs to run up, s.
    pub run_up_s: f64,
    /// Mass on the flange that the controller must know, kg; without it nothing moves.
    pub payload_kg: Option<f64>,
    /// Serial number that the arm must have, where the user states it.
    pub serial: Option<String>,
    /// Force toward a structure above what was predicted at which the arm goes back and waits, N.
    pub force_excess_n: f64,
    /// How far back along its path the burr goes to wait, mm.
    pub retreat_mm: f64,
    /// Slow down where the bound is larger than the clearance, instead of refusing.
    pub slow: bool,
    /// Stream a plan that is not verified.
    pub unverified: bool,
    /// Longest wait for the controller to answer or to start its program, s.
    pub patience_s: f64,
}

impl Default for Settings {
    /// Limits of this program; none has a source but trials on a simulated arm.
    fn default() -> Self {
        Self {
            timing: StreamTiming::ASSUMED,
            tolerance_mm: 0.5,
            tolerance_share: 0.25,
            shaft_lever_mm: 50.0,
            approach_mm_s: 5.0,
            approach_rad_s: 0.1,
            approach_most_mm: 300.0,
            approach_cone_rad: 60f64.to_radians(),
            run_up_s: 3.0,
            payload_kg: None,
            serial: None,
            force_excess_n: 5.0,
            retreat_mm: 2.0,
            slow: false,
            unverified: false,
            patience_s: 10.0,
        }
    }
}

impl Settings {
    /// The same settings, every number within its range.
    ///
    /// # Errors
    /// [`StreamError::Setting`] naming the first that is not.
    pub fn checked(self) -> Result<Self, StreamError> {
        let ranges = [
            ("tolerance_mm", self.tolerance_mm, 0.01, 0.5),
            ("tolerance_share", self.tolerance_share, 0.01, 0.5),
            ("shaft_lever_mm", self.shaft_lever_mm, 10.0, 500.0),
            ("approach_mm_s", self.approach_mm_s, 0.1, 20.0),
            ("approach_rad_s", self.approach_rad_s, 0.01, 0.5),
            ("approach_most_mm", self.approach_most_mm, 0.0, 1000.0),
            ("approach_cone_rad", self.approach_cone_rad, 0.0, 1.6),
            ("run_up_s", self.run_up_s, 0.0, 60.0),
            ("payload_kg", self.payload_kg.unwrap_or(0.0), 0.0, 20.0),
            ("force_excess_n", self.force_excess_n, 0.0, 1000.0),
            ("retreat_mm", self.retreat_mm, 0.0, 50.0),
            ("patience_s", self.patience_s, 0.1, 120.0),
        ];
        match ranges.iter().find(|(_, value, low, high)| !(low..=high).contains(&value)) {
            None => Ok(self),
            Some(&(name, value, low, high)) => Err(StreamError::Setting { name, value, low, high }),
        }
    }
}
