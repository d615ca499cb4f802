//! The eighths of each voxel that the shank must not touch.
//!
//! A voxel has the class of its centre. A free voxel may still contain a part of the bone or structure beside it. So an
//! eighth towards a solid neighbour has the neighbour's class, and a whole voxel beside a structure counts as the structure,
//! because the structure's own voxels (on the label map's grid) may end anywhere in it.

use std::ops::Range;

use crate::scene::{Class, Scene};
use bonemill_geometry::{Grid, Point, Work, cancel};
use nalgebra::Vector3;
use rayon::prelude::*;

use crate::neighbours::joined;

/// All eighths of a voxel.
const ALL: u8 = 0xff;

/// The solid eighths of each voxel, both permanent ones and those that the burr removes. Bit n is the eighth on the upper
/// side along x, y and z where bits 0, 1 and 2 of n are set.
#[derive(Debug)]
pub struct ShankObstacles {
    grid: Grid<Work>,
    stays: Vec<u8>,
    goes: Vec<u8>,
    /// The box of the voxels with removable eighths.
    going: [Range<usize>; 3],
}

impl ShankObstacles {
    /// The obstacles of a scene. `shank_clearances_mm`: one per structure.
    pub fn new(scene: &Scene, shank_clearances_mm: &[f64]) -> Self {
        let grid = scene.class.grid().clone();
        let class = scene.class.data();
        let seen = Class::STRUCTURE | Class::OBSTACLE | Class::MATERIAL;
        let own: Vec<u8> = class.iter().map(|class| class.0 & seen).collect();
        let around = joined(&own, grid.dims(), |a, b| a | b);
        let hidden_mm = 0.5 * grid.diagonal_mm();
        // without a clearance, the structure's own voxels and those beside them suffice
        let with_clearance: Vec<_> = scene
            .structures
            .iter()
            .zip(shank_clearances_mm)
            .filter(|(_, clearance)| **clearance > 0.0)
            .filter_map(|(structure, clearance)| Some((structure.field.as_ref()?, clearance + hidden_mm)))
            .collect();
        let is_kept_clear = |n: usize| {
            let p = || scene.ct_from_work * grid.center(grid.voxel(n));
            with_clearance.iter().any(|(field, mm)| field.is_nearer_than(p(), *mm))
        };
        let of = |n: usize| -> (u8, u8) {
            cancel::poll();
            if around[n] & Class::STRUCTURE != 0 || class[n].is(Class::OBSTACLE) || is_kept_clear(n) {
                (ALL, 0)
            } else if class[n].is(Class::MATERIAL) {
                (0, ALL)
            } else if around[n] != 0 {
                facing(&grid, class, n)
            } else {
                (0, 0)
            }
        };
        let (stays, goes): (Vec<u8>, Vec<u8>) = (0..grid.len()).into_par_iter().map(of).unzip();
        let going = hull(&grid, &goes);
        Self { grid, stays, goes, going }
    }

    /// The grid of the voxels.
    pub fn grid(&self) -> &Grid<Work> {
        &self.grid
    }

    /// Eighths of a voxel that no move removes.
    pub fn stays(&self, voxel: usize) -> u8 {
        self.stays[voxel]
    }

    /// Eighths of a voxel that are solid until the burr covers them.
    pub fn goes(&self, voxel: usize) -> u8 {
        self.goes[voxel]
    }

    /// The box of the voxels with removable eighths, per axis.
    pub fn going(&self) -> [Range<usize>; 3] {
        self.going.clone()
    }

    /// Centres of a voxel's eighths, mm in work.
    pub fn centers(&self, voxel: usize) -> [Point<Work>; 8] {
        let center = self.grid.center(self.grid.voxel(voxel));
        let quarter_mm = 0.25 * self.grid.spacing_mm().x;
        std::array::from_fn(|n| {
            center + Vector3::from([0, 1, 2].map(|a| if n >> a & 1 == 1 { quarter_mm } else { -quarter_mm }))
        })
    }
}

/// Eighths of a free voxel that face obstacles, and those that face only the target's material.
fn facing(grid: &Grid<Work>, class: &[Class], n: usize) -> (u8, u8) {
    let (voxel, dims) = (grid.voxel(n), grid.dims());
    let (mut stays, mut goes) = (0, 0);
    for eighth in 0..8usize {
        // the seven neighbours that share the eighth's outer corner
        let met = (1..8usize).filter_map(|toward| {
            let mut at = voxel;
            for a in (0..3).filter(|a| toward >> a & 1 == 1) {
                at[a] = if eighth >> a & 1 == 1 { at[a] + 1 } else { at[a].checked_sub(1)? };
            }
            (0..3).all(|a| at[a] < dims[a]).then(|| class[grid.index(at)])
        });
        let (mut obstacle, mut material) = (false, false);
        for class in met {
            obstacle |= class.is(Class::OBSTACLE);
            material |= class.is(Class::MATERIAL);
        }
        stays |= u8::from(obstacle) << eighth;
        goes |= u8::from(material && !obstacle) << eighth;
    }
    (stays, goes)
}

/// The box of the voxels with a value other than 0, per axis; empty if there are none.
fn hull(grid: &Grid<Work>, value: &[u8]) -> [Range<usize>; 3] {
    let dims = grid.dims();
    let [nx, ny, _] = dims;
    let none = || dims.map(|n| n..0);
    let join = |mut a: [Range<usize>; 3], b: [Range<usize>; 3]| {
        for (a, b) in a.iter_mut().zip(b) {
            *a = a.start.min(b.start)..a.end.max(b.end);
        }
        a
    };
    let slab = |(k, slab): (usize, &[u8])| {
        let held = slab.iter().enumerate().filter(|(_, value)| **value != 0);
        held.map(|(n, _)| [n % nx, n / nx, k].map(|i| i..i + 1)).fold(none(), join)
    };
    let found = value.par_chunks((nx * ny).max(1)).enumerate().map(slab).reduce(none, join);
    if found.iter().any(Range::is_empty) { [0..0, 0..0, 0..0] } else { found }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bonemill_geometry::Point;

    fn grid() -> Grid<Work> {
        Grid::aligned([5, 4, 3], 0.5, Point::new(0.0, 0.0, 0.0)).unwrap()
    }

    #[test]
    fn eighths_face_the_neighbours_that_share_their_corner() {
        let grid = grid();
        let mut class = vec![Class(0); grid.len()];
        class[grid.index([2, 1, 1])] = Class(Class::MATERIAL);
        // bits 0, 2, 4, 6 are the lower eighths along x, the others the upper ones
        assert_eq!(facing(&grid, &class, grid.index([1, 1, 1])), (0, 0b1010_1010));
        assert_eq!(facing(&grid, &class, grid.index([3, 1, 1])), (0, 0b0101_0101));
        // across an edge: the lower ones along y, the upper ones along x
        assert_eq!(facing(&grid, &class, grid.index([1, 2, 1])), (0, 0b0010_0010));
        class[grid.index([1, 0, 0])] = Class(Class::OBSTACLE);
        assert_eq!(facing(&grid, &class, grid.index([1, 1, 1])), (0b0000_0011, 0b1010_1000));
    }

    #[test]
    fn the_hull_holds_all_and_no_more() {
        let grid = grid();
        let mut value = vec![0; grid.len()];
        assert_eq!(hull(&grid, &value), [0..0, 0..0, 0..0]);
        value[grid.index([1, 2, 0])] = 4;
        value[grid.index([3, 1, 2])] = 1;
        assert_eq!(hull(&grid, &value), [1..4, 1..3, 0..3]);
    }
}
