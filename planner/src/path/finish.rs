//! Finishing: along what roughing leaves on walls and floors.
//!
//! Every reachable voxel lies in the ball at some connected node. So each node has a gain: how many of the voxels still
//! there a ball at it would remove. The finishing burr walks from node to node where the gain per millimetre is best,
//! and jumps when nothing near is left. Gains are kept up to date as voxels go; a voxel is subtracted once from each
//! node in its ball, so the whole costs as much as the first count.

use bonemill_geometry::{Point, Work};

use super::ball_rows::BallRows;
use super::{Builder, Pass};
use crate::voxels::VoxelSet;

/// A node is worth a visit when at least this share of a full ball's volume would go (at least two voxels).
const WORTH_SHARE: f64 = 0.001;
/// Finishing ends when this share of the reachable volume is left.
const ENOUGH_LEFT: f64 = 0.003;
/// Nodes looked at from where the burr stands: within this many voxels.
const LOOK_VOXELS: i64 = 4;
/// A millimetre of travel to the next start costs as much as this many voxels of gain.
const TRAVEL_COST: f64 = 1.0;

/// Adds finishing passes as layer `layer`.
pub(super) fn finish(builder: &mut Builder, layer: u32) {
    let mut gains = Gains::new(builder);
    let total = builder.space().reachable().iter().filter(|r| **r).count();
    let enough_left = (ENOUGH_LEFT * total as f64) as usize;
    // every pass removes at least one voxel or strikes its start off: the loop ends
    while builder.left() > enough_left {
        let Some(start) = gains.best_start(builder) else { break };
        let nodes = gains.walk(builder, start);
        let before = builder.left();
        let points = nodes.iter().map(|n| gains.center(builder, *n)).collect();
        if !builder.add(Pass { layer, points, put_off: false }) || builder.left() == before {
            gains.strike(start);
        }
        gains.settle(builder);
    }
}

struct Gains {
    gain: Vec<u32>,
    /// Starts that led nowhere: never tried again.
    struck: Vec<bool>,
    /// Nodes that may be worth a visit, in order: gains never grow.
    starts: Vec<usize>,
    /// Reachable voxels that were there at the last settling.
    left: Vec<usize>,
    /// Those of them that the walk has not taken, and those that it has.
    there: VoxelSet,
    taken: Vec<usize>,
    worth: u32,
    offsets: Vec<[i64; 3]>,
    ball: BallRows,
}

impl Gains {
    fn new(builder: &Builder) -> Self {
        let grid = builder.space().grid();
        let around = -LOOK_VOXELS..=LOOK_VOXELS;
        let mut offsets = Vec::new();
        for k in around.clone() {
            for j in around.clone() {
                for i in around.clone() {
                    let squared = i * i + j * j + k * k;
                    if squared > 0 && squared <= LOOK_VOXELS * LOOK_VOXELS {
                        offsets.push([i, j, k]);
                    }
                }
            }
        }
        let mut gains = Self {
            gain: vec![0; grid.len()],
            struck: vec![false; grid.len()],
            starts: Vec::new(),
            left: (0..grid.len()).filter(|n| builder.is_left(*n)).collect(),
            there: VoxelSet::of(grid.len(), |n| builder.is_left(n)),
            taken: Vec::new(),
            worth: ((WORTH_SHARE * builder.space().ball_voxels()) as u32).max(2),
            offsets,
            ball: BallRows::new(grid.dims(), builder.space().radius_mm() / grid.spacing_mm().x),
        };
        for n in 0..gains.left.len() {
            let voxel = gains.left[n];
            gains.add(builder, voxel, 1);
        }
        gains.starts = (0..grid.len()).filter(|n| gains.is_worth(*n)).collect();
        gains
    }

    fn center(&self, builder: &Builder, node: usize) -> Point<Work> {
        let grid = builder.space().grid();
        grid.center(grid.voxel(node))
    }

