//! A plan as it is streamed: checked rows, the clearance left at each, and how fast each may be passed.
//!
//! Built once from values, before anything is connected. After that nothing in it can be wrong for an arm that follows.
//! The clearance left is what lies between the burr's surface and the nearest structure. Between waypoints it is bounded from
//! both ends, since a distance changes no faster than the burr moves, and from below by the clearance that the plan keeps.

use bonemill_arm::{Arm, Joint, JointKind};
use nalgebra::Vector3;

use crate::stream::bound::{self, Failure, Rates, Travel};
use crate::stream::error::StreamError;
use crate::stream::link::{Joints, padded};
use crate::stream::settings::Settings;
use crate::stream::track::Track;
use crate::stream::tube::BLOCK;

/// What is known of a plan's files.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Standing {
    /// Every file is what a passing verification judged.
    Verified,
    /// It is not so, for this reason.
    Unverified(String),
}

/// A structure that the plan keeps clear of.
#[derive(Debug, Clone, PartialEq)]
pub struct StructureKept {
    /// Its name.
    pub name: String,
    /// Least distance of the burr's surface that the plan keeps everywhere, mm.
    pub clearance_mm: f64,
}

/// A structure near a waypoint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Near {
    /// Its place among the structures.
    pub structure: usize,
    /// From the burr's surface to it, mm.
    pub gap_mm: f64,
    /// Unit direction from the burr to it, in base.
    pub toward: Vector3<f64>,
    /// Predicted force along that direction, N; not negative.
    pub force_n: f64,
}

/// What streaming needs of a waypoint.
#[derive(Debug, Clone, PartialEq)]
pub struct WaypointNear {
    /// When the burr is there, s on the trajectory's clock.
    pub time_s: f64,
    /// Structures within reach of a force; others are farther away than all of these.
    pub near: Vec<Near>,
}

/// A place at which the burr goes back a little and the user is waited for.
#[derive(Debug, Clone, PartialEq)]
pub struct HoldPlace {
    /// The row of the trajectory.
    pub row: usize,
    /// What the user is told, such as the structure and its distance.
    pub why: String,
}

/// A plan's values, as its files have them.
#[derive(Debug, Clone)]
pub struct StreamInput<'a> {
    /// The arm, with the burr on its flange.
    pub arm: &'a Arm,
    /// The arm's name in the case, such as `ur5e`.
    pub model: String,
    /// The trajectory's clock, s.
    pub time_s: &'a [f64],
    /// Joint positions row by row, rad or mm.
    pub q: &'a [f64],
    /// The case's structures.
    pub structures: Vec<StructureKept>,
    /// All waypoints, in order.
    pub waypoints: Vec<WaypointNear>,
    /// Hold points, by row.
    pub holds: Vec<HoldPlace>,
    /// Whether the case says nothing of where the arm stands.
    pub registration_assumed: bool,
    /// What is known of the files.
    pub standing: Standing,
    /// SHA-256 of the trajectory, hexadecimal: binds a log to its plan.
    pub digest: String,
}

/// A plan that can be streamed.
#[derive(Debug, Clone)]
pub struct StreamPlan {
    /// The arm.
    pub arm: Arm,
    /// Its name in the case.
    pub model: String,
    /// Time between rows, s.
    pub period_s: f64,
    /// The rows.
    pub track: Track,
    /// The case's structures.
    pub structures: Vec<StructureKept>,
    /// From the burr's surface to the nearest structure, by row, mm.
    pub gap_mm: Vec<f64>,
    /// Share of the planned speed at which each row may be passed, 0 to 1; 0 where no speed is slow enough.
    pub rate: Vec<f64>,
    /// Hold points, by row.
    pub holds: Vec<HoldPlace>,
    /// What is known of the files.
    pub standing: Standing,
    /// SHA-256 of the trajectory, hexadecimal.
    pub digest: String,
    /// How far off its path the burr can be at most while a row is the newest target, at that share, mm; where it is farthest, by the row's own tube.
    pub off_mm: Vec<f64>,
    /// How fast the share of the planned speed may change, 1/s.
    pub ramp_per_s: f64,
    waypoints: Vec<WaypointNear>,
    settings: Settings,
    /// The share at which the tube of each block of rows is narrow enough.
    rate_of_tubes: Vec<f64>,
}

/// Farther than any structure that a force is told for, mm.
const FAR_MM: f64 = 8.0;

