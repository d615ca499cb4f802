//! The inputs of the force model: tool, material, discretisation, motion; checked where they are made.

use std::f64::consts::PI;

use bonemill_geometry::{Frame, Point, basis};
use nalgebra::{Rotation3, Unit, Vector3};

use super::error::{ModelError, checked};

/// Length element of the force sum.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Measure {
    /// Its arc length: K_t is then the specific cutting energy exactly.
    Db,
    /// Its height, as Dillon prints it; underrates the tip by sin κ.
    Dz,
}

/// A spherical burr with identical blades.
#[derive(Debug, Clone, PartialEq)]
pub struct Tool {
    radius_mm: f64,
    blades: u32,
    spin: f64,
    helix_rad: f64,
    kappa_min_rad: f64,
    kappa_max_rad: f64,
}

impl Tool {
    /// A whole sphere with straight blades. `spin` is the sign of the angular velocity about the axis from the burr to the
    /// handpiece: −1 "forward", clockwise as the handpiece sees it, or +1.
    ///
    /// # Errors
    /// [`ModelError::OutOfRange`] unless 0 < radius ≤ 50 mm, 1 ≤ blades ≤ 1000 and spin is ±1.
    pub fn new(radius_mm: f64, blades: u32, spin: i32) -> Result<Self, ModelError> {
        checked("burr radius, mm", radius_mm, |r| r > 0.0 && r <= 50.0, "above 0, at most 50")?;
        checked("blades", f64::from(blades), |b| (1.0..=1000.0).contains(&b), "1 to 1000")?;
        checked("spin", f64::from(spin), |s| s.abs() == 1.0, "-1 or +1")?;
        Ok(Self {
            radius_mm,
            blades,
            spin: f64::from(spin),
            helix_rad: 0.0,
            kappa_min_rad: 0.0,
            kappa_max_rad: PI,
        })
    }

    /// The same burr with helical blades: the blade lags by tan(helix)(1 − cos κ).
    ///
    /// # Errors
    /// [`ModelError::OutOfRange`] unless |helix| < 80°.
    pub fn with_helix(self, helix_rad: f64) -> Result<Self, ModelError> {
        checked("helix, rad", helix_rad, |h| h.abs() < 80f64.to_radians(), "below 80° either way")?;
        Ok(Self { helix_rad, ..self })
    }

    /// The same burr, cutting only where `kappa_min_rad` ≤ κ ≤ `kappa_max_rad`.
    ///
    /// # Errors
    /// [`ModelError::OutOfRange`] unless 0 ≤ min < max ≤ π.
    pub fn with_kappa(self, kappa_min_rad: f64, kappa_max_rad: f64) -> Result<Self, ModelError> {
        checked("kappa_min, rad", kappa_min_rad, |k| (0.0..PI).contains(&k), "0 to below π")?;
        let above = |k| k > kappa_min_rad && k <= PI;
        checked("kappa_max, rad", kappa_max_rad, above, "above kappa_min, at most π")?;
        Ok(Self { kappa_min_rad, kappa_max_rad, ..self })
    }

    /// The same burr on a neck of the given radius, where it does not cut: κ_max = π − asin(r_neck/r).
    ///
    /// # Errors
    /// [`ModelError::OutOfRange`] unless 0 ≤ r_neck < r.
    pub fn with_neck(self, neck_radius_mm: f64) -> Result<Self, ModelError> {
        let r = self.radius_mm;
        checked("neck radius, mm", neck_radius_mm, |n| n >= 0.0 && n < r, "0 to below the burr's radius")?;
        let kappa_min_rad = self.kappa_min_rad;
        self.with_kappa(kappa_min_rad, PI - (neck_radius_mm / r).asin())
    }

