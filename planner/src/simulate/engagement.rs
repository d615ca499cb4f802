//! The burr's surface as nodes, and what of it meets bone.
//!
//! The nodes are those of the burr's force sum (D4): meridians of blades at increments of rotation, elements of equal
//! polar angle. Only nodes that move forward are looked at. What a force model needs of them are a few sums: per
//! increment of rotation, of the tangential, radial and axial directions times chip times weight, and of removal over
//! all.

use std::f64::consts::PI;

use bonemill_geometry::basis;
use nalgebra::{Matrix3, Unit, Vector3};

use super::bone::{Amount, Kind};
use crate::burr::force::GRAZING;
use crate::burr::input::Element;
use crate::burr::{Discretisation, Material, Tool};

/// The nodes of a tool.
#[derive(Debug, Clone)]
pub struct BurrNodes {
    tool: Tool,
    rings: Vec<Ring>,
    azimuths: Vec<[f64; 2]>,
    increments: usize,
}

#[derive(Debug, Clone)]
struct Ring {
    element: Element,
    /// (cos, sin) of the ring's turn −σ lag.
    turn: [f64; 2],
}

/// Direction sums of one increment of rotation, tool frame, mm: Σ q e_v dl, Σ q n dl, Σ q e_a dl.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Directions {
    /// Along the blades' motion.
    pub tangential: Vector3<f64>,
    /// Outwards.
    pub radial: Vector3<f64>,
    /// Along the meridian from tip to shaft.
    pub axial: Vector3<f64>,
}

impl Directions {
    /// −(k_t Σ e_v + k_r Σ n + k_a Σ e_a).
    pub fn force(&self, [k_t, k_r, k_a]: [f64; 3]) -> Vector3<f64> {
        -(self.tangential * k_t + self.radial * k_r + self.axial * k_a)
    }

    /// Σ r n × dF: n × e_v = σ e_a and n × e_a = −σ e_v.
    pub fn moment(&self, [k_t, _, k_a]: [f64; 3], tool: &Tool) -> Vector3<f64> {
        (self.axial * -k_t + self.tangential * k_a) * (tool.radius_mm() * tool.spin())
    }
}

/// The bone that a burr meets at one pose and feed direction.
#[derive(Debug, Clone)]
pub struct Engagement {
    /// Columns: the tool frame's axes in work.
    pub tool_axes: Matrix3<f64>,
    /// Unit direction of the feed, work.
    pub feed: Unit<Vector3<f64>>,
    /// Feed, mm/s.
    pub speed_mm_s: f64,
    /// Spindle, rpm.
    pub spindle_rpm: f64,
    /// Per increment of rotation, with q = w n·v̂: the cutting term per unit of chip.
    pub cut: Vec<Directions>,
    /// Per increment, with q = w E: the edge term.
    pub edge: Vec<Directions>,
    /// Σ w n n·v̂ dA, tool frame, mm²: where the bone is.
    pub toward_bone_mm2: Vector3<f64>,
    /// Removal per mm of feed, mm²: everything solid that has weight.
    pub mrr_mm2: f64,
    /// The same weighted with w.
    pub weighted_mrr_mm2: f64,
    /// Surface that moves into bone, mm².
    pub contact_area_mm2: f64,
    /// Volume and mass per mm of feed, by kind.
    pub by_kind_per_mm: Amount,
}

impl Engagement {
    /// Removal rate of everything that has weight, mm³/s.
    pub fn mrr_mm3_s(&self) -> f64 {
        self.mrr_mm2 * self.speed_mm_s
    }

    /// Removal rate as of material at the reference density, mm³/s.
    pub fn weighted_mrr_mm3_s(&self) -> f64 {
        self.weighted_mrr_mm2 * self.speed_mm_s
    }

    /// Whether the burr cuts nothing.
    pub fn is_air(&self) -> bool {
        self.weighted_mrr_mm2 <= 0.0
    }
}

/// How a burr moves.
#[derive(Debug, Clone, Copy)]
pub(super) struct Feed {
    pub axis: Unit<Vector3<f64>>,
    pub direction: Unit<Vector3<f64>>,
    pub speed_mm_s: f64,
    pub spindle_rpm: f64,
}

impl BurrNodes {
    /// Tabulates the nodes.
    pub fn new(tool: &Tool, disc: &Discretisation) -> Self {
        let count = tool.blades() as usize * disc.n_gamma();
        // blade i at increment j: as a set, σ(m + ½)·2π/count with j = m mod n_gamma
        let azimuth = |m| {
            let psi = tool.spin() * (m as f64 + 0.5) * 2.0 * PI / count as f64;
            [psi.cos(), psi.sin()]
        };
        let ring = |k| {
            let element = disc.element(tool, k);
            let turn = -tool.spin() * tool.lag_rad(element.kappa_rad);
            Ring { element, turn: [turn.cos(), turn.sin()] }
        };
        Self {
            tool: tool.clone(),
            rings: (0..disc.n_kappa()).map(ring).collect(),
            azimuths: (0..count).map(azimuth).collect(),
            increments: disc.n_gamma(),
        }
    }

    /// The tool.
    pub fn tool(&self) -> &Tool {
        &self.tool
    }

    /// Nodes in all, of which about half move forward.
    pub fn count(&self) -> usize {
        self.rings.len() * self.azimuths.len()
    }

