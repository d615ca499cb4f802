//! The rows of a motion that are exported: every n-th of a sampled trajectory, and always its last.

use crate::arm::{Joint, JointKind};
use crate::error::RobotError;

/// Part of a sampled trajectory, with the joints that it is for.
#[derive(Debug, Clone, Copy)]
pub struct ExportRows<'a> {
    joints: &'a [Joint],
    time_s: &'a [f64],
    q: &'a [f64],
    qd: &'a [f64],
    stride: usize,
}

impl<'a> ExportRows<'a> {
    /// Every `stride`-th row of a trajectory: times, s, shape (rows); positions and velocities, mm or rad, shape
    /// (rows × joints). 0 counts as 1.
    ///
    /// # Errors
    /// [`RobotError::EmptyPath`] without a row, [`RobotError::Length`] where lists do not match.
    pub fn new(
        joints: &'a [Joint],
        time_s: &'a [f64],
        q: &'a [f64],
        qd: &'a [f64],
        stride: usize,
    ) -> Result<Self, RobotError> {
        let expected = time_s.len() * joints.len();
        if time_s.is_empty() {
            return Err(RobotError::EmptyPath);
        }
        for (what, got) in [("joint position", q.len()), ("joint velocity", qd.len())] {
            if got != expected {
                return Err(RobotError::Length { what, got, expected });
            }
        }
        Ok(Self { joints, time_s, q, qd, stride: stride.max(1) })
    }

    /// The joints.
    pub fn joints(&self) -> &'a [Joint] {
        self.joints
    }

    /// Number of rows that are exported.
    pub fn count(&self) -> usize {
        (self.time_s.len() - 1).div_ceil(self.stride) + 1
    }

    /// Time, positions and velocities of an exported row.
    pub(super) fn row(&self, n: usize) -> (f64, &'a [f64], &'a [f64]) {
        let at = (n * self.stride).min(self.time_s.len() - 1);
        let dof = self.joints.len();
        (self.time_s[at], &self.q[at * dof..(at + 1) * dof], &self.qd[at * dof..(at + 1) * dof])
    }

    /// Joint values in SI: m for prismatic joints, rad for revolute ones.
    pub(super) fn si(&self, values: &[f64]) -> Vec<f64> {
        let per = |joint: &Joint| if joint.kind == JointKind::Prismatic { 1e-3 } else { 1.0 };
        self.joints.iter().zip(values).map(|(joint, value)| value * per(joint)).collect()
    }
}
