//! How far the burr can travel after a failure, along its planned path and off it.
//!
//! An arm that follows is, in joint space, a weighted mean of the targets that it was sent lately, and its velocity is the mean of their
//! velocities with the same weights. So a stop that slows all joints together, straight in joint space, leads to places that are means of
//! targets *moved ahead along their own tangent* by the stop's duration over two. Means lie in the convex hull of those points, and the
//! distance from a chord of the path is convex: its largest value is at one of the points.
//!
//! ```text
//! off   = tolerance·max(1, q̇/(2aτ)) + farthest point from the chord + sagitta of the path + bend of the kinematics + older targets
//! along = arc[x − backlog, x + reaction] + tolerance + v·q̇/(2a)
//! ```
//!
//! `off` holds at every moment for the newest target, before a failure as after it: targets that are still sent have a row, and an
//! `off`, of their own. Each term is derived in docs/streaming.md.
//!
//! Not bounded: an arm that moves by itself. That is the controller's safety configuration's to limit.

use std::ops::RangeInclusive;

use nalgebra::Vector3;
use rayon::prelude::*;

use crate::link::Joints;
use crate::plan::StreamPlan;
use crate::settings::Timing;
use crate::track::Track;

/// A distance along and off the path.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Travel {
    /// Along the planned path, mm.
    pub along_mm: f64,
    /// Off it, mm.
    pub off_mm: f64,
}

impl Travel {
    /// The larger of two in each direction.
    #[must_use]
    pub fn max(self, other: Self) -> Self {
        Self { along_mm: self.along_mm.max(other.along_mm), off_mm: self.off_mm.max(other.off_mm) }
    }
}

/// What can fail, by what is left to stop the arm.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Failure {
    /// The PC, its program or the way to the controller is lost: the arm comes to rest at the last target.
    OrdersLost,
    /// The controller's state is lost, frozen or late: targets are sent until it is too old.
    StateLost,
    /// The link works, and the arm is stopped along its path: by the user, a tolerance, a limit.
    Stopped,
    /// The controller stops the arm: protective, emergency or pendant stop.
    StoppedItself,
}

impl Failure {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::OrdersLost, Self::StateLost, Self::Stopped, Self::StoppedItself];

    /// What the user reads.
    pub fn about(self) -> &'static str {
        match self {
            Self::OrdersLost => "PC, program or network lost",
            Self::StateLost => "state lost, frozen or late",
            Self::Stopped => "stopped by the user or a limit",
            Self::StoppedItself => "stopped by the controller",
        }
    }

    /// How much farther the targets go after it, s of the plan, at the share `rate` of the planned speed.
    fn reaction_s(self, plan: &StreamPlan, rate: f64) -> f64 {
        let Timing { transport_s, state_age_s, .. } = plan.settings().timing;
        let sent_s = transport_s + plan.period_s;
        match self {
            Self::OrdersLost => rate * sent_s,
            Self::StateLost => rate * (sent_s + state_age_s),
            // seen after its way here, then the ramp's r²/2
            Self::Stopped => {
                rate * (sent_s + transport_s + plan.period_s) + rate * rate / (2.0 * plan.ramp_per_s)
            }
            Self::StoppedItself => rate * sent_s,
        }
    }
}

/// Along the path after a failure in a row, passed at the share `rate` of the planned speed, mm.
pub fn along_mm(plan: &StreamPlan, row: usize, rate: f64, failure: Failure) -> f64 {
    way_mm(plan, row, rate, failure.reaction_s(plan, rate))
}

/// The same when a program on the controller follows splines that last for `depth_s`, and slows down when none is left.
pub fn along_buffered_mm(plan: &StreamPlan, row: usize, rate: f64, depth_s: f64) -> f64 {
    let sent_s = plan.settings().timing.transport_s + plan.period_s;
    way_mm(plan, row, rate, rate * (depth_s + sent_s) + rate * rate / (2.0 * plan.ramp_per_s))
}

fn way_mm(plan: &StreamPlan, row: usize, rate: f64, reaction_s: f64) -> f64 {
    let Timing { stop_rad_s2, .. } = plan.settings().timing;
    let backlog_s = plan.settings().timing.backlog_s();
    // the share may have been larger before, and may grow after
    let rate = (rate + plan.ramp_per_s * backlog_s).min(1.0);
    let track = &plan.track;
    let from = (row as f64 - rate * backlog_s / plan.period_s).max(0.0);
    let to = (row as f64 + reaction_s / plan.period_s).clamp(from, track.last_row());
    let rows = from as usize..=(to.ceil() as usize).min(track.rows() - 1);
    let tolerance_mm = rows.clone().map(|n| plan.tolerance_mm(n)).fold(0.0, f64::max);
    let fastest = track.fastest(rows, plan.period_s);
    let ahead_mm = rate * fastest.burr_mm_s * rate * fastest.joint_rad_s / (2.0 * stop_rad_s2);
    track.way_mm(from, to) + tolerance_mm + ahead_mm
}

