//! A path that is prepared once and then timed with many sets of speed caps.

use std::ops::Range;
use std::sync::Arc;

use bonemill_arm::RobotError;

use super::geometry::{Geometry, PathElement};
use super::input::{JointPath, PathLimits, check_caps, check_path};
use super::law::TimeLaw;
use super::pass;
use super::stretch::{Stretch, stretches};

/// Window lengths that are tried, as shares of the longest useful one, 2 q̈max/q⃛max, at which jerk limits no longer bind
/// accelerations on straight moves. A shorter window allows less acceleration but saves time at stops and slow places.
pub(super) const WINDOW_SHARES: [f64; 5] = [1.0, 0.5, 0.25, 0.125, 0.0625];

/// The shortest window, s: half a controller's cycle. A controller cannot follow shorter changes, and differences over
/// microseconds would be lost in the rounding of times.
const SHORTEST_WINDOW_S: f64 = 1e-3;

/// A joint path with rounded corners, from which laws for any set of speed caps are computed.
///
/// ```
/// use bonemill_robot::timelaw::{CornerTolerance, JointPath, PathLimits, PreparedPath};
/// let limits = PathLimits::new(&[15.0; 2], &[150.0; 2], &[3000.0; 2], CornerTolerance::default())?;
/// let q = [0.0, 0.0, 10.0, 0.0, 10.0, 5.0];
/// let pose = [[0.0, 0.0, 0.0, 0.0, 0.0, 1.0], [10.0, 0.0, 0.0, 0.0, 0.0, 1.0], [10.0, 5.0, 0.0, 0.0, 0.0, 1.0]];
/// let path = JointPath { q: &q, burr_mm: &[0.0, 10.0, 5.0], pose: &pose, stops: &[] };
/// let prepared = PreparedPath::new(&path, &limits)?;
/// let law = prepared.law(&[0.0, 2.0, 2.0])?;
/// assert!((law.duration_s() - 7.5).abs() < 0.3);
/// assert!(law.limit_ratios(&limits).jerk <= 1.0 + 1e-9);
/// # Ok::<(), bonemill_arm::RobotError>(())
/// ```
#[derive(Debug, Clone)]
pub struct PreparedPath {
    geometry: Arc<Geometry>,
    elements: Arc<[(f64, f64, PathElement)]>,
    limits: PathLimits,
    /// Whether the burr moves on a given move, so that its cap counts.
    burr_moves: Vec<bool>,
}

impl PreparedPath {
    /// Rounds the corners of a path; linear in the number of waypoints.
    ///
    /// # Errors
    /// [`RobotError::EmptyPath`], [`RobotError::Length`] or [`RobotError::Value`] where `path` holds no waypoint, lists
    /// of other lengths, a number that is not finite or too large, a negative length or a stop that is not a waypoint.
    pub fn new(path: &JointPath<'_>, limits: &PathLimits) -> Result<Self, RobotError> {
        check_path(path, limits.dof())?;
        let geometry = Geometry::new(path, limits);
        Ok(Self {
            elements: geometry.elements().into(),
            geometry: Arc::new(geometry),
            limits: limits.clone(),
            burr_moves: path.burr_mm.iter().map(|ds| *ds > 0.0).collect(),
        })
    }

    /// Number of given waypoints.
    pub fn waypoint_count(&self) -> usize {
        self.burr_moves.len()
    }

    /// The rounded corners at which the burr leaves the polyline by at least `least_mm`: the given waypoints that lie there, and the joint
    /// vectors at equal steps from where the corner begins to where it ends, `half` steps to its middle.
    pub fn burr_corners(&self, least_mm: f64, half: usize) -> Vec<(Range<usize>, Vec<Vec<f64>>)> {
        let kept_of = &self.geometry.kept_of;
        let of_kept = |i: usize| {
            let up_to = |kept: usize| kept_of.partition_point(|of| (*of as usize) < kept);
            up_to(i)..up_to(i + 1)
        };
        let is_wide = |i: &usize| self.geometry.burr_off_mm(*i) >= least_mm;
        let corner = |i: usize| {
            let l = self.geometry.half_blend_mm[i];
            let at = |n: usize| {
                let (x, mut q) = (n as f64 / half as f64 * l, vec![0.0; self.geometry.dof]);
                self.geometry.at(PathElement::Blend(i as u32), x, |j, [position, ..]| q[j] = position);
                q
            };
            (of_kept(i), (0..=2 * half).map(at).collect())
        };
        (0..self.geometry.count()).filter(is_wide).map(corner).collect()
    }

    /// The time law under speed caps of the burr, mm/s, one per waypoint for the move that ENDS there.
    ///
    /// The first cap is ignored, and so is that of a rotation in place: the burr's motion at its rounded corners is limited by
    /// the cap of the neighbouring move.
    ///
    /// # Errors
    /// [`RobotError::Length`] or [`RobotError::Value`] where a cap is missing, not finite or not above 0.
    pub fn law(&self, caps_mm_s: &[f64]) -> Result<TimeLaw, RobotError> {
        let (window_s, _, best) = self.best(caps_mm_s)?;
        Ok(TimeLaw::new(Arc::clone(&self.geometry), Arc::clone(&self.elements), &best, window_s))
    }

    /// Only the duration of [`PreparedPath::law`], s, for searches over caps.
    ///
    /// # Errors
    /// As [`PreparedPath::law`].
    pub fn duration_s(&self, caps_mm_s: &[f64]) -> Result<f64, RobotError> {
        Ok(self.best(caps_mm_s)?.1)
    }

    /// A lower bound of a law's duration, s: every move at its cap or at its slowest joint's velocity limit, without
    /// acceleration limits.
    ///
    /// Merged moves and rounded corners count with their full length.
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

    /// The window with the shortest law: its length, the law's duration and the boxes. A shorter window saves time at rests and
    /// allows less acceleration elsewhere, so as soon as a shorter one gives a longer law, still shorter ones are not tried.
    fn best(&self, caps_mm_s: &[f64]) -> Result<(f64, f64, Vec<Stretch>), RobotError> {
        let caps = self.segment_caps(caps_mm_s)?;
        let mut best = self.through_window(&caps, WINDOW_SHARES[0]);
        for share in &WINDOW_SHARES[1..] {
            let shorter = self.through_window(&caps, *share);
            if shorter.1 >= best.1 {
                break;
            }
            best = shorter;
        }
        Ok(best)
    }

    /// The same for one window, given as a share of the longest.
    pub(super) fn through_window(&self, caps: &[f64], share: f64) -> (f64, f64, Vec<Stretch>) {
        let limits = &self.limits;
        let longest_s =
            limits.acceleration.iter().zip(&limits.jerk).map(|(a, j)| 2.0 * a / j).fold(0.0, f64::max);
        let window_s = (share * longest_s).max(SHORTEST_WINDOW_S);
        let boxes = stretches(&self.geometry, limits, caps, window_s);
        let duration_s = if boxes.is_empty() { 0.0 } else { pass::duration_s(&boxes, window_s) + window_s };
        (window_s, duration_s, boxes)
    }

    /// The cap of each kept segment, mm/s; ∞ where the burr stands still. A merged move takes no time, so its cap is not used.
    pub(super) fn segment_caps(&self, caps_mm_s: &[f64]) -> Result<Vec<f64>, RobotError> {
        check_caps(caps_mm_s, self.waypoint_count())?;
        let cap = |&k: &u32| {
            let k = k as usize;
            if self.burr_moves[k] { caps_mm_s[k] } else { f64::INFINITY }
        };
        Ok(self.geometry.move_to.iter().map(cap).collect())
    }
}
