//! What is cut from a side: levels, finishing passes, the contour and the rim.
//!
//! [`Part`] is what both sides share; a [`Sight`] holds one side's maps of where the tip may be. Three bodies must not be cut: the part, always; the strip,
//! until the contour; the tab, ever.

use nalgebra::Vector3;
use rayon::prelude::*;

use crate::dropcutter::DropCutter;
use crate::envelope::{Envelope, Facet};
use crate::job::Job;
use crate::leftover::{self, Leftover, Reason};
use crate::moves::{Facing, Kind};
use crate::passes::{Height, Pass, Passes, refined};
use crate::raster::{NONE, Raster};
use crate::rings::{Field, iso_loops};
use crate::silhouette::{Loop, Nearest, Silhouette, area_mm2, sampled};
use crate::strip::{Strip, Tab, cutting_force_n};

/// Stock that roughing leaves on the part, mm.
const ALLOWANCE_MM: f64 = 0.1;
/// Distance of passes around the part from touching it, mm.
const BESIDE_MM: f64 = 0.005;
/// Share of the widest cut that passes are laid at, so that bends stay below it.
const STEP_SHARE: f64 = 0.9;
/// Share of the finishing step that passes are laid for.
const SCALLOP_SHARE: f64 = 0.8;
/// How far the contour goes beyond the strip, mm.
const THROUGH_MM: f64 = 0.1;

/// The part over a raster, with the strip around it; seen from the front.
pub(crate) struct Part {
    pub raster: Raster,
    pub envelope: Envelope,
    pub silhouette: Silhouette,
    pub strip: Strip,
    tab: Tab,
    nearest: Nearest,
    /// Distance to the outer outline, mm, below 0 inside; holes count as inside.
    outside_mm: Vec<f64>,
}

impl Part {
    pub fn with(raster: Raster, envelope: Envelope, silhouette: Silhouette, job: &Job) -> Self {
        let strip = Strip::along(&raster, &envelope, &silhouette, job.process.strip_mm);
        let nearest = Nearest::of(&raster, &strip.points);
        let outer = silhouette.loops().filter(|l| area_mm2(l) > 0.0);
        let outer: Vec<[f64; 2]> = outer.flat_map(|l| sampled(l, 0.5 * raster.pitch_mm)).collect();
        let mut outside_mm = Nearest::of(&raster, &outer).distance_mm;
        let open = reached_from_the_edge(&raster, |cell| !envelope.holds(cell));
        outside_mm.iter_mut().zip(&open).filter(|(_, open)| !**open).for_each(|(d, _)| *d = -*d);
        let tab = strip.tab(cutting_force_n(job), job.process.strip_mm);
        Self { raster, envelope, silhouette, strip, tab, nearest, outside_mm }
    }

    fn seen<T: Copy>(&self, map: &[T], facing: Facing) -> Vec<T> {
        if facing == Facing::Front { map.to_vec() } else { self.raster.turned(map) }
    }

    /// Outer outlines at a distance, clockwise as the side sees them.
    fn around(&self, distance_mm: f64, facing: Facing) -> Vec<Loop> {
        let mut loops = self.silhouette.offset(distance_mm);
        loops.retain(|l| area_mm2(l) > 0.0);
        for outline in &mut loops {
            match facing {
                Facing::Front => outline.reverse(),
                Facing::Back => outline.iter_mut().for_each(|p| p[1] = -p[1]),
            }
        }
        loops
    }

    /// The strip, or the tab alone, as a body that the side must not cut.
    fn strip_body(&self, facing: Facing, tab_only: bool) -> Vec<f64> {
        let mut body = self.strip.body(&self.raster, &self.envelope, &self.nearest, facing == Facing::Back);
        if tab_only {
            let tab =
                self.seen(&(0..self.raster.len()).map(|cell| self.is_tab(cell)).collect::<Vec<_>>(), facing);
            body.iter_mut().zip(tab).filter(|(_, tab)| !tab).for_each(|(w, _)| *w = NONE);
        }
        body
    }

