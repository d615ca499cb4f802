//! A way between two positions when neither a straight link nor a retract will do: under a ledge, round a corner.
//!
//! A* over the connected grid nodes; a node at which the ball would still cut costs more than a free one, so a cut is
//! made only where there is no free way of reasonable length.

use std::cmp::Ordering;
use std::collections::{BinaryHeap, HashMap};

use bonemill_geometry::{Point, Work};

use super::Builder;

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

/// Positions from `from` (left out) to `to` (last), each move clear; `None` when there is no way.
pub(super) fn way(builder: &Builder, from: Point<Work>, to: Point<Work>) -> Option<Vec<Point<Work>>> {
    let space = builder.space();
    let grid = space.grid();
    let (start, goal) = (node_at(builder, from)?, node_at(builder, to)?);
    let center = |node: usize| grid.center(grid.voxel(node));
    let left = |node: usize| HASTE * center(node).distance_mm(&center(goal));
    let mut cost = HashMap::from([(start, 0.0)]);
    let mut came_from = HashMap::new();
    let mut free = HashMap::new();
    let mut open = BinaryHeap::from([Open { estimate: left(start), node: start }]);
    while let Some(Open { node, estimate }) = open.pop() {
        if free.len() > MOST_NODES {
            return None;
        }
        if node == goal {
            let mut nodes = vec![node];
            while let Some(previous) = came_from.get(&nodes[nodes.len() - 1]) {
                nodes.push(*previous);
            }
            nodes.reverse();
            return Some(straightened(builder, from, nodes.into_iter().map(center).chain([to])));
        }
        let here = cost[&node];
        if estimate > here + left(node) + 1e-9 {
            continue; // an older, dearer entry
        }
        for next in neighbours(grid.dims(), grid.voxel(node)).map(|v| grid.index(v)) {
            if !space.connected()[next] {
                continue;
            }
            let is_free = *free.entry(next).or_insert_with(|| builder.is_free(center(next), center(next)));
            let step = center(node).distance_mm(&center(next));
            let through = here + step * if is_free { 1.0 } else { CUT_COST };
            if cost.get(&next).is_none_or(|known| through < known - 1e-12) {
                cost.insert(next, through);
                came_from.insert(next, node);
                open.push(Open { estimate: through + left(next), node: next });
            }
        }
    }
    None
}

/// A connected node next to `p`, from which a straight clear move leads to it.
fn node_at(builder: &Builder, p: Point<Work>) -> Option<usize> {
    let (space, grid) = (builder.space(), builder.space().grid());
    let nearest = grid.nearest(p)?;
    std::iter::once(nearest)
        .chain(neighbours(grid.dims(), nearest))
        .filter(|v| space.connected()[grid.index(*v)])
        .min_by(|a, b| grid.center(*a).distance_mm(&p).total_cmp(&grid.center(*b).distance_mm(&p)))
        .map(|v| grid.index(v))
}

fn neighbours(dims: [usize; 3], [i, j, k]: [usize; 3]) -> impl Iterator<Item = [usize; 3]> {
    (0..27).filter(|n| *n != 13).filter_map(move |n| {
        let at = |v: usize, d: usize, dim: usize| (v + d).checked_sub(1).filter(|v| *v < dim);
        Some([at(i, n % 3, dims[0])?, at(j, n / 3 % 3, dims[1])?, at(k, n / 9, dims[2])?])
    })
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
        let reach = (n..way.len().min(n + 40))
            .rev()
            .find(|m| builder.is_free(here, way[*m]) && builder.space().is_move_clear(here, way[*m], step));
        let next = reach.unwrap_or(n);
        here = way[next];
        kept.push(here);
        n = next + 1;
    }
    kept
}
