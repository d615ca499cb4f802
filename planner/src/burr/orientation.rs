//! Forces for many shaft axes at one waypoint, from one gathering of bone.
//!
//! In the continuum limit F = −(N_β/2π) ∫ (K_t e_v + K_r n + K_a e_a) t w g dA with g = 1/r (dz) or 1/(r sin κ) (db): the
//! axis enters only through e_v = σ a×n/|a×n|, e_a = (a − (a·n) n)/|a×n| and sin κ = |a×n|. So the surface is sampled once, on
//! a lattice that knows the feed but not the shaft, and only the samples in bone are kept; an axis then costs a few
//! multiplications per sample.
//!
//! The lattice is a sunflower on the disc across the feed, lifted to the front hemisphere: each sample stands for the same
//! Σ t dA, so the weights of the cutting term are equal where the bone is. With an edge term, whose weight does not vanish at
//! grazing, the lattice is uniform in area instead.
//!
//! Near the poles of the shaft the integrands 1/sin κ (vectors) and 1/sin κ (scalars, db) are singular but integrable: a sample
//! within its own cell's radius of a pole takes the mean over its cell (see [`cell_mean_vector`], [`cell_mean_scalar`]).
//! The cut-off at the neck fades over one cell, so that the force is continuous in the axis.
//! A helix changes only the edge term; the sampling offset is the caller's.

use std::f64::consts::PI;

use bonemill_geometry::basis;
use nalgebra::{Unit, Vector3};

use super::input::{Material, Measure, Tool};
use super::kernel::EngagedForce;

/// Golden angle of the sunflower, rad: 2π(1 − 1/φ).
const GOLDEN_ANGLE_RAD: f64 = 2.399_963_229_728_653;
/// Samples are stored and summed in lanes of this many: a width that every SIMD set divides.
const LANES: usize = 8;

/// The sampling of one tool, material and measure.
#[derive(Debug, Clone)]
pub struct OrientationKernel {
    tool: Tool,
    material: Material,
    measure: Measure,
    /// Front hemisphere about +z, unit normals.
    directions: Vec<Vector3<f64>>,
    /// dA/r² = 2π/M (uniform) or π/(M n·v) (cosine).
    uniform: bool,
}

/// The samples of one waypoint that lie in bone, in lanes of `f32`: the sum's error is that of the lattice, 1e-3, not of
/// its arithmetic, 1e-6.
#[derive(Debug, Clone, Default)]
pub struct EngagedSamples {
    lanes: Vec<Lane>,
    count: usize,
    mrr_mm2: f64,
    weighted_mrr_mm2: f64,
}

#[derive(Debug, Clone, Copy, Default)]
struct Lane {
    normal: [[f32; LANES]; 3],
    /// w (n·v) dA/r², and E w dA/r².
    cut: [f32; LANES],
    edge: [f32; LANES],
    /// Square of the cell's radius, rad².
    cell2: [f32; LANES],
}

impl EngagedSamples {
    /// Samples in bone.
    pub fn len(&self) -> usize {
        self.count
    }

    /// Whether nothing is cut.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Removal per mm of feed, mm²: everything that has weight, whatever the axis (a neck not counted).
    pub fn mrr_mm2(&self) -> f64 {
        self.mrr_mm2
    }

    /// Removal per mm of feed, mm², weighted with w.
    pub fn weighted_mrr_mm2(&self) -> f64 {
        self.weighted_mrr_mm2
    }

    fn clear(&mut self) {
        self.lanes.clear();
        (self.count, self.mrr_mm2, self.weighted_mrr_mm2) = (0, 0.0, 0.0);
    }

    fn push(&mut self, n: &Vector3<f64>, cut: f64, edge: f64, cell2: f64) {
        let at = self.count % LANES;
        if at == 0 {
            // what stays empty weighs nothing, and its cell keeps the division finite
            self.lanes.push(Lane { cell2: [1.0; LANES], ..Lane::default() });
        }
        if let Some(lane) = self.lanes.last_mut() {
            for a in 0..3 {
                lane.normal[a][at] = n[a] as f32;
            }
            (lane.cut[at], lane.edge[at], lane.cell2[at]) = (cut as f32, edge as f32, cell2 as f32);
            self.count += 1;
        }
    }
}

/// Σ q u, Σ q u n, Σ q u (a·n) n, with u the mean of 1/sin^p κ for the vectors, and Σ q s n with s for the radial term.
#[derive(Default)]
struct Sums {
    plain: f64,
    normal: Vector3<f64>,
    twice: Vector3<f64>,
    radial: Vector3<f64>,
    torque: f64,
}

