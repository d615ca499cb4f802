//! The surface of a side: passes that leave no more than the finishing step.
//!
//! Where a surface rises at an angle θ, a pass of a flat end with radius R that goes at an angle φ to the steepest way leaves R sin θ (1 − cos Δψ) along the
//! normal at R sin(φ ± Δψ) across it. So passes along the steepest way may be √(8 e R / sin θ) apart for a finishing step e, passes along a contour line
//! e / sin θ only. A surface is therefore cut by straight rows, in the one of two directions that is closer to the steepest way, and by rings along
//! the outline only where it is steep: there a pass cuts by the side of the cutter.
//!
//! Rows come in rounds, each at half the spacing of the one before, and are driven only where the stock that is left is thicker than the
//! finishing step. Walls, and what no row has made good, are cut by rings of the step that leaves e at every place.
//! Rings and the first rows keep the sense of cut: those beside each other are cut in the order in which they are laid, others from the nearest on. A row of
//! a later round lies between two others and has stock on both sides: it is driven either way.

use std::f64::consts::FRAC_PI_2;

use rayon::prelude::*;

use crate::machining::EndMill;
use crate::machining::moves::Kind;
use crate::machining::part::Part;
use crate::machining::pass::{Height, TipPass, across_mm, refined};
use crate::machining::passes::Passes;
use crate::machining::raster::{CellRaster, NONE};
use crate::machining::sides::{ALLOWANCE_MM, STEP_SHARE, Sight};
use crate::machining::silhouette::{Loop, length_mm};
use crate::machining::stock::{Stock, Surfaces, TipPoint};

/// Share of the finishing step that rows and rings are laid for, and above which stock is cut again: cells tell thickness to a tenth of it.
const SHARE: f64 = 0.9;
/// Share of it above which rings were too far apart.
const TOO_FAR_APART: f64 = 1.05;
/// Distance of the first rows, in diameters: layers are thinner than an entry, so their width is not bounded.
const ROWS_APART: f64 = 0.8;
/// Rounds of rows in each direction.
const ROUNDS: usize = 3;
/// Rise over run up to which rows go over a surface: the cutter goes down it at no steeper angle.
const STEEP: f64 = 1.0;

/// Points along a straight line over the raster, mm.
type Row = Vec<[f64; 2]>;

/// The surface that a side shall leave over the part.
struct Surface {
    /// Where.
    cells: Vec<bool>,
    /// Lowest surface that the tip can leave, mm; `NONE` beside the part.
    target: Vec<f64>,
    /// Root of 1 + slope²: thickness along the cutter over thickness along the normal.
    steepness: Vec<f64>,
    /// Direction of the rows that may be farther apart: along u (0) or v (1); `None` where the surface is too steep for rows.
    way: Vec<Option<usize>>,
}

impl Surface {
    /// Its cells on which stock thicker than `thick_mm` is left along the normal.
    fn left(&self, stock: &Stock, thick_mm: f64) -> Vec<bool> {
        let Surfaces { top, other } = &stock.centres;
        let left = |cell: usize| {
            let thickness = top[cell] - self.target[cell].max(other[cell]);
            self.cells[cell] && thickness > thick_mm * self.steepness[cell]
        };
        (0..self.target.len()).map(left).collect()
    }
}

/// Where the tip may be: over the raster in general, and exactly.
struct Reach<'a> {
    raster: &'a CellRaster,
    /// Where the axis may be.
    domain: Vec<bool>,
    /// Lowest tip, mm.
    tip: Vec<f64>,
    /// Lowest tip, exact for the part, mm.
    height: Height<'a>,
}

impl Reach<'_> {
    fn may_be(&self, p: [f64; 2]) -> bool {
        self.raster.cell(p).is_some_and(|cell| self.domain[cell])
    }

    fn about_mm(&self, p: [f64; 2]) -> f64 {
        self.raster.highest_around(&self.tip, p)
    }

    fn exact_mm(&self, p: [f64; 2]) -> f64 {
        if self.may_be(p) { (self.height)(p) } else { f64::INFINITY }
    }
}

