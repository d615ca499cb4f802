//! How far the burr can travel after a failure, along its planned path and off it.
//!
//! An arm that follows without overshoot is, in joint space, a weighted mean of the targets that it was sent; so it stays in their
//! convex hull, and a stop that does not pass the target stays in it, too ([`Timing::joint_error_rad`]). Targets lie on the path.
//! So after a failure at row x, passed at the share r of the planned speed, the burr is between the place where it can be at the
//! earliest, x − r·backlog, and the last target that is sent, x + r·reaction:
//!
//! ```text
//! along = arc[x − r·backlog, x + r·reaction] + tolerance + overshoot
//! off   = tolerance + 2·sagitta + lever·(Σ Δq)²/2 + overshoot
//! ```
//!
//! tolerance: how far off its path the burr was let. sagitta: the farthest of that piece of path from its chord; a point of the
//! hull is within one sagitta of the chord, and the path within one more. lever·(Σ Δq)²/2: how far the burr's place is from affine
//! in the joints. overshoot: by how much a stop from the path's own joint speed passes the target.
//!
//! Not bounded: an arm that moves by itself. That is the controller's safety configuration's to limit.

use rayon::prelude::*;

use crate::plan::StreamPlan;
use crate::settings::Timing;

/// A distance along and off the path.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Travel {
    /// Along the planned path, mm.
    pub along_mm: f64,
    /// Off it, mm.
    pub off_mm: f64,
}

impl Travel {
    /// The larger of both.
    pub fn most_mm(&self) -> f64 {
        self.along_mm.max(self.off_mm)
    }

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

/// How motion gets to the controller.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Mode {
    /// servoJ: a target a period.
    Servo,
    /// A program on the controller follows splines of so many seconds, and slows down when none is left.
    Buffered {
        /// Splines that the controller holds, s.
        depth_s: f64,
    },
}

/// Travel after a failure at a place, passed at the share `rate` of the planned speed.
pub fn travel(plan: &StreamPlan, row: f64, rate: f64, failure: Failure) -> Travel {
    piece(plan, row, rate, failure.reaction_s(plan, rate))
}

/// The same when a program on the controller follows a buffer; what fails is then the supply.
pub fn travel_in_mode(plan: &StreamPlan, row: f64, rate: f64, mode: Mode) -> Travel {
    match mode {
        Mode::Servo => worst(plan, row, rate),
        Mode::Buffered { depth_s } => {
            let sent_s = plan.settings().timing.transport_s + plan.period_s;
            piece(plan, row, rate, rate * (depth_s + sent_s) + rate * rate / (2.0 * plan.ramp_per_s))
        }
    }
}

/// The worst over all failures.
pub fn worst(plan: &StreamPlan, row: f64, rate: f64) -> Travel {
    // everything grows with the reaction
    let reaction_s = Failure::ALL.map(|f| f.reaction_s(plan, rate)).into_iter().fold(0.0, f64::max);
    piece(plan, row, rate, reaction_s)
}

/// The least clearance between the first place where the burr can be and the last target, mm.
pub fn least_gap_mm(plan: &StreamPlan, row: f64, rate: f64) -> f64 {
    let (from, to) = ends(plan, row, rate, Failure::StateLost.reaction_s(plan, rate));
    plan.gap_mm[from as usize..=(to.ceil() as usize).min(plan.gap_mm.len() - 1)]
        .iter()
        .copied()
        .fold(f64::INFINITY, f64::min)
}

/// First and last place of the piece of path that counts.
fn ends(plan: &StreamPlan, row: f64, rate: f64, reaction_s: f64) -> (f64, f64) {
    let backlog_s = plan.settings().timing.backlog_s();
    let last = plan.track.last_row();
    let from = (row - rate * backlog_s / plan.period_s).clamp(0.0, last);
    (from, (row + reaction_s / plan.period_s).clamp(from, last))
}

fn piece(plan: &StreamPlan, row: f64, rate: f64, reaction_s: f64) -> Travel {
    let timing = plan.settings().timing;
    let (from, to) = ends(plan, row, rate, reaction_s);
    let track = &plan.track;
    let rows = from as usize..=(to.ceil() as usize).min(track.rows() - 1);
    let (start, end) = (track.burr_at(from), track.burr_at(to));
    let chord = (end - start).try_normalize(1e-9).unwrap_or_default();
    let (mut sagitta_mm, mut tolerance_mm) = (0.0f64, 0.0f64);
    let (mut low, mut high) = ([f64::INFINITY; 6], [f64::NEG_INFINITY; 6]);
    let mut speed_rad_s = 0.0f64;
    for n in rows {
        let off = track.burr_mm()[n] - start;
        sagitta_mm = sagitta_mm.max((off - chord * chord.dot(&off)).norm());
        tolerance_mm = tolerance_mm.max(plan.tolerance_mm(n));
        let q = &track.q()[n];
        let next = &track.q()[(n + 1).min(track.rows() - 1)];
        for j in 0..6 {
            (low[j], high[j]) = (low[j].min(q[j]), high[j].max(q[j]));
            speed_rad_s = speed_rad_s.max((next[j] - q[j]).abs() / plan.period_s);
        }
    }
    let span_rad: f64 = (0..6).map(|j| high[j] - low[j]).sum();
    let way_mm = track.way_mm(from, to);
    let speed_mm_s = rate * way_mm / ((to - from).max(1.0) * plan.period_s);
    let slowing_s = rate * speed_rad_s / timing.stop_rad_s2;
    let overshoot_mm = speed_mm_s * (slowing_s / 2.0 - timing.follow_s).max(0.0);
    Travel {
        along_mm: way_mm + tolerance_mm + overshoot_mm,
        off_mm: tolerance_mm + 2.0 * sagitta_mm + 0.5 * plan.lever_mm * span_rad.powi(2) + overshoot_mm,
    }
}

/// Shares of the planned speed that are tried, from fast to slow.
const RATES: [f64; 9] = [1.0, 0.85, 0.7, 0.55, 0.4, 0.3, 0.2, 0.1, 0.05];
/// Rows that are judged at once.
const BLOCK: usize = 5;

/// The share of its planned speed at which every row may be passed: the bound is no larger than the clearance that is left, and
/// the speed falls no faster than the ramp; 0 where no share is small enough.
pub(crate) fn rates(plan: &StreamPlan) -> Vec<f64> {
    let rows = plan.track.rows();
    let fits = |row: usize, rate: f64| {
        worst(plan, row as f64, rate).most_mm() <= least_gap_mm(plan, row as f64, rate)
    };
    let allowed = |block: usize| {
        let row = block * BLOCK;
        // no structure near: nothing to compare with
        RATES.into_iter().find(|rate| fits(row, *rate)).unwrap_or(0.0)
    };
    let blocks: Vec<f64> = (0..rows.div_ceil(BLOCK)).into_par_iter().map(allowed).collect();
    let mut rate: Vec<f64> = (0..rows)
        .map(|row| {
            let next = blocks.get(row / BLOCK + 1).copied().unwrap_or(1.0);
            blocks[row / BLOCK].min(next)
        })
        .collect();
    slow_ahead(&mut rate, plan.ramp_per_s * plan.period_s);
    rate
}

/// Lowers rates so that none falls faster than `ramp` a period: r² may fall by 2·ramp a row, since a row takes 1/r periods.
pub(crate) fn slow_ahead(rate: &mut [f64], ramp: f64) {
    for n in (1..rate.len()).rev() {
        if rate[n] > 0.0 {
            rate[n - 1] = rate[n - 1].min((rate[n].powi(2) + 2.0 * ramp).sqrt());
        }
    }
}
