//! The voxels of the target that the ball can reach: the opening of free space and target, less clearances, connected to the
//! outside along the approach.
//!
//! The burr's centre may be at a voxel's centre if the whole ball lies in the planning grid, it contains no centre of an
//! obstacle voxel, and every structure is its clearance away, plus the plan's margin for the trajectory's corners.

use bonemill_case::Case;
use bonemill_geometry::{Grid, Work, cancel};
use rayon::prelude::*;

use super::boxes::Boxes;
use super::edt;
use super::lattice::TARGET;
use super::voxels::{DOUBT_MM, Doubtful, Voxels};

/// A plan's margin beyond each clearance for the trajectory's corners, mm.
const CORNERS_MM: f64 = 0.025;
/// Distances between centres that differ by less than this are equal, mm.
const SAME_MM: f64 = 1e-5;

/// The voxels of the target that the ball reaches. `boxes` hold the clearance of each structure, mm.
pub fn reachable(
    case: &Case,
    boxes: &[(&Boxes<'_>, f64)],
    voxels: &Voxels,
    band_mm: f64,
) -> Doubtful<Vec<bool>> {
    let radius = case.burr.radius_mm;
    let mut near = Doubtful { surely: vec![false; voxels.grid.len()], possibly: Vec::new() };
    near.possibly.clone_from(&near.surely);
    for (boxes, clearance_mm) in boxes {
        mark_near(voxels, boxes, radius + clearance_mm + CORNERS_MM, &mut near);
    }
    // a certainly reached voxel is reached with all possible obstacles
    let Doubtful { surely, possibly } = &voxels.class;
    let obstacles = |bone, target| voxels.obstacles(bone, target, band_mm, case.sheets);
    let clear = Doubtful {
        surely: clear(voxels, radius, DOUBT_MM, &obstacles(possibly, surely), &near.possibly),
        possibly: clear(voxels, radius, -DOUBT_MM, &obstacles(surely, possibly), &near.surely),
    };
    let surely = covered(voxels, radius, -DOUBT_MM, &clear.surely, &voxels.class.surely);
    let is_one = clear.surely == clear.possibly && voxels.class.surely == voxels.class.possibly;
    let possibly = if is_one {
        surely.clone()
    } else {
        covered(voxels, radius, DOUBT_MM, &clear.possibly, &voxels.class.possibly)
    };
    Doubtful { surely, possibly }
}

/// The voxels at which the burr's centre may be.
fn clear(voxels: &Voxels, radius_mm: f64, more_mm: f64, obstacle: &[bool], near: &[bool]) -> Vec<bool> {
    let (grid, h) = (&voxels.grid, voxels.spacing_mm());
    let from_bone = edt::squared_voxels(grid.dims(), |n| obstacle[n]);
    let least = ((radius_mm - SAME_MM + more_mm).max(0.0) / h).powi(2) as f32;
    let reach = radius_mm / h;
    let is_inside = |n: usize| {
        let (at, dims) = (grid.voxel(n), grid.dims());
        (0..3).all(|a| at[a] as f64 >= reach && at[a] as f64 <= (dims[a] - 1) as f64 - reach)
    };
    let is_clear = |n: usize| from_bone[n] >= least && !near[n] && is_inside(n);
    (0..grid.len()).into_par_iter().with_min_len(1 << 12).map(is_clear).collect()
}

/// Target voxels in the ball at some clear centre that is connected to the outside.
fn covered(voxels: &Voxels, radius_mm: f64, more_mm: f64, clear: &[bool], class: &[u8]) -> Vec<bool> {
    let below = (radius_mm / voxels.spacing_mm()).ceil() as usize;
    let connected = connected_to_top(voxels.grid.dims(), below, clear);
    let from_centers = edt::squared_voxels(voxels.grid.dims(), |n| connected[n]);
    let reach = ((radius_mm + SAME_MM + more_mm) / voxels.spacing_mm()).powi(2) as f32;
    class.iter().zip(from_centers).map(|(class, d)| class & TARGET != 0 && d <= reach).collect()
}

/// Marks the centres nearer to a structure than `least_mm`. Along a row, a computed distance decides for the following voxels
/// too, as far as it cannot cross `least_mm`.
fn mark_near(voxels: &Voxels, boxes: &Boxes<'_>, least_mm: f64, near: &mut Doubtful<Vec<bool>>) {
    let grid: &Grid<Work> = &voxels.grid;
    let ([nx, ny, _], h) = (grid.dims(), voxels.spacing_mm());
    let rows = near.surely.par_chunks_mut(nx).zip(near.possibly.par_chunks_mut(nx));
    rows.enumerate().for_each(|(row, (surely, possibly))| {
        cancel::poll();
        let mut i = 0;
        while i < nx {
            let p = voxels.ct_from_grid * grid.center([i, row % ny, row / ny]);
            let beyond = boxes.distance_mm(p) - least_mm;
            let same = ((beyond.abs() - 2.0 * DOUBT_MM) / h).max(0.0) as usize;
            let run = i..(i + same + 1).min(nx);
            if beyond < -DOUBT_MM {
                surely[run.clone()].fill(true);
            }
            if beyond < DOUBT_MM {
                possibly[run].fill(true);
            }
            i += same + 1;
        }
    });
}

/// The points that are connected by faces to the highest slab in which the ball fits into the grid, `below` slabs under the
/// top.
fn connected_to_top([nx, ny, nz]: [usize; 3], below: usize, clear: &[bool]) -> Vec<bool> {
    let slab = nx * ny;
    let mut reached = vec![false; clear.len()];
    let Some(top) = (nz - 1).checked_sub(below) else { return reached };
    let mut open: Vec<usize> = (slab * top..clear.len()).filter(|n| clear[*n]).collect();
    open.iter().for_each(|n| reached[*n] = true);
    while let Some(n) = open.pop() {
        let (i, j, k) = (n % nx, n / nx % ny, n / slab);
        let sides = [
            (i > 0, n.wrapping_sub(1)),
            (i + 1 < nx, n + 1),
            (j > 0, n.wrapping_sub(nx)),
            (j + 1 < ny, n + nx),
            (k > 0, n.wrapping_sub(slab)),
            (k + 1 < nz, n + slab),
        ];
        for (_, m) in sides.into_iter().filter(|(is_in, _)| *is_in) {
            if clear[m] && !reached[m] {
                reached[m] = true;
                open.push(m);
            }
        }
    }
    reached
}
