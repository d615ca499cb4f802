//! Facets as a file gives them: nothing is checked but that they can be computed with.

use nalgebra::Vector3;

use super::{FacetPlace, PartError};

/// Most facets of a part. A file of 50 bytes a facet is then 500 MB.
pub const MOST_FACETS: usize = 10_000_000;
/// Largest coordinate, in the file's unit: µm of a part of 1 m.
const LARGEST_COORDINATE: f64 = 1e6;

/// Triangles on shared or repeated vertices, in the file's unit.
#[derive(Debug, Clone, PartialEq)]
pub struct Facets {
    /// Vertices.
    pub vertices: Vec<Vector3<f64>>,
    /// Three vertex numbers a facet; counter-clockwise seen from outside, if the file is right.
    pub triangles: Vec<[u32; 3]>,
    /// Each facet's number in the file, from 0: facets are dropped and added, messages name those of the file.
    pub(crate) numbers: Vec<u32>,
}

impl Facets {
    /// Facets in the order of a file.
    pub fn new(vertices: Vec<[f64; 3]>, triangles: Vec<[u32; 3]>) -> Self {
        let numbers = (0..u32::try_from(triangles.len()).unwrap_or(u32::MAX)).collect();
        Self { vertices: vertices.into_iter().map(Vector3::from).collect(), triangles, numbers }
    }

    /// Whether every facet can be computed with.
    ///
    /// # Errors
    /// [`PartError::Empty`], [`PartError::TooManyFacets`], [`PartError::NoSuchVertex`], [`PartError::Coordinate`].
    pub(crate) fn check(&self) -> Result<(), PartError> {
        if self.triangles.is_empty() {
            return Err(PartError::Empty);
        }
        if self.triangles.len() > MOST_FACETS {
            return Err(PartError::TooManyFacets { found: self.triangles.len(), most: MOST_FACETS });
        }
        for (facet, triangle) in self.triangles.iter().enumerate() {
            for &vertex in triangle {
                let Some(at) = self.vertices.get(vertex as usize).copied() else {
                    let count = self.vertices.len();
                    return Err(PartError::NoSuchVertex { facet, vertex: vertex.into(), count });
                };
                if !at.iter().all(|c| c.abs() < LARGEST_COORDINATE) {
                    return Err(PartError::Coordinate { facet, at: at.into() });
                }
            }
        }
        Ok(())
    }

    /// Longest side of the bounding box of the facets, in the file's unit.
    pub(crate) fn length(&self) -> f64 {
        let mut corners = self.triangles.iter().flatten().map(|&v| self.vertices[v as usize]);
        let first = corners.next().unwrap_or_default();
        let (low, high) = corners.fold((first, first), |(low, high), p| (low.inf(&p), high.sup(&p)));
        (high - low).max()
    }

    /// The facet's corners.
    pub(crate) fn corners(&self, facet: usize) -> [Vector3<f64>; 3] {
        self.triangles[facet].map(|v| self.vertices[v as usize])
    }

    /// The facet's area, in the unit's square.
    pub(crate) fn area(&self, facet: usize) -> f64 {
        let [a, b, c] = self.corners(facet);
        0.5 * (b - a).cross(&(c - a)).norm()
    }

    /// The facet's number in the file and its first corner.
    pub(crate) fn place(&self, facet: usize) -> FacetPlace {
        FacetPlace { facet: self.numbers[facet], at_mm: self.corners(facet)[0].into() }
    }

    /// Drops the vertices that no facet has: they have no place in the part's size.
    pub(crate) fn drop_unused_vertices(&mut self) {
        let mut is_used = vec![false; self.vertices.len()];
        self.triangles.iter().flatten().for_each(|v| is_used[*v as usize] = true);
        let mut count = 0;
        let number: Vec<u32> = (is_used.iter())
            .map(|used| {
                count += u32::from(*used);
                count.wrapping_sub(1)
            })
            .collect();
        let mut used = is_used.iter();
        self.vertices.retain(|_| used.next().is_some_and(|used| *used));
        self.triangles.iter_mut().flatten().for_each(|v| *v = number[*v as usize]);
    }

    /// Keeps the facets for which `keep` holds; how many were dropped.
    pub(crate) fn retain(&mut self, keep: impl Fn(usize) -> bool) -> usize {
        let before = self.triangles.len();
        let kept: Vec<usize> = (0..before).filter(|&f| keep(f)).collect();
        if kept.len() < before {
            self.triangles = kept.iter().map(|&f| self.triangles[f]).collect();
            self.numbers = kept.iter().map(|&f| self.numbers[f]).collect();
        }
        before - kept.len()
    }
}