    /// `sign` to the gain of every connected node whose ball holds `voxel`.
    fn add(&mut self, builder: &Builder, voxel: usize, sign: i32) {
        let connected = builder.space().connected();
        for run in self.ball.around(voxel) {
            for (gain, is_node) in self.gain[run.clone()].iter_mut().zip(&connected[run]) {
                *gain = gain.wrapping_add_signed(sign * i32::from(*is_node));
            }
        }
    }

    /// Brings the gains up to what the builder has really removed.
    fn settle(&mut self, builder: &Builder) {
        for voxel in std::mem::take(&mut self.taken) {
            if builder.is_left(voxel) {
                self.there.insert(voxel);
                self.add(builder, voxel, 1);
            }
        }
        for voxel in std::mem::take(&mut self.left) {
            if builder.is_left(voxel) {
                self.left.push(voxel);
            } else if self.there.remove(voxel) {
                self.add(builder, voxel, -1);
            }
        }
    }

    fn is_worth(&self, node: usize) -> bool {
        self.gain[node] >= self.worth && !self.struck[node]
    }

    /// Never go to `node` again.
    fn strike(&mut self, node: usize) {
        self.struck[node] = true;
    }

    /// The worthwhile node with the best gain less the cost of travelling there.
    fn best_start(&mut self, builder: &Builder) -> Option<usize> {
        let mut starts = std::mem::take(&mut self.starts);
        starts.retain(|node| self.is_worth(*node));
        self.starts = starts;
        let from = builder.position();
        let value = |node: usize| {
            let travel = from.map_or(0.0, |p| p.distance_mm(&self.center(builder, node)));
            f64::from(self.gain[node]) - TRAVEL_COST * travel
        };
        let mut best: Option<(f64, usize)> = None;
        for node in &self.starts {
            let v = value(*node);
            if best.is_none_or(|(b, _)| v > b) {
                best = Some((v, *node));
            }
        }
        best.map(|(_, node)| node)
    }

    /// Nodes from `start` on, each the best per millimetre among those near the last, as long as one is worth it.
    ///
    /// What the walk would take is taken from the gains, until [`Gains::settle`].
    fn walk(&mut self, builder: &Builder, start: usize) -> Vec<usize> {
        let space = builder.space();
        let grid = space.grid();
        let dims = grid.dims().map(|d| d as i64);
        let mut nodes = vec![start];
        self.take(builder, start);
        // bounded: each further node takes at least `worth` voxels
        loop {
            let here = nodes[nodes.len() - 1];
            let at = grid.voxel(here).map(|c| c as i64);
            let mut best: Option<(f64, usize)> = None;
            for o in &self.offsets {
                let v = [at[0] + o[0], at[1] + o[1], at[2] + o[2]];
                if (0..3).any(|a| v[a] < 0 || v[a] >= dims[a]) {
                    continue;
                }
                let node = grid.index(v.map(|c| c as usize));
                if !self.is_worth(node) {
                    continue;
                }
                let length = ((o[0] * o[0] + o[1] * o[1] + o[2] * o[2]) as f64).sqrt();
                let value = f64::from(self.gain[node]) / (length + 1.0);
                if best.is_none_or(|(b, _)| value > b)
                    && space.is_move_clear(
                        grid.center(grid.voxel(here)),
                        grid.center(grid.voxel(node)),
                        grid.spacing_mm().x,
                    )
                {
                    best = Some((value, node));
                }
            }
            let Some((_, node)) = best else { break };
            self.take(builder, node);
            nodes.push(node);
        }
        nodes
    }

    /// Takes what a ball at `node` would remove.
    fn take(&mut self, builder: &Builder, node: usize) {
        let first = self.taken.len();
        for run in self.ball.around(node) {
            self.there.take(run, |voxel| self.taken.push(voxel));
        }
        for n in first..self.taken.len() {
            let voxel = self.taken[n];
            self.add(builder, voxel, -1);
        }
    }
}