    fn is_tab(&self, cell: usize) -> bool {
        let [u, v] = self.raster.centre_of(cell);
        v > 0.0
            && (u - self.tab.at[0]).abs() < 0.5 * self.tab.length_mm
            && v > self.tab.at[1] - 0.5 * self.tab.length_mm
    }

    /// The box around the tab and what the cutter leaves beside it, block's frame, mm.
    pub fn tab_box(&self, job: &Job) -> [Vector3<f64>; 2] {
        let beside = 0.5 * self.tab.length_mm + job.tool.diameter_mm();
        let (low, high) = (job.block.low_mm, job.block.high_mm);
        let z = -self.tab.at[1];
        [
            Vector3::new(self.tab.at[0] - beside, low.y, z - beside),
            Vector3::new(self.tab.at[0] + beside, high.y, z + 0.5 * self.tab.length_mm + job.tool.radius_mm),
        ]
    }

    /// Where the contour ends below: the other side of the strip and a little more, as the side sees it, mm.
    fn contour_floor(&self, facing: Facing, corner_mm: f64) -> Vec<f64> {
        let floor = |cell: usize| {
            let [low, high] =
                self.strip.heights.get(self.nearest.point[cell] as usize).copied().unwrap_or([0.0; 2]);
            let far = if facing == Facing::Front { low } else { -high };
            far - THROUGH_MM - 2.0 * corner_mm
        };
        self.seen(&(0..self.raster.len()).map(floor).collect::<Vec<_>>(), facing)
    }
}

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

/// One side's maps of where the tip may be.
pub(crate) struct Sight<'a> {
    job: &'a Job,
    facing: Facing,
    drop: DropCutter,
    /// Heights of the part, mm.
    heights: Vec<f64>,
    /// Lowest tip over the part, mm.
    tip: Vec<f64>,
    /// Lowest tip over the strip, mm.
    strip_tip: Vec<f64>,
    /// Lowest tip that the holder allows, mm.
    deepest_mm: f64,
}

impl<'a> Sight<'a> {
    pub fn new(part: &Part, job: &'a Job, facets: &[Facet], facing: Facing) -> Self {
        let heights = part.envelope.heights(&part.raster, facing);
        let top = facing.from_block(&job.block.high_mm).z.max(facing.from_block(&job.block.low_mm).z);
        let widest = job.tool.holder.iter().map(|h| h.radius_mm).fold(0.0, f64::max);
        Self {
            job,
            facing,
            drop: DropCutter::new(facets, &job.tool),
            tip: part.raster.dilated(&heights, &job.tool, 0.0),
            strip_tip: part.raster.dilated(&part.strip_body(facing, false), &job.tool, 0.0),
            heights,
            deepest_mm: if widest > job.tool.radius_mm { top - job.tool.length_mm + BESIDE_MM } else { NONE },
        }
    }

    /// Places where the part faces this side, but the cutter is too wide.
    pub fn too_narrow(&self, part: &Part) -> Vec<Leftover> {
        let reached = part.raster.eroded(&self.tip, &self.job.tool);
        let thickness: Vec<f64> =
            reached.iter().zip(&self.heights).map(|(r, h)| if *h > NONE { r - h } else { 0.0 }).collect();
        leftover::places(&part.raster, &thickness, &self.heights, self.facing, Reason::Narrow)
    }

    /// Places that the holder keeps the cutter from.
    pub fn too_deep(&self, part: &Part) -> Vec<Leftover> {
        let thickness: Vec<f64> = self
            .heights
            .iter()
            .map(|h| if *h > NONE { (self.deepest_mm - h).max(0.0) } else { 0.0 })
            .collect();
        leftover::places(&part.raster, &thickness, &self.heights, self.facing, Reason::Deep)
    }

    /// Levels down to the strip, then the surface.
    pub fn rough_and_finish(&self, part: &Part, passes: &mut Passes<'_>) {
        self.rough(part, passes);
        self.finish(part, passes);
    }