impl StreamPlan {
    /// Checks a plan's values.
    ///
    /// # Errors
    /// [`StreamError`]: an arm of more than six joints, an assumed registration, a rate that the controller does not have, steps or positions
    /// beyond the limits, waypoints of another trajectory, settings out of range.
    pub fn new(input: StreamInput<'_>, settings: Settings) -> Result<Self, StreamError> {
        let settings = settings.checked()?;
        let joints = input.arm.joints();
        if joints.is_empty() || joints.len() > 6 {
            return Err(not_ur(joints));
        }
        if input.registration_assumed {
            return Err(StreamError::RegistrationAssumed);
        }
        let period_s = even_period(input.time_s)?;
        let rows: Vec<Joints> = input.q.chunks_exact(joints.len()).filter_map(padded).collect();
        if rows.len() != input.time_s.len() {
            return Err(StreamError::TooFewRows { rows: rows.len() });
        }
        check_rows(joints, &rows, period_s)?;
        let track = Track::new(input.arm, settings.timing.stops(input.arm), rows);
        let gap_mm = gaps(&track, period_s, &input.waypoints, &input.structures)?;
        let mut plan = Self {
            arm: input.arm.clone(),
            model: input.model,
            period_s,
            structures: input.structures,
            rate: vec![1.0; gap_mm.len()],
            gap_mm,
            holds: input.holds,
            standing: input.standing,
            digest: input.digest,
            off_mm: Vec::new(),
            rate_of_tubes: Vec::new(),
            ramp_per_s: ramp_per_s(&track, period_s),
            waypoints: input.waypoints,
            settings,
            track,
        };
        let Rates { rate, off_mm, of_tubes } = bound::rates(&plan);
        (plan.rate, plan.off_mm, plan.rate_of_tubes) = (rate, off_mm, of_tubes);
        Ok(plan)
    }

    /// That a controller with six revolute joints can follow it, as those that it is streamed to have.
    ///
    /// # Errors
    /// [`StreamError::NotUr`].
    pub fn for_a_ur(&self) -> Result<(), StreamError> {
        let joints = self.arm.joints();
        let is_ur = joints.len() == 6 && joints.iter().all(|j| j.kind == JointKind::Revolute);
        if is_ur { Ok(()) } else { Err(not_ur(joints)) }
    }

    /// What of the plan alone refuses a run before anything is connected, in words.
    ///
    /// # Errors
    /// A plan that is not verified, or too fast for the room that it has.
    pub fn ready(&self) -> Result<(), String> {
        crate::stream::check::plan_ready(self)
    }

    /// How it is streamed.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Expects the arm farther behind its targets, as far as they are held back on the controller; bounds and speeds stay.
    pub(crate) fn lag_by(&mut self, held_s: f64) {
        self.settings.timing.lag_s += held_s;
    }

    /// The time that it takes at its planned speed, s.
    pub fn duration_s(&self) -> f64 {
        self.period_s * self.track.last_row()
    }

    /// How far the burr may be off its path in a row, mm: a share of the clearance that is left there.
    pub fn tolerance_mm(&self, row: usize) -> f64 {
        let gap_mm = self.gap_mm.get(row).copied().unwrap_or(0.0);
        self.settings.tolerance_mm.min(self.settings.tolerance_share * gap_mm)
    }

    /// Where a run goes on that was stopped at a place: back by as much as the arm may have been behind it.
    pub fn resume_row(&self, reached_row: f64) -> f64 {
        let reached_row = reached_row.clamp(0.0, self.track.last_row());
        let back_mm = self.tolerance_mm(reached_row as usize);
        let mut row = reached_row;
        let reached_mm = self.track.burr_at(reached_row);
        while row > 0.0 && (self.track.burr_at(row) - reached_mm).norm() < back_mm {
            row = (row - 1.0).max(0.0);
        }
        row
    }

    /// How far from a place where it goes on a stopped run may have left the burr, mm: the way back from the place that was seen last, and
    /// what the burr went on after that.
    pub(crate) fn left_mm(&self, row: f64) -> f64 {
        let start_mm = self.track.burr_at(row);
        let step_mm = (self.track.burr_at(row + 1.0) - start_mm).norm();
        let back_mm = |n: usize| (self.track.burr_at(n as f64) - start_mm).norm();
        let seen_last =
            (row as usize..self.track.rows()).take_while(|n| back_mm(*n) <= self.tolerance_mm(*n) + step_mm);
        seen_last.map(|n| back_mm(n) + self.travel(n).along_mm).fold(0.0, f64::max)
    }

    /// What the burr can travel after a failure in a row, at the worst and at the speed that is allowed there.
    pub fn travel(&self, row: usize) -> Travel {
        let row = row.min(self.track.rows() - 1);
        let along = Failure::ALL.map(|failure| bound::along_mm(self, row, self.rate[row], failure));
        Travel { along_mm: along.into_iter().fold(0.0, f64::max), off_mm: self.off_mm[row] }
    }

