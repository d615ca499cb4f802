//! Haptic steps of a drill, a reamer or any other solid of revolution that plunges: tip positions in, thrust and torque out.
//!
//! The cutter moves without tilting; its tip goes straight from step to step. Along one line what it has removed is its solid at the
//! deepest tip, so the bone in front of its edges is intact as soon as it goes deeper, and there is none while it goes back and forth
//! above: exact, whatever the length of the steps. What earlier lines removed is kept as distances on a sparse lattice ([`Holes`]),
//! whose cells follow the cutter's radius; an element that reaches into such a hole is engaged in part.
//!
//! The force is the mean over a turn of equation (7) of Faieghi et al. with each element's load times the density weight of the bone
//! half a chip in front of it ([`bonemill_cutting::edge`]). A step across the axis cuts nothing in this model: the lattice takes the
//! solid at the new place, and no force is given for it.
//!
//! Left out: bending, wandering of the tip, what rubs at the wall.

mod holes;
mod radial;
mod surface;
#[cfg(test)]
mod tests;

use std::f64::consts::TAU;

use bonemill_cutting::cutter::SolidOfRevolution;
use bonemill_cutting::edge::{CutterForce, EdgeLoads};
use bonemill_geometry::{Point, Volume, Work};
use nalgebra::{Rotation3, Vector3};

pub use holes::Holes;
use radial::RadialDistances;
pub use surface::BrickSamples;

use crate::EngineError;

/// Cells of the lattice along the cutter's radius.
const CELLS_PER_RADIUS: f64 = 10.0;
/// The lattice takes the cutter's solid at least every so many cells of its way.
const STRETCH_CELLS: f64 = 0.5;
/// The tip leaves its line where it is farther from it than this part of a cell.
const SAME_LINE: f64 = 1e-3;

/// A cutter that plunges, and how its force is summed.
#[derive(Debug, Clone)]
pub struct PlungeSpec<'c> {
    /// What it sweeps when it turns.
    pub solid: &'c SolidOfRevolution,
    /// The loads of its elements at the feed and speed of the plunge.
    pub loads: &'c EdgeLoads,
    /// Angles between one copy of the edges and the next.
    pub turns: usize,
    /// How far in front of an edge the bone is looked at, mm: half a chip.
    pub ahead_mm: f64,
    /// From work to the tool's axes.
    pub tool_from_work: Rotation3<f64>,
}

/// One element at one angle: where, and what it adds per unit of weight; work axes.
#[derive(Debug, Clone, Copy)]
struct Node {
    offset_mm: Vector3<f64>,
    /// The same in tool axes.
    in_tool_mm: Vector3<f64>,
    force_n: Vector3<f64>,
    moment_nmm: Vector3<f64>,
}

/// The state of a plunge.
pub struct PlungeEngine<'a, T> {
    density_g_cm3: &'a Volume<T, Work>,
    nodes: Vec<Node>,
    holes: Holes,
    distances: RadialDistances,
    tool_from_work: Rotation3<f64>,
    /// Tip on the present line, tool axes: the deepest, and where the lattice was last.
    deepest_mm: Vector3<f64>,
    taken_mm: Vector3<f64>,
}

impl<'a, T: Copy + Into<f64> + Sync> PlungeEngine<'a, T> {
    /// A cutter whose tip appears at `tip`; bone within it is gone.
    ///
    /// # Errors
    /// [`EngineError::TooFine`] where the lattice over the bone would be too large.
    pub fn new(
        density_g_cm3: &'a Volume<T, Work>,
        spec: &PlungeSpec<'_>,
        tip: Point<Work>,
    ) -> Result<Self, EngineError> {
        let cell_mm = spec.solid.max_radius_mm() / CELLS_PER_RADIUS;
        let tool = spec.tool_from_work;
        let mut engine = Self {
            density_g_cm3,
            nodes: nodes(spec),
            holes: Holes::new(density_g_cm3.grid(), &tool, cell_mm)?,
            distances: RadialDistances::new(spec.solid, cell_mm),
            tool_from_work: tool,
            deepest_mm: tool * tip.coords,
            taken_mm: tool * tip.coords,
        };
        engine.holes.take(&engine.distances, &engine.taken_mm, f64::INFINITY);
        Ok(engine)
    }

