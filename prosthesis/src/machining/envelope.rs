//! The part seen along the cutter: its highest and lowest points over every cell, and what lies hidden between.
//!
//! Two opposite sides see the upper and the lower envelope only. Where a vertical line meets the part in several pieces, the gaps between them are
//! undercuts from both sides: [`Envelope::hidden_mm`] says how much, [`crate::machining::leftover`] where.
//! Columns are taken at the cells' centres; what is thinner than a cell may be missed here and is found by [`crate::machining::dropcutter`].

use nalgebra::Vector3;

use crate::machining::raster::{CellRaster, NONE};

/// Gaps below this are taken for one surface, mm.
const LEAST_GAP_MM: f64 = 0.02;

/// A triangle's corners in (u, v, w), mm, counter-clockwise from outside.
pub type Facet = [Vector3<f64>; 3];

/// Heights of a part over a raster, seen from the front.
#[derive(Debug, Clone)]
pub struct Envelope {
    /// Highest point, mm; `NONE` where there is no part.
    pub top: Vec<f64>,
    /// Lowest point, mm; +∞ where there is no part.
    pub bottom: Vec<f64>,
    /// Sum of the gaps between top and bottom, mm.
    pub hidden_mm: Vec<f64>,
}

/// Where a facet's plane is over a cell.
struct Crossing {
    cell: u32,
    w_mm: f64,
    leaves: bool,
}

impl Envelope {
    /// Of the facets of a closed mesh.
    pub fn of(raster: &CellRaster, facets: &[Facet]) -> Self {
        let mut crossings = Vec::new();
        for facet in facets {
            add_crossings(raster, facet, &mut crossings);
        }
        crossings.sort_unstable_by(|a, b| {
            (a.cell, a.w_mm).partial_cmp(&(b.cell, b.w_mm)).unwrap_or(std::cmp::Ordering::Equal)
        });
        let mut envelope = Self {
            top: raster.filled(NONE),
            bottom: raster.filled(f64::INFINITY),
            hidden_mm: raster.filled(0.0),
        };
        for column in crossings.chunk_by(|a, b| a.cell == b.cell) {
            envelope.enter(column);
        }
        envelope
    }

    fn enter(&mut self, column: &[Crossing]) {
        let [first, .., last] = column else { return };
        let cell = first.cell as usize;
        (self.bottom[cell], self.top[cell]) = (first.w_mm, last.w_mm);
        let gaps = column.windows(2).filter(|pair| pair[0].leaves && !pair[1].leaves);
        self.hidden_mm[cell] =
            gaps.map(|pair| pair[1].w_mm - pair[0].w_mm).filter(|gap| *gap > LEAST_GAP_MM).sum();
    }

    /// Whether the part is over a cell.
    pub fn holds(&self, cell: usize) -> bool {
        self.top[cell] > NONE
    }

    /// Heights seen from the front or, turned, from the back.
    pub fn heights(&self, raster: &CellRaster, facing: crate::machining::moves::Facing) -> Vec<f64> {
        match facing {
            crate::machining::moves::Facing::Front => self.top.clone(),
            crate::machining::moves::Facing::Back => {
                raster.turned(&self.bottom.iter().map(|w| -w).collect::<Vec<_>>())
            }
        }
    }
}

fn add_crossings(raster: &CellRaster, [a, b, c]: &Facet, into: &mut Vec<Crossing>) {
    let normal = (b - a).cross(&(c - a));
    if normal.z == 0.0 {
        return;
    }
    let range = |axis: usize| {
        let values = [a[axis], b[axis], c[axis]];
        (values.iter().copied().fold(f64::INFINITY, f64::min), values.iter().copied().fold(NONE, f64::max))
    };
    let (u, v) = (range(0), range(1));
    let turn = normal.z.signum();
    let side = |p: &Vector3<f64>, q: &Vector3<f64>, [u, v]: [f64; 2]| {
        turn * ((q.x - p.x) * (v - p.y) - (q.y - p.y) * (u - p.x)) >= 0.0
    };
    for j in raster.span(1, v.0, v.1) {
        for i in raster.span(0, u.0, u.1) {
            let at = raster.centre(i, j);
            if side(a, b, at) && side(b, c, at) && side(c, a, at) {
                let w_mm = a.z - (normal.x * (at[0] - a.x) + normal.y * (at[1] - a.y)) / normal.z;
                into.push(Crossing { cell: (i + raster.dims[0] * j) as u32, w_mm, leaves: normal.z > 0.0 });
            }
        }
    }
}
