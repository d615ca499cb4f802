//! What both sides share: the part over a raster, its outlines, the strip around it and the tab.
//!
//! Everything is kept as seen from the front; [`Part::seen`] turns a map for the back. Three bodies must not be cut: the part, always; the strip,
//! until the contour; the tab, ever. What the contour would cut off from the grip is milled away like the channel around the part, so that it does not come
//! loose under the cutter ([`Part::loose`]).

use std::collections::BTreeMap;

use nalgebra::Vector3;

use crate::machining::envelope::Envelope;
use crate::machining::job::MachiningJob;
use crate::machining::leftover::{self, Leftover, Reason};
use crate::machining::moves::Facing;
use crate::machining::raster::{CellRaster, NONE};
use crate::machining::reach::THROUGH_MM;
use crate::machining::silhouette::{Loop, NearestPoints, Silhouette, area_mm2, sampled};
use crate::machining::strip::{Strip, Tab, outline_force_n};

/// The part over a raster, with the strip around it; seen from the front.
pub(crate) struct Part {
    pub raster: CellRaster,
    pub envelope: Envelope,
    pub silhouette: Silhouette,
    pub strip: Strip,
    tab: Tab,
    nearest: NearestPoints,
    /// Distance to the outer outline, mm, below 0 inside; holes count as inside.
    pub outside_mm: Vec<f64>,
    /// Cells of the block that the contour would cut off from the grip.
    pub loose: Vec<bool>,
    /// Distance to part and loose cells, mm, below 0 inside the part's outer outline.
    pub milled_mm: Vec<f64>,
}

/// A place is out of reach by at least so many cells.
const BEYOND_CELLS: f64 = 0.05;
/// A frame beside the channel that is thinner than this holds nothing, mm. Assumed.
const HOLDS_MM: f64 = 0.5;

impl Part {
    pub fn with(raster: CellRaster, envelope: Envelope, silhouette: Silhouette, job: &MachiningJob) -> Self {
        let strip = Strip::along(&raster, &envelope, &silhouette, job.process.strip_mm);
        let nearest = NearestPoints::of(&raster, &strip.points);
        let outer = silhouette.loops().filter(|l| area_mm2(l) > 0.0);
        let outer: Vec<[f64; 2]> = outer.flat_map(|l| sampled(l, 0.5 * raster.pitch_mm)).collect();
        let mut outside_mm = NearestPoints::of(&raster, &outer).distance_mm;
        let open = reached_from_the_edge(&raster, |cell| !envelope.holds(cell));
        outside_mm.iter_mut().zip(&open).filter(|(_, open)| !**open).for_each(|(d, _)| *d = -*d);
        let tab = strip.tab(outline_force_n(job), job.process.strip_mm);
        let loose = loose(&raster, &outside_mm, job);
        let milled_mm = milled_mm(&raster, &outside_mm, &loose, job);
        Self { raster, envelope, silhouette, strip, tab, nearest, outside_mm, loose, milled_mm }
    }

    pub fn seen<T: Copy>(&self, map: &[T], facing: Facing) -> Vec<T> {
        if facing == Facing::Front { map.to_vec() } else { self.raster.turned(map) }
    }

    /// The outermost cells of the part and all beside it, as the side sees them: of their slope a raster says too little.
    pub fn outermost(&self, facing: Facing) -> Vec<bool> {
        let map: Vec<bool> = self.outside_mm.iter().map(|d| *d > -1.5 * self.raster.pitch_mm).collect();
        self.seen(&map, facing)
    }

    /// Outlines at a distance: clockwise as the side sees them, those in holes counter-clockwise, so that the part is on the right.
    pub fn around(&self, distance_mm: f64, facing: Facing) -> Vec<Loop> {
        let mut loops = self.silhouette.offset(distance_mm);
        for outline in &mut loops {
            match facing {
                Facing::Front => outline.reverse(),
                Facing::Back => outline.iter_mut().for_each(|p| p[1] = -p[1]),
            }
        }
        loops
    }

