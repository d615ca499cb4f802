//! Which part of the burr's surface lies in what an earlier piece of the path has removed.
//!
//! A piece removes a capsule: all points within the burr's radius of it. The space around the path is divided into cells. A cell
//! holds the first piece whose capsule contains all of it, and the pieces before that one whose surface may cross it. So a point is
//! compared with few capsules, and the result is that of a comparison with all.
//!
//! Pieces lie within [`THIN_MM`] of the motion. Where the burr passes a place again, this decides whether it seems to touch what the
//! earlier pass left, and edge forces need no more than a touch. So what stands by less than that beyond the surface of an
//! earlier pass counts as removed.

use bonemill_geometry::cancel;
use nalgebra::Vector3;
use rayon::prelude::*;

use super::super::carve::{MoveSegment, NEVER};
use super::path::THIN_MM;

/// Side of a cell, mm.
const CELL_MM: f64 = 0.25;
/// Relative margin for rounding.
const ROUNDING: f64 = 1e-12;
/// A piece that ends at least so long before another one begins is an earlier pass, mm of way.
const EARLIER_MM: f64 = 1.0;

/// The pieces of a path, by place.
#[derive(Debug)]
pub struct Covered<'a> {
    pieces: &'a [MoveSegment],
    /// The way until the end of each, mm.
    way_mm: Vec<f64>,
    /// Radius of the capsules, mm; of earlier passes.
    reach_mm: f64,
    earlier_mm: f64,
    /// Distance from a capsule's surface within which it may cross a patch, mm.
    patch_mm: f64,
    lo: Vector3<f64>,
    dims: [usize; 3],
    /// By z.
    slabs: Vec<Slab>,
}

/// A layer of cells.
#[derive(Debug)]
struct Slab {
    cells: Vec<Cell>,
    /// Indices of pieces; every cell has a run of them.
    near: Vec<u32>,
}

#[derive(Debug, Clone, Copy)]
struct Cell {
    /// The first piece that contains the whole cell, or [`NEVER`].
    full: u32,
    near: [u32; 2],
}

impl<'a> Covered<'a> {
    /// The pieces for points in a box, mm. `patch_mm`: largest distance between a patch's middle and its edge.
    pub fn new(
        pieces: &'a [MoveSegment],
        radius_mm: f64,
        patch_mm: f64,
        [lo, hi]: [Vector3<f64>; 2],
    ) -> Self {
        let dims: [usize; 3] = (hi - lo).map(|mm| (mm / CELL_MM).ceil().max(1.0) as usize).into();
        let reach_mm = radius_mm * (1.0 + ROUNDING);
        let earlier_mm = reach_mm + THIN_MM;
        let until = |way: &mut f64, piece: &MoveSegment| {
            *way += (piece.b - piece.a).norm();
            Some(*way)
        };
        let way_mm = pieces.iter().scan(0.0, until).collect();
        let mut covered =
            Self { pieces, way_mm, reach_mm, earlier_mm, patch_mm, lo, dims, slabs: Vec::new() };
        covered.slabs = (0..dims[2]).into_par_iter().map(|k| covered.slab(k)).collect();
        covered
    }

