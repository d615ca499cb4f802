//! Which bone outside the target is an obstacle, and which the burr may take.
//!
//! Where the target's surface meets soft tissue or air, the CT's blur leaves a thin sheet of bone-like values just outside
//! the target; taken at face value it would wall the target in. Farther out, thin bone is real: the septa between air
//! cells. So a part that is thinner than the band is no obstacle where it lies within the band of the target; with
//! [`Sheets::Cut`] it is none anywhere. Specks, pieces of less than eight voxels (a cube of 2×2×2), are noise everywhere.
//!
//! Thick is what a ball of the band's diameter fits into and what lies within the band of such a place, so that nothing
//! thick loses its corners.

use bonemill_geometry::Sheets;
use bonemill_geometry::{Volume, Work};
use bonemill_imaging::{ImageError, distance_within};

use super::Class;

/// A connected piece of fewer voxels is a speck.
const SPECK_VOXELS: usize = 8;
/// Distances that differ by less are one, mm.
const ROUNDING_MM: f64 = 1e-6;

/// Flags of each voxel of `bone` (bone outside the target): [`Class::OBSTACLE`], with [`Class::THIN`] where only
/// [`Sheets::Keep`] makes it one, or [`Class::SHEET`].
///
/// # Errors
/// When a distance field cannot be made.
pub(super) fn bone_classes(
    bone: &Volume<bool, Work>,
    target: &Volume<bool, Work>,
    band_mm: f64,
    sheets: Sheets,
) -> Result<Vec<u8>, ImageError> {
    let thick = thick_part(bone, band_mm)?;
    let speck = specks(bone);
    let from_target = distance_within(target, band_mm + bone.grid().spacing_mm().x)?;
    let is_near =
        |n: usize| from_target.as_ref().is_some_and(|mm| f64::from(mm.data()[n]) <= band_mm + ROUNDING_MM);
    let class = |n: usize| match (bone.data()[n], thick.data()[n]) {
        (false, _) => 0,
        (true, true) => Class::OBSTACLE,
        (true, false) if sheets == Sheets::Cut || speck[n] || is_near(n) => Class::SHEET,
        (true, false) => Class::OBSTACLE | Class::THIN,
    };
    Ok((0..bone.data().len()).map(class).collect())
}

