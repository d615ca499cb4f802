//! What cutters of one axis have removed: signed distances of its surface, in bricks of 8³ cells where there is any, along the tool's
//! axes.
//!
//! A cell keeps the least signed distance of all solids taken, cut off at ±2 cells; it only falls, so the order does not matter.
//! A brick is shared with who displays it and copied when it is cut again, so that neither waits for the other.

use std::sync::Arc;

use bonemill_geometry::{Grid, Work};
use nalgebra::{Rotation3, Vector3};

use super::radial::RadialDistances;
use crate::EngineError;

/// Cells along a brick's side.
pub(super) const SIDE: usize = 8;
/// Distances beyond this are cut off, cells.
pub(super) const FAR: f32 = 2.0;
/// More bricks than this over the bone are refused.
const MOST_BRICKS: f64 = 6.7e7;
/// The place of a brick without a hole: beyond all that are stored.
const WHOLE: u32 = u32::MAX;

/// Distances of a brick's cells, in cells, x-fastest.
pub(super) type Brick = [f32; SIDE * SIDE * SIDE];

/// Distances, in cells.
#[derive(Debug, Clone)]
pub struct Holes {
    pub(super) cell_mm: f64,
    /// Cell centre (0, 0, 0), tool axes.
    pub(super) origin_mm: Vector3<f64>,
    pub(super) bricks: [usize; 3],
    /// Bricks that changed since they were last taken for display, each once.
    pub(super) touched: Vec<usize>,
    pub(super) is_touched: Vec<bool>,
    places: Vec<u32>,
    stored: Vec<Arc<Brick>>,
}

impl Holes {
    /// No hole in bone on this grid.
    ///
    /// # Errors
    /// [`EngineError::TooFine`] for more than 67 million bricks.
    pub fn new(
        grid: &Grid<Work>,
        tool_from_work: &Rotation3<f64>,
        cell_mm: f64,
    ) -> Result<Self, EngineError> {
        let dims = grid.dims().map(|n| (n - 1) as f64);
        let corners = (0..8usize).map(|n| {
            let index = [0, 1, 2].map(|a| if n >> a & 1 == 1 { dims[a] } else { 0.0 });
            tool_from_work * grid.at(index).coords
        });
        let beyond = grid.spacing_mm().max() + 3.0 * cell_mm;
        let (mut low, mut high) = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
        for corner in corners {
            (low, high) = (low.inf(&corner), high.sup(&corner));
        }
        let (low, high) = (low.add_scalar(-beyond), high.add_scalar(beyond));
        let count = (high - low).map(|length| (length / (cell_mm * SIDE as f64)).ceil());
        if count.product() > MOST_BRICKS {
            return Err(EngineError::TooFine {
                bricks: count.product(),
                spacing_mm: cell_mm,
                most: MOST_BRICKS,
            });
        }
        let bricks = [count.x as usize, count.y as usize, count.z as usize];
        let places = vec![WHOLE; bricks.iter().product()];
        let is_touched = vec![false; places.len()];
        let (stored, touched) = (Vec::new(), Vec::new());
        Ok(Self { cell_mm, origin_mm: low, bricks, touched, is_touched, places, stored })
    }

    /// Side of a cell, mm.
    pub fn cell_mm(&self) -> f64 {
        self.cell_mm
    }

    /// Bricks that hold a surface, and the memory of all, bytes.
    pub fn memory(&self) -> (usize, usize) {
        let bytes = self.stored.len() * size_of::<Brick>();
        (self.stored.len(), bytes + self.places.len() * size_of::<u32>())
    }

    /// Takes out the cutter's solid with its tip at a place, tool axes; `way_mm` is how far it came down the same line since the last
    /// time: what lies above is taken already.
    pub(super) fn take(&mut self, solid: &RadialDistances, tip_mm: &Vector3<f64>, way_mm: f64) {
        let [bottom, full, top] = solid.z_mm;
        let far = f64::from(FAR) * self.cell_mm;
        let radius = solid.radius_mm + far;
        let upper = (full + way_mm).min(top) + far;
        let low = tip_mm + Vector3::new(-radius, -radius, bottom - far);
        let high = tip_mm + Vector3::new(radius, radius, upper);
        let side_mm = SIDE as f64 * self.cell_mm;
        let brick = |p: &Vector3<f64>, a: usize| ((p[a] - self.origin_mm[a]) / side_mm).floor();
        let range = |a: usize| {
            let last = brick(&high, a).min((self.bricks[a] - 1) as f64);
            let first = brick(&low, a).max(0.0);
            if last < first { 0..0 } else { first as usize..last as usize + 1 }
        };
        let ranges = [range(0), range(1), range(2)];
        for k in ranges[2].clone() {
            for j in ranges[1].clone() {
                for i in ranges[0].clone() {
                    self.lower([i, j, k], solid, tip_mm, upper);
                }
            }
        }
    }

