//! The motions in their order on columns of stock: what meets stock that must not, and how wide the cutter engages.
//!
//! Both sides cut along y, so what is left over a cell of (x, z) is one interval of y: a dexel. The cutter is stamped along each motion at half a
//! cell. A rapid motion that would take stock, a holder in stock and a turn of the block under the tip are collisions. What a motion cuts off from the grip
//! is told by [`crate::proof::hold`].
//!
//! *Width of cut*: how much of the cutter's width, across the motion, takes more than the entries' depth, over the last 3 cells of travel since the
//! last bend. It is counted in strips one cell wide along the motion, so that slivers at both edges of a channel count by their own width and not by
//! the channel's. A stretch of the width may so be given up to two cells too much; a width that is by at most 4 cells more than allowed is measured again
//! on cells a quarter as wide. Plunges, steeper than 45°, are entries and have none.

use std::collections::VecDeque;

use bonemill_geometry::cancel;
use nalgebra::Vector3;

use crate::proof::chip::{Chip, RecentTeeth, Teeth};
use crate::proof::finer::{FINER, finer_width_mm};
use crate::proof::gcode::{ProgramMotion, SideUp};
use crate::proof::hold::{Hold, LoosePiece, OVERLAP_MM, Window};
use crate::proof::{ProofError, ProofJob};

/// Cells across the cutter's radius, and most cells.
const CELLS_ACROSS: f64 = 12.0;
const MOST_CELLS: f64 = 4e6;
/// Stamps over which a width is counted.
const REMEMBERED: usize = 6;
/// So that cells on the border of two strips count for one and the same side, in strips.
const TIE: f64 = 1e-6;
/// Stock that a rapid motion may touch, mm: what rounding leaves.
const TOUCH_MM: f64 = 0.01;

/// What met the stock.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Struck {
    /// The cutter in a rapid motion.
    RapidCutter,
    /// The holder.
    Holder,
    /// The block while it turns.
    Turn,
    /// A rapid motion below its height above the stock.
    Clearance,
}

/// A motion in which something met the stock.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Collision {
    /// What.
    pub struck: Struck,
    /// Line of the program.
    pub line: usize,
    /// By how much, mm.
    pub depth_mm: f64,
}

/// A motion whose cut is too wide.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WideCut {
    /// Line of the program.
    pub line: usize,
    /// Width of cut, mm.
    pub width_mm: f64,
    /// Length of the motion, mm.
    pub length_mm: f64,
}

/// What the replay found.
#[derive(Debug, Clone, PartialEq)]
pub struct Replay {
    /// Collisions, at most one of a kind a motion.
    pub collisions: Vec<Collision>,
    /// Widest cut deeper than the entries' depth, mm.
    pub widest_mm: f64,
    /// Motions whose cut is wider than allowed by more than a quarter of a cell.
    pub too_wide: Vec<WideCut>,
    /// Pieces that came loose.
    pub loose: Vec<LoosePiece>,
    /// Of every cutting motion that cut anything.
    pub chips: Vec<Chip>,
    /// Side of a cell, mm; those that judge a width near the allowed one have a quarter of it.
    pub column_mm: f64,
}

/// Replays motions on a block.
///
/// # Errors
/// [`ProofError::Value`] where the block has too many columns.
pub fn replay(motions: &[ProgramMotion], job: &ProofJob) -> Result<Replay, ProofError> {
    let mut stock = Columns::of(job)?;
    let mut hold = Hold::of(&stock, job.grip_mm);
    let mut found = Replay {
        collisions: vec![],
        widest_mm: 0.0,
        too_wide: vec![],
        loose: vec![],
        chips: vec![],
        column_mm: stock.cell,
    };
    let mut width = Width::default();
    let mut finer = None;
    let farthest = |axis: usize| job.low_mm[axis].abs().max(job.high_mm[axis].abs());
    let swing = farthest(1).hypot(farthest(2));
    for (n, motion) in motions.iter().enumerate() {
        cancel::poll();
        if motion.turns {
            let depth_mm = swing - motion.from_mm.z.min(motion.to_mm.z);
            if depth_mm > 0.0 {
                found.collisions.push(Collision { struck: Struck::Turn, line: motion.line, depth_mm });
            }
            continue;
        }
        let depth_mm = stock.holder_mm(motion, job);
        if depth_mm > TOUCH_MM {
            found.collisions.push(Collision { struck: Struck::Holder, line: motion.line, depth_mm });
        }
        let low_mm = stock.low_mm(motion, job);
        let met = stock.drive(motion, job, &mut width);
        if stock.chip_mm > 0.0 {
            found.chips.push(Chip { line: motion.line, depth_mm: stock.chip_mm });
        }
        if std::mem::take(&mut stock.parted) {
            found.loose.extend(hold.lost(&stock, &stock.touched(motion, job.radius_mm), motion.line));
        }
        if motion.rapid && met > TOUCH_MM {
            found.collisions.push(Collision {
                struck: Struck::RapidCutter,
                line: motion.line,
                depth_mm: met,
            });
        } else if low_mm > TOUCH_MM {
            found.collisions.push(Collision {
                struck: Struck::Clearance,
                line: motion.line,
                depth_mm: low_mm,
            });
        }
        let mut width_mm = width.widest_mm;
        if width_mm > job.widest_mm && width_mm <= job.widest_mm + 4.0 * stock.cell {
            width_mm = finer_width_mm(&motions[..=n], job, stock.cell, &mut finer);
        }
        found.widest_mm = found.widest_mm.max(width_mm);
        if width_mm > job.widest_mm + stock.cell / FINER {
            let length_mm = (motion.to_mm - motion.from_mm).norm();
            found.too_wide.push(WideCut { line: motion.line, width_mm, length_mm });
        }
    }
    Ok(found)
}