    /// What is gone, as distances: behind the present tip by less than a cell.
    pub fn holes(&self) -> &Holes {
        &self.holes
    }

    /// The bricks whose surface changed since the last call, for display; behind the present tip by less than a cell. Another thread can
    /// mesh them while this one goes on.
    pub fn take_touched(&mut self) -> Vec<BrickSamples> {
        self.holes.take_touched(self.tool_from_work.inverse())
    }

    /// Goes straight to a tip position: what the cutter feels at its end, with the weight of bone by its density, g/cm³; work axes,
    /// moment about the tip.
    pub fn step(&mut self, tip: Point<Work>, weight: impl Fn(f64) -> f64) -> CutterForce {
        let to = self.tool_from_work * tip.coords;
        let aside_mm = (to - self.deepest_mm).xy().norm();
        if aside_mm > SAME_LINE * self.holes.cell_mm() {
            self.settle();
            (self.deepest_mm, self.taken_mm) = (to, to);
            self.holes.take(&self.distances, &to, f64::INFINITY);
            return CutterForce::default();
        }
        if to.z >= self.deepest_mm.z {
            return CutterForce::default();
        }
        let force = self.force(tip, &to, weight);
        self.deepest_mm = to;
        if self.taken_mm.z - to.z >= STRETCH_CELLS * self.holes.cell_mm() {
            self.take_deepest();
        }
        force
    }

    /// Takes the whole way out of the lattice.
    pub fn settle(&mut self) {
        if self.deepest_mm.z < self.taken_mm.z {
            self.take_deepest();
        }
    }

    fn take_deepest(&mut self) {
        let way_mm = self.taken_mm.z - self.deepest_mm.z;
        self.holes.take(&self.distances, &self.deepest_mm, way_mm);
        self.taken_mm = self.deepest_mm;
    }

    fn force(&self, tip: Point<Work>, to: &Vector3<f64>, weight: impl Fn(f64) -> f64) -> CutterForce {
        let grid = self.density_g_cm3.grid();
        let mut sum = CutterForce::default();
        for node in &self.nodes {
            let index = grid.continuous_index(tip + node.offset_mm);
            let density = self.density_g_cm3.trilinear_at(index, 0.0);
            if density <= 0.0 {
                continue;
            }
            let own = node.in_tool_mm + to;
            // the lattice holds the present line's own surface: what lies below the place where it was last is not there
            let left = self.holes.left_outside(&own, &self.distances, &self.taken_mm);
            let w = left * weight(density);
            sum.force_n += node.force_n * w;
            sum.moment_nmm += node.moment_nmm * w;
        }
        sum
    }
}

/// Every element at every angle, as a mean over a turn.
fn nodes(spec: &PlungeSpec<'_>) -> Vec<Node> {
    let work_from_tool = spec.tool_from_work.inverse();
    let angles = spec.loads.copies() as usize * spec.turns.max(1);
    let share = f64::from(spec.loads.copies()) / angles as f64;
    let ahead = Vector3::z() * spec.ahead_mm;
    let turned =
        |n: usize| Rotation3::from_axis_angle(&Vector3::z_axis(), TAU * (n as f64 + 0.5) / angles as f64);
    (0..angles)
        .flat_map(|n| {
            let turn = turned(n);
            spec.loads.loads().iter().map(move |load| {
                let at = turn * load.position_mm.coords;
                let force = turn * load.in_tool_n * share;
                Node {
                    offset_mm: work_from_tool * (at - ahead),
                    in_tool_mm: at - ahead,
                    force_n: work_from_tool * force,
                    moment_nmm: work_from_tool * at.cross(&force),
                }
            })
        })
        .collect()
}
