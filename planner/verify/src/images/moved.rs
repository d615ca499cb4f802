//! A mask on another grid than the label map's, brought onto it by the rules that `docs/formats.md` states, with code of its own.
//!
//! What is removed has the map's voxels whose centres, moved by a little so that none lies on a face, lie in a voxel of the mask. What is
//! kept has the map's voxels that hold one of the points of a lattice in each voxel of the mask: from face to face, a hundredth of the
//! voxel in all left out, in the fewest equal steps that are no longer than the map's smallest voxel side.

use bonemill_geometry::{Ct, Grid, Volume};
use nalgebra::{Matrix4, Vector3, Vector4};

use super::segments::LabelsRead;
use crate::error::ReadProblem;

/// How far centres are moved, mm.
const MOVED_MM: [f64; 3] = [0.00137, 0.00119, 0.00107];
/// Half of a voxel, voxels, as far as a lattice reaches from its centre.
const REACH: f64 = 0.49;
/// By how much of a step a step may be longer.
const LONGER: f64 = 0.01;
/// Axes are turned against each other if a cosine differs by more from 0 and 1.
const TURNED: f64 = 1e-5;
/// A map holds no more voxels.
const MOST_VOXELS: i64 = 500_000_000;

/// How a mask is brought onto the map's grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MaskRule {
    /// At the map's centres.
    AtCentres,
    /// Wherever the mask is.
    Everywhere,
}

/// From indices of a grid to mm.
fn matrix(grid: &Grid<Ct>) -> Matrix4<f64> {
    let mut all = Matrix4::identity();
    let steps = grid.axes() * nalgebra::Matrix3::from_diagonal(&grid.spacing_mm());
    all.fixed_view_mut::<3, 3>(0, 0).copy_from(&steps);
    all.fixed_view_mut::<3, 1>(0, 3).copy_from(&grid.origin().coords);
    all
}

/// The index of the voxel that holds a point, given by a continuous index.
fn nearest(at: &Vector4<f64>) -> [i64; 3] {
    [at.x, at.y, at.z].map(|v| (v + 0.5).floor() as i64)
}

/// Which voxels of the map the mask has; the map grows where it must.
///
/// # Errors
/// [`ReadProblem::Affine`] for grids that cannot be inverted or lie too far apart.
pub(super) fn onto(
    map: &mut LabelsRead,
    mask: &Volume<bool, Ct>,
    by: MaskRule,
) -> Result<Vec<bool>, ReadProblem> {
    let apart = ReadProblem::Affine("a place too far from the label map's");
    let inverse =
        |m: &Matrix4<f64>| m.try_inverse().ok_or(ReadProblem::Affine("axes that do not span space"));
    let map_from_mask = inverse(&matrix(map.shown.grid()))? * matrix(mask.grid());
    let [nx, ny, _] = mask.grid().dims();
    let voxels: Vec<[f64; 3]> = (0..mask.data().len())
        .filter(|n| mask.data()[*n])
        .map(|n| [n % nx, n / nx % ny, n / (nx * ny)].map(|v| v as f64))
        .collect();
    let (mut low, mut high) = ([f64::MAX; 3], [f64::MIN; 3]);
    for voxel in &voxels {
        for a in 0..3 {
            low[a] = low[a].min(voxel[a] - REACH);
            high[a] = high[a].max(voxel[a] + REACH);
        }
    }
    if voxels.is_empty() {
        return Ok(vec![false; map.shown.data().len()]);
    }
    let corners = (0..8).map(|c| {
        let at: [f64; 3] = std::array::from_fn(|a| if c & (1 << a) == 0 { low[a] } else { high[a] });
        nearest(&(map_from_mask * Vector4::new(at[0], at[1], at[2], 1.0)))
    });
    let dims = map.shown.grid().dims().map(|d| d as i64);
    let [first, last] = corners.fold([[0; 3], dims.map(|d| d - 1)], |[first, last], at| {
        let each = |a: usize| (first[a].min(at[a]), last[a].max(at[a]));
        [[each(0).0, each(1).0, each(2).0], [each(0).1, each(1).1, each(2).1]]
    });
    let size: [i64; 3] = std::array::from_fn(|a| last[a].saturating_sub(first[a]).saturating_add(1));
    let grows = size != dims;
    if grows && size.iter().fold(1i64, |all, n| all.saturating_mul(*n)) > MOST_VOXELS {
        return Err(apart);
    }
    enlarge(map, first, size.map(|n| n as usize))?;
    let map_from_mask = inverse(&matrix(map.shown.grid()))? * matrix(mask.grid());
    let mut found = vec![false; map.shown.data().len()];
    let place = |at: [i64; 3]| {
        let is_in = (0..3).all(|a| (0..size[a]).contains(&at[a]));
        is_in.then(|| (at[0] + size[0] * (at[1] + size[1] * at[2])) as usize)
    };
    match by {
        MaskRule::AtCentres => {
            let mask_from_map = inverse(&matrix(mask.grid()))? * matrix(map.shown.grid());
            let moved = mask.grid().axes().transpose() * Vector3::from(MOVED_MM);
            let moved = moved.component_div(&mask.grid().spacing_mm()).push(0.0);
            let dims = mask.grid().dims().map(|d| d as i64);
            let [mx, my] = [size[0] as usize, size[1] as usize];
            for (n, found) in found.iter_mut().enumerate() {
                let [i, j, k] = [n % mx, n / mx % my, n / (mx * my)].map(|v| v as f64);
                let at = nearest(&(mask_from_map * Vector4::new(i, j, k, 1.0) + moved));
                *found = (0..3).all(|a| (0..dims[a]).contains(&at[a]))
                    && mask.data()[(at[0] + dims[0] * (at[1] + dims[1] * at[2])) as usize];
            }
        }
        MaskRule::Everywhere => {
            let turned = mask.grid().axes().transpose() * map.shown.grid().axes();
            let is_turned = turned.iter().any(|c| c.abs() > TURNED && c.abs() < 1.0 - TURNED);
            // a turned cube holds a ball of its own width, and a ball one of the points that are 1/√3 of that apart
            let step_mm = map.shown.grid().spacing_mm().min() / if is_turned { 3f64.sqrt() } else { 1.0 };
            let counts: [usize; 3] = std::array::from_fn(|a| {
                (1..).find(|n| mask.grid().spacing_mm()[a] / step_mm <= *n as f64 + LONGER).unwrap_or(1)
            });
            let points = counts.map(|n| n + 1);
            for voxel in &voxels {
                for n in 0..points.iter().product::<usize>() {
                    let at = [n % points[0], n / points[0] % points[1], n / (points[0] * points[1])];
                    let off = |a: usize| REACH * (2.0 * at[a] as f64 / counts[a] as f64 - 1.0);
                    let point = Vector4::new(voxel[0] + off(0), voxel[1] + off(1), voxel[2] + off(2), 1.0);
                    if let Some(place) = place(nearest(&(map_from_mask * point))) {
                        found[place] = true;
                    }
                }
            }
        }
    }
    Ok(found)
}

