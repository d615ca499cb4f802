//! One vertex for every place: corners that are equal, and on open edges those that are nearly so, become the same vertex.

use std::collections::HashMap;

use nalgebra::Vector3;
use rayon::prelude::*;

use super::Facets;
use super::edges::Edges;

/// Joins vertices with equal coordinates; vertices that no facet uses vanish. Numbers follow the coordinates, so that the result
/// does not depend on the order of vertices in the file.
pub(crate) fn weld_equal(facets: &mut Facets) {
    // + 0.0 makes −0 a plain 0
    let key = |v: u32| facets.vertices[v as usize].map(|c| ordered(c + 0.0));
    let mut corners: Vec<([u64; 3], u32)> = (facets.triangles.par_iter().enumerate())
        .flat_map_iter(|(f, t)| {
            t.iter().enumerate().map(move |(k, &v)| (key(v).into(), 3 * f as u32 + k as u32))
        })
        .collect();
    corners.par_sort_unstable();
    let mut vertices = Vec::with_capacity(corners.len() / 5);
    let mut triangles = facets.triangles.clone();
    let mut last = None;
    for (key, corner) in corners {
        let (facet, k) = (corner as usize / 3, corner as usize % 3);
        if last != Some(key) {
            vertices.push(facets.vertices[facets.triangles[facet][k] as usize]);
            last = Some(key);
        }
        triangles[facet][k] = vertices.len() as u32 - 1;
    }
    (facets.vertices, facets.triangles) = (vertices, triangles);
}

/// Bits that sort as the number does.
fn ordered(number: f64) -> u64 {
    let bits = number.to_bits();
    if bits >> 63 == 0 { bits | 1 << 63 } else { !bits }
}

/// Joins vertices of open edges that lie within `tolerance_mm` of an earlier one; how many moved, and how far at most, mm.
pub(crate) fn weld_open(facets: &mut Facets, edges: &Edges, tolerance_mm: f64) -> (usize, f64) {
    let mut open: Vec<u32> = edges.open().flat_map(|h| edges.ends(facets, h)).collect();
    open.sort_unstable();
    open.dedup();
    let cell = |p: &Vector3<f64>| p.map(|c| (c / tolerance_mm).floor() as i64);
    let mut kept: HashMap<[i64; 3], Vec<u32>> = HashMap::new();
    let mut moved_to: HashMap<u32, u32> = HashMap::new();
    let mut largest_mm = 0.0_f64;
    for v in open {
        let p = facets.vertices[v as usize];
        let near = neighbours(cell(&p)).filter_map(|c| kept.get(&c)).flatten();
        let best = near
            .map(|&w| ((facets.vertices[w as usize] - p).norm(), w))
            .filter(|(d, _)| *d <= tolerance_mm)
            .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        match best {
            Some((distance_mm, w)) => {
                largest_mm = largest_mm.max(distance_mm);
                moved_to.insert(v, w);
            }
            None => kept.entry(cell(&p).into()).or_default().push(v),
        }
    }
    for v in facets.triangles.iter_mut().flatten() {
        *v = moved_to.get(v).copied().unwrap_or(*v);
    }
    (moved_to.len(), largest_mm)
}

/// A cell and those around it.
fn neighbours(cell: Vector3<i64>) -> impl Iterator<Item = [i64; 3]> {
    (0..27).map(move |n| (cell + Vector3::new(n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1)).into())
}