    fn lower(&mut self, brick: [usize; 3], solid: &RadialDistances, tip_mm: &Vector3<f64>, upper_mm: f64) {
        let number = brick[0] + self.bricks[0] * (brick[1] + self.bricks[1] * brick[2]);
        let first = self.origin_mm + Vector3::from(brick.map(|b| (b * SIDE) as f64 * self.cell_mm)) - tip_mm;
        // the brick's least distance from the axis says whether the solid reaches it
        let nearest = |a: usize| {
            let (low, high) = (first[a], first[a] + (SIDE - 1) as f64 * self.cell_mm);
            if low > 0.0 {
                low
            } else if high < 0.0 {
                -high
            } else {
                0.0
            }
        };
        if nearest(0).hypot(nearest(1)) > solid.radius_mm + f64::from(FAR) * self.cell_mm {
            return;
        }
        if self.places[number] == WHOLE {
            self.places[number] = self.stored.len() as u32;
            self.stored.push(Arc::new([FAR; SIDE * SIDE * SIDE]));
        }
        let (cell_mm, per_mm) = (self.cell_mm, (1.0 / self.cell_mm) as f32);
        let cells = Arc::make_mut(&mut self.stored[self.places[number] as usize]);
        let mut changes = false;
        let mut radii = [0.0; SIDE * SIDE];
        for (n, radius) in radii.iter_mut().enumerate() {
            *radius = (first.x + (n % SIDE) as f64 * cell_mm).hypot(first.y + (n / SIDE) as f64 * cell_mm);
        }
        for (layer, cells) in cells.chunks_exact_mut(SIDE * SIDE).enumerate() {
            let z = first.z + layer as f64 * cell_mm;
            if z > upper_mm {
                break;
            }
            for (cell, radius) in cells.iter_mut().zip(&radii) {
                let distance = (solid.at(*radius, z) * per_mm).max(-FAR);
                if distance < *cell {
                    *cell = distance;
                    changes = true;
                }
            }
        }
        if changes && !std::mem::replace(&mut self.is_touched[number], true) {
            self.touched.push(number);
        }
    }

    /// A brick's cells; `None` for one without a hole.
    #[inline]
    pub(super) fn brick(&self, [i, j, k]: [usize; 3]) -> Option<&Arc<Brick>> {
        let place = *self.places.get(i + self.bricks[0] * (j + self.bricks[1] * k))?;
        self.stored.get(place as usize)
    }

    /// The signed distance of a cell, cells.
    #[inline]
    fn cell(&self, cell: [usize; 3]) -> f32 {
        let brick = self.brick(cell.map(|c| c / SIDE));
        brick.map_or(FAR, |cells| cells[within(cell)])
    }

    /// The distance of the removed space at a point, tool axes, mm: negative within; cut off at ±2 cells.
    pub fn distance_mm(&self, p: &Vector3<f64>) -> f64 {
        let at = (p - self.origin_mm) / self.cell_mm;
        let most = |a: usize| (self.bricks[a] * SIDE - 2) as f64;
        let base = [0, 1, 2].map(|a| at[a].max(0.0).min(most(a)) as usize);
        let u = [0, 1, 2].map(|a| ((at[a] - base[a] as f64).clamp(0.0, 1.0)) as f32);
        let corner = |n: usize| self.cell([base[0] + (n & 1), base[1] + (n >> 1 & 1), base[2] + (n >> 2)]);
        f64::from(bonemill_geometry::trilinear(&std::array::from_fn(corner), u)) * self.cell_mm
    }

    /// The part of the bone at a point that is left, 0 to 1, besides what the cutter of the present line removed with its tip at
    /// `taken_mm`. Where that solid is nearer than any other hole, the lattice shows only itself.
    #[inline]
    pub(super) fn left_outside(
        &self,
        p: &Vector3<f64>,
        own: &RadialDistances,
        taken_mm: &Vector3<f64>,
    ) -> f64 {
        let distance = self.distance_mm(p);
        if distance >= 0.5 * self.cell_mm {
            return 1.0;
        }
        let from_tip = p - taken_mm;
        let of_own = f64::from(own.at(from_tip.x.hypot(from_tip.y), from_tip.z));
        // interpolation between cells is off by at most a few tenths of a cell at the solid's corners
        if of_own - distance < 0.35 * self.cell_mm {
            return 1.0;
        }
        (0.5 + distance / self.cell_mm).clamp(0.0, 1.0)
    }
}

/// Where a cell stands in its brick.
#[inline]
pub(super) fn within(cell: [usize; 3]) -> usize {
    let [i, j, k] = cell.map(|c| c % SIDE);
    i + SIDE * (j + SIDE * k)
}
