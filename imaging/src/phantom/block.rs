//! The test block of Dillon et al. 2016 (D), section III: rigid foam with round air cells, a square pocket to be milled,
//! and a virtual facial nerve that passes beside the pocket.
//!
//! ct: the pocket's centre line is x = y = 0, the block's upper face is z = 0, the approach is +z, so the work axes are
//! ct's. From D: foam of 0.8 g/cm³, a pocket of 15 × 15 × 15 mm, cells of 3 to 5 mm diameter, noise of 5 % of the mean voxel
//! intensity. Assumed, because D does not say it: the block's size, the cells' share, and the nerve's course. The nerve is
//! only a label, as in D: it changes neither the cells nor the image, so one seed gives the same image for every nerve.
//!
//! The image has its own scale: HU = 1000 (ρ − 1) with ρ in g/cm³, so air is −1000 and foam −200. The case file holds the
//! density table for it.

use bonemill_geometry::{Ct, Grid, Point, Volume};

use super::rng::Rng;
use super::shapes::{Tube, V3};
use super::{Phantom, TARGET, ct_grid, names, with_noise};

const FOAM_G_CM3: f64 = 0.8; // D III: Sawbones solid rigid polyurethane foam
const POCKET_MM: f64 = 15.0; // D III: a cube
const BLOCK_MIN_MM: [f64; 3] = [-13.0, -13.0, -22.0]; // assumed: 5.5 mm beside and 7 mm below the pocket
const BLOCK_MAX_MM: [f64; 3] = [13.0, 13.0, 0.0];
const CELL_RADIUS_MM: [f64; 2] = [1.5, 2.5]; // D III: 3 to 5 mm diameter
const SKIN_MM: f64 = 0.5; // assumed: no cell opens to the block's outside
const NERVE_RADIUS_MM: f64 = 0.8; // of the nerve in its canal
const NERVE_GAP_MM: f64 = 1.4; // least distance to the pocket's wall: above the clearance of 1.0 and two grids' error
const NERVE_BOW_MM: f64 = 0.35; // how much farther it is at the pocket's corners
const NERVE_DEPTH_MM: f64 = 9.0; // below the upper face, at mid-course
const NERVE_SLOPE: f64 = 0.06; // depth per length
const NERVE: u8 = 1;

const SPACING_MM: f64 = 0.25;
// the image has 2 mm of air around the block and 4 mm above it; voxel faces coincide with the pocket's faces
const DIMS: [usize; 3] = [120, 120, 112];
const ORIGIN: Point<Ct> = Point::new(-14.875, -14.875, -23.875);

/// Where the nerve passes the pocket. The bone-attached arm tilts the shaft in the work y–z plane.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NerveSide {
    /// Along y, beside the wall x = ±7.5 mm: tilting does not bring the shaft nearer.
    BesideTiltPlane,
    /// Along x, beside the wall y = ±7.5 mm: the shaft tilts towards it.
    InTiltPlane,
}

/// What an experiment varies in the block.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BlockParams {
    /// Which wall the nerve passes.
    pub nerve: NerveSide,
    /// Whether it passes the wall on the axis' positive side. Together with the spin, this decides in which direction the
    /// burr is pushed.
    pub nerve_on_positive_side: bool,
    /// Share of air cells in the block without its 0.5 mm skin, at least 0. Above about 0.32 not all cells find a free place,
    /// and fewer are made.
    pub cell_fraction: f64,
    /// Least distance between two cells, mm; below 0 they may overlap.
    pub cell_gap_mm: f64,
    /// Standard deviation of the noise, as a share of the block's mean density.
    pub noise_fraction: f64,
}

impl BlockParams {
    /// D's block. Assumed: 28 % cells that are 0.2 mm apart, and the nerve beside the tilt plane, on the side of +x.
    pub const fn paper() -> Self {
        Self {
            nerve: NerveSide::BesideTiltPlane,
            nerve_on_positive_side: true,
            cell_fraction: 0.28,
            cell_gap_mm: 0.2,
            noise_fraction: 0.05,
        }
    }
}

/// The block for a seed, which decides the cells and the noise.
pub fn block(params: &BlockParams, seed: u64) -> Phantom {
    let grid = ct_grid(DIMS, SPACING_MM, ORIGIN);
    let mut foam = solid(&grid);
    for cell in air_cells(params, seed) {
        carve(&mut foam, &cell);
    }
    let shares: f64 = foam.data().iter().map(|&share| f64::from(share)).sum();
    let block_mm3: f64 = (0..3).map(|a| BLOCK_MAX_MM[a] - BLOCK_MIN_MM[a]).product();
    let mean_g_cm3 = FOAM_G_CM3 * shares * grid.voxel_mm3() / block_mm3;
    let hu = foam.map(|&share| 1000.0 * (share * FOAM_G_CM3 as f32 - 1.0));
    let sd_hu = 1000.0 * params.noise_fraction * mean_g_cm3;
    Phantom {
        ct: with_noise(&hu, sd_hu, &Rng::new(seed, 1)),
        labels: labels(&grid, params),
        label_names: names(&[("facial_nerve", NERVE), ("target", TARGET)]),
        case_toml: format!("# The foam block, seed {seed}.\n{}", include_str!("block_case.toml")),
    }
}

/// An air cell: a ball.
#[derive(Debug, Clone, Copy)]
struct Cell {
    center: V3,
    radius_mm: f64,
}

