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

use rayon::prelude::*;

use crate::stream::plan::StreamPlan;
use crate::stream::settings::StreamTiming;
use crate::stream::tube::{BLOCK, wide_tube};
pub use crate::stream::tube::{Tube, tube};

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
        let StreamTiming { transport_s, state_age_s, .. } = plan.settings().timing;
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
    let backlog_s = plan.settings().timing.backlog_s();
    // the share may have been larger before, and may grow after
    let rate = (rate + plan.ramp_per_s * backlog_s).min(1.0);
    let track = &plan.track;
    let from = (row as f64 - rate * backlog_s / plan.period_s).max(0.0);
    let to = (row as f64 + reaction_s / plan.period_s).clamp(from, track.last_row());
    let rows = from as usize..=(to.ceil() as usize).min(track.rows() - 1);
    let tolerance_mm = rows.clone().map(|n| plan.tolerance_mm(n)).fold(0.0, f64::max);
    let fastest = track.fastest(rows, plan.period_s);
    let ahead_mm = rate * fastest.burr_mm_s * rate * fastest.stop_s / 2.0;
    track.way_mm(from, to) + tolerance_mm + ahead_mm
}

/// Shares of the planned speed that are tried, from fast to slow.
const RATES: [f64; 9] = [1.0, 0.85, 0.7, 0.55, 0.4, 0.3, 0.2, 0.1, 0.05];

/// Blocks that share a first, wider tube: where it is narrow enough no other is needed.
const WIDE: usize = 6;

/// What every row may be passed at.
pub(crate) struct Rates {
    /// Share of the planned speed of each row: the burr is no farther off its path than the room there, and speed falls no faster than the
    /// ramp; 0 where no share is small enough.
    pub rate: Vec<f64>,
    /// How far off its path the burr can be at most, of each row, mm. The greatest of all is its own tube's; others may be a wider tube's.
    pub off_mm: Vec<f64>,
    /// The share at which each block's tube is narrow enough.
    pub of_tubes: Vec<f64>,
}

/// See [`Rates`]. A tube over many blocks costs little more than one over a single one; where it is within its room, and narrower than the
/// widest place of the plan, the blocks' own are not computed.
pub(crate) fn rates(plan: &StreamPlan) -> Rates {
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
    let count = rows.div_ceil(BLOCK);
    let wide = |n: usize| wide_tube(plan, WIDE * n * BLOCK, WIDE * BLOCK, 1.0);
    let wide: Vec<Tube> = (0..count.div_ceil(WIDE)).into_par_iter().map(wide).collect();
    let of = |n: usize| WIDE * n..(WIDE * (n + 1)).min(count);
    let widest = (0..wide.len()).max_by(|a, b| wide[*a].off_mm.total_cmp(&wide[*b].off_mm)).unwrap_or(0);
    let least_mm = of(widest).map(|block| allowed(block).1).fold(0.0, f64::max);
    let own = |n: usize| {
        let Tube { off_mm, gap_mm } = wide[n];
        if off_mm <= gap_mm.min(least_mm) {
            vec![(1.0, off_mm); of(n).len()]
        } else {
            of(n).map(allowed).collect()
        }
    };
    let blocks: Vec<(f64, f64)> = (0..wide.len()).into_par_iter().flat_map_iter(own).collect();
    let mut rate = vec![1.0f64; rows];
    let backlog_rows = plan.settings().timing.backlog_s() / plan.period_s;
    for (block, (allowed, _)) in blocks.iter().enumerate().filter(|(_, (allowed, _))| *allowed < 1.0) {
        // no row that counts for a tube is passed faster than it
        let first = ((block * BLOCK) as f64 - allowed * backlog_rows).max(0.0) as usize;
        let last = ((block + 1) * BLOCK).min(rows);
        rate[first..last].iter_mut().for_each(|rate| *rate = rate.min(*allowed));
    }
    slow_ahead(&mut rate, plan.ramp_per_s * plan.period_s);
    let off_mm = (0..rows).map(|row| blocks[row / BLOCK].1).collect();
    Rates { rate, off_mm, of_tubes: blocks.into_iter().map(|(allowed, _)| allowed).collect() }
}

/// Lowers rates so that none falls faster than `ramp` a period: r² may fall by 2·ramp a row, since a row takes 1/r periods.
pub(crate) fn slow_ahead(rate: &mut [f64], ramp: f64) {
    for n in (1..rate.len()).rev() {
        if rate[n] > 0.0 {
            rate[n - 1] = rate[n - 1].min((rate[n].powi(2) + 2.0 * ramp).sqrt());
        }
    }
}
