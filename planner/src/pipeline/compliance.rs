//! The arm's compliance along a path (D10), when its stiffness is known.

use bonemill_geometry::{Base, Point, Rigid, Work};
use bonemill_robot::Arm;
use bonemill_robot::arm::bone_attached;
use nalgebra::Matrix3;

use super::PlanError;
use crate::case::{Case, ForceTerm};

/// Deflection per force as a function of the tilt.
#[derive(Debug, Clone, Copy)]
pub struct Compliance<'a> {
    arm: &'a Arm,
    stiffness: Option<&'a [f64]>,
    base_from_work: &'a Rigid<Base, Work>,
}

impl<'a> Compliance<'a> {
    /// From the case's joint stiffness, if it has one.
    ///
    /// # Errors
    /// When the case looks at the deflection and has none.
    pub fn new(
        case: &'a Case,
        arm: &'a Arm,
        base_from_work: &'a Rigid<Base, Work>,
    ) -> Result<Self, PlanError> {
        let stiffness = case.robot.joint_stiffness.as_deref();
        if stiffness.is_none() && case.cost.force == ForceTerm::Deflection {
            return Err(PlanError::StiffnessMissing);
        }
        Ok(Self { arm, stiffness, base_from_work })
    }

    /// mm/N in work per angle. The linear joints only shift the arm: its compliance depends on the tilt alone.
    ///
    /// # Errors
    /// When the stiffness does not fit the arm.
    pub fn at_angles(&self, angles_rad: &[f64]) -> Result<Option<Vec<Matrix3<f64>>>, PlanError> {
        let Some(stiffness) = self.stiffness else { return Ok(None) };
        let turn = self.base_from_work.rotation.into_inner();
        let one = |angle: &f64| -> Result<_, PlanError> {
            let q = bone_attached::ik(Point::new(0.0, 0.0, 0.0), *angle);
            Ok(turn.transpose() * self.arm.compliance(&q, stiffness)? * turn)
        };
        angles_rad.iter().map(one).collect::<Result<Vec<_>, _>>().map(Some)
    }
}
