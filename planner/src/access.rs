//! Which shaft directions are free at a waypoint (D II-A).
//!
//! The shank at axis a is free before move i exactly when no solid voxel with T ≥ i lies in it: the maximum of T over
//! the shank's volume is below i. Taking the maximum over a ball of the shank's radius once for every voxel turns that
//! volume into a line: one ray march along the axis per direction.
//!
//! A march looks at the nearest voxel at steps of one voxel; the ball is larger by what that can miss, so "free" is
//! certain and "blocked" errs by less than a voxel. Thick segments (the handpiece) use a coarser field, for which a
//! block counts as solid as long as any voxel in it is. Beyond the work grid `FarObstacles` stands for bone and
//! structures.
//!
//! A march through free space is long and most of it far from everything: blocks of voxels with the latest time in and
//! around each say how many steps need no look ([`Skips`]); the answer is the same.
//!
//! A ball at a cylinder's flat front reaches out of it: back into the burr's own cut, or from the handpiece down to the
//! skull. Where only that part of a march is blocked, the front is looked at again: voxel by voxel for the first
//! cylinder, with balls of the first cylinder's radius for the others. A voxel whose centre lies before the front may
//! reach past it by half its diagonal: one that still stands after the move is in the way, too.

mod field;

use std::ops::ControlFlow;

use bonemill_geometry::{Point, Work, basis, cancel};
use bonemill_imaging::Scene;
use nalgebra::Vector3;

use self::field::{Bounds, Field, SOLID, Skips};
use crate::removal::RemovalTime;
use crate::sweep::Rows;

/// A cylinder of the shank: distances along the axis from the burr's centre, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ShankCylinder {
    /// Where it starts.
    pub from_mm: f64,
    /// Where it ends.
    pub to_mm: f64,
    /// Its radius.
    pub radius_mm: f64,
}

/// What is in the shank's way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Blocked {
    /// Bone of the target that is still there, removed at this move at the earliest (or never).
    NotYetRemoved {
        /// Distance along the axis, mm.
        at_mm: f64,
    },
    /// Bone outside the target, or a structure.
    Obstacle {
        /// Distance along the axis, mm.
        at_mm: f64,
    },
}

/// Coarser fields have at least this many voxels across a segment's radius.
const VOXELS_PER_RADIUS: f64 = 8.0;

/// Access for every waypoint of one path.
#[derive(Debug)]
pub struct Access<'a> {
    scene: &'a Scene,
    rows: Rows,
    /// T of what is solid, voxel by voxel.
    latest: Field,
    near_box: Bounds,
    segments: Vec<Segment>,
}

#[derive(Debug)]
struct Segment {
    cylinder: ShankCylinder,
    /// T dilated by the cylinder's radius.
    latest: Field,
    skips: Skips,
    /// How far a march's ball may reach ahead of where it stands, mm.
    reach_mm: f64,
    /// Centres of balls of the first cylinder's radius that hold this cylinder's front: along and across the axis, mm.
    front: Vec<Vector3<f64>>,
}

impl<'a> Access<'a> {
    /// Dilates the removal time once per cylinder. `shank_clearances_mm`: one per structure of the scene.
    pub fn new(
        scene: &'a Scene,
        removal: &RemovalTime,
        shank: &[ShankCylinder],
        shank_clearances_mm: &[f64],
    ) -> Self {
        let latest = Field::removal_time(scene, removal, shank_clearances_mm);
        let thin_mm = shank.first().map_or(0.0, |c| c.radius_mm);
        let segments = shank
            .iter()
            .map(|cylinder| {
                let factor = (cylinder.radius_mm / (VOXELS_PER_RADIUS * latest.spacing_mm)).floor().max(1.0);
                let pooled = latest.pooled(factor as usize, cylinder.radius_mm);
                let reach_mm = pooled.ball_voxels(cylinder.radius_mm) * pooled.spacing_mm;
                let front = if cylinder.radius_mm > thin_mm {
                    front_balls(cylinder, reach_mm, thin_mm)
                } else {
                    Vec::new()
                };
                let latest = pooled.dilated(cylinder.radius_mm);
                Segment { cylinder: *cylinder, skips: latest.skips(), latest, reach_mm, front }
            })
            .collect();
        Self { scene, rows: Rows::of(scene.class.grid()), near_box: latest.bounds(), latest, segments }
    }

    /// Whether the shank along `axis` (unit, work) is free while move `index` ends at `center`.
    pub fn is_free(&self, index: u32, center: Point<Work>, axis: &Vector3<f64>) -> bool {
        self.blocked(index, center, axis).is_none()
    }

    /// The nearest thing along `axis` that is in the shank's way.
    pub fn blocked(&self, index: u32, center: Point<Work>, axis: &Vector3<f64>) -> Option<Blocked> {
        cancel::poll();
        self.segments.iter().find_map(|segment| self.blocked_segment(segment, index, center, axis))
    }

