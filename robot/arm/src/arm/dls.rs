//! Damped least squares: finds a joint vector for a pose from a starting joint vector, with the arm's Jacobian.
//!
//! ```text
//! Δq = W Jᵀ (J W Jᵀ + μ s I)⁻¹ e
//! ```
//!
//! e: the error, 3 rows in mm and 3 in rad times `LEVER_MM`. W: the squared speed limits of the joints, so that a joint
//! moves in proportion to its squared speed limit, whether in mm or rad. s: the mean of J W Jᵀ's diagonal. μ falls after
//! every step that lowers the error and rises after every other (Levenberg–Marquardt), so in a singular pose the result
//! is a remaining error, never a jump or NaN. Joints stay in their range.
//!
//! **Source:** Wampler 1986, "Manipulator inverse kinematic solutions based on vector formulations and damped
//! least-squares methods"; damping by Marquardt 1963.

use bonemill_geometry::{Base, Rigid, Tool};
use nalgebra::{Matrix3, Matrix6, Matrix6xX, Vector3, Vector6};

use super::inverse::{AxisPose, angle_between};
use super::{Arm, JointKind};

/// The length that one radian of the tool's orientation counts as, mm.
const LEVER_MM: f64 = 100.0;

/// Largest number of steps, accepted or not.
const STEPS: usize = 100;

/// An error below this is rounding, mm.
const DONE_MM: f64 = 1e-12;

/// The goal of the tool, in the work frame ([`super::Mount`]).
#[derive(Debug, Clone, Copy)]
pub enum ToolGoal {
    /// A full pose.
    Pose(Rigid<Base, Tool>),
    /// A point and an axis; the roll about the axis is free.
    Axis(AxisPose),
}

/// Result of a search.
#[derive(Debug, Clone, PartialEq)]
pub struct NumericSolution {
    /// Joint vector, mm or rad.
    pub q: Vec<f64>,
    /// Remaining distance, mm.
    pub short_mm: f64,
    /// Remaining angle, rad.
    pub short_rad: f64,
}

impl NumericSolution {
    /// Whether both remaining errors are at most `exact`, mm and rad.
    pub fn is_within(&self, exact: f64) -> bool {
        self.short_mm <= exact && self.short_rad <= exact
    }
}

/// Searches from `start`, which must be a joint vector of the arm.
pub fn solve(arm: &Arm, goal: &ToolGoal, start: &[f64]) -> NumericSolution {
    solve_holding(arm, goal, start, None)
}

/// The same with one joint held where it is.
pub fn solve_holding(arm: &Arm, goal: &ToolGoal, start: &[f64], held: Option<usize>) -> NumericSolution {
    let mut weights: Vec<f64> = arm.joints().iter().map(|joint| joint.velocity_limit.powi(2)).collect();
    if let Some(weight) = held.and_then(|held| weights.get_mut(held)) {
        *weight = 0.0;
    }
    let mut q = start.to_vec();
    let mut error = error(arm, goal, &q);
    let mut damping = 1e-3;
    let mut steps = 0;
    while steps < STEPS && error.norm() > DONE_MM {
        let jacobian = task_jacobian(arm, goal, &q);
        let mut weighted = jacobian.clone();
        for (mut column, weight) in weighted.column_iter_mut().zip(&weights) {
            column *= *weight;
        }
        let square: Matrix6<f64> = &weighted * jacobian.transpose();
        let scale = square.trace() / 6.0;
        let mut stepped = false;
        while steps < STEPS && damping < 1e9 {
            steps += 1;
            let damped = square + Matrix6::identity() * (damping * scale).max(f64::MIN_POSITIVE);
            let Some(solved) = damped.cholesky().map(|c| c.solve(&error)) else {
                damping *= 10.0;
                continue;
            };
            let mut next = q.clone();
            for (j, next) in next.iter_mut().enumerate() {
                *next += weighted.column(j).dot(&solved);
            }
            keep_in_range(arm, &mut next);
            let next_error = self::error(arm, goal, &next);
            if next_error.norm() < error.norm() {
                (q, error, stepped) = (next, next_error, true);
                damping = (damping * 0.1).max(1e-14);
                break;
            }
            damping *= 10.0;
        }
        if !stepped {
            break;
        }
    }
    NumericSolution {
        short_mm: error.fixed_rows::<3>(0).norm(),
        short_rad: error.fixed_rows::<3>(3).norm() / LEVER_MM,
        q,
    }
}

