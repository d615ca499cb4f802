//! How much bone the burr takes, and with which part of it: Dillon's equations (1) and (2).
//!
//! z_i = (x_i − c)·a is a voxel centre's place along the shaft, V_i its exact volume inside the ball, ρ_i its density:
//!
//! ```text
//! m = Σ ρ_i V_i      I = Σ ρ_i V_i max(0, r² − z_i²)      I_n = I/(m r²)
//! ```
//!
//! I_n is near 1 when the side of the burr cuts and falls to 0 at the tip. Without the clamp, which touches only voxels that
//! stick out of the ball at the poles, it is a quadratic form: with S = Σ ρ_i V_i p_i p_iᵀ, p_i = x_i − c,
//!
//! ```text
//! I_n(a) = 1 − aᵀ S a/(m r²)
//! ```
//!
//! so that one pass over the voxels serves every axis ([`Moments`]).

use bonemill_geometry::{Frame, Point, Volume};
use nalgebra::{Matrix3, Unit, Vector3};

use crate::cutter::ball::BallVolumes;

/// Dillon's quantities at one place for one axis. With no mass, I_n is 1 and everything else 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EngagementMetrics {
    /// Voxels that the ball covers at least in part.
    pub voxels: usize,
    /// Volume of the ball within the grid, mm³.
    pub volume_mm3: f64,
    /// m, mg.
    pub mass_mg: f64,
    /// I, mg mm².
    pub inertia_mg_mm2: f64,
    /// I_n, 0 to 1.
    pub inertia_normalised: f64,
    /// I with the true squared distance from the shaft's axis, min(r², |p|² − z²), mg mm².
    pub true_inertia_mg_mm2: f64,
    /// The same over m r².
    pub true_inertia_normalised: f64,
    /// Mean of z² by mass, mm².
    pub z2_mean_mm2: f64,
}

/// The metrics of a ball in a density field, which may be the intact bone or what is left of it.
///
/// `axis` is the unit shaft axis; r² − z² is taken as printed, clamped at 0 for voxel centres beyond
/// the poles, and the true d² at r² for those beyond the equator, which keeps both I_n within 0 to 1.
///
/// **Source:** Dillon et al. 2016, equations (1), (2); resolutions 1–5 of docs/force-model.md 8.
pub fn engagement_metrics<T: Copy + Into<f64>, F: Frame>(
    density_g_cm3: &Volume<T, F>,
    center: Point<F>,
    axis: &Unit<Vector3<f64>>,
    radius_mm: f64,
) -> EngagementMetrics {
    let grid = density_g_cm3.grid();
    let r2 = radius_mm * radius_mm;
    let (mut voxels, mut volume, mut mass, mut inertia, mut true_inertia, mut z2_sum) =
        (0, 0.0, 0.0, 0.0, 0.0, 0.0);
    let block = [[0; 3], grid.dims()];
    BallVolumes::new().for_each(
        grid,
        center,
        radius_mm,
        block,
        |row| row,
        |index, v| {
            let p = grid.center(grid.voxel(index)) - center;
            let rho: f64 = density_g_cm3.data()[index].into();
            let (m, z2) = (rho * v, p.dot(axis).powi(2));
            voxels += 1;
            volume += v;
            mass += m;
            inertia += m * (r2 - z2).max(0.0);
            true_inertia += m * (p.norm_squared() - z2).min(r2);
            z2_sum += m * z2;
        },
    );
    let per_mass = |sum: f64, none: f64| if mass > 0.0 { sum / mass } else { none };
    EngagementMetrics {
        voxels,
        volume_mm3: volume,
        mass_mg: mass,
        inertia_mg_mm2: inertia,
        inertia_normalised: per_mass(inertia / r2, 1.0),
        true_inertia_mg_mm2: true_inertia,
        true_inertia_normalised: per_mass(true_inertia / r2, 1.0),
        z2_mean_mm2: per_mass(z2_sum, 0.0),
    }
}

/// Mass and second moments of the bone in the ball: all that I_n needs for any axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moments {
    radius_mm: f64,
    mass_mg: f64,
    second_mg_mm2: Matrix3<f64>,
}

impl Moments {
    /// No bone, in a ball of `radius_mm`.
    pub fn new(radius_mm: f64) -> Self {
        Self { radius_mm, mass_mg: 0.0, second_mg_mm2: Matrix3::zeros() }
    }

    /// Adds a piece of bone: its mass, and its centre seen from the burr's.
    #[inline]
    pub fn add(&mut self, mass_mg: f64, from_center_mm: &Vector3<f64>) {
        self.mass_mg += mass_mg;
        // symmetric, but nine products vectorise better than six do
        self.second_mg_mm2 += from_center_mm * from_center_mm.transpose() * mass_mg;
    }

    /// Adds what was summed apart.
    pub fn merge(&mut self, other: &Self) {
        self.mass_mg += other.mass_mg;
        self.second_mg_mm2 += other.second_mg_mm2;
    }

    /// m, mg.
    pub fn mass_mg(&self) -> f64 {
        self.mass_mg
    }

    /// S = Σ m p pᵀ, mg mm².
    pub fn second_mg_mm2(&self) -> &Matrix3<f64> {
        &self.second_mg_mm2
    }

    /// I_n for a unit axis: 1 − aᵀSa/(m r²), at least 0; 1 without mass.
    pub fn inertia_normalised(&self, axis: &Unit<Vector3<f64>>) -> f64 {
        (1.0 - axis.dot(&(self.scaled() * axis.into_inner()))).max(0.0)
    }

    /// S/(m r²); zero without mass.
    fn scaled(&self) -> Matrix3<f64> {
        if self.mass_mg > 0.0 {
            self.second_mg_mm2 / (self.mass_mg * self.radius_mm.powi(2))
        } else {
            Matrix3::zeros()
        }
    }
}

#[cfg(test)]
mod tests;
