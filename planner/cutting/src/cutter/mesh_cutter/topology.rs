//! Which facets meet at which edge of a closed mesh.

use bonemill_geometry::{Mesh, Tool};
use nalgebra::Vector3;

use crate::cutter::CutterError;

/// An edge of two facets: its ends, and the facets in which it runs from the first to the second and back.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct FacetEdge {
    pub ends: [u32; 2],
    pub facets: [u32; 2],
}

/// All edges of a closed mesh, by their ends.
pub(super) struct Topology {
    pub edges: Vec<FacetEdge>,
}

impl Topology {
    /// # Errors
    /// [`CutterError::Facet`] for a facet without area in its vertices, [`CutterError::NotClosed`] for an edge that is not
    /// shared by exactly two facets in opposite senses.
    pub fn new(triangles: &[[u32; 3]], vertices: usize) -> Result<Self, CutterError> {
        let mut sides = Vec::with_capacity(3 * triangles.len());
        for (n, t) in triangles.iter().enumerate() {
            if t[0] == t[1] || t[1] == t[2] || t[2] == t[0] || t.iter().any(|v| *v as usize >= vertices) {
                return Err(CutterError::Facet { facet: n });
            }
            for side in 0..3 {
                let (a, b) = (t[side], t[(side + 1) % 3]);
                sides.push((a.min(b), a.max(b), a > b, n as u32));
            }
        }
        sides.sort_unstable();
        let mut edges = Vec::with_capacity(sides.len() / 2);
        for group in sides.chunk_by(|x, y| (x.0, x.1) == (y.0, y.1)) {
            let [forth, back] = group else { return Err(open(group)) };
            if forth.2 == back.2 {
                return Err(open(group));
            }
            edges.push(FacetEdge { ends: [forth.0, forth.1], facets: [forth.3, back.3] });
        }
        Ok(Self { edges })
    }
}

fn open(group: &[(u32, u32, bool, u32)]) -> CutterError {
    CutterError::NotClosed {
        facet: group[0].3 as usize,
        vertices: [group[0].0, group[0].1],
        facets: group.len(),
    }
}

/// Corners of a facet.
pub(super) fn corners(mesh: &Mesh<Tool>, facet: u32) -> [Vector3<f64>; 3] {
    mesh.triangles[facet as usize].map(|v| mesh.vertices[v as usize].coords)
}

/// Outward unit normal of a facet; `None` for one without area.
pub(super) fn normal(mesh: &Mesh<Tool>, facet: u32) -> Option<Vector3<f64>> {
    let [a, b, c] = corners(mesh, facet);
    (b - a).cross(&(c - a)).try_normalize(1e-14)
}
