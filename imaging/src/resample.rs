//! Resamples grey values, density and labels onto the planning grid, once, so that no later stage interpolates.
//!
//! HU are converted to density at each CT voxel, and then density is interpolated, because the calibration curve is not
//! a straight line: a voxel of half bone and half air has the mean of their densities, not the density of their mean HU.
//! Only the part of the CT under the grid is converted. Beyond the image there is air.
//!
//! The map from a grid voxel to a continuous CT index is affine, so along a row the index is a start plus i steps, and
//! the part of a row that lies well inside the image needs no bounds checks. Slices are computed independently, so the
//! result does not depend on the number of threads.

use std::ops::Range;

use bonemill_geometry::{Ct, Grid, Rigid, Volume, Work, cancel};
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

use crate::DensityTable;

/// HU of air, beyond the image.
pub const AIR_HU: f32 = -1000.0;
/// How far inside the box of voxel centres a place must lie to skip the bounds checks, voxels; far above rounding.
const EDGE: f64 = 1e-9;

/// HU on `grid`, trilinear; voxels beyond the image count as `outside_hu`, as in [`Volume::trilinear`].
pub fn resample_hu(
    ct: &Volume<f32, Ct>,
    grid: &Grid<Work>,
    ct_from_work: &Rigid<Ct, Work>,
    outside_hu: f32,
) -> Volume<f32, Work> {
    let (index, source) = (IndexMap::new(ct.grid(), grid, ct_from_work), Source::whole(ct, outside_hu));
    let [nx, ny, _] = grid.dims();
    let mut hu = Volume::filled(grid.clone(), 0.0);
    hu.data_mut()
        .par_chunks_exact_mut(nx)
        .enumerate()
        .for_each(|(row, out)| source.fill_row(&index, [row % ny, row / ny], out));
    hu
}

/// HU and density on `grid`, `(hu, density_g_cm3)`: [`resample_hu`] with [`AIR_HU`] outside; HU calibrated per CT voxel, then
/// trilinear, beyond the image the density of air.
pub fn resample_hu_and_density(
    ct: &Volume<f32, Ct>,
    table: &DensityTable,
    grid: &Grid<Work>,
    ct_from_work: &Rigid<Ct, Work>,
) -> (Volume<f32, Work>, Volume<f32, Work>) {
    let (index, source) = (IndexMap::new(ct.grid(), grid, ct_from_work), Source::whole(ct, AIR_HU));
    let calibrated = Calibrated::new(ct, table, grid, &index);
    let [nx, ny, _] = grid.dims();
    let mut hu = Volume::filled(grid.clone(), 0.0);
    let mut density = Volume::filled(grid.clone(), 0.0);
    let rows = hu.data_mut().par_chunks_exact_mut(nx).zip(density.data_mut().par_chunks_exact_mut(nx));
    rows.enumerate().for_each(|(row, (hu, density))| {
        source.fill_row(&index, [row % ny, row / ny], hu);
        calibrated.source().fill_row(&index, [row % ny, row / ny], density);
    });
    (hu, density)
}

/// The label of the voxel that holds each voxel centre of `grid`; 0 beyond the map.
pub fn resample_nearest(
    labels: &Volume<u16, Ct>,
    grid: &Grid<Work>,
    ct_from_work: &Rigid<Ct, Work>,
) -> Volume<u16, Work> {
    let [nx, ny, _] = grid.dims();
    let index = IndexMap::new(labels.grid(), grid, ct_from_work);
    let [mx, my, mz] = labels.grid().dims();
    let dims = [mx as f64, my as f64, mz as f64];
    let mut resampled = Volume::filled(grid.clone(), 0u16);
    resampled.data_mut().par_chunks_exact_mut(nx).enumerate().for_each(|(row, out)| {
        let start = index.row_start(row % ny, row / ny);
        for (i, value) in out.iter_mut().enumerate() {
            // half a voxel is added, so that the cast, which rounds down, gives the nearest voxel
            let [x, y, z] = index.along(start, i).map(|c| c + 0.5);
            if x >= 0.0 && y >= 0.0 && z >= 0.0 && x < dims[0] && y < dims[1] && z < dims[2] {
                *value = labels.data()[x as usize + mx * (y as usize + my * z as usize)];
            }
        }
    });
    resampled
}

