//! Finishing: passes along the material that roughing leaves on walls and floors.
//!
//! Every reachable voxel lies in the ball at some connected node. The gain of a node is the number of standing voxels that
//! the ball would remove there. A finishing pass goes from node to node where the gain per millimetre is largest, and a new
//! pass starts elsewhere when no gain is left nearby. Only one node of each cell ([`Cells`]) is considered.
//!
//! Gains never grow, so an earlier gain is an upper bound of the present one. A gain is counted again, by the words of the
//! ball's rows, only where its bound could be the largest; the choice is the same as if all gains were known.

use bonemill_cutting::stock::voxels::{VoxelSet, voxels_apart};
use bonemill_geometry::{Point, Work};
use rayon::prelude::*;

use super::ball_rows::BallRows;
use super::cells::Cells;
use super::{Builder, Lines, Pass};

/// A node is visited only if at least this share of a ball's volume would be removed (and at least two voxels).
const WORTH_SHARE: f64 = 0.001;
/// Finishing ends when only this share of the reachable volume is left.
const ENOUGH_LEFT: f64 = 0.003;
/// The next node is searched within this many cells of the burr.
const LOOK_CELLS: i64 = 4;
/// Cost of travel to the next start: volume of gain per mm of travel, mm².
const TRAVEL_COST_MM2: f64 = 1.0 / 64.0;

/// Adds finishing passes as layer `layer`; returns the number of rows of voxels that were read.
pub(super) fn finish(builder: &mut Builder, layer: u32, lines: &Lines) -> usize {
    let total = builder.space().reachable().iter().filter(|r| **r).count();
    let enough_left = (ENOUGH_LEFT * total as f64) as usize;
    let spacing_mm = builder.space().grid().spacing_mm().x;
    let side = voxels_apart(spacing_mm);
    // material in corners that no cell's node reaches is removed from the nodes nearest to what limits the burr
    let corners = (side > 1).then_some((1, spacing_mm as f32));
    let mut rows = 0;
    for (side, most_margin_mm) in std::iter::once((side, f32::INFINITY)).chain(corners) {
        if builder.left() > enough_left {
            let gains = Gains::new(builder, Cells::new(builder.space(), side, most_margin_mm));
            rows += finish_cells(builder, layer, gains, enough_left, lines);
        }
    }
    rows
}

/// Adds passes through the nodes of some cells.
fn finish_cells(
    builder: &mut Builder,
    layer: u32,
    mut gains: Gains,
    enough_left: usize,
    lines: &Lines,
) -> usize {
    // the loop ends, because every pass removes at least one voxel or excludes its start
    while builder.left() > enough_left {
        let Some(start) = gains.best_start(builder) else { break };
        let cells = gains.walk(builder, start);
        let before = builder.left();
        let mut points: Vec<_> = cells.iter().map(|cell| gains.center(builder, *cell)).collect();
        if (lines.sense)(builder, &points) == Some(true) {
            points.reverse();
        }
        let pass = Pass { layer, points, put_off: false, from_above: false };
        let is_vain = !builder.add(pass) || builder.left() == before;
        gains.settle(builder);
        if is_vain {
            gains.most[start] = 0;
        }
    }
    gains.counted * gains.ball.len()
}

/// Gains of the cells' nodes.
struct Gains {
    cells: Cells,
    /// Upper bound of each cell's gain; 0 where it is not tried again.
    most: Vec<u32>,
    /// Cells that may be visited, in order.
    starts: Vec<usize>,
    /// Reachable voxels that stand and that the present walk does not remove.
    there: VoxelSet,
    /// Bounds before they were lowered during the walk.
    lowered: Vec<(usize, u32)>,
    worth: u32,
    offsets: Vec<[i64; 3]>,
    ball: BallRows,
    /// How often the rows of a ball were read.
    counted: usize,
}

impl Gains {
    /// The gain of each cell.
    fn new(builder: &Builder, cells: Cells) -> Self {
        let (space, grid) = (builder.space(), builder.space().grid());
        let around = -LOOK_CELLS..=LOOK_CELLS;
        let mut offsets = Vec::new();
        for k in around.clone() {
            for j in around.clone() {
                for i in around.clone() {
                    let squared = i * i + j * j + k * k;
                    if squared > 0 && squared <= LOOK_CELLS * LOOK_CELLS {
                        offsets.push([i, j, k]);
                    }
                }
            }
        }
        let ball = BallRows::new(grid.dims(), space.radius_mm() / grid.spacing_mm().x);
        let there = builder.reachable_left().clone();
        // with few voxels, each adds to the counts of its nodes; with few nodes, each counts its voxels; both read a ball's rows
        let (left, nodes) = (builder.left(), cells.nodes());
        let most: Vec<u32> = if left <= nodes {
            let held = ball.counts(there.within(0..grid.len()));
            (0..cells.len()).map(|cell| cells.node(cell).map_or(0, |node| held[node])).collect()
        } else {
            let gain = |cell| cells.node(cell).map_or(0, |node| count(&there, &ball, node));
            (0..cells.len()).into_par_iter().map(gain).collect()
        };
        let worth = ((WORTH_SHARE * space.ball_voxels()) as u32).max(2);
        Self {
            starts: (0..cells.len()).filter(|cell| most[*cell] >= worth).collect(),
            counted: left.min(nodes),
            cells,
            most,
            there,
            lowered: Vec::new(),
            worth,
            offsets,
            ball,
        }
    }

