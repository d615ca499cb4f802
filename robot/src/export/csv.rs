//! `trajectory.csv`: `time_s,q1..qn,qd1..qdn`, one row per controller period.
//!
//! Prismatic joints are in mm and mm/s to 1e-7, revolute joints in rad and rad/s to 1e-9. A time is exact if k/rate has at
//! most nine decimals, else it is rounded to 1e-9 s. Trailing zeros are left out.
//!
//! Invariant: the bytes depend on the law and the rate only. Rows are formatted in parallel in fixed portions and
//! written in order; memory does not grow with the number of rows.

use std::io::Write;

use crate::timelaw::RowGrid;
use bonemill_arm::RobotError;
use bonemill_arm::arm::JointKind;
use rayon::prelude::*;

use super::decimal::{push_fixed, push_units};

/// Number of rows that one task formats.
const PORTION: u64 = 2048;

/// Number of portions that are formatted while as many are written: enough for every core of a large machine, in about
/// 10 MB.
const BATCH: u64 = 16;

/// The most decimals of a time.
const TIME_DECIMALS: u32 = 9;

/// Writes a sampled law as CSV and returns the number of rows.
///
/// `kinds`: one per joint, which sets the resolution. The writer need not be buffered. It is not flushed.
///
/// # Errors
/// [`RobotError::Length`] where `kinds` does not match the law's joints; [`RobotError::Write`] when the writer fails.
pub fn write_trajectory_csv(
    out: &mut (impl Write + Send),
    rows: &RowGrid<'_>,
    kinds: &[JointKind],
) -> Result<u64, RobotError> {
    if kinds.len() != rows.dof() {
        return Err(RobotError::Length { what: "joint kind", got: kinds.len(), expected: rows.dof() });
    }
    let decimals: Vec<u32> = kinds.iter().map(|kind| decimals(*kind)).collect();
    out.write_all(header(rows.dof()).as_bytes())
        .map_err(|source| RobotError::Write { rows_written: 0, source })?;
    let clock = Clock::new(rows.rate_hz());
    let format = |batch: u64| -> Vec<(u64, Vec<u8>)> {
        let end = (batch + PORTION * BATCH).min(rows.count());
        let starts: Vec<u64> = (batch..end).step_by(PORTION as usize).collect();
        let one = |start: u64| (start, portion(rows, start..(start + PORTION).min(end), &decimals, &clock));
        starts.into_par_iter().map(one).collect()
    };
    let mut write = |texts: Vec<(u64, Vec<u8>)>| {
        texts.into_iter().try_for_each(|(rows_written, text)| {
            out.write_all(&text).map_err(|source| RobotError::Write { rows_written, source })
        })
    };
    // one batch is written while the next is formatted
    let mut formatted = Vec::new();
    for batch in (0..rows.count()).step_by((PORTION * BATCH) as usize) {
        let (written, next) = rayon::join(|| write(std::mem::take(&mut formatted)), || format(batch));
        written?;
        formatted = next;
    }
    write(formatted)?;
    Ok(rows.count())
}

/// Decimals for 1e-7 mm or 1e-9 rad: 0.1 nm, which is also 1e-9 rad at a lever of 100 mm.
pub(super) fn decimals(kind: JointKind) -> u32 {
    match kind {
        JointKind::Prismatic => 7,
        JointKind::Revolute => 9,
    }
}

fn header(dof: usize) -> String {
    let mut header = String::from("time_s");
    for name in ["q", "qd"] {
        for joint in 1..=dof {
            header.push_str(&format!(",{name}{joint}"));
        }
    }
    header.push('\n');
    header
}

fn portion(rows: &RowGrid<'_>, range: std::ops::Range<u64>, decimals: &[u32], clock: &Clock) -> Vec<u8> {
    let mut text = Vec::with_capacity((range.end - range.start) as usize * (16 + 24 * decimals.len()));
    rows.for_each(range, |row, q, qd| {
        clock.push(&mut text, row);
        for values in [q, qd] {
            for (value, decimals) in values.iter().zip(decimals) {
                text.push(b',');
                push_fixed(&mut text, *value, *decimals);
            }
        }
        text.push(b'\n');
    });
    text
}

/// k/rate as decimals.
struct Clock {
    rate_hz: f64,
    /// The period in units of 10^−decimals, where that is a whole number; `None` means that times are rounded.
    period: Option<u64>,
    decimals: u32,
}

impl Clock {
    fn new(rate_hz: f64) -> Self {
        for decimals in 0..=TIME_DECIMALS {
            let period = 10f64.powi(decimals as i32) / rate_hz;
            if period.fract() == 0.0 && period < 1e15 {
                return Self { rate_hz, period: Some(period as u64), decimals };
            }
        }
        Self { rate_hz, period: None, decimals: TIME_DECIMALS }
    }

    fn push(&self, out: &mut Vec<u8>, row: u64) {
        match self.period {
            // there are fewer than 1e9 rows, with periods below 1e9 units, so the product does not overflow
            Some(period) => push_units(out, (row * period) as i64, self.decimals),
            None => push_fixed(out, row as f64 / self.rate_hz, self.decimals),
        }
    }
}

#[cfg(test)]
mod tests;