impl Sight<'_> {
    /// Passes that leave the finishing step on the cells that count, nowhere below `floor`; along the `first` outlines before all others.
    pub fn surface(&self, part: &Part, passes: &mut Passes<'_>, floor: &[f64], first: &[Loop]) {
        let raster = &part.raster;
        let height = |p: [f64; 2]| self.drop.height_mm(p).max(raster.highest_around(floor, p));
        let reach = Reach {
            raster,
            domain: self.domain(part, &part.outside_mm, self.beside_mm()),
            tip: self.tip_above(floor),
            height: &height,
        };
        let surface = self.surface_to_leave(&reach, passes.counts.clone());
        passes.look_beyond(self.laid_for_mm());
        self.cut_rings(first, &reach, passes, |_| true);
        self.cut_gentle(&surface, &reach, passes);
        self.cut_steep(&surface, part, &reach, passes);
    }

    /// Rows in both directions, closer and closer where stock is left.
    fn cut_gentle(&self, surface: &Surface, reach: &Reach<'_>, passes: &mut Passes<'_>) {
        for round in 0..ROUNDS {
            for along in [0, 1] {
                let left = surface.left(&passes.stock, self.laid_for_mm());
                let of_way = left.into_iter().zip(&surface.way);
                passes.counts = of_way.map(|(left, way)| left && *way == Some(along)).collect();
                let rows = rows(reach.raster, along, self.rows_apart_mm(), round);
                self.cut_rows(&rows, round == 0, reach, passes);
            }
        }
    }

    /// Rings up the walls, then where rows and walls have left stock.
    fn cut_steep(&self, surface: &Surface, part: &Part, reach: &Reach<'_>, passes: &mut Passes<'_>) {
        let raster = reach.raster;
        let slopes = slopes(raster, &reach.tip);
        // the least step around a cell, since a ring may lie anywhere between centres
        let steps_mm = raster.narrowed(&self.steps_mm(&slopes));
        let rings = self.rings(part, reach, &steps_mm);
        let steepest = raster.widened(&slopes.iter().map(|[u, v]| u.hypot(*v)).collect::<Vec<_>>());
        let on_wall = |p: [f64; 2]| raster.cell(p).is_some_and(|cell| steepest[cell] > STEEP);
        let left = |passes: &Passes<'_>, share: f64| {
            surface.left(&passes.stock, share * self.job.process.finishing_step_mm)
        };
        // of a wall's thickness a raster says too little: all of its rings are driven
        let steep = surface.cells.iter().zip(&surface.way).map(|(counts, way)| *counts && way.is_none());
        passes.counts =
            left(passes, SHARE).into_iter().zip(steep).map(|(left, steep)| left || steep).collect();
        self.cut_rings(&rings, reach, passes, on_wall);
        passes.counts = left(passes, SHARE);
        self.cut_rings(&rings, reach, passes, |p| !on_wall(p));
        // a raster says where rings lie to a share of a cell: where two are too far apart, there are others between
        let outermost = part.outermost(self.facing);
        passes.counts = left(passes, TOO_FAR_APART)
            .into_iter()
            .zip(outermost)
            .map(|(left, outer)| left && !outer)
            .collect();
        if passes.counts.contains(&true) {
            let between: Vec<f64> = steps_mm.iter().map(|step| 0.5 * step).collect();
            passes.look_beyond(0.5 * self.laid_for_mm());
            self.cut_rings(&self.rings(part, reach, &between), reach, passes, |_| true);
        }
    }

    /// Rings of the given steps.
    fn rings(&self, part: &Part, reach: &Reach<'_>, steps_mm: &[f64]) -> Vec<Loop> {
        let mut rings = self.loops(part, &reach.domain, (&part.outside_mm, self.beside_mm()), steps_mm);
        // around a peak, the rings outside cover what is within the cutter's radius
        rings.retain(|ring| length_mm(ring) > self.job.tool.radius_mm);
        rings
    }

    /// What the tip can leave of the surface, and how it lies.
    fn surface_to_leave(&self, reach: &Reach<'_>, cells: Vec<bool>) -> Surface {
        let reached = reach.raster.eroded(&reach.tip, &self.job.tool);
        let over = |(h, reached): (&f64, f64)| if *h > NONE { h.max(reached) } else { NONE };
        let target: Vec<f64> = self.heights.iter().zip(reached).map(over).collect();
        let slopes = slopes(reach.raster, &target);
        let most_mm = self.rows_apart_mm();
        // a wall within the radius lifts the tip: its foot is cut on the way down, by rings
        let most_lift_mm = STEEP * self.job.tool.radius_mm;
        let way = |((w, tip), [along_u, along_v]): ((&f64, &f64), &[f64; 2])| {
            let apart_mm =
                [(*along_u, *along_v), (*along_v, *along_u)].map(|(a, b)| self.apart_mm(a, b).min(most_mm));
            let gentle = *w > NONE && along_u.hypot(*along_v) <= STEEP && tip - w <= most_lift_mm;
            gentle.then_some(usize::from(apart_mm[1] > apart_mm[0]))
        };
        Surface {
            cells,
            way: target.iter().zip(&reach.tip).zip(&slopes).map(way).collect(),
            steepness: slopes.iter().map(|[u, v]| (1.0 + u * u + v * v).sqrt()).collect(),
            target,
        }
    }

    /// Rings where they are needed, of the places that `over` tells.
    fn cut_rings(
        &self,
        rings: &[Loop],
        reach: &Reach<'_>,
        passes: &mut Passes<'_>,
        over: impl Fn([f64; 2]) -> bool + Sync,
    ) {
        let lay = |ring: &Loop| {
            // the raster's heights are enough to see what is needless
            let mut pass = TipPass::along(ring, 1.5 * reach.raster.pitch_mm, |p| reach.about_mm(p));
            let worth = |p: &TipPoint| over([p[0], p[1]]) && is_worth(passes, p);
            let driven = passes.driven(&pass, &pass.places.iter().map(worth).collect::<Vec<_>>());
            pass.places.par_iter_mut().zip(&driven).for_each(|(p, driven)| {
                p[2] = if *driven { (reach.height)([p[0], p[1]]) } else { f64::INFINITY };
            });
            let closed = !driven.contains(&false);
            let runs = if closed { vec![pass.places] } else { pass.runs(&driven) };
            let laid = |places| self.sensed(refined(TipPass { places, closed }, reach.height));
            runs.into_iter().map(laid).collect::<Vec<TipPass>>()
        };
        let laid = rings.par_iter().flat_map_iter(lay).collect();
        for pass in &nearest_first(laid, passes.place(), self.job.tool.diameter_mm()) {
            passes.cut(pass, reach.height, Kind::Finish);
        }
    }

    /// The needed stretches of some rows, each the nearest to the one before; `sensed`: those beside each other in their order.
    fn cut_rows(&self, rows: &[Row], sensed: bool, reach: &Reach<'_>, passes: &mut Passes<'_>) {
        let exact = |p: [f64; 2]| reach.exact_mm(p);
        let lay = |row: &Row| {
            let about = |p: &[f64; 2]| {
                [p[0], p[1], if reach.may_be(*p) { reach.about_mm(*p) } else { f64::INFINITY }]
            };
            let about = TipPass { places: row.iter().map(about).collect(), closed: false };
            let needed: Vec<bool> = about.places.iter().map(|p| is_worth(passes, p)).collect();
            let stretch = |places: Vec<TipPoint>| {
                let places = places.iter().map(|p| [p[0], p[1], exact([p[0], p[1]])]).collect();
                self.sensed(refined(TipPass { places, closed: false }, reach.height))
            };
            about.runs(&passes.driven(&about, &needed)).into_iter().map(stretch).collect::<Vec<TipPass>>()
        };
        let laid = rows.par_iter().flat_map_iter(lay).collect();
        let beside_mm = if sensed { self.job.tool.diameter_mm() } else { 0.0 };
        for pass in &nearest_first(laid, passes.place(), beside_mm) {
            passes.cut(pass, &exact, Kind::Finish);
        }
    }

    /// The thickness that rows and rings are laid for, mm.
    fn laid_for_mm(&self) -> f64 {
        SHARE * self.job.process.finishing_step_mm
    }

    /// Distance of the first rows, mm.
    fn rows_apart_mm(&self) -> f64 {
        self.apart_mm(0.0, 0.0).min(ROWS_APART * self.job.tool.diameter_mm())
    }

    fn apart_mm(&self, along: f64, across: f64) -> f64 {
        apart_mm(&self.job.tool, self.laid_for_mm(), along, across)
    }

    /// The step of rings that leaves the finishing step along the normal where the tip's lowest place rises as given: they are rows along
    /// contour lines.
    fn steps_mm(&self, slope_of_tip: &[[f64; 2]]) -> Vec<f64> {
        let tool = &self.job.tool;
        let e = self.laid_for_mm();
        // two passes beside a ridge leave nothing between them
        let most = STEP_SHARE * self.job.widest_mm().min(tool.radius_mm);
        slope_of_tip.iter().map(|[u, v]| apart_mm(tool, e, 0.0, u.hypot(*v)).min(most)).collect()
    }
}

