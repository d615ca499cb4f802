//! How far off its path the burr can be, whatever fails: the tube around the path.
//!
//! An arm that follows is, in joint space, a weighted mean of the targets that it was sent lately, and its velocity is the mean of their
//! velocities with the same weights. So a stop that slows all joints together, straight in joint space, leads to places that are means of
//! targets *moved ahead along their own tangent* by the stop's duration over two. The burrs of the moved targets are computed. A mean of
//! them lies in their convex hull, and the distance from a chord of the path is convex: its largest value is at one of the burrs. What is
//! left is how far the burr of a mean is from the mean of the burrs ([`Curvature`]), and what an arm is off its targets.
//!
//! ```text
//! off = farthest burr from the chord + sagitta of the path + bend of the kinematics + older targets + longer·error + error's turn
//! ```
//!
//! Each term is derived in docs/streaming.md.

use std::ops::{Range, RangeInclusive};

use nalgebra::Vector3;

use crate::stream::bend::Curvature;
use crate::stream::link::Joints;
use crate::stream::plan::StreamPlan;
use crate::stream::settings::StreamTiming;
use crate::stream::track::Track;

/// How far off its path the burr can be, and the room to structures there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tube {
    /// Off the path, mm.
    pub off_mm: f64,
    /// The least clearance over that piece of path, mm.
    pub gap_mm: f64,
}

/// Rows that share a tube.
pub(crate) const BLOCK: usize = 5;

/// The tube while the newest target is in one of `BLOCK` rows from a row on, and no row before was passed at more than the share `rate`
/// of its planned speed (above 0), or at half of that going back.
pub fn tube(plan: &StreamPlan, row: usize, rate: f64) -> Tube {
    wide_tube(plan, row, BLOCK, rate)
}

/// The same while the newest target is in one of some `rows` from a row on.
pub(crate) fn wide_tube(plan: &StreamPlan, row: usize, rows: usize, rate: f64) -> Tube {
    let (timing, track) = (plan.settings().timing, &plan.track);
    let end = track.rows() - 1;
    let rows_of = |seconds: f64| rate * seconds / plan.period_s;
    let first = (row as f64 - rows_of(timing.backlog_s())).max(0.0) as usize;
    let last = (row + rows).min(end);
    let fastest = track.fastest(first..=last, plan.period_s);
    let error_share = timing.joint_error_share(fastest.stop_s);
    // half of the longest stop's duration: from the path's speed, and from that of a joint on its way back to what it was told
    let stop_s = 0.5 * rate * fastest.stop_s + error_share * timing.follow_s;
    let longer = (stop_s / timing.follow_s - 1.0).max(1.0);
    let points = Points::new(plan, first..=last, rows_of(stop_s));
    let from = (first as f64 - BACK * points.ahead).max(0.0) as usize;
    let to = ((last as f64 + points.ahead).ceil() as usize).min(end);
    // what may be judged by the state that was used last
    let judged =
        first..=((row as f64 - rows_of(timing.state_age_s + timing.transport_s)) as usize).max(first);
    let tolerance_mm = judged.map(|n| plan.tolerance_mm(n)).fold(f64::INFINITY, f64::min);
    let older_rows = rows_of(older_square_s2(timing).sqrt());
    let all = 0..SHARES.len();
    let beside_mm =
        points.beside_mm(track, (from, to), all.clone()).min(points.beside_mm(track, (from, last), all));
    let followed_mm = points.beside_mm(track, (from, last), AS_THEY_ARE..AS_THEY_ARE + 1)
        + points.bend_mm(plan, AS_THEY_ARE, AS_THEY_ARE, older_rows);
    let bend_mm = (1..SHARES.len()).map(|n| points.bend_mm(plan, n - 1, n, older_rows)).fold(0.0, f64::max);
    Tube {
        off_mm: beside_mm
            + bend_mm
            + older_s(timing, stop_s) * fastest.burr_mm_s
            + longer * (tolerance_mm + followed_mm)
            + points
                .error_mm(plan, track.stops().map(|a| a * timing.joint_error_s2(fastest.stop_s) * longer)),
        gap_mm: plan.gap_mm[from..=to].iter().copied().fold(f64::INFINITY, f64::min),
    }
}

/// What share of a stop a stop on the way back, at half the speed, goes.
const BACK: f64 = 0.25;

/// How much targets older than the backlog count, times how far back they are, s: of a mean with the weights s/τ² exp(−s/τ) of two lags
/// behind each other.
fn older_s(timing: StreamTiming, stop_s: f64) -> f64 {
    let lags = (timing.lag_s + timing.state_age_s) / timing.follow_s;
    (timing.follow_s * (2.0 + lags) + stop_s * (1.0 + lags)) * (-lags).exp()
}

