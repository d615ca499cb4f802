//! Where on its track the next target lies: the plan's clock, which runs at a share of the planned speed and is timed anew after a gap.
//!
//! One target is sent a period, whatever the real clock does: what was missed is never sent at once. The share changes by the
//! ramp at most; a gap counts as if the arm had slowed down by the ramp meanwhile.

use std::collections::VecDeque;

/// A gap between targets that is no jitter: so many periods.
const GAP_PERIODS: f64 = 2.5;

/// The place of the newest target, and of those that the arm may still have before it.
#[derive(Debug, Clone)]
pub struct Follower {
    period_s: f64,
    ramp_per_s: f64,
    backlog_s: f64,
    last_row: f64,
    row: f64,
    rate: f64,
    /// Time on the arm's scaled clock, s: it runs at the controller's share of full speed.
    arm_s: f64,
    sent_s: Option<f64>,
    /// Time on the arm's clock and row of the targets sent within the backlog, and of the one before.
    sent: VecDeque<(f64, f64)>,
}

impl Follower {
    /// At rest at a row.
    pub fn new(period_s: f64, ramp_per_s: f64, backlog_s: f64, last_row: f64, row: f64) -> Self {
        Self {
            period_s,
            ramp_per_s,
            backlog_s,
            last_row,
            row,
            rate: 0.0,
            arm_s: 0.0,
            sent_s: None,
            sent: VecDeque::with_capacity(64),
        }
    }

    /// Goes on at a share of the planned speed.
    pub fn set_rate(&mut self, rate: f64) {
        self.rate = rate;
    }

    /// The newest target's place, in rows.
    pub fn row(&self) -> f64 {
        self.row
    }

    /// The share of the planned speed.
    pub fn rate(&self) -> f64 {
        self.rate
    }

    /// How many rows it takes to come to rest.
    pub fn rows_to_rest(&self) -> f64 {
        self.rate * self.rate / (2.0 * self.ramp_per_s * self.period_s)
    }

    /// The next target's place, when `wanted` is the share to go for, below 0 for back, and the controller runs at `fraction` of full
    /// speed; the gap before it, s, if there was one.
    pub fn advance(&mut self, now_s: f64, wanted: f64, fraction: f64) -> Option<f64> {
        let since_s = self.sent_s.map_or(self.period_s, |sent_s| (now_s - sent_s).max(0.0));
        self.sent_s = Some(now_s);
        self.arm_s += since_s * fraction;
        let gap_s = (since_s > GAP_PERIODS * self.period_s).then_some(since_s);
        if let Some(gap_s) = gap_s {
            let lost = self.ramp_per_s * (gap_s - self.period_s);
            self.rate = self.rate.signum() * (self.rate.abs() - lost).max(0.0);
        }
        let ramp = self.ramp_per_s * self.period_s;
        self.rate += (wanted - self.rate).clamp(-ramp, ramp);
        self.row = (self.row + self.rate).clamp(0.0, self.last_row);
        self.remember();
        gap_s
    }

    fn remember(&mut self) {
        let rests = self.sent.iter().rev().take(2).filter(|(_, row)| *row == self.row).count() == 2;
        if rests {
            // a target that is sent again and again needs its first and last time only
            self.sent.pop_back();
        }
        self.sent.push_back((self.arm_s, self.row));
        let oldest_s = self.arm_s - self.backlog_s;
        // the target before the backlog's first is the one that the arm may still be at
        while self.sent.get(1).is_some_and(|(arm_s, _)| *arm_s < oldest_s) {
            self.sent.pop_front();
        }
    }

    /// First and last place that the arm may be at, in rows.
    pub fn backlog(&self) -> (f64, f64) {
        let rows = self.sent.iter().map(|(_, row)| *row);
        rows.fold((self.row, self.row), |(low, high), row| (low.min(row), high.max(row)))
    }
}
