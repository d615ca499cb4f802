//! The sum of [`super::burr_force`], factored over rings of equal κ.
//!
//! A ring's weights q = t w enter through three sums ([`super::sums`]); the trigonometry is tabulated once for a tool. What is
//! left per node is one dot product and, if the node moves forward, one sample of the bone; a tile of nodes without bone takes
//! one sample for all of them. Same nodes, same result to rounding.

use std::f64::consts::PI;

use bonemill_geometry::{basis, cancel};
use nalgebra::{Unit, Vector3};

use super::force::GRAZING;
use super::input::{Discretisation, Element, Material, Tool};
use super::rings::{Circle, Nodes};
use super::sums::{DirectionSums, Harmonics};

/// The reach of a tile of directions that are tested together, as a share of the burr's radius.
pub const TILE_REACH: f64 = 0.25;

/// The bone around a burr, by direction from its centre.
pub trait BoneAround {
    /// Whether there may be bone in a direction that differs from the unit `normal` by at most `reach`. All calls of
    /// [`Self::weight`] until the next call of this function are for such directions.
    fn is_near(&mut self, normal: &Vector3<f64>, reach: f64) -> bool;

    /// w ≥ 0 of the bone in the direction of a unit normal, the mean over the patch around it; 0 where it has been removed.
    fn weight(&mut self, normal: &Vector3<f64>, patch: &Patch) -> f64;
}

/// Bone given by its weight on each patch.
pub struct OverPatches<W>(pub W);

impl<W: FnMut(&Vector3<f64>, &Patch) -> f64> BoneAround for OverPatches<W> {
    fn is_near(&mut self, _: &Vector3<f64>, _: f64) -> bool {
        true
    }

    #[inline]
    fn weight(&mut self, normal: &Vector3<f64>, patch: &Patch) -> f64 {
        (self.0)(normal, patch)
    }
}

/// Bone given by its weight in each direction.
pub struct AtPoints<W>(pub W);

impl<W: FnMut(&Vector3<f64>) -> f64> BoneAround for AtPoints<W> {
    fn is_near(&mut self, _: &Vector3<f64>, _: f64) -> bool {
        true
    }

    #[inline]
    fn weight(&mut self, normal: &Vector3<f64>, _: &Patch) -> f64 {
        (self.0)(normal)
    }
}

/// How a burr is fed: direction, speed and spindle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Feed {
    /// Unit direction of the burr's centre.
    pub direction: Unit<Vector3<f64>>,
    /// Its speed, mm/s.
    pub speed_mm_s: f64,
    /// Spindle speed, rpm.
    pub spindle_rpm: f64,
}

impl Feed {
    /// Of a unit direction, a speed, mm/s, and a spindle speed, rpm.
    pub fn new(direction: &Unit<Vector3<f64>>, speed_mm_s: f64, spindle_rpm: f64) -> Self {
        Self { direction: *direction, speed_mm_s, spindle_rpm }
    }
}

/// Force at any feed speed, for one place, axis and feed direction.
///
/// The cutting part is proportional to the speed. The edge part does not depend on it, exactly for t0 = 0; with t0 > 0 it
/// holds at the nominal speed that the kernel was given.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EngagedForce {
    /// Cutting force on the burr per unit of speed, N/(mm/s).
    pub cut_n_per_mm_s: Vector3<f64>,
    /// Edge force on the burr, N.
    pub edge_n: Vector3<f64>,
    /// Resisting torque of cutting per unit of speed, N mm/(mm/s).
    pub cut_torque_nmm_per_mm_s: f64,
    /// Resisting torque of the edges, N mm.
    pub edge_torque_nmm: f64,
    /// Removal per mm of feed, mm²: everything that has weight.
    pub mrr_mm2: f64,
    /// Removal per mm of feed, mm², weighted with w.
    pub weighted_mrr_mm2: f64,
}

impl EngagedForce {
    /// Nothing is cut.
    pub const ZERO: Self = Self {
        cut_n_per_mm_s: Vector3::new(0.0, 0.0, 0.0),
        edge_n: Vector3::new(0.0, 0.0, 0.0),
        cut_torque_nmm_per_mm_s: 0.0,
        edge_torque_nmm: 0.0,
        mrr_mm2: 0.0,
        weighted_mrr_mm2: 0.0,
    };

