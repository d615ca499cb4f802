//! What pushes the burr at a waypoint, and its part toward each structure.

use bonemill_cutting::burr::EngagedForce;
use nalgebra::{Matrix3, Vector3};

/// Force and deflection of one move, work.
#[derive(Debug, Clone, Copy)]
pub(super) struct Push {
    /// Force on the burr at the move's speed, N; 0 in air.
    pub force_n: Vector3<f64>,
    /// Deflection of the arm under it, mm; none without a stiffness.
    deflection_mm: Option<Vector3<f64>>,
}

/// The parts of a [`Push`] toward one structure, not negative.
#[derive(Debug, Clone, Copy)]
pub(super) struct PushToward {
    pub force_n: f64,
    pub deflection_um: Option<f64>,
}

impl Push {
    /// `compliance` in work, mm/N.
    pub fn new(force: Option<&EngagedForce>, speed_mm_s: f64, compliance: Option<&Matrix3<f64>>) -> Self {
        let force_n = force.map(|f| f.force_n(speed_mm_s)).unwrap_or_default();
        Self { force_n, deflection_mm: compliance.map(|c| c * force_n) }
    }

    /// max(0, F·u) for a unit direction, and the same of the deflection.
    pub fn toward(&self, direction: &Vector3<f64>) -> PushToward {
        let along = |push: &Vector3<f64>| push.dot(direction).max(0.0);
        PushToward {
            force_n: along(&self.force_n),
            deflection_um: self.deflection_mm.map(|d| 1e3 * along(&d)),
        }
    }
}
