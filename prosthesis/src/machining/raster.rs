//! A square raster over (u, v) and maps of heights on it.
//!
//! The raster is symmetric in v, so that cell (i, j) seen from the front is cell (i, n − 1 − j) seen from the back. A map holds a height w a
//! cell, at its centre; `NONE` stands where there is nothing.

use bonemill_geometry::cancel;
use rayon::prelude::*;

use crate::machining::{EndMill, MachiningError};

/// No material: below everything.
pub const NONE: f64 = f64::NEG_INFINITY;

/// Cells of the largest raster.
const MOST_CELLS: f64 = 6e6;

/// Square cells over (u, v).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CellRaster {
    /// Centre of cell (0, 0), mm.
    pub origin_mm: [f64; 2],
    /// Side of a cell, mm.
    pub pitch_mm: f64,
    /// Cells along u and v.
    pub dims: [usize; 2],
}

impl CellRaster {
    /// Over u in `low..high` and |v| up to `v_mm`, with cells of `pitch_mm`, or larger where these would be too many.
    ///
    /// # Errors
    /// [`MachiningError::TooLarge`] where even cells of 0.5 mm are too many.
    pub fn over(low_mm: f64, high_mm: f64, v_mm: f64, pitch_mm: f64) -> Result<Self, MachiningError> {
        let (width, height) = (high_mm - low_mm, 2.0 * v_mm);
        let pitch_mm = pitch_mm.max((width * height / MOST_CELLS).sqrt());
        let most_mm = 0.5 * MOST_CELLS.sqrt();
        let size_mm = width.max(height);
        if size_mm > most_mm || !size_mm.is_finite() {
            return Err(MachiningError::TooLarge { size_mm, most_mm });
        }
        let cells = |length: f64| (length / pitch_mm).ceil() as usize + 1;
        let dims = [cells(width), cells(height)];
        let start = |middle: f64, n: usize| middle - 0.5 * (n - 1) as f64 * pitch_mm;
        let origin_mm = [start(0.5 * (low_mm + high_mm), dims[0]), start(0.0, dims[1])];
        Ok(Self { origin_mm, pitch_mm, dims })
    }

    /// Number of cells.
    pub fn len(&self) -> usize {
        self.dims[0] * self.dims[1]
    }

    /// Never: there is at least one cell.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// A map with one height everywhere.
    pub fn filled(&self, w_mm: f64) -> Vec<f64> {
        vec![w_mm; self.len()]
    }

    /// Centre of a cell, mm.
    pub fn centre(&self, i: usize, j: usize) -> [f64; 2] {
        [self.origin_mm[0] + i as f64 * self.pitch_mm, self.origin_mm[1] + j as f64 * self.pitch_mm]
    }

    /// Centre of the cell at a place in memory, mm.
    pub fn centre_of(&self, cell: usize) -> [f64; 2] {
        self.centre(cell % self.dims[0], cell / self.dims[0])
    }

    /// Column or row of a coordinate, as a real number; integers are centres.
    pub fn at(&self, axis: usize, mm: f64) -> f64 {
        (mm - self.origin_mm[axis]) / self.pitch_mm
    }

    /// The cell whose square holds the point, if any.
    pub fn cell(&self, [u, v]: [f64; 2]) -> Option<usize> {
        let (i, j) = (self.at(0, u).round(), self.at(1, v).round());
        let inside = i >= 0.0 && j >= 0.0 && i < self.dims[0] as f64 && j < self.dims[1] as f64;
        inside.then(|| i as usize + self.dims[0] * j as usize)
    }

    /// The cells beside one: left, right, below, above; `None` beyond the raster.
    pub fn neighbours(&self, cell: usize) -> [Option<usize>; 4] {
        let [nu, nv] = self.dims;
        let (i, j) = (cell % nu, cell / nu);
        [
            (i > 0).then(|| cell - 1),
            (i + 1 < nu).then(|| cell + 1),
            (j > 0).then(|| cell - nu),
            (j + 1 < nv).then(|| cell + nu),
        ]
    }

    /// Cells that are connected to those of `from` through cells that are `open`, these included, but for those that were `seen`; then they all are.
    pub fn connected(
        &self,
        mut from: Vec<usize>,
        seen: &mut [bool],
        open: impl Fn(usize) -> bool,
    ) -> Vec<usize> {
        let mut found = Vec::new();
        while let Some(cell) = from.pop() {
            if open(cell) && !std::mem::replace(&mut seen[cell], true) {
                found.push(cell);
                from.extend(self.neighbours(cell).into_iter().flatten());
            }
        }
        found
    }

