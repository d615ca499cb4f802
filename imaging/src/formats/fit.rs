//! Brings the voxels of a label from its own grid onto another: those that it touches, so that nothing of it is lost, or those whose
//! centres lie in it, so that it is neither larger nor smaller.
//!
//! Where grids are cut from one lattice both give the label's own voxels. Else a label that touches covers itself, and reaches less than
//! a voxel of each grid beyond; one by centres is off by half a voxel of either sense.

use bonemill_geometry::{Ct, Grid, Point, Volume};
use nalgebra::Vector3;

/// A centre that lies on a face of the label's voxels is looked up this far from it, mm: which voxel counts is not left to the rounding
/// of headers. Along no axis, and no difference of two placements that occur.
const OFF_FACE_MM: [f64; 3] = [0.00137, 0.00119, 0.00107];
/// Voxels touch if they overlap by more than this, of the label's voxel: headers are rounded.
const OVERLAP_VOXELS: f64 = 0.01;

/// Axes are parallel if no cosine between two differs by more from 0 or 1: no voxel of an image is displaced by more than its hundredth.
const PARALLEL: f64 = 1e-5;

/// How a label is brought onto another grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fit {
    /// The voxels whose centres lie in it: for what is removed.
    Centres,
    /// Every voxel that it touches: for what is kept.
    Touched,
}

/// The first and the last index along each axis of the voxels of a label; `None` without one.
pub(super) fn index_box(from: &Volume<u16, Ct>, is_in: &impl Fn(u16) -> bool) -> Option<[[usize; 3]; 2]> {
    let grid = from.grid();
    let mut found: Option<[[usize; 3]; 2]> = None;
    for (place, _) in from.data().iter().enumerate().filter(|(_, value)| is_in(**value)) {
        let voxel = grid.voxel(place);
        let [low, high] = found.get_or_insert([voxel; 2]);
        for a in 0..3 {
            low[a] = low[a].min(voxel[a]);
            high[a] = high[a].max(voxel[a]);
        }
    }
    found
}

/// The first and the last index in another grid, which may lie beyond it, of a box of voxels.
pub(super) fn moved_box(from: &Grid<Ct>, [low, high]: [[usize; 3]; 2], to: &Grid<Ct>) -> [[i64; 3]; 2] {
    let half = 0.5 - OVERLAP_VOXELS;
    let mut found = [[i64::MAX; 3], [i64::MIN; 3]];
    for corner in 0..8 {
        let at = |a: usize| if corner >> a & 1 == 0 { low[a] as f64 - half } else { high[a] as f64 + half };
        let index = to.continuous_index(from.at([at(0), at(1), at(2)]));
        for a in 0..3 {
            let nearest = (index[a] + 0.5).floor() as i64;
            found[0][a] = found[0][a].min(nearest);
            found[1][a] = found[1][a].max(nearest);
        }
    }
    found
}

/// The voxels of a grid, in a box of it, whose centres lie in a label's voxels, ascending.
pub(super) fn centred(
    from: &Volume<u16, Ct>,
    is_in: &impl Fn(u16) -> bool,
    to: &Grid<Ct>,
    [low, high]: [[usize; 3]; 2],
) -> Vec<usize> {
    let off = Vector3::from(OFF_FACE_MM);
    let mut places = Vec::new();
    for k in low[2]..=high[2] {
        for j in low[1]..=high[1] {
            for i in low[0]..=high[0] {
                let p = Point::from_coords(to.center([i, j, k]).coords + off);
                if from.grid().nearest(p).is_some_and(|voxel| is_in(*from.get(voxel))) {
                    places.push(to.index([i, j, k]));
                }
            }
        }
    }
    places
}

/// Whether each axis of a grid is one of another's, of either sense.
fn are_parallel(a: &Grid<Ct>, b: &Grid<Ct>) -> bool {
    (a.axes().transpose() * b.axes()).iter().all(|c| c.abs() < PARALLEL || 1.0 - c.abs() < PARALLEL)
}

/// The voxels of a grid that a label's voxels touch, ascending: those that hold one of the points by which each voxel is sampled, from
/// face to face. Points are nowhere farther apart than the grid's voxels along parallel axes, else than 1/√3 of that: a cube then holds one
/// however it is turned, since it holds a ball as wide as the points' cube is across.
pub(super) fn touched(
    from: &Volume<u16, Ct>,
    is_in: &impl Fn(u16) -> bool,
    to: &Grid<Ct>,
    [low, high]: [[usize; 3]; 2],
) -> Vec<usize> {
    let grid = from.grid();
    let half = 0.5 - OVERLAP_VOXELS;
    let offsets: [Vec<f64>; 3] = std::array::from_fn(|a| {
        let apart_mm = to.spacing_mm().min() / if are_parallel(grid, to) { 1.0 } else { 3f64.sqrt() };
        let steps = (grid.spacing_mm()[a] / apart_mm - OVERLAP_VOXELS).ceil().max(1.0);
        (0..=steps as usize).map(|n| half * (2.0 * n as f64 / steps - 1.0)).collect()
    });
    let mut is_touched = vec![false; to.len()];
    for k in low[2]..=high[2] {
        for j in low[1]..=high[1] {
            for i in (low[0]..=high[0]).filter(|i| is_in(*from.get([*i, j, k]))) {
                for z in &offsets[2] {
                    for y in &offsets[1] {
                        for x in &offsets[0] {
                            let p = grid.at([i as f64 + x, j as f64 + y, k as f64 + z]);
                            if let Some(voxel) = to.nearest(p) {
                                is_touched[to.index(voxel)] = true;
                            }
                        }
                    }
                }
            }
        }
    }
    (0..is_touched.len()).filter(|place| is_touched[*place]).collect()
}
