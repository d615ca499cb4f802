//! Which facet lies beyond each edge.
//!
//! A half-edge is a facet's side: number 3 f + k goes from corner k of facet f to its next corner. At an edge of a closed manifold
//! surface exactly two meet.

use rayon::prelude::*;

use super::Facets;

/// No half-edge.
const NONE: u32 = u32::MAX;

/// The half-edges of a mesh, paired where exactly two meet.
pub(crate) struct Edges {
    /// The other half-edge of the same edge, or [`NONE`].
    twin: Vec<u32>,
    /// The first half-edge of every edge with more than two.
    crowded: Vec<u32>,
    is_open: Vec<bool>,
}

impl Edges {
    pub(crate) fn of(facets: &Facets) -> Self {
        let count = 3 * facets.triangles.len();
        let key = |h: u32| {
            let [a, b] = ends(facets, h);
            (u64::from(a.min(b)) << 32) | u64::from(a.max(b))
        };
        let mut sorted: Vec<(u64, u32)> = (0..count as u32).into_par_iter().map(|h| (key(h), h)).collect();
        sorted.par_sort_unstable();
        let mut edges = Self { twin: vec![NONE; count], crowded: Vec::new(), is_open: vec![false; count] };
        for group in sorted.chunk_by(|a, b| a.0 == b.0) {
            match group {
                [(_, h)] => edges.is_open[*h as usize] = true,
                [(_, g), (_, h)] => {
                    edges.twin[*g as usize] = *h;
                    edges.twin[*h as usize] = *g;
                }
                _ => edges.crowded.extend(group.first().map(|(_, h)| *h)),
            }
        }
        edges.crowded.sort_unstable();
        edges
    }

    /// The half-edge on the other side, where there is exactly one.
    pub(crate) fn twin(&self, h: u32) -> Option<u32> {
        let twin = self.twin[h as usize];
        (twin != NONE).then_some(twin)
    }

    /// The facet beyond a facet's side.
    pub(crate) fn neighbours(&self, facet: u32) -> impl Iterator<Item = u32> + '_ {
        (3 * facet..3 * facet + 3).filter_map(|h| self.twin(h)).map(|h| h / 3)
    }

    /// Half-edges with nothing on the other side.
    pub(crate) fn open(&self) -> impl Iterator<Item = u32> + '_ {
        self.is_open.iter().enumerate().filter(|(_, open)| **open).map(|(h, _)| h as u32)
    }

    /// One half-edge for every edge with more than two facets.
    pub(crate) fn crowded(&self) -> &[u32] {
        &self.crowded
    }

    /// From which vertex to which.
    pub(crate) fn ends(&self, facets: &Facets, h: u32) -> [u32; 2] {
        ends(facets, h)
    }
}

fn ends(facets: &Facets, h: u32) -> [u32; 2] {
    let triangle = facets.triangles[h as usize / 3];
    [triangle[h as usize % 3], triangle[next(h) as usize % 3]]
}

/// The next half-edge around the facet.
pub(crate) fn next(h: u32) -> u32 {
    if h % 3 == 2 { h - 2 } else { h + 1 }
}