/// The affine map from a voxel of the planning grid to a continuous index of the CT.
struct IndexMap {
    linear: Matrix3<f64>,
    offset: Vector3<f64>,
}

impl IndexMap {
    fn new(ct: &Grid<Ct>, work: &Grid<Work>, ct_from_work: &Rigid<Ct, Work>) -> Self {
        let per_mm = Matrix3::from_diagonal(&ct.spacing_mm().map(f64::recip)) * ct.axes().transpose();
        let turn = ct_from_work.rotation.matrix() * work.axes() * Matrix3::from_diagonal(&work.spacing_mm());
        let offset = ct.continuous_index(*ct_from_work * work.origin());
        Self { linear: per_mm * turn, offset: Vector3::from(offset) }
    }

    fn row_start(&self, j: usize, k: usize) -> Vector3<f64> {
        cancel::poll();
        self.offset + self.linear.column(1) * j as f64 + self.linear.column(2) * k as f64
    }

    #[inline]
    fn along(&self, start: Vector3<f64>, i: usize) -> [f64; 3] {
        let i = i as f64;
        [start.x + self.linear.m11 * i, start.y + self.linear.m21 * i, start.z + self.linear.m31 * i]
    }

    /// The voxels of a row of `n` whose index lies in `lo..=hi` along every axis.
    fn inside(&self, start: Vector3<f64>, n: usize, lo: [f64; 3], hi: [f64; 3]) -> Range<usize> {
        let (mut first, mut last) = (0.0f64, n as f64 - 1.0);
        for a in 0..3 {
            if lo[a] >= hi[a] {
                return 0..0;
            }
            let step = self.linear[(a, 0)];
            if step.abs() < 1e-12 {
                if start[a] < lo[a] || start[a] > hi[a] {
                    return 0..0;
                }
                continue;
            }
            let (t0, t1) = ((lo[a] - start[a]) / step, (hi[a] - start[a]) / step);
            first = first.max(t0.min(t1));
            last = last.min(t0.max(t1));
        }
        let (first, last) = (first.ceil(), last.floor());
        if first > last { 0..0 } else { first as usize..last as usize + 1 }
    }

    /// The smallest and largest CT voxel that interpolation on `work` can read, if any.
    fn touched(&self, work: &Grid<Work>, ct: &Grid<Ct>) -> Option<([usize; 3], [usize; 3])> {
        let (mut lo, mut hi) = ([0; 3], [0; 3]);
        for a in 0..3 {
            let (mut low, mut high) = (self.offset[a], self.offset[a]);
            for b in 0..3 {
                let reach = self.linear[(a, b)] * (work.dims()[b] as f64 - 1.0);
                low += reach.min(0.0);
                high += reach.max(0.0);
            }
            // one voxel more on each side than the corners need
            let (low, high) =
                ((low.floor() - 1.0).max(0.0), (high.floor() + 2.0).min(ct.dims()[a] as f64 - 1.0));
            if low > high {
                return None;
            }
            (lo[a], hi[a]) = (low as usize, high as usize);
        }
        Some((lo, hi))
    }
}

/// The values of a box of CT voxels, and where the box lies.
#[derive(Clone, Copy)]
struct Source<'a> {
    values: &'a [f32],
    dims: [usize; 3],
    first: [usize; 3],
    outside: f32,
}

impl<'a> Source<'a> {
    fn whole(ct: &'a Volume<f32, Ct>, outside: f32) -> Self {
        Self { values: ct.data(), dims: ct.grid().dims(), first: [0; 3], outside }
    }

    /// Computes the values of row (j, k) of the planning grid.
    fn fill_row(&self, index: &IndexMap, [j, k]: [usize; 2], out: &mut [f32]) {
        let start = index.row_start(j, k);
        let lo = self.first.map(|f| f as f64 + EDGE);
        let hi = std::array::from_fn(|a| (self.first[a] + self.dims[a]) as f64 - 1.0 - EDGE);
        let inside = index.inside(start, out.len(), lo, hi);
        for (i, value) in out.iter_mut().enumerate() {
            let place = index.along(start, i);
            *value = if inside.contains(&i) { self.at_inside(place) } else { self.at(place) };
        }
    }

