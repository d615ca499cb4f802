//! The engine: takes poses, computes forces and removes bone.
//!
//! A step goes straight from the previous pose to the next. The force is computed at its end, in the bone before the step
//! (docs/force-model.md 5); then the swept capsule is removed. A step in which the shank touches bone is reported and not
//! made. A refused pose changes nothing.
//!
//! Poses known beforehand are processed in batches: all steps of a batch read the same lattice, and each reads its own part
//! of the trail, so they are computed in parallel. The division into batches is fixed, so results do not depend on the
//! number of threads.

use bonemill_cutting::burr::{Discretisation, Feed, Material, Tool, checked, direction};
use bonemill_cutting::cutter::ShankCylinder;
use bonemill_geometry::capsule::segment_distance_squared;
use bonemill_geometry::{Point, Work, cancel};
use nalgebra::{Unit, Vector3};
use rayon::prelude::*;

use super::bone::{Amount, Bone, VoxelKind};
use super::engagement::{BurrNodes, Engagement, Surroundings};
use super::error::EngineError;
use super::lattice::Lattice;
use super::model::{CutForce, ForceModel};
use super::shank::ShankContact;
use super::shank_clearance::ShankClearance;
use super::swept::SweptPiece;
use super::trail::Trail;

/// Poses farther away than this are refused, mm, because coordinates in cells would be inexact.
const MOST_MM: f64 = 1e5;
/// The lattice is updated to this far behind the burr, cells. With 10 cells per radius, the burr's front is then more than
/// half a patch away from the removed volume, so that the burr's own surface never counts as an edge.
const LAG_CELLS: f64 = 2.5;
/// The lattice is updated in stretches of at least this length, cells.
const STRETCH_CELLS: f64 = 2.0;
/// Largest deviation of a piece of the trail from the burr's path, cells.
const BENT_CELLS: f64 = 0.004;

/// Position of the burr and direction of its shaft.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// The burr's centre.
    pub center: Point<Work>,
    /// Unit direction from the burr to the handpiece.
    pub axis: Unit<Vector3<f64>>,
}

impl Pose {
    /// A pose; `axis` need not be a unit vector.
    ///
    /// # Errors
    /// [`EngineError::Pose`] for a centre that is not finite or too far away, [`EngineError::Model`] for an axis of length 0.
    pub fn new(center: Point<Work>, axis: Vector3<f64>) -> Result<Self, EngineError> {
        if !center.coords.iter().all(|c| c.abs() <= MOST_MM) {
            return Err(EngineError::Pose { center_mm: center.coords.into(), most_mm: MOST_MM });
        }
        Ok(Self { center, axis: direction("shaft axis", axis)? })
    }
}

/// A pose and the duration of the step to it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Move {
    /// Where the step ends.
    pub to: Pose,
    /// Duration, s.
    pub seconds: f64,
    /// The burr's velocity at the end, mm/s, for which the force is computed; `None`: the step's mean. The two differ where a path
    /// is curved or the speed changes.
    pub end_velocity_mm_s: Option<Vector3<f64>>,
}

impl Move {
    /// A straight step at constant speed.
    pub fn straight(to: Pose, seconds: f64) -> Self {
        Self { to, seconds, end_velocity_mm_s: None }
    }
}

/// The outcome of a step.
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// Force and torque on the burr.
    pub force: CutForce,
    /// Removal rate at the step's end, mm³/s.
    pub mrr_mm3_s: f64,
    /// The same in equivalent volume of material at the reference density, mm³/s.
    pub weighted_mrr_mm3_s: f64,
    /// Surface that moves into bone, mm².
    pub contact_area_mm2: f64,
    /// Amount removed by the step, estimated as the surface's rate at its end times its length. The exact sum over all steps is
    /// [`Engine::removed`].
    pub removed: Amount,
    /// Contact of the shank with bone; then the step was not made, and all other values are zero.
    pub contact: Option<ShankContact>,
}

impl Step {
    /// A step that cuts nothing.
    pub(super) fn nothing(contact: Option<ShankContact>) -> Self {
        Self {
            force: CutForce::default(),
            mrr_mm3_s: 0.0,
            weighted_mrr_mm3_s: 0.0,
            contact_area_mm2: 0.0,
            removed: Amount::default(),
            contact,
        }
    }

    fn of(met: &Engagement, force: CutForce, length_mm: f64) -> Self {
        let mut removed = Amount::default();
        for kind in VoxelKind::ALL {
            let [volume, mass] =
                [&met.by_kind_per_mm.volume_mm3, &met.by_kind_per_mm.mass_mg].map(|a| a[kind as usize]);
            removed.add(kind, volume * length_mm, mass * length_mm);
        }
        Self {
            force,
            mrr_mm3_s: met.mrr_mm3_s(),
            weighted_mrr_mm3_s: met.weighted_mrr_mm3_s(),
            contact_area_mm2: met.contact_area_mm2,
            removed,
            contact: None,
        }
    }
}