    fn center(&self, builder: &Builder, cell: usize) -> Point<Work> {
        let grid = builder.space().grid();
        // only cells with a node are returned
        grid.center(grid.voxel(self.cells.node(cell).unwrap_or(0)))
    }

    /// Counts the gain of a cell's node again.
    fn gain(&mut self, cell: usize) -> u32 {
        let Some(node) = self.cells.node(cell).filter(|_| self.most[cell] > 0) else { return 0 };
        let gain = count(&self.there, &self.ball, node);
        self.counted += 1;
        if gain < self.most[cell] {
            self.lowered.push((cell, self.most[cell]));
            self.most[cell] = gain;
        }
        gain
    }

    /// Updates the gains to the material that the builder has really removed.
    fn settle(&mut self, builder: &Builder) {
        if self.there.replace(builder.reachable_left()) {
            // some of the material that the walk counted as removed still stands
            for (cell, most) in self.lowered.drain(..).rev() {
                self.most[cell] = most;
            }
        }
        self.lowered.clear();
    }

    /// The cell with the largest gain minus cost of travel, among those worth a visit; the first of equals.
    fn best_start(&mut self, builder: &Builder) -> Option<usize> {
        let grid = builder.space().grid();
        let travel_cost = TRAVEL_COST_MM2 / grid.voxel_mm3();
        let from = builder.position();
        let mut starts = std::mem::take(&mut self.starts);
        starts.retain(|cell| self.most[*cell] >= self.worth);
        let mut best: Option<(f64, usize)> = None;
        for cell in &starts {
            let travel = from.map_or(0.0, |p| p.distance_mm(&self.center(builder, *cell)));
            let value = |gain: u32| f64::from(gain) - travel_cost * travel;
            let is_better = |gain: u32| best.is_none_or(|(b, _)| value(gain) > b);
            if is_better(self.most[*cell]) {
                let gain = self.gain(*cell);
                if gain >= self.worth && is_better(gain) {
                    best = Some((value(gain), *cell));
                }
            }
        }
        self.starts = starts;
        best.map(|(_, cell)| cell)
    }

    /// Cells from `start` on: each has the largest gain per millimetre near the one before, as long as one is worth a visit.
    ///
    /// Material that the walk would remove counts as removed until [`Gains::settle`].
    fn walk(&mut self, builder: &Builder, start: usize) -> Vec<usize> {
        let mut cells = vec![start];
        let mut next = Some(start);
        // the loop ends, because each further node removes at least `worth` voxels
        while let Some(cell) = next {
            if let Some(node) = self.cells.node(cell) {
                self.ball.around(node).for_each(|run| self.there.take(run, |_| ()));
            }
            next = self.next(builder, cell);
            cells.extend(next);
        }
        cells
    }

    /// The cell near `here` with the largest gain per millimetre that a straight move reaches; the first of equals.
    fn next(&mut self, builder: &Builder, here: usize) -> Option<usize> {
        let (space, grid) = (builder.space(), builder.space().grid());
        let from = self.center(builder, here);
        let voxel = |cell: usize| self.cells.node(cell).map(|node| grid.voxel(node).map(|c| c as i64));
        let at = voxel(here)?;
        // upper bound of the value, index of the offset, length in cells, cell
        let mut near: Vec<(f64, usize, f64, usize)> = Vec::with_capacity(self.offsets.len());
        for (n, offset) in self.offsets.iter().enumerate() {
            let Some(cell) = self.cells.at_offset(here, *offset) else { continue };
            if self.most[cell] >= self.worth
                && let Some(to) = voxel(cell)
            {
                let squared: i64 = (0..3).map(|a| (to[a] - at[a]).pow(2)).sum();
                let length = (squared as f64).sqrt() / self.cells.side() as f64;
                near.push((f64::from(self.most[cell]) / (length + 1.0), n, length, cell));
            }
        }
        near.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let mut best: Option<(f64, usize, usize)> = None;
        for (most, n, length, cell) in near {
            if best.is_some_and(|(b, ..)| most < b) {
                break;
            }
            let gain = self.gain(cell);
            let value = f64::from(gain) / (length + 1.0);
            let is_better = best.is_none_or(|(b, first, _)| value > b || value == b && n < first);
            if gain >= self.worth
                && is_better
                && space.is_move_clear(from, self.center(builder, cell), grid.spacing_mm().x)
            {
                best = Some((value, n, cell));
            }
        }
        best.map(|(.., cell)| cell)
    }
}

/// Number of voxels of `there` in a ball around a node.
fn count(there: &VoxelSet, ball: &BallRows, node: usize) -> u32 {
    ball.around(node).map(|run| there.count(run) as u32).sum()
}

#[cfg(test)]
mod tests;
