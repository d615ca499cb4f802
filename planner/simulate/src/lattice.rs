//! The remaining bone: for each cell of a lattice, its depth below the cut surface, stored in bricks of 8³ cells where
//! something was cut.
//!
//! The removed space is a union of capsules, and the depth of a point below its surface is the least of the capsules'
//! distances: D = min(|p − segment| − r). So a cell stores one number, which only decreases. Therefore removal is monotone,
//! independent of the order and of the division of a straight move into steps (to single precision, 2e-5 of a cell), and
//! free of cusps for any length of step. Between cell centres D is interpolated. This makes the hole of a tube too small by
//! s/(12 r) of a cell s in the mean, which is corrected; the remaining error is below s/(20 r).
//!
//! The surface's curvature depends on the burr's radius, not on the voxels, so the cell size follows the radius. A cell is a
//! whole number of voxels or a whole part of one, so that volumes and masses are exactly those of the voxels. The remaining
//! share of a cell is f = clamp(½ + D/s + s/(24 r), 0, 1): exact for a flat face along the cells, and without bias for a tube
//! (the hole of a single ball is (s/r)²/8 too large).
//!
//! Depths are limited to ±[`FAR`] cells. A brick is unknown until a burr comes near; then it is empty of solid cells, intact,
//! cut (and stored) or completely removed (and not stored). So memory grows with the cut surface only.

use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use bonemill_geometry::{Point, Work, trilinear};
use nalgebra::Vector3;

use super::bone::{Amount, Bone, VoxelKind};
use super::error::EngineError;

/// Side of a brick, cells.
pub(super) const SIDE: usize = 8;
/// Number of cells of a brick.
pub(super) const CELLS: usize = SIDE * SIDE * SIDE;
/// Limit of depths, cells: every corner of a cell that the surface crosses is nearer than this (√3).
pub(super) const FAR: f32 = 2.0;
/// Interpolated depth on a ball's surface after the mean correction, in units of s/r cells: 1/6 and a margin.
const DOUBT: f64 = 0.2;
/// Largest underestimate of D by interpolation, cells: ½ at a ridge between two balls, and less than a hundredth on one ball.
const BETWEEN: f64 = 0.52;
/// Largest weighted mean distance from the cell nearest to a point to the eight cells around the point, cells:
/// (3 + 3√2 + √3)/8.
const AROUND: f64 = 1.122;
/// Largest number of bricks over the grid: 256 MB of tags.
const MOST_BRICKS: f64 = 67_108_864.0;

/// A brick's tag: its state, or the index at which it is stored.
pub(super) mod tag {
    /// The brick was not classified yet.
    pub const UNKNOWN: u32 = u32::MAX;
    /// There is no solid cell in it or near it.
    pub const NOTHING: u32 = u32::MAX - 1;
    /// It has solid cells, and none is cut.
    pub const INTACT: u32 = u32::MAX - 2;
    /// It is completely removed.
    pub const GONE: u32 = u32::MAX - 3;
    /// Smaller tags are indices.
    pub const FIRST: u32 = GONE;
}

/// Cells of one brick, x-fastest.
#[derive(Debug, Clone)]
pub(super) struct Brick {
    /// D, cells.
    pub depth: [f32; CELLS],
    /// Contents of each cell before anything was cut; `None` where it was not needed yet.
    pub held: [Option<Held>; CELLS],
}

impl Brick {
    /// A brick in which nothing is cut.
    pub const INTACT: Self = Self { depth: [FAR; CELLS], held: [None; CELLS] };
}

/// The solid contents of an uncut cell.
#[derive(Debug, Clone, Copy)]
pub(super) struct Held {
    /// Its mass, mg.
    pub mass_mg: f64,
    /// Number of its solid parts, each of [`Lattice::part_mm3`].
    pub parts: u16,
    /// The most important kind among them; `None` where nothing is solid.
    pub kind: Option<VoxelKind>,
}