    /// Force on the burr at a speed, N; zero at rest, where nothing moves into bone.
    pub fn force_n(&self, speed_mm_s: f64) -> Vector3<f64> {
        if speed_mm_s > 0.0 { self.cut_n_per_mm_s * speed_mm_s + self.edge_n } else { Vector3::zeros() }
    }

    /// Resisting torque at a speed, N mm; zero at rest.
    pub fn torque_nmm(&self, speed_mm_s: f64) -> f64 {
        if speed_mm_s > 0.0 { self.cut_torque_nmm_per_mm_s * speed_mm_s + self.edge_torque_nmm } else { 0.0 }
    }
}

/// The piece of the burr's surface that a sample stands for.
#[derive(Debug, Clone, Copy)]
pub struct Patch<'a> {
    normal: &'a Vector3<f64>,
    shape: PatchShape<'a>,
}

#[derive(Debug, Clone, Copy)]
enum PatchShape<'a> {
    /// Between two rings and two meridians about the axis; `sin` κ.
    Cell { axis: &'a Vector3<f64>, sin: f64, along_mm: f64, around_mm: f64 },
    /// As wide as long, turned somehow.
    Round { side_mm: f64 },
}

impl<'a> Patch<'a> {
    /// A patch as wide as long about a unit normal.
    pub fn round(normal: &'a Vector3<f64>, side_mm: f64) -> Self {
        Self { normal, shape: PatchShape::Round { side_mm } }
    }

    /// Its two sides projected onto a unit direction, mm, not negative.
    #[inline]
    pub fn sides_mm(&self, direction: &Vector3<f64>) -> [f64; 2] {
        match self.shape {
            PatchShape::Cell { axis, sin, along_mm, around_mm } => {
                let (up, out) = (axis.dot(direction), self.normal.dot(direction));
                // e_a = (a − (a·n) n)/sin κ, e_ψ = a × n/sin κ
                let along = (up - axis.dot(self.normal) * out) / sin;
                let around = axis.cross(self.normal).dot(direction) / sin;
                [along_mm * along.abs(), around_mm * around.abs()]
            }
            PatchShape::Round { side_mm } => {
                let out = self.normal.dot(direction);
                let across = side_mm * (1.0 - out * out).max(0.0).sqrt();
                // a square at 30°, between lying along the edge and across it
                [0.866 * across, 0.5 * across]
            }
        }
    }
}

/// The tables of one tool, material and discretisation.
#[derive(Debug, Clone)]
pub struct ForceKernel {
    tool: Tool,
    material: Material,
    sample_radius_mm: f64,
    n_gamma: usize,
    nodes: Nodes,
}

impl ForceKernel {
    /// Tabulates the nodes.
    pub fn new(tool: &Tool, material: &Material, disc: &Discretisation) -> Self {
        Self {
            tool: tool.clone(),
            material: material.clone(),
            sample_radius_mm: tool.radius_mm() + disc.sample_offset_mm(),
            n_gamma: disc.n_gamma(),
            nodes: Nodes::new(tool, disc, TILE_REACH),
        }
    }

    /// Distance from the burr's centre at which the bone is sampled, mm: r + δ.
    pub fn sample_radius_mm(&self) -> f64 {
        self.sample_radius_mm
    }

    /// The tool of the tables.
    pub fn tool(&self) -> &Tool {
        &self.tool
    }

    /// The material of the tables.
    pub fn material(&self) -> &Material {
        &self.material
    }