    /// Radius r, mm.
    pub fn radius_mm(&self) -> f64 {
        self.radius_mm
    }
    /// Number of blades, N_β.
    pub fn blades(&self) -> u32 {
        self.blades
    }
    /// σ: −1.0 or 1.0.
    pub fn spin(&self) -> f64 {
        self.spin
    }
    /// Helix angle, rad.
    pub fn helix_rad(&self) -> f64 {
        self.helix_rad
    }
    /// Where the cutting part begins, polar angle from the tip, rad.
    pub fn kappa_min_rad(&self) -> f64 {
        self.kappa_min_rad
    }
    /// Where the cutting part ends, polar angle from the tip, rad.
    pub fn kappa_max_rad(&self) -> f64 {
        self.kappa_max_rad
    }
    /// Length of feed per tooth for a speed, mm: 60 |v|/(n N_β).
    pub fn feed_per_tooth_mm(&self, speed_mm_s: f64, spindle_rpm: f64) -> f64 {
        60.0 * speed_mm_s / (spindle_rpm * f64::from(self.blades))
    }
    /// How far the blade lags behind its tip at κ, rad.
    pub(crate) fn lag_rad(&self, kappa_rad: f64) -> f64 {
        self.helix_rad.tan() * (1.0 - kappa_rad.cos())
    }
    /// dS/db = sqrt(1 + sin⁴κ tan²helix).
    pub(super) fn edge_stretch(&self, sin_kappa: f64) -> f64 {
        (1.0 + sin_kappa.powi(4) * self.helix_rad.tan().powi(2)).sqrt()
    }
}

/// Specific cutting energies and how they scale with density.
#[derive(Debug, Clone, PartialEq)]
pub struct Material {
    k_n_mm2: [f64; 3],
    k_edge_n_mm: [f64; 3],
    rho_ref_g_cm3: f64,
    exponent: f64,
    rho_min_g_cm3: f64,
    t0_mm: f64,
}

impl Material {
    /// (K_t, K_r, K_a) in N/mm² at the reference density; force proportional to density, no edge term.
    ///
    /// # Errors
    /// [`ModelError::OutOfRange`] unless each K is finite and ≥ 0 and the density is positive.
    pub fn new(k_n_mm2: [f64; 3], rho_ref_g_cm3: f64) -> Result<Self, ModelError> {
        non_negative(["k_t, N/mm²", "k_r, N/mm²", "k_a, N/mm²"], k_n_mm2)?;
        checked("rho_ref, g/cm³", rho_ref_g_cm3, |r| r > 0.0, "positive")?;
        let k_edge_n_mm = [0.0; 3];
        Ok(Self { k_n_mm2, k_edge_n_mm, rho_ref_g_cm3, exponent: 1.0, rho_min_g_cm3: 0.0, t0_mm: 0.0 })
    }

    /// The same with edge (ploughing) forces (K_te, K_re, K_ae) per mm of engaged edge, which fade as t/(t + t0).
    ///
    /// # Errors
    /// [`ModelError::OutOfRange`] unless all are finite and ≥ 0.
    pub fn with_edge(self, k_edge_n_mm: [f64; 3], t0_mm: f64) -> Result<Self, ModelError> {
        non_negative(["k_te, N/mm", "k_re, N/mm", "k_ae, N/mm"], k_edge_n_mm)?;
        checked("t0, mm", t0_mm, |t| t >= 0.0, "0 or more")?;
        Ok(Self { k_edge_n_mm, t0_mm, ..self })
    }

    /// The same with w = (ρ/ρ_ref)^exponent where ρ > rho_min.
    ///
    /// # Errors
    /// [`ModelError::OutOfRange`] unless 0 ≤ exponent ≤ 10 and rho_min ≥ 0.
    pub fn with_density_law(self, exponent: f64, rho_min_g_cm3: f64) -> Result<Self, ModelError> {
        checked("exponent of density", exponent, |p| (0.0..=10.0).contains(&p), "0 to 10")?;
        checked("rho_min, g/cm³", rho_min_g_cm3, |r| r >= 0.0, "0 or more")?;
        Ok(Self { exponent, rho_min_g_cm3, ..self })
    }

    /// Density weight w(ρ): (ρ/ρ_ref)^p where ρ > ρ_min, else 0.
    #[inline]
    pub fn weight(&self, rho_g_cm3: f64) -> f64 {
        let rho = rho_g_cm3.max(0.0);
        if rho > self.rho_min_g_cm3 {
            let ratio = rho / self.rho_ref_g_cm3;
            // the common law, and the one that runs per surface sample, must not cost a power
            if self.exponent == 1.0 { ratio } else { ratio.powf(self.exponent) }
        } else {
            0.0
        }
    }