/// The state of the bone.
#[derive(Debug)]
pub struct Lattice<'a, T> {
    pub(super) bone: Bone<'a, T>,
    /// Number of cells along a voxel, or of voxels along a cell; one of them is 1.
    pub(super) split: usize,
    pub(super) block: usize,
    cells_per_voxel: f64,
    cells: [usize; 3],
    /// s/r: the angle by which the surface turns within a cell.
    bend: f64,
    pub(super) bricks: [usize; 3],
    /// Tag of each brick; atomic, because several threads may classify a brick at the same time, with the same result.
    tags: Vec<AtomicU32>,
    pub(super) stored: Vec<Option<Box<Brick>>>,
    pub(super) vacant: Vec<u32>,
    dirty: Vec<u32>,
    is_dirty: Vec<bool>,
}

impl<'a, T: Copy + Into<f64> + Sync> Lattice<'a, T> {
    /// A lattice in which nothing is cut, with at least and about `cells_per_radius` cells along the burr's radius.
    ///
    /// # Errors
    /// [`EngineError::TooFine`], and [`EngineError::Model`] for impossible radii.
    pub fn new(bone: Bone<'a, T>, radius_mm: f64, cells_per_radius: f64) -> Result<Self, EngineError> {
        bonemill_cutting::burr::checked(
            "burr radius, mm",
            radius_mm,
            |r| r > 0.0 && r <= 50.0,
            "above 0, at most 50",
        )?;
        let sane = |n: f64| (1.0..=1000.0).contains(&n);
        bonemill_cutting::burr::checked("cells per radius", cells_per_radius, sane, "1 to 1000")?;
        let h = bone.spacing_mm();
        let wanted_mm = radius_mm / cells_per_radius * (1.0 + 1e-9);
        // a cell of more voxels would overflow its count
        let block = if h <= wanted_mm { (wanted_mm / h).floor().min(40.0) as usize } else { 1 };
        let split = if h > wanted_mm { (h / wanted_mm).ceil().min(1e4) as usize } else { 1 };
        let cells = bone.grid().dims().map(|n| (n * split).div_ceil(block));
        let bricks = cells.map(|n| n.div_ceil(SIDE));
        let count: f64 = bricks.iter().map(|n| *n as f64).product();
        if count > MOST_BRICKS {
            let spacing_mm = h * block as f64 / split as f64;
            return Err(EngineError::TooFine { bricks: count, spacing_mm, most: MOST_BRICKS });
        }
        let count = bricks.iter().product();
        Ok(Self {
            bone,
            split,
            block,
            cells_per_voxel: split as f64 / block as f64,
            cells,
            bend: h * block as f64 / (split as f64 * radius_mm),
            bricks,
            tags: (0..count).map(|_| AtomicU32::new(tag::UNKNOWN)).collect(),
            stored: Vec::new(),
            vacant: Vec::new(),
            dirty: Vec::new(),
            is_dirty: vec![false; count],
        })
    }