/// How far rows may be apart that leave at most `step_mm` along the normal of a plane that rises by `along` along and by `across` across them, mm.
///
/// A flat end leaves stairs of s sin θ along a contour line, a corner of radius r_c scallops that are cos θ √(8 e r_c) apart; the better of both counts.
pub(crate) fn apart_mm(tool: &EndMill, step_mm: f64, along: f64, across: f64) -> f64 {
    let flat = tool.radius_mm - tool.corner_radius_mm;
    let tangent = along.hypot(across);
    let cosine = 1.0 / (1.0 + tangent * tangent).sqrt();
    let phi = across.abs().atan2(along.abs());
    let turn = (1.0 - step_mm / (flat * tangent * cosine).max(1e-9)).clamp(-1.0, 1.0).acos();
    let rows = flat * ((phi + turn).min(FRAC_PI_2).sin() - (phi - turn).max(-FRAC_PI_2).sin());
    rows.max(cosine * (8.0 * step_mm * tool.corner_radius_mm).sqrt())
}

/// Rise over run along u and v, the steeper of both ways, over the finite heights of a map.
fn slopes(raster: &CellRaster, map: &[f64]) -> Vec<[f64; 2]> {
    let [nu, nv] = raster.dims;
    let slope = |cell: usize| {
        let (i, j) = (cell % nu, cell / nu);
        let steeper = |others: [Option<usize>; 2]| {
            let rises = others.into_iter().flatten().map(|other| (map[other] - map[cell]).abs());
            rises.filter(|rise| rise.is_finite()).fold(0.0, f64::max) / raster.pitch_mm
        };
        [
            steeper([(i > 0).then(|| cell - 1), (i + 1 < nu).then(|| cell + 1)]),
            steeper([(j > 0).then(|| cell - nu), (j + 1 < nv).then(|| cell + nu)]),
        ]
    };
    (0..raster.len()).map(slope).collect()
}

