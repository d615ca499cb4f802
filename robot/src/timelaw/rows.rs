//! A time law sampled at a controller's rate.
//!
//! Invariants: row k is at exactly k/rate (periods are not summed); the last row is the first one at or after the end, so
//! it is exactly the last waypoint, at rest.

use bonemill_arm::RobotError;

use super::law::TimeLaw;

/// Largest number of rows of a trajectory: some 2 GB of text, five hours at 500 Hz.
pub const MOST_ROWS: f64 = 1e7;

/// Rows of a law at k/rate, k = 0..count.
#[derive(Debug, Clone, Copy)]
pub struct RowGrid<'a> {
    law: &'a TimeLaw,
    rate_hz: f64,
    count: u64,
}

/// A time law sampled at a controller's rate, for a file, a simulator or a robot.
#[derive(Debug, Clone, PartialEq)]
pub struct JointTrajectory {
    /// Number of joints.
    pub dof: usize,
    /// Rows per second.
    pub rate_hz: f64,
    /// k/rate, s, shape (rows).
    pub time_s: Vec<f64>,
    /// Positions, mm or rad by joint, shape (rows × dof).
    pub q: Vec<f64>,
    /// Velocities, mm/s or rad/s, shape (rows × dof).
    pub qd: Vec<f64>,
}

impl TimeLaw {
    /// The rows of this law at `rate_hz`.
    ///
    /// # Errors
    /// [`RobotError::Value`] where the rate is not finite or not above 0, [`RobotError::TooLong`] where there would be more
    /// than `MOST_ROWS` rows.
    pub fn rows(&self, rate_hz: f64) -> Result<RowGrid<'_>, RobotError> {
        if !(rate_hz.is_finite() && rate_hz > 0.0) {
            let (what, unit, expected) = ("rate_hz", "Hz", "a finite rate above 0");
            return Err(RobotError::Value { what, index: 0, value: rate_hz, unit, expected });
        }
        let periods = (self.duration_s() * rate_hz).ceil();
        if periods.is_nan() || periods >= MOST_ROWS {
            return Err(RobotError::TooLong { duration_s: self.duration_s(), rate_hz, most_rows: MOST_ROWS });
        }
        Ok(RowGrid { law: self, rate_hz, count: periods as u64 + 1 })
    }
}

impl<'a> RowGrid<'a> {
    /// Number of rows, at least 1.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Rows per second.
    pub fn rate_hz(&self) -> f64 {
        self.rate_hz
    }

    /// Number of joints.
    pub fn dof(&self) -> usize {
        self.law.dof()
    }

    /// k/rate, s.
    pub fn time_s(&self, row: u64) -> f64 {
        row as f64 / self.rate_hz
    }

    /// Calls `take(row, q, qd)` for the rows `range` in order; each row depends on its number alone.
    pub fn for_each(&self, range: std::ops::Range<u64>, mut take: impl FnMut(u64, &[f64], &[f64])) {
        let (mut q, mut qd) = (vec![0.0; self.dof()], vec![0.0; self.dof()]);
        let mut cursor = self.law.cursor(self.time_s(range.start));
        for row in range.start..range.end.min(self.count) {
            // rounding of k/rate must not put the last row before the end
            let last = row + 1 == self.count;
            let time_s = if last { f64::INFINITY } else { self.time_s(row) };
            cursor.read(time_s, &mut q, &mut qd);
            take(row, &q, &qd);
        }
    }

    /// All rows at once.
    pub fn collect(&self) -> JointTrajectory {
        let values = self.count as usize * self.dof();
        let mut all = JointTrajectory {
            dof: self.dof(),
            rate_hz: self.rate_hz,
            time_s: (0..self.count).map(|row| self.time_s(row)).collect(),
            q: Vec::with_capacity(values),
            qd: Vec::with_capacity(values),
        };
        self.for_each(0..self.count, |_, q, qd| {
            all.q.extend_from_slice(q);
            all.qd.extend_from_slice(qd);
        });
        all
    }
}

impl JointTrajectory {
    /// Number of rows.
    pub fn len(&self) -> usize {
        self.time_s.len()
    }

    /// Whether there is no row; a sampled law has at least one.
    pub fn is_empty(&self) -> bool {
        self.time_s.is_empty()
    }

    /// The rows in order: time, positions, velocities.
    pub fn rows(&self) -> impl Iterator<Item = (f64, &[f64], &[f64])> {
        let states = self.q.chunks_exact(self.dof).zip(self.qd.chunks_exact(self.dof));
        self.time_s.iter().zip(states).map(|(time_s, (q, qd))| (*time_s, q, qd))
    }
}
