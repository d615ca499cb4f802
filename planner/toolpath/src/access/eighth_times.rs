//! Removal times of each eighth of a voxel, on a lattice of half the spacing.
//!
//! A voxel whose centre is removed may keep a corner, for a few moves or for good, and the shank may meet this corner. An
//! eighth counts as removed when its own centre is.

use bonemill_cutting::cutter::Ball;
use bonemill_cutting::stock::removal::NEVER;
use bonemill_cutting::stock::runs::{straight_runs, take_runs};
use bonemill_cutting::stock::sweep::Rows;
use bonemill_cutting::stock::voxels::VoxelSet;
use nalgebra::Vector3;
use rayon::prelude::*;

use super::solid::ShankObstacles;
use crate::path::PathPoint;

/// Number of layers of eighths that one task sweeps; for a move that does not reach them it only makes one comparison.
const LAYERS: usize = 16;

/// The first move whose ball covers each eighth, over the box of the voxels with removable eighths.
#[derive(Debug, Clone)]
pub struct EighthTimes {
    /// The first voxel of the box.
    first: [usize; 3],
    /// Number of eighths along each axis.
    dims: [usize; 3],
    /// Removal time of each eighth, x-fastest.
    time: Vec<u32>,
}

impl EighthTimes {
    /// Sweeps the path. Each task has its own layers, so the result does not depend on the number of threads.
    pub fn new(solid: &ShankObstacles, points: &[PathPoint], ball: Ball) -> Self {
        let (grid, (first, dims)) = (solid.grid(), eighths_that_go(solid));
        let half_mm = 0.5 * grid.spacing_mm().x;
        let slab = dims[0] * dims[1];
        let mut time = vec![NEVER; slab * dims[2]];
        let runs = straight_runs(0..points.len() as u32, |n| points[n as usize].position);
        time.par_chunks_mut((slab * LAYERS).max(1)).enumerate().for_each(|(portion, time)| {
            let below = portion * LAYERS;
            let goes = |n: usize| {
                let fine = [n % dims[0], n / dims[0] % dims[1], below + n / slab];
                let voxel = std::array::from_fn(|a| first[a] + fine[a] / 2);
                let eighth = fine[0] & 1 | (fine[1] & 1) << 1 | (fine[2] & 1) << 2;
                solid.goes(grid.index(voxel)) >> eighth & 1 == 1
            };
            let mut standing = VoxelSet::of(time.len(), goes);
            let rows = Rows::new([dims[0], dims[1], time.len() / slab], half_mm);
            // the rows begin at the centre of the portion's first eighth
            let lowest = grid.center(first).coords - Vector3::repeat(0.5 * half_mm);
            let origin = lowest + Vector3::z() * (below as f64 * half_mm);
            let at = |n: u32| points[n as usize].position + -origin;
            take_runs(&runs, at, &rows, ball, &mut standing, |n, index| time[n] = index);
        });
        Self { first, dims, time }
    }

    /// Times of a voxel's eighths, in the order of [`ShankObstacles`]'s bits; [`NEVER`] for those that are not removed.
    pub fn of(&self, voxel: [usize; 3]) -> [u32; 8] {
        let low: [usize; 3] = std::array::from_fn(|a| voxel[a].wrapping_sub(self.first[a]));
        if (0..3).any(|a| low[a] >= self.dims[a] / 2) {
            return [NEVER; 8];
        }
        std::array::from_fn(|n| {
            let [i, j, k] = [0, 1, 2].map(|a| 2 * low[a] + (n >> a & 1));
            self.time[i + self.dims[0] * (j + self.dims[1] * k)]
        })
    }
}

/// The first voxel of the box of the voxels with removable eighths, and the number of the box's eighths along each axis.
fn eighths_that_go(solid: &ShankObstacles) -> ([usize; 3], [usize; 3]) {
    let going = solid.going();
    (going.clone().map(|range| range.start), going.map(|range| 2 * range.len()))
}
