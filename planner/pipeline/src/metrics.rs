//! Volumes: what is to be removed, what can be, what is, and why the rest stays.

use bonemill_cutting::stock::removal::RemovalTime;
use bonemill_geometry::capsule::segment_distance_squared;
use bonemill_imaging::ImageError;
use bonemill_toolpath::path::PathPoint;
use bonemill_toolpath::scene::{Class, Scene};
use bonemill_toolpath::space::BurrSpace;

use super::reach::Dropped;
use super::rest::{RestCause, rest};

/// One volume in its three kinds, mm³.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Volumes {
    /// Air cells included.
    pub all_mm3: f64,
    /// Its part above `air_hu`.
    pub material_mm3: f64,
    /// Its part above `bone_hu`.
    pub bone_mm3: f64,
}

/// Coverage of the target.
#[derive(Debug, Clone, PartialEq)]
pub struct Coverage {
    /// The target.
    pub target: Volumes,
    /// What the ball can reach under the clearances.
    pub reachable: Volumes,
    /// What the path removes of the target.
    pub removed: Volumes,
    /// What it removes of the reachable part.
    pub removed_reachable: Volumes,
    /// The part of the target beyond the scan, mm³; not in `target`.
    pub outside_mm3: f64,
    /// What keeps the rest of the target, mm³ by cause, the largest first; together target + outside − removed.
    pub rest: Vec<(RestCause, f64)>,
    /// Bone outside the target whose voxel centres are removed, mm³.
    pub untargeted_bone_by_voxels_mm3: f64,
    /// The part of it that is specks and thin bone, mm³.
    pub thin_bone_by_voxels_mm3: f64,
    /// How far the centre of an obstacle voxel lies inside the swept ball at most, mm: the distance field's error between
    /// grid nodes, some hundredths of a voxel.
    pub deepest_in_obstacle_mm: f64,
}

impl Coverage {
    /// Removed share of the whole target, the part beyond the scan included, 0..1.
    pub fn removed_share(&self) -> f64 {
        let whole_mm3 = self.target.all_mm3 + self.outside_mm3;
        if whole_mm3 > 0.0 { self.removed.all_mm3 / whole_mm3 } else { 1.0 }
    }

    /// Removed share of the reachable volume, 0..1; 1 when nothing is reachable.
    pub fn reached_share(&self) -> f64 {
        if self.reachable.all_mm3 > 0.0 {
            self.removed_reachable.all_mm3 / self.reachable.all_mm3
        } else {
            1.0
        }
    }
}

/// Measures coverage by voxel centres.
///
/// # Errors
/// When a distance field cannot be made.
pub fn coverage(
    scene: &Scene,
    space: &BurrSpace,
    removal: &RemovalTime,
    points: &[PathPoint],
    dropped: &[Dropped],
) -> Result<Coverage, ImageError> {
    let (voxel, in_target) = (scene.class.grid().voxel_mm3(), scene.target_voxel_mm3);
    let mut found = Coverage {
        target: Volumes::default(),
        reachable: Volumes::default(),
        removed: Volumes::default(),
        removed_reachable: Volumes::default(),
        outside_mm3: scene.outside.mm3.total(),
        rest: rest(scene, space, removal, dropped)?,
        untargeted_bone_by_voxels_mm3: 0.0,
        thin_bone_by_voxels_mm3: 0.0,
        deepest_in_obstacle_mm: 0.0,
    };
    for (n, class) in scene.class.data().iter().enumerate() {
        let (reachable, removed) = (space.reachable()[n], removal.is_removed(n));
        if class.is(Class::TARGET) {
            for (counts, volumes) in [
                (true, &mut found.target),
                (reachable, &mut found.reachable),
                (removed, &mut found.removed),
                (removed && reachable, &mut found.removed_reachable),
            ] {
                if counts {
                    volumes.add(*class, in_target);
                }
            }
            continue;
        }
        if removed && class.is(Class::SHEET | Class::OBSTACLE) {
            found.untargeted_bone_by_voxels_mm3 += voxel;
        }
        if removed && class.is(Class::SHEET) {
            found.thin_bone_by_voxels_mm3 += voxel;
        } else if removed && class.is(Class::OBSTACLE) {
            found.deepest_in_obstacle_mm =
                found.deepest_in_obstacle_mm.max(depth_in_sweep(scene, space, points, n));
        }
    }
    Ok(found)
}

impl Volumes {
    fn add(&mut self, class: Class, voxel_mm3: f64) {
        self.all_mm3 += voxel_mm3;
        self.material_mm3 += if class.is(Class::MATERIAL) { voxel_mm3 } else { 0.0 };
        self.bone_mm3 += if class.is(Class::TARGET_BONE) { voxel_mm3 } else { 0.0 };
    }
}

/// How deep a voxel's centre lies in the burr's whole sweep, mm.
fn depth_in_sweep(scene: &Scene, space: &BurrSpace, points: &[PathPoint], voxel: usize) -> f64 {
    let grid = scene.class.grid();
    let p = grid.center(grid.voxel(voxel)).coords;
    let moves =
        points.windows(2).map(|w| segment_distance_squared(&p, &w[0].position.coords, &w[1].position.coords));
    space.radius_mm() - moves.fold(f64::INFINITY, f64::min).sqrt()
}
