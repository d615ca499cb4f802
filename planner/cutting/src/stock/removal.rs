//! The removal-time field: the move that first cuts each voxel.
//!
//! A ball's sweep does not depend on the shaft's direction. So for a given path the move T(x) in which the burr first covers
//! the voxel centre x is one static field, and the bone before move i is [T ≥ i]. Move i ends at waypoint i; waypoint 0 is
//! the burr's first position. With this field, waypoints can be processed independently and in any order.

use std::ops::Range;

use crate::cutter::Ball;
use bonemill_geometry::{Grid, Point, Work};

use crate::stock::runs::{straight_runs, take_runs};
use crate::stock::sweep::Rows;
use crate::stock::voxels::VoxelSet;

/// T of a voxel that no move covers.
pub const NEVER: u32 = u32::MAX;

/// T(x) for every voxel of the planning grid, inside and outside the target.
#[derive(Debug, Clone)]
pub struct RemovalTime {
    rows: Rows,
    time: Vec<u32>,
    /// The voxels that no move has covered.
    standing: VoxelSet,
}

impl RemovalTime {
    /// The field before any move: nothing is removed.
    pub fn new(grid: &Grid<Work>) -> Self {
        let standing = VoxelSet::of(grid.len(), |_| true);
        Self { rows: Rows::of(grid), time: vec![NEVER; grid.len()], standing }
    }

    /// T per voxel, x-fastest; [`NEVER`] where no move covers the voxel.
    pub fn time(&self) -> &[u32] {
        &self.time
    }

    /// Whether some move covered the voxel.
    pub fn is_removed(&self, voxel: usize) -> bool {
        self.time[voxel] != NEVER
    }

    /// Sweeps a ball along moves of a path whose positions are `at`; calls `removed` with each voxel that they cover first.
    pub fn sweep(
        &mut self,
        moves: Range<u32>,
        at: impl Fn(u32) -> Point<Work>,
        ball: Ball,
        mut removed: impl FnMut(usize),
    ) {
        let Self { rows, time, standing } = self;
        let runs = straight_runs(moves, &at);
        take_runs(&runs, at, rows, ball, standing, |voxel, index| {
            time[voxel] = index;
            removed(voxel);
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn grid() -> Grid<Work> {
        Grid::aligned([30, 28, 26], 0.25, Point::new(0.0, 0.0, 0.0)).unwrap()
    }

    fn field(path: &[[f64; 3]]) -> RemovalTime {
        let mut field = RemovalTime::new(&grid());
        let at = |n: usize| Point::from_coords(path[n].into());
        field.sweep(0..path.len() as u32, |n| at(n as usize), Ball { radius_mm: 1.1 }, |_| ());
        field
    }

    proptest! {
        /// The same moves in another order remove the same voxels, only at other times.
        #[test]
        fn what_is_removed_does_not_depend_on_the_order(path in prop::collection::vec(prop::array::uniform3(0.0f64..7.0), 2..12)) {
            let there = field(&path);
            let back = field(&path.iter().rev().copied().collect::<Vec<_>>());
            for voxel in 0..grid().len() {
                prop_assert_eq!(there.is_removed(voxel), back.is_removed(voxel));
            }
        }

        /// Lengthening a path restores no bone and changes no earlier removal time.
        #[test]
        fn removal_is_monotone(path in prop::collection::vec(prop::array::uniform3(0.0f64..7.0), 3..12)) {
            let whole = field(&path);
            let part = field(&path[..path.len() - 1]);
            for (w, p) in whole.time().iter().zip(part.time()) {
                prop_assert!(w == p || (*p == NEVER && *w as usize == path.len() - 1));
            }
        }
    }

    #[test]
    fn each_voxel_is_told_once() {
        let mut f = RemovalTime::new(&grid());
        let (a, b) = (Point::new(1.0, 2.0, 3.0), Point::new(5.0, 4.0, 2.0));
        let expected = f.standing.count_within(&f.rows, [a, b], 1.3, usize::MAX);
        let (mut told, ball) = (0, Ball { radius_mm: 1.3 });
        let at = |n: u32| if n == 6 { a } else { b };
        f.sweep(7..8, at, ball, |_| told += 1);
        assert!(told == expected && told > 1000);
        f.sweep(8..9, at, ball, |voxel| panic!("{voxel} goes again"));
        assert_eq!(f.time().iter().filter(|t| **t == 7).count(), told);
    }
}
