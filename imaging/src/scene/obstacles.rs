//! Which bone outside the target is an obstacle, and which is the shadow of partial volume.
//!
//! Where the target's surface meets soft tissue or air, the CT's blur leaves a thin sheet of bone-like values just
//! outside the target; taken at face value it would wall the target in. A part of the bone is an obstacle when it holds
//! a cube of 2×2×2 voxels and a ball of the band's diameter fits into it; the obstacle is then grown back to the bone's
//! own surface, so that nothing thick loses its corners.

use bonemill_geometry::{Volume, Work};

use crate::{ImageError, distance_within};

/// The obstacle part of `bone` (bone outside the target), same grid.
///
/// Whatever is dropped is thinner than `band_mm` plus one voxel.
pub(super) fn obstacle_part(
    bone: &Volume<bool, Work>,
    band_mm: f64,
) -> Result<Volume<bool, Work>, ImageError> {
    let h = bone.grid().spacing_mm().x;
    let mut core = hold_a_cube(bone);
    // distance to the nearest voxel that is not bone; a centre lies half a voxel deeper than that voxel's face
    let air = bone.map(|b| !b);
    if let Some(depth) = distance_within(&air, band_mm + h)? {
        for (keep, depth_mm) in core.data_mut().iter_mut().zip(depth.data()) {
            *keep &= f64::from(*depth_mm) >= 0.5 * band_mm + 0.5 * h - 1e-6;
        }
    }
    let Some(near) = distance_within(&core, band_mm + h)? else {
        return Ok(core);
    };
    let mut obstacle = bone.clone();
    for (keep, from_core) in obstacle.data_mut().iter_mut().zip(near.data()) {
        *keep &= f64::from(*from_core) <= band_mm + 0.5 * h;
    }
    Ok(obstacle)
}

/// Voxels that belong to a 2×2×2 cube of the mask.
fn hold_a_cube(mask: &Volume<bool, Work>) -> Volume<bool, Work> {
    let grid = mask.grid();
    let [nx, ny, nz] = grid.dims();
    let steps = [0, 1, nx, nx + 1, nx * ny, nx * ny + 1, nx * ny + nx, nx * ny + nx + 1];
    let mut held = vec![false; mask.data().len()];
    for k in 0..nz.saturating_sub(1) {
        for j in 0..ny.saturating_sub(1) {
            for i in 0..nx.saturating_sub(1) {
                let corner = grid.index([i, j, k]);
                if steps.iter().all(|s| mask.data()[corner + s]) {
                    steps.iter().for_each(|s| held[corner + s] = true);
                }
            }
        }
    }
    let mut out = mask.clone();
    out.data_mut().copy_from_slice(&held);
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use bonemill_geometry::{Grid, Point};

    const H: f64 = 0.25;

    fn bone(holds: impl Fn([usize; 3]) -> bool) -> Volume<bool, Work> {
        let grid = Grid::<Work>::aligned([24, 24, 24], H, Point::new(0.0, 0.0, 0.0)).unwrap();
        let data = (0..grid.len()).map(|n| holds(grid.voxel(n))).collect();
        Volume::new(grid, data).unwrap()
    }

    fn kept(bone: &Volume<bool, Work>, band_mm: f64) -> usize {
        obstacle_part(bone, band_mm).unwrap().data().iter().filter(|b| **b).count()
    }

    #[test]
    fn sheets_thinner_than_the_band_and_specks_go_and_thick_bone_stays_whole() {
        let band = H * 3f64.sqrt();
        let sheet = |n: usize| bone(move |[_, _, k]| (8..8 + n).contains(&k));
        assert_eq!(kept(&sheet(1), band), 0);
        assert_eq!(kept(&sheet(3), band), 3 * 24 * 24);
        let block = bone(|v| v.iter().all(|c| (6..16).contains(c)));
        assert_eq!(kept(&block, band), 1000);
        assert_eq!(kept(&bone(|v| v == [4, 4, 4] || v == [5, 4, 4]), band), 0);
    }

    #[test]
    fn a_fin_on_thick_bone_goes_but_for_the_band_next_to_it() {
        let finned = bone(|[i, j, k]| k < 6 || (i == 12 && j > 2 && j < 20));
        let band = H * 3f64.sqrt();
        let obstacle = obstacle_part(&finned, band).unwrap();
        assert!(*obstacle.get([3, 3, 5]) && !*obstacle.get([12, 10, 12]));
    }

    #[test]
    fn a_coarse_scan_has_a_wide_band() {
        let sheet = bone(|[_, _, k]| (8..13).contains(&k));
        assert_eq!(kept(&sheet, 2.0), 0);
        assert_eq!(kept(&sheet, 0.8), 5 * 24 * 24);
    }

    #[test]
    fn no_bone_is_no_obstacle_and_all_bone_is_one() {
        assert_eq!(kept(&bone(|_| false), 0.4), 0);
        assert_eq!(kept(&bone(|_| true), 0.4), 24 * 24 * 24);
    }
}