    fn rough(&self, part: &Part, passes: &mut Passes<'_>) {
        let (raster, job) = (&part.raster, self.job);
        let grown = 0.75 * raster.pitch_mm + ALLOWANCE_MM;
        let mut tip = raster.dilated(&self.heights, &job.tool, grown);
        for (tip, strip) in tip.iter_mut().zip(&self.strip_tip) {
            *tip = (*tip + ALLOWANCE_MM).max(*strip).max(self.deepest_mm);
        }
        // heights are read from the cells around, which must lie beside the part
        let beside = job.tool.radius_mm + grown + 1.5 * raster.pitch_mm;
        let domain = self.domain(part, beside);
        let loops = self.loops(part, &domain, beside, &raster.filled(STEP_SHARE * job.widest_mm()));
        let top = passes.stock.top.iter().copied().fold(NONE, f64::max);
        let lowest =
            tip.iter().zip(&domain).filter(|(_, inside)| **inside).map(|(w, _)| *w).fold(top, f64::min);
        let levels = ((top - lowest) / job.level_mm() - 1e-9).ceil().max(0.0) as usize;
        let depth = (top - lowest) / levels.max(1) as f64;
        let free = |p: [f64; 2]| {
            let inside = raster.cell(p).is_some_and(|cell| domain[cell]);
            if inside { raster.highest_around(&tip, p) } else { f64::INFINITY }
        };
        for level in (1..=levels).map(|n| top - n as f64 * depth) {
            let height = |p: [f64; 2]| free(p).max(level);
            // outlines lie on the domain's edge, where cells may count as outside
            let edge = |p: [f64; 2]| raster.highest_around(&tip, p).max(level);
            for outline in &part.around(beside, self.facing) {
                passes.cut(
                    &self.sensed(Pass::along(outline, 1.5 * raster.pitch_mm, edge)),
                    &edge,
                    Kind::Rough,
                );
            }
            for outline in loops.iter().chain(&iso_loops(raster, &tip, level + 1e-6)) {
                passes.cut(
                    &self.sensed(Pass::along(outline, 1.5 * raster.pitch_mm, height)),
                    &height,
                    Kind::Rough,
                );
            }
        }
    }

    fn finish(&self, part: &Part, passes: &mut Passes<'_>) {
        let near = |cell: usize| part.outside_mm[cell] < 3.0 * part.raster.pitch_mm;
        passes.counts = part.seen(&(0..part.raster.len()).map(near).collect::<Vec<_>>(), self.facing);
        let floor: Vec<f64> = self.strip_tip.iter().map(|w| w.max(self.deepest_mm)).collect();
        self.surface(part, passes, &floor);
    }

