//! The force on the burr: the sum over its surface of docs/force-model.md 3 and 4, as written there.
//!
//! The burr is a ball with straight blades; the sum over blades and increments of rotation is one over equally spaced azimuths. Nodes
//! are equally spaced in the polar angle κ from the tip. Only nodes that move forward cut.

use std::f64::consts::PI;

use bonemill_case::{Burr, MaterialSpec, Measure};
use bonemill_geometry::basis;
use nalgebra::{Matrix3, Vector3};

/// A node moves forward if its chip is at least this share of the feed per tooth.
const GRAZING: f64 = 1e-12;

/// The nodes of a burr's surface.
#[derive(Debug)]
pub struct BurrSum {
    nodes: Vec<Node>,
    burr: Burr,
    material: MaterialSpec,
    azimuths: usize,
    along_mm: f64,
}

/// A node in the tool frame.
#[derive(Debug, Clone, Copy)]
struct Node {
    /// n, outward.
    normal: Vector3<f64>,
    /// e_a, along the meridian from tip to shaft.
    up: Vector3<f64>,
    /// e_ψ, around the shaft.
    around: Vector3<f64>,
    sin: f64,
}

/// The patch of the surface for which a node stands.
#[derive(Debug, Clone, Copy)]
pub struct NodePatch<'a> {
    node: &'a Node,
    tool_from_work: &'a Matrix3<f64>,
    sides_mm: [f64; 2],
}

/// The force on the burr at one place: a part proportional to the speed, and a part of the edges.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Engaged {
    /// Cutting force per speed, N/(mm/s).
    pub cut_n_per_mm_s: Vector3<f64>,
    /// Force of the edges, N.
    pub edge_n: Vector3<f64>,
    /// Torque of cutting per speed, N mm/(mm/s).
    pub cut_nmm_per_mm_s: f64,
    /// Torque of the edges, N mm.
    pub edge_nmm: f64,
}

impl Engaged {
    /// The force at a speed, N; none at rest.
    pub fn force_n(&self, speed_mm_s: f64) -> Vector3<f64> {
        if speed_mm_s > 0.0 { self.cut_n_per_mm_s * speed_mm_s + self.edge_n } else { Vector3::zeros() }
    }

    /// The resisting torque at a speed, N mm; none at rest.
    pub fn torque_nmm(&self, speed_mm_s: f64) -> f64 {
        if speed_mm_s > 0.0 { self.cut_nmm_per_mm_s * speed_mm_s + self.edge_nmm } else { 0.0 }
    }

    /// The mean of two.
    pub fn mean_with(&self, other: &Self) -> Self {
        Self {
            cut_n_per_mm_s: 0.5 * (self.cut_n_per_mm_s + other.cut_n_per_mm_s),
            edge_n: 0.5 * (self.edge_n + other.edge_n),
            cut_nmm_per_mm_s: 0.5 * (self.cut_nmm_per_mm_s + other.cut_nmm_per_mm_s),
            edge_nmm: 0.5 * (self.edge_nmm + other.edge_nmm),
        }
    }

    /// Whether nothing is cut.
    pub fn is_none(&self) -> bool {
        self.cut_n_per_mm_s == Vector3::zeros() && self.edge_n == Vector3::zeros()
    }
}

impl NodePatch<'_> {
    /// The patch's two sides projected onto a unit direction in work, mm.
    #[inline]
    pub fn sides_mm(&self, direction: &Vector3<f64>) -> [f64; 2] {
        let direction = self.tool_from_work * direction;
        let [along, around] = self.sides_mm;
        [along * self.node.up.dot(&direction).abs(), around * self.node.around.dot(&direction).abs()]
    }
}

impl BurrSum {
    /// `rings` polar angles by `azimuths` places around.
    pub fn new(burr: &Burr, material: &MaterialSpec, [rings, azimuths]: [usize; 2]) -> Self {
        let r = burr.radius_mm;
        // below the neck
        let kappa_max = PI - (burr.neck_radius_mm / r).clamp(0.0, 1.0).asin();
        let step = kappa_max / rings as f64;
        let node = |n: usize| {
            let (sk, ck) = ((n / azimuths) as f64 * step + 0.5 * step).sin_cos();
            let psi = f64::from(burr.spin) * ((n % azimuths) as f64 + 0.5) * 2.0 * PI / azimuths as f64;
            let (sp, cp) = psi.sin_cos();
            Node {
                normal: Vector3::new(sk * cp, sk * sp, -ck),
                up: Vector3::new(ck * cp, ck * sp, sk),
                around: Vector3::new(-sp, cp, 0.0),
                sin: sk,
            }
        };
        let nodes = (0..rings * azimuths).map(node).collect();
        Self { nodes, burr: *burr, material: *material, azimuths, along_mm: r * step }
    }