/// Burr, shank and resolution of a simulation.
#[derive(Debug, Clone)]
pub struct EngineSpec {
    /// The burr.
    pub tool: Tool,
    /// Coefficients and density law of the bone.
    pub material: Material,
    /// Nodes of the force sum.
    pub disc: Discretisation,
    /// Spindle speed, rpm.
    pub spindle_rpm: f64,
    /// The shank, from the burr outwards; if empty, contacts are not tested.
    pub shank: Vec<ShankCylinder>,
    /// Number of the lattice's cells along the burr's radius.
    pub cells_per_radius: f64,
}

impl EngineSpec {
    /// Default number of cells per radius. docs/results.md, "Data structures of the engine", has error and time for other values.
    pub const CELLS_PER_RADIUS: f64 = 10.0;
}

/// The state of a simulation.
pub struct Engine<'a, T, M> {
    lattice: Lattice<'a, T>,
    trail: Trail,
    nodes: BurrNodes,
    model: M,
    spec: EngineSpec,
    pose: Pose,
    removed: Amount,
    watch: ShankClearance,
    /// Time of stopped steps, which is added to the next step that is made, s.
    waited_s: f64,
}

impl<'a, T: Copy + Into<f64> + Sync, M: ForceModel> Engine<'a, T, M> {
    /// A simulation whose burr starts at `start`; bone inside the burr there is removed.
    ///
    /// # Errors
    /// [`EngineError::TooFine`], or [`EngineError::Model`] for an impossible spindle or shank.
    pub fn new(bone: Bone<'a, T>, spec: EngineSpec, model: M, start: Pose) -> Result<Self, EngineError> {
        checked("spindle speed, rpm", spec.spindle_rpm, |n| n > 0.0 && n <= 1e6, "above 0, at most 1e6")?;
        for c in &spec.shank {
            checked("shank start, mm", c.from_mm, |v| v >= 0.0, "0 or more")?;
            checked("shank end, mm", c.to_mm, |v| v >= c.from_mm && v <= 1e4, "from its start to 1e4")?;
            checked("shank radius, mm", c.radius_mm, |v| v > 0.0 && v <= 1e3, "above 0, at most 1e3")?;
        }
        let lattice = Lattice::new(bone, spec.tool.radius_mm(), spec.cells_per_radius)?;
        let tolerance_mm = BENT_CELLS * lattice.spacing_mm();
        let r = spec.tool.radius_mm();
        let half_mm = BurrNodes::half_patch_mm(&spec.tool, &spec.disc);
        let tile_reach = lattice.longest_reach_mm(half_mm) / (r + spec.disc.sample_offset_mm());
        let nodes = BurrNodes::new(&spec.tool, &spec.disc, tile_reach);
        let watch = ShankClearance::new(&spec.shank, r);
        Ok(Self {
            trail: Trail::new(start.center, tolerance_mm),
            lattice,
            nodes,
            model,
            spec,
            pose: start,
            removed: Amount::default(),
            watch,
            waited_s: 0.0,
        })
    }

    /// Where the burr is.
    pub fn pose(&self) -> Pose {
        self.pose
    }

