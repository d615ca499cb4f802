//! Finds the move that first reaches each point of a lattice, by testing every point of every capsule.
//!
//! A move sweeps the points within the burr's radius of its segment. Long moves are divided into pieces, so that the searched
//! boxes stay small. Slabs of the lattice are independent, so the result does not depend on the number of threads.

use bonemill_geometry::{Grid, Work, cancel};
use nalgebra::Vector3;
use rayon::prelude::*;

use super::lattice::FineLattice;
use super::voxels::{DOUBT_MM, Doubtful};

/// The number for a point that no move reaches.
pub const NEVER: u32 = u32::MAX;

/// Longest piece of a move searched at once, mm.
const PIECE_MM: f64 = 1.0;

/// A straight piece of the burr's path, and the number of its move.
#[derive(Debug, Clone, Copy)]
pub struct MoveSegment {
    /// Start, mm in work.
    pub a: Vector3<f64>,
    /// End, mm in work.
    pub b: Vector3<f64>,
    /// Number of its move.
    pub number: u32,
}

impl MoveSegment {
    /// Squared distance from a point, mm².
    pub fn squared(&self, p: &Vector3<f64>) -> f64 {
        self.away(p).norm_squared()
    }

    /// The vector to a point from the nearest place of the piece, mm.
    pub fn away(&self, p: &Vector3<f64>) -> Vector3<f64> {
        let d = self.b - self.a;
        let length2 = d.norm_squared();
        let t = if length2 > 0.0 { ((p - self.a).dot(&d) / length2).clamp(0.0, 1.0) } else { 0.0 };
        p - self.a - d * t
    }
}

/// What a plan's moves reach of the fine lattice.
#[derive(Debug, Clone, Copy)]
pub struct Removed<'a> {
    /// The lattice.
    pub lattice: &'a FineLattice,
    /// The moves in pieces.
    pub pieces: &'a [MoveSegment],
    /// The move that first reaches each point of the lattice; [`NEVER`] where there is none.
    pub first: &'a [u32],
}

/// The moves through `points`, divided into pieces; move 0 is the first point itself.
pub fn pieces(points: &[Vector3<f64>]) -> Vec<MoveSegment> {
    let mut found: Vec<MoveSegment> =
        points.first().map(|p| MoveSegment { a: *p, b: *p, number: 0 }).into_iter().collect();
    for (pair, number) in points.windows(2).zip(1u32..) {
        let (a, d) = (pair[0], pair[1] - pair[0]);
        let count = (d.norm() / PIECE_MM).ceil().max(1.0);
        for n in 0..count as usize {
            let at = |n: usize| a + d * (n as f64 / count);
            found.push(MoveSegment { a: at(n), b: at(n + 1), number });
        }
    }
    found
}

/// For each point of the lattice, the number of the first move within `radius_mm`; [`NEVER`] where there is none.
pub fn first_moves(grid: &Grid<Work>, pieces: &[MoveSegment], radius_mm: f64) -> Vec<u32> {
    let [nx, ny, nz] = grid.dims();
    let radius2 = radius_mm * radius_mm;
    let mut first = vec![NEVER; nx * ny * nz];
    first.par_chunks_mut(nx * ny).enumerate().for_each(|(k, slab)| {
        cancel::poll();
        for piece in pieces {
            for_each_near(grid, piece, radius_mm, k, |n, p| {
                if slab[n] == NEVER && piece.squared(p) <= radius2 {
                    slab[n] = piece.number;
                }
            });
        }
    });
    first
}

/// The points of a grid that the pieces sweep: those certainly within the radius, and those for which rounding decides.
pub fn swept(grid: &Grid<Work>, pieces: &[MoveSegment], radius_mm: f64) -> Doubtful<Vec<bool>> {
    let [nx, ny, nz] = grid.dims();
    let [inner2, outer2] = [radius_mm - DOUBT_MM, radius_mm + DOUBT_MM].map(|r| r * r);
    let mut surely = vec![false; nx * ny * nz];
    let mut possibly = surely.clone();
    let slabs = surely.par_chunks_mut(nx * ny).zip(possibly.par_chunks_mut(nx * ny));
    slabs.enumerate().for_each(|(k, (surely, possibly))| {
        cancel::poll();
        for piece in pieces {
            for_each_near(grid, piece, radius_mm + DOUBT_MM, k, |n, p| {
                if !surely[n] {
                    let squared = piece.squared(p);
                    surely[n] = squared <= inner2;
                    possibly[n] |= squared <= outer2;
                }
            });
        }
    });
    Doubtful { surely, possibly }
}

/// Among all points and pieces for which `is(point, move)` holds, the point deepest inside the sweep: (depth mm, point, move).
///
/// A point's depth is the radius less its distance from the nearest piece.
pub fn deepest(
    grid: &Grid<Work>,
    pieces: &[MoveSegment],
    radius_mm: f64,
    is: impl Fn(usize, u32) -> bool + Sync,
) -> Option<(f64, usize, u32)> {
    let [nx, ny, nz] = grid.dims();
    let slabs: Vec<Option<(f64, usize, u32)>> = (0..nz)
        .into_par_iter()
        .map(|k| {
            cancel::poll();
            let mut best: Option<(f64, usize, u32)> = None;
            for piece in pieces {
                for_each_near(grid, piece, radius_mm, k, |n, p| {
                    let n = n + k * nx * ny;
                    if is(n, piece.number) {
                        let squared = piece.squared(p);
                        if squared <= best.map_or(radius_mm * radius_mm, |b| b.0) {
                            best = Some((squared, n, piece.number));
                        }
                    }
                });
            }
            best
        })
        .collect();
    let best = slabs.into_iter().flatten().min_by(|a, b| a.0.total_cmp(&b.0))?;
    Some((radius_mm - best.0.sqrt(), best.1, best.2))
}

