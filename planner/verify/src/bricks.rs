//! The points that still stand at a given move, and whether a cylinder touches them: every point in the cylinder is tested.
//!
//! Each point of a grid stands until a given move; each block of 8×8×8 points stores the latest of these moves, so that a
//! block in which nothing stands is skipped. Coordinates are along the grid's own axes, in mm.

use bonemill_geometry::{Frame, Grid, cancel};
use nalgebra::Vector3;
use rayon::prelude::*;

/// Side of a block, points.
const EDGE: usize = 8;

/// Distance from a cylinder's surface up to which standing points are searched, mm, so that small distances are known.
pub const LOOK_MM: f64 = 0.25;

/// A cylinder around a shaft: the points between `from_mm` and `to_mm` along the axis and within the radius.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cylinder {
    /// Start along the axis, from the burr's centre, mm.
    pub from_mm: f64,
    /// End along the axis, mm.
    pub to_mm: f64,
    /// Radius, mm.
    pub radius_mm: f64,
}

impl Cylinder {
    /// Depth of a point inside, mm, given its position along the axis and its distance from it; negative outside.
    pub fn depth_mm(&self, along_mm: f64, off_mm: f64) -> f64 {
        (self.radius_mm - off_mm).min(along_mm - self.from_mm).min(self.to_mm - along_mm)
    }
}

/// Points of a grid, each with the number of the first move at which it no longer stands.
#[derive(Debug)]
pub struct Bricks<F: Frame> {
    grid: Grid<F>,
    until: Vec<u32>,
    blocks: [usize; 3],
    latest: Vec<u32>,
}

impl<F: Frame> Bricks<F> {
    /// The points with the given numbers, x-fastest: a point stands before every move of a number below its own; with 0 it never
    /// stands.
    pub fn new(grid: Grid<F>, until: Vec<u32>) -> Self {
        let dims = grid.dims();
        let blocks = dims.map(|d| d.div_ceil(EDGE));
        let latest = (0..blocks.iter().product::<usize>())
            .into_par_iter()
            .map(|b| {
                cancel::poll();
                let [x, y, z] = ranges(blocks, dims, b);
                z.flat_map(|k| y.clone().map(move |j| (j, k)))
                    .filter_map(|(j, k)| {
                        let row = dims[0] * (j + dims[1] * k);
                        until[row + x.start..row + x.end].iter().max().copied()
                    })
                    .max()
                    .unwrap_or(0)
            })
            .collect();
        Self { grid, until, blocks, latest }
    }

    /// The standing point deepest in the cylinder at a move: (depth mm, point). Points up to [`LOOK_MM`] outside are included,
    /// with negative depth; `None` if nothing stands that near. `center`, `axis`: the burr's centre and the shaft in F.
    pub fn deepest(
        &self,
        center: &Vector3<f64>,
        axis: &Vector3<f64>,
        cylinder: &Cylinder,
        moment: u32,
    ) -> Option<(f64, usize)> {
        let turn = self.grid.axes().transpose();
        let (center, axis) = (turn * (center - self.grid.origin().coords), turn * axis);
        let spacing = self.grid.spacing_mm();
        let dims = self.grid.dims();
        let mut best: Option<(f64, usize)> = None;
        let [bx, by, bz] = self.blocks_around(&center, &axis, cylinder)?;
        let half = spacing * (0.5 * (EDGE - 1) as f64);
        let reach_mm = half.norm() + LOOK_MM;
        for (z, y, x) in bz.flat_map(|z| {
            let bx = bx.clone();
            by.clone().flat_map(move |y| bx.clone().map(move |x| (z, y, x)))
        }) {
            let block = x + self.blocks[0] * (y + self.blocks[1] * z);
            if self.latest[block] <= moment {
                continue;
            }
            let corner = Vector3::new(x as f64, y as f64, z as f64) * EDGE as f64;
            let (along, off) = place(&(corner.component_mul(&spacing) + half - center), &axis);
            if cylinder.depth_mm(along, off) < -reach_mm {
                continue;
            }
            let [xs, ys, zs] = ranges(self.blocks, dims, block);
            for k in zs {
                for j in ys.clone() {
                    let row = dims[0] * (j + dims[1] * k);
                    for i in xs.clone().filter(|i| self.until[row + i] > moment) {
                        let p = Vector3::new(i as f64, j as f64, k as f64).component_mul(&spacing);
                        let (along, off) = place(&(p - center), &axis);
                        let depth = cylinder.depth_mm(along, off);
                        if depth > best.map_or(-LOOK_MM, |b| b.0) {
                            best = Some((depth, row + i));
                        }
                    }
                }
            }
        }
        best
    }