/// Clamps linear joints, and revolute joints with a range of less than a turn, to their ranges. Other joints may turn
/// further.
fn keep_in_range(arm: &Arm, q: &mut [f64]) {
    for (joint, q) in arm.joints().iter().zip(q) {
        let range = joint.upper - joint.lower;
        if joint.kind == JointKind::Prismatic || range < std::f64::consts::TAU {
            *q = q.clamp(joint.lower, joint.upper);
        }
    }
}

/// The remaining error: mm, and rad × lever.
fn error(arm: &Arm, goal: &ToolGoal, q: &[f64]) -> Vector6<f64> {
    let tool = arm.tool_at(q);
    let now = tool.rotation.matrix();
    let (position, turn) = match goal {
        ToolGoal::Pose(pose) => (pose.translation_mm, between(now, pose.rotation.matrix())),
        ToolGoal::Axis(pose) => {
            let (angle, across) = angle_between(&now.column(2).into_owned(), &pose.axis);
            (pose.position.coords, across.map_or(Vector3::zeros(), |across| across.into_inner() * angle))
        }
    };
    let mut error = Vector6::zeros();
    error.fixed_rows_mut::<3>(0).copy_from(&(position - tool.translation_mm));
    error.fixed_rows_mut::<3>(3).copy_from(&(turn * LEVER_MM));
    error
}

/// The rotation vector from one orientation to another. It is accurate for small angles, where an arc cosine of the trace
/// is not.
fn between(from: &Matrix3<f64>, to: &Matrix3<f64>) -> Vector3<f64> {
    let sine: Vector3<f64> = (0..3).map(|k| from.column(k).cross(&to.column(k))).sum::<Vector3<f64>>() * 0.5;
    let cosine = 0.5 * ((from.transpose() * to).trace() - 1.0);
    let size = sine.norm();
    let angle = size.atan2(cosine);
    if size > 1e-9 {
        return sine * (angle / size);
    }
    // no rotation, or half a turn: there the sine is 0 and does not give the axis
    if cosine > 0.0 { sine } else { half_turn(&(to * from.transpose())) }
}

/// π times the axis of a half turn R = 2 a aᵀ − 1.
fn half_turn(r: &Matrix3<f64>) -> Vector3<f64> {
    let square = (r + Matrix3::identity()) * 0.5;
    let column = (0..3).map(|k| square.column(k).into_owned()).max_by(|a, b| a.norm().total_cmp(&b.norm()));
    column.and_then(|a| a.try_normalize(0.0)).unwrap_or_else(Vector3::x) * std::f64::consts::PI
}

/// The error's derivative, with angles times the lever; for an axis goal without the rotation about the axis.
fn task_jacobian(arm: &Arm, goal: &ToolGoal, q: &[f64]) -> Matrix6xX<f64> {
    let mut jacobian = arm.tool_jacobian_at(q);
    let roll = match goal {
        ToolGoal::Pose(_) => None,
        ToolGoal::Axis(_) => Some(arm.tool_at(q).rotation * Vector3::z()),
    };
    for mut column in jacobian.column_iter_mut() {
        let mut turn = column.fixed_rows::<3>(3).into_owned();
        if let Some(axis) = roll {
            turn -= axis * axis.dot(&turn);
        }
        column.fixed_rows_mut::<3>(3).copy_from(&(turn * LEVER_MM));
    }
    jacobian
}
