//! Which shaft directions are free at a waypoint (D II-A).
//!
//! The shank at axis a is free before move i exactly when no solid voxel with T ≥ i lies in it: the maximum of T over
//! the shank's volume is below i. Taking the maximum over a ball of the shank's radius once for every voxel turns that
//! volume into a line: one ray march along the axis per direction.
//!
//! A march looks at the nearest voxel at steps of one voxel; the ball is larger by what that can miss, so "free" is
//! certain. Where a march on voxels is not, the voxels around that part of it are tested one by one, each by its
//! eighths ([`EighthTimes`]): bone that stands anywhere in a voxel stands there. Thick segments (the handpiece) use a
//! coarser field, for which a block counts as solid as long as any voxel in it is. Beyond the work grid `FarObstacles`
//! stands for bone and structures.
//!
//! The arm rounds corners within a tolerance, and between two tested places the shank sweeps a little more than
//! it holds at either: the shank is tested wider by both ([`aside_mm`]). A whole move, during which the shank turns, is
//! asked at places that far apart, and at nearer ones where those leave a doubt (`turn`).
//!
//! A march through free space is long and most of it far from everything: blocks of voxels with the latest time in each say
//! how many steps need no look (`march`). Where a march is in doubt, the rest of the way is looked at with a ball that is
//! small enough to be certain of "blocked"; only what lies between the two is tested by eighths. The answer is the same.
//!
//! A ball at a thick cylinder's flat front reaches out of it, from the handpiece down to the skull. Where only that part of
//! a march is blocked, the front is looked at again with balls of the first cylinder's radius.

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

pub use bonemill_cutter::ShankCylinder;
use bonemill_geometry::{Point, Work, basis, cancel};
use bonemill_motion::timelaw::CornerTolerance;
use bonemill_scene::Scene;
use bonemill_stock::voxels::voxels_apart;
use nalgebra::Vector3;
use rayon::prelude::*;

use self::eighths::Eighths;
use self::field::{Bounds, Field, SOLID};
use self::front::Front;
use self::march::Marched;
use bonemill_motion::timelaw::TRAJECTORY_TOLERANCE_MM;

/// What is in the shank's way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Blocked {
    /// Bone of the target that is still there, removed at this move at the earliest.
    NotYetRemoved {
        /// Distance along the axis, mm.
        at_mm: f64,
    },
    /// Bone outside the target, a structure, or bone of the target that no move takes.
    Obstacle {
        /// Distance along the axis, mm.
        at_mm: f64,
    },
}

/// How far the shank moves between two tested places, mm.
pub const STRIDE_MM: f64 = 0.3;

/// What the shank is widened by for what it sweeps between those places, mm, or more where it is thin.
const BETWEEN_MM: f64 = 0.02;

/// How far a shank of radius `radius_mm` may be aside of where the path has it, at a distance from the burr's centre, mm; with
/// what it sweeps on the way from place to place: a cylinder that moves sideways by d sweeps √(ρ² + d²/4) − ρ beyond what it
/// holds at both ends.
pub fn aside_mm(radius_mm: f64, along_mm: f64) -> f64 {
    TRAJECTORY_TOLERANCE_MM + between_mm(radius_mm) + CornerTolerance::default().axis_rad * along_mm
}

/// The part of it for what is swept from place to place, mm.
fn between_mm(radius_mm: f64) -> f64 {
    BETWEEN_MM.max(across_mm(radius_mm, 0.5 * STRIDE_MM) - radius_mm)
}

/// √(a² + b²); no call, since it is computed for every eighth of a voxel.
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
    /// By how much a thin cylinder is tested narrower than with [`aside_mm`].
    narrower: Narrower,
}

/// How much less room a thin cylinder is given than [`aside_mm`] says.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Narrower {
    /// Share of what it sweeps between two places that is left out: for places that are nearer to each other.
    between_share: f64,
    /// And by so much all over, mm.
    by_mm: f64,
}

impl Narrower {
    /// As wide as [`aside_mm`] says.
    const NOT: Self = Self { between_share: 0.0, by_mm: 0.0 };

    /// How far a shank of that radius may be aside, mm.
    fn aside_mm(&self, radius_mm: f64, along_mm: f64) -> f64 {
        aside_mm(radius_mm, along_mm) - self.between_share * between_mm(radius_mm) - self.by_mm
    }
}

/// Voxels along a side of the blocks in which groups of a front's balls are looked up.
const AROUND_VOXELS: usize = 2;

/// Steps of a march that are tested eighth by eighth at once.
const PART: usize = 4;

/// Access for every waypoint of one path.
#[derive(Debug)]
pub struct Access<'a> {
    scene: &'a Scene,
    /// For what balls leave in doubt; none for a comparison of paths, which takes the balls' answer.
    eighths: Option<Eighths<'a>>,
    near_box: Bounds,
    /// Where something beyond the work grid is known; `None` where nothing is.
    far_box: Option<Bounds>,
    segments: Vec<Segment>,
    /// The latest of what the first cylinder's field has within `around_mm` of a place: for groups of a front's balls, where there is
    /// a front.
    around: Option<Field>,
    around_mm: f64,
}

#[derive(Debug)]
struct Segment {
    cylinder: ShankCylinder,
    /// T dilated by the cylinder's radius: where it is early enough, the cylinder is free.
    outer: Marched,
    /// T dilated by less: where it is late, the cylinder is blocked, more than `inner_mm` from its ends. None for a thin cylinder and
    /// one with a front.
    inner: Option<Marched>,
    inner_mm: f64,
    /// How far a march's ball may reach ahead of where it stands, mm.
    reach_mm: f64,
    /// Balls of the first cylinder's radius that hold this cylinder's front; none for a thin cylinder.
    front: Option<Front>,
}