    /// Whether an outline, as a side sees it, lies in a hole of the part.
    pub fn is_in_hole(&self, outline: &Loop, facing: Facing) -> bool {
        let front = |[u, v]: [f64; 2]| if facing == Facing::Front { [u, v] } else { [u, -v] };
        let cell = outline.first().and_then(|p| self.raster.cell(front(*p)));
        cell.is_some_and(|cell| self.outside_mm[cell] < 0.0)
    }

    /// The cells of the part's holes, as a side sees them.
    pub fn holes(&self, facing: Facing) -> Vec<bool> {
        let is_hole = |cell: usize| self.outside_mm[cell] < 0.0 && !self.envelope.holds(cell);
        self.seen(&(0..self.raster.len()).map(is_hole).collect::<Vec<_>>(), facing)
    }

    /// The strip, or the tab alone, as a body that the side must not cut.
    pub fn strip_body(&self, facing: Facing, tab_only: bool) -> Vec<f64> {
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

    /// Boxes of the stock that the tab keeps on the part's outline, its own and what the cutter cannot take beside it; side by side along u,
    /// block's frame, mm. Stock that would stay without the tab as well does not count.
    pub fn tab_boxes(&self, job: &MachiningJob) -> Vec<[Vector3<f64>; 2]> {
        let (raster, radius_mm) = (&self.raster, job.tool.radius_mm);
        let tab: Vec<bool> =
            (0..raster.len()).map(|cell| self.is_tab(cell) && !self.envelope.holds(cell)).collect();
        let centres: Vec<_> = (0..raster.len()).filter(|n| tab[*n]).map(|n| raster.centre_of(n)).collect();
        let from_tab = NearestPoints::of(raster, &centres);
        let without = self.reached(job, |_| true);
        let beside = self.reached(job, |cell| from_tab.distance_mm[cell] >= radius_mm);
        let reach_mm = radius_mm + BEYOND_CELLS * raster.pitch_mm;
        let margin_mm = 2.0 * raster.pitch_mm;
        // outside the part on its outline; within it on a bevel
        let is_kept = |cell: &usize| {
            let is_beside = without.distance_mm[*cell] <= reach_mm && beside.distance_mm[*cell] > reach_mm;
            if self.envelope.holds(*cell) {
                from_tab.distance_mm[*cell] <= radius_mm
            } else {
                (tab[*cell] || is_beside) && self.nearest.distance_mm[*cell] <= margin_mm
            }
        };
        let mut boxes: BTreeMap<i64, [Vector3<f64>; 2]> = BTreeMap::new();
        for cell in (0..raster.len()).filter(is_kept) {
            let [u, v] = raster.centre_of(cell);
            let [low, high] =
                self.strip.heights.get(self.nearest.point[cell] as usize).copied().unwrap_or([0.0; 2]);
            let around = Vector3::new(margin_mm, margin_mm + job.tool.corner_radius_mm, margin_mm);
            let (low, high) = (Vector3::new(u, low, -v) - around, Vector3::new(u, high, -v) + around);
            let found = boxes.entry((u / (0.5 * radius_mm)).floor() as i64).or_insert([low, high]);
            *found = [found[0].inf(&low), found[1].sup(&high)];
        }
        boxes.into_values().collect()
    }

    /// The way from each cell to the nearest place of the axis at which the cutter touches an outline, or is kept from it by what is not `free`.
    fn reached(&self, job: &MachiningJob, free: impl Fn(usize) -> bool) -> NearestPoints {
        let (raster, radius_mm) = (&self.raster, job.tool.radius_mm);
        let is_free = |cell: usize| self.is_free(cell, radius_mm) && free(cell);
        let is_edge = |cell: &usize| {
            is_free(*cell) && raster.neighbours(*cell).into_iter().flatten().any(|next| !is_free(next))
        };
        // from the cell's centre toward the outline, to where the cutter touches it, unless something else keeps it from there
        let touching = |cell: usize| {
            let (at, outline) =
                (raster.centre_of(cell), self.strip.points[self.nearest.point[cell] as usize]);
            let share = 1.0 - radius_mm / self.nearest.distance_mm[cell];
            let share =
                if self.nearest.distance_mm[cell] < radius_mm + 2.0 * raster.pitch_mm { share } else { 0.0 };
            [0, 1].map(|n| at[n] + share * (outline[n] - at[n]))
        };
        let edge: Vec<[f64; 2]> = (0..raster.len()).filter(is_edge).map(touching).collect();
        NearestPoints::of(raster, &edge)
    }

    /// Whether the cutter's axis may stand in a cell, as far as the part is concerned.
    fn is_free(&self, cell: usize, radius_mm: f64) -> bool {
        !self.envelope.holds(cell) && self.nearest.distance_mm[cell] >= radius_mm
    }

    /// Stock beside the part's outlines that no place of the axis reaches: in corners that are sharper than the cutter is round.
    pub fn corners(&self, job: &MachiningJob) -> Vec<Leftover> {
        let (raster, radius_mm) = (&self.raster, job.tool.radius_mm);
        let reached = self.reached(job, |_| true);
        // a place counts where it is clearly out of reach, and then as far as it is at all: along an outline the touching places are a cell apart
        let [beyond_mm, clearly_mm] = [BEYOND_CELLS, 0.25].map(|cells| radius_mm + cells * raster.pitch_mm);
        let rim = |cell: usize| self.strip.rims.get(self.nearest.point[cell] as usize).copied();
        let is_left = |cell: usize| {
            !self.envelope.holds(cell)
                && !self.is_free(cell, radius_mm)
                && reached.distance_mm[cell] > beyond_mm
        };
        let mut seen = vec![false; raster.len()];
        let clear =
            (0..raster.len()).filter(|cell| is_left(*cell) && reached.distance_mm[*cell] > clearly_mm);
        raster.connected(clear.collect(), &mut seen, is_left);
        let left: Vec<Option<[f64; 2]>> =
            (0..raster.len()).map(|cell| rim(cell).filter(|_| seen[cell])).collect();
        let thickness: Vec<f64> = left.iter().map(|rim| rim.map_or(0.0, |[low, high]| high - low)).collect();
        let middle: Vec<f64> =
            left.iter().map(|rim| rim.map_or(0.0, |[low, high]| 0.5 * (low + high))).collect();
        leftover::places(raster, &thickness, &middle, Facing::Front, Reason::Corner)
    }

    /// Where contour and finishing of the rim end below, as the side sees it, mm: the other side of the strip or of the rim, whichever is lower, and a
    /// little more, carried from the outline over the raster.
    pub fn rim_floor(&self, facing: Facing, corner_mm: f64) -> Vec<f64> {
        let ends = [&self.strip.heights, &self.strip.rims];
        let floor = |cell: usize| {
            let at = self.nearest.point[cell] as usize;
            let far = ends.iter().filter_map(|ends| ends.get(at)).map(|[low, high]| match facing {
                Facing::Front => *low,
                Facing::Back => -high,
            });
            far.fold(f64::INFINITY, f64::min) - THROUGH_MM - 2.0 * corner_mm
        };
        self.seen(&(0..self.raster.len()).map(floor).collect::<Vec<_>>(), facing)
    }
}

/// Cells of the block, seen from the front, that no frame beside the channel connects to the grip.
fn loose(raster: &CellRaster, outside_mm: &[f64], job: &MachiningJob) -> Vec<bool> {
    let block = &job.block;
    let grip_v = -(block.low_mm.z + block.grip_mm);
    let in_block = |cell: usize, beyond_mm: f64| {
        let [u, v] = raster.centre_of(cell);
        let within = |at: f64, low: f64, high: f64| (low - beyond_mm..=high + beyond_mm).contains(&at);
        within(u, block.low_mm.x, block.high_mm.x) && within(v, -block.high_mm.z, -block.low_mm.z)
    };
    // also one whose centre lies beside the block: a sheet may be thinner than a cell
    let touches_block = |cell: usize| in_block(cell, 0.5 * raster.pitch_mm);
    // a cell that the channel's edge passes through counts as beside it
    let channel_mm = job.tool.diameter_mm() - raster.pitch_mm;
    let beside: Vec<bool> =
        (0..raster.len()).map(|c| touches_block(c) && outside_mm[c] > channel_mm).collect();
    let holds =
        |cell: usize| in_block(cell, 0.0) && outside_mm[cell] > channel_mm + raster.pitch_mm + HOLDS_MM;
    // below the raster the block goes on to the grip
    let lowest = raster.centre(0, raster.dims[1] - 1)[1];
    let is_grip = |cell: usize| raster.centre_of(cell)[1] >= grip_v.min(lowest);
    let grip = (0..raster.len()).filter(|cell| is_grip(*cell));
    let mut held = vec![false; raster.len()];
    raster.connected(grip.collect(), &mut held, holds);
    let is_beside =
        |cell: usize, map: &[bool]| raster.neighbours(cell).into_iter().flatten().any(|next| map[next]);
    // the frame's own edges, from cell to cell beside it: farther than straight on
    let rounds = std::f64::consts::SQRT_2 * (HOLDS_MM / raster.pitch_mm + 2.0);
    for _ in 0..rounds.ceil() as usize {
        let before = held.clone();
        let near = |cell: usize| beside[cell] && is_beside(cell, &before);
        (0..raster.len()).filter(|cell| near(*cell)).for_each(|cell| held[cell] = true);
    }
    // what is left hangs on nothing, or holds more than itself: else it is a sharp corner of the frame
    let rest = |cell: usize| beside[cell] && !held[cell];
    let (mut loose, mut seen) = (vec![false; raster.len()], vec![false; raster.len()]);
    for cell in 0..raster.len() {
        if rest(cell) && !seen[cell] {
            let piece = raster.connected(vec![cell], &mut seen, rest);
            let hangs = piece.iter().any(|cell| is_beside(*cell, &held));
            let is_loose = !hangs || piece.iter().any(|cell| holds(*cell));
            piece.into_iter().for_each(|cell| loose[cell] = is_loose);
        }
    }
    loose
}

/// Distance to the part or to what is loose, whichever is nearer; loose cells count only as far as the cutter stays off the grip.
fn milled_mm(raster: &CellRaster, outside_mm: &[f64], loose: &[bool], job: &MachiningJob) -> Vec<f64> {
    let points: Vec<[f64; 2]> =
        (0..raster.len()).filter(|cell| loose[*cell]).map(|cell| raster.centre_of(cell)).collect();
    if points.is_empty() {
        return outside_mm.to_vec();
    }
    let lowest_v = -(job.block.low_mm.z + job.block.grip_mm + job.tool.radius_mm + THROUGH_MM);
    let loose_mm = NearestPoints::of(raster, &points).distance_mm;
    let nearer = |cell: usize| {
        let (outside, loose) = (outside_mm[cell], loose_mm[cell]);
        if raster.centre_of(cell)[1] > lowest_v {
            outside
        } else if outside + loose <= job.tool.diameter_mm() + 2.0 * raster.pitch_mm {
            // between the two nothing stands: it is inside
            outside.min(loose) - job.tool.radius_mm
        } else {
            outside.min(loose)
        }
    };
    (0..raster.len()).map(nearer).collect()
}

/// Cells that are connected to the raster's edge through cells that are `open`.
fn reached_from_the_edge(raster: &CellRaster, open: impl Fn(usize) -> bool) -> Vec<bool> {
    let [nu, nv] = raster.dims;
    let on_edge =
        |cell: usize| cell.is_multiple_of(nu) || cell % nu == nu - 1 || cell < nu || cell >= nu * (nv - 1);
    let mut reached = vec![false; raster.len()];
    raster.connected((0..raster.len()).filter(|c| on_edge(*c)).collect(), &mut reached, open);
    reached
}
