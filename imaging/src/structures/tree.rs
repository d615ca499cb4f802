//! The nearest of many boxes: a bounding-volume tree in one array.
//!
//! The boxes never change, and the coarse field gives a good upper bound of the distance before the search. A tree that is
//! split at the median and searched depth first with that bound visits little more than one path. Here it is several
//! times faster than a general R-tree, which must keep a queue of open nodes.
//!
//! The tree depends only on the order of the given boxes; among equally near boxes always the same one is found.

use std::array::from_fn;

/// Boxes in a leaf.
const LEAF: usize = 4;
/// The most open nodes of a depth-first search: one per level, and 2³² boxes have fewer levels than this.
const DEPTH: usize = 64;

/// A closed box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Bounds {
    pub low: [f64; 3],
    pub high: [f64; 3],
}

impl Bounds {
    /// The point of the box nearest to `p`; `p` itself inside.
    #[inline]
    pub fn nearest(&self, p: [f64; 3]) -> [f64; 3] {
        from_fn(|a| p[a].max(self.low[a]).min(self.high[a]))
    }

    /// Squared distance to `p`; 0 inside.
    #[inline]
    pub fn distance_squared(&self, p: [f64; 3]) -> f64 {
        let q = self.nearest(p);
        (p[0] - q[0]).powi(2) + (p[1] - q[1]).powi(2) + (p[2] - q[2]).powi(2)
    }

    fn join(&self, other: &Self) -> Self {
        Self {
            low: from_fn(|a| self.low[a].min(other.low[a])),
            high: from_fn(|a| self.high[a].max(other.high[a])),
        }
    }
}

/// Boxes with their tree.
#[derive(Debug, Clone)]
pub(super) struct Tree {
    /// Node 0 is the root.
    nodes: Vec<Node>,
    /// The boxes in the order of the leaves.
    boxes: Vec<Bounds>,
}

#[derive(Debug, Clone, Copy)]
struct Node {
    bounds: Bounds,
    /// For a leaf, its first box; for an inner node, its second child (the first child follows its parent).
    at: u32,
    /// Number of a leaf's boxes; 0 for an inner node.
    count: u32,
}

impl Tree {
    /// A tree of at most 2³¹ boxes.
    pub fn new(mut boxes: Vec<Bounds>) -> Self {
        let mut nodes = Vec::with_capacity(boxes.len() / LEAF * 2 + 1);
        if !boxes.is_empty() {
            let end = boxes.len();
            split(&mut boxes, 0..end, &mut nodes);
        }
        Self { nodes, boxes }
    }

    /// The nearest box and its squared distance, if that is at most `within_squared`.
    pub fn nearest(&self, p: [f64; 3], within_squared: f64) -> Option<(&Bounds, f64)> {
        let (mut best, mut found) = (within_squared, None);
        let mut open = [(0u32, 0.0f64); DEPTH];
        let mut depth = 0;
        let mut next = self.nodes.first().map(|root| (0u32, root.bounds.distance_squared(p)));
        while let Some((at, distance)) = next.take().or_else(|| {
            depth = usize::checked_sub(depth, 1)?;
            Some(open[depth])
        }) {
            if distance > best {
                continue;
            }
            let node = &self.nodes[at as usize];
            if node.count > 0 {
                for bounds in &self.boxes[node.at as usize..(node.at + node.count) as usize] {
                    let distance = bounds.distance_squared(p);
                    // an equal distance is accepted once, because the bound itself may be the answer
                    if distance < best || (distance == best && found.is_none()) {
                        (best, found) = (distance, Some(bounds));
                    }
                }
                continue;
            }
            let child = |at: u32| (at, self.nodes[at as usize].bounds.distance_squared(p));
            let (mut near, mut far) = (child(at + 1), child(node.at));
            if far.1 < near.1 {
                (near, far) = (far, near);
            }
            if far.1 <= best {
                open[depth] = far;
                depth += 1;
            }
            next = Some(near);
        }
        found.map(|bounds| (bounds, best))
    }
}

/// Appends the tree over `boxes[range]`, halved along the widest axis.
fn split(boxes: &mut [Bounds], range: std::ops::Range<usize>, nodes: &mut Vec<Node>) {
    let part = &mut boxes[range.clone()];
    let bounds = part.iter().skip(1).fold(part[0], |all, b| all.join(b));
    let place = nodes.len();
    nodes.push(Node { bounds, at: range.start as u32, count: part.len() as u32 });
    if part.len() <= LEAF {
        return;
    }
    let axis = (0..3).max_by(|a, b| {
        let width = |a: usize| bounds.high[a] - bounds.low[a];
        width(*a).total_cmp(&width(*b))
    });
    let middle = |b: &Bounds| axis.map_or(0.0, |a| b.low[a] + b.high[a]);
    let half = part.len() / 2;
    part.select_nth_unstable_by(half, |a, b| middle(a).total_cmp(&middle(b)));
    split(boxes, range.start..range.start + half, nodes);
    let second = nodes.len() as u32;
    split(boxes, range.start + half..range.end, nodes);
    (nodes[place].at, nodes[place].count) = (second, 0);
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_nearest_of_all_is_found_within_any_bound(
            boxes in prop::collection::vec((prop::array::uniform3(-9.0f64..9.0), prop::array::uniform3(0.0f64..3.0)), 0..60),
            p in prop::array::uniform3(-15.0f64..15.0), share in 0.0f64..2.0,
        ) {
            let boxes: Vec<_> = boxes
                .iter()
                .map(|(low, size)| Bounds { low: *low, high: from_fn(|a| low[a] + size[a]) })
                .collect();
            let expected = boxes.iter().map(|b| b.distance_squared(p)).fold(f64::INFINITY, f64::min);
            let tree = Tree::new(boxes);
            prop_assert_eq!(tree.nearest(p, f64::INFINITY).map_or(f64::INFINITY, |(_, d)| d), expected);
            prop_assert_eq!(tree.nearest(p, expected).map_or(f64::INFINITY, |(_, d)| d), expected);
            let within = tree.nearest(p, share * expected).map(|(_, d)| d);
            prop_assert_eq!(within, (expected.is_finite() && expected <= share * expected).then_some(expected));
        }
    }
}