/// Strips along the motion that were cut deep, a bit each, over the last stamps.
#[derive(Debug, Default)]
pub(crate) struct Width {
    recent: VecDeque<u128>,
    direction: [f64; 2],
    pub widest_mm: f64,
}

impl Width {
    /// What is across one direction is not across another: a bend of more than 20° starts anew.
    fn turn(&mut self, direction: [f64; 2]) {
        let cosine = direction[0] * self.direction[0] + direction[1] * self.direction[1];
        if cosine < 0.94 {
            self.recent.clear();
        }
        self.direction = direction;
    }

    /// Stamps at half a cell: [`REMEMBERED`] are 3 cells of travel, in which every strip meets a cell's centre.
    fn add(&mut self, deep: u128, cell: f64) {
        self.recent.push_back(deep);
        if self.recent.len() > REMEMBERED {
            self.recent.pop_front();
        }
        let strips = self.recent.iter().fold(0, |all, deep| all | deep);
        self.widest_mm = self.widest_mm.max(f64::from(strips.count_ones()) * cell);
    }
}

/// Intervals of y over cells of (x, z).
pub(crate) struct Columns {
    /// Side of a cell, mm.
    pub cell: f64,
    /// x and z of the first cell's centre, mm.
    pub origin: [f64; 2],
    /// Cells along x and z.
    pub dims: [usize; 2],
    /// Lower end of the stock over each cell, mm.
    pub low: Vec<f64>,
    /// Upper end, mm; no more than the lower one where there is none.
    pub high: Vec<f64>,
    /// Whether neighbouring cells ceased to hold each other since this was last taken.
    parted: bool,
    /// Of the last motion, see [`Chip`], mm.
    chip_mm: f64,
}

impl Columns {
    fn of(job: &ProofJob) -> Result<Self, ProofError> {
        let size = job.high_mm - job.low_mm;
        let cell = (job.radius_mm / CELLS_ACROSS).max((size.x * size.z / MOST_CELLS).sqrt());
        if cell > 0.5 * job.radius_mm {
            return Err(ProofError::Value {
                what: "cutter radius for a block of this size",
                value: job.radius_mm,
                low: 2.0 * cell,
                high: 50.0,
            });
        }
        Ok(Self::over(job, (job.low_mm.x, job.high_mm.x), (job.low_mm.z, job.high_mm.z), cell))
    }

    /// The block from the lower to the higher x and z, mm, uncut.
    pub fn over(job: &ProofJob, x: (f64, f64), z: (f64, f64), cell: f64) -> Self {
        let dims = [x, z].map(|(low, high)| ((high - low) / cell).ceil().max(0.0) as usize);
        let count = dims[0] * dims[1];
        let (low, high) = (vec![job.low_mm.y; count], vec![job.high_mm.y; count]);
        Self {
            cell,
            origin: [x.0 + 0.5 * cell, z.0 + 0.5 * cell],
            dims,
            low,
            high,
            parted: false,
            chip_mm: 0.0,
        }
    }

    /// Cells along an axis whose centres lie in `low..=high`.
    fn span(&self, axis: usize, low: f64, high: f64) -> std::ops::Range<usize> {
        let first = ((low - self.origin[axis]) / self.cell).ceil().max(0.0);
        let last =
            (((high - self.origin[axis]) / self.cell).floor() + 1.0).clamp(0.0, self.dims[axis] as f64);
        first.min(last) as usize..last as usize
    }

