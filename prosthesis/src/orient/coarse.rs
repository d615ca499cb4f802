//! A coarser surface for the search: vertices in one cell become one.
//!
//! Moving vertices together keeps a closed surface closed, as a sum of facets, which is all that an outline needs.

use std::collections::BTreeMap;

use super::outline::SeenSurface;

/// The surface with the vertices of every cube of `cell_mm` at that of the cube's first vertex.
pub(super) fn coarse(surface: &SeenSurface, cell_mm: f64) -> SeenSurface {
    let (vertices, triangles) = surface.surface();
    let mut first: BTreeMap<[i64; 3], u32> = BTreeMap::new();
    let mut kept = Vec::new();
    let mut merged = Vec::with_capacity(vertices.len());
    for v in vertices {
        let cell = v.map(|c| (c / cell_mm).floor() as i64).into();
        let number = *first.entry(cell).or_insert_with(|| {
            kept.push(*v);
            kept.len() as u32 - 1
        });
        merged.push(number);
    }
    let moved = triangles.iter().map(|t| t.map(|v| merged[v as usize]));
    let triangles = moved.filter(|[a, b, c]| a != b && b != c && c != a).collect();
    SeenSurface::new(kept, triangles)
}
