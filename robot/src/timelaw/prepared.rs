//! A path made ready once, to be timed under many sets of speed caps.

use std::sync::Arc;

use super::geometry::{Element, Geometry};
use super::input::{JointPath, PathLimits, check_caps, check_path};
use super::law::TimeLaw;
use super::pass;
use crate::error::RobotError;

/// Intervals of a parabola; even, so that its waypoint lies between two.
///
/// The knob of speed against optimality: against a fine grid with signed constraints, cuts with random caps take 2.7, 1.0
/// and 0.3 % longer (mean of 6 paths) with 2, 4 and 8 intervals, and preparing and timing a path takes 1 : 1.4 : 2.
pub(super) const BLEND_INTERVALS: u32 = 4;

/// A stretch of the path on which one bound on σ = ṡ² and σ' holds.
#[derive(Debug, Clone, Copy)]
pub(super) struct Interval {
    pub element: Element,
    /// Its start on the element, mm of s.
    pub start_mm: f64,
    /// Its length h, mm of s; above 0.
    pub length_mm: f64,
    /// Greatest σ within the joints' limits, mm²/s².
    pub joint_sigma: f64,
    /// Greatest |σ'| on a straight piece, mm/s²; unused on a parabola.
    pub slope: f64,
    /// Greatest path length of the burr per s in the interval.
    pub burr_per_s: f64,
    /// Kept segment whose speed cap holds.
    pub segment: u32,
    /// Kept segment whose speed cap holds where the burr stands still on that one; the same on a straight piece.
    pub neighbour: u32,
    /// Part of a parabola, 0..[`BLEND_INTERVALS`].
    pub part: u32,
}

/// A joint path with its corners rounded and its constraints laid out; times any set of speed caps.
///
/// The geometry does not depend on the caps, so raising a cap never lengthens the law.
///
/// ```
/// use bonemill_robot::timelaw::{JointPath, PathLimits, PreparedPath};
/// let limits = PathLimits::new(&[15.0, 15.0], &[150.0, 150.0], &[1.0, 1.0], 0.04)?;
/// let q = [0.0, 0.0, 10.0, 0.0, 10.0, 5.0];
/// let path = JointPath { q: &q, burr_mm: &[0.0, 10.0, 5.0], stops: &[] };
/// let prepared = PreparedPath::new(&path, &limits)?;
/// let law = prepared.law(&[0.0, 2.0, 2.0])?;
/// assert!((law.duration_s() - 7.5).abs() < 0.1);
/// assert_eq!(law.sample(0.0).qd, [0.0, 0.0]);
/// # Ok::<(), bonemill_robot::RobotError>(())
/// ```
#[derive(Debug, Clone)]
pub struct PreparedPath {
    pub(super) geometry: Arc<Geometry>,
    pub(super) limits: PathLimits,
    pub(super) intervals: Vec<Interval>,
    /// Whether the burr moves on a given move, so that its cap counts.
    burr_moves: Vec<bool>,
}

impl PreparedPath {
    /// Rounds the corners of a path and lays out its constraints; linear in the number of waypoints.
    ///
    /// # Errors
    /// [`RobotError::EmptyPath`], [`RobotError::Length`] or [`RobotError::Value`] where `path` holds no waypoint, lists
    /// of other lengths, a number that is not finite or absurd, a negative length or a stop that is no waypoint.
    pub fn new(path: &JointPath<'_>, limits: &PathLimits) -> Result<Self, RobotError> {
        check_path(path, limits.dof())?;
        let geometry = Geometry::new(path, limits);
        Ok(Self {
            intervals: intervals(&geometry, limits),
            geometry: Arc::new(geometry),
            limits: limits.clone(),
            burr_moves: path.burr_mm.iter().map(|ds| *ds > 0.0).collect(),
        })
    }

    /// Number of waypoints as given.
    pub fn waypoint_count(&self) -> usize {
        self.burr_moves.len()
    }

    /// The time law under speed caps of the burr, mm/s, one per waypoint for the move that ENDS there.
    ///
    /// The first cap is ignored, as is that of a rotation in place: what the burr still moves at its cut corners is under
    /// the cap of the neighbouring move.
    ///
    /// # Errors
    /// [`RobotError::Length`] or [`RobotError::Value`] where a cap is missing, not finite or not above 0.
    pub fn law(&self, caps_mm_s: &[f64]) -> Result<TimeLaw, RobotError> {
        let sigma_max = self.sigma_max(caps_mm_s)?;
        let sigma = pass::greatest_sigma(self, &sigma_max);
        Ok(TimeLaw::new(self, &sigma_max, &sigma))
    }

    /// The duration alone of [`PreparedPath::law`], s, at half its cost: for searches over caps.
    ///
    /// # Errors
    /// As [`PreparedPath::law`].
    pub fn duration_s(&self, caps_mm_s: &[f64]) -> Result<f64, RobotError> {
        let sigma_max = self.sigma_max(caps_mm_s)?;
        let sigma = pass::greatest_sigma(self, &sigma_max);
        let mut duration_s = 0.0;
        pass::for_each_phase(self, &sigma_max, &sigma, |_, phase| duration_s += phase.duration_s());
        Ok(duration_s)
    }