    fn blocked_segment(
        &self,
        segment: &Segment,
        index: u32,
        center: Point<Work>,
        axis: &Vector3<f64>,
    ) -> Option<Blocked> {
        let ShankCylinder { from_mm, to_mm, radius_mm } = segment.cylinder;
        let field = &segment.latest;
        let (enter, leave) = field.crossing(&center.coords, axis);
        let behind_front = from_mm + segment.reach_mm;
        let mut front_is_free = false;
        let (mut marched, mut look) = (steps(from_mm.max(enter), to_mm.min(leave), field.spacing_mm), true);
        while let Some(at_mm) = marched.next() {
            if front_is_free && at_mm < behind_front {
                continue;
            }
            let p = center.coords + axis * at_mm;
            // where the last look was of no use, this one would be of none
            if look && segment.skips.at(field, &p) < index as f32 {
                marched.nth(Skips::STEPS - 1);
                continue;
            }
            look = !look;
            let latest = field.at(&p);
            if latest < index as f32 {
                continue;
            }
            if at_mm >= behind_front {
                return Some(Blocked::by(latest, at_mm));
            }
            if let Some(blocked) = self.blocked_front(segment, index, center, axis) {
                return Some(blocked);
            }
            front_is_free = true;
        }
        // the segment beyond the work grid
        let step = self.scene.far.spacing_mm();
        let (_, leave) = self.near_box.crossing(&center.coords, axis);
        let is_near = |at_mm: f64| {
            let distance = self.scene.far.at_least_mm(center + axis * at_mm);
            distance.is_some_and(|d| d < radius_mm.hypot(0.5 * step))
        };
        for at_mm in steps(from_mm.max(leave), to_mm, step) {
            if (front_is_free && at_mm < behind_front) || !is_near(at_mm) {
                continue;
            }
            if segment.front.is_empty() || at_mm >= behind_front {
                return Some(Blocked::Obstacle { at_mm });
            }
            if let Some(blocked) = self.blocked_front(segment, index, center, axis) {
                return Some(blocked);
            }
            front_is_free = true;
        }
        None
    }

    /// What is in the way of a cylinder's first `reach_mm`.
    fn blocked_front(
        &self,
        segment: &Segment,
        index: u32,
        center: Point<Work>,
        axis: &Vector3<f64>,
    ) -> Option<Blocked> {
        let ShankCylinder { from_mm, to_mm, radius_mm } = segment.cylinder;
        let Some(thin) = self.segments.first().filter(|_| !segment.front.is_empty()) else {
            let end = center + axis * to_mm.min(from_mm + segment.reach_mm);
            return self.blocked_voxels(index, center, axis, [from_mm, radius_mm], end);
        };
        let basis = basis::from_z(axis);
        segment.front.iter().find_map(|offset| {
            let p = center + basis * offset;
            let latest = thin.latest.at(&p.coords);
            if latest >= index as f32 {
                return Some(Blocked::by(latest, offset.z));
            }
            let is_beyond = self.scene.class.grid().nearest(p).is_none();
            let near = || self.scene.far.at_least_mm(p).is_some_and(|d| d < thin.cylinder.radius_mm);
            (is_beyond && near()).then_some(Blocked::Obstacle { at_mm: offset.z })
        })
    }

    /// Solid voxel centres in the cylinder from `from_mm` along the axis to `end`.
    fn blocked_voxels(
        &self,
        index: u32,
        center: Point<Work>,
        axis: &Vector3<f64>,
        [from_mm, radius_mm]: [f64; 2],
        end: Point<Work>,
    ) -> Option<Blocked> {
        let mut found = None;
        let grid = self.scene.class.grid();
        let hidden_mm = 0.5 * grid.diagonal_mm();
        let _ = self.rows.within_capsule(center + axis * from_mm, end, radius_mm, |run| {
            for voxel in run.filter(|v| self.latest.value[*v] >= index as f32) {
                let at_mm = (grid.center(grid.voxel(voxel)) - center).dot(axis);
                // what the burr takes in this very move lies before the front, but for its corners
                let is_before = at_mm < from_mm;
                if !is_before || at_mm >= from_mm - hidden_mm && self.latest.value[voxel] > index as f32 {
                    found = Some(Blocked::by(self.latest.value[voxel], at_mm));
                    return ControlFlow::Break(());
                }
            }
            ControlFlow::Continue(())
        });
        found
    }
}

impl Blocked {
    fn by(latest: f32, at_mm: f64) -> Self {
        if latest == SOLID { Self::Obstacle { at_mm } } else { Self::NotYetRemoved { at_mm } }
    }
}

/// Centres (across, across, along the axis) of balls of `ball_mm` whose union holds the cylinder's first `length_mm`:
/// one per cube of a lattice that such a ball holds.
fn front_balls(cylinder: &ShankCylinder, length_mm: f64, ball_mm: f64) -> Vec<Vector3<f64>> {
    let side = 2.0 * ball_mm / 3f64.sqrt();
    let across = (cylinder.radius_mm / side).ceil() as i64;
    let along = (length_mm / side).ceil() as i64;
    let mut centers = Vec::new();
    for k in 0..along {
        for j in -across..across {
            for i in -across..across {
                let nearest = |n: i64| if n >= 0 { n as f64 * side } else { (n + 1) as f64 * side };
                if nearest(i).hypot(nearest(j)) < cylinder.radius_mm {
                    let middle = |n: i64| (n as f64 + 0.5) * side;
                    centers.push(Vector3::new(middle(i), middle(j), cylinder.from_mm + middle(k)));
                }
            }
        }
    }
    centers
}

/// Distances from..=to, `step` apart, the end included; none when to < from.
fn steps(from: f64, to: f64, step: f64) -> impl Iterator<Item = f64> {
    let count = if to >= from { ((to - from) / step) as usize + 2 } else { 0 };
    (0..count).map(move |n| (from + n as f64 * step).min(to))
}
