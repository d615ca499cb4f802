//! Which waypoints are driven through: near-duplicates are merged before corners are rounded.
//!
//! Two waypoints a nanometre apart have a direction between them that is all noise; a corner there would stop the arm.
//! Invariants: first, last and stops are kept (exact duplicates apart); every merged waypoint is within
//! 2 · [`Kept::MERGE_SHARE`] of the tolerance of the kept one that stands for it.

use super::input::{JointPath, PathLimits};

/// Speed at which a move that hardly shifts the burr is measured, mm/s: a move gets at least the length that the burr
/// would cover at this speed in the time that the joints need. A cut's typical speed (Dillon et al. 2016: 1.5 mm/s), so
/// that ṡ stays about even from cuts to rotations. It shapes parabolas between the two, and nothing else.
const REFERENCE_SPEED_MM_S: f64 = 1.5;

/// Waypoints nearer than this are one, stops and ends included, mm.
const SAME_MM: f64 = 1e-12;

/// Which waypoints are driven through; the others are as good as one of these.
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
    /// Share of the corner tolerance within which a waypoint counts as its predecessor. Waypoints nearer than this only
    /// carry noise in their direction, and would slow the arm down for it.
    pub const MERGE_SHARE: f64 = 1.0 / 32.0;

    /// Walks along the path and merges what is near its last kept waypoint. `path` was checked.
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
                    // a stop is met exactly: it takes the place of the waypoint just before it
                    kept.of[last] = k;
                    kept.stop[last] = true;
                }
            }
            kept.kept_of.push(kept.of.len() as u32 - 1);
        }
        kept
    }

    /// The moves that lead from one kept waypoint's cluster to the next one's.
    pub fn moves(&self) -> impl Iterator<Item = u32> {
        let leads_on = |(k, pair): (usize, &[u32])| (pair[0] != pair[1]).then_some(k as u32 + 1);
        self.kept_of.windows(2).enumerate().filter_map(leads_on)
    }
}

/// How far two waypoints are apart, as burr, axis and joints notice it, mm: an axis by what its tolerance is worth.
fn apart_mm(path: &JointPath<'_>, limits: &PathLimits, from: usize, to: usize) -> f64 {
    let [a, b] = [from, to].map(|k| &path.pose[k]);
    let apart = |range: std::ops::Range<usize>| range.map(|k| (b[k] - a[k]).powi(2)).sum::<f64>().sqrt();
    // both tolerances 0: corners are stops, and the axis has no scale
    let per_rad = limits.corner.burr_mm / limits.corner.axis_rad.max(f64::MIN_POSITIVE);
    apart(0..3).max((apart(3..6) * per_rad).min(1e9)).max(joint_mm(path, limits, from, to))
}

/// What the burr covers at the reference speed while the joints go from one waypoint to the other, mm.
pub(super) fn joint_mm(path: &JointPath<'_>, limits: &PathLimits, from: usize, to: usize) -> f64 {
    let dof = limits.dof();
    let steps = path.q[from * dof..].iter().zip(&path.q[to * dof..]).zip(&limits.velocity);
    REFERENCE_SPEED_MM_S * steps.map(|((a, b), v)| (b - a).abs() / v).fold(0.0, f64::max)
}