impl<'a> Access<'a> {
    /// Dilates the removal time once per cylinder. `eighths`: of the path, on the scene's `solid`.
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

    /// For a comparison of paths: bone goes by voxels, at `removal_time`, and what a ball of a thin cylinder's radius meets along
    /// its axis is in the way, off by up to a voxel to either side. Thick cylinders as for a plan.
    pub fn draft(
        scene: &'a Scene,
        solid: &ShankObstacles,
        removal_time: &[u32],
        shank: &[ShankCylinder],
    ) -> Self {
        let latest = Field::of_voxels(solid, removal_time);
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

    /// The removal times that it was made of; none of a draft.
    pub fn into_eighths(self) -> Option<EighthTimes> {
        self.eighths.map(|eighths| eighths.eighths)
    }

    /// Whether the shank along `axis` (unit, work) is free while move `index` ends at `center`.
    pub fn is_free(&self, index: u32, center: Point<Work>, axis: &Vector3<f64>) -> bool {
        self.blocked(index, center, axis).is_none()
    }

    /// Something along `axis` that is in the shank's way, if there is anything: not always the nearest.
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
        // a draft's balls reach ahead of the cylinder, where the burr takes what it takes in this very move
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
        // the segment beyond the work grid
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

    /// What is in the way of a thick cylinder's first `reach_mm`.
    fn blocked_front(&self, segment: &Segment, pose: &PosedShank) -> Option<Blocked> {
        let PosedShank { index, center, axis, .. } = *pose;
        let (thin, around, front) = (self.segments.first()?, self.around.as_ref()?, segment.front.as_ref()?);
        let (far, thin_mm) = (&self.scene.far, thin.cylinder.radius_mm);
        let basis = basis::from_z(axis);
        let (near_box, far_box, around_mm) = (&self.near_box, self.far_box.as_ref(), self.around_mm);
        let is_free = |offset: &Vector3<f64>| {
            let p = center + basis * offset;
            // what of the ball is in the far box is no farther from the place in the box that is nearest to its middle
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

/// One per cylinder; `make`: from the cylinder, the radius of the first and the field with room around it.
fn segments(
    latest: &Field,
    shank: &[ShankCylinder],
    make: impl Fn(&ShankCylinder, f64, Field) -> Segment + Sync,
) -> Vec<Segment> {
    let thin_mm = shank.first().map_or(0.0, |c| c.radius_mm);
    let segment = |cylinder: &ShankCylinder| {
        let by_radius = (cylinder.radius_mm / (VOXELS_PER_RADIUS * latest.spacing_mm)) as usize;
        let factor = by_radius.max(voxels_apart(latest.spacing_mm));
        make(cylinder, thin_mm, latest.pooled(factor, wide_mm(cylinder)))
    };
    shank.par_iter().map(segment).collect()
}

/// The radius of a cylinder with what it may be aside anywhere, mm.
fn wide_mm(cylinder: &ShankCylinder) -> f64 {
    cylinder.radius_mm + aside_mm(cylinder.radius_mm, cylinder.to_mm)
}

impl Segment {
    /// With balls that are certain of what they say.
    fn certain(cylinder: &ShankCylinder, thin_mm: f64, pooled: Field) -> Self {
        let wide_mm = wide_mm(cylinder);
        let reach_mm = pooled.ball_voxels(wide_mm) * pooled.spacing_mm;
        let front = (pooled.is_blocks && cylinder.radius_mm > thin_mm)
            .then(|| Front::new(&ShankCylinder { radius_mm: wide_mm, ..*cylinder }, reach_mm, thin_mm));
        let inner_mm = cylinder.radius_mm + aside_mm(cylinder.radius_mm, 0.0);
        let inner = if front.is_none() { pooled.surely_within(inner_mm).map(Marched::new) } else { None };
        let outer = Marched::new(pooled.dilated(wide_mm));
        Self { cylinder: *cylinder, outer, inner, inner_mm, reach_mm, front }
    }

    /// With a ball of the cylinder's own radius, where there is no front to look at.
    fn nearly(cylinder: &ShankCylinder, thin_mm: f64, pooled: Field) -> Self {
        if pooled.is_blocks && cylinder.radius_mm > thin_mm {
            return Self::certain(cylinder, thin_mm, pooled);
        }
        let reach_mm = wide_mm(cylinder);
        let outer = Marched::new(pooled.within(reach_mm));
        Self { cylinder: *cylinder, outer, inner: None, inner_mm: 0.0, reach_mm, front: None }
    }

    /// What is certain to stand in the cylinder, where its axis runs between two distances.
    fn surely_blocked(&self, pose: &PosedShank, [start_mm, end_mm]: [f64; 2]) -> Option<Blocked> {
        let PosedShank { index, center, axis, narrower } = *pose;
        // a narrower shank may pass what is certain to block this ball's
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

/// Distances from..=to, `step` apart, the end included; none when to < from.
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
                    // on the side of what is swept
                    let nearest_mm = along_mm.min(nearer * STRIDE_MM - along_mm).hypot(radius_mm);
                    assert!(nearest_mm <= wide_mm + 1e-12, "{radius_mm}: {nearest_mm} beyond {wide_mm}");
                }
            }
        }
    }
}
