//! Searches a way between two positions when neither a straight link nor a retract is possible: under a ledge, round a corner.
//!
//! A* runs over connected grid nodes, one in [`voxels_apart`] along each axis. A node at which the ball would still cut costs
//! more than a free one, so the way cuts only where there is no free way of reasonable length.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use bonemill_cutting::stock::voxels::{VoxelSet, voxels_apart};
use bonemill_geometry::{Point, Work};

use super::Builder;
use crate::space::BurrSpace;

/// A millimetre through material costs as much as this many through free space.
const CUT_COST: f64 = 6.0;
/// Number of nodes after which the search fails; the pass is then reported as unjoined.
const MOST_NODES: usize = 15_000;
/// Weight of the remaining distance against the way so far. Above 1, the search soon finds a way of reasonable length instead
/// of the shortest way later.
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
    // the heap returns the largest element first, which must be the smallest estimate; of equal ones the smaller node
    fn cmp(&self, other: &Self) -> Ordering {
        other.estimate.total_cmp(&self.estimate).then(other.node.cmp(&self.node))
    }
}

/// A node that a search has reached.
#[derive(Debug, Clone, Copy)]
struct Seen {
    node: usize,
    /// Cost of the way to it.
    cost: f64,
    /// Index of the node before it; the start refers to itself.
    from: u32,
    is_free: bool,
}

/// Runs searches on one grid, one after the other. Nodes are numbered on a separate lattice.
#[derive(Debug, Default)]
pub(super) struct LinkSearch {
    lattice: SearchNodes,
    /// Nodes at which the ball was found to cut nothing, which stays true.
    free: VoxelSet,
    /// The voxel that the ball was last found to cut at each node, plus 1; 0 where it was not tested. Most of these voxels still
    /// stand.
    met: Vec<u32>,
    /// Index of each node in `seen`, plus 1; 0 where it is not in it.
    place: Vec<u32>,
    seen: Vec<Seen>,
}

impl LinkSearch {
    pub(super) fn new(space: &BurrSpace) -> Self {
        let grid = space.grid();
        let lattice = SearchNodes::new(grid.dims(), voxels_apart(grid.spacing_mm().x));
        let len = lattice.len();
        Self {
            lattice,
            free: VoxelSet::of(len, |_| false),
            met: vec![0; len],
            place: vec![0; len],
            seen: Vec::new(),
        }
    }

    /// Positions from `from` (not included) to `to` (the last), each move clear; `None` when there is no way.
    pub(super) fn way(
        &mut self,
        builder: &Builder,
        from: Point<Work>,
        to: Point<Work>,
    ) -> Option<Vec<Point<Work>>> {
        let (start, goal) = (self.lattice.node_at(builder, from)?, self.lattice.node_at(builder, to)?);
        let nodes = self.nodes(builder, start, goal);
        for seen in self.seen.drain(..) {
            self.place[seen.node] = 0;
        }
        let centers = nodes?.into_iter().map(|node| self.lattice.center(builder.space(), node));
        Some(straightened(builder, from, centers.chain([to])))
    }

    /// The cheapest nodes from `start` to `goal`, both included.
    fn nodes(&mut self, builder: &Builder, start: usize, goal: usize) -> Option<Vec<usize>> {
        let (space, lattice) = (builder.space(), self.lattice);
        let center = |node: usize| lattice.center(space, node);
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
                continue; // an older entry of higher cost
            }
            for (n, next) in lattice.neighbours(node) {
                if !lattice.is_step_open(space, node, n) {
                    continue;
                }
                let place = match self.place[next] {
                    0 => {
                        let is_free = self.is_free(builder, next, node);
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

    /// Whether the ball cuts nothing at a node that is reached from the node `from`. The voxel that it met before at either of
    /// them is tested first.
    fn is_free(&mut self, builder: &Builder, node: usize, from: usize) -> bool {
        if self.free.contains(node) {
            return true;
        }
        let center = self.lattice.center(builder.space(), node);
        let before = [node, from].into_iter().find_map(|near| (self.met[near] as usize).checked_sub(1));
        if let Some(voxel) = builder.met(center, center, before) {
            self.met[node] = voxel as u32 + 1;
            return false;
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

/// Every `apart`-th voxel along each axis, x-fastest.
#[derive(Debug, Clone, Copy, Default)]
struct SearchNodes {
    apart: usize,
    dims: [usize; 3],
}

impl SearchNodes {
    fn new(voxels: [usize; 3], apart: usize) -> Self {
        Self { apart, dims: voxels.map(|n| n.div_ceil(apart)) }
    }

    fn len(&self) -> usize {
        self.dims.iter().product()
    }

    fn place(&self, node: usize) -> [usize; 3] {
        let [nx, ny, _] = self.dims;
        [node % nx, node / nx % ny, node / (nx * ny)]
    }

    fn node(&self, [i, j, k]: [usize; 3]) -> usize {
        i + self.dims[0] * (j + self.dims[1] * k)
    }

    fn voxel(&self, node: usize) -> [usize; 3] {
        self.place(node).map(|c| c * self.apart)
    }

    fn voxel_index(&self, space: &BurrSpace, node: usize) -> usize {
        space.grid().index(self.voxel(node))
    }

    fn center(&self, space: &BurrSpace, node: usize) -> Point<Work> {
        space.grid().center(self.voxel(node))
    }

    /// A connected node near `p` from which a straight clear move leads to `p`.
    fn node_at(&self, builder: &Builder, p: Point<Work>) -> Option<usize> {
        let space = builder.space();
        let nearest = space.grid().nearest(p)?.map(|c| c as f64 / self.apart as f64);
        let nearest = self.node([0, 1, 2].map(|a| (nearest[a].round() as usize).min(self.dims[a] - 1)));
        let distance_mm = |node: &usize| self.center(space, *node).distance_mm(&p);
        std::iter::once(nearest)
            .chain(self.neighbours(nearest).map(|(_, node)| node))
            .filter(|node| space.connected()[self.voxel_index(space, *node)])
            .filter(|node| {
                space.is_move_clear(p, self.center(space, *node), 0.5 * space.grid().spacing_mm().x)
            })
            .min_by(|a, b| distance_mm(a).total_cmp(&distance_mm(b)))
    }

    /// The neighbours of a node, each with the number of its [`step`].
    fn neighbours(self, node: usize) -> impl Iterator<Item = (usize, usize)> {
        let at = self.place(node);
        (0..27).filter(|n| *n != 13).filter_map(move |n| {
            let moved =
                |a: usize| at[a].checked_add_signed(step(n)[a] as isize).filter(|v| *v < self.dims[a]);
            Some((n, self.node([moved(0)?, moved(1)?, moved(2)?])))
        })
    }

    /// Whether all voxels from a node to its n-th neighbour, including the neighbour, are connected.
    fn is_step_open(&self, space: &BurrSpace, node: usize, n: usize) -> bool {
        let from = self.voxel(node).map(|c| c as i64);
        (1..=self.apart as i64).all(|m| {
            let voxel = [0, 1, 2].map(|a| (from[a] + m * step(n)[a]) as usize);
            space.connected()[space.grid().index(voxel)]
        })
    }
}

/// Offset from a voxel to its n-th neighbour of 27, which include itself.
fn step(n: usize) -> [i64; 3] {
    [n % 3, n / 3 % 3, n / 9].map(|d| d as i64 - 1)
}

/// Leaves out positions that a straight move can skip, if that move is clear, and free where the skipped ones were free.
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
        // the farthest of the next few positions that a straight free move reaches, else the next one
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