/// The same times the square of how far they are from the backlog's middle, s².
fn older_square_s2(timing: StreamTiming) -> f64 {
    let lags = (timing.lag_s + timing.state_age_s) / timing.follow_s;
    // ∫ (s − L/2)² s/τ² exp(−s/τ) ds from L on
    let moment = 0.25 * lags.powi(3) + 1.25 * lags.powi(2) + 4.0 * lags + 6.0;
    timing.follow_s.powi(2) * moment * (-lags).exp()
}

/// Shares of a stop that moved targets are computed at, in order.
const SHARES: [f64; 4] = [-BACK, 0.0, 0.5, 1.0];
/// The place in `SHARES` of the targets as they are.
const AS_THEY_ARE: usize = 1;

/// Targets of some rows, as they are and moved ahead and back along their tangents.
struct Points {
    /// Steps to the next row.
    steps: Vec<Joints>,
    /// How far ahead, in rows.
    ahead: f64,
    /// For one of the shares after the other, all targets.
    q: Vec<Joints>,
    /// Their burrs, mm.
    burr_mm: Vec<Vector3<f64>>,
    /// From the first target to the last.
    direction: Joints,
}

impl Points {
    fn new(plan: &StreamPlan, rows: RangeInclusive<usize>, ahead: f64) -> Self {
        let track = &plan.track;
        let step = |n: usize| minus(&track.q()[(n + 1).min(track.rows() - 1)], &track.q()[n]);
        let steps: Vec<Joints> = rows.clone().map(step).collect();
        let targets = &track.q()[rows.clone()];
        let moved = |share: f64| {
            let moved = targets.iter().zip(&steps);
            moved.map(move |(q, step)| std::array::from_fn(|j| q[j] + share * ahead * step[j]))
        };
        let q: Vec<Joints> = SHARES.into_iter().flat_map(moved).collect();
        let at = |q: &Joints| plan.arm.tool_at(q).translation_mm;
        let as_they_are = track.burr_mm()[rows].iter().copied();
        let (back, ahead_q) = (&q[..steps.len()], &q[2 * steps.len()..]);
        let burr_mm = back.iter().map(at).chain(as_they_are).chain(ahead_q.iter().map(at)).collect();
        let direction = minus(&targets[targets.len() - 1], &targets[0]);
        Self { steps, ahead, q, burr_mm, direction }
    }

    /// Places of the targets moved by some of the shares.
    fn at(&self, shares: Range<usize>) -> Range<usize> {
        shares.start * self.steps.len()..shares.end * self.steps.len()
    }

    /// The targets moved by a share.
    fn moved(&self, share: usize) -> &[Joints] {
        &self.q[self.at(share..share + 1)]
    }

    /// The farthest of the points from a chord between two rows, and of the chord from the path there, mm.
    fn beside_mm(&self, track: &Track, (from, to): (usize, usize), shares: Range<usize>) -> f64 {
        let path_mm = &track.burr_mm()[from..=to];
        let points_mm = &self.burr_mm[self.at(shares)];
        let (start, chord) = (path_mm[0], path_mm[to - from] - path_mm[0]);
        let square = chord.norm_squared().max(1e-18);
        let along = |point: &Vector3<f64>| (point - start).dot(&chord) / square;
        let across = |point: &Vector3<f64>| point - start - chord * along(point).clamp(0.0, 1.0);
        let farther = |a: Vector3<f64>, b: Vector3<f64>| if b.norm() > a.norm() { b } else { a };
        let farthest = points_mm.iter().map(across).fold(Vector3::zeros(), farther);
        // an arc and what is on its chord are nearer to a line between them
        let aside = 0.5 * (farthest - chord * (farthest.dot(&chord) / square));
        let beside_mm = |aside: Vector3<f64>| {
            let most = |mm: f64, point: &Vector3<f64>| mm.max((across(point) - aside).norm());
            points_mm.iter().fold(0.0, most) + path_mm.iter().fold(0.0, most)
        };
        beside_mm(Vector3::zeros()).min(beside_mm(aside))
    }

    /// How far the burr of a mean is from the mean of the burrs, mm, while targets move from one share to another, with targets older than
    /// these at so many rows from their middle.
    fn bend_mm(&self, plan: &StreamPlan, from: usize, to: usize, older_rows: f64) -> f64 {
        let curvature = Curvature::around(&plan.arm, &self.q[self.at(from..to + 1)], self.direction);
        // burrs are computed at both shares: between them each is beside its chord
        let moved = (SHARES[to] - SHARES[from]) * self.ahead;
        curvature.mean_mm(self.moved(from), self.moved(to))
            + curvature.along_mm(&self.steps) * (moved.powi(2) / 8.0 + older_rows.powi(2) / 2.0)
    }

    /// What an error of at most so much in each joint moves the burr by, beside what it does where it is judged, mm.
    fn error_mm(&self, plan: &StreamPlan, error: Joints) -> f64 {
        let curvature = Curvature::around(&plan.arm, &self.q, self.direction);
        curvature.error_mm(&self.q, &error)
    }
}

fn minus(a: &Joints, b: &Joints) -> Joints {
    std::array::from_fn(|j| a[j] - b[j])
}
