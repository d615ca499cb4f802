//! One grid node per cube of voxels: candidate positions of the burr's centre, about a quarter of a millimetre apart for any
//! spacing of the grid.
//!
//! A ball contains about (r/h)³ voxels of side h, and a voxel lies in the balls around as many nodes. The cost of choosing
//! among all nodes would grow with the square of that; choosing among one node per cell costs no more than there are voxels.

use rayon::prelude::*;

use crate::space::BurrSpace;

/// No node.
const NONE: u32 = u32::MAX;

/// Cubes of voxels, x-fastest, each with one of its connected nodes if it has any.
#[derive(Debug)]
pub(super) struct Cells {
    side: usize,
    dims: [usize; 3],
    node: Vec<u32>,
}

impl Cells {
    /// Cubes of `side`³ voxels. The node of each cube is the one with the least margin: it is nearest to what limits the burr,
    /// and bone is left there. Among equal margins it is the one nearest to the cube's middle. Nodes with a margin above
    /// `most_margin_mm` are not used.
    pub(super) fn new(space: &BurrSpace, side: usize, most_margin_mm: f32) -> Self {
        let grid = space.grid();
        let dims = grid.dims().map(|n| n.div_ceil(side));
        let of = |cell: usize| {
            let first =
                [cell % dims[0], cell / dims[0] % dims[1], cell / (dims[0] * dims[1])].map(|c| c * side);
            let along = |axis: usize| first[axis]..(first[axis] + side).min(grid.dims()[axis]);
            let mut best = (f32::INFINITY, usize::MAX, NONE);
            for k in along(2) {
                for j in along(1) {
                    for i in along(0) {
                        let node = grid.index([i, j, k]);
                        if space.connected()[node] && space.margin_mm(node) <= most_margin_mm {
                            let off = [i - first[0], j - first[1], k - first[2]];
                            let off: usize = off.iter().map(|off| (2 * off + 1).abs_diff(side).pow(2)).sum();
                            let found = (space.margin_mm(node), off, node as u32);
                            best = if found < best { found } else { best };
                        }
                    }
                }
            }
            best.2
        };
        let node = (0..dims.iter().product()).into_par_iter().with_min_len(1 << 10).map(of).collect();
        Self { side, dims, node }
    }

    /// Side of a cube, voxels.
    pub(super) fn side(&self) -> usize {
        self.side
    }

    /// Number of cubes.
    pub(super) fn len(&self) -> usize {
        self.node.len()
    }

    /// Number of cubes with a node.
    pub(super) fn nodes(&self) -> usize {
        self.node.iter().filter(|node| **node != NONE).count()
    }

    /// The node of a cube.
    pub(super) fn node(&self, cell: usize) -> Option<usize> {
        Some(self.node[cell]).filter(|node| *node != NONE).map(|node| node as usize)
    }

    /// The cube at an offset from another, in cubes, if there is one.
    pub(super) fn at_offset(&self, cell: usize, offset: [i64; 3]) -> Option<usize> {
        let [nx, ny, _] = self.dims;
        let at = [cell % nx, cell / nx % ny, cell / (nx * ny)];
        let moved = |a: usize| at[a].checked_add_signed(offset[a] as isize).filter(|v| *v < self.dims[a]);
        Some(moved(0)? + nx * (moved(1)? + ny * moved(2)?))
    }
}
