//! Tests which shaft directions are free at a waypoint (D II-A).
//!
//! The shank at axis a is free before move i exactly when it contains no solid voxel with T ≥ i, that is, when the maximum
//! of T over the shank's volume is below i. For every voxel, the maximum over a ball of the shank's radius is computed once.
//! Then the volume becomes a line, and one ray march along the axis tests a direction.
//!
//! A march reads the nearest voxel at steps of one voxel. The ball is enlarged by the error of this, so the answer "free" is
//! certain. Where the answer is not "free", the voxels around that part of the march are tested one by one, each by its
//! eighths ([`EighthTimes`]): any bone in a voxel counts. Thick cylinders (the handpiece) use a coarser field, in which a
//! block is solid as long as any voxel in it is. Beyond the planning grid, `FarObstacles` holds bone and structures.
//!
//! The arm rounds corners within a tolerance, and between two tested places the shank sweeps a little more than its volume
//! at either place. So the shank is tested wider by both amounts ([`aside_mm`]). A whole move, during which the shank turns,
//! is tested at places that far apart, and at closer places where the answer is not certain (`turn`).
//!
//! Most of a march through free space is far from everything. Blocks of voxels, each with its latest time, tell how many
//! steps can be skipped (`march`). Where the answer is not "free", the rest of the march is tested with a ball so small that
//! its answer "blocked" is certain; only directions between the two are tested by eighths. This does not change the result.
//!
//! A ball at a thick cylinder's flat front reaches beyond the front, from the handpiece down to the skull. If only that part
//! of a march is blocked, the front is tested again with balls of the first cylinder's radius.

mod eighth_times;
mod eighths;
mod field;
mod front;
mod march;
mod solid;
mod turn;

pub use self::eighth_times::EighthTimes;
pub use self::solid::ShankObstacles;
pub use self::turn::Turn;

use crate::scene::Scene;
pub use bonemill_cutting::cutter::ShankCylinder;
use bonemill_cutting::stock::voxels::voxels_apart;
use bonemill_geometry::{Point, Work, basis, cancel};
use bonemill_robot::timelaw::CornerTolerance;
use nalgebra::Vector3;
use rayon::prelude::*;

use self::eighths::Eighths;
use self::field::{Bounds, SOLID, TimeField};
use self::front::Front;
use self::march::Marched;
use bonemill_robot::timelaw::TRAJECTORY_TOLERANCE_MM;

/// What blocks the shank.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Blocked {
    /// Bone of the target that is removed by this move or a later one.
    NotYetRemoved {
        /// Distance along the axis, mm.
        at_mm: f64,
    },
    /// Bone outside the target, a structure, or bone of the target that no move removes.
    Obstacle {
        /// Distance along the axis, mm.
        at_mm: f64,
    },
}

/// Distance that the shank moves between two tested places, mm.
pub const STRIDE_MM: f64 = 0.3;

/// By how much the shank is widened for the volume that it sweeps between those places, mm; by more where it is thin.
const BETWEEN_MM: f64 = 0.02;

/// Largest sideways deviation of a shank of radius `radius_mm` from its planned place, at a distance from the burr's centre,
/// mm. It includes the volume swept between tested places: a cylinder of radius ρ that moves sideways by d sweeps
/// √(ρ² + d²/4) − ρ beyond its volumes at both ends.
pub fn aside_mm(radius_mm: f64, along_mm: f64) -> f64 {
    TRAJECTORY_TOLERANCE_MM + between_mm(radius_mm) + CornerTolerance::default().axis_rad * along_mm
}

/// The part of [`aside_mm`] for the volume swept between tested places, mm.
fn between_mm(radius_mm: f64) -> f64 {
    BETWEEN_MM.max(across_mm(radius_mm, 0.5 * STRIDE_MM) - radius_mm)
}

/// √(a² + b²), without a call to `hypot`, because it is computed for every eighth of a voxel.
#[inline]
fn across_mm(a_mm: f64, b_mm: f64) -> f64 {
    (a_mm * a_mm + b_mm * b_mm).sqrt()
}

/// Coarser fields have at least this many voxels across a segment's radius.
const VOXELS_PER_RADIUS: f64 = 8.0;

/// A shaft along `axis` (unit, work) while move `index` ends at `center`.
#[derive(Debug, Clone, Copy)]
struct PosedShank<'a> {
    index: u32,
    center: Point<Work>,
    axis: &'a Vector3<f64>,
    /// By how much a thin cylinder is tested narrower than [`aside_mm`] says.
    narrower: Narrower,
}

/// A reduction of the width that [`aside_mm`] adds to a thin cylinder.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Narrower {
    /// Share of the swept volume's width that is left out, for places that are closer together.
    between_share: f64,
    /// Further reduction of the radius, mm.
    by_mm: f64,
}