    /// The remaining bone.
    pub fn lattice(&self) -> &Lattice<'a, T> {
        &self.lattice
    }

    /// The remaining bone, for a viewer that reads the changed surfaces.
    pub fn lattice_mut(&mut self) -> &mut Lattice<'a, T> {
        &mut self.lattice
    }

    /// The bone, density law and burr of this simulation.
    pub fn spec(&self) -> &EngineSpec {
        &self.spec
    }

    /// Amount removed from the lattice: everything that the burr swept, except along the last few cells of its path. After
    /// [`Engine::settle`] it is complete.
    pub fn removed(&self) -> &Amount {
        &self.removed
    }

    /// Length of the last part of the path that is not yet removed from the lattice, mm.
    pub fn pending_mm(&self) -> f64 {
        self.trail.length_mm()
    }

    /// Removes the whole path from the lattice.
    pub fn settle(&mut self) {
        let pieces = self.trail.take_all_but(0.0);
        self.remove(&pieces);
    }

    /// Goes straight to a pose and cuts.
    ///
    /// # Errors
    /// [`EngineError`] for a pose or time that is not finite, a negative time, or a time of 0 for a step of some length; nothing
    /// changes then.
    pub fn step(&mut self, to: Move) -> Result<Step, EngineError> {
        self.step_yielding(&to, |_| Vector3::zeros())
    }

    /// As [`Engine::step`], with a burr that deflects: `yields` returns the deflection in work, mm, for the force at the step's
    /// end.
    ///
    /// # Errors
    /// As [`Engine::step`], also when the deflection is not finite.
    pub fn step_yielding(
        &mut self,
        to: &Move,
        yields: impl FnOnce(&CutForce) -> Vector3<f64>,
    ) -> Result<Step, EngineError> {
        let met = self.meet(to)?;
        let force = met.as_ref().map(|met| self.model.force(met)).unwrap_or_default();
        let end = Pose { center: to.to.center + yields(&force), axis: to.to.axis };
        check(&self.pose, &Move { to: end, ..*to })?;
        let length_mm = (end.center - self.pose.center).norm();
        let before = self.trail.clone();
        self.trail.extend(end.center.coords);
        if let Some(contact) = self.watch.contact(&self.lattice, &self.trail, &self.pose, &end) {
            self.trail = before;
            self.waited_s += to.seconds;
            return Ok(Step::nothing(Some(contact)));
        }
        self.pose = end;
        self.waited_s = 0.0;
        self.follow(STRETCH_CELLS);
        Ok(met.map_or_else(|| Step::nothing(None), |met| Step::of(&met, force, length_mm)))
    }

    /// The engagement at the end of a step, without making the step; `None` where the burr does not move.
    ///
    /// # Errors
    /// As [`Engine::step`].
    pub fn meet(&self, to: &Move) -> Result<Option<Engagement>, EngineError> {
        check(&self.pose, to)?;
        Ok(self.engage(&self.pose, to, &self.trail, self.waited_s))
    }

    /// Makes steps whose poses are all known, on all threads. A step stopped by the shank is left out, and the next one starts
    /// from where the burr was and has the time of both.
    ///
    /// # Errors
    /// As [`Engine::step`], for the first refused step; then no step of the batch is made.
    pub fn steps(&mut self, moves: &[Move]) -> Result<Vec<Step>, EngineError> {
        let mut from = self.pose;
        for to in moves {
            check(&from, to)?;
            from = to.to;
        }
        let mut steps = Vec::with_capacity(moves.len());
        let mut alone = false;
        while steps.len() < moves.len() {
            let rest = &moves[steps.len()..];
            if alone {
                let step = self.step(rest[0])?;
                alone = step.contact.is_some();
                steps.push(step);
            } else {
                let made = self.together(rest);
                alone = made.len() < rest.len() || made.last().is_some_and(|s| s.contact.is_some());
                steps.extend(made);
            }
        }
        Ok(steps)
    }

    /// Makes steps up to and including the first that the shank stops.
    fn together(&mut self, moves: &[Move]) -> Vec<Step> {
        // the trail before each step, and after the last
        let mut trails = vec![self.trail.clone()];
        for to in moves {
            let mut trail = trails[trails.len() - 1].clone();
            trail.extend(to.to.center.coords);
            trails.push(trail);
        }
        let start = self.pose;
        let from = |n: usize| if n == 0 { start } else { moves[n - 1].to };
        let waited_s = self.waited_s;
        let (lattice, mut watch) = (&self.lattice, self.watch.clone());
        // both read the bone as it is before the batch, and neither needs the other's result
        let (mut steps, stopped) = rayon::join(
            || {
                let one = |n: usize| {
                    cancel::poll();
                    let to = &moves[n];
                    let met = self.engage(&from(n), to, &trails[n], if n == 0 { waited_s } else { 0.0 });
                    let length_mm = (to.to.center - from(n).center).norm();
                    met.map_or_else(
                        || Step::nothing(None),
                        |met| Step::of(&met, self.model.force(&met), length_mm),
                    )
                };
                (0..moves.len()).into_par_iter().map(one).collect::<Vec<Step>>()
            },
            || {
                moves
                    .iter()
                    .enumerate()
                    .find_map(|(n, to)| Some((n, watch.contact(lattice, &trails[n + 1], &from(n), &to.to)?)))
            },
        );
        self.watch = watch;
        let made = stopped.as_ref().map_or(moves.len(), |(n, _)| *n);
        self.trail = trails.swap_remove(made);
        if made > 0 {
            self.pose = moves[made - 1].to;
            self.waited_s = 0.0;
        }
        if let Some((n, contact)) = stopped {
            steps.truncate(n);
            steps.push(Step::nothing(Some(contact)));
            self.waited_s += moves[n].seconds;
        }
        self.follow(0.0);
        steps
    }

    /// Updates the lattice to the lag once the path is `stretch` cells longer than the lag.
    fn follow(&mut self, stretch: f64) {
        let s = self.lattice.spacing_mm();
        let mut pieces = Vec::new();
        if self.trail.length_mm() >= (LAG_CELLS + stretch) * s {
            pieces = self.trail.take_all_but(LAG_CELLS * s);
        }
        if self.trail.is_crowded() {
            pieces.extend(self.trail.thin_out());
        }
        self.remove(&pieces);
    }

    fn remove(&mut self, pieces: &[super::carve::Piece]) {
        if !pieces.is_empty() {
            let lost = self.lattice.remove(pieces, self.spec.tool.radius_mm());
            self.removed.merge(&lost);
        }
    }

    /// The feed at the end of a step; `None` where the burr does not move. A step after a stopped one does not begin where it should,
    /// so that its mean velocity counts.
    fn feed(&self, from: &Pose, to: &Move, waited_s: f64) -> Option<Feed> {
        let unit = |v: Vector3<f64>| Unit::try_new(v, 0.0).filter(|u| u.iter().all(|v| v.is_finite()));
        let way = to.to.center - from.center;
        let chord = unit(way)?;
        let (direction, speed_mm_s) = match to.end_velocity_mm_s.filter(|_| waited_s == 0.0) {
            Some(velocity) => (unit(velocity).unwrap_or(chord), velocity.norm()),
            None => (chord, way.norm() / (to.seconds + waited_s)),
        };
        Some(Feed { direction, speed_mm_s, spindle_rpm: self.spec.spindle_rpm })
    }

    /// The engagement at the step's end, in the bone before the step.
    fn engage(&self, from: &Pose, to: &Move, trail: &Trail, waited_s: f64) -> Option<Engagement> {
        let feed = self.feed(from, to, waited_s)?;
        let r = self.spec.tool.radius_mm();
        let center = to.to.center.coords;
        let half_mm = BurrNodes::half_patch_mm(&self.spec.tool, &self.spec.disc);
        // only the stretch within the lattice's lag is certainly the burr's own surface
        let sample_mm = r + self.spec.disc.sample_offset_mm();
        let reach2 = (2.0 * r + half_mm).powi(2);
        let near: Vec<SweptPiece> = trail
            .newest(LAG_CELLS * self.lattice.spacing_mm())
            .into_iter()
            .filter(|piece| {
                !piece.leads_to(&center, &feed.direction)
                    && segment_distance_squared(&center, &piece.from, &piece.to) < reach2
            })
            .map(|piece| SweptPiece::new(&piece, &center, sample_mm))
            .collect();
        let half_cells = half_mm / self.lattice.spacing_mm();
        let lattice = &self.lattice;
        let way = center - from.center.coords;
        let around = Seen { lattice, near: &near, center, way, radius_mm: r, sample_mm, half_mm, half_cells };
        Some(self.nodes.engage(&to.to.axis, &feed, &self.spec.material, &around))
    }
}