    /// The uncut bone.
    pub fn bone(&self) -> &Bone<'a, T> {
        &self.bone
    }

    /// Side of a cell, mm.
    pub fn spacing_mm(&self) -> f64 {
        self.bone.spacing_mm() / self.cells_per_voxel
    }

    /// Volume of the parts in which a cell's solid volume is counted, mm³: a voxel, or the cell itself where it is smaller.
    pub(super) fn part_mm3(&self) -> f64 {
        (self.bone.spacing_mm() / self.split as f64).powi(3)
    }

    /// Number of stored bricks, and their memory, bytes.
    pub fn stored_bricks(&self) -> (usize, usize) {
        let count = self.stored.len() - self.vacant.len();
        (count, count * size_of::<Brick>() + self.tags.len() * (size_of::<u32>() + 1))
    }

    /// Cell coordinates of a point; whole numbers are cell centres.
    #[inline]
    pub(super) fn cell_of(&self, p: &Vector3<f64>) -> Vector3<f64> {
        self.cell_of_index(&self.bone.index(p))
    }

    #[inline]
    fn cell_of_index(&self, index: &Vector3<f64>) -> Vector3<f64> {
        index.map(|v| (v + 0.5) * self.cells_per_voxel - 0.5)
    }

    /// The point at cell coordinates.
    pub(super) fn point(&self, cell: Vector3<f64>) -> Point<Work> {
        self.bone.at(cell.map(|c| (c + 0.5) / self.cells_per_voxel - 0.5))
    }

    /// The share, 0 to 1, of a patch of the burr's surface that lies in remaining bone. The patch is given by its centre's
    /// continuous voxel index, its outward normal and its half width in cells.
    ///
    /// Where an older surface crosses the burr's surface at an angle θ, D changes by sin θ per length along the patch, so the
    /// share is m = clamp(½ + D/(w sin θ), 0, 1).
    #[inline]
    pub(super) fn patch_left(&self, index: &Vector3<f64>, normal: &Vector3<f64>, half: f64) -> f64 {
        let cell = self.cell_of_index(index);
        // most patches are far from any cut surface, which one cell shows
        if let Some(is_left) = self.is_surely_left(&cell, half) {
            return f64::from(u8::from(is_left));
        }
        self.interpolated(&cell, normal, half)
    }

    /// [`Self::patch_left`] by interpolation between the eight cells around.
    #[inline]
    fn interpolated(&self, cell: &Vector3<f64>, normal: &Vector3<f64>, half: f64) -> f64 {
        let (corners, u) = match self.around(cell) {
            CellsAround::Bone => return 1.0,
            CellsAround::Gone => return 0.0,
            CellsAround::Cut(corners, u) => (corners, u),
        };
        // a tube is curved in two of three directions, half of each in the mean
        let bent: f32 = u.iter().map(|u| u * (1.0 - u)).sum::<f32>() * (self.bend / 6.0) as f32;
        let depth = f64::from(trilinear(&corners, u) - bent);
        if depth >= half {
            return 1.0;
        }
        if depth <= -half {
            return 0.0;
        }
        // within a cell the slope of the interpolation turns as much as the surface
        let sin = (crossing(&slope(&corners, u), normal) - self.bend).max(0.0);
        share(depth, half, sin, DOUBT * self.bend)
    }

    /// Whether a patch of half width `half`, cells, certainly lies in remaining bone (true) or in removed space (false); `None`
    /// if the cell nearest to its middle does not decide. It decides where it is so deep that interpolation cannot change the
    /// sign: the eight cells are [`AROUND`] away in the mean, and D grows by at most 1 per length.
    #[inline]
    fn is_surely_left(&self, cell: &Vector3<f64>, half: f64) -> Option<bool> {
        let depth = f64::from(self.depth_of(self.nearest_cell(cell)));
        let sure = half + AROUND + self.bend;
        if depth >= sure { Some(true) } else { (depth <= -sure).then_some(false) }
    }

    /// Whether there is no remaining bone within `reach_mm` of the point with this continuous voxel index, and no patch of this
    /// half width there meets any; `reach_mm` is at most [`Lattice::longest_reach_mm`].
    ///
    /// D grows by at most 1 per length, and so do the depths of patches, up to the error of interpolation.
    #[inline]
    pub(super) fn is_open_around(&self, index: &Vector3<f64>, reach_mm: f64, half_mm: f64) -> bool {
        let cell = self.cell_of_index(index);
        let brick = std::array::from_fn(|a| (cell[a].max(0.0) as usize).min(self.cells[a] - 1) / SIDE);
        if self.looked_at(self.brick_index(brick)) == tag::NOTHING {
            return true;
        }
        let least = (reach_mm + half_mm) / self.spacing_mm() + BETWEEN;
        // inside bone one cell decides
        f64::from(self.depth_of(self.nearest_cell(&cell))) <= AROUND - least
            && f64::from(self.depth_at(&cell)) <= -least
    }

    /// The longest reach of [`Lattice::is_open_around`] for patches of a half width, mm.
    pub(super) fn longest_reach_mm(&self, half_mm: f64) -> f64 {
        (f64::from(FAR) - BETWEEN) * self.spacing_mm() - half_mm
    }

    /// The eight cells around cell coordinates and the position between them. Beyond the lattice its outermost cells are used.
    #[inline]
    fn around(&self, cell: &Vector3<f64>) -> CellsAround {
        let (mut base, mut u) = ([0usize; 3], [0f32; 3]);
        for a in 0..3 {
            // NaN becomes 0
            let c = cell[a].max(0.0);
            base[a] = (c as usize).min(self.cells[a] - 1);
            u[a] = ((c - base[a] as f64) as f32).min(1.0);
        }
        let local = base.map(|c| c % SIDE);
        if local.iter().all(|&l| l < SIDE - 1) {
            let stored = match self.tag(self.brick_index(base.map(|c| c / SIDE))) {
                place if place < tag::FIRST => self.stored[place as usize].as_ref(),
                tag::GONE => return CellsAround::Gone,
                _ => return CellsAround::Bone,
            };
            let Some(brick) = stored else { return CellsAround::Bone };
            let start = local[0] + SIDE * (local[1] + SIDE * local[2]);
            let v = &brick.depth[start..start + SIDE * SIDE + SIDE + 2];
            return CellsAround::Cut([v[0], v[1], v[8], v[9], v[64], v[65], v[72], v[73]], u);
        }
        let corner = |n: usize| {
            let cell = [base[0] + (n & 1), base[1] + (n >> 1 & 1), base[2] + (n >> 2)];
            self.depth_of(std::array::from_fn(|a| cell[a].min(self.cells[a] - 1)))
        };
        CellsAround::Cut(std::array::from_fn(corner), u)
    }

    /// The cell nearest to cell coordinates; beyond the lattice the outermost one. NaN becomes 0.
    #[inline]
    fn nearest_cell(&self, cell: &Vector3<f64>) -> [usize; 3] {
        std::array::from_fn(|a| ((cell[a] + 0.5).max(0.0) as usize).min(self.cells[a] - 1))
    }

    /// Number of cells along a voxel; 1 where a cell is as large or larger.
    pub(super) fn split(&self) -> usize {
        self.split
    }

    /// D at cell coordinates, interpolated.
    #[inline]
    pub(super) fn depth_at(&self, cell: &Vector3<f64>) -> f32 {
        match self.around(cell) {
            CellsAround::Bone => FAR,
            CellsAround::Gone => -FAR,
            CellsAround::Cut(corners, u) => trilinear(&corners, u),
        }
    }

    /// D of a cell.
    #[inline]
    pub(super) fn depth_of(&self, cell: [usize; 3]) -> f32 {
        match self.tag(self.brick_index(cell.map(|c| c / SIDE))) {
            place if place < tag::FIRST => self.stored[place as usize].as_ref().map_or(FAR, |brick| {
                let [x, y, z] = cell.map(|c| c % SIDE);
                brick.depth[x + SIDE * (y + SIDE * z)]
            }),
            tag::GONE => -FAR,
            _ => FAR,
        }
    }

    /// Number of the brick (i, j, k).
    #[inline]
    pub(super) fn brick_index(&self, [i, j, k]: [usize; 3]) -> usize {
        i + self.bricks[0] * (j + self.bricks[1] * k)
    }

    /// First cell of a brick.
    pub(super) fn first_cell(&self, brick: usize) -> [usize; 3] {
        let [nx, ny, _] = self.bricks;
        [brick % nx, brick / nx % ny, brick / (nx * ny)].map(|b| b * SIDE)
    }

    /// Cell number `n` of a brick.
    pub(super) fn cell_in(&self, brick: usize, n: usize) -> [usize; 3] {
        let first = self.first_cell(brick);
        [first[0] + n % SIDE, first[1] + n / SIDE % SIDE, first[2] + n / (SIDE * SIDE)]
    }

    /// Cells along x, y, z.
    pub(super) fn cells(&self) -> [usize; 3] {
        self.cells
    }

    /// Number of all bricks.
    pub(super) fn brick_count(&self) -> usize {
        self.tags.len()
    }

    /// A brick's tag.
    #[inline]
    pub(super) fn tag(&self, brick: usize) -> u32 {
        self.tags[brick].load(Relaxed)
    }

    pub(super) fn set_tag(&mut self, brick: usize, tag: u32) {
        *self.tags[brick].get_mut() = tag;
    }

    /// A brick's tag; an unknown brick is classified first.
    pub(super) fn looked_at(&self, brick: usize) -> u32 {
        if self.tag(brick) == tag::UNKNOWN {
            let found = if self.has_solid(brick) { tag::INTACT } else { tag::NOTHING };
            self.tags[brick].store(found, Relaxed);
        }
        self.tag(brick)
    }

    /// Amount of all remaining solid material. Reads every voxel.
    pub fn left(&self) -> Amount {
        let mut left = Amount::default();
        let part_mm3 = self.part_mm3();
        for index in 0..self.brick_count() {
            let brick = match self.tag(index) {
                tag::GONE | tag::NOTHING => continue,
                place if place < tag::FIRST => self.stored[place as usize].as_deref(),
                _ => Some(&Brick::INTACT),
            };
            let Some(brick) = brick else { continue };
            // summed by brick, because one long sum would accumulate rounding errors
            let mut own = Amount::default();
            for n in 0..CELLS {
                let held = brick.held[n].unwrap_or_else(|| self.held(self.cell_in(index, n)));
                if let Some(kind) = held.kind {
                    let part = self.part_left(brick.depth[n]);
                    own.add(kind, part * f64::from(held.parts) * part_mm3, part * held.mass_mg);
                }
            }
            left.merge(&own);
        }
        left
    }

    /// The remaining share of a cell whose centre has depth D, cells.
    #[inline]
    pub(super) fn part_left(&self, depth: f32) -> f64 {
        (0.5 + self.bend / 24.0 + f64::from(depth)).clamp(0.0, 1.0)
    }

    /// Records that a brick's cells changed.
    pub(super) fn touch(&mut self, brick: usize) {
        if !self.is_dirty[brick] {
            self.is_dirty[brick] = true;
            self.dirty.push(brick as u32);
        }
    }

    /// Bricks whose cells changed since the last call, ascending.
    pub(super) fn take_touched(&mut self) -> Vec<u32> {
        let mut touched = std::mem::take(&mut self.dirty);
        touched.sort_unstable();
        touched.iter().for_each(|&brick| self.is_dirty[brick as usize] = false);
        touched
    }
}