impl Narrower {
    /// No reduction.
    const NOT: Self = Self { between_share: 0.0, by_mm: 0.0 };

    /// The width to add to a shank of that radius, mm.
    fn aside_mm(&self, radius_mm: f64, along_mm: f64) -> f64 {
        aside_mm(radius_mm, along_mm) - self.between_share * between_mm(radius_mm) - self.by_mm
    }
}

/// Side of the blocks in which groups of a front's balls are looked up, voxels.
const AROUND_VOXELS: usize = 2;

/// Number of steps of a march that are tested by eighths at a time.
const PART: usize = 4;

/// Access for every waypoint of one path.
#[derive(Debug)]
pub struct Access<'a> {
    scene: &'a Scene,
    /// The exact test where balls leave a doubt; `None` for a comparison of paths, which uses the balls' answer.
    eighths: Option<Eighths<'a>>,
    near_box: Bounds,
    /// The box beyond the planning grid in which obstacles are known; `None` if none are.
    far_box: Option<Bounds>,
    segments: Vec<Segment>,
    /// The latest time of the first cylinder's field within `around_mm` of a place, used for groups of a front's balls; `None`
    /// without a front.
    around: Option<TimeField>,
    around_mm: f64,
}

#[derive(Debug)]
struct Segment {
    cylinder: ShankCylinder,
    /// T dilated by the cylinder's radius. Where it is early enough, the cylinder is free.
    outer: Marched,
    /// T dilated by less. Where it is late and more than `inner_mm` from the cylinder's ends, the cylinder is blocked. `None`
    /// for a thin cylinder and for one with a front.
    inner: Option<Marched>,
    inner_mm: f64,
    /// How far a march's ball extends ahead of its centre, mm.
    reach_mm: f64,
    /// Balls of the first cylinder's radius that cover this cylinder's front; `None` for a thin cylinder.
    front: Option<Front>,
}

impl<'a> Access<'a> {
    /// Dilates the removal time once per cylinder. `eighths` are the removal times of the path, on the scene's `solid`.
    pub fn new(
        scene: &'a Scene,
        solid: &'a ShankObstacles,
        eighths: EighthTimes,
        shank: &[ShankCylinder],
    ) -> Self {
        let eighths = Eighths::new(solid, eighths);
        let segments = segments(&eighths.latest, shank, Segment::certain);
        let access = Self::of(scene, eighths.latest.bounds(), segments);
        Self { eighths: Some(eighths), ..access }
    }

    /// A coarser test for a comparison of paths: bone is removed by whole voxels, at `removal_time`, and a thin cylinder is
    /// blocked by anything that a ball of its radius meets along its axis, with an error of up to one voxel to either side.
    /// Thick cylinders are tested as for a plan.
    pub fn draft(
        scene: &'a Scene,
        solid: &ShankObstacles,
        removal_time: &[u32],
        shank: &[ShankCylinder],
    ) -> Self {
        let latest = TimeField::of_voxels(solid, removal_time);
        Self::of(scene, latest.bounds(), segments(&latest, shank, Segment::nearly))
    }

    fn of(scene: &'a Scene, near_box: Bounds, segments: Vec<Segment>) -> Self {
        let fronts_mm = segments.iter().filter_map(|segment| segment.front.as_ref()).map(Front::reach_mm);
        let around_mm = fronts_mm.fold(0.0, f64::max);
        let thin = segments.first().filter(|_| around_mm > 0.0);
        let around = thin.map(|thin| thin.outer.field.latest_around(AROUND_VOXELS, around_mm));
        let far_box = scene.far.grid().map(Bounds::of);
        Self { scene, eighths: None, near_box, far_box, segments, around, around_mm }
    }

    /// Whether the shank along `axis` (unit, work) is free while move `index` ends at `center`.
    pub fn is_free(&self, index: u32, center: Point<Work>, axis: &Vector3<f64>) -> bool {
        self.blocked(index, center, axis).is_none()
    }

    /// Something that blocks the shank along `axis`, if there is anything; it is not always the nearest.
    pub fn blocked(&self, index: u32, center: Point<Work>, axis: &Vector3<f64>) -> Option<Blocked> {
        self.blocked_pose(&PosedShank { index, center, axis, narrower: Narrower::NOT })
    }

    fn blocked_pose(&self, pose: &PosedShank) -> Option<Blocked> {
        cancel::poll();
        self.segments.iter().find_map(|segment| self.blocked_segment(segment, pose))
    }

