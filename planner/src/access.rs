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
//! A ball at a cylinder's flat front reaches out of it: back into the burr's own cut, or from the handpiece down to the
//! skull. Where only that part of a march is blocked, the front is looked at again: voxel by voxel for the first
//! cylinder, with balls of the first cylinder's radius for the others.

use std::ops::ControlFlow;

use bonemill_geometry::{Point, Work, basis, cancel};
use bonemill_imaging::{Class, Scene};
use nalgebra::Vector3;
use rayon::prelude::*;

use crate::removal::{NEVER, RemovalTime};
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

/// Removal time of free voxels: before every move.
const FREE: f32 = -1.0;
/// Removal time of what is never removed.
const SOLID: f32 = f32::INFINITY;
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
                Segment { cylinder: *cylinder, latest: pooled.dilated(cylinder.radius_mm), reach_mm, front }
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
        for at_mm in steps(from_mm.max(enter), to_mm.min(leave), field.spacing_mm) {
            if front_is_free && at_mm < behind_front {
                continue;
            }
            let latest = field.at(&(center.coords + axis * at_mm));
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
        let _ = self.rows.within_capsule(center + axis * from_mm, end, radius_mm, |run| {
            for voxel in run.filter(|v| self.latest.value[*v] >= index as f32) {
                let at_mm = (grid.center(grid.voxel(voxel)) - center).dot(axis);
                if at_mm >= from_mm {
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

/// An axis-aligned box in work, mm.
#[derive(Debug, Clone, Copy)]
struct Bounds {
    low_mm: Vector3<f64>,
    high_mm: Vector3<f64>,
}

impl Bounds {
    /// Where the ray center + t·axis, t ≥ 0, enters and leaves the box; enter > leave when it misses it.
    fn crossing(&self, center: &Vector3<f64>, axis: &Vector3<f64>) -> (f64, f64) {
        let (mut enter, mut leave) = (0f64, f64::INFINITY);
        for a in 0..3 {
            let (low, high) = (self.low_mm[a] - center[a], self.high_mm[a] - center[a]);
            if axis[a].abs() < 1e-12 {
                if low > 0.0 || high < 0.0 {
                    return (f64::INFINITY, 0.0);
                }
            } else {
                let (t0, t1) = (low / axis[a], high / axis[a]);
                enter = enter.max(t0.min(t1));
                leave = leave.min(t0.max(t1));
            }
        }
        (enter, leave)
    }
}

/// A scalar per cubic voxel; free outside.
#[derive(Debug, Clone)]
struct Field {
    dims: [usize; 3],
    spacing_mm: f64,
    /// Centre of the first voxel, mm in work.
    origin_mm: f64,
    /// Whether a voxel stands for a block of grid voxels.
    is_blocks: bool,
    value: Vec<f32>,
}

impl Field {
    /// T of what is solid, −1 elsewhere. T is exact: a path has fewer than 2²⁴ waypoints.
    fn removal_time(scene: &Scene, removal: &RemovalTime, shank_clearances_mm: &[f64]) -> Self {
        let grid = scene.class.grid();
        let mut value: Vec<f32> = scene
            .class
            .data()
            .iter()
            .zip(removal.time())
            .map(|(class, time)| {
                if class.is(Class::OBSTACLE | Class::STRUCTURE) || class.is(Class::MATERIAL) && *time == NEVER
                {
                    SOLID
                } else if class.is(Class::MATERIAL) {
                    *time as f32
                } else {
                    FREE
                }
            })
            .collect();
        for (structure, clearance) in scene.structures.iter().zip(shank_clearances_mm) {
            // without a clearance the voxels of the structure itself are enough, and they are solid already
            let Some(field) = structure.field.as_ref().filter(|_| *clearance > 0.0) else { continue };
            value.par_iter_mut().enumerate().for_each(|(n, v)| {
                cancel::poll();
                let p = scene.ct_from_work * grid.center(grid.voxel(n));
                if field.is_nearer_than(p, *clearance) {
                    *v = SOLID;
                }
            });
        }
        Self { dims: grid.dims(), spacing_mm: grid.spacing_mm().x, origin_mm: 0.0, is_blocks: false, value }
    }

    /// Blocks of `factor`³ voxels, each with its latest time, and room of `pad_mm` around, where the handpiece still
    /// meets what lies at the border.
    fn pooled(&self, factor: usize, pad_mm: f64) -> Self {
        let spacing_mm = self.spacing_mm * factor as f64;
        let pad = (pad_mm / spacing_mm).ceil() as usize + 2;
        let dims = self.dims.map(|n| n.div_ceil(factor) + 2 * pad);
        let mut value = vec![FREE; dims.iter().product()];
        for k in 0..self.dims[2] {
            for j in 0..self.dims[1] {
                let row = dims[0] * (j / factor + pad + dims[1] * (k / factor + pad)) + pad;
                let source = self.dims[0] * (j + self.dims[1] * k);
                for (i, v) in self.value[source..source + self.dims[0]].iter().enumerate() {
                    let block = &mut value[row + i / factor];
                    *block = block.max(*v);
                }
            }
        }
        let first_center = 0.5 * (factor as f64 - 1.0) * self.spacing_mm;
        let origin_mm = first_center - pad as f64 * spacing_mm;
        Self { dims, spacing_mm, origin_mm, is_blocks: factor > 1, value }
    }

    /// Latest time around each voxel: the maximum over a ball that holds all that a march step stands for.
    ///
    /// A solid voxel centre in the cylinder is within √(ρ² + (s/2)²) of the nearest step of the march, and that within
    /// half a voxel diagonal of the voxel that is looked up; a block may hold it half a diagonal off again.
    fn dilated(self, radius_mm: f64) -> Self {
        Self { value: ball_maximum(&self.value, self.dims, self.ball_voxels(radius_mm)), ..self }
    }

    /// The radius of that ball, voxels.
    fn ball_voxels(&self, radius_mm: f64) -> f64 {
        let half_diagonal = 0.5 * 3f64.sqrt();
        let radius = (radius_mm / self.spacing_mm).hypot(0.5) + half_diagonal;
        if self.is_blocks { radius + half_diagonal } else { radius }
    }

    /// The box of all voxels.
    fn bounds(&self) -> Bounds {
        let low = self.origin_mm - 0.5 * self.spacing_mm;
        let size = Vector3::from(self.dims.map(|n| n as f64 * self.spacing_mm));
        Bounds { low_mm: Vector3::repeat(low), high_mm: Vector3::repeat(low) + size }
    }

    /// [`Bounds::crossing`] of the box of all voxels.
    fn crossing(&self, center: &Vector3<f64>, axis: &Vector3<f64>) -> (f64, f64) {
        self.bounds().crossing(center, axis)
    }

    /// The value of the voxel that holds `p`, [`FREE`] outside.
    #[inline]
    fn at(&self, p: &Vector3<f64>) -> f32 {
        let scale = 1.0 / self.spacing_mm;
        let at = |c: f64, n: usize| {
            // truncation is rounding down for what is not negative
            let v = (c - self.origin_mm) * scale + 0.5;
            (v >= 0.0 && v < n as f64).then_some(v as usize)
        };
        match (at(p.x, self.dims[0]), at(p.y, self.dims[1]), at(p.z, self.dims[2])) {
            (Some(i), Some(j), Some(k)) => self.value[i + self.dims[0] * (j + self.dims[1] * k)],
            _ => FREE,
        }
    }
}

/// Maximum over the ball of `radius` voxels around each voxel.
///
/// The ball is a stack of rows. Rows of equal half-width share one running maximum along x; what remains per voxel is
/// one comparison per row of the ball, in memory order.
fn ball_maximum(value: &[f32], dims: [usize; 3], radius: f64) -> Vec<f32> {
    let [nx, ny, nz] = dims;
    let reach = radius.floor() as i64;
    let mut by_width: Vec<Vec<[i64; 2]>> = vec![Vec::new(); reach as usize + 1];
    for dk in -reach..=reach {
        for dj in -reach..=reach {
            let left = radius * radius - (dj * dj + dk * dk) as f64;
            if left >= 0.0 {
                by_width[left.sqrt().floor() as usize].push([dj, dk]);
            }
        }
    }
    let mut out = value.to_vec();
    let mut rows = value.to_vec();
    for (width, offsets) in by_width.iter().enumerate() {
        if width > 0 {
            rows.par_chunks_mut(nx).for_each(widen);
        }
        out.par_chunks_mut(nx * ny).enumerate().for_each(|(k, slab)| {
            for [dj, dk] in offsets {
                cancel::poll();
                let source_k = k as i64 + dk;
                if source_k < 0 || source_k >= nz as i64 {
                    continue;
                }
                let (j_from, j_to) = ((-dj).max(0) as usize, (ny as i64 - dj.max(&0)).max(0) as usize);
                for j in j_from..j_to {
                    let from = nx * ((j as i64 + dj) as usize + ny * source_k as usize);
                    let target = &mut slab[nx * j..nx * (j + 1)];
                    for (t, s) in target.iter_mut().zip(&rows[from..from + nx]) {
                        *t = if *s > *t { *s } else { *t };
                    }
                }
            }
        });
    }
    out
}

/// From the maxima over windows of half-width w to those of w + 1, in place.
fn widen(row: &mut [f32]) {
    let mut before = FREE;
    for i in 0..row.len() {
        let here = row[i];
        let after = row.get(i + 1).copied().unwrap_or(FREE);
        row[i] = before.max(here).max(after);
        before = here;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_ball_maximum_is_the_maximum_over_the_ball(
            value in prop::collection::vec(-1.0f32..9.0, 7 * 6 * 5), radius in 0.0f64..4.0,
        ) {
            let dims = [7, 6, 5];
            let fast = ball_maximum(&value, dims, radius);
            let at = |n: usize| [n % 7, n / 7 % 6, n / 42].map(|c| c as f64);
            for (n, found) in fast.iter().enumerate() {
                let near = |m: &usize| {
                    (0..3).map(|a| (at(n)[a] - at(*m)[a]).powi(2)).sum::<f64>() <= radius * radius
                };
                let slow = (0..value.len()).filter(near).map(|m| value[m]).fold(FREE, f32::max);
                prop_assert_eq!(*found, slow);
            }
        }
    }

    #[test]
    fn pooling_keeps_the_latest_time_of_every_block() {
        let field = Field {
            dims: [5, 4, 3],
            spacing_mm: 0.5,
            origin_mm: 0.0,
            is_blocks: false,
            value: (0..60).map(|n| n as f32).collect(),
        };
        let coarse = field.pooled(2, 1.0);
        for n in 0..60usize {
            let p = Vector3::new((n % 5) as f64, (n / 5 % 4) as f64, (n / 20) as f64) * 0.5;
            assert!(coarse.at(&p) >= n as f32);
        }
        assert_eq!(coarse.at(&Vector3::repeat(-1.3)), FREE);
        assert_eq!(coarse.value.iter().copied().fold(FREE, f32::max), 59.0);
    }
}