/// Air cells that fill the requested share: the largest first, each at a random free place.
fn air_cells(params: &BlockParams, seed: u64) -> Vec<Cell> {
    const TRIES: usize = 20_000;
    let mut rng = Rng::new(seed, 0);
    let inner: [f64; 3] = std::array::from_fn(|a| BLOCK_MAX_MM[a] - BLOCK_MIN_MM[a] - 2.0 * SKIN_MM);
    let wanted_mm3 = params.cell_fraction.min(0.6) * inner.iter().product::<f64>();
    let mut radii = Vec::new();
    let mut sum_mm3 = 0.0;
    while sum_mm3 < wanted_mm3 {
        let r = rng.range(CELL_RADIUS_MM[0], CELL_RADIUS_MM[1]);
        sum_mm3 += 4.0 / 3.0 * std::f64::consts::PI * r.powi(3);
        radii.push(r);
    }
    radii.sort_by(|a, b| b.total_cmp(a));

    let mut cells: Vec<Cell> = Vec::with_capacity(radii.len());
    for radius_mm in radii {
        for _ in 0..TRIES {
            let center = V3::from_fn(|a, _| {
                let wall = SKIN_MM + radius_mm;
                rng.range(BLOCK_MIN_MM[a] + wall, BLOCK_MAX_MM[a] - wall)
            });
            let free = |c: &Cell| (c.center - center).norm() >= c.radius_mm + radius_mm + params.cell_gap_mm;
            if cells.iter().all(free) {
                cells.push(Cell { center, radius_mm });
                break;
            }
        }
    }
    cells
}

/// The exact share of each voxel that lies in the block, before cells are removed.
fn solid(grid: &Grid<Ct>) -> Volume<f32, Ct> {
    let share = |a: usize, n: usize| {
        let center = grid.origin().coords[a] + n as f64 * SPACING_MM;
        let (lo, hi) = (center - 0.5 * SPACING_MM, center + 0.5 * SPACING_MM);
        ((hi.min(BLOCK_MAX_MM[a]) - lo.max(BLOCK_MIN_MM[a])) / SPACING_MM).clamp(0.0, 1.0) as f32
    };
    let shares: [Vec<f32>; 3] = std::array::from_fn(|a| (0..DIMS[a]).map(|n| share(a, n)).collect());
    let mut foam = Volume::filled(grid.clone(), 0.0);
    for (n, value) in foam.data_mut().iter_mut().enumerate() {
        let voxel = grid.voxel(n);
        *value = (0..3).map(|a| shares[a][voxel[a]]).product();
    }
    foam
}

/// Removes a cell from the foam; a voxel on the cell's surface is sampled at 4 × 4 × 4 points.
fn carve(foam: &mut Volume<f32, Ct>, cell: &Cell) {
    let grid = foam.grid().clone();
    let half_diagonal = 0.5 * grid.diagonal_mm();
    let at =
        |sign: f64| grid.continuous_index(Point::from_coords(cell.center.add_scalar(sign * cell.radius_mm)));
    let (lo, hi) = (at(-1.0), at(1.0));
    let first = |a: usize| lo[a].floor().max(0.0) as usize;
    let last = |a: usize| (hi[a].ceil().max(0.0) as usize).min(DIMS[a] - 1);
    for k in first(2)..=last(2) {
        for j in first(1)..=last(1) {
            for i in first(0)..=last(0) {
                let from = grid.center([i, j, k]).coords - cell.center;
                let depth = cell.radius_mm - from.norm();
                let share = if depth >= half_diagonal {
                    1.0
                } else if depth <= -half_diagonal {
                    continue;
                } else {
                    sampled_share(&from, cell.radius_mm)
                };
                let n = grid.index([i, j, k]);
                let left = &mut foam.data_mut()[n];
                *left = (*left - share).max(0.0);
            }
        }
    }
}

/// Share of the voxel at `from` that lies inside the ball around the origin.
fn sampled_share(from: &V3, radius_mm: f64) -> f32 {
    let offset = |n: usize| (n as f64 - 1.5) * 0.25 * SPACING_MM;
    let inside = |s: &usize| {
        let p = from + V3::new(offset(s % 4), offset(s / 4 % 4), offset(s / 16));
        p.norm_squared() <= radius_mm * radius_mm
    };
    (0..64).filter(inside).count() as f32 / 64.0
}

/// The pocket, air cells included, and the nerve.
fn labels(grid: &Grid<Ct>, params: &BlockParams) -> Volume<u8, Ct> {
    let nerve = nerve(params);
    let half = 0.5 * POCKET_MM;
    let mut labels = Volume::filled(grid.clone(), 0u8);
    for (n, label) in labels.data_mut().iter_mut().enumerate() {
        let p = grid.center(grid.voxel(n)).coords;
        let in_block = (0..3).all(|a| p[a] > BLOCK_MIN_MM[a] && p[a] < BLOCK_MAX_MM[a]);
        if p.x.abs() < half && p.y.abs() < half && p.z < 0.0 && p.z > -POCKET_MM {
            *label = TARGET;
        } else if in_block && nerve.contains(&p) {
            *label = NERVE;
        }
    }
    labels
}

/// The nerve's course: it runs through the whole block and bends towards the middle of the pocket's wall.
fn nerve(params: &BlockParams) -> Tube {
    let side = if params.nerve_on_positive_side { 1.0 } else { -1.0 };
    let half = 0.5 * POCKET_MM;
    let knot = |s: f64| {
        let away = side * (half + NERVE_GAP_MM + NERVE_RADIUS_MM + NERVE_BOW_MM * (s / half).powi(2));
        let z = -NERVE_DEPTH_MM + NERVE_SLOPE * s;
        let point = match params.nerve {
            NerveSide::BesideTiltPlane => V3::new(away, s, z),
            NerveSide::InTiltPlane => V3::new(s, away, z),
        };
        (point, NERVE_RADIUS_MM)
    };
    Tube::straight(&(-14..=14).map(|s| knot(f64::from(s))).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests;
