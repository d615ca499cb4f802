//! Volumes: what is to be removed, what can be, what is, and why the rest stays.

use bonemill_imaging::{Class, ImageError, Scene, distance_within};

use crate::path::PathPoint;
use crate::removal::RemovalTime;
use crate::space::BurrSpace;
use crate::sweep::segment_distance_squared;

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
    /// What only the clearances keep from being reached, per structure of the scene, mm³.
    pub kept_by_structure_mm3: Vec<f64>,
    /// What only thin bone outside the target keeps from being reached: what `target.sheets = "keep"` costs, mm³.
    pub kept_by_thin_bone_mm3: f64,
    /// What the ball cannot reach for the bone around it (its radius, ledges), mm³.
    pub kept_by_bone_mm3: f64,
    /// Bone outside the target whose voxel centres are removed: specks and thin bone, mm³.
    pub thin_bone_removed_mm3: f64,
    /// How far the centre of an obstacle voxel lies inside the swept ball at most, mm: the distance field's error between
    /// grid nodes, some hundredths of a voxel.
    pub deepest_in_obstacle_mm: f64,
}

impl Coverage {
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
) -> Result<Coverage, ImageError> {
    let voxel = scene.class.grid().voxel_mm3();
    let without_structures = BurrSpace::new(scene, space.radius_mm(), &[])?;
    let without_thin = reachable_without_thin(scene, space)?;
    let mut found = Coverage {
        target: Volumes::default(),
        reachable: Volumes::default(),
        removed: Volumes::default(),
        removed_reachable: Volumes::default(),
        kept_by_structure_mm3: vec![0.0; scene.structures.len()],
        kept_by_thin_bone_mm3: 0.0,
        kept_by_bone_mm3: 0.0,
        thin_bone_removed_mm3: 0.0,
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
                    volumes.add(*class, voxel);
                }
            }
            if !reachable && !removed {
                if without_thin.as_ref().is_some_and(|reachable| reachable[n]) {
                    found.kept_by_thin_bone_mm3 += voxel;
                    continue;
                }
                match without_structures.reachable()[n].then(|| nearest_limit(scene, space, n)).flatten() {
                    Some(structure) => found.kept_by_structure_mm3[structure] += voxel,
                    None => found.kept_by_bone_mm3 += voxel,
                }
            }
        } else if removed && class.is(Class::SHEET) {
            found.thin_bone_removed_mm3 += voxel;
        } else if removed && class.is(Class::OBSTACLE) {
            found.deepest_in_obstacle_mm =
                found.deepest_in_obstacle_mm.max(depth_in_sweep(scene, space, points, n));
        }
    }
    Ok(found)
}

/// What the ball could reach if thin bone were no obstacle; `None` where there is none.
fn reachable_without_thin(scene: &Scene, space: &BurrSpace) -> Result<Option<Vec<bool>>, ImageError> {
    if scene.count(Class::THIN) == 0 {
        return Ok(None);
    }
    let thick = scene.class.map(|c| c.is(Class::OBSTACLE) && !c.is(Class::THIN));
    let thick_mm = distance_within(&thick, 2.0 * space.radius_mm())?;
    Ok(Some(space.among_others(thick_mm.as_ref())?.reachable().to_vec()))
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

/// The structure whose required distance is missed most at a voxel.
fn nearest_limit(scene: &Scene, space: &BurrSpace, voxel: usize) -> Option<usize> {
    let grid = scene.class.grid();
    let p = scene.ct_from_work * grid.center(grid.voxel(voxel));
    let margin = |(number, keep): (usize, &f64)| {
        let field = scene.structures[number].field.as_ref()?;
        Some((field.distance(p) - keep, number))
    };
    let margins = space.keep_mm().iter().enumerate().filter_map(margin);
    margins.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, number)| number)
}