    /// The cells that a tool may reach on a motion.
    fn touched(&self, motion: &ProgramMotion, radius_mm: f64) -> Window {
        let turn = if motion.facing == SideUp::Front { -1.0 } else { 1.0 };
        let (a, b) = (motion.from_mm, motion.to_mm);
        [(0, a.x, b.x), (1, turn * a.y, turn * b.y)]
            .map(|(axis, a, b)| self.span(axis, a.min(b) - radius_mm, a.max(b) + radius_mm))
    }

    /// Stock over a cell as the facing side sees it: its surface there and the far one.
    fn seen(&self, cell: usize, facing: SideUp) -> (f64, f64) {
        match facing {
            SideUp::Front => (self.high[cell], self.low[cell]),
            SideUp::Back => (-self.low[cell], -self.high[cell]),
        }
    }

    /// Stamps the cutter along a motion; gives the thickest stock that it took.
    pub fn drive(&mut self, motion: &ProgramMotion, job: &ProofJob, width: &mut Width) -> f64 {
        let along = motion.to_mm - motion.from_mm;
        let across = along.xy().norm();
        let count = (across / (0.5 * self.cell)).ceil().max(1.0) as usize;
        let direction = if across > 0.0 { [along.x / across, along.y / across] } else { [0.0; 2] };
        let mut thickest = 0.0_f64;
        width.widest_mm = 0.0;
        self.chip_mm = 0.0;
        width.turn(direction);
        let counts = across > along.z.abs() && !motion.rapid;
        let met = self.meeting(motion, count, job.radius_mm);
        let mut recent = RecentTeeth::default();
        // stamps beside the columns take nothing: as many as the width remembers stand for all
        let beside = |stamps: usize, width: &mut Width, cell: f64| {
            (0..stamps.min(REMEMBERED)).filter(|_| counts).for_each(|_| width.add(0, cell));
        };
        beside(met.start - 1, width, self.cell);
        for n in met.clone() {
            let tip = motion.from_mm + along * (n as f64 / count as f64);
            let (taken, deep, teeth) = self.stamp(&tip, motion, direction, job);
            if !motion.rapid {
                self.chip_mm = self.chip_mm.max(recent.add(teeth, REMEMBERED, job.flutes));
            }
            thickest = thickest.max(taken);
            if counts {
                width.add(deep, self.cell);
            }
        }
        beside(count + 1 - met.end, width, self.cell);
        thickest
    }

    /// Those of the stamps 1 to `count` of a motion at which a tool may be over the columns.
    fn meeting(&self, motion: &ProgramMotion, count: usize, radius_mm: f64) -> std::ops::Range<usize> {
        let turn = if motion.facing == SideUp::Front { -1.0 } else { 1.0 };
        let (mut first, mut last) = (0.0f64, 1.0f64);
        for (axis, from, to) in
            [(0, motion.from_mm.x, motion.to_mm.x), (1, turn * motion.from_mm.y, turn * motion.to_mm.y)]
        {
            let low = self.origin[axis] - radius_mm - self.cell;
            let high = self.origin[axis] + self.dims[axis] as f64 * self.cell + radius_mm;
            if from == to {
                if !(low..=high).contains(&from) {
                    return 1..1;
                }
                continue;
            }
            let (a, b) = ((low - from) / (to - from), (high - from) / (to - from));
            (first, last) = (first.max(a.min(b)), last.min(a.max(b)));
        }
        if first > last {
            return 1..1;
        }
        let first = ((first * count as f64).floor() as usize).max(1);
        let last = ((last * count as f64).ceil() as usize).min(count);
        first..(last + 1).max(first)
    }

    /// Takes what is above the cutter; gives the thickest, the strips from which it was thicker than an entry and, by angle, the depth × cos of each tooth.
    fn stamp(
        &mut self,
        tip: &Vector3<f64>,
        motion: &ProgramMotion,
        direction: [f64; 2],
        job: &ProofJob,
    ) -> (f64, u128, Teeth) {
        let r = job.radius_mm;
        let mut teeth = Teeth::default();
        // rows of cells run along z: the machine's Y, or its reverse
        let turn = if motion.facing == SideUp::Front { -1.0 } else { 1.0 };
        let z = turn * tip.y;
        let (mut thickest, mut deep) = (0.0_f64, 0);
        for k in self.span(1, z - r, z + r) {
            let dv = turn * (self.origin[1] + k as f64 * self.cell - z);
            let half = (r * r - dv * dv).max(0.0).sqrt();
            for i in self.span(0, tip.x - half, tip.x + half) {
                let du = self.origin[0] + i as f64 * self.cell - tip.x;
                let cell = i + self.dims[0] * k;
                let surface = tip.z + profile_mm(du.hypot(dv), job);
                let (near, far) = self.seen(cell, motion.facing);
                let taken = near - surface.max(far);
                if taken <= 0.0 {
                    continue;
                }
                thickest = thickest.max(taken);
                teeth.take([du, dv], taken * (du * direction[0] + dv * direction[1]) / r);
                if taken > job.entry_mm {
                    // a cell is at least a 48th of the radius: fewer than 98 strips
                    let across = dv * direction[0] - du * direction[1];
                    deep |= 1 << ((across + r) / self.cell + TIE) as u32;
                }
                let [low, high] = [self.low[cell], self.high[cell]];
                match motion.facing {
                    SideUp::Front => self.high[cell] = surface.max(far),
                    SideUp::Back => self.low[cell] = -surface.max(far),
                }
                self.parted |= self.parts(cell, [low, high]);
            }
        }
        (thickest, deep, teeth)
    }