/// Calls `visit(index in the slab, point)` for every point of slab `k` whose distance from the piece's bounding box is within
/// the radius: all points that the piece sweeps, and few others.
fn for_each_near(
    grid: &Grid<Work>,
    piece: &MoveSegment,
    radius_mm: f64,
    k: usize,
    mut visit: impl FnMut(usize, &Vector3<f64>),
) {
    let [nx, ny, _] = grid.dims();
    let h = grid.spacing_mm().x;
    let origin = grid.origin().coords;
    let (lo, hi) = (piece.a.inf(&piece.b), piece.a.sup(&piece.b));
    // the points along an axis within `reach` of the box, and the distance of a coordinate from the box
    let range = |a: usize, n: usize, reach: f64| {
        let first = ((lo[a] - reach - origin[a]) / h).ceil().max(0.0) as usize;
        let last = ((hi[a] + reach - origin[a]) / h).floor();
        if last < 0.0 { 0..0 } else { first..(last as usize + 1).min(n) }
    };
    let beyond = |a: usize, v: f64| (lo[a] - v).max(v - hi[a]).max(0.0);
    let z = origin.z + k as f64 * h;
    let left = radius_mm * radius_mm - beyond(2, z).powi(2);
    if left < 0.0 {
        return;
    }
    for j in range(1, ny, left.sqrt()) {
        let y = origin.y + j as f64 * h;
        let reach = (left - beyond(1, y).powi(2)).max(0.0).sqrt();
        for i in range(0, nx, reach) {
            visit(i + nx * j, &Vector3::new(origin.x + i as f64 * h, y, z));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bonemill_geometry::Point;

    fn path() -> Vec<Vector3<f64>> {
        [[1.0, 1.0, 3.0], [2.5, 1.2, 2.0], [2.5, 1.2, 2.0], [7.0, 4.0, 1.0], [1.0, 4.5, 6.0]]
            .map(Vector3::from)
            .to_vec()
    }

    #[test]
    fn the_first_move_is_that_of_every_pair_asked_in_order() {
        let grid = Grid::aligned([20, 14, 17], 0.4, Point::new(-0.3, 0.2, 0.1)).unwrap();
        let path = path();
        let first = first_moves(&grid, &pieces(&path), 1.1);
        for (n, found) in first.iter().enumerate() {
            let p = grid.center(grid.voxel(n)).coords;
            let near = |i: usize| {
                let whole = MoveSegment { a: path[i.saturating_sub(1)], b: path[i], number: 0 };
                (whole.squared(&p).sqrt() - 1.1).abs() < 1e-9 || whole.squared(&p) <= 1.1 * 1.1
            };
            let brute = (0..path.len()).find(|i| near(*i)).map_or(NEVER, |i| i as u32);
            assert_eq!(*found, brute, "point {n}");
        }
    }

    #[test]
    fn what_is_swept_is_what_some_move_reaches_and_the_surface_is_in_doubt() {
        let grid = Grid::aligned([20, 14, 17], 0.4, Point::new(-0.3, 0.2, 0.1)).unwrap();
        let pieces = pieces(&path());
        let first = first_moves(&grid, &pieces, 1.1);
        let found = swept(&grid, &pieces, 1.1);
        for (n, first) in first.iter().enumerate() {
            assert!(!found.surely[n] || *first != NEVER && found.possibly[n]);
            assert!(found.possibly[n] || *first == NEVER);
        }
        assert!(found.surely.iter().filter(|s| **s).count() > 200);
        // a ball of four spacings around a point of the grid
        let center = grid.center([9, 7, 8]).coords;
        let found = swept(&grid, &[MoveSegment { a: center, b: center, number: 0 }], 1.6);
        let on_it = grid.index([13, 7, 8]);
        assert!(!found.surely[on_it] && found.possibly[on_it]);
    }

    #[test]
    fn the_deepest_point_is_the_nearest_to_the_path() {
        let grid = Grid::aligned([20, 14, 17], 0.4, Point::new(-0.3, 0.2, 0.1)).unwrap();
        let pieces = pieces(&path());
        let is = |n: usize, _| n % 7 == 3;
        let (depth, place, _) = deepest(&grid, &pieces, 1.1, is).unwrap();
        let distance = |n: usize| {
            let p = grid.center(grid.voxel(n)).coords;
            pieces.iter().map(|piece| piece.squared(&p).sqrt()).fold(f64::INFINITY, f64::min)
        };
        let brute = (0..grid.len()).filter(|n| is(*n, 0)).map(distance).fold(f64::INFINITY, f64::min);
        assert!((1.1 - brute - depth).abs() < 1e-12 && (distance(place) - brute).abs() < 1e-12);
        assert!(deepest(&grid, &pieces, 1.1, |_, _| false).is_none());
    }
}