    /// Columns or rows whose centres lie within `low..=high` mm, cut to the raster.
    pub fn span(&self, axis: usize, low_mm: f64, high_mm: f64) -> std::ops::Range<usize> {
        let low = self.at(axis, low_mm).ceil().max(0.0);
        let high = (self.at(axis, high_mm).floor() + 1.0).clamp(0.0, self.dims[axis] as f64);
        low.min(high) as usize..high as usize
    }

    /// The greatest of the four heights around a point; `NONE` outside.
    pub fn highest_around(&self, map: &[f64], [u, v]: [f64; 2]) -> f64 {
        let (i, j) = (self.at(0, u), self.at(1, v));
        let mut best = NONE;
        for j in [j.floor(), j.ceil()] {
            for i in [i.floor(), i.ceil()] {
                let inside = i >= 0.0 && j >= 0.0 && i < self.dims[0] as f64 && j < self.dims[1] as f64;
                if let Some(w) = inside.then(|| map.get(i as usize + self.dims[0] * j as usize)).flatten() {
                    best = best.max(*w);
                }
            }
        }
        best
    }

    /// The map seen from the other side: rows in reverse.
    pub fn turned<T: Copy>(&self, map: &[T]) -> Vec<T> {
        map.chunks(self.dims[0]).rev().flatten().copied().collect()
    }

    /// Where the tip may be over a body: out(p) = max over o of map(p + o) − profile(|o|), mm.
    ///
    /// `grown_mm` widens the cutter, which makes the map safe for a body known at cell centres only.
    pub fn dilated(&self, map: &[f64], tool: &EndMill, grown_mm: f64) -> Vec<f64> {
        self.spread(map, &Footprint::of(self, tool, grown_mm), |best, w, f| best.max(w - f), NONE)
    }

    /// What a tip over `map` leaves: out(p) = min over o of map(p + o) + profile(|o|), mm.
    pub fn eroded(&self, map: &[f64], tool: &EndMill) -> Vec<f64> {
        self.spread(map, &Footprint::of(self, tool, 0.0), |best, w, f| best.min(w + f), f64::INFINITY)
    }

    /// The highest of a cell and the eight around it.
    pub fn widened(&self, map: &[f64]) -> Vec<f64> {
        self.spread(map, &Footprint::square(), |best, w, _| best.max(w), NONE)
    }

    /// The lowest of a cell and the eight around it.
    pub fn narrowed(&self, map: &[f64]) -> Vec<f64> {
        self.spread(map, &Footprint::square(), |best, w, _| best.min(w), f64::INFINITY)
    }

    fn spread(
        &self,
        map: &[f64],
        footprint: &Footprint,
        merge: impl Fn(f64, f64, f64) -> f64 + Sync,
        start: f64,
    ) -> Vec<f64> {
        let nu = self.dims[0];
        let mut out = vec![start; self.len()];
        out.par_chunks_mut(nu).enumerate().for_each(|(j, row)| {
            cancel::poll();
            for &(du, dv, f) in &footprint.cells {
                let Some(from) = j.checked_add_signed(dv).filter(|r| *r < self.dims[1]) else { continue };
                let source = &map[from * nu..(from + 1) * nu];
                let (to, from) = if du < 0 { (du.unsigned_abs(), 0) } else { (0, du.unsigned_abs()) };
                let count = nu.saturating_sub(du.unsigned_abs());
                for (best, w) in row[to..to + count].iter_mut().zip(&source[from..from + count]) {
                    *best = merge(*best, *w, f);
                }
            }
        });
        out
    }
}

/// The cells under a cutter whose axis is over a cell's centre, with the height of its surface there.
#[derive(Debug, Clone)]
pub struct Footprint {
    /// Offsets in cells, and the profile, mm.
    pub cells: Vec<(isize, isize, f64)>,
}

impl Footprint {
    /// A cell and the eight around it.
    fn square() -> Self {
        Self { cells: (-1..=1).flat_map(|dv| (-1..=1).map(move |du| (du, dv, 0.0))).collect() }
    }

    /// Of a tool whose radius is larger by `grown_mm`.
    pub fn of(raster: &CellRaster, tool: &EndMill, grown_mm: f64) -> Self {
        let reach = ((tool.radius_mm + grown_mm) / raster.pitch_mm).floor() as isize;
        let mut cells = Vec::new();
        for dv in -reach..=reach {
            for du in -reach..=reach {
                let distance = raster.pitch_mm * ((du * du + dv * dv) as f64).sqrt();
                if let Some(f) = tool.profile_mm((distance - grown_mm).max(0.0)) {
                    cells.push((du, dv, f));
                }
            }
        }
        Self { cells }
    }
}