    /// By how much a rapid motion that does not rise is lower than its height above the stock under the cutter, mm.
    fn low_mm(&self, motion: &ProgramMotion, job: &ProofJob) -> f64 {
        let (from, to) = (motion.from_mm, motion.to_mm);
        let rises = (to - from).xy().norm() == 0.0 && to.z >= from.z;
        if !motion.rapid || rises {
            return 0.0;
        }
        let along = to - from;
        let count = (along.xy().norm() / self.cell).ceil().max(1.0) as usize;
        let turn = if motion.facing == SideUp::Front { -1.0 } else { 1.0 };
        let mut low_mm = 0.0_f64;
        for n in self.meeting(motion, count, job.radius_mm) {
            let tip = from + along * (n as f64 / count as f64);
            let (r, z) = (job.radius_mm, turn * tip.y);
            for k in self.span(1, z - r, z + r) {
                let dv = self.origin[1] + k as f64 * self.cell - z;
                let half = (r * r - dv * dv).max(0.0).sqrt();
                for i in self.span(0, tip.x - half, tip.x + half) {
                    let (near, far) = self.seen(i + self.dims[0] * k, motion.facing);
                    if near > far {
                        let du = self.origin[0] + i as f64 * self.cell - tip.x;
                        low_mm = low_mm.max(near + job.clearance_mm - tip.z - profile_mm(du.hypot(dv), job));
                    }
                }
            }
        }
        low_mm
    }

    /// Whether a cell that had stock between two heights no longer holds a neighbour that it held.
    fn parts(&self, cell: usize, [low, high]: [f64; 2]) -> bool {
        let held = |beside: usize| self.high[beside].min(high) - self.low[beside].max(low) > OVERLAP_MM;
        let block = self.dims.map(|n| 0..n);
        self.beside(cell, &block).into_iter().flatten().any(|n| held(n) && !self.hold(cell, n))
    }

    /// How deep the holder is in stock anywhere on a motion, mm.
    fn holder_mm(&self, motion: &ProgramMotion, job: &ProofJob) -> f64 {
        let mut base = motion.from_mm.z.min(motion.to_mm.z) + job.length_mm;
        let top = job.low_mm.y.abs().max(job.high_mm.y.abs());
        let mut deepest = 0.0_f64;
        // a piece above the whole block meets nothing
        for &[length, radius] in job.holder_mm.iter() {
            if base >= top {
                break;
            }
            let surface = self.highest_near(motion, radius);
            deepest = deepest.max(surface - base);
            base += length;
        }
        deepest
    }

    /// The highest stock within the rectangle around a motion and a distance from it, mm.
    fn highest_near(&self, motion: &ProgramMotion, radius: f64) -> f64 {
        let [columns, rows] = self.touched(motion, radius);
        let mut highest = f64::NEG_INFINITY;
        for k in rows {
            for i in columns.clone() {
                let (near, far) = self.seen(i + self.dims[0] * k, motion.facing);
                if near > far {
                    highest = highest.max(near);
                }
            }
        }
        highest
    }
}

/// Height of the cutter's surface above its tip, mm.
fn profile_mm(distance: f64, job: &ProofJob) -> f64 {
    let rc = job.corner_radius_mm;
    let into = (distance - (job.radius_mm - rc)).clamp(0.0, rc);
    rc - (rc * rc - into * into).max(0.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slivers_at_both_edges_of_a_channel_count_by_their_own_width() {
        let mut width = Width::default();
        width.turn([1.0, 0.0]);
        width.add(1 | 1 << 23, 0.125);
        assert_eq!(width.widest_mm, 0.25);
        // strips are met one after the other within 3 cells of travel, and forgotten at a bend
        width.add(0b11110, 0.125);
        assert_eq!(width.widest_mm, 0.75);
        width.turn([0.0, 1.0]);
        width.widest_mm = 0.0;
        width.add(0b100, 0.125);
        assert_eq!(width.widest_mm, 0.125);
    }
}