    /// Trilinear interpolation at a place whose eight neighbours all lie in the box.
    #[inline]
    fn at_inside(&self, place: [f64; 3]) -> f32 {
        let [nx, ny, _] = self.dims;
        // the values are not negative, so the cast rounds down
        let base = place.map(|c| c as usize);
        let f: [f32; 3] = std::array::from_fn(|a| (place[a] - base[a] as f64) as f32);
        let at = base[0] - self.first[0] + nx * (base[1] - self.first[1] + ny * (base[2] - self.first[2]));
        let pair = |at: usize| {
            let (a, b) = (self.values[at], self.values[at + 1]);
            a + (b - a) * f[0]
        };
        let along_y = |at: usize| {
            let (a, b) = (pair(at), pair(at + nx));
            a + (b - a) * f[1]
        };
        let (a, b) = (along_y(at), along_y(at + nx * ny));
        a + (b - a) * f[2]
    }

    /// Trilinear interpolation anywhere; neighbours beyond the box count as `outside`.
    fn at(&self, index: [f64; 3]) -> f32 {
        let local: [f64; 3] = std::array::from_fn(|a| index[a] - self.first[a] as f64);
        let floor = local.map(f64::floor);
        if (0..3).any(|a| floor[a] < -1.0 || floor[a] >= self.dims[a] as f64) {
            return self.outside;
        }
        let mut sum = 0.0;
        for corner in 0..8usize {
            let mut weight = 1.0;
            let mut place = Some([0usize; 3]);
            for a in 0..3 {
                let up = corner >> a & 1;
                let fraction = local[a] - floor[a];
                weight *= if up == 1 { fraction } else { 1.0 - fraction };
                let voxel = floor[a] + up as f64;
                if voxel < 0.0 || voxel >= self.dims[a] as f64 {
                    place = None;
                } else if let Some(p) = &mut place {
                    p[a] = voxel as usize;
                }
            }
            let value = place
                .map_or(self.outside, |[i, j, k]| self.values[i + self.dims[0] * (j + self.dims[1] * k)]);
            sum += weight * f64::from(value);
        }
        sum as f32
    }
}

/// The densities of the CT voxels that interpolation on a grid can read.
struct Calibrated {
    values: Vec<f32>,
    dims: [usize; 3],
    first: [usize; 3],
    air_g_cm3: f32,
}

impl Calibrated {
    fn new(ct: &Volume<f32, Ct>, table: &DensityTable, grid: &Grid<Work>, index: &IndexMap) -> Self {
        let air_g_cm3 = table.density_g_cm3(f64::from(AIR_HU)) as f32;
        let Some((first, last)) = index.touched(grid, ct.grid()) else {
            return Self { values: Vec::new(), dims: [0; 3], first: [0; 3], air_g_cm3 };
        };
        let dims: [usize; 3] = std::array::from_fn(|a| last[a] - first[a] + 1);
        let mut values = vec![0.0; dims.iter().product()];
        values.par_chunks_exact_mut(dims[0]).enumerate().for_each(|(row, out)| {
            let start = ct.grid().index([first[0], first[1] + row % dims[1], first[2] + row / dims[1]]);
            for (density, hu) in out.iter_mut().zip(&ct.data()[start..start + dims[0]]) {
                *density = table.density_g_cm3(f64::from(*hu)) as f32;
            }
        });
        Self { values, dims, first, air_g_cm3 }
    }