    /// Half the width of a node's patch across an edge of the bone, mm: 0.35 of the distance of nodes along a blade,
    /// which halves to thirds the error of counting nodes in or out (tried on crescents of 0.12 to 1 r at all tilts:
    /// 32 × 64 nodes then do as 64 × 128).
    pub(super) fn half_patch_mm(&self) -> f64 {
        0.35 * self.tool.radius_mm() * (self.tool.kappa_max_rad() - self.tool.kappa_min_rad())
            / self.rings.len() as f64
    }

    /// Looks at the bone in every direction that moves forward; `bone` gives the density of what is left there, the kind of
    /// the voxel that holds it (none beyond a body's face, where density still fades), and the part of the node's patch in
    /// which it is left.
    pub(super) fn engage(
        &self,
        feed: &Feed,
        material: &Material,
        mut bone: impl FnMut(&Vector3<f64>) -> Option<(f64, Option<Kind>, f64)>,
    ) -> Engagement {
        let tool_axes = basis::from_z(&feed.axis).into_inner();
        let (x, y, z) =
            (tool_axes.column(0).into_owned(), tool_axes.column(1).into_owned(), feed.axis.into_inner());
        let tooth_mm = self.tool.feed_per_tooth_mm(feed.speed_mm_s, feed.spindle_rpm);
        let around_rad = 2.0 * PI / self.azimuths.len() as f64;
        let has_edge = material.has_edge();
        let mut out = Engagement {
            tool_axes,
            feed: feed.direction,
            speed_mm_s: feed.speed_mm_s,
            spindle_rpm: feed.spindle_rpm,
            cut: vec![Directions::default(); self.increments],
            edge: if has_edge { vec![Directions::default(); self.increments] } else { Vec::new() },
            toward_bone_mm2: Vector3::zeros(),
            mrr_mm2: 0.0,
            weighted_mrr_mm2: 0.0,
            contact_area_mm2: 0.0,
            by_kind_per_mm: Amount::default(),
        };
        let mut cut = vec![[0.0; 3]; self.increments];
        let mut edge = vec![[0.0; 3]; self.increments];
        for Ring { element, turn: [tc, ts] } in &self.rings {
            let (sk, ck) = (element.sin, element.cos);
            let (rx, ry) = (x * *tc + y * *ts, y * *tc - x * *ts);
            let (sx, sy, nz) = (rx * sk, ry * sk, z * -ck);
            let (fx, fy, fz) = (sx.dot(&feed.direction), sy.dot(&feed.direction), nz.dot(&feed.direction));
            // the whole ring looks back: burr above its equator in a plunge
            if fx.hypot(fy) + fz <= GRAZING {
                continue;
            }
            let area_mm2 = self.tool.radius_mm() * element.dz_mm * around_rad;
            let mut found = false;
            let mut increment = 0;
            for &[c, s] in &self.azimuths {
                let slot = increment;
                increment = if increment + 1 == self.increments { 0 } else { increment + 1 };
                let forward = fx * c + fy * s + fz;
                if forward <= GRAZING {
                    continue;
                }
                let Some((density, kind, part)) = bone(&(sx * c + sy * s + nz)) else { continue };
                let w = material.weight(density);
                if w <= 0.0 {
                    continue;
                }
                found = true;
                let w = w * part;
                add(&mut cut[slot], forward * w, c, s);
                if has_edge {
                    add(&mut edge[slot], material.edge_factor(forward * tooth_mm) * w, c, s);
                }
                let rate = forward * area_mm2 * part;
                out.weighted_mrr_mm2 += w * forward * area_mm2;
                out.contact_area_mm2 += area_mm2 * part;
                // volume ends at the body's face, mass where its interpolated density does
                let volume = if kind.is_some() { rate } else { 0.0 };
                out.mrr_mm2 += volume;
                out.by_kind_per_mm.add(kind.unwrap_or(Kind::Material), volume, rate * density);
            }
            if found {
                let ring = RingFrame { turn: [*tc, *ts], sk, ck, spin: self.tool.spin() };
                for (sum, slot) in out.cut.iter_mut().zip(&mut cut) {
                    out.toward_bone_mm2 += ring.outwards(*slot) * area_mm2;
                    ring.expand(sum, std::mem::take(slot), element.dl_mm);
                }
                for (sum, slot) in out.edge.iter_mut().zip(&mut edge) {
                    ring.expand(sum, std::mem::take(slot), element.edge_mm);
                }
            }
        }
        out
    }
}

/// Σq, Σq cos ψ, Σq sin ψ.
#[inline]
fn add(sum: &mut [f64; 3], q: f64, c: f64, s: f64) {
    sum[0] += q;
    sum[1] += q * c;
    sum[2] += q * s;
}

/// From a ring's harmonics to directions in the tool frame.
struct RingFrame {
    turn: [f64; 2],
    sk: f64,
    ck: f64,
    spin: f64,
}

impl RingFrame {
    fn around(&self, [_, qc, qs]: [f64; 3]) -> (f64, f64) {
        let [tc, ts] = self.turn;
        (qc * tc - qs * ts, qs * tc + qc * ts)
    }

    fn outwards(&self, q: [f64; 3]) -> Vector3<f64> {
        let (c, s) = self.around(q);
        Vector3::new(self.sk * c, self.sk * s, -self.ck * q[0])
    }

    fn expand(&self, sum: &mut Directions, q: [f64; 3], length_mm: f64) {
        let (c, s) = self.around(q);
        sum.tangential += Vector3::new(-s, c, 0.0) * (self.spin * length_mm);
        sum.radial += self.outwards(q) * length_mm;
        sum.axial += Vector3::new(self.ck * c, self.ck * s, self.sk * q[0]) * length_mm;
    }
}