/// The bone around a burr: the lattice without the newest stretch of the path.
struct Seen<'a, 'b, T> {
    lattice: &'b Lattice<'a, T>,
    near: &'b [SweptPiece],
    center: Vector3<f64>,
    /// The step that ends at the centre; it has swept what lies behind.
    way: Vector3<f64>,
    radius_mm: f64,
    /// Distance from the centre at which a node samples the bone, mm.
    sample_mm: f64,
    /// Half the width of a patch, mm and cells.
    half_mm: f64,
    half_cells: f64,
}

impl<T: Copy + Into<f64> + Sync> Surroundings for Seen<'_, '_, T> {
    #[inline]
    fn is_open(&self, normal: &Vector3<f64>, reach: f64) -> bool {
        let index = self.lattice.bone().index(&(self.center + normal * self.sample_mm));
        self.lattice.is_open_around(&index, reach * self.sample_mm, self.half_mm)
    }

    #[inline]
    fn bone(&self, normal: &Vector3<f64>) -> Option<(f64, Option<VoxelKind>, f64)> {
        if normal.dot(&self.way) <= 0.0 {
            return None;
        }
        let bone = self.lattice.bone();
        let index = bone.index(&(self.center + normal * self.sample_mm));
        let mut part = self.lattice.patch_left(&index, normal, self.half_cells);
        if part <= 0.0 {
            return None;
        }
        for piece in self.near {
            part = piece.part_outside(normal, self.radius_mm, self.half_mm).min(part);
            if part <= 0.0 {
                return None;
            }
        }
        // last, because reading the images takes the longest
        let density = bone.met_at(&index);
        if density <= 0.0 {
            return None;
        }
        Some((density, bone.nearest(&index).map(|(_, kind)| kind), part))
    }
}

/// Checks that a step can be made.
fn check(from: &Pose, to: &Move) -> Result<(), EngineError> {
    Pose::new(to.to.center, to.to.axis.into_inner())?;
    let stands = from.center == to.to.center;
    let ok = |s: f64| s > 0.0 || (s == 0.0 && stands);
    checked("time of a step, s", to.seconds, ok, "positive; 0 only in place")?;
    Ok(())
}
