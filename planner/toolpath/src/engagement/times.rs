//! Removal times of the voxels around a point, and of all voxels near it.

use crate::scene::Class;
use bonemill_cutting::stock::removal::NEVER;
use bonemill_geometry::{Grid, Volume, Work, cancel};
use nalgebra::Vector3;
use rayon::prelude::*;

use crate::neighbours::joined;

/// Removal times of the eight voxels around a point. If neither they nor the voxels beside them have mass, the time is before
/// every move.
#[derive(Debug, Clone, Copy)]
pub(super) struct CellTimes {
    pub(super) first: u32,
    pub(super) last: u32,
}

/// [`CellTimes`] of every cell, at its first voxel.
pub(super) fn cell_times(class: &Volume<Class, Work>, time: &[u32]) -> Vec<CellTimes> {
    let [nx, ny, nz] = class.grid().dims();
    // there may be bone between voxel centres
    let has_mass: Vec<u8> = class.data().iter().map(|class| class.0 & Class::HAS_MASS).collect();
    let near_mass = joined(&has_mass, class.grid().dims(), |a, b| a | b);
    let slab = nx * ny;
    let steps = [0, 1, nx, nx + 1, slab, slab + 1, slab + nx, slab + nx + 1];
    let mut times = vec![CellTimes { first: 0, last: 0 }; time.len()];
    times.par_chunks_mut(slab).enumerate().take(nz.saturating_sub(1)).for_each(|(k, cells)| {
        cancel::poll();
        for j in 0..ny.saturating_sub(1) {
            for i in 0..nx.saturating_sub(1) {
                let voxels = steps.map(|step| k * slab + j * nx + i + step);
                if voxels.iter().any(|v| near_mass[*v] != 0) {
                    let ends = voxels.iter().map(|v| time[*v]);
                    cells[j * nx + i] =
                        CellTimes { first: ends.clone().fold(NEVER, u32::min), last: ends.fold(0, u32::max) };
                }
            }
        }
    });
    times
}

/// The latest of [`CellTimes`] in each block of cells and the blocks around it.
#[derive(Debug)]
pub(super) struct LastTimes {
    dims: [usize; 3],
    value: Vec<u32>,
    per_mm: f64,
    /// Largest radius of a query, mm.
    reach_mm: f64,
}

impl LastTimes {
    /// Side of a block, cells.
    const SIDE: usize = 2;

    /// The latest times of a grid's cells, for queries of up to `reach_mm` around a point.
    pub(super) fn new(times: &[CellTimes], grid: &Grid<Work>, reach_mm: f64) -> Self {
        let ([nx, ny, nz], spacing_mm) = (grid.dims(), grid.spacing_mm().x);
        let block_mm = Self::SIDE as f64 * spacing_mm;
        let blocks = (reach_mm / block_mm).ceil().max(1.0) as usize;
        let dims = [nx, ny, nz].map(|n| n.div_ceil(Self::SIDE));
        let [bx, by, _] = dims;
        let mut value = vec![0; dims.iter().product()];
        value.par_chunks_mut(bx * by).enumerate().for_each(|(block, slab)| {
            cancel::poll();
            for k in block * Self::SIDE..((block + 1) * Self::SIDE).min(nz) {
                for j in 0..ny {
                    let blocks = &mut slab[bx * (j / Self::SIDE)..][..bx];
                    for (i, times) in times[nx * (j + ny * k)..][..nx].iter().enumerate() {
                        let latest = &mut blocks[i / Self::SIDE];
                        *latest = times.last.max(*latest);
                    }
                }
            }
        });
        for _ in 0..blocks {
            value = joined(&value, dims, u32::max);
        }
        Self { dims, value, per_mm: 1.0 / spacing_mm, reach_mm: blocks as f64 * block_mm }
    }

    /// An upper bound of the removal times of the cells within `around_mm` of `p`; `None` where it is not known.
    pub(super) fn around(&self, p: &Vector3<f64>, around_mm: f64) -> Option<u32> {
        let block = |a: usize| {
            let cell = p[a] * self.per_mm;
            let block = cell as usize / Self::SIDE;
            (cell >= 0.0 && block < self.dims[a]).then_some(block)
        };
        let [i, j, k] = [block(0)?, block(1)?, block(2)?];
        (around_mm <= self.reach_mm).then(|| self.value[i + self.dims[0] * (j + self.dims[1] * k)])
    }
}
