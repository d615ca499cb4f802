//! What the arm's state says while it moves: how old it is, and what must stop the arm.
//!
//! Age is counted on the controller's own clock, against the quickest state so far: a state that is made late, comes late or
//! comes again is old, whatever the PC received when. The burr is judged in mm and the shaft in mrad against the clearance that
//! is left where the arm is.

use bonemill_arm::JointKind;
use nalgebra::Vector3;

use crate::stream::cause::Cause;
use crate::stream::link::{ArmState, PLAYING, SAFETY_NORMAL};
use crate::stream::plan::StreamPlan;
use crate::stream::track::Track;
use crate::stream::tube::BLOCK;

/// A controller's clock that falls back by more than this was started again, s.
const RESTART_S: f64 = 1.0;

/// The newest state and its age.
#[derive(Debug, Clone)]
pub struct Watch {
    newest: Option<ArmState>,
    /// Least of PC's clock minus controller's clock, s, and when that was brought up to date.
    offset: Option<(f64, f64)>,
    restarted: bool,
    /// Least time between two states on the controller's clock, s, and how many there were.
    step_s: (f64, u32),
    /// Whether a state has ever had a force.
    felt: bool,
}

/// Where the arm is beside its track.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Deviation {
    /// The arm's place on the track, in rows.
    pub row: f64,
    /// Of the burr from the path, mm.
    pub off_mm: f64,
    /// Of the shaft from its planned axis, rad.
    pub axis_rad: f64,
}

impl Default for Watch {
    fn default() -> Self {
        Self { newest: None, offset: None, restarted: false, step_s: (f64::INFINITY, 0), felt: false }
    }
}

impl Watch {
    /// Takes a state; whether it is a new one.
    pub fn observe(&mut self, state: &ArmState, clock_drift: f64) -> bool {
        let apart_s = state.received_s - state.controller_s;
        if let Some(newest) = &self.newest {
            if state.controller_s < newest.controller_s - RESTART_S {
                self.restarted = true;
            }
            if !(state.controller_s > newest.controller_s) {
                return false;
            }
            let step_s = state.controller_s - newest.controller_s;
            self.step_s = (self.step_s.0.min(step_s), self.step_s.1.saturating_add(1));
        }
        self.offset = Some(match self.offset {
            None => (apart_s, state.received_s),
            Some((offset_s, at_s)) => {
                let drifted_s = offset_s + clock_drift * (state.received_s - at_s).max(0.0);
                (drifted_s.min(apart_s), state.received_s)
            }
        });
        self.felt |= state.force_n.is_some();
        self.newest = Some(*state);
        true
    }

    /// The newest state.
    pub fn newest(&self) -> Option<&ArmState> {
        self.newest.as_ref()
    }

    /// Least time between two states on the controller's clock, s, and of how many.
    pub fn step_s(&self) -> (f64, u32) {
        self.step_s
    }

    /// How old the newest state is, s; infinite where there is none.
    pub fn age_s(&self, now_s: f64) -> f64 {
        match (&self.newest, self.offset) {
            (Some(state), Some((offset_s, _))) => now_s - state.controller_s - offset_s,
            _ => f64::INFINITY,
        }
    }

    /// What the controller itself says against moving.
    pub fn stopped_itself(&self) -> Option<Cause> {
        let state = self.newest.as_ref()?;
        if state.safety_mode != SAFETY_NORMAL {
            return Some(Cause::SafetyMode(state.safety_mode));
        }
        if self.restarted {
            return Some(Cause::Restarted);
        }
        (state.runtime_state != PLAYING).then_some(Cause::ProgramStopped)
    }

    /// What in the newest state is none of an arm's.
    pub fn nonsense(&self) -> Option<Cause> {
        let state = self.newest.as_ref()?;
        let said = if !state.q.iter().all(|q| q.is_finite() && q.abs() < 100.0) {
            "joints, expected six finite numbers, rad"
        } else if !(0.0..=1.001).contains(&state.speed_fraction) {
            "speed fraction, expected 0 to 1"
        } else if !state.controller_s.is_finite() {
            "timestamp, expected a finite number, s"
        } else if state.force_n.is_some_and(|f| !f.iter().all(|v| v.is_finite())) {
            "force, expected finite numbers, N"
        } else {
            return None;
        };
        Some(Cause::Nonsense(said))
    }

    /// A force sensor that was there and is not.
    pub fn sensor_lost(&self) -> Option<Cause> {
        let is_silent = self.newest.as_ref()?.force_n.is_none();
        (self.felt && is_silent).then_some(Cause::SensorLost)
    }

    /// Where the arm is beside the piece of track that it may be on, and what is too far there.
    pub fn judge(
        &self,
        plan: &StreamPlan,
        track: &Track,
        (from_row, to_row): (f64, f64),
        tolerance_mm: impl Fn(usize) -> f64,
    ) -> Option<(Deviation, Option<Cause>)> {
        let state = self.newest.as_ref()?;
        let tool = plan.arm.tool_at(&state.q);
        let near = track.nearest(from_row, to_row, &tool.translation_mm);
        let axis_rad = track.axis_off_rad(from_row, to_row, &(tool.rotation * Vector3::z()));
        let deviation = Deviation { row: near.row, off_mm: near.distance_mm, axis_rad };
        let rows = from_row as usize..=to_row.ceil() as usize;
        let most_mm = rows.map(tolerance_mm).fold(f64::INFINITY, f64::min);
        let most_rad = most_mm / plan.settings().shaft_lever_mm;
        // speeds of every row that may count until a stop begins
        let timing = plan.settings().timing;
        let soon_rows = (timing.state_age_s + 2.0 * timing.transport_s) / plan.period_s;
        let soon = from_row as usize..=(to_row + soon_rows).ceil() as usize + 2 * BLOCK;
        let (joint, joint_off) = track.joints_off(from_row, to_row, &state.q);
        let joint_most =
            track.stops()[joint] * timing.joint_error_s2(track.fastest(soon, plan.period_s).stop_s);
        let cause = if !(near.distance_mm <= most_mm) {
            Some(Cause::OffPath { off_mm: near.distance_mm, most_mm })
        } else if !(axis_rad <= most_rad) {
            Some(Cause::AxisOff { off_rad: axis_rad, most_rad })
        } else if joint_off > joint_most {
            let slides = plan.arm.joints().get(joint).is_some_and(|j| j.kind == JointKind::Prismatic);
            let (per, unit) = if slides { (1.0, "mm") } else { (1e3, "mrad") };
            Some(Cause::JointOff { joint: joint + 1, off: per * joint_off, most: per * joint_most, unit })
        } else {
            None
        };
        Some((deviation, cause))
    }
}
