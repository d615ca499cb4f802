//! Computes forces from the engagement: one small interface with two models.
//!
//! [`FlutedBurr`] is Dillon's spherical burr with the edge term, summed over the blades. [`Lumped`] is Yang and Chen's model,
//! in which the force depends only on the removal rate, as printed or with the energy of the burr model's db form.

use std::f64::consts::PI;

use bonemill_cutting::burr::checked;
use bonemill_cutting::burr::sums::DirectionSums;
use bonemill_cutting::burr::{Material, ModelError, Tool};
use nalgebra::Vector3;

use super::engagement::Engagement;

/// Force and torque of the bone on the burr; vectors in work.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CutForce {
    /// Mean force on the burr over a turn, N.
    pub force_n: Vector3<f64>,
    /// Mean moment about the burr's centre, N mm.
    pub moment_nmm: Vector3<f64>,
    /// Resisting torque about the shaft, N mm.
    pub torque_nmm: f64,
    /// Torque times angular velocity, mW.
    pub spindle_power_mw: f64,
    /// Largest force over a turn, N.
    pub peak_n: f64,
}

/// A force model.
pub trait ForceModel: Sync {
    /// The force for an engagement; zero in air and at rest.
    fn force(&self, met: &Engagement) -> CutForce;
}

impl<M: ForceModel + ?Sized> ForceModel for Box<M> {
    fn force(&self, met: &Engagement) -> CutForce {
        (**self).force(met)
    }
}

/// The spherical fluted burr: Dillon's equations (3) and (4) with the edge term of docs/force-model.md 3.
#[derive(Debug, Clone, PartialEq)]
pub struct FlutedBurr {
    /// The burr.
    pub tool: Tool,
    /// The bone.
    pub material: Material,
}

impl ForceModel for FlutedBurr {
    fn force(&self, met: &Engagement) -> CutForce {
        if met.is_air() || met.speed_mm_s <= 0.0 {
            return CutForce::default();
        }
        let tooth_mm = self.tool.feed_per_tooth_mm(met.speed_mm_s, met.spindle_rpm);
        let k = self.material.k_n_mm2().map(|k| k * tooth_mm);
        let k_edge = self.material.k_edge_n_mm();
        let (mut force, mut moment, mut peak_n) = (Vector3::zeros(), Vector3::zeros(), 0f64);
        for (n, cut) in met.cut.iter().enumerate() {
            let edge = met.edge.get(n).copied().unwrap_or_default();
            let instant = cut.force(k) + edge.force(k_edge);
            peak_n = peak_n.max(instant.norm());
            force += instant;
            moment += cut.moment(k, &self.tool) + edge.moment(k_edge, &self.tool);
        }
        let per_turn = 1.0 / met.cut.len() as f64;
        let moment = moment * per_turn;
        // + 0.0 turns −0 into 0 in air
        let torque_nmm = -self.tool.spin() * moment.z + 0.0;
        CutForce {
            force_n: met.tool_axes * force * per_turn,
            moment_nmm: met.tool_axes * moment,
            torque_nmm,
            spindle_power_mw: torque_nmm * 2.0 * PI * met.spindle_rpm / 60.0,
            peak_n,
        }
    }
}

/// Force on the burr per unit of each coefficient, work: K_t, K_r, K_a (mm²), then K_te, K_re, K_ae (mm).
///
/// The model is linear in its six coefficients; this is what a calibration fits.
pub fn force_per_coefficient(met: &Engagement, tool: &Tool) -> [Vector3<f64>; 6] {
    let tooth_mm = tool.feed_per_tooth_mm(met.speed_mm_s, met.spindle_rpm);
    let per_turn = 1.0 / met.cut.len().max(1) as f64;
    let sum = |all: &[DirectionSums], k: [f64; 3], scale: f64| {
        met.tool_axes * all.iter().map(|d| d.force(k)).sum::<Vector3<f64>>() * (scale * per_turn)
    };
    let [t, r, a] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let cut = |k| sum(&met.cut, k, tooth_mm);
    let edge = |k| sum(&met.edge, k, 1.0);
    [cut(t), cut(r), cut(a), edge(t), edge(r), edge(a)]
}

/// How the lumped force is computed from the removal rate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LumpedForm {
    /// F_t = K_t MRR/f with a fixed K_t for all feeds and spindle speeds: equation (3) as printed.
    AsPrinted {
        /// K_t, N per mm² of engaged cross-section.
        k_t_n_mm2: f64,
        /// F_r/F_t.
        k_r: f64,
    },
    /// F_t = K MRR/V_c with the specific cutting energy K and V_c the speed of the teeth at the equator; F_r = K_r F_t. The
    /// spindle's power is then K MRR.
    CuttingEnergy {
        /// K, N/mm² (mJ/mm³).
        k_n_mm2: f64,
        /// F_r/F_t.
        k_r: f64,
    },
}

/// Yang and Chen's lumped force.
///
/// F_t acts against the blades' motion and F_r away from the bone, both at the mean of the engaged surface's normals. MRR is
/// the equivalent volume of material at the reference density, so that light bone gives less force (Yang's phantom has one
/// density).
///
/// **Source:** Yang & Chen, equations (3), (4), (13), (14); docs/force-model.md 9 for both forms.
#[derive(Debug, Clone, PartialEq)]
pub struct Lumped {
    tool: Tool,
    form: LumpedForm,
}

impl Lumped {
    /// The lumped model for a burr.
    ///
    /// # Errors
    /// [`ModelError::OutOfRange`] unless the coefficients are finite and not negative.
    pub fn new(tool: Tool, form: LumpedForm) -> Result<Self, ModelError> {
        let (k, k_r) = match form {
            LumpedForm::AsPrinted { k_t_n_mm2: k, k_r } | LumpedForm::CuttingEnergy { k_n_mm2: k, k_r } => {
                (k, k_r)
            }
        };
        checked("lumped K, N/mm²", k, |k| k >= 0.0, "0 or more")?;
        checked("lumped K_r = F_r/F_t", k_r, |k| k >= 0.0, "0 or more")?;
        Ok(Self { tool, form })
    }
}

impl ForceModel for Lumped {
    fn force(&self, met: &Engagement) -> CutForce {
        if met.is_air() || met.speed_mm_s <= 0.0 {
            return CutForce::default();
        }
        let (sigma, r) = (self.tool.spin(), self.tool.radius_mm());
        let omega = 2.0 * PI * met.spindle_rpm / 60.0;
        let (tangential_n, radial_n) = match self.form {
            LumpedForm::AsPrinted { k_t_n_mm2, k_r } => {
                // MRR/f: the engaged cross-section
                let tangential = k_t_n_mm2 * met.weighted_mrr_mm2;
                (tangential, k_r * tangential)
            }
            LumpedForm::CuttingEnergy { k_n_mm2, k_r } => {
                let tangential = k_n_mm2 * met.weighted_mrr_mm3_s() / (omega * r);
                (tangential, k_r * tangential)
            }
        };
        let outwards = met.toward_bone_mm2.try_normalize(1e-12).unwrap_or_default();
        // in a plunge the tangential forces cancel
        let around = Vector3::z().cross(&outwards).try_normalize(1e-9).unwrap_or_default() * sigma;
        let force = -(around * tangential_n + outwards * radial_n);
        let torque_nmm = tangential_n * r;
        CutForce {
            force_n: met.tool_axes * force,
            moment_nmm: met.tool_axes * Vector3::new(0.0, 0.0, -sigma * torque_nmm),
            torque_nmm,
            spindle_power_mw: torque_nmm * omega,
            peak_n: force.norm(),
        }
    }
}
