//! The scan's edge: measures again the bone on the outer faces of the CT near the target.

use bonemill_geometry::{Ct, Point, Volume, Work};

use super::anatomy::Anatomy;
use super::edt;
use super::lattice::TARGET;
use super::voxels::Voxels;

/// Distances that differ by less than this are equal, mm.
const SAME_MM: f64 = 1e-5;

/// The least and the largest area of bone on the scan's edge within `reach_mm` of the target's voxels, mm².
///
/// The definition is the planner's: outer faces of the CT's outermost voxels at or above `bone_hu`. A face's distance is
/// interpolated at its middle, from distances between the centres of voxels and of target voxels.
pub fn edge_bone_mm2(anatomy: &Anatomy, bone_hu: f64, voxels: &Voxels, reach_mm: f64) -> [f64; 2] {
    let grid_from_ct = voxels.ct_from_grid.inverse();
    let last = voxels.grid.dims().map(|d| (d - 1) as f64);
    let mut faces = Vec::new();
    each_outer_face(&anatomy.ct, |middle, area_mm2, hu| {
        let index = voxels.grid.continuous_index(grid_from_ct * middle);
        if hu >= bone_hu && (0..3).all(|a| index[a] >= 0.0 && index[a] < last[a]) {
            faces.push((index, area_mm2));
        }
    });
    if faces.is_empty() {
        return [0.0; 2];
    }
    let area_within = |class: &[u8], reach_mm: f64| -> f64 {
        let distance_mm = from_target_mm(voxels, class);
        let is_near = |index| distance_mm.trilinear_inside(index).is_some_and(|mm| mm <= reach_mm);
        faces.iter().filter(|(index, _)| is_near(*index)).map(|(_, area_mm2)| area_mm2).sum()
    };
    [
        area_within(&voxels.class.surely, reach_mm - SAME_MM),
        area_within(&voxels.class.possibly, reach_mm + SAME_MM),
    ]
}

/// Distance from every voxel's centre to the nearest centre of a target voxel, mm.
fn from_target_mm(voxels: &Voxels, class: &[u8]) -> Volume<f32, Work> {
    let squared = edt::squared_voxels(voxels.grid.dims(), |n| class[n] & TARGET != 0);
    let mut distance_mm = Volume::filled(voxels.grid.clone(), 0f32);
    let h = voxels.spacing_mm();
    distance_mm.data_mut().iter_mut().zip(squared).for_each(|(mm, d)| *mm = (f64::from(d).sqrt() * h) as f32);
    distance_mm
}

/// Visits the outer faces of the CT: middle, area in mm², and HU of the voxel behind each.
fn each_outer_face(ct: &Volume<f32, Ct>, mut visit: impl FnMut(Point<Ct>, f64, f64)) {
    let (grid, [nx, ny, nz]) = (ct.grid(), ct.grid().dims());
    let spacing = grid.spacing_mm();
    let mut along = |axis: usize, [i, j, k]: [usize; 3]| {
        let area_mm2 = spacing[(axis + 1) % 3] * spacing[(axis + 2) % 3];
        for (end, out) in [(0, -0.5), (grid.dims()[axis] - 1, 0.5)] {
            let mut voxel = [i, j, k];
            voxel[axis] = end;
            let mut index = voxel.map(|v| v as f64);
            index[axis] += out;
            visit(grid.at(index), area_mm2, f64::from(*ct.get(voxel)));
        }
    };
    (0..nz).for_each(|k| (0..ny).for_each(|j| along(0, [0, j, k])));
    (0..nz).for_each(|k| (0..nx).for_each(|i| along(1, [i, 0, k])));
    (0..ny).for_each(|j| (0..nx).for_each(|i| along(2, [i, j, 0])));
}
