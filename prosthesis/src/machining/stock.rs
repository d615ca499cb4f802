//! What is left of the block, as heights by side, while the moves are laid.
//!
//! Both sides cut along one axis, so the stock over a cell is one interval: from the surface that the other side left to the one that this side leaves.
//! The stock says which part of a pass takes anything, how wide a cut would be, and how high the tip must be to pass freely.
//!
//! What a cut takes is told at cells' centres. What is free is told by the cells that were cut whole: a ridge may stand between two centres.

use crate::machining::EndMill;
use crate::machining::job::Block;
use crate::machining::moves::Facing;
use crate::machining::raster::{CellRaster, NONE};

/// So that cells on the border of two strips count for one and the same side, in strips.
const TIE: f64 = 1e-6;
/// Thinner stock than this is taken for none, mm.
const LEAST_MM: f64 = 0.01;

/// Share of a cell's side from its centre to its corners.
const TO_CORNER: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// Stock as one side sees it.
#[derive(Debug, Clone)]
pub struct Stock {
    raster: CellRaster,
    tool: EndMill,
    /// At the cells' centres.
    pub centres: Surfaces,
    /// Where a cell was cut whole.
    whole: Surfaces,
}

/// The two surfaces of the stock over the cells, as heights of one side.
#[derive(Debug, Clone)]
pub struct Surfaces {
    /// Of this side, mm; `NONE` beside the block.
    pub top: Vec<f64>,
    /// Of the other side, mm.
    pub other: Vec<f64>,
}

impl Surfaces {
    /// Thickness that a surface at `w_mm` takes from a cell, mm.
    fn taken(&self, cell: usize, w_mm: f64) -> f64 {
        self.top[cell] - w_mm.max(self.other[cell])
    }

    /// The same seen from the other side.
    fn turned(&self, raster: &CellRaster) -> Self {
        let other_way = |map: &[f64]| raster.turned(&map.iter().map(|w| -w).collect::<Vec<_>>());
        let cells = self.top.iter().zip(&self.other);
        let gone = cells.map(|(top, other)| if top > other { *other } else { f64::INFINITY });
        Self { top: other_way(&gone.collect::<Vec<_>>()), other: other_way(&self.top) }
    }
}

/// A place of the tip: u, v, w, mm.
pub type TipPoint = [f64; 3];

impl Stock {
    /// The whole block.
    pub fn block(raster: &CellRaster, block: &Block, tool: &EndMill, facing: Facing) -> Self {
        let (a, b) = (facing.from_block(&block.low_mm), facing.from_block(&block.high_mm));
        let (low, high) = (a.inf(&b), a.sup(&b));
        // of the cells, or of those that the block touches
        let surfaces = |beside_mm: f64| {
            let inside = |cell: usize| {
                let [u, v] = raster.centre_of(cell);
                let [from, to] = [low.add_scalar(-beside_mm), high.add_scalar(beside_mm)];
                u >= from.x && u <= to.x && v >= from.y && v <= to.y
            };
            let top = (0..raster.len()).map(|cell| if inside(cell) { high.z } else { NONE }).collect();
            Surfaces { top, other: raster.filled(low.z) }
        };
        let (centres, whole) = (surfaces(0.0), surfaces(0.5 * raster.pitch_mm));
        Self { raster: *raster, tool: tool.clone(), centres, whole }
    }

    /// Side of a cell, mm.
    pub fn pitch_mm(&self) -> f64 {
        self.raster.pitch_mm
    }

    /// The same stock seen from the other side.
    pub fn turned(&self) -> Self {
        let [centres, whole] = [&self.centres, &self.whole].map(|surfaces| surfaces.turned(&self.raster));
        Self { raster: self.raster, tool: self.tool.clone(), centres, whole }
    }

    /// The cells whose centres are under a tool wider by `grown_mm` at a place: cell, height of the tool's surface there.
    fn under(&self, [u, v, w]: TipPoint, grown_mm: f64) -> impl Iterator<Item = (usize, f64)> {
        let (raster, tool) = (&self.raster, &self.tool);
        let radius = tool.radius_mm + grown_mm;
        raster.span(1, v - radius, v + radius).flat_map(move |j| {
            let dv = raster.centre(0, j)[1] - v;
            let half = (radius * radius - dv * dv).max(0.0).sqrt();
            raster.span(0, u - half, u + half).map(move |i| {
                let surface = if tool.corner_radius_mm == 0.0 {
                    w
                } else {
                    let du = raster.centre(i, 0)[0] - u;
                    let distance = (du.hypot(dv) - grown_mm).clamp(0.0, tool.radius_mm);
                    w + tool.profile_mm(distance).unwrap_or(0.0)
                };
                (i + raster.dims[0] * j, surface)
            })
        })
    }

