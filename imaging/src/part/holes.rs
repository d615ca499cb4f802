//! Holes: loops of open edges, filled by the triangulation of least area when they are small.
//!
//! **Source:** Barequet and Sharir 1995, Filling gaps in the boundary of a polyhedron: dynamic programming over the loop's arcs.

use std::collections::BTreeMap;

use nalgebra::Vector3;

use super::edges::{Edges, next};
use super::{Change, Facets, PartError};

/// Most edges around a hole that is filled; the triangulation takes their number cubed.
const MOST_EDGES: usize = 128;

/// Fills every hole whose perimeter is at most `most_mm`; facets agree in their sense already.
///
/// # Errors
/// [`PartError::Open`] for a larger one.
pub(crate) fn fill(facets: &mut Facets, edges: &Edges, most_mm: f64) -> Result<Option<Change>, PartError> {
    let loops = loops(facets, edges);
    if loops.is_empty() {
        return Ok(None);
    }
    let before = facets.triangles.len();
    let mut longest_perimeter_mm = 0.0_f64;
    for hole in &loops {
        let points: Vec<Vector3<f64>> = hole.vertices.iter().map(|&v| facets.vertices[v as usize]).collect();
        let perimeter_mm = perimeter(&points);
        let place = facets.place(hole.beside as usize);
        if perimeter_mm > most_mm || points.len() > MOST_EDGES {
            return Err(PartError::Open {
                edges: points.len(),
                perimeter_mm,
                most_mm,
                most_edges: MOST_EDGES,
                place,
            });
        }
        longest_perimeter_mm = longest_perimeter_mm.max(perimeter_mm);
        for triangle in least_area(&points) {
            facets.triangles.push(triangle.map(|n| hole.vertices[n]));
            facets.numbers.push(place.facet);
        }
    }
    let area_mm2 = (before..facets.triangles.len()).map(|f| facets.area(f)).sum();
    let facets = facets.triangles.len() - before;
    Ok(Some(Change::HolesFilled { holes: loops.len(), facets, area_mm2, longest_perimeter_mm }))
}

struct Hole {
    /// Around the hole, in the sense in which its new facets run.
    vertices: Vec<u32>,
    /// A facet beside it.
    beside: u32,
}

/// The loops of open edges, each in the sense opposite to its facets'.
fn loops(facets: &Facets, edges: &Edges) -> Vec<Hole> {
    let mut left: BTreeMap<u32, ()> = edges.open().map(|h| (h, ())).collect();
    let mut loops = Vec::new();
    while let Some((first, ())) = left.pop_first() {
        let mut vertices = vec![edges.ends(facets, first)[0]];
        let mut h = following(edges, first);
        // a loop is as long as there are open edges at most
        while h != first && left.remove(&h).is_some() {
            vertices.push(edges.ends(facets, h)[0]);
            h = following(edges, h);
        }
        vertices.reverse();
        loops.extend(simple(vertices).into_iter().map(|vertices| Hole { vertices, beside: first / 3 }));
    }
    loops
}

/// A loop cut where it comes to a vertex again: holes that meet at a vertex are holes of their own.
fn simple(around: Vec<u32>) -> Vec<Vec<u32>> {
    let (mut loops, mut way) = (Vec::new(), Vec::<u32>::new());
    for vertex in around {
        if let Some(n) = way.iter().position(|v| *v == vertex) {
            loops.push(way.split_off(n));
        }
        way.push(vertex);
    }
    loops.push(way);
    loops
}

/// The open half-edge that begins where this one ends, on the same side of the surface.
fn following(edges: &Edges, h: u32) -> u32 {
    let mut g = next(h);
    while let Some(twin) = edges.twin(g) {
        g = next(twin);
    }
    g
}

fn perimeter(points: &[Vector3<f64>]) -> f64 {
    points.iter().zip(points.iter().cycle().skip(1)).map(|(a, b)| (b - a).norm()).sum()
}

/// The triangulation of a loop with the least area: numbers of its points.
fn least_area(points: &[Vector3<f64>]) -> Vec<[usize; 3]> {
    let n = points.len();
    let area =
        |i: usize, k: usize, j: usize| 0.5 * (points[k] - points[i]).cross(&(points[j] - points[i])).norm();
    // best[i][j]: area and middle corner of the best triangulation of the arc from i to j
    let mut best = vec![vec![(0.0, 0); n]; n];
    for length in 2..n {
        for i in 0..n - length {
            let j = i + length;
            let through = |k: usize| (best[i][k].0 + area(i, k, j) + best[k][j].0, k);
            let choice = (i + 1..j).map(through).min_by(|a, b| a.0.total_cmp(&b.0));
            best[i][j] = choice.unwrap_or_default();
        }
    }
    let (mut triangles, mut arcs) = (Vec::new(), vec![(0, n.saturating_sub(1))]);
    while let Some((i, j)) = arcs.pop() {
        if j >= i + 2 {
            let k = best[i][j].1;
            triangles.push([i, k, j]);
            arcs.extend([(i, k), (k, j)]);
        }
    }
    triangles
}
