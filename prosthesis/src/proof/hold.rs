//! What loses its hold: stock that a motion cuts off from the grip.
//!
//! Neighbouring columns hold each other where their stock overlaps along y. Stock is held while a chain of such columns leads to the grip. After a motion
//! that parted two columns, those around it are followed; only where they do not hold each other is the whole block followed from the grip.

use std::ops::Range;

use nalgebra::Vector3;

use crate::proof::dexels::Columns;

/// Pieces up to this volume are swarf, mm³. Assumed: the hair-thin rest beside a cut, about a milligram of plastic.
pub const SWARF_MM3: f64 = 1.0;
/// Least overlap of two columns that hold each other, mm.
pub(crate) const OVERLAP_MM: f64 = 0.01;

/// A piece of stock that a motion cut off from the grip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LoosePiece {
    /// Line of the program.
    pub line: usize,
    /// Volume, mm³.
    pub volume_mm3: f64,
    /// Its middle, block's frame, mm.
    pub at_mm: Vector3<f64>,
}

/// Columns and rows from the first to behind the last.
pub(crate) type Window = [Range<usize>; 2];

/// The columns that are held.
pub(crate) struct Hold {
    held: Vec<bool>,
    /// The search in which a column was last reached.
    reached: Vec<u32>,
    search: u32,
    /// Rows of columns in the grip.
    grip_rows: usize,
}

impl Hold {
    /// Of an uncut block that is gripped up to `grip_mm` above its lowest z.
    pub fn of(stock: &Columns, grip_mm: f64) -> Self {
        let count = stock.low.len();
        let grip_rows = ((grip_mm / stock.cell).round() as usize).clamp(1, stock.dims[1].max(1));
        Self { held: vec![true; count], reached: vec![0; count], search: 0, grip_rows }
    }

    /// Pieces larger than swarf that came loose in the motion of a line; the window holds every column that it touched.
    pub fn lost(&mut self, stock: &Columns, touched: &Window, line: usize) -> Vec<LoosePiece> {
        let around =
            [0, 1].map(|n| touched[n].start.saturating_sub(1)..(touched[n].end + 1).min(stock.dims[n]));
        let nx = stock.dims[0];
        let there: Vec<usize> = around[1]
            .clone()
            .flat_map(|k| around[0].clone().map(move |i| i + nx * k))
            .filter(|cell| self.is_held(stock, *cell))
            .collect();
        let Some(&first) = there.first() else { return vec![] };
        // columns that hold each other here are held as the others are, unless the grip itself was cut
        if around[1].start >= self.grip_rows && self.follow(stock, vec![first], &around).len() == there.len()
        {
            return vec![];
        }
        let block = stock.dims.map(|n| 0..n);
        let gripped = (0..self.grip_rows * nx).filter(|cell| self.is_held(stock, *cell)).collect();
        self.follow(stock, gripped, &block);
        let from_grip = self.search;
        let is_off: Vec<bool> = self.reached.iter().map(|search| *search != from_grip).collect();
        let mut found = Vec::new();
        for cell in (0..is_off.len()).filter(|cell| is_off[*cell]) {
            if self.is_held(stock, cell) {
                let piece = self.follow(stock, vec![cell], &block);
                piece.iter().for_each(|cell| self.held[*cell] = false);
                found
                    .extend(Some(measured(stock, &piece, line)).filter(|piece| piece.volume_mm3 > SWARF_MM3));
            }
        }
        found
    }

    fn is_held(&self, stock: &Columns, cell: usize) -> bool {
        self.held[cell] && stock.high[cell] > stock.low[cell]
    }

    /// The columns in a window that hold each other with the first ones, these included.
    fn follow(&mut self, stock: &Columns, first: Vec<usize>, window: &Window) -> Vec<usize> {
        self.search += 1;
        first.iter().for_each(|cell| self.reached[*cell] = self.search);
        let (mut found, mut next) = (first, 0);
        while let Some(&cell) = found.get(next) {
            next += 1;
            for beside in stock.beside(cell, window).into_iter().flatten() {
                if self.reached[beside] != self.search
                    && self.is_held(stock, beside)
                    && stock.hold(cell, beside)
                {
                    self.reached[beside] = self.search;
                    found.push(beside);
                }
            }
        }
        found
    }
}

impl Columns {
    /// Whether two neighbouring columns hold each other.
    pub(crate) fn hold(&self, a: usize, b: usize) -> bool {
        self.high[a].min(self.high[b]) - self.low[a].max(self.low[b]) > OVERLAP_MM
    }

    /// The four columns beside one, those in the window.
    pub(crate) fn beside(&self, cell: usize, [columns, rows]: &Window) -> [Option<usize>; 4] {
        let nx = self.dims[0];
        let (i, k) = (cell % nx, cell / nx);
        [
            (i > columns.start).then(|| cell - 1),
            (i + 1 < columns.end).then(|| cell + 1),
            (k > rows.start).then(|| cell - nx),
            (k + 1 < rows.end).then(|| cell + nx),
        ]
    }
}

/// Volume and middle of some columns.
fn measured(stock: &Columns, piece: &[usize], line: usize) -> LoosePiece {
    let (mut volume_mm3, mut moment) = (0.0, Vector3::zeros());
    for &cell in piece {
        let (low, high) = (stock.low[cell], stock.high[cell]);
        let volume = (high - low) * stock.cell * stock.cell;
        let at = |axis: usize, n: usize| stock.origin[axis] + n as f64 * stock.cell;
        let middle =
            Vector3::new(at(0, cell % stock.dims[0]), 0.5 * (low + high), at(1, cell / stock.dims[0]));
        (volume_mm3, moment) = (volume_mm3 + volume, moment + volume * middle);
    }
    LoosePiece { line, volume_mm3, at_mm: moment / volume_mm3 }
}