    /// (K_t, K_r, K_a), N/mm².
    pub fn k_n_mm2(&self) -> [f64; 3] {
        self.k_n_mm2
    }
    /// (K_te, K_re, K_ae), N/mm.
    pub fn k_edge_n_mm(&self) -> [f64; 3] {
        self.k_edge_n_mm
    }
    /// Chip thickness at which the edge term is half, t0, mm.
    pub fn t0_mm(&self) -> f64 {
        self.t0_mm
    }
    /// Whether any edge coefficient is not 0.
    pub fn has_edge(&self) -> bool {
        self.k_edge_n_mm.iter().any(|&k| k > 0.0)
    }
    /// Edge factor E of a chip thickness t > 0: t/(t + t0), 1 for t0 = 0.
    #[inline]
    pub fn edge_factor(&self, t_mm: f64) -> f64 {
        if self.t0_mm > 0.0 { t_mm / (t_mm + self.t0_mm) } else { 1.0 }
    }
}

fn non_negative(names: [&'static str; 3], values: [f64; 3]) -> Result<(), ModelError> {
    for (name, value) in names.into_iter().zip(values) {
        checked(name, value, |k| k >= 0.0, "finite, 0 or more")?;
    }
    Ok(())
}

/// How the polar angle is cut into elements.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ElementGrid {
    /// Uniform in κ.
    Kappa,
    /// Uniform in z: equation (4) to the letter. Not to be used with [`Measure::Db`]: 1/sin κ at the tip.
    Z,
}

/// How finely the surface is summed.
#[derive(Debug, Clone, PartialEq)]
pub struct Discretisation {
    n_gamma: usize,
    n_kappa: usize,
    grid: ElementGrid,
    measure: Measure,
    sample_offset_mm: f64,
}

impl Default for Discretisation {
    /// 64 elements by 16 increments (128 azimuths on 8 blades), db: 1.6e-4 of |F| from the continuum in the median.
    fn default() -> Self {
        Self {
            n_gamma: 16,
            n_kappa: 64,
            grid: ElementGrid::Kappa,
            measure: Measure::Db,
            sample_offset_mm: 0.0,
        }
    }
}

impl Discretisation {
    /// `n_gamma` increments of rotation between two blades, `n_kappa` elements from tip to shaft.
    ///
    /// # Errors
    /// [`ModelError::OutOfRange`] unless both are 1 to 100 000.
    pub fn new(
        n_gamma: usize,
        n_kappa: usize,
        grid: ElementGrid,
        measure: Measure,
    ) -> Result<Self, ModelError> {
        for (name, n) in [("n_gamma", n_gamma), ("n_kappa", n_kappa)] {
            checked(name, n as f64, |n| (1.0..=1e5).contains(&n), "1 to 100000")?;
        }
        Ok(Self { n_gamma, n_kappa, grid, measure, sample_offset_mm: 0.0 })
    }

    /// The same, with the density read `sample_offset_mm` outside the surface.
    ///
    /// # Errors
    /// [`ModelError::OutOfRange`] when it is not finite.
    pub fn with_sample_offset(self, sample_offset_mm: f64) -> Result<Self, ModelError> {
        checked("sample offset, mm", sample_offset_mm, |_| true, "finite")?;
        Ok(Self { sample_offset_mm, ..self })
    }

    /// Increments of rotation between two blades, N_γ.
    pub fn n_gamma(&self) -> usize {
        self.n_gamma
    }
    /// Elements along a blade.
    pub fn n_kappa(&self) -> usize {
        self.n_kappa
    }
    /// dz or db.
    pub fn measure(&self) -> Measure {
        self.measure
    }
    /// How far outside the surface the density is read, mm.
    pub fn sample_offset_mm(&self) -> f64 {
        self.sample_offset_mm
    }