/// How far off its path the burr can be, and the room to structures there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tube {
    /// Off the path, mm.
    pub off_mm: f64,
    /// The least clearance over that piece of path, mm.
    pub gap_mm: f64,
}

/// The tube while the newest target is in one of `BLOCK` rows from a row on, and no row before was passed at more than the share `rate`
/// of its planned speed (above 0), or at half of that going back.
pub fn tube(plan: &StreamPlan, row: usize, rate: f64) -> Tube {
    let (timing, track) = (plan.settings().timing, &plan.track);
    let end = track.rows() - 1;
    let rows_of = |seconds: f64| rate * seconds / plan.period_s;
    let first = (row as f64 - rows_of(timing.backlog_s())).max(0.0) as usize;
    let last = (row + BLOCK).min(end);
    let fastest = track.fastest(first..=last, plan.period_s);
    let joint_rad_s = rate * fastest.joint_rad_s;
    // half of the longest stop's duration: from the path's speed, and from that of a joint on its way back to what it was told
    let stop_s = joint_rad_s / (2.0 * timing.stop_rad_s2) + timing.follow_s;
    let points = Points { rows: first..=last, ahead: rows_of(stop_s) };
    let from = (first as f64 - BACK * points.ahead).max(0.0) as usize;
    let to = ((last as f64 + points.ahead).ceil() as usize).min(end);
    // what may be judged by the state that was used last
    let judged =
        first..=((row as f64 - rows_of(timing.state_age_s + timing.transport_s)) as usize).max(first);
    let tolerance_mm = judged.map(|n| plan.tolerance_mm(n)).fold(f64::INFINITY, f64::min);
    let beside_mm = points.beside_mm(track, from, to).min(points.beside_mm(track, from, last));
    let older_mm = older_s(timing, stop_s) * fastest.burr_mm_s;
    Tube {
        off_mm: tolerance_mm * (joint_rad_s / (2.0 * timing.stop_rad_s2 * timing.follow_s)).max(1.0)
            + beside_mm
            + points.bend_mm(plan)
            + older_mm,
        gap_mm: plan.gap_mm[from..=to].iter().copied().fold(f64::INFINITY, f64::min),
    }
}

/// What share of a stop a stop on the way back, at half the speed, goes.
const BACK: f64 = 0.25;

/// How much targets older than the backlog count, times how far back they are, s: of a mean with the weights s/τ² exp(−s/τ) of two lags
/// behind each other.
fn older_s(timing: Timing, stop_s: f64) -> f64 {
    let lags = (timing.lag_s + timing.state_age_s) / timing.follow_s;
    (timing.follow_s * (2.0 + lags) + stop_s * (1.0 + lags)) * (-lags).exp()
}

/// Targets of some rows, as they are and moved ahead and back along their tangents.
struct Points {
    rows: RangeInclusive<usize>,
    /// How far ahead, in rows.
    ahead: f64,
}

impl Points {
    /// A value of each row, and moved by its step.
    fn moved<T>(&self, values: &[T], at: impl Fn(&T, &T, f64) -> T + Copy) -> impl Iterator<Item = T> {
        let shares = [0.0, self.ahead, -BACK * self.ahead];
        self.rows.clone().flat_map(move |n| {
            let (here, next) = (&values[n], &values[(n + 1).min(values.len() - 1)]);
            shares.map(|share| at(here, next, share))
        })
    }

    /// The farthest of the points from the chord between two rows, and of the chord from the path there, mm.
    fn beside_mm(&self, track: &Track, from: usize, to: usize) -> f64 {
        let burr_mm = track.burr_mm();
        let (start, chord) = (burr_mm[from], burr_mm[to] - burr_mm[from]);
        let square = chord.norm_squared().max(1e-18);
        let beside_mm = |point: &Vector3<f64>| {
            let share = ((point - start).dot(&chord) / square).clamp(0.0, 1.0);
            (point - start - chord * share).norm()
        };
        let points = self.moved(burr_mm, |here, next, share| here + (next - here) * share);
        let farthest_mm = points.map(|p| beside_mm(&p)).fold(0.0, f64::max);
        farthest_mm + burr_mm[from..=to].iter().map(beside_mm).fold(0.0, f64::max)
    }

