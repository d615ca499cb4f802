//! Vertices at which a closed surface touches itself: each sheet gets a vertex of its own, at the same place.

use super::Facets;
use super::edges::{Edges, next};

/// Doubles such vertices; how many were added. The surface is closed and agrees in its sense.
pub(crate) fn open_pinches(facets: &mut Facets, edges: &Edges) -> usize {
    let before = facets.vertices.len();
    let mut is_used = vec![false; before];
    let mut is_seen = vec![false; 3 * facets.triangles.len()];
    let vertices_before: Vec<u32> = facets.triangles.iter().flatten().copied().collect();
    for start in 0..is_seen.len() as u32 {
        if is_seen[start as usize] {
            continue;
        }
        let v = vertices_before[start as usize];
        let is_first_sheet = !std::mem::replace(&mut is_used[v as usize], true);
        let own = if is_first_sheet { v } else { facets.vertices.len() as u32 };
        if !is_first_sheet {
            facets.vertices.push(facets.vertices[v as usize]);
        }
        // the half-edges that leave the vertex, one facet after the other
        let mut h = start;
        while !std::mem::replace(&mut is_seen[h as usize], true) {
            facets.triangles[h as usize / 3][h as usize % 3] = own;
            let before_h = next(next(h));
            let Some(twin) = edges.twin(before_h) else { break };
            h = twin;
        }
    }
    facets.vertices.len() - before
}