    /// Largest distance between a patch's middle and its edge, mm.
    pub fn patch_mm(&self) -> f64 {
        0.5 * self.along_mm.hypot(self.around_mm(1.0))
    }

    fn around_mm(&self, sin: f64) -> f64 {
        self.burr.radius_mm * sin * 2.0 * PI / self.azimuths as f64
    }

    /// w(ρ) = (ρ/ρ_ref)^p, 0 without density.
    #[inline]
    pub fn weight(&self, rho_g_cm3: f64) -> f64 {
        let ratio = rho_g_cm3 / self.material.rho_ref_g_cm3;
        let p = self.material.exponent;
        if rho_g_cm3 <= 0.0 {
            0.0
        } else if p == 1.0 {
            ratio
        } else {
            ratio.powf(p)
        }
    }

    /// The force on a burr whose shaft has the unit direction `axis` and which moves in the unit direction `feed`.
    ///
    /// `weight`: w of the bone at the burr's centre plus the radius times a unit normal, times the patch's share of bone. The speed
    /// counts only for an edge term that depends on the chip's thickness.
    ///
    /// **Source:** Dillon et al. 2016, equations (3) and (4); docs/force-model.md 1 to 4.
    pub fn engaged(
        &self,
        axis: &Vector3<f64>,
        feed: &Vector3<f64>,
        speed_mm_s: f64,
        mut weight: impl FnMut(&Vector3<f64>, &NodePatch<'_>) -> f64,
    ) -> Engaged {
        let work_from_tool = basis::from_z(axis).into_inner();
        let tool_from_work = work_from_tool.transpose();
        let feed_tool = tool_from_work * feed;
        let (m, sigma) = (&self.material, f64::from(self.burr.spin));
        let turn_mm = 60.0 / self.burr.spindle_rpm;
        let tooth_mm = turn_mm * speed_mm_s / f64::from(self.burr.flutes);
        let [mut cut, mut edge] = [Vector3::<f64>::zeros(); 2];
        let [mut cut_q, mut edge_q] = [0.0; 2];
        for node in &self.nodes {
            let forward = node.normal.dot(&feed_tool);
            if forward <= GRAZING {
                continue;
            }
            let sides_mm = [self.along_mm, self.around_mm(node.sin)];
            let patch = NodePatch { node, tool_from_work: &tool_from_work, sides_mm };
            let w = weight(&(work_from_tool * node.normal), &patch);
            if w <= 0.0 {
                continue;
            }
            // per feed per tooth of 1 mm
            let dl_mm = match m.measure {
                Measure::Db => self.along_mm,
                Measure::Dz => self.along_mm * node.sin,
            };
            let e = if m.t0_mm > 0.0 { tooth_mm * forward / (tooth_mm * forward + m.t0_mm) } else { 1.0 };
            let (chip, ploughed) = (forward * w * dl_mm, e * w * self.along_mm);
            let push = |k: &[f64; 3]| -(node.around * (sigma * k[0]) + node.normal * k[1] + node.up * k[2]);
            cut += push(&m.k_n_mm2) * chip;
            edge += push(&m.k_edge_n_mm) * ploughed;
            cut_q += node.sin * chip;
            edge_q += node.sin * ploughed;
        }
        // a blade is at each azimuth for this share of a turn; all blades together
        let share = f64::from(self.burr.flutes) / self.azimuths as f64;
        let per_speed = turn_mm / f64::from(self.burr.flutes) * share;
        let r = self.burr.radius_mm;
        Engaged {
            cut_n_per_mm_s: work_from_tool * cut * per_speed,
            edge_n: work_from_tool * edge * share,
            cut_nmm_per_mm_s: m.k_n_mm2[0] * r * cut_q * per_speed,
            edge_nmm: m.k_edge_n_mm[0] * r * edge_q * share,
        }
    }
}

#[cfg(test)]
mod tests;