    /// The box as a source. Interpolation never reads CT voxels outside it, so it can be used in place of the whole image.
    fn source(&self) -> Source<'_> {
        Source { values: &self.values, dims: self.dims, first: self.first, outside: self.air_g_cm3 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bonemill_geometry::Point;
    use nalgebra::Rotation3;
    use proptest::prelude::*;

    fn ct(turn: [f64; 3], mirror: bool, dims: [usize; 3]) -> Volume<f32, Ct> {
        let mut axes = Rotation3::new(Vector3::from(turn)).into_inner();
        if mirror {
            axes.set_column(2, &-axes.column(2));
        }
        let grid = Grid::new(dims, Vector3::new(0.4, 0.5, 0.9), axes, Vector3::new(1.0, -3.0, 2.0)).unwrap();
        // values without a pattern, -1000 to 2000 HU
        let data = (0..grid.len()).map(|n| ((n * 7919 + n * n * 31) % 3001) as f32 - 1000.0).collect();
        Volume::new(grid, data).unwrap()
    }

    fn table() -> DensityTable {
        DensityTable::new(&[-1000.0, -150.0, 300.0, 2000.0], &[0.01, 0.924, 1.145, 1.856]).unwrap()
    }

    proptest! {
        #[test]
        fn every_voxel_is_the_direct_interpolation(
            turn in prop::array::uniform3(-3.0f64..3.0), mirror: bool, aligned: bool,
            work_turn in prop::array::uniform3(-3.0f64..3.0), shift in prop::array::uniform3(-4.0f64..4.0),
            dims in prop::array::uniform3(1usize..12),
        ) {
            let ct = ct(turn, mirror, dims);
            let rotation = if aligned && !mirror {
                Rotation3::from_matrix_unchecked(*ct.grid().axes())
            } else {
                Rotation3::new(Vector3::from(work_turn))
            };
            let ct_from_work: Rigid<Ct, Work> = Rigid::new(rotation, Vector3::from(shift));
            let grid = Grid::aligned([14, 9, 8], 0.37, Point::new(0.0, 0.0, 0.0)).unwrap();
            let table = table();
            let calibrated = ct.map(|v| table.density_g_cm3(f64::from(*v)) as f32);
            let labels = ct.map(|v| (*v + 1000.0) as u16);

            let hu = resample_hu(&ct, &grid, &ct_from_work, -900.0);
            let (hu_in_air, density) = resample_hu_and_density(&ct, &table, &grid, &ct_from_work);
            let nearest = resample_nearest(&labels, &grid, &ct_from_work);
            let in_air = resample_hu(&ct, &grid, &ct_from_work, AIR_HU);
            prop_assert_eq!(hu_in_air.data(), in_air.data());
            for n in 0..grid.len() {
                let p = ct_from_work * grid.center(grid.voxel(n));
                prop_assert!((f64::from(hu.data()[n]) - ct.trilinear(p, -900.0)).abs() < 2e-3);
                let air = f64::from(table.density_g_cm3(-1000.0) as f32);
                prop_assert!((f64::from(density.data()[n]) - calibrated.trilinear(p, air)).abs() < 2e-6);
                // a point on a voxel's face may fall to either side by rounding
                let c = ct.grid().continuous_index(p);
                if c.iter().all(|c| ((c + 0.5) - (c + 0.5).round()).abs() > 1e-9) {
                    let expected = labels.grid().nearest(p).map_or(0, |v| *labels.get(v));
                    prop_assert_eq!(nearest.data()[n], expected);
                }
            }
        }
    }

    #[test]
    fn density_is_calibrated_before_it_is_interpolated() {
        let grid = Grid::new([2, 1, 1], Vector3::repeat(1.0), Matrix3::identity(), Vector3::zeros()).unwrap();
        let ct = Volume::new(grid, vec![-1000.0, 300.0]).unwrap();
        let work = Grid::aligned([1, 1, 1], 0.5, Point::new(0.0, 0.0, 0.0)).unwrap();
        let middle: Rigid<Ct, Work> = Rigid::new(Rotation3::identity(), Vector3::new(0.5, 0.0, 0.0));
        let density = resample_hu_and_density(&ct, &table(), &work, &middle).1.data()[0];
        assert!((density - 0.5 * (0.01 + 1.145)).abs() < 1e-6, "{density}");
    }

    #[test]
    fn the_number_of_threads_changes_nothing() {
        let ct = ct([0.2, 0.5, -0.3], false, [11, 10, 9]);
        let grid = Grid::aligned([20, 20, 20], 0.2, Point::new(0.0, 0.0, 0.0)).unwrap();
        let place: Rigid<Ct, Work> =
            Rigid::new(Rotation3::new(Vector3::new(0.1, 0.2, 0.3)), Vector3::zeros());
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| resample_hu(&ct, &grid, &place, AIR_HU).into_parts().1)
        };
        assert_eq!(run(1), run(3));
    }
}
