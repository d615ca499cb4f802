//! A way between two positions when neither a straight link nor a retract will do: under a ledge, round a corner.
//!
//! A* over the connected grid nodes; a node at which the ball would still cut costs more than a free one, so a cut is
//! made only where there is no free way of reasonable length.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use bonemill_geometry::{Point, Work};

use super::Builder;
use super::ball_rows::BallRows;
use crate::space::BurrSpace;
use crate::voxels::VoxelSet;

/// A millimetre through material counts as this many through free space.
const CUT_COST: f64 = 6.0;
/// Nodes looked at before the search gives up: the pass is then reported as unjoined.
const MOST_NODES: usize = 15_000;
/// The distance left counts this much more than the way so far: a way of reasonable length soon, not the shortest late.
const HASTE: f64 = 2.0;

struct Open {
    estimate: f64,
    node: usize,
}

impl PartialEq for Open {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}
impl Eq for Open {}
impl PartialOrd for Open {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Open {
    // the heap gives the largest first: the smallest estimate, ties by the smaller node
    fn cmp(&self, other: &Self) -> Ordering {
        other.estimate.total_cmp(&self.estimate).then(other.node.cmp(&self.node))
    }
}

/// A node that a search has looked at.
#[derive(Debug, Clone, Copy)]
struct Seen {
    node: usize,
    /// Of the way to it.
    cost: f64,
    /// Where that came from, as a place in the list; the start's is its own.
    from: u32,
    is_free: bool,
}

/// Searches on one grid, one after the other.
#[derive(Debug, Default)]
pub(super) struct Search {
    /// Nodes at which the ball was once found to cut nothing: it never does again.
    free: VoxelSet,
    /// What the ball was last found to cut at a node, plus 1; 0 where it was never looked for. Most of it is still there.
    met: Vec<u32>,
    /// What the ball holds at a node and not where it came from, by the step.
    crescents: Vec<BallRows>,
    /// Place of a node in `seen`, plus 1; 0 where it is not.
    place: Vec<u32>,
    seen: Vec<Seen>,
}

impl Search {
    pub(super) fn new(space: &BurrSpace) -> Self {
        let (grid, len) = (space.grid(), space.grid().len());
        let radius = space.radius_mm() / grid.spacing_mm().x;
        Self {
            free: VoxelSet::of(len, |_| false),
            met: vec![0; len],
            crescents: (0..27).map(|n| BallRows::beyond(grid.dims(), radius, step(n))).collect(),
            place: vec![0; len],
            seen: Vec::new(),
        }
    }

    /// Positions from `from` (left out) to `to` (last), each move clear; `None` when there is no way.
    pub(super) fn way(
        &mut self,
        builder: &Builder,
        from: Point<Work>,
        to: Point<Work>,
    ) -> Option<Vec<Point<Work>>> {
        let (start, goal) = (node_at(builder, from)?, node_at(builder, to)?);
        let nodes = self.nodes(builder, start, goal);
        for seen in self.seen.drain(..) {
            self.place[seen.node] = 0;
        }
        let grid = builder.space().grid();
        let centers = nodes?.into_iter().map(|node| grid.center(grid.voxel(node)));
        Some(straightened(builder, from, centers.chain([to])))
    }

    /// The cheapest nodes from `start` to `goal`, both included.
    fn nodes(&mut self, builder: &Builder, start: usize, goal: usize) -> Option<Vec<usize>> {
        let space = builder.space();
        let grid = space.grid();
        let center = |node: usize| grid.center(grid.voxel(node));
        let left = |node: usize| HASTE * center(node).distance_mm(&center(goal));
        self.see(Seen { node: start, cost: 0.0, from: 0, is_free: true });
        let mut open = BinaryHeap::from([Open { estimate: left(start), node: start }]);
        while let Some(Open { node, estimate }) = open.pop() {
            if self.seen.len() > MOST_NODES {
                return None;
            }
            let mut here = self.place[node] as usize - 1;
            if node == goal {
                let mut nodes = vec![node];
                while here != 0 {
                    here = self.seen[here].from as usize;
                    nodes.push(self.seen[here].node);
                }
                nodes.reverse();
                return Some(nodes);
            }
            let cost = self.seen[here].cost;
            if estimate > cost + left(node) + 1e-9 {
                continue; // an older, dearer entry
            }
            for (n, next) in neighbours(grid.dims(), grid.voxel(node)) {
                let next = grid.index(next);
                if !space.connected()[next] {
                    continue;
                }
                let place = match self.place[next] {
                    0 => {
                        let is_free = self.is_free(builder, next, node, n);
                        self.see(Seen { node: next, cost: f64::INFINITY, from: 0, is_free })
                    }
                    place => place as usize - 1,
                };
                let seen = &mut self.seen[place];
                let step = center(node).distance_mm(&center(next));
                let through = cost + step * if seen.is_free { 1.0 } else { CUT_COST };
                if through < seen.cost - 1e-12 {
                    (seen.cost, seen.from) = (through, here as u32);
                    open.push(Open { estimate: through + left(next), node: next });
                }
            }
        }
        None
    }