    /// The force for a shaft `axis` (burr to handpiece) and a feed, both in the frame in which the bone is sampled:
    /// at the centre plus [`Self::sample_radius_mm`] times a unit normal. The feed's speed matters only to an edge term with t0 > 0.
    ///
    /// Bone that gives the mean over each patch makes the sum smooth where it ends in an edge.
    pub fn engaged_force(
        &self,
        axis: &Unit<Vector3<f64>>,
        feed: &Feed,
        bone: &mut impl BoneAround,
    ) -> EngagedForce {
        cancel::poll();
        let Feed { direction: feed, speed_mm_s: nominal_mm_s, spindle_rpm } = feed;
        let (nominal_mm_s, spindle_rpm) = (*nominal_mm_s, *spindle_rpm);
        let basis = basis::from_z(axis).into_inner();
        let (x, y, z) = (basis.column(0).into_owned(), basis.column(1).into_owned(), axis.into_inner());
        let tooth_mm = self.tool.feed_per_tooth_mm(nominal_mm_s, spindle_rpm);
        let mut out = EngagedForce::ZERO;
        let (mut cut, mut edge) = (DirectionSums::default(), DirectionSums::default());
        let spin = self.tool.spin();
        let Nodes { rings, azimuths, tile_size: [high, wide], tiles } = &self.nodes;
        let mut weights = vec![0.0; high * azimuths.len()];
        for (tile, rings) in tiles.iter().zip(rings.chunks(*high)) {
            let circles: Vec<Circle> = rings.iter().map(|ring| ring.circle([&x, &y, &z], feed)).collect();
            // all look back: the burr above its equator in a plunge
            if circles.iter().all(|circle| circle.most_forward() <= GRAZING) {
                continue;
            }
            weights.fill(0.0);
            let mut found = false;
            let middles = tile.circle([&x, &y, &z], feed);
            for (t, places) in azimuths.chunks(*wide).enumerate() {
                let [c, s] = places[0];
                if middles.forward(c, s) <= GRAZING - tile.reach
                    || !bone.is_near(&middles.normal(c, s), tile.reach)
                {
                    continue;
                }
                for ((ring, circle), weights) in
                    rings.iter().zip(&circles).zip(weights.chunks_mut(azimuths.len()))
                {
                    let shape = self.patch_shape(axis, &ring.element);
                    for (&[c, s], weight) in places.iter().zip(&mut weights[t * wide..]) {
                        if circle.forward(c, s) > GRAZING {
                            let n = circle.normal(c, s);
                            *weight = bone.weight(&n, &Patch { normal: &n, shape });
                            found |= *weight > 0.0;
                        }
                    }
                }
            }
            if !found {
                continue;
            }
            for ((ring, circle), weights) in rings.iter().zip(&circles).zip(weights.chunks(azimuths.len())) {
                let (mut q_cut, mut q_edge, mut q_area) = <(Harmonics, Harmonics, f64)>::default();
                for (&[c, s], &w) in azimuths.iter().zip(weights) {
                    if w > 0.0 {
                        let forward = circle.forward(c, s);
                        q_cut.add(forward * w, [c, s]);
                        q_edge.add(self.material.edge_factor(forward * tooth_mm) * w, [c, s]);
                        q_area += forward;
                    }
                }
                let element = &ring.element;
                cut.add(ring, &q_cut, element.dl_mm, spin);
                edge.add(ring, &q_edge, element.edge_mm, spin);
                out.mrr_mm2 += q_area * element.dz_mm;
                out.weighted_mrr_mm2 += q_cut.sum() * element.dz_mm;
            }
        }
        let per_turn = 1.0 / self.n_gamma as f64;
        let per_speed = self.tool.feed_per_tooth_mm(1.0, spindle_rpm) * per_turn;
        let area = self.tool.radius_mm() * 2.0 * PI / azimuths.len() as f64;
        let (k_n_mm2, k_edge_n_mm) = (self.material.k_n_mm2(), self.material.k_edge_n_mm());
        out.cut_n_per_mm_s = basis * cut.force(k_n_mm2) * per_speed;
        out.cut_torque_nmm_per_mm_s = cut.torque(k_n_mm2[0], &self.tool) * per_speed;
        if self.material.has_edge() && tooth_mm > 0.0 {
            out.edge_n = basis * edge.force(k_edge_n_mm) * per_turn;
            out.edge_torque_nmm = edge.torque(k_edge_n_mm[0], &self.tool) * per_turn;
        }
        out.mrr_mm2 *= area;
        out.weighted_mrr_mm2 *= area;
        out
    }

    fn patch_shape<'a>(&self, axis: &'a Vector3<f64>, element: &Element) -> PatchShape<'a> {
        PatchShape::Cell {
            axis,
            sin: element.sin,
            along_mm: element.dz_mm / element.sin,
            around_mm: self.tool.radius_mm() * element.sin * 2.0 * PI / self.nodes.azimuths.len() as f64,
        }
    }
}
