//! The volumes of a channel: voxels of the planning grid whose centres the tool sweeps.

use bonemill_case::Density;
use bonemill_cutter::SolidOfRevolution;
use bonemill_geometry::{Point, Tool, basis};
use bonemill_scene::Scene;
use rayon::prelude::*;

use crate::axis::ChannelAxis;

/// What a channel removes, mm³.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SweptVolumes {
    /// All that is swept within the target of the scene: from just before the bone to the end.
    pub all_mm3: f64,
    /// Its part above `air_hu`.
    pub material_mm3: f64,
    /// Its part at or above `bone_hu`.
    pub bone_mm3: f64,
}

/// The volumes of a channel from the depth `from_mm` on.
pub fn swept(
    scene: &Scene,
    density: &Density,
    axis: &ChannelAxis,
    solid: &SolidOfRevolution,
    from_mm: f64,
) -> SweptVolumes {
    let grid = scene.class.grid();
    let tool_from_ct = basis::from_z(&axis.out).inverse();
    // in tool coordinates at the end of the way, which leads along -z
    let way = nalgebra::Vector3::new(0.0, 0.0, from_mm - axis.depth_mm);
    let count = |(n, hu): (usize, &f32)| {
        let p = scene.ct_from_work * grid.center(grid.voxel(n));
        let at = tool_from_ct * (p - axis.end());
        let is_before = at.z > axis.depth_mm - from_mm;
        if is_before || !solid.sweep_contains(Point::<Tool>::from_coords(at), way) {
            return [0u64; 3];
        }
        let hu = f64::from(*hu);
        [1, u64::from(hu > density.air_hu), u64::from(hu >= density.bone_hu)]
    };
    let add = |a: [u64; 3], b: [u64; 3]| [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
    let counts = scene.hu.data().par_iter().enumerate().map(count).reduce(|| [0; 3], add);
    let [all_mm3, material_mm3, bone_mm3] = counts.map(|n| n as f64 * grid.voxel_mm3());
    SweptVolumes { all_mm3, material_mm3, bone_mm3 }
}
