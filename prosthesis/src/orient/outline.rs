//! The outline of a closed surface seen along an axis, its area and its hull.
//!
//! The facets that face the viewer form a sheet whose border is the silhouette: the edges between facets that face the viewer and
//! facets that do not. A point is covered by the projection exactly where the border winds around it, so the outline is the
//! union of a few loops (non-zero winding) instead of that of all facets.

use bonemill_geometry::{Mesh, Part};
use geo::ConvexHull;
use i_overlay::core::fill_rule::FillRule;
use i_overlay::float::simplify::SimplifyShape;
use nalgebra::{Rotation3, Vector3};
use rayon::prelude::*;

use super::Residual;

/// A plane of projection.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ProjectionPlane {
    /// x and y, seen along z.
    Xy,
    /// x and z, seen along y.
    Xz,
    /// z and y, seen along x.
    Yz,
}

impl ProjectionPlane {
    /// All, in the order in which they are turned.
    pub const ALL: [Self; 3] = [Self::Xy, Self::Xz, Self::Yz];

    /// The two axes: along the first the longer side is to lie.
    pub(super) fn axes(self) -> [usize; 2] {
        match self {
            Self::Xy => [0, 1],
            Self::Xz => [0, 2],
            Self::Yz => [2, 1],
        }
    }

    /// The rotation that turns the first axis toward the second by `angle_rad`.
    pub(super) fn turn(self, angle_rad: f64) -> Rotation3<f64> {
        let [u, v] = self.axes().map(|axis| Vector3::ith(axis, 1.0));
        Rotation3::new(u.cross(&v) * angle_rad)
    }
}

/// The projection of a part on a plane.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Outline {
    /// Area, holes left out, mm².
    pub area_mm2: f64,
    /// Corners of its convex hull, counter-clockwise, mm.
    pub hull_mm: Vec<[f64; 2]>,
}

impl Outline {
    /// Sides of the bounding rectangle after the outline is turned by `angle_rad`, mm.
    pub(crate) fn sides_mm(&self, angle_rad: f64) -> [f64; 2] {
        let (sin, cos) = angle_rad.sin_cos();
        let turned = self.hull_mm.iter().map(|[u, v]| [cos * u - sin * v, sin * u + cos * v]);
        let far = [f64::INFINITY; 2];
        let (low, high) = turned.fold((far, far.map(|f| -f)), |(low, high), p| {
            ([low[0].min(p[0]), low[1].min(p[1])], [high[0].max(p[0]), high[1].max(p[1])])
        });
        [high[0] - low[0], high[1] - low[1]]
    }

    /// Bounding rectangle less projection, mm².
    pub(crate) fn residual_mm2(&self, angle_rad: f64) -> f64 {
        let [w, h] = self.sides_mm(angle_rad);
        w * h - self.area_mm2
    }
}

/// A closed surface, ready to be seen from any side.
#[derive(Debug, Clone)]
pub struct SeenSurface {
    vertices: Vec<Vector3<f64>>,
    triangles: Vec<[u32; 3]>,
    /// Every facet's normal, of any length.
    normals: Vec<Vector3<f64>>,
    /// Every edge's two vertices, the facet that runs from the first to the second, and the one that runs back; where more than two facets meet,
    /// an edge for every two.
    edges: Vec<[u32; 4]>,
}

impl SeenSurface {
    /// Of a closed surface that faces outwards.
    pub fn of(mesh: &Mesh<Part>) -> Self {
        Self::new(mesh.vertices.iter().map(|v| v.coords).collect(), mesh.triangles.clone())
    }

    pub(super) fn new(vertices: Vec<Vector3<f64>>, triangles: Vec<[u32; 3]>) -> Self {
        // a side as it is run through, and as its edge is named
        let side = |f: usize, k: usize| {
            let [a, b] = [triangles[f][k], triangles[f][(k + 1) % 3]];
            (a > b, [a.min(b), a.max(b)], f as u32)
        };
        let mut sides: Vec<_> = (0..triangles.len()).flat_map(|f| [0, 1, 2].map(|k| side(f, k))).collect();
        sides.par_sort_unstable();
        // on a closed surface as many facets run one way as the other, so both halves have the same edges in the same order
        let (forward, back) = sides.split_at(sides.partition_point(|side| !side.0));
        let edges = forward.iter().zip(back).map(|(f, b)| [f.1[0], f.1[1], f.2, b.2]).collect();
        let corner = |v: u32| vertices[v as usize];
        let normal = |[a, b, c]: &[u32; 3]| (corner(*b) - corner(*a)).cross(&(corner(*c) - corner(*a)));
        Self { normals: triangles.iter().map(normal).collect(), vertices, triangles, edges }
    }