    /// Whether the ball cuts nothing at a node, the n-th neighbour of another. Where it cuts nothing there, only what it holds more
    /// is looked at; else what it met here or there before is asked first.
    fn is_free(&mut self, builder: &Builder, node: usize, from: usize, n: usize) -> bool {
        if self.free.contains(node) {
            return true;
        }
        let is_free = self.free.contains(from)
            && !self.crescents[n].around(node).any(|run| builder.holds_material(run));
        if !is_free {
            let center = builder.space().grid().center(builder.space().grid().voxel(node));
            let before = [node, from].into_iter().find_map(|near| (self.met[near] as usize).checked_sub(1));
            if let Some(voxel) = builder.met(center, center, before) {
                self.met[node] = voxel as u32 + 1;
                return false;
            }
        }
        self.free.insert(node);
        true
    }

    fn see(&mut self, seen: Seen) -> usize {
        self.seen.push(seen);
        self.place[seen.node] = self.seen.len() as u32;
        self.seen.len() - 1
    }
}

/// A connected node next to `p`, from which a straight clear move leads to it.
fn node_at(builder: &Builder, p: Point<Work>) -> Option<usize> {
    let (space, grid) = (builder.space(), builder.space().grid());
    let nearest = grid.nearest(p)?;
    std::iter::once(nearest)
        .chain(neighbours(grid.dims(), nearest).map(|(_, v)| v))
        .filter(|v| space.connected()[grid.index(*v)])
        .min_by(|a, b| grid.center(*a).distance_mm(&p).total_cmp(&grid.center(*b).distance_mm(&p)))
        .map(|v| grid.index(v))
}

/// The neighbours of a voxel, each with its number: [`step`] leads there.
fn neighbours(dims: [usize; 3], at: [usize; 3]) -> impl Iterator<Item = (usize, [usize; 3])> {
    (0..27).filter(|n| *n != 13).filter_map(move |n| {
        let [i, j, k] =
            std::array::from_fn(|a| at[a].checked_add_signed(step(n)[a] as isize).filter(|v| *v < dims[a]));
        Some((n, [i?, j?, k?]))
    })
}

/// From a voxel to its n-th neighbour of 27, itself among them.
fn step(n: usize) -> [i64; 3] {
    [n % 3, n / 3 % 3, n / 9].map(|d| d as i64 - 1)
}

/// Leaves out positions that a straight move may skip: clear, and free where the skipped ones were.
fn straightened(
    builder: &Builder,
    from: Point<Work>,
    way: impl Iterator<Item = Point<Work>>,
) -> Vec<Point<Work>> {
    let way: Vec<_> = way.collect();
    let step = 0.5 * builder.space().grid().spacing_mm().x;
    let mut kept = Vec::new();
    let mut here = from;
    let mut n = 0;
    while n < way.len() {
        // the farthest of the next few that a straight free move reaches, else the very next
        let mut met = None;
        let mut is_free = |to| {
            met = builder.met(here, to, met);
            met.is_none()
        };
        let reach = (n..way.len().min(n + 40))
            .rev()
            .find(|m| is_free(way[*m]) && builder.space().is_move_clear(here, way[*m], step));
        let next = reach.unwrap_or(n);
        here = way[next];
        kept.push(here);
        n = next + 1;
    }
    kept
}
