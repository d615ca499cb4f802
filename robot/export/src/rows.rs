//! The exported rows of a motion: every n-th row of a sampled trajectory, and always its last. Also computes how far the
//! burr leaves its path because of the rows that are left out.

use bonemill_geometry::{Base, Point};
use rayon::prelude::*;

use bonemill_arm::RobotError;
use bonemill_arm::arm::{Arm, Joint, JointKind};

/// How a controller interpolates between rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Between {
    /// Every joint at a constant speed.
    Straight,
    /// A cubic with the positions and velocities of both rows.
    Cubic,
}

/// Some rows of a sampled trajectory, with the joints.
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

    /// Clock of every exported row, s.
    pub fn times_s(&self) -> impl Iterator<Item = f64> {
        (0..self.count()).map(|n| self.row(n).0)
    }

    /// Time, positions and velocities of an exported row.
    pub(super) fn row(&self, n: usize) -> (f64, &'a [f64], &'a [f64]) {
        let at = (n * self.stride).min(self.time_s.len() - 1);
        let dof = self.joints.len();
        (self.time_s[at], &self.q[at * dof..(at + 1) * dof], &self.qd[at * dof..(at + 1) * dof])
    }

    /// Positions at an instant, by the cubic with the positions and velocities of the rows around it; before the first and
    /// after the last row, that row's positions.
    pub(super) fn at(&self, time_s: f64) -> Vec<f64> {
        let dof = self.joints.len();
        let after = self.time_s.partition_point(|t| *t <= time_s).clamp(1, self.time_s.len().max(2) - 1);
        let before = after - 1;
        let Some(to_s) = self.time_s.get(after) else { return self.q.to_vec() };
        let span_s = to_s - self.time_s[before];
        let u = ((time_s - self.time_s[before]) / span_s).clamp(0.0, 1.0);
        let of = |values: &[f64], j: usize| [before, after].map(|row| values[row * dof + j]);
        (0..dof).map(|j| cubic(of(self.q, j), of(self.qd, j).map(|qd| qd * span_s), u)).collect()
    }

    /// The largest distance of the burr's centre from its sampled path when the rows between are left out, mm, and the exported
    /// row before that place. Delay along the path does not count.
    ///
    /// # Errors
    /// [`RobotError::Length`] for an arm with another number of joints.
    pub fn deviation_mm(&self, arm: &Arm, between: Between) -> Result<(f64, usize), RobotError> {
        let dof = self.joints.len();
        let step = |n: usize| -> Result<(f64, usize), RobotError> {
            let ((t0, q0, qd0), (t1, q1, qd1)) = (self.row(n), self.row(n + 1));
            let span_s = t1 - t0;
            let first = n * self.stride;
            let last = (first + self.stride).min(self.time_s.len() - 1);
            let sampled = self.q[first * dof..(last + 1) * dof].chunks_exact(dof);
            let places = sampled.map(|q| burr(arm, q)).collect::<Result<Vec<_>, _>>()?;
            let mut q = vec![0.0; dof];
            let mut worst_mm = 0f64;
            for (around, time_s) in places.windows(3).zip(&self.time_s[first + 1..]) {
                let u = (time_s - t0) / span_s;
                for (j, q) in q.iter_mut().enumerate() {
                    *q = match between {
                        Between::Straight => q0[j] + u * (q1[j] - q0[j]),
                        Between::Cubic => cubic([q0[j], q1[j]], [qd0[j] * span_s, qd1[j] * span_s], u),
                    };
                }
                worst_mm = worst_mm.max(aside(around, &burr(arm, &q)?));
            }
            Ok((worst_mm, n))
        };
        // of equal values the first, so that the result does not depend on threads
        let worse =
            |a: (f64, usize), b: (f64, usize)| if b.0 > a.0 || (b.0 == a.0 && b.1 < a.1) { b } else { a };
        (0..self.count() - 1).into_par_iter().map(step).try_reduce(|| (0.0, 0), |a, b| Ok(worse(a, b)))
    }

    /// Joint values in SI: m for prismatic joints, rad for revolute ones.
    pub(super) fn si(&self, values: &[f64]) -> Vec<f64> {
        let per = |joint: &Joint| if joint.kind == JointKind::Prismatic { 1e-3 } else { 1.0 };
        self.joints.iter().zip(values).map(|(joint, value)| value * per(joint)).collect()
    }
}

fn burr(arm: &Arm, q: &[f64]) -> Result<Point<Base>, RobotError> {
    Ok(Point::from_coords(arm.burr(q)?.translation_mm))
}

/// Distance of a point from the line through the middle one of three places along the chord of the outer two, mm.
fn aside(around: &[Point<Base>], there: &Point<Base>) -> f64 {
    let (way, off) = (around[2] - around[0], *there - around[1]);
    let share = if way.norm_squared() > 0.0 { off.dot(&way) / way.norm_squared() } else { 0.0 };
    (off - way * share).norm()
}

/// The cubic between two values with the given slopes per whole step.
fn cubic([from, to]: [f64; 2], [m0, m1]: [f64; 2], u: f64) -> f64 {
    let v = 1.0 - u;
    from * v * v * (1.0 + 2.0 * u) + to * u * u * (3.0 - 2.0 * u) + m0 * u * v * v - m1 * u * u * v
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A circle of 5 mm radius at 1 rad/s by the bone-attached arm's linear joints, 500 rows a second.
    fn circle() -> (Vec<f64>, Vec<f64>, Vec<f64>) {
        let time_s: Vec<f64> = (0..=2000).map(|k| f64::from(k) * 0.002).collect();
        let q = time_s.iter().flat_map(|t| [5.0 * t.cos(), 5.0 * t.sin(), 0.0, 0.0]).collect();
        let qd = time_s.iter().flat_map(|t| [-5.0 * t.sin(), 5.0 * t.cos(), 0.0, 0.0]).collect();
        (time_s, q, qd)
    }

    #[test]
    fn a_chord_is_as_far_from_its_arc_as_geometry_says() {
        let arm = Arm::bone_attached().unwrap();
        let (time_s, q, qd) = circle();
        let off = |stride, between| {
            let rows = ExportRows::new(arm.joints(), &time_s, &q, &qd, stride).unwrap();
            rows.deviation_mm(&arm, between).unwrap().0
        };
        for stride in [10, 50, 100] {
            let span = 0.002 * stride as f64;
            let sagitta = 5.0 * (1.0 - (0.5 * span).cos());
            let straight = off(stride, Between::Straight);
            assert!((straight / sagitta - 1.0).abs() < 1e-3, "{straight} for {sagitta}");
            // Hermite: q⁗ span⁴/384
            let most = 5.0 * span.powi(4) / 384.0;
            let cubic = off(stride, Between::Cubic);
            assert!(cubic < 1.1 * most && cubic > 0.5 * most, "{cubic} for {most}");
        }
        assert_eq!(off(1, Between::Straight), 0.0);
    }
}