    /// Some rows of it, for trials: with its clearances and speeds, and every row's own tube, without waypoints and hold points.
    pub fn piece(&self, from_row: usize, rows: usize) -> Self {
        let from = from_row.min(self.track.rows().saturating_sub(2));
        let to = (from + rows.max(2)).min(self.track.rows());
        let own_mm = |row: usize| {
            let block = row / BLOCK;
            // where no share is small enough: of the smallest that was tried
            let rate = self.rate_of_tubes.get(block).copied().filter(|rate| *rate > 0.0);
            rate.map_or(self.off_mm[row], |rate| bound::tube(self, block * BLOCK, rate).off_mm)
        };
        Self {
            off_mm: (from..to).map(own_mm).collect(),
            rate_of_tubes: Vec::new(),
            arm: self.arm.clone(),
            model: self.model.clone(),
            period_s: self.period_s,
            track: self.track.piece(from, to),
            structures: self.structures.clone(),
            gap_mm: self.gap_mm[from..to].to_vec(),
            rate: self.rate[from..to].to_vec(),
            holds: Vec::new(),
            standing: self.standing.clone(),
            digest: self.digest.clone(),
            ramp_per_s: self.ramp_per_s,
            waypoints: Vec::new(),
            settings: self.settings.clone(),
        }
    }

    /// The structures near the move that a row belongs to.
    pub fn near(&self, row: f64) -> &[Near] {
        let time_s = row * self.period_s;
        let n = self.waypoints.partition_point(|w| w.time_s < time_s);
        self.waypoints.get(n.min(self.waypoints.len().saturating_sub(1))).map_or(&[], |w| &w.near)
    }
}

/// How fast the share of a track's speed may change, 1/s: joints slow no harder than in twice the least stop that is assumed, since a
/// controller's own is that hard. Between 2 and 10.
pub(crate) fn ramp_per_s(track: &Track, period_s: f64) -> f64 {
    (2.0 / track.fastest(0..=track.rows(), period_s).stop_s).clamp(2.0, 10.0)
}

fn not_ur(joints: &[Joint]) -> StreamError {
    let kind = |j: &Joint| if j.kind == JointKind::Revolute { "revolute" } else { "prismatic" };
    StreamError::NotUr { kinds: joints.iter().map(kind).collect::<Vec<_>>().join(", ") }
}

fn even_period(time_s: &[f64]) -> Result<f64, StreamError> {
    let rows = time_s.len();
    let (Some(first), Some(last), true) = (time_s.first(), time_s.last(), rows >= 2) else {
        return Err(StreamError::TooFewRows { rows });
    };
    let period_s = (last - first) / (rows - 1) as f64;
    if !(0.002 - 1e-9..=0.01 + 1e-9).contains(&period_s) {
        return Err(StreamError::Period { period_s });
    }
    let off = |(row, time): (usize, &f64)| !((time - period_s * row as f64).abs() <= 1e-6);
    match time_s.iter().enumerate().find(|at| off(*at)) {
        None => Ok(period_s),
        Some((row, &time_s)) => Err(StreamError::Uneven { row, time_s, period_s }),
    }
}

fn check_rows(joints: &[Joint], rows: &[Joints], period_s: f64) -> Result<(), StreamError> {
    for (row, q) in rows.iter().enumerate() {
        let before = &rows[row.saturating_sub(1)];
        for ((joint, q), before) in joints.iter().zip(q).zip(before) {
            let beyond_rad = (joint.lower - q).max(q - joint.upper);
            // what is not finite is within no limit
            if !(beyond_rad <= 0.0) {
                return Err(StreamError::BeyondLimit { row, joint: joint.name.clone(), beyond_rad });
            }
            let speed_rad_s = (q - before).abs() / period_s;
            if speed_rad_s > joint.velocity_limit * (1.0 + 1e-6) {
                let (joint, limit_rad_s) = (joint.name.clone(), joint.velocity_limit);
                return Err(StreamError::TooFast { row, joint, speed_rad_s, limit_rad_s });
            }
        }
    }
    Ok(())
}

/// The clearance that is left in every row.
fn gaps(
    track: &Track,
    period_s: f64,
    waypoints: &[WaypointNear],
    structures: &[StructureKept],
) -> Result<Vec<f64>, StreamError> {
    let end_s = period_s * track.last_row();
    let mut before_s = 0.0;
    for (waypoint, w) in waypoints.iter().enumerate() {
        let time_s = w.time_s;
        if !(time_s >= before_s && time_s <= end_s + period_s) {
            return Err(StreamError::Waypoint { waypoint, time_s, end_s });
        }
        before_s = time_s;
    }
    let kept_mm = structures.iter().map(|s| s.clearance_mm).fold(f64::INFINITY, f64::min).min(FAR_MM);
    let gap = |n: usize| {
        let near = waypoints.get(n).map_or(&[][..], |w| &w.near);
        near.iter().map(|s| s.gap_mm).fold(FAR_MM, f64::min)
    };
    let mut at = 0;
    let rows = (0..track.rows()).map(|row| {
        let time_s = row as f64 * period_s;
        while at + 1 < waypoints.len() && waypoints[at + 1].time_s < time_s {
            at += 1;
        }
        let place = |n: usize| waypoints.get(n).map_or(0.0, |w| w.time_s / period_s);
        let next = (at + 1).min(waypoints.len().saturating_sub(1));
        let from_before = gap(at) - track.way_mm(place(at), row as f64);
        let from_next = gap(next) - track.way_mm(row as f64, place(next));
        from_before.max(from_next).max(kept_mm)
    });
    Ok(rows.collect())
}