    fn blocked_segment(&self, segment: &Segment, pose: &PosedShank) -> Option<Blocked> {
        let PosedShank { index, center, axis, .. } = *pose;
        let ShankCylinder { from_mm, to_mm, radius_mm } = segment.cylinder;
        let (enter, leave) = segment.outer.field.crossing(&center.coords, axis);
        let behind_front = from_mm + segment.reach_mm;
        let by_eighths = segment.front.is_none();
        let (mut front_is_free, mut doubted) = (false, false);
        let (begin_mm, step_mm) = (from_mm.max(enter), segment.outer.field.spacing_mm);
        let mut ray = segment.outer.ray(&center.coords, axis, [begin_mm, to_mm.min(leave)]);
        // a draft's balls extend ahead of the cylinder, where the burr removes bone in this same move
        let is_nearly = by_eighths && self.eighths.is_none();
        let standing_at = (index + u32::from(is_nearly)) as f32;
        while let Some((sample, latest)) =
            ray.as_mut().and_then(|ray| ray.next_standing(&segment.outer, standing_at))
        {
            let at_mm = (begin_mm + sample as f64 * step_mm).min(to_mm.min(leave));
            if front_is_free && at_mm < behind_front {
                continue;
            }
            if by_eighths {
                let Some(eighths) = &self.eighths else { return Some(Blocked::by(latest, at_mm)) };
                if !doubted && let Some(blocked) = segment.surely_blocked(pose, [at_mm, leave]) {
                    return Some(blocked);
                }
                doubted = true;
                let end_mm = at_mm + PART as f64 * step_mm;
                let part = [at_mm - step_mm, end_mm + step_mm];
                if let Some(blocked) = eighths.blocked_part(&segment.cylinder, pose, part) {
                    return Some(blocked);
                }
                ray.iter_mut().for_each(|ray| ray.skip(PART));
                continue;
            }
            if at_mm >= behind_front {
                return Some(Blocked::by(latest, at_mm));
            }
            if let Some(blocked) = self.blocked_front(segment, pose) {
                return Some(blocked);
            }
            front_is_free = true;
        }
        // the part of the cylinder beyond the planning grid
        let (far, far_box) = (&self.scene.far, self.far_box.as_ref()?);
        let step = far.spacing_mm();
        let (_, begin) = self.near_box.crossing(&center.coords, axis);
        let (_, end) = far_box.crossing(&center.coords, axis);
        let near_mm = |at_mm: f64| across_mm(radius_mm + aside_mm(radius_mm, at_mm), 0.5 * step);
        let most_mm = near_mm(to_mm);
        let mut marched = steps(from_mm.max(begin), to_mm.min(end + step), step);
        while let Some(at_mm) = marched.next() {
            if front_is_free && at_mm < behind_front {
                continue;
            }
            let Some(distance_mm) = far.at_least_mm(center + axis * at_mm) else { continue };
            if distance_mm >= near_mm(at_mm) {
                let certain = (far.certain_within_mm(distance_mm, most_mm) / step) as usize;
                if certain > 0 {
                    marched.nth(certain - 1);
                }
                continue;
            }
            if by_eighths || at_mm >= behind_front {
                return Some(Blocked::Obstacle { at_mm });
            }
            if let Some(blocked) = self.blocked_front(segment, pose) {
                return Some(blocked);
            }
            front_is_free = true;
        }
        None
    }

    /// What blocks the first `reach_mm` of a thick cylinder.
    fn blocked_front(&self, segment: &Segment, pose: &PosedShank) -> Option<Blocked> {
        let PosedShank { index, center, axis, .. } = *pose;
        let (thin, around, front) = (self.segments.first()?, self.around.as_ref()?, segment.front.as_ref()?);
        let (far, thin_mm) = (&self.scene.far, thin.cylinder.radius_mm);
        let basis = basis::from_z(axis);
        let (near_box, far_box, around_mm) = (&self.near_box, self.far_box.as_ref(), self.around_mm);
        let is_free = |offset: &Vector3<f64>| {
            let p = center + basis * offset;
            // the part of the ball inside the far box is no farther from the box's point nearest to the ball's centre
            let far_mm = || far.at_least_mm(Point::from_coords(far_box?.nearest(&p.coords)));
            around.at(&p.coords) < index as f32
                && (near_box.holds_ball(&p.coords, around_mm)
                    || far_mm().is_none_or(|far_mm| far.certain_within_mm(far_mm, thin_mm) >= around_mm))
        };
        front.find(is_free, |offset| {
            let p = center + basis * offset;
            let latest = thin.outer.field.at(&p.coords);
            if latest >= index as f32 {
                return Some(Blocked::by(latest, offset.z));
            }
            let is_beyond = !near_box.holds(&p.coords);
            let near = || far.at_least_mm(p).is_some_and(|d| d < thin_mm);
            (is_beyond && near()).then_some(Blocked::Obstacle { at_mm: offset.z })
        })
    }
}