    /// Blocks that the cylinder's box meets; `None` when it lies beyond the grid.
    fn blocks_around(
        &self,
        center: &Vector3<f64>,
        axis: &Vector3<f64>,
        cylinder: &Cylinder,
    ) -> Option<[std::ops::Range<usize>; 3]> {
        let ends = [center + axis * cylinder.from_mm, center + axis * cylinder.to_mm];
        // half-width of a disc's box across each axis
        let wide = axis.map(|a| cylinder.radius_mm * (1.0 - a * a).max(0.0).sqrt() + LOOK_MM);
        let (lo, hi) = (ends[0].inf(&ends[1]) - wide, ends[0].sup(&ends[1]) + wide);
        let spacing = self.grid.spacing_mm();
        let mut found: [std::ops::Range<usize>; 3] = Default::default();
        for a in 0..3 {
            let block_mm = spacing[a] * EDGE as f64;
            let first = (lo[a] / block_mm).floor().max(0.0);
            let last = ((hi[a] / block_mm).floor() + 1.0).min(self.blocks[a] as f64);
            if last <= first || last.is_nan() {
                return None;
            }
            found[a] = first as usize..last as usize;
        }
        Some(found)
    }
}

/// Position along a unit axis and distance from the axis, for a vector from a point on it.
pub fn place(v: &Vector3<f64>, axis: &Vector3<f64>) -> (f64, f64) {
    let along = v.dot(axis);
    (along, (v - axis * along).norm())
}

/// The points of a block along each axis.
fn ranges(blocks: [usize; 3], dims: [usize; 3], block: usize) -> [std::ops::Range<usize>; 3] {
    let at = [block % blocks[0], block / blocks[0] % blocks[1], block / (blocks[0] * blocks[1])];
    std::array::from_fn(|a| at[a] * EDGE..((at[a] + 1) * EDGE).min(dims[a]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use bonemill_geometry::Ct;
    use nalgebra::Rotation3;

    #[test]
    fn the_deepest_point_is_that_of_every_point_asked_one_by_one() {
        let axes = Rotation3::new(Vector3::new(0.2, 0.5, -0.3)).into_inner();
        let grid =
            Grid::<Ct>::new([21, 19, 30], Vector3::new(0.4, 0.5, 0.3), axes, Vector3::new(1.0, 2.0, 3.0))
                .unwrap();
        let until: Vec<u32> = (0..grid.len()).map(|n| ((n * 7919) % 97) as u32).collect();
        let bricks = Bricks::new(grid.clone(), until.clone());
        let cylinder = Cylinder { from_mm: 0.8, to_mm: 6.0, radius_mm: 0.6 };
        let mut touched = 0;
        for n in 0..200usize {
            let center = grid.at([(n % 17) as f64, (n % 13) as f64, (n % 29) as f64]).coords;
            let axis = Vector3::new((n % 5) as f64 - 2.0, (n % 7) as f64 - 3.0, 1.0).normalize();
            let moment = 90 + (n % 7) as u32;
            let brute = (0..grid.len())
                .filter(|m| until[*m] > moment)
                .map(|m| {
                    let (along, off) = place(&(grid.center(grid.voxel(m)).coords - center), &axis);
                    cylinder.depth_mm(along, off)
                })
                .fold(f64::NEG_INFINITY, f64::max);
            match bricks.deepest(&center, &axis, &cylinder, moment) {
                Some((depth, _)) => {
                    touched += 1;
                    assert!((depth - brute).abs() < 1e-12, "{depth} against {brute}");
                }
                None => assert!(brute <= -LOOK_MM + 1e-12, "{brute}"),
            }
        }
        assert!(touched > 50, "{touched}");
    }
}