impl OrientationKernel {
    /// The default number of samples of the front hemisphere.
    pub const DEFAULT_SAMPLES: usize = 1024;

    /// A lattice of `samples` over the front hemisphere (at least 16 are taken).
    pub fn new(tool: &Tool, material: &Material, measure: Measure, samples: usize) -> Self {
        let (uniform, m) = (material.has_edge(), samples.max(16));
        let direction = |i: usize| {
            let u = (i as f64 + 0.5) / m as f64;
            let z = if uniform { 1.0 - u } else { (1.0 - u).sqrt() };
            let (s, c) = (i as f64 * GOLDEN_ANGLE_RAD).sin_cos();
            let across = (1.0 - z * z).sqrt();
            Vector3::new(across * c, across * s, z)
        };
        Self {
            tool: tool.clone(),
            material: material.clone(),
            measure,
            directions: (0..m).map(direction).collect(),
            uniform,
        }
    }

    /// Gathers the bone in front of the burr into `samples` (cleared first, so that one buffer serves a whole path).
    ///
    /// `feed` and the unit normals that `weight` takes are in the caller's frame; `weight` is w ≥ 0 of the bone at the burr's
    /// centre plus r (+ offset) times the normal, 0 where it has been removed. The speeds matter only to an edge term with t0 > 0.
    pub fn gather(
        &self,
        samples: &mut EngagedSamples,
        feed: &Unit<Vector3<f64>>,
        nominal_mm_s: f64,
        spindle_rpm: f64,
        mut weight: impl FnMut(&Vector3<f64>) -> f64,
    ) {
        samples.clear();
        let turn = basis::from_z(feed).into_inner();
        let tooth_mm = self.tool.feed_per_tooth_mm(nominal_mm_s, spindle_rpm);
        let count = self.directions.len() as f64;
        let r2 = self.tool.radius_mm().powi(2);
        for direction in &self.directions {
            let (n, forward) = (turn * direction, direction.z);
            let w = weight(&n);
            if w > 0.0 {
                let area = if self.uniform { 2.0 * PI / count } else { PI / (count * forward) };
                let edge = self.material.edge_factor(forward * tooth_mm) * w * area;
                samples.push(&n, w * forward * area, edge, area / PI);
                samples.mrr_mm2 += forward * area * r2;
                samples.weighted_mrr_mm2 += w * forward * area * r2;
            }
        }
    }

    /// The force for a shaft `axis` (unit, burr to handpiece, in the frame of the samples).
    ///
    /// **Source:** Dillon et al. 2016, equations (3) and (4), in the limit of fine elements.
    pub fn force_for_axis(
        &self,
        samples: &EngagedSamples,
        axis: &Unit<Vector3<f64>>,
        spindle_rpm: f64,
    ) -> EngagedForce {
        if samples.is_empty() {
            return EngagedForce::ZERO;
        }
        let r = self.tool.radius_mm();
        let per_area = f64::from(self.tool.blades()) / (2.0 * PI) * r;
        let cut_sums = match self.measure {
            Measure::Dz => self.sum::<false>(samples, axis, 0.0, |lane| &lane.cut),
            Measure::Db => self.sum::<true>(samples, axis, 0.0, |lane| &lane.cut),
        };
        let (cut, cut_torque) = self.assemble(&cut_sums, axis, self.material.k_n_mm2());
        let (edge, edge_torque) = if self.material.has_edge() {
            let helix2 = self.tool.helix_rad().tan().powi(2);
            let sums = self.sum::<true>(samples, axis, helix2 as f32, |lane| &lane.edge);
            self.assemble(&sums, axis, self.material.k_edge_n_mm())
        } else {
            Default::default()
        };
        let per_speed = per_area * self.tool.feed_per_tooth_mm(1.0, spindle_rpm);
        EngagedForce {
            cut_n_per_mm_s: cut * per_speed,
            edge_n: edge * per_area,
            cut_torque_nmm_per_mm_s: cut_torque * per_speed,
            edge_torque_nmm: edge_torque * per_area,
            mrr_mm2: samples.mrr_mm2,
            weighted_mrr_mm2: samples.weighted_mrr_mm2,
        }
    }

    fn assemble(
        &self,
        sums: &Sums,
        axis: &Unit<Vector3<f64>>,
        [k_t, k_r, k_a]: [f64; 3],
    ) -> (Vector3<f64>, f64) {
        let a = axis.into_inner();
        let tangential = a.cross(&sums.normal) * self.tool.spin();
        let meridian = a * sums.plain - sums.twice;
        let force = -(tangential * k_t + sums.radial * k_r + meridian * k_a);
        (force, k_t * sums.torque * self.tool.radius_mm())
    }