/// The part of `bone` that is not thin. What is left out is thinner than `band_mm` plus one voxel.
fn thick_part(bone: &Volume<bool, Work>, band_mm: f64) -> Result<Volume<bool, Work>, ImageError> {
    let h = bone.grid().spacing_mm().x;
    let mut core = hold_a_cube(bone);
    // distance to the nearest voxel that is not bone; a centre lies half a voxel deeper than that voxel's face
    let air = bone.map(|b| !b);
    if let Some(depth) = distance_within(&air, band_mm + h)? {
        for (keep, depth_mm) in core.data_mut().iter_mut().zip(depth.data()) {
            *keep &= f64::from(*depth_mm) >= 0.5 * band_mm + 0.5 * h - ROUNDING_MM;
        }
    }
    let Some(near) = distance_within(&core, band_mm + h)? else {
        return Ok(core);
    };
    let mut thick = bone.clone();
    for (keep, from_core) in thick.data_mut().iter_mut().zip(near.data()) {
        *keep &= f64::from(*from_core) <= band_mm + 0.5 * h;
    }
    Ok(thick)
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

/// Voxels of pieces of the mask, joined by faces, edges or corners, that are specks.
fn specks(mask: &Volume<bool, Work>) -> Vec<bool> {
    let grid = mask.grid();
    let [nx, ny, nz] = grid.dims();
    let mut left = mask.data().to_vec();
    let mut speck = vec![false; left.len()];
    let (mut open, mut piece) = (Vec::new(), Vec::new());
    for start in 0..left.len() {
        if !std::mem::take(&mut left[start]) {
            continue;
        }
        open.push(start);
        while let Some(n) = open.pop() {
            if piece.len() < SPECK_VOXELS {
                piece.push(n);
            }
            let [i, j, k] = grid.voxel(n);
            let around = |v: usize, n: usize| v.saturating_sub(1)..(v + 2).min(n);
            for k in around(k, nz) {
                for j in around(j, ny) {
                    for n in around(i, nx).map(|i| grid.index([i, j, k])) {
                        if std::mem::take(&mut left[n]) {
                            open.push(n);
                        }
                    }
                }
            }
        }
        if piece.len() < SPECK_VOXELS {
            piece.iter().for_each(|n| speck[*n] = true);
        }
        piece.clear();
    }
    speck
}

#[cfg(test)]
mod tests {
    use super::*;
    use bonemill_geometry::{Grid, Point};

    const H: f64 = 0.25;
    const BAND_MM: f64 = 0.434;

    fn mask(holds: impl Fn([usize; 3]) -> bool) -> Volume<bool, Work> {
        let grid = Grid::<Work>::aligned([24, 24, 24], H, Point::new(0.0, 0.0, 0.0)).unwrap();
        let data = (0..grid.len()).map(|n| holds(grid.voxel(n))).collect();
        Volume::new(grid, data).unwrap()
    }

    fn thick(bone: &Volume<bool, Work>, band_mm: f64) -> usize {
        thick_part(bone, band_mm).unwrap().data().iter().filter(|b| **b).count()
    }

    #[test]
    fn sheets_thinner_than_the_band_are_thin_and_thick_bone_stays_whole() {
        let sheet = |n: usize| mask(move |[_, _, k]| (8..8 + n).contains(&k));
        assert_eq!(thick(&sheet(1), BAND_MM), 0);
        assert_eq!(thick(&sheet(3), BAND_MM), 3 * 24 * 24);
        let block = mask(|v| v.iter().all(|c| (6..16).contains(c)));
        assert_eq!(thick(&block, BAND_MM), 1000);
    }

    #[test]
    fn a_fin_on_thick_bone_is_thin_but_for_the_band_next_to_it() {
        let finned = mask(|[i, j, k]| k < 6 || (i == 12 && j > 2 && j < 20));
        let part = thick_part(&finned, BAND_MM).unwrap();
        assert!(*part.get([3, 3, 5]) && !*part.get([12, 10, 12]));
    }

    #[test]
    fn a_coarse_scan_has_a_wide_band() {
        let sheet = mask(|[_, _, k]| (8..13).contains(&k));
        assert_eq!(thick(&sheet, 2.0), 0);
        assert_eq!(thick(&sheet, 0.8), 5 * 24 * 24);
    }

    #[test]
    fn no_bone_is_not_thick_and_all_bone_is() {
        assert_eq!(thick(&mask(|_| false), 0.4), 0);
        assert_eq!(thick(&mask(|_| true), 0.4), 24 * 24 * 24);
    }

    /// A septum one voxel thick that leaves the target's side, a film along the target, and a septum farther out.
    #[test]
    fn septa_are_obstacles_beyond_the_band_of_the_target_unless_sheets_are_cut() {
        let target = mask(|[_, _, k]| k < 8);
        let bone = mask(|[i, _, k]| k == 8 || (i == 12 && (9..20).contains(&k)));
        let at = |classes: &[u8], voxel| classes[target.grid().index(voxel)];
        let keep = bone_classes(&bone, &target, BAND_MM, Sheets::Keep).unwrap();
        assert_eq!(at(&keep, [3, 3, 8]), Class::SHEET);
        // 0.25 and 0.5 mm from the target's last layer
        assert_eq!(at(&keep, [12, 5, 8]), Class::SHEET);
        assert_eq!(at(&keep, [12, 5, 9]), Class::OBSTACLE | Class::THIN);
        assert_eq!(at(&keep, [12, 5, 19]), Class::OBSTACLE | Class::THIN);
        assert_eq!(at(&keep, [3, 3, 12]), 0);
        let cut = bone_classes(&bone, &target, BAND_MM, Sheets::Cut).unwrap();
        assert!(cut.iter().all(|c| *c == 0 || *c == Class::SHEET));
    }

    #[test]
    fn specks_are_pieces_of_less_than_eight_voxels_and_no_large_sheet() {
        let pieces = mask(|[i, j, k]| {
            let chain = i == j && j == k && (4..11).contains(&i);
            let cube = [i, j, k].iter().all(|c| (14..16).contains(c));
            let sheet = k == 20;
            chain || cube || sheet
        });
        let speck = specks(&pieces);
        let is = |voxel| speck[pieces.grid().index(voxel)];
        assert!(is([4, 4, 4]) && is([10, 10, 10]));
        assert!(!is([14, 14, 15]) && !is([0, 5, 20]));
        let target = mask(|_| false);
        let classes = bone_classes(&pieces, &target, BAND_MM, Sheets::Keep).unwrap();
        let class = |voxel| classes[pieces.grid().index(voxel)];
        assert_eq!(class([7, 7, 7]), Class::SHEET);
        assert_eq!(class([14, 14, 14]) & Class::OBSTACLE, Class::OBSTACLE);
        assert_eq!(class([3, 5, 20]), Class::OBSTACLE | Class::THIN);
    }
}