/// One segment per cylinder; `make` gets the cylinder, the radius of the first one, and the field with a margin around it.
fn segments(
    latest: &TimeField,
    shank: &[ShankCylinder],
    make: impl Fn(&ShankCylinder, f64, TimeField) -> Segment + Sync,
) -> Vec<Segment> {
    let thin_mm = shank.first().map_or(0.0, |c| c.radius_mm);
    let segment = |cylinder: &ShankCylinder| {
        let by_radius = (cylinder.radius_mm / (VOXELS_PER_RADIUS * latest.spacing_mm)) as usize;
        let factor = by_radius.max(voxels_apart(latest.spacing_mm));
        make(cylinder, thin_mm, latest.pooled(factor, wide_mm(cylinder)))
    };
    shank.par_iter().map(segment).collect()
}

/// A cylinder's radius plus its largest [`aside_mm`], mm.
fn wide_mm(cylinder: &ShankCylinder) -> f64 {
    cylinder.radius_mm + aside_mm(cylinder.radius_mm, cylinder.to_mm)
}

impl Segment {
    /// A segment with balls whose answers are certain.
    fn certain(cylinder: &ShankCylinder, thin_mm: f64, pooled: TimeField) -> Self {
        let wide_mm = wide_mm(cylinder);
        let reach_mm = pooled.ball_voxels(wide_mm) * pooled.spacing_mm;
        let front = (pooled.is_blocks && cylinder.radius_mm > thin_mm)
            .then(|| Front::new(&ShankCylinder { radius_mm: wide_mm, ..*cylinder }, reach_mm, thin_mm));
        let inner_mm = cylinder.radius_mm + aside_mm(cylinder.radius_mm, 0.0);
        let inner = if front.is_none() { pooled.surely_within(inner_mm).map(Marched::new) } else { None };
        let outer = Marched::new(pooled.dilated(wide_mm));
        Self { cylinder: *cylinder, outer, inner, inner_mm, reach_mm, front }
    }

    /// A segment with a ball of the cylinder's own radius, for a cylinder without a front.
    fn nearly(cylinder: &ShankCylinder, thin_mm: f64, pooled: TimeField) -> Self {
        if pooled.is_blocks && cylinder.radius_mm > thin_mm {
            return Self::certain(cylinder, thin_mm, pooled);
        }
        let reach_mm = wide_mm(cylinder);
        let outer = Marched::new(pooled.within(reach_mm));
        Self { cylinder: *cylinder, outer, inner: None, inner_mm: 0.0, reach_mm, front: None }
    }

    /// Something that certainly lies in the cylinder between two distances along its axis.
    fn surely_blocked(&self, pose: &PosedShank, [start_mm, end_mm]: [f64; 2]) -> Option<Blocked> {
        let PosedShank { index, center, axis, narrower } = *pose;
        // a narrower shank may pass obstacles that certainly block the full one
        let inner = self.inner.as_ref().filter(|_| narrower == Narrower::NOT)?;
        let begin_mm = start_mm.max(self.cylinder.from_mm + self.inner_mm);
        let end_mm = end_mm.min(self.cylinder.to_mm - self.inner_mm);
        let mut ray = inner.ray(&center.coords, axis, [begin_mm, end_mm])?;
        let (sample, latest) = ray.next_standing(inner, index as f32)?;
        Some(Blocked::by(latest, (begin_mm + sample as f64 * inner.field.spacing_mm).min(end_mm)))
    }
}

impl Blocked {
    fn by(latest: f32, at_mm: f64) -> Self {
        if latest == SOLID { Self::Obstacle { at_mm } } else { Self::NotYetRemoved { at_mm } }
    }
}

/// Distances from..=to, `step` apart, including the end; empty when to < from.
fn steps(from: f64, to: f64, step: f64) -> impl Iterator<Item = f64> {
    let count = if to >= from { ((to - from) / step) as usize + 2 } else { 0 };
    (0..count).map(move |n| (from + n as f64 * step).min(to))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_shank_sweeps_between_two_places_lies_in_the_wider_shank_at_one_of_them() {
        for radius_mm in [0.05, 0.2, 0.55, 0.6, 1.5] {
            for nearer in [1.0, 0.5, 0.25, 0.125] {
                let narrower = Narrower { between_share: 1.0 - nearer, by_mm: 0.0 };
                let wide_mm = radius_mm + narrower.aside_mm(radius_mm, 0.0) - TRAJECTORY_TOLERANCE_MM;
                for n in 0..=300 {
                    let along_mm = nearer * STRIDE_MM * f64::from(n) / 300.0;
                    // on the side of the swept volume
                    let nearest_mm = along_mm.min(nearer * STRIDE_MM - along_mm).hypot(radius_mm);
                    assert!(nearest_mm <= wide_mm + 1e-12, "{radius_mm}: {nearest_mm} beyond {wide_mm}");
                }
            }
        }
    }
}