/// Straight rows of a round over a raster along u (0) or v (1): `apart_mm` apart in the first round, half-way between those before in the next.
///
/// From the middle outwards, on one side there and on the other back: all in one sense of cut, with short ways between them.
fn rows(raster: &CellRaster, along: usize, apart_mm: f64, round: usize) -> Vec<Row> {
    let across = 1 - along;
    let (start, end) = (raster.origin_mm, raster.centre(raster.dims[0] - 1, raster.dims[1] - 1));
    let apart_mm = apart_mm / 2f64.powi(round as i32);
    let step = 1.5 * raster.pitch_mm;
    let places = ((end[along] - start[along]) / step) as usize;
    let row = |n: usize| {
        let at = |k: usize| {
            let mut p = start;
            p[along] += k as f64 * step;
            p[across] += n as f64 * apart_mm;
            p
        };
        (0..=places).map(at).collect::<Row>()
    };
    let new = |n: &usize| round == 0 || n % 2 == 1;
    let count = ((end[across] - start[across]) / apart_mm) as usize;
    let middle = count / 2;
    let mut numbers: Vec<usize> = (0..=count).filter(new).collect();
    // the middle first, then one on either side
    numbers.sort_by_key(|n| (n.abs_diff(middle), *n));
    // along u the stock is on the right of rows to +u at the lower v, along v of those to +v at the higher u
    let is_back = |n: usize| (n > middle) == (along == 0);
    let sensed = |n: usize| if is_back(n) { row(n).into_iter().rev().collect() } else { row(n) };
    numbers.into_iter().map(sensed).collect()
}