    /// The cells of layer `k`.
    fn slab(&self, k: usize) -> Slab {
        cancel::poll();
        let [nx, ny, _] = self.dims;
        let slack_mm = 0.5 * 3f64.sqrt() * CELL_MM + self.patch_mm;
        let (holds_mm, touches_mm) = (self.reach_mm - slack_mm, self.earlier_mm + slack_mm);
        let holds = if holds_mm > 0.0 { holds_mm * holds_mm } else { -1.0 };
        let mut found = vec![(NEVER, Vec::new()); nx * ny];
        let z = self.lo.z + (k as f64 + 0.5) * CELL_MM;
        for piece in self.pieces {
            let (lo, hi) = (piece.a.inf(&piece.b), piece.a.sup(&piece.b));
            if z < lo.z - touches_mm || z > hi.z + touches_mm {
                continue;
            }
            let cells = |axis: usize, count: usize| {
                let cell = |mm: f64| ((mm - self.lo[axis]) / CELL_MM).max(0.0) as usize;
                cell(lo[axis] - touches_mm)..cell(hi[axis] + touches_mm).saturating_add(1).min(count)
            };
            for j in cells(1, ny) {
                for i in cells(0, nx) {
                    let (full, near) = &mut found[i + nx * j];
                    if *full != NEVER {
                        continue;
                    }
                    let center = Vector3::new(
                        self.lo.x + (i as f64 + 0.5) * CELL_MM,
                        self.lo.y + (j as f64 + 0.5) * CELL_MM,
                        z,
                    );
                    let squared = piece.squared(&center);
                    if squared <= holds {
                        *full = piece.number;
                    } else if squared <= touches_mm * touches_mm {
                        near.push(piece.number);
                    }
                }
            }
        }
        Slab::packed(&found)
    }

    fn cell(&self, p: &Vector3<f64>) -> Option<(&Cell, &Slab)> {
        let at = (p - self.lo) / CELL_MM;
        let [nx, ny, nz] = self.dims.map(|n| n as f64);
        let is_in = at.x >= 0.0 && at.x < nx && at.y >= 0.0 && at.y < ny && at.z >= 0.0 && at.z < nz;
        let slab = if is_in { self.slabs.get(at.z as usize)? } else { return None };
        Some((slab.cells.get(at.x as usize + self.dims[0] * at.y as usize)?, slab))
    }

    /// The share of a patch around `p` that no piece before `piece` has removed; 0 outside the box.
    ///
    /// `sides_mm`: the patch's two sides projected onto a unit direction. Within a patch the surface of the nearest capsule counts
    /// as flat, so that the share changes smoothly.
    #[inline]
    pub fn share_left(
        &self,
        piece: u32,
        p: &Vector3<f64>,
        sides_mm: impl Fn(&Vector3<f64>) -> [f64; 2],
    ) -> f64 {
        let Some((cell, slab)) = self.cell(p) else { return 0.0 };
        if cell.full < piece {
            return 0.0;
        }
        let inside = (self.reach_mm - self.patch_mm).max(0.0).powi(2);
        let begins_mm = piece.checked_sub(1).map_or(0.0, |before| self.way_mm[before as usize]);
        // how far the point is beyond the nearest piece, and that piece
        let mut nearest = (f64::INFINITY, 0);
        for &number in &slab.near[cell.near[0] as usize..cell.near[1] as usize] {
            if number >= piece {
                break;
            }
            let squared = self.pieces[number as usize].squared(p);
            if squared <= inside {
                return 0.0;
            }
            let is_earlier = begins_mm - self.way_mm[number as usize] >= EARLIER_MM;
            let reach_mm = if is_earlier { self.earlier_mm } else { self.reach_mm };
            if squared < (reach_mm + nearest.0).powi(2) {
                nearest = (squared.sqrt() - reach_mm, number);
            }
        }
        let beyond_mm = nearest.0;
        if beyond_mm >= self.patch_mm {
            return 1.0;
        }
        let away = self.pieces[nearest.1 as usize].away(p).normalize();
        share_beyond(beyond_mm, sides_mm(&away))
    }
}

impl Slab {
    fn packed(found: &[(u32, Vec<u32>)]) -> Self {
        let mut slab = Self { cells: Vec::with_capacity(found.len()), near: Vec::new() };
        for (full, near) in found {
            let first = slab.near.len() as u32;
            slab.near.extend(near);
            slab.cells.push(Cell { full: *full, near: [first, slab.near.len() as u32] });
        }
        slab
    }
}