/// Cells around a point.
enum CellsAround {
    /// None is cut.
    Bone,
    /// All are removed.
    Gone,
    /// Depths, x-fastest, and the position between them, 0 to 1.
    Cut([f32; 8], [f32; 3]),
}

/// m = clamp(½ + D/(w sin θ), 0, 1) with half the width w. A surface along the patch comes from an earlier visit of the burr
/// to the same place; there a depth within `doubt` counts as removed.
#[inline]
pub(super) fn share(depth: f64, half: f64, sin: f64, doubt: f64) -> f64 {
    let depth = depth - doubt * (1.0 - sin * sin);
    (0.5 + depth / (2.0 * half * sin).max(1e-12)).clamp(0.0, 1.0)
}

/// Sine of the angle between a surface with this gradient and the one with this unit normal.
#[inline]
pub(super) fn crossing(gradient: &Vector3<f64>, normal: &Vector3<f64>) -> f64 {
    let squared = gradient.norm_squared().max(1e-12);
    (1.0 - gradient.dot(normal).powi(2) / squared).max(0.0).sqrt()
}

/// Gradient of the trilinear interpolation.
fn slope(v: &[f32; 8], u: [f32; 3]) -> Vector3<f64> {
    let axis = |a: usize| {
        let (step, b, c) = (1 << a, (a + 1) % 3, (a + 2) % 3);
        let weight = |n: usize, axis: usize| if n >> axis & 1 == 1 { u[axis] } else { 1.0 - u[axis] };
        let rising = |n: usize| (v[n + step] - v[n]) * weight(n, b) * weight(n, c);
        f64::from((0..8).filter(|n| n & step == 0).map(rising).sum::<f32>())
    };
    Vector3::new(axis(0), axis(1), axis(2))
}

#[cfg(test)]
mod tests;