/// Whether a place, lower by the allowance, takes anything that counts: a superset of what is needed at exact heights.
fn is_worth(passes: &Passes<'_>, p: &TipPoint) -> bool {
    let deeper = [p[0], p[1], p[2] - ALLOWANCE_MM];
    p[2].is_finite() && passes.stock.meets(deeper, passes.stock.pitch_mm(), &passes.counts)
}

/// Passes, each the nearest to the end of the one before, but after all earlier ones that are nearer to it than `beside_mm`, told to half of it.
///
/// 0: after none of them, and driven from either end, since they have stock on both sides.
fn nearest_first(passes: Vec<TipPass>, at: Option<TipPoint>, beside_mm: f64) -> Vec<TipPass> {
    let some: Vec<Vec<TipPoint>> = passes.par_iter().map(|pass| pass.sparse(0.5 * beside_mm)).collect();
    let are_beside =
        |m: usize, n: usize| some[m].iter().any(|a| some[n].iter().any(|b| across_mm(a, b) < beside_mm));
    let waits_for = |n: usize| (0..n).filter(|m| beside_mm > 0.0 && are_beside(*m, n)).collect();
    let mut waits: Vec<Vec<usize>> = (0..passes.len()).into_par_iter().map(waits_for).collect();
    let mut left: Vec<Option<TipPass>> = passes.into_iter().map(Some).collect();
    let mut ordered = Vec::with_capacity(left.len());
    let mut at = at.unwrap_or_default();
    let either_way = beside_mm == 0.0;
    loop {
        let free = left.iter().enumerate().filter(|(n, _)| waits[*n].is_empty());
        let ways = free.filter_map(|(n, pass)| Some((n, pass.as_ref()?))).flat_map(|(n, pass)| {
            let back = either_way.then(|| pass.places.last()).flatten();
            let back = back.map(|end| (n, across_mm(end, &at), true));
            [(n, pass.distance_mm(at), false)].into_iter().chain(back)
        });
        let nearest = ways.min_by(|a, b| a.1.total_cmp(&b.1));
        let Some((next, _, back)) = nearest else { return ordered };
        waits.iter_mut().for_each(|waits| waits.retain(|n| *n != next));
        ordered.extend(left[next].take().map(|pass| if back { pass.reversed() } else { pass }));
        at = ordered.last().and_then(TipPass::end).unwrap_or(at);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Greatest thickness along the normal that flat rows `apart_mm` apart leave on a plane: brute force over the ends' discs.
    fn left_mm(tool: &EndMill, apart_mm: f64, along: f64, across: f64) -> f64 {
        let (radius, tangent) = (tool.radius_mm, along.hypot(across));
        // over a point at 0 along and y across from a row's axis
        let over = |y: f64| {
            let reach = (radius * radius - y * y).sqrt();
            let tip = |t: f64| along * t + radius * tangent;
            tip(-reach).min(tip(reach)) - across * y
        };
        let rows =
            |y: f64| (-40..=40).map(move |n| y + apart_mm * f64::from(n)).filter(|y| y.abs() <= radius);
        let left = |k: i32| rows(apart_mm * f64::from(k) / 2000.0).map(over).fold(f64::INFINITY, f64::min);
        (0..2000).map(left).fold(0.0, f64::max) / (1.0 + tangent * tangent).sqrt()
    }

    #[test]
    fn rows_leave_what_they_are_laid_for() {
        let tool =
            EndMill { radius_mm: 1.6, corner_radius_mm: 0.0, flutes: 1, length_mm: 20.0, holder: vec![] };
        for (along, across) in [(0.3, 0.0), (0.5, 0.2), (-0.4, 0.4), (0.2, -0.6), (0.0, 0.5), (0.9, 0.3)] {
            let apart = apart_mm(&tool, 0.08, along, across);
            let left = left_mm(&tool, apart, along, across);
            assert!((left - 0.08).abs() < 0.002, "({along}, {across}): {left} mm at {apart} mm");
        }
        // along a contour line: stairs of s sin θ
        assert!((apart_mm(&tool, 0.08, 0.0, 0.75) - 0.08 / 0.6).abs() < 1e-9);
        // a plane across the cutter: as wide as the cutter
        assert!((apart_mm(&tool, 0.08, 0.0, 0.0) - 3.2).abs() < 1e-9);
    }

    #[test]
    fn passes_beside_each_other_keep_their_order_and_the_nearest_of_the_others_is_next() {
        // arcs of rings on the left and on the right: ring 0 left and right, ring 1 left and right, …
        let arc = |n: usize| {
            let u = if n.is_multiple_of(2) { -20.0 } else { 20.0 };
            let places = (0..=4).map(|k| [u + 0.1 * (n / 2) as f64, f64::from(k), 0.0]);
            TipPass { places: places.collect(), closed: false }
        };
        let order = |beside_mm: f64, at: TipPoint| {
            let ordered = nearest_first((0..6).map(arc).collect(), Some(at), beside_mm);
            let number = |pass: &TipPass| (0..6).position(|n| arc(n).places == pass.places);
            let back = |pass: &TipPass| number(&pass.clone().reversed()).map(|n| n + 100);
            ordered.iter().map(|pass| number(pass).or_else(|| back(pass)).unwrap()).collect::<Vec<_>>()
        };
        assert_eq!(order(3.0, [21.0, 0.0, 0.0]), [1, 3, 5, 0, 2, 4]);
        // with nothing to wait for, the innermost may be first, and every second is driven back
        assert_eq!(order(0.0, [21.0, 0.0, 0.0]), [5, 103, 1, 104, 2, 100]);
    }

    #[test]
    fn rows_are_climb_and_later_rounds_lie_between() {
        let raster = CellRaster::over(-5.0, 5.0, 5.0, 0.1).unwrap();
        for along in [0, 1] {
            let first = rows(&raster, along, 1.0, 0);
            let second = rows(&raster, along, 1.0, 1);
            let across = |row: &Row| row[0][1 - along];
            // each row has those after it on its right or has been passed on its left
            let forward = |row: &Row| row[row.len() - 1][along] > row[0][along];
            for rows in [&first, &second] {
                for (a, b) in rows.iter().zip(rows.iter().skip(2)).filter(|(a, b)| forward(a) == forward(b)) {
                    let to_right = if along == 0 { across(a) - across(b) } else { across(b) - across(a) };
                    assert!(to_right * if forward(a) { 1.0 } else { -1.0 } > 0.0);
                }
            }
            for row in &second {
                let nearest =
                    first.iter().map(|other| (across(other) - across(row)).abs()).fold(9.0, f64::min);
                assert!((nearest - 0.5).abs() < 1e-9, "{nearest}");
            }
        }
    }
}