    /// The cells that lie under the tool with all their corners, as [`Self::under`] gives them.
    fn under_whole(&self, at: TipPoint) -> impl Iterator<Item = (usize, f64)> {
        self.under(at, -TO_CORNER * self.raster.pitch_mm)
    }

    /// Whether the tool at a place, wider by `grown_mm`, would take anything from cells that `counts` holds for.
    pub fn meets(&self, at: TipPoint, grown_mm: f64, counts: &[bool]) -> bool {
        self.under(at, grown_mm).any(|(cell, w)| counts[cell] && self.centres.taken(cell, w) > LEAST_MM)
    }

    /// Whether the tool at a place would cut cells whole that were not yet, of those that `counts` holds for.
    pub fn meets_whole(&self, at: TipPoint, counts: &[bool]) -> bool {
        self.under_whole(at).any(|(cell, w)| counts[cell] && self.whole.taken(cell, w) > LEAST_MM)
    }

    /// How much of the tool's width, across `direction`, has stock before it that is thicker than `deeper_mm`, mm: in strips one cell wide.
    /// Stock whose cells' centres are up to `grown_mm` before the tool counts, too: slivers may be thinner than a cell.
    pub fn width_mm(&self, at: TipPoint, direction: [f64; 2], deeper_mm: f64, grown_mm: f64) -> f64 {
        let radius_mm = self.tool.radius_mm;
        let mut strips = vec![false; (self.tool.diameter_mm() / self.raster.pitch_mm) as usize + 2];
        let near = self.under(at, grown_mm);
        let thick = near.filter(|(cell, w)| self.centres.taken(*cell, *w) > deeper_mm);
        thick.for_each(|(cell, _)| {
            let [u, v] = self.raster.centre_of(cell);
            let (du, dv) = (u - at[0], v - at[1]);
            let across = dv * direction[0] - du * direction[1];
            if du * direction[0] + dv * direction[1] > 0.0 && across.abs() <= radius_mm {
                strips[((across + radius_mm) / self.raster.pitch_mm + TIE) as usize] = true;
            }
        });
        strips.iter().filter(|strip| **strip).count() as f64 * self.raster.pitch_mm
    }

    /// Takes away what is above the tool at a place.
    pub fn cut(&mut self, at: TipPoint) {
        let mut top = std::mem::take(&mut self.centres.top);
        self.under(at, 0.0).for_each(|(cell, w)| top[cell] = top[cell].min(w));
        self.centres.top = top;
        let mut top = std::mem::take(&mut self.whole.top);
        self.under_whole(at).for_each(|(cell, w)| top[cell] = top[cell].min(w));
        self.whole.top = top;
    }

    /// Cuts along a straight move, at steps of a cell.
    pub fn cut_line(&mut self, from: TipPoint, to: TipPoint) {
        for at in steps(from, to, self.raster.pitch_mm) {
            self.cut(at);
        }
    }

    /// Lowest place of the tip at (u, v) at which the tool takes nothing from the centres, mm.
    pub fn lowest_mm(&self, at: [f64; 2]) -> f64 {
        self.lowest_over_mm(at, 0.0, &self.centres)
    }

    /// Lowest place of the tip at (u, v) at which the tool meets nothing, a cell's side away from it either, mm.
    pub fn free_mm(&self, at: [f64; 2]) -> f64 {
        self.lowest_over_mm(at, self.raster.pitch_mm, &self.whole)
    }

    fn lowest_over_mm(&self, at: [f64; 2], grown_mm: f64, stock: &Surfaces) -> f64 {
        let mut lowest = NONE;
        self.under([at[0], at[1], 0.0], grown_mm).for_each(|(cell, f)| {
            if stock.top[cell] > stock.other[cell] {
                lowest = lowest.max(stock.top[cell] - f);
            }
        });
        lowest
    }

    /// [`Self::free_mm`] along a straight line.
    pub fn free_along_mm(&self, from: [f64; 2], to: [f64; 2]) -> f64 {
        let (from, to) = ([from[0], from[1], 0.0], [to[0], to[1], 0.0]);
        let apart = 2.0 * self.raster.pitch_mm;
        steps(from, to, apart).map(|p| self.free_mm([p[0], p[1]])).fold(NONE, f64::max)
    }
}

/// Places along a straight line, both ends included, at most `apart_mm` apart.
pub fn steps(from: TipPoint, to: TipPoint, apart_mm: f64) -> impl Iterator<Item = TipPoint> {
    let length = (to[0] - from[0]).hypot(to[1] - from[1]);
    let count = (length / apart_mm).ceil().max(1.0) as usize;
    (0..=count).map(move |n| {
        let part = n as f64 / count as f64;
        std::array::from_fn(|a| from[a] + part * (to[a] - from[a]))
    })
}