/// Gives the map `size` voxels from the index `first` on, which is 0 or before.
fn enlarge(map: &mut LabelsRead, first: [i64; 3], size: [usize; 3]) -> Result<(), ReadProblem> {
    let old = map.shown.grid().clone();
    if size == old.dims() {
        return Ok(());
    }
    let place = |n: usize| {
        let [nx, ny, _] = old.dims();
        let at = [n % nx, n / nx % ny, n / (nx * ny)];
        let at: [usize; 3] = std::array::from_fn(|a| at[a] + first[a].unsigned_abs() as usize);
        at[0] + size[0] * (at[1] + size[1] * at[2])
    };
    let mut data = vec![0u16; size.iter().product()];
    map.shown
        .data()
        .iter()
        .enumerate()
        .filter(|(_, label)| **label != 0)
        .for_each(|(n, label)| data[place(n)] = *label);
    map.further.iter_mut().for_each(|(n, _)| *n = place(*n));
    let origin = matrix(&old) * Vector4::new(first[0] as f64, first[1] as f64, first[2] as f64, 1.0);
    let grid = Grid::new(size, old.spacing_mm(), *old.axes(), origin.xyz())?;
    map.shown = Volume::new(grid, data)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use bonemill_geometry::Point;
    use bonemill_imaging::{Fit, Image, LabelMap, Placement, Provenance};
    use nalgebra::{Matrix3, Rotation3};

    fn grid(dims: [usize; 3], spacing_mm: [f64; 3], turn: f64, origin: [f64; 3]) -> Grid<Ct> {
        let axes = Rotation3::new(Vector3::new(0.2, -0.1, 1.0) * turn).into_inner();
        Grid::new(dims, Vector3::from(spacing_mm), axes * Matrix3::identity(), Vector3::from(origin)).unwrap()
    }

    /// Both programs bring a ball from any grid onto the same voxels, also of a map that must grow.
    #[test]
    fn the_planner_has_the_same_voxels() {
        let map = grid([14, 12, 10], [0.5; 3], 0.0, [-3.0, -3.0, -2.5]);
        let others = [
            grid([30, 28, 26], [0.25; 3], 0.0, [-3.625, -3.375, -3.125]),
            grid([6, 6, 8], [1.5, 1.5, 1.0], 0.0, [-3.75, -4.0, -3.5]),
            grid([40, 40, 12], [0.2, 0.2, 0.8], 0.3, [-3.3, -4.7, -4.1]),
            grid([14, 12, 10], [0.5; 3], 0.0, [-4.0, -3.5, -2.0]),
        ];
        for other in others {
            let value = |n: usize| {
                u16::from(other.center(other.voxel(n)).distance_mm(&Point::new(-1.0, 0.3, 0.2)) < 2.9) * 4
            };
            let values: Vec<u16> = (0..other.len()).map(value).collect();
            for (by, fit) in [(MaskRule::AtCentres, Fit::Centres), (MaskRule::Everywhere, Fit::Touched)] {
                let base: Vec<u16> = (0..map.len()).map(|n| u16::from(n % 7 == 0) * 9).collect();
                let read = |grid: &Grid<Ct>, values: &[u16]| LabelsRead {
                    shown: Volume::new(grid.clone(), values.to_vec()).unwrap(),
                    further: vec![],
                    names: vec![],
                    is_segmentation: false,
                };
                let planned = |grid: &Grid<Ct>, values: &[u16]| {
                    let volume = Volume::new(grid.clone(), values.to_vec()).unwrap();
                    let provenance = Provenance { files: vec![], placement: Placement::Nrrd };
                    LabelMap {
                        image: Image { volume, provenance, warnings: vec![] },
                        names: None,
                        further: vec![],
                    }
                };
                let (mut mine, mut theirs) = (read(&map, &base), planned(&map, &base));
                let label = mine.add((&read(&other, &values), Some(4)), by, &[]).unwrap();
                let added = theirs.add((&planned(&other, &values), Some(4)), fit, None).unwrap();
                assert_eq!(label, added.number);
                assert_eq!(mine.shown.grid().dims(), theirs.image.volume.grid().dims());
                assert_eq!(mine.shown.data(), theirs.image.volume.data(), "{by:?} {other:?}");
                let further: Vec<_> = theirs.further.iter().map(|(n, label)| (*n as usize, *label)).collect();
                assert_eq!(mine.further, further);
            }
        }
    }
}