    /// How far the burr's place is from an affine function of the joints over the points, mm.
    ///
    /// Its second derivative by joints i and j is at most the burr's distance d from the axis of the later one, and the variance of a mean
    /// over a range R at most R²/4. The distances change by the later joints' turns.
    fn bend_mm(&self, plan: &StreamPlan) -> f64 {
        let q = plan.track.q();
        let (mut low, mut high) = ([f64::INFINITY; 6], [f64::NEG_INFINITY; 6]);
        for point in self.moved(q, |a, b, share| std::array::from_fn(|j| a[j] + share * (b[j] - a[j]))) {
            for (j, at) in point.iter().enumerate() {
                (low[j], high[j]) = (low[j].min(*at), high[j].max(*at));
            }
        }
        let range: Joints = std::array::from_fn(|j| high[j] - low[j]);
        let jacobian = plan.arm.tool_jacobian_at(&q[*self.rows.end()]);
        let (mut bend_mm, mut turned_mm, mut later_rad) = (0.0, 0.0, range.iter().sum::<f64>());
        for (j, column) in jacobian.column_iter().enumerate().rev() {
            let distance_mm = column.fixed_rows::<3>(0).norm() + turned_mm;
            turned_mm += distance_mm * range[j];
            // pairs of which this joint is the later one
            later_rad -= range[j];
            bend_mm += distance_mm * range[j] * (range[j] + 2.0 * later_rad);
        }
        // 1/8 for the mean, 1/2 for moving ahead along the tangent, which is at most the range
        bend_mm / 8.0 + bend_mm / 2.0 * self.ahead_share(q, &range).powi(2)
    }

    /// The largest share of its range that a joint is moved ahead by.
    fn ahead_share(&self, q: &[Joints], range: &Joints) -> f64 {
        let steps = self.rows.clone().map(|n| (&q[n], &q[(n + 1).min(q.len() - 1)]));
        let share = |(a, b): (&Joints, &Joints)| {
            let shares = (0..6).map(|j| self.ahead * (b[j] - a[j]).abs() / range[j].max(1e-12));
            shares.fold(0.0, f64::max)
        };
        steps.map(share).fold(0.0, f64::max).min(1.0)
    }
}

/// Shares of the planned speed that are tried, from fast to slow.
const RATES: [f64; 9] = [1.0, 0.85, 0.7, 0.55, 0.4, 0.3, 0.2, 0.1, 0.05];
/// Rows that share a tube.
pub(crate) const BLOCK: usize = 5;

/// The share of its planned speed at which every row may be passed, and how far off its path the burr can be there, mm: no farther
/// than the room there, while speed falls no faster than the ramp; 0 where no share is small enough.
pub(crate) fn rates(plan: &StreamPlan) -> (Vec<f64>, Vec<f64>) {
    let rows = plan.track.rows();
    let allowed = |block: usize| {
        let tubes = RATES.iter().map(|rate| (*rate, tube(plan, block * BLOCK, *rate)));
        let (mut rate, mut off_mm) = (0.0, 0.0);
        for (tried, tube) in tubes {
            off_mm = tube.off_mm;
            if tube.off_mm <= tube.gap_mm {
                rate = tried;
                break;
            }
        }
        (rate, off_mm)
    };
    let blocks: Vec<(f64, f64)> = (0..rows.div_ceil(BLOCK)).into_par_iter().map(allowed).collect();
    let mut rate = vec![1.0f64; rows];
    let backlog_rows = plan.settings().timing.backlog_s() / plan.period_s;
    for (block, (allowed, _)) in blocks.iter().enumerate().filter(|(_, (allowed, _))| *allowed < 1.0) {
        // no row that counts for a tube is passed faster than it
        let first = ((block * BLOCK) as f64 - allowed * backlog_rows).max(0.0) as usize;
        let last = ((block + 1) * BLOCK).min(rows);
        rate[first..last].iter_mut().for_each(|rate| *rate = rate.min(*allowed));
    }
    slow_ahead(&mut rate, plan.ramp_per_s * plan.period_s);
    (rate, (0..rows).map(|row| blocks[row / BLOCK].1).collect())
}

/// Lowers rates so that none falls faster than `ramp` a period: r² may fall by 2·ramp a row, since a row takes 1/r periods.
pub(crate) fn slow_ahead(rate: &mut [f64], ramp: f64) {
    for n in (1..rate.len()).rev() {
        if rate[n] > 0.0 {
            rate[n - 1] = rate[n - 1].min((rate[n].powi(2) + 2.0 * ramp).sqrt());
        }
    }
}