    /// A time that no law can beat, s: every move at its cap or its slowest joint's velocity limit, accelerations free.
    ///
    /// Moves that were merged away and the little that cut corners save are counted as driven in full.
    ///
    /// # Errors
    /// As [`PreparedPath::law`].
    pub fn lower_bound_s(&self, caps_mm_s: &[f64]) -> Result<f64, RobotError> {
        let caps = self.segment_caps(caps_mm_s)?;
        let seconds = caps.iter().enumerate().map(|(i, cap)| {
            let speed =
                self.geometry.joint_sigma(i, &self.limits).sqrt().min(cap / self.geometry.burr_per_s[i]);
            self.geometry.length_mm[i] / speed
        });
        Ok(seconds.sum())
    }

    /// Greatest σ of each interval under the caps, mm²/s².
    fn sigma_max(&self, caps_mm_s: &[f64]) -> Result<Vec<f64>, RobotError> {
        let caps = self.segment_caps(caps_mm_s)?;
        let sigma = |interval: &Interval| {
            let own = caps[interval.segment as usize];
            // a parabola into a rotation in place still carries the burr: the end of the move before
            let cap = if own.is_finite() { own } else { caps[interval.neighbour as usize] };
            // a burr that stands still has no speed cap: cap / 0 = ∞
            let cap = cap / interval.burr_per_s;
            interval.joint_sigma.min(cap * cap)
        };
        Ok(self.intervals.iter().map(sigma).collect())
    }

    /// The cap of each kept segment, mm/s; ∞ where the burr stands still. A move that was merged away takes no time, so
    /// its cap binds nothing.
    fn segment_caps(&self, caps_mm_s: &[f64]) -> Result<Vec<f64>, RobotError> {
        check_caps(caps_mm_s, self.waypoint_count())?;
        let cap = |&k: &u32| {
            let k = k as usize;
            if self.burr_moves[k] { caps_mm_s[k] } else { f64::INFINITY }
        };
        Ok(self.geometry.move_to.iter().map(cap).collect())
    }
}

/// Every straight piece and the parts of every parabola, in the order of travel.
fn intervals(geometry: &Geometry, limits: &PathLimits) -> Vec<Interval> {
    let mut intervals = Vec::with_capacity(geometry.count() * (1 + BLEND_INTERVALS as usize));
    for i in 0..geometry.count() - 1 {
        let (length, l1, l2) =
            (geometry.length_mm[i], geometry.half_blend_mm[i], geometry.half_blend_mm[i + 1]);
        // what rounding leaves of a segment between two parabolas that meet is no piece
        if length - l1 - l2 > 1e-12 * length {
            intervals.push(straight(geometry, limits, i));
        }
        if l2 > 0.0 {
            intervals.extend((0..BLEND_INTERVALS).map(|part| blend(geometry, limits, i + 1, part)));
        }
    }
    intervals
}

/// |d σ'| / 2 ≤ a and |d| √σ ≤ v on the straight piece of kept segment i.
fn straight(geometry: &Geometry, limits: &PathLimits, i: usize) -> Interval {
    let most = geometry.direction(i).iter().zip(&limits.acceleration).map(|(d, a)| d.abs() / a);
    let start_mm = geometry.half_blend_mm[i];
    Interval {
        element: Element::Straight(i as u32),
        start_mm,
        length_mm: geometry.length_mm[i] - start_mm - geometry.half_blend_mm[i + 1],
        joint_sigma: geometry.joint_sigma(i, limits),
        slope: 2.0 / most.fold(0.0, f64::max),
        burr_per_s: geometry.burr_per_s[i],
        segment: i as u32,
        neighbour: i as u32,
        part: 0,
    }
}

/// One part of the parabola at kept waypoint i: |c| σ ≤ a and max|q'| √σ ≤ v.
fn blend(geometry: &Geometry, limits: &PathLimits, i: usize, part: u32) -> Interval {
    let corner = geometry.corner(i);
    let [from, to] = part_ends(part);
    let (mut slowest, mut most_curved) = (0f64, 0f64);
    let joints = limits.velocity.iter().zip(&limits.acceleration);
    for ((steepest, curvature), (v, a)) in corner.bounds(from, to).zip(joints) {
        slowest = slowest.max(steepest / v);
        most_curved = most_curved.max(curvature / a);
    }
    let (before, after) = (i as u32 - 1, i as u32);
    let first_half = part < BLEND_INTERVALS / 2;
    let (segment, neighbour) = if first_half { (before, after) } else { (after, before) };
    // the burr's path length per s goes linearly from one segment's to the other's
    let (r1, r2) = (geometry.burr_per_s[i - 1], geometry.burr_per_s[i]);
    let burr_per_s = [from, to].map(|u| (1.0 - u) * r1 + u * r2);
    Interval {
        element: Element::Blend(i as u32),
        start_mm: 2.0 * corner.half_mm * from,
        length_mm: 2.0 * corner.half_mm / f64::from(BLEND_INTERVALS),
        joint_sigma: slowest.powi(-2).min(most_curved.recip()),
        slope: 0.0,
        burr_per_s: burr_per_s[0].max(burr_per_s[1]),
        segment,
        neighbour,
        part,
    }
}

/// The u at which a part of a parabola begins and ends.
pub(super) fn part_ends(part: u32) -> [f64; 2] {
    [part, part + 1].map(|at| f64::from(at) / f64::from(BLEND_INTERVALS))
}
