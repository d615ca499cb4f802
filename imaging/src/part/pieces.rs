//! Pieces that hang together over edges. Small ones beside a large one are debris.

use super::edges::Edges;
use super::{Change, Facets, PartError};

/// The piece of every facet, and each piece's area, mm².
struct Pieces {
    of_facet: Vec<u32>,
    areas_mm2: Vec<f64>,
}

fn pieces(facets: &Facets, edges: &Edges) -> Pieces {
    const UNSEEN: u32 = u32::MAX;
    let mut of_facet = vec![UNSEEN; facets.triangles.len()];
    let mut areas_mm2 = Vec::new();
    for start in 0..of_facet.len() as u32 {
        if of_facet[start as usize] != UNSEEN {
            continue;
        }
        let piece = areas_mm2.len() as u32;
        let (mut stack, mut area_mm2) = (vec![start], 0.0);
        of_facet[start as usize] = piece;
        while let Some(f) = stack.pop() {
            area_mm2 += facets.area(f as usize);
            for g in edges.neighbours(f) {
                if of_facet[g as usize] == UNSEEN {
                    of_facet[g as usize] = piece;
                    stack.push(g);
                }
            }
        }
        areas_mm2.push(area_mm2);
    }
    Pieces { of_facet, areas_mm2 }
}

/// Drops pieces whose area is at most `debris_share` of the largest's, and says so.
pub(crate) fn drop_debris(facets: &mut Facets, edges: &Edges, debris_share: f64) -> Option<Change> {
    let Pieces { of_facet, areas_mm2 } = pieces(facets, edges);
    let largest_mm2 = areas_mm2.iter().copied().fold(0.0, f64::max);
    let is_debris: Vec<bool> = areas_mm2.iter().map(|&a| a <= debris_share * largest_mm2).collect();
    let dropped = facets.retain(|f| !is_debris[of_facet[f] as usize]);
    let of_debris = areas_mm2.iter().zip(&is_debris).filter(|(_, debris)| **debris);
    let (pieces, area_mm2) = of_debris.fold((0, 0.0), |(n, sum), (a, _)| (n + 1, sum + a));
    (dropped > 0).then_some(Change::DebrisDropped { pieces, facets: dropped, area_mm2 })
}

/// Refuses more than one piece.
///
/// # Errors
/// [`PartError::Pieces`].
pub(crate) fn refuse_several(facets: &Facets, edges: &Edges) -> Result<(), PartError> {
    let Pieces { of_facet, areas_mm2 } = pieces(facets, edges);
    let mut by_area: Vec<u32> = (0..areas_mm2.len() as u32).collect();
    by_area.sort_by(|&a, &b| areas_mm2[b as usize].total_cmp(&areas_mm2[a as usize]).then(a.cmp(&b)));
    let [_, second, ..] = by_area.as_slice() else { return Ok(()) };
    let facet = of_facet.iter().position(|piece| piece == second).unwrap_or_default();
    let area_mm2 = areas_mm2[*second as usize];
    Err(PartError::Pieces { pieces: areas_mm2.len(), area_mm2, place: facets.place(facet) })
}
