//! The published tool path, for comparison: planes of rows along x, there and back, and a last pass along every row on the surface.
//!
//! Rows step over the part with a retract. Their spacing is one number for all of the part, so the steepest place decides it; the side load of a plane's
//! first row is the whole cutter, and the sense of cut changes from row to row.
//!
//! **Source:** Castelli et al. 2020, section 4.2. Assumed, where the paper is silent: rows keep within the channel around the part.

use rayon::prelude::*;

use crate::machining::moves::Kind;
use crate::machining::part::Part;
use crate::machining::pass::{TipPass, refined};
use crate::machining::passes::Passes;
use crate::machining::raster::{CellRaster, NONE};
use crate::machining::sides::{ALLOWANCE_MM, Sight};

/// Spacings of the published tool path, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ZigZag {
    /// Rows of a plane (h_layer of the paper).
    pub row_mm: f64,
    /// Planes where the part is not met.
    pub plane_mm: f64,
    /// Planes where it is.
    pub fine_plane_mm: f64,
    /// Rows of the last pass on the surface.
    pub last_row_mm: f64,
}

impl Sight<'_> {
    /// The published tool path of a side: planes of rows along x from edge to edge of the domain, there and back, then a last pass along every row
    /// on the surface.
    pub fn zigzag(&self, part: &Part, passes: &mut Passes<'_>, rows: &ZigZag) {
        let (raster, job) = (&part.raster, self.job);
        passes.bounded = false;
        let beside = job.tool.radius_mm + ALLOWANCE_MM;
        let domain = self.domain(part, &part.milled_mm, beside);
        let height = |p: [f64; 2]| {
            let inside = raster.cell(p).is_some_and(|cell| domain[cell]);
            let tip =
                || self.drop.height_mm(p).max(raster.highest_around(&self.strip_tip, p)).max(self.deepest_mm);
            if inside { tip() } else { f64::INFINITY }
        };
        let surface = self.rows(raster, rows.row_mm, height);
        let finest = self.rows(raster, rows.last_row_mm, height);
        let finite = |w: &f64| w.is_finite();
        let lowest =
            surface.iter().flat_map(|r| &r.places).map(|p| p[2]).filter(finite).fold(f64::INFINITY, f64::min);
        let part_top = self.heights.iter().copied().fold(NONE, f64::max);
        let mut level = passes.stock.centres.top.iter().copied().fold(NONE, f64::max);
        while level > lowest {
            let step = if level - rows.plane_mm >= part_top { rows.plane_mm } else { rows.fine_plane_mm };
            level = (level - step).max(lowest);
            let at_level = |p: [f64; 2]| if height(p) <= level + 1e-9 { level } else { f64::INFINITY };
            for row in &surface {
                let place =
                    |p: &[f64; 3]| [p[0], p[1], if p[2] <= level + 1e-9 { level } else { f64::INFINITY }];
                passes.cut(
                    &TipPass { places: row.places.iter().map(place).collect(), closed: false },
                    &at_level,
                    Kind::Rough,
                );
            }
        }
        passes.look_beyond(rows.last_row_mm);
        for row in &finest {
            passes.cut(row, &height, Kind::Finish);
        }
    }

    /// Rows along u over the raster, every other one backwards.
    fn rows(
        &self,
        raster: &CellRaster,
        apart_mm: f64,
        height: impl Fn([f64; 2]) -> f64 + Sync,
    ) -> Vec<TipPass> {
        let [nu, nv] = raster.dims;
        let (start, end) = (raster.origin_mm, raster.centre(nu - 1, nv - 1));
        let count = ((end[1] - start[1]) / apart_mm).floor() as usize;
        let row = |n: usize| {
            let v = start[1] + n as f64 * apart_mm;
            let step = 1.5 * raster.pitch_mm;
            let places = (0..=((end[0] - start[0]) / step) as usize).map(|k| start[0] + k as f64 * step);
            let pass = TipPass { places: places.map(|u| [u, v, height([u, v])]).collect(), closed: false };
            let pass = refined(pass, &height);
            if n.is_multiple_of(2) { pass } else { pass.reversed() }
        };
        (0..=count).into_par_iter().map(row).collect()
    }
}