    /// Element `k` of a blade.
    pub(crate) fn element(&self, tool: &Tool, k: usize) -> Element {
        let (r, n) = (tool.radius_mm, self.n_kappa as f64);
        let mid = k as f64 + 0.5;
        let (kappa_rad, sin_cos, db_mm, dz_mm) = match self.grid {
            ElementGrid::Kappa => {
                let step = (tool.kappa_max_rad - tool.kappa_min_rad) / n;
                let kappa = tool.kappa_min_rad + mid * step;
                let (sin, cos) = kappa.sin_cos();
                (kappa, (sin, cos), r * step, r * sin * step)
            }
            ElementGrid::Z => {
                let (z0, z1) = (-r * tool.kappa_min_rad.cos(), -r * tool.kappa_max_rad.cos());
                let dz = (z1 - z0) / n;
                let kappa = (-(z0 + mid * dz) / r).clamp(-1.0, 1.0).acos();
                let (sin, cos) = kappa.sin_cos();
                (kappa, (sin, cos), dz / sin, dz)
            }
        };
        let dl_mm = match self.measure {
            Measure::Dz => dz_mm,
            Measure::Db => db_mm,
        };
        let edge_mm = db_mm * tool.edge_stretch(sin_cos.0);
        Element { kappa_rad, sin: sin_cos.0, cos: sin_cos.1, dl_mm, edge_mm, dz_mm }
    }
}

/// A differential element of a blade: its polar angle and its lengths.
#[derive(Debug, Clone, Copy)]
pub struct Element {
    /// κ, polar angle from the tip, rad.
    pub kappa_rad: f64,
    /// sin κ.
    pub sin: f64,
    /// cos κ.
    pub cos: f64,
    /// Length that the cutting term counts: dz or db.
    pub dl_mm: f64,
    /// Length of cutting edge, dS.
    pub edge_mm: f64,
    /// Its height along the axis, dz.
    pub dz_mm: f64,
}

/// Where the burr is, how it lies, how it moves.
#[derive(Debug, Clone, Copy)]
pub struct Motion<F: Frame> {
    center: Point<F>,
    axis: Unit<Vector3<f64>>,
    velocity_mm_s: Vector3<f64>,
    spindle_rpm: f64,
}

impl<F: Frame> Motion<F> {
    /// `axis` points from the burr's centre to the handpiece and need not be a unit vector; `velocity_mm_s` is the burr's
    /// centre relative to the bone, and may be 0.
    ///
    /// # Errors
    /// [`ModelError`] when a value is not finite, the axis has no direction, or the spindle stands still.
    pub fn new(
        center: Point<F>,
        axis: Vector3<f64>,
        velocity_mm_s: Vector3<f64>,
        spindle_rpm: f64,
    ) -> Result<Self, ModelError> {
        let finite = |name, v: Vector3<f64>| {
            let ok = v.iter().all(|c| c.is_finite());
            if ok { Ok(()) } else { Err(ModelError::Vector { name, value: v.into(), expected: "finite" }) }
        };
        finite("burr centre, mm", center.coords)?;
        finite("velocity, mm/s", velocity_mm_s)?;
        checked("spindle speed, rpm", spindle_rpm, |n| n > 0.0, "positive")?;
        Ok(Self { center, axis: direction("shaft axis", axis)?, velocity_mm_s, spindle_rpm })
    }

    /// Burr centre.
    pub fn center(&self) -> Point<F> {
        self.center
    }
    /// Unit axis from the burr to the handpiece.
    pub fn axis(&self) -> Unit<Vector3<f64>> {
        self.axis
    }
    /// Velocity of the burr's centre, mm/s.
    pub fn velocity_mm_s(&self) -> Vector3<f64> {
        self.velocity_mm_s
    }
    /// Spindle speed, rpm.
    pub fn spindle_rpm(&self) -> f64 {
        self.spindle_rpm
    }
    /// Columns: the tool frame's axes in `F`.
    pub(super) fn rotation(&self) -> Rotation3<f64> {
        basis::from_z(&self.axis)
    }
}

/// The direction of a vector.
pub fn direction(name: &'static str, v: Vector3<f64>) -> Result<Unit<Vector3<f64>>, ModelError> {
    // scaled first, so that neither tiny nor huge vectors lose their direction; a NaN fails the comparison
    let scale = v.amax();
    if !(scale > 0.0 && scale.is_finite() && v.iter().all(|c| c.is_finite())) {
        return Err(ModelError::Vector { name, value: v.into(), expected: "finite and not zero" });
    }
    Ok(Unit::new_normalize(v / scale))
}