    pub(super) fn surface(&self) -> (&[Vector3<f64>], &[[u32; 3]]) {
        (&self.vertices, &self.triangles)
    }

    /// Residual areas of the part turned by `rotation`.
    pub fn residual(&self, rotation: &Rotation3<f64>) -> Residual {
        let area_mm2 = |plane| self.outline(rotation, plane).residual_mm2(0.0);
        let (xy_mm2, (xz_mm2, yz_mm2)) = rayon::join(
            || area_mm2(ProjectionPlane::Xy),
            || rayon::join(|| area_mm2(ProjectionPlane::Xz), || area_mm2(ProjectionPlane::Yz)),
        );
        Residual { xy_mm2, xz_mm2, yz_mm2 }
    }

    /// The outline on `plane` of the part turned by `rotation`.
    pub(crate) fn outline(&self, rotation: &Rotation3<f64>, plane: ProjectionPlane) -> Outline {
        bonemill_geometry::cancel::poll();
        let [u, v] = plane.axes().map(|axis| rotation.matrix().row(axis).transpose());
        let flat = |n: &u32| [u.dot(&self.vertices[*n as usize]), v.dot(&self.vertices[*n as usize])];
        let loops = chained(self.border(&u.cross(&v)));
        let contours: Vec<Vec<[f64; 2]>> = loops.iter().map(|l| l.iter().map(flat).collect()).collect();
        let shapes = contours.simplify_shape(FillRule::NonZero);
        let area_mm2 = shapes.iter().flatten().map(|contour| gauss_area(contour)).sum::<f64>().abs();
        Outline { area_mm2, hull_mm: hull(&contours) }
    }

    /// Directed edges around the facets that face a viewer from `toward`.
    fn border(&self, toward: &Vector3<f64>) -> Vec<[u32; 2]> {
        let faces: Vec<bool> = self.normals.iter().map(|normal| normal.dot(toward) > 0.0).collect();
        let directed = |&[a, b, forward, back]: &[u32; 4]| match [forward, back].map(|f| faces[f as usize]) {
            [true, false] => Some([a, b]),
            [false, true] => Some([b, a]),
            _ => None,
        };
        self.edges.iter().filter_map(directed).collect()
    }
}

/// Directed edges as closed loops; every vertex has as many edges in as out.
fn chained(mut edges: Vec<[u32; 2]>) -> Vec<Vec<u32>> {
    edges.sort_unstable();
    let from = |v: u32, edges: &[[u32; 2]]| edges.partition_point(|e| e[0] < v);
    // how many edges of the vertex at this place are used up, kept at its first edge
    let mut used = vec![0_usize; edges.len()];
    let mut loops = Vec::new();
    for start in 0..edges.len() {
        let first = from(edges[start][0], &edges);
        if start - first < used[first] {
            continue;
        }
        let (mut at, mut vertices) = (edges[start][0], Vec::new());
        loop {
            let first = from(at, &edges);
            let Some(edge) = edges.get(first + used.get(first).copied().unwrap_or(0)).filter(|e| e[0] == at)
            else {
                break;
            };
            used[first] += 1;
            vertices.push(at);
            at = edge[1];
        }
        loops.push(vertices);
    }
    loops
}

/// Signed area of a closed polygon by Gauss's formula, ½ Σ (uᵢ vᵢ₊₁ − uᵢ₊₁ vᵢ), mm².
fn gauss_area(points: &[[f64; 2]]) -> f64 {
    let Some(&[u0, v0]) = points.first() else { return 0.0 };
    // about the first point, so that far polygons lose no digits
    let about = |p: &[f64; 2]| [p[0] - u0, p[1] - v0];
    let pairs = points.iter().zip(points.iter().cycle().skip(1));
    0.5 * pairs.map(|(p, q)| (about(p), about(q))).map(|(p, q)| p[0] * q[1] - q[0] * p[1]).sum::<f64>()
}

fn hull(contours: &[Vec<[f64; 2]>]) -> Vec<[f64; 2]> {
    let points: Vec<geo::Point<f64>> =
        contours.iter().flatten().map(|p| geo::Point::new(p[0], p[1])).collect();
    let polygon = geo::MultiPoint::new(points).convex_hull();
    let mut corners: Vec<[f64; 2]> = polygon.exterior().coords().map(|c| [c.x, c.y]).collect();
    // the ring repeats its first corner
    corners.pop();
    corners
}