    /// Passes of the finishing step over the part, nowhere below `floor`.
    fn surface(&self, part: &Part, passes: &mut Passes<'_>, floor: &[f64]) {
        let raster = &part.raster;
        let tip: Vec<f64> = self.tip.iter().zip(floor).map(|(a, b)| a.max(*b)).collect();
        let beside = self.job.tool.radius_mm + BESIDE_MM;
        let domain = self.domain(part, beside);
        let mut loops = part.around(beside, self.facing);
        loops.extend(self.loops(part, &domain, beside, &self.steps_mm(raster, &tip)));
        let height = |p: [f64; 2]| self.drop.height_mm(p).max(raster.highest_around(floor, p));
        // the raster's heights are enough to see what is needless
        let worth = |outline: &Loop| {
            let rough = Pass::along(outline, 2.0 * raster.pitch_mm, |p| raster.highest_around(&tip, p));
            rough.places.iter().any(|p| {
                passes.stock.meets([p[0], p[1], p[2] - ALLOWANCE_MM], raster.pitch_mm, &passes.counts)
            })
        };
        let worth: Vec<bool> = loops.par_iter().map(worth).collect();
        let loops: Vec<&Loop> = loops.iter().zip(worth).filter(|(_, worth)| *worth).map(|(l, _)| l).collect();
        let lay = |outline: &&Loop| {
            self.sensed(refined(Pass::along(outline, 1.5 * raster.pitch_mm, height), height))
        };
        let laid: Vec<Pass> = loops.par_iter().map(lay).collect();
        passes.grown_mm = 0.75 * raster.pitch_mm;
        for pass in &laid {
            passes.cut(pass, &height as Height<'_>, Kind::Finish);
        }
    }

    /// Cuts the strip along the outline, but not the tab.
    pub fn contour(&self, part: &Part, passes: &mut Passes<'_>) {
        let (raster, job) = (&part.raster, self.job);
        let floor = part.contour_floor(self.facing, job.tool.corner_radius_mm);
        let tab = raster.dilated(&part.strip_body(self.facing, true), &job.tool, 0.0);
        let depth = job.process.strip_mm + THROUGH_MM + 2.0 * job.tool.corner_radius_mm;
        let entries = (depth / (job.entry_mm() + THROUGH_MM)).ceil().max(1.0) as usize;
        for entry in 1..=entries {
            let above = depth * (1.0 - entry as f64 / entries as f64);
            let height = |p: [f64; 2]| {
                let floor = raster.highest_around(&floor, p) + above;
                floor.max(raster.highest_around(&tab, p)).max(self.drop.height_mm(p)).max(self.deepest_mm)
            };
            for outline in &part.around(job.tool.radius_mm + BESIDE_MM, self.facing) {
                let pass = self.sensed(refined(Pass::along(outline, 1.5 * raster.pitch_mm, height), height));
                passes.cut(&pass, &height, Kind::Contour);
            }
        }
    }

    /// Finishes what the strip had covered.
    pub fn rim(&self, part: &Part, passes: &mut Passes<'_>) {
        let (raster, tool) = (&part.raster, &self.job.tool);
        let below = part.contour_floor(self.facing, tool.corner_radius_mm);
        let tab = raster.dilated(&part.strip_body(self.facing, true), tool, 0.0);
        let floor: Vec<f64> = below.iter().zip(&tab).map(|(a, b)| a.max(*b).max(self.deepest_mm)).collect();
        let over = |other: &[f64]| self.tip.iter().zip(other).map(|(a, b)| a.max(*b)).collect::<Vec<f64>>();
        let before = raster.eroded(&over(&self.strip_tip), tool);
        let after = raster.eroded(&over(&floor), tool);
        let covered = |cell: usize| {
            self.heights[cell] > NONE
                && before[cell] - after[cell].max(self.heights[cell])
                    > 0.5 * self.job.process.finishing_step_mm
        };
        passes.counts = (0..raster.len()).map(covered).collect();
        if passes.counts.contains(&true) {
            self.surface(part, passes, &floor);
        }
    }

    /// Where the axis may be: within `distance_mm` of the part's outer outline or inside it.
    fn domain(&self, part: &Part, distance_mm: f64) -> Vec<bool> {
        let map: Vec<bool> = part.outside_mm.iter().map(|d| *d <= distance_mm).collect();
        part.seen(&map, self.facing)
    }

    fn loops(&self, part: &Part, domain: &[bool], beside_mm: f64, step_mm: &[f64]) -> Vec<Loop> {
        let inward: Vec<f64> = part.outside_mm.iter().map(|d| beside_mm - d).collect();
        let field = Field::march(&part.raster, domain, &part.seen(&inward, self.facing), step_mm);
        field.loops().into_iter().map(|(_, outline)| outline).collect()
    }

    /// The step across the raster that leaves the finishing step e along the normal: where the tip rises at an angle θ, a flat end leaves stairs
    /// s sin θ, a rounded corner of radius r_c scallops with s = cos θ √(8 e r_c); the better of both, at most the widest cut.
    fn steps_mm(&self, raster: &Raster, tip: &[f64]) -> Vec<f64> {
        let tool = &self.job.tool;
        let e = SCALLOP_SHARE * self.job.process.finishing_step_mm;
        let most = STEP_SHARE * self.job.widest_mm();
        let flat = 2.0 * (tool.radius_mm - tool.corner_radius_mm);
        let [nu, nv] = raster.dims;
        let step = |cell: usize| {
            let (i, j) = (cell % nu, cell / nu);
            let slope = |low: usize, high: usize, apart: usize| {
                let rise = tip[high] - tip[low];
                if rise.is_finite() { rise.abs() / (apart.max(1) as f64 * raster.pitch_mm) } else { 0.0 }
            };
            let (left, right) = (i.saturating_sub(1), (i + 1).min(nu - 1));
            let (below, above) = (j.saturating_sub(1), (j + 1).min(nv - 1));
            let along_u = slope(left + nu * j, right + nu * j, right - left);
            let along_v = slope(i + nu * below, i + nu * above, above - below);
            let tangent = along_u.hypot(along_v);
            let cosine = 1.0 / (1.0 + tangent * tangent).sqrt();
            let stairs = (e / (tangent * cosine).max(1e-9)).min(flat);
            let scallop = cosine * (8.0 * e * tool.corner_radius_mm).sqrt();
            stairs.max(scallop).min(most)
        };
        (0..raster.len()).map(step).collect()
    }

    /// The published tool path of a side: planes of rows along x from edge to edge of the domain, there and back, then a last pass along every row
    /// on the surface.
    pub fn zigzag(&self, part: &Part, passes: &mut Passes<'_>, rows: &ZigZag) {
        let (raster, job) = (&part.raster, self.job);
        passes.bounded = false;
        let beside = job.tool.radius_mm + ALLOWANCE_MM;
        let domain = self.domain(part, beside);
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
        let mut level = passes.stock.top.iter().copied().fold(NONE, f64::max);
        while level > lowest {
            let step = if level - rows.plane_mm >= part_top { rows.plane_mm } else { rows.fine_plane_mm };
            level = (level - step).max(lowest);
            let at_level = |p: [f64; 2]| if height(p) <= level + 1e-9 { level } else { f64::INFINITY };
            for row in &surface {
                let place =
                    |p: &[f64; 3]| [p[0], p[1], if p[2] <= level + 1e-9 { level } else { f64::INFINITY }];
                passes.cut(
                    &Pass { places: row.places.iter().map(place).collect(), closed: false },
                    &at_level,
                    Kind::Rough,
                );
            }
        }
        passes.grown_mm = 0.75 * raster.pitch_mm;
        for row in &finest {
            passes.cut(row, &height, Kind::Finish);
        }
    }

    /// Rows along u over the raster, every other one backwards.
    fn rows(&self, raster: &Raster, apart_mm: f64, height: impl Fn([f64; 2]) -> f64 + Sync) -> Vec<Pass> {
        let [nu, nv] = raster.dims;
        let (start, end) = (raster.origin_mm, raster.centre(nu - 1, nv - 1));
        let count = ((end[1] - start[1]) / apart_mm).floor() as usize;
        let row = |n: usize| {
            let v = start[1] + n as f64 * apart_mm;
            let step = 1.5 * raster.pitch_mm;
            let places = (0..=((end[0] - start[0]) / step) as usize).map(|k| start[0] + k as f64 * step);
            let pass = Pass { places: places.map(|u| [u, v, height([u, v])]).collect(), closed: false };
            let pass = refined(pass, &height);
            if n % 2 == 0 { pass } else { pass.reversed() }
        };
        (0..=count).into_par_iter().map(row).collect()
    }

    /// In the sense of the case: passes are laid for climb.
    fn sensed(&self, pass: Pass) -> Pass {
        if self.job.process.climb { pass } else { pass.reversed() }
    }
}

/// Cells that are connected to the raster's edge through cells that are `open`.
fn reached_from_the_edge(raster: &Raster, open: impl Fn(usize) -> bool) -> Vec<bool> {
    let [nu, nv] = raster.dims;
    let mut reached = vec![false; raster.len()];
    let on_edge = |cell: usize| cell % nu == 0 || cell % nu == nu - 1 || cell < nu || cell >= nu * (nv - 1);
    let mut stack: Vec<usize> = (0..raster.len()).filter(|c| on_edge(*c)).collect();
    while let Some(cell) = stack.pop() {
        if !open(cell) || std::mem::replace(&mut reached[cell], true) {
            continue;
        }
        let (i, j) = (cell % nu, cell / nu);
        stack.extend((i > 0).then(|| cell - 1));
        stack.extend((i + 1 < nu).then(|| cell + 1));
        stack.extend((j > 0).then(|| cell - nu));
        stack.extend((j + 1 < nv).then(|| cell + nu));
    }
    reached
}
