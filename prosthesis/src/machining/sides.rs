//! What is cut from a side: levels, finishing passes, the contour and the rim.
//!
//! A [`Sight`] holds one side's maps of where the tip may be.

use crate::machining::dropcutter::DropCutter;
use crate::machining::envelope::Facet;
use crate::machining::job::MachiningJob;
use crate::machining::leftover::{self, Leftover, Reason};
use crate::machining::moves::{Facing, Kind};
use crate::machining::part::Part;
use crate::machining::pass::{TipPass, refined};
use crate::machining::passes::{Passes, Sliver};
use crate::machining::raster::NONE;
use crate::machining::rings::{Field, iso_loops};
use crate::machining::silhouette::Loop;
use bonemill_case::prosthesis::CutSense;

/// Stock that roughing leaves on the part, mm.
pub(crate) const ALLOWANCE_MM: f64 = 0.1;
/// What roughing leaves to finishing: its thickness in entries' depths, its width in diameters.
const SLIVER_DEPTH: f64 = 0.6;
const SLIVER_WIDTH: f64 = 0.1;
/// Distance of passes around the part from touching it, mm.
const BESIDE_MM: f64 = 0.005;
/// Share of the widest cut that passes are laid at, so that bends, and cells, stay below it.
pub(crate) const STEP_SHARE: f64 = 0.82;
/// One side's maps of where the tip may be.
pub(crate) struct Sight<'a> {
    pub job: &'a MachiningJob,
    pub facing: Facing,
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
    pub fn new(part: &Part, job: &'a MachiningJob, facets: &[Facet], facing: Facing) -> Self {
        let heights = part.envelope.heights(&part.raster, facing);
        let top = facing.from_block(&job.block.high_mm).z.max(facing.from_block(&job.block.low_mm).z);
        Self {
            job,
            facing,
            drop: DropCutter::new(facets, &job.tool),
            tip: part.raster.dilated(&heights, &job.tool, 0.0),
            strip_tip: part.raster.dilated(&part.strip_body(facing, false), &job.tool, 0.0),
            heights,
            deepest_mm: top - job.tool.reach_mm(),
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

    /// Holes, then levels down to the strip. What is thinner or narrower than a [`Sliver`] is left to finishing.
    fn rough(&self, part: &Part, passes: &mut Passes<'_>) {
        let (raster, job) = (&part.raster, self.job);
        let grown = 0.75 * raster.pitch_mm + ALLOWANCE_MM;
        let mut tip = raster.dilated(&self.heights, &job.tool, grown);
        for (tip, strip) in tip.iter_mut().zip(&self.strip_tip) {
            *tip = (*tip + ALLOWANCE_MM).max(*strip).max(self.deepest_mm);
        }
        let beside = job.tool.radius_mm + ALLOWANCE_MM;
        let domain = self.domain(part, &part.milled_mm, beside);
        let loops = self.loops(
            part,
            &domain,
            (&part.milled_mm, beside),
            &raster.filled(STEP_SHARE * job.widest_mm()),
        );
        let top = passes.stock.centres.top.iter().copied().fold(NONE, f64::max);
        let lowest =
            tip.iter().zip(&domain).filter(|(_, inside)| **inside).map(|(w, _)| *w).fold(top, f64::min);
        let free = |p: [f64; 2]| {
            let inside = raster.cell(p).is_some_and(|cell| domain[cell]);
            if inside { raster.highest_around(&tip, p) } else { f64::INFINITY }
        };
        // beside the part the raster's heights are those of its edge
        let floor = |p: [f64; 2]| raster.highest_around(&self.strip_tip, p).max(self.deepest_mm);
        let beside_part = |p: [f64; 2]| (self.drop.height_mm(p) + ALLOWANCE_MM).max(floor(p));
        let wall = raster.widened(&tip);
        let lay = |outline: &Loop| self.sensed(TipPass::along(outline, 1.5 * raster.pitch_mm, beside_part));
        let channel = |passes: &mut Passes<'_>, around: &[TipPass], level: f64| {
            let height = |p: [f64; 2]| beside_part(p).max(level);
            around.iter().for_each(|pass| passes.cut(&pass.above(level), &height, Kind::Rough));
        };
        let layer = |passes: &mut Passes<'_>, outwards: bool, level: f64| {
            let height = |p: [f64; 2]| free(p).max(level);
            let along = |outline: &Loop| TipPass::along(outline, 1.5 * raster.pitch_mm, height);
            let walls = iso_loops(raster, &wall, level + 1e-6);
            let mut rings: Vec<TipPass> = loops.iter().map(along).collect();
            if outwards {
                rings = rings.into_iter().rev().map(TipPass::reversed).collect();
            }
            for pass in rings.into_iter().chain(walls.iter().map(along)) {
                passes.cut(&self.sensed(pass), &height, Kind::Rough);
            }
        };
        let outlines = part.around(beside, self.facing);
        let (holes, outer): (Vec<&Loop>, Vec<&Loop>) =
            outlines.iter().partition(|outline| part.is_in_hole(outline, self.facing));
        let [holes, outer]: [Vec<TipPass>; 2] =
            [holes, outer].map(|outlines| outlines.into_iter().map(lay).collect());
        // what stands in a hole hangs on its wall to the end, else it comes loose once the other side is cut: from the inside outwards. It is cut no
        // deeper than at full width, since in the hole's corners stock stands ahead of the cutter and beside it
        let all = std::mem::replace(&mut passes.counts, part.holes(self.facing));
        for level in levels(top, lowest, passes.entry_mm()).take_while(|_| !holes.is_empty()) {
            layer(passes, true, level);
            channel(passes, &holes, level);
        }
        passes.counts = all;
        passes.left_alone = Some(Sliver {
            thinner_mm: SLIVER_DEPTH * job.entry_mm(),
            narrower_mm: SLIVER_WIDTH * job.tool.diameter_mm(),
        });
        // the channel around the part is a slot
        for level in levels(top, lowest, passes.entry_mm()) {
            channel(passes, &outer, level);
        }
        for level in levels(top, lowest, job.level_mm()) {
            layer(passes, false, level);
        }
        passes.left_alone = None;
        // finishing does not come to loose stock: no sliver of it stays
        self.cut_loose(part, passes, |passes| {
            levels(top, lowest, job.level_mm()).for_each(|level| layer(passes, false, level));
        });
    }

    /// Lays passes that cut loose stock, if there is any, and that whole.
    fn cut_loose(&self, part: &Part, passes: &mut Passes<'_>, lay: impl FnOnce(&mut Passes<'_>)) {
        if part.loose.contains(&true) {
            let all = std::mem::replace(&mut passes.counts, part.seen(&part.loose, self.facing));
            passes.wholly = true;
            lay(passes);
            passes.wholly = false;
            passes.counts = all;
        }
    }

    fn finish(&self, part: &Part, passes: &mut Passes<'_>) {
        let near = |cell: usize| part.outside_mm[cell] < 3.0 * part.raster.pitch_mm;
        passes.counts = part.seen(&(0..part.raster.len()).map(near).collect::<Vec<_>>(), self.facing);
        let floor: Vec<f64> = self.strip_tip.iter().map(|w| w.max(self.deepest_mm)).collect();
        self.surface(part, passes, &floor, &part.around(self.beside_mm(), self.facing));
    }

    /// Cuts the strip along the outline, but not the tab; before that, from the outside inwards, what of it carries loose stock.
    pub fn contour(&self, part: &Part, passes: &mut Passes<'_>) {
        let (raster, job) = (&part.raster, self.job);
        let floor = part.rim_floor(self.facing, job.tool.corner_radius_mm);
        let tab = raster.dilated(&part.strip_body(self.facing, true), &job.tool, 0.0);
        let height = |p: [f64; 2]| {
            let lowest = raster.highest_around(&floor, p).max(raster.highest_around(&tab, p));
            lowest.max(self.drop.height_mm(p)).max(self.deepest_mm)
        };
        let around = |passes: &mut Passes<'_>, beside_mm: f64| {
            let outlines = part.around(beside_mm, self.facing);
            // around holes there is no strip
            for outline in outlines.iter().filter(|outline| !part.is_in_hole(outline, self.facing)) {
                let pass = TipPass::along(outline, 1.5 * raster.pitch_mm, height);
                passes.cut(&self.sensed(refined(pass, height)), &height, Kind::Contour);
            }
        };
        let loose = part.loose.iter().zip(&part.outside_mm).filter(|(loose, _)| **loose);
        let farthest_mm = loose.map(|(_, outside_mm)| outside_mm + raster.pitch_mm).fold(0.0, f64::max);
        let step_mm = STEP_SHARE * job.widest_mm();
        let rings =
            ((farthest_mm - job.tool.radius_mm - self.beside_mm()) / step_mm).ceil().max(0.0) as usize;
        self.cut_loose(part, passes, |passes| {
            (1..=rings).rev().for_each(|ring| around(passes, self.beside_mm() + ring as f64 * step_mm));
        });
        around(passes, self.beside_mm());
    }

    /// Finishes what the strip had covered.
    pub fn rim(&self, part: &Part, passes: &mut Passes<'_>) {
        let (raster, tool) = (&part.raster, &self.job.tool);
        let below = part.rim_floor(self.facing, tool.corner_radius_mm);
        let tab = raster.dilated(&part.strip_body(self.facing, true), tool, 0.0);
        let floor: Vec<f64> = below.iter().zip(&tab).map(|(a, b)| a.max(*b).max(self.deepest_mm)).collect();
        let before = raster.eroded(&self.tip_above(&self.strip_tip), tool);
        let after = raster.eroded(&self.tip_above(&floor), tool);
        // a slope narrower than a cell shows in no height: the outermost cells count all
        let edge = part.outermost(self.facing);
        let covered = |cell: usize| {
            let thick = before[cell] - after[cell].max(self.heights[cell]);
            self.heights[cell] > NONE && (edge[cell] || thick > 0.5 * self.job.process.finishing_step_mm)
        };
        passes.counts = (0..raster.len()).map(covered).collect();
        if passes.counts.contains(&true) {
            // the contour has been around
            self.surface(part, passes, &floor, &[]);
        }
    }

    /// Lowest tip over the part and nowhere below `floor`, mm.
    pub fn tip_above(&self, floor: &[f64]) -> Vec<f64> {
        self.tip.iter().zip(floor).map(|(a, b)| a.max(*b)).collect()
    }

    /// Where the axis may be: within `distance_mm` of what `outside_mm` is the distance from.
    pub fn domain(&self, part: &Part, outside_mm: &[f64], distance_mm: f64) -> Vec<bool> {
        let map: Vec<bool> = outside_mm.iter().map(|d| *d <= distance_mm).collect();
        part.seen(&map, self.facing)
    }

    /// Rings through a domain, from its edge at `beside_mm` on the map of distances inwards.
    pub fn loops(
        &self,
        part: &Part,
        domain: &[bool],
        (outside_mm, beside_mm): (&[f64], f64),
        step_mm: &[f64],
    ) -> Vec<Loop> {
        let inward: Vec<f64> = outside_mm.iter().map(|d| beside_mm - d).collect();
        let field = Field::march(&part.raster, domain, &part.seen(&inward, self.facing), step_mm);
        field.loops().into_iter().map(|(_, outline)| outline).collect()
    }

    /// Distance of passes around the part from its outline, mm.
    pub fn beside_mm(&self) -> f64 {
        self.job.tool.radius_mm + BESIDE_MM
    }

    /// In the sense of the case: passes are laid for climb.
    pub fn sensed(&self, pass: TipPass) -> TipPass {
        if self.job.process.sense == CutSense::Climb { pass } else { pass.reversed() }
    }
}

/// Heights from below `top` to `lowest`, evenly, at most `most_mm` apart.
fn levels(top: f64, lowest: f64, most_mm: f64) -> impl Iterator<Item = f64> {
    let count = ((top - lowest) / most_mm - 1e-9).ceil().max(0.0) as usize;
    (1..=count).map(move |n| top - (top - lowest) * n as f64 / count as f64)
}