/// The share of a rectangle beyond a straight edge from which its middle is `beyond_mm` away; `sides_mm` are the sides projected
/// onto the edge's normal.
///
/// The distances of the rectangle's points from its middle are the sum of two uniform variables, so the share is that sum's
/// distribution function: the second difference of t²/2 for t > 0, over both widths.
fn share_beyond(beyond_mm: f64, [a, b]: [f64; 2]) -> f64 {
    let wide = a.max(b);
    if wide <= 0.0 {
        return if beyond_mm > 0.0 { 1.0 } else { 0.0 };
    }
    let narrow = a.min(b).max(1e-3 * wide);
    let area = |t: f64| 0.5 * t.max(0.0).powi(2);
    let (sum, difference) = (0.5 * (wide + narrow), 0.5 * (wide - narrow));
    let share = area(beyond_mm + sum) - area(beyond_mm + difference) - area(beyond_mm - difference)
        + area(beyond_mm - sum);
    (share / (wide * narrow)).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A path back and forth with small steps aside.
    fn pieces() -> Vec<MoveSegment> {
        let at = |n: u32| {
            let x = f64::from(n % 7) * 0.6;
            let side = f64::from(n / 7);
            Vector3::new(if (n / 7).is_multiple_of(2) { x } else { 3.6 - x }, 0.7 * side, 0.05 * side)
        };
        (0..40).map(|n| MoveSegment { a: at(n), b: at(n + 1), number: n }).collect()
    }

    #[test]
    fn the_share_is_that_of_a_comparison_with_all_earlier_pieces() {
        let pieces = pieces();
        let patch_mm = 0.1;
        let covered =
            Covered::new(&pieces, 1.5, patch_mm, [Vector3::repeat(-2.0), Vector3::new(6.0, 7.0, 3.0)]);
        let sides = |g: &Vector3<f64>| [0.12 * g.x.abs(), 0.15 * g.y.abs()];
        let mut partly = 0;
        for n in 0..6000u32 {
            let at = |m: u32, span: f64| f64::from((n * m) % 1013) / 1013.0 * span - 1.9;
            let p = Vector3::new(at(7, 7.0), at(13, 8.0), at(29, 4.5));
            let piece = n % 41;
            let reach_mm = |earlier: &MoveSegment| {
                let between = &pieces[earlier.number as usize + 1..piece as usize];
                let way_mm: f64 = between.iter().map(|piece| (piece.b - piece.a).norm()).sum();
                if way_mm >= EARLIER_MM { 1.5 + THIN_MM } else { 1.5 }
            };
            let beyond =
                |earlier: &MoveSegment| (earlier.away(&p).norm() - reach_mm(earlier), earlier.away(&p));
            let nearest = pieces[..piece as usize].iter().map(beyond).min_by(|a, b| a.0.total_cmp(&b.0));
            let brute = nearest.map_or(1.0, |(mm, away)| share_beyond(mm, sides(&away.normalize())));
            let share = covered.share_left(piece, &p, sides);
            assert!((share - brute).abs() < 1e-6, "{n}: {share}, {brute}");
            partly += usize::from(share > 0.0 && share < 1.0);
        }
        assert!(partly > 20, "{partly}");
        assert_eq!(covered.share_left(3, &Vector3::repeat(50.0), sides), 0.0);
    }

    #[test]
    fn the_share_is_that_of_points_of_the_rectangle() {
        const N: i32 = 300;
        for (beyond, a, b, angle) in [(0.1, 0.5, 0.3, 0.4_f64), (-0.2, 0.6, 0.9, 1.2), (0.3, 0.4, 0.4, 0.8)] {
            let at = |n: i32| (f64::from(n) + 0.5) / f64::from(N) - 0.5;
            let (s, c) = angle.sin_cos();
            let is_beyond = |n: &i32| beyond + at(n % N) * a * c + at(n / N) * b * s > 0.0;
            let counted = (0..N * N).filter(is_beyond).count() as f64 / f64::from(N * N);
            assert!((share_beyond(beyond, [a * c, b * s]) - counted).abs() < 5e-3);
        }
        assert_eq!([-0.1, 0.0, 0.1].map(|d| share_beyond(d, [0.0, 0.0])), [0.0, 0.0, 1.0]);
    }
}