    /// The lanes' sums. `DB` chooses g = 1/sin κ; otherwise g = 1. `helix2` = tan²helix stretches the edge.
    fn sum<const DB: bool>(
        &self,
        samples: &EngagedSamples,
        axis: &Unit<Vector3<f64>>,
        helix2: f32,
        weight: impl Fn(&Lane) -> &[f32; LANES],
    ) -> Sums {
        let [ax, ay, az] = [axis.x as f32, axis.y as f32, axis.z as f32];
        // a·n = −cos κ lies between these; they reach past ±1 where nothing is cut off
        let low =
            if self.tool.kappa_min_rad() > 0.0 { -self.tool.kappa_min_rad().cos() } else { -2.0 } as f32;
        let high = if self.tool.kappa_max_rad() < PI { -self.tool.kappa_max_rad().cos() } else { 2.0 } as f32;
        let cut_off = low > -1.0 || high < 1.0;
        let mut acc = [[0f32; LANES]; 11];
        for lane in &samples.lanes {
            let q = weight(lane);
            for l in 0..LANES {
                let (nx, ny, nz) = (lane.normal[0][l], lane.normal[1][l], lane.normal[2][l]);
                let d = ax * nx + ay * ny + az * nz;
                let sin2 = (1.0 - d * d).max(0.0);
                let cell2 = lane.cell2[l];
                let mut q = q[l];
                if cut_off {
                    // per radian of κ, d changes by sin κ
                    let cell = 2.0 * (sin2 * cell2).sqrt() + 1e-6;
                    q *= ((high - d) / cell + 0.5).clamp(0.0, 1.0) * ((d - low) / cell + 0.5).clamp(0.0, 1.0);
                }
                if helix2 > 0.0 {
                    q *= (1.0 + helix2 * sin2 * sin2).sqrt();
                }
                let (u, s, sin) = if DB {
                    (cell_mean_vector(sin2, cell2), cell_mean_scalar(sin2, cell2), 1.0)
                } else {
                    let sin = sin2.max(1e-12).sqrt();
                    (1.0 / sin, 1.0, sin)
                };
                let (qu, qs) = (q * u, q * s);
                let terms = [
                    qu,
                    qu * nx,
                    qu * ny,
                    qu * nz,
                    qu * d * nx,
                    qu * d * ny,
                    qu * d * nz,
                    qs * nx,
                    qs * ny,
                    qs * nz,
                    q * sin,
                ];
                for (sum, term) in acc.iter_mut().zip(terms) {
                    sum[l] += term;
                }
            }
        }
        let total = acc.map(|lanes| lanes.iter().map(|&v| f64::from(v)).sum::<f64>());
        Sums {
            plain: total[0],
            normal: Vector3::new(total[1], total[2], total[3]),
            twice: Vector3::new(total[4], total[5], total[6]),
            radial: Vector3::new(total[7], total[8], total[9]),
            torque: total[10],
        }
    }
}

/// u with u·(a×n) the mean of (a×n)/sin²κ over a round cell: 1/max(sin²κ, cell²).
///
/// In the plane the field x/|x|² is harmonic outside the pole, so its mean over a disc that does not hold the pole is its
/// value at the centre, and within the disc it grows linearly.
#[inline(always)]
fn cell_mean_vector(sin2: f32, cell2: f32) -> f32 {
    1.0 / sin2.max(cell2)
}

/// Mean of 1/sin κ over a round cell.
///
/// With u = sin κ/cell the mean of 1/|x| over a disc is (4/π)E(u)/cell for u ≤ 1 and (4/π)(uE(1/u) − (u − 1/u)K(1/u))/cell
/// beyond (E, K complete elliptic integrals of modulus u). The polynomials hold the value 4/π at u = 1 and the first terms
/// of both series; error below 0.5 % of the value.
#[inline(always)]
fn cell_mean_scalar(sin2: f32, cell2: f32) -> f32 {
    const AT_ONE: f32 = std::f32::consts::FRAC_2_PI * 2.0;
    let inverse = 1.0 / sin2.max(cell2);
    let x2 = cell2 * inverse;
    let outside = inverse.sqrt() * (1.0 + x2 * (0.125 + (AT_ONE - 1.125) * x2));
    let u2 = sin2 / cell2;
    let inside = (2.0 - u2 * (0.5 + (1.5 - AT_ONE) * u2)) / cell2.sqrt();
    if sin2 < cell2 { inside } else { outside }
}
