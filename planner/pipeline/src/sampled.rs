//! The force by directions in which bone is looked for: what lines, senses, axes and bounds are chosen by.
//!
//! What a move cuts is gathered once, whatever its axis; then the force costs a few operations per sample and axis.

use bonemill_case::Case;
use bonemill_cutting::burr::{BoneAround, EngagedForce, EngagedSamples, Feed, Material, OrientationKernel};
use bonemill_setup::tools;
use nalgebra::{Unit, Vector3};

use super::PlanError;

/// A case's burr in its material.
#[derive(Debug)]
pub struct SampledForce {
    kernel: OrientationKernel,
    material: Material,
    /// Speed at which forces are compared, mm/s.
    pub(super) nominal_mm_s: f64,
    spindle_rpm: f64,
    /// Whether edges push without a chip.
    pub(super) has_edges: bool,
    /// See [`bonemill_case::Accuracy`].
    pub(super) force_change: f64,
}

/// Whether edges push without a chip.
pub(super) fn has_edges(case: &Case) -> bool {
    case.material.k_edge_n_mm != [0.0; 3]
}

impl SampledForce {
    /// Directions, and how many make a sample, where lines are compared.
    pub const LINES: [usize; 2] = [1024, 4];
    /// The same where the senses of one pass are compared.
    pub const SENSES: [usize; 2] = [512, 4];

    /// The same along a move where edges push without a chip: such forces jump where contact begins.
    const WITH_EDGES: [usize; 2] = [8192, 2];

    /// Directions, and how many make a sample, where axes are chosen.
    pub fn of_case(case: &Case) -> [usize; 2] {
        [case.accuracy.force_directions as usize, 2]
    }

    /// For places within moves.
    ///
    /// # Errors
    /// As [`SampledForce::new`].
    pub fn within(case: &Case) -> Result<Self, PlanError> {
        Self::new(case, if has_edges(case) { Self::WITH_EDGES } else { Self::of_case(case) })
    }

    /// Of a case's burr and material.
    ///
    /// # Errors
    /// When the tool or the material is not usable.
    pub fn new(case: &Case, [samples, merged]: [usize; 2]) -> Result<Self, PlanError> {
        let tool = tools::tool(&case.burr)?;
        let (material, measure) = tools::material(&case.material)?;
        let kernel = OrientationKernel::new(&tool, &material, measure, samples, merged);
        let [nominal_mm_s, spindle_rpm] = [case.speed.nominal_mm_s, case.burr.spindle_rpm];
        let (has_edges, force_change) = (has_edges(case), case.accuracy.force_change);
        Ok(Self { kernel, material, nominal_mm_s, spindle_rpm, has_edges, force_change })
    }

    /// Where bone is looked for, mm from the burr's centre.
    pub fn radius_mm(&self) -> f64 {
        self.kernel.tool().radius_mm()
    }

    /// How much a density, g/cm³, counts beside that of the coefficients.
    pub fn weight(&self, density_g_cm3: f64) -> f64 {
        self.material.weight(density_g_cm3)
    }

    /// A move in a direction at the nominal speed.
    pub fn nominal(&self, direction: &Unit<Vector3<f64>>) -> Feed {
        Feed::new(direction, self.nominal_mm_s, self.spindle_rpm)
    }

    /// Gathers what a move cuts of the bone around.
    pub fn gather(&self, samples: &mut EngagedSamples, feed: &Feed, mut bone: impl BoneAround) {
        self.kernel.gather(samples, feed, &mut bone);
    }

    /// Force of what was gathered, for an axis.
    pub fn of(&self, samples: &EngagedSamples, axis: &Unit<Vector3<f64>>) -> EngagedForce {
        self.kernel.force_for_axis(samples, axis, self.spindle_rpm)
    }
}
