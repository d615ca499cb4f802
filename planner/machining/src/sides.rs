//! What is cut from a side: levels, finishing passes, the contour and the rim.
//!
//! A [`Sight`] holds one side's maps of where the tip may be.

use rayon::prelude::*;

use crate::dropcutter::DropCutter;
use crate::envelope::Facet;
use crate::job::Job;
use crate::leftover::{self, Leftover, Reason};
use crate::moves::{Facing, Kind};
use crate::part::{Part, THROUGH_MM};
use crate::pass::{Height, Pass, refined};
use crate::passes::Passes;
use crate::raster::{NONE, Raster};
use crate::rings::{Field, iso_loops};
use crate::silhouette::{Loop, area_mm2};

/// Stock that roughing leaves on the part, mm.
pub(crate) const ALLOWANCE_MM: f64 = 0.1;
/// Distance of passes around the part from touching it, mm.
const BESIDE_MM: f64 = 0.005;
/// Share of the widest cut that passes are laid at, so that bends stay below it.
const STEP_SHARE: f64 = 0.9;
/// Share of the finishing step that passes are laid for.
const SCALLOP_SHARE: f64 = 0.75;
/// One side's maps of where the tip may be.
pub(crate) struct Sight<'a> {
    pub job: &'a Job,
    facing: Facing,
    pub drop: DropCutter,
    /// Heights of the part, mm.
    pub heights: Vec<f64>,
    /// Lowest tip over the part, mm.
    tip: Vec<f64>,
    /// Lowest tip over the strip, mm.
    pub strip_tip: Vec<f64>,
    /// Lowest tip that the holder allows, mm.
    pub deepest_mm: f64,
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
                // around holes there is no strip
                if area_mm2(outline) > 0.0 {
                    continue;
                }
                let pass = self.sensed(refined(Pass::along(outline, 1.5 * raster.pitch_mm, height), height));
                passes.cut(&pass, &height, Kind::Contour);
            }
        }
    }

    /// Finishes what the strip had covered.
    pub fn rim(&self, part: &Part, passes: &mut Passes<'_>) {
        let (raster, tool) = (&part.raster, &self.job.tool);
        let below = part.rim_floor(self.facing, tool.corner_radius_mm);
        let tab = raster.dilated(&part.strip_body(self.facing, true), tool, 0.0);
        let floor: Vec<f64> = below.iter().zip(&tab).map(|(a, b)| a.max(*b).max(self.deepest_mm)).collect();
        let over = |other: &[f64]| self.tip.iter().zip(other).map(|(a, b)| a.max(*b)).collect::<Vec<f64>>();
        let before = raster.eroded(&over(&self.strip_tip), tool);
        let after = raster.eroded(&over(&floor), tool);
        // a slope narrower than a cell shows in no height: the outermost cells count all
        let edge: Vec<bool> = part.outside_mm.iter().map(|d| *d > -1.5 * raster.pitch_mm).collect();
        let edge = part.seen(&edge, self.facing);
        let covered = |cell: usize| {
            let thick = before[cell] - after[cell].max(self.heights[cell]);
            self.heights[cell] > NONE && (edge[cell] || thick > 0.5 * self.job.process.finishing_step_mm)
        };
        passes.counts = (0..raster.len()).map(covered).collect();
        if passes.counts.contains(&true) {
            self.surface(part, passes, &floor);
        }
    }

    /// Where the axis may be: within `distance_mm` of the part's outer outline or inside it.
    pub fn domain(&self, part: &Part, distance_mm: f64) -> Vec<bool> {
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
        // two passes beside a ridge leave nothing between them
        let most = STEP_SHARE * self.job.widest_mm().min(tool.radius_mm);
        let flat = 2.0 * (tool.radius_mm - tool.corner_radius_mm);
        let [nu, nv] = raster.dims;
        let step = |cell: usize| {
            let (i, j) = (cell % nu, cell / nu);
            // the steeper of both ways, so that an edge is not evened out
            let slope = |others: [Option<usize>; 2]| {
                let rises = others.into_iter().flatten().map(|other| (tip[other] - tip[cell]).abs());
                rises.filter(|rise| rise.is_finite()).fold(0.0, f64::max) / raster.pitch_mm
            };
            let along_u = slope([(i > 0).then(|| cell - 1), (i + 1 < nu).then(|| cell + 1)]);
            let along_v = slope([(j > 0).then(|| cell - nu), (j + 1 < nv).then(|| cell + nu)]);
            let tangent = along_u.hypot(along_v);
            let cosine = 1.0 / (1.0 + tangent * tangent).sqrt();
            let stairs = (e / (tangent * cosine).max(1e-9)).min(flat);
            let scallop = cosine * (8.0 * e * tool.corner_radius_mm).sqrt();
            stairs.max(scallop).min(most)
        };
        (0..raster.len()).map(step).collect()
    }

    /// In the sense of the case: passes are laid for climb.
    fn sensed(&self, pass: Pass) -> Pass {
        if self.job.process.climb { pass } else { pass.reversed() }
    }
}
