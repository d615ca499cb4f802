//! The arm's compliance at the burr: before the axes are chosen, and along the joint vectors that were chosen.
//!
//! Before the axes are chosen, the bone-attached arm's compliance depends on the tilt alone; another arm's is taken with the burr at
//! the target's centre, a few mm of the arm's reach away from where it will be.

use crate::PlanError;
use bonemill_case::{Case, ForceTerm};
use bonemill_geometry::{Point, Work};
use nalgebra::{Matrix3, Unit, Vector3};
use rayon::prelude::*;

use super::Placed;

/// The arm's compliance, when its stiffness is known.
pub struct Compliance<'a> {
    placed: Placed<'a>,
    stiffness: Option<&'a [f64]>,
}

impl<'a> Compliance<'a> {
    /// Of a case's arm.
    ///
    /// # Errors
    /// [`PlanError::StiffnessMissing`] if the case's cost uses the deflection and the case gives no stiffness.
    pub fn new(case: &'a Case, placed: Placed<'a>) -> Result<Self, PlanError> {
        let stiffness = case.robot.joint_stiffness.as_deref();
        if stiffness.is_none() && case.cost.force == ForceTerm::Deflection {
            return Err(PlanError::StiffnessMissing);
        }
        Ok(Self { placed, stiffness })
    }

    /// The compliance in a case's cost, mm/N in work, for each of neighbouring axes with the burr at `at`; `None` if the cost uses the
    /// force itself. An axis that the arm cannot take there gets the compliance of the nearest one that it can take.
    ///
    /// # Errors
    /// As [`Compliance::at_axes`].
    pub fn of_cost(
        &self,
        case: &Case,
        at: Point<Work>,
        axes: &[Unit<Vector3<f64>>],
        allows: impl Fn(&Vector3<f64>) -> bool,
    ) -> Result<Option<Vec<Matrix3<f64>>>, PlanError> {
        if case.cost.force == ForceTerm::Cutting {
            return Ok(None);
        }
        let taken: Vec<_> = axes.iter().copied().filter(|axis| allows(axis)).collect();
        let taken = if taken.is_empty() { axes.to_vec() } else { taken };
        let Some(found) = self.at_axes(at, &taken)? else { return Ok(None) };
        let nearest = |axis: &Unit<Vector3<f64>>| {
            let cosine = |n: &usize| taken[*n].dot(axis);
            (0..taken.len()).max_by(|a, b| cosine(a).total_cmp(&cosine(b))).unwrap_or(0)
        };
        Ok(Some(axes.iter().map(|axis| found[nearest(axis)]).collect()))
    }

    /// mm/N in work for each of neighbouring axes, the burr at `at`.
    ///
    /// # Errors
    /// [`PlanError::OutOfReach`] where the arm cannot stand there.
    pub fn at_axes(
        &self,
        at: Point<Work>,
        axes: &[Unit<Vector3<f64>>],
    ) -> Result<Option<Vec<Matrix3<f64>>>, PlanError> {
        if self.stiffness.is_none() {
            return Ok(None);
        }
        let motion = self.placed.motion(&vec![at; axes.len()], axes, &vec![0.0; axes.len()], None)?;
        self.along(&motion.resolved.q)
    }

    /// mm/N in work at each of a sequence of joint vectors.
    ///
    /// # Errors
    /// Where the stiffness does not fit the arm.
    pub fn along(&self, q: &[f64]) -> Result<Option<Vec<Matrix3<f64>>>, PlanError> {
        let Some(stiffness) = self.stiffness else { return Ok(None) };
        let turn = self.placed.base_from_work.rotation.into_inner();
        let arm = self.placed.arm;
        let one = |q: &[f64]| -> Result<_, PlanError> {
            Ok(turn.transpose() * arm.compliance(q, stiffness)? * turn)
        };
        q.par_chunks(arm.dof()).map(one).collect::<Result<Vec<_>, _>>().map(Some)
    }
}
