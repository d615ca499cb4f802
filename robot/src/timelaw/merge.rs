//! Merges waypoints that are almost equal, before corners are rounded.
//!
//! The direction between two waypoints that are a nanometre apart is only noise, and a corner there would stop the arm.
//! Invariants: the first waypoint, the last one and stops are kept (except exact duplicates); the distance of every merged
//! waypoint from the kept one is at most 2 · [`Kept::MERGE_SHARE`] of the tolerance.

use super::input::{JointPath, PathLimits};

/// Speed that gives a length to moves in which the burr hardly moves, mm/s: a move has at least the length that the burr
/// would cover at this speed in the time that the joints need. It is a cut's typical speed (Dillon et al. 2016: 1.5 mm/s),
/// so that ṡ changes little between cuts and rotations. It only affects the transitions between the two.
const REFERENCE_SPEED_MM_S: f64 = 1.5;

/// Waypoints nearer than this are merged, even if they are stops or ends, mm.
const SAME_MM: f64 = 1e-12;

/// The waypoints that are kept; each of the others is merged into one of these.
pub(super) struct Kept {
    /// Indices of given waypoints, increasing, shape (M).
    pub of: Vec<usize>,
    /// Kept waypoint of every given one, shape (N).
    pub kept_of: Vec<u32>,
    /// Whether the arm stops at a kept waypoint, shape (M).
    pub stop: Vec<bool>,
    /// Whether waypoints that differ were merged.
    pub merged: bool,
}

impl Kept {
    /// Share of the corner tolerance within which a waypoint is merged with its predecessor. The direction between nearer
    /// waypoints is noise, which would slow the arm down.
    pub const MERGE_SHARE: f64 = 1.0 / 32.0;

    /// Goes along the path and merges each waypoint that is near the last kept one. `path` was checked.
    pub fn new(path: &JointPath<'_>, limits: &PathLimits) -> Self {
        let count = path.burr_mm.len();
        let mut is_stop = vec![false; count];
        for &stop in path.stops {
            is_stop[stop] = true;
        }
        is_stop[0] = true;
        is_stop[count - 1] = true;
        let near_mm = Self::MERGE_SHARE * limits.corner.burr_mm;
        let mut kept = Self { of: vec![0], kept_of: vec![0], stop: vec![true], merged: false };
        for (k, &stops) in is_stop.iter().enumerate().skip(1) {
            let last = kept.of.len() - 1;
            let apart_mm = apart_mm(path, limits, kept.of[last], k);
            if apart_mm <= SAME_MM {
                kept.stop[last] |= stops;
            } else if apart_mm > near_mm || (stops && kept.stop[last]) {
                kept.of.push(k);
                kept.stop.push(stops);
            } else {
                kept.merged = true;
                if stops {
                    // a stop must be met exactly, so it replaces the waypoint just before it
                    kept.of[last] = k;
                    kept.stop[last] = true;
                }
            }
            kept.kept_of.push(kept.of.len() as u32 - 1);
        }
        kept
    }

    /// The moves from the waypoints merged into one kept waypoint to those merged into the next.
    pub fn moves(&self) -> impl Iterator<Item = u32> {
        let leads_on = |(k, pair): (usize, &[u32])| (pair[0] != pair[1]).then_some(k as u32 + 1);
        self.kept_of.windows(2).enumerate().filter_map(leads_on)
    }
}

/// Distance of two waypoints, mm: the greatest of the burr's motion, the axis' turn (scaled by the ratio of the two
/// tolerances) and the joints' motion.
fn apart_mm(path: &JointPath<'_>, limits: &PathLimits, from: usize, to: usize) -> f64 {
    let [a, b] = [from, to].map(|k| &path.pose[k]);
    let apart = |range: std::ops::Range<usize>| range.map(|k| (b[k] - a[k]).powi(2)).sum::<f64>().sqrt();
    // if both tolerances are 0, corners are stops, and the axis needs no scale
    let per_rad = limits.corner.burr_mm / limits.corner.axis_rad.max(f64::MIN_POSITIVE);
    apart(0..3).max((apart(3..6) * per_rad).min(1e9)).max(joint_mm(path, limits, from, to))
}

/// The distance that the burr covers at the reference speed while the joints move from one waypoint to the other, mm.
pub(super) fn joint_mm(path: &JointPath<'_>, limits: &PathLimits, from: usize, to: usize) -> f64 {
    let dof = limits.dof();
    let steps = path.q[from * dof..].iter().zip(&path.q[to * dof..]).zip(&limits.velocity);
    REFERENCE_SPEED_MM_S * steps.map(|((a, b), v)| (b - a).abs() / v).fold(0.0, f64::max)
}
