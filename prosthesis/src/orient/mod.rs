//! How a part lies in its block: the published procedure and the least residual area.
//!
//! The residual area of a plane is the bounding rectangle of the part's projection less the projection's own area: material that
//! is cut away for nothing. [`published`] turns the part in one plane after the other in equal steps (Castelli et al. 2020, section
//! 3); [`least_residual`] takes the exact rectangle of each plane by rotating calipers and then refines all three angles together.
//!
//! Invariants: the part's longest side lies along x and its shortest along y, unless it is laid as given; its outer, convex side
//! faces +y; [`least_residual`] is never worse than [`published`] by the sum of the three areas. The refinement is local: from
//! several starts it goes downhill, and does not prove that no other orientation is better.

mod coarse;
mod outline;
mod published;
mod refined;

use bonemill_geometry::{Block, Mesh, Part, Rigid};
use nalgebra::{Matrix3, Rotation3, Vector3};

pub use outline::{ProjectionPlane, SeenSurface};
pub use published::{ANGLE_STEP_RAD, OrientationRun, published};
pub use refined::least_residual;

/// Areas cut away for nothing, by the plane of projection, mm².
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Residual {
    /// Plane of x and y.
    pub xy_mm2: f64,
    /// Plane of x and z.
    pub xz_mm2: f64,
    /// Plane of y and z.
    pub yz_mm2: f64,
}

impl Residual {
    /// All three.
    pub fn sum_mm2(&self) -> f64 {
        self.xy_mm2 + self.xz_mm2 + self.yz_mm2
    }
}

/// A part in its block's frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Laid {
    /// Where the block's frame is in the part's.
    pub block_from_part: Rigid<Block, Part>,
    /// Sides of the part's bounding box along x, y and z, mm.
    pub size_mm: Vector3<f64>,
    /// Residual areas.
    pub residual: Residual,
}

impl Laid {
    /// The part turned by `rotation`, its bounding box around the origin.
    pub fn turned(mesh: &Mesh<Part>, surface: &SeenSurface, rotation: &Rotation3<f64>) -> Self {
        let (low, high) = bounds(mesh, rotation);
        Self {
            block_from_part: Rigid::new(*rotation, -(low + high) / 2.0),
            size_mm: high - low,
            residual: surface.residual(rotation),
        }
    }

    /// The part as its file gives it.
    pub fn as_given(mesh: &Mesh<Part>, surface: &SeenSurface) -> Self {
        Self::turned(mesh, surface, &Rotation3::identity())
    }
}

/// Corners of the bounding box of the turned mesh, mm.
fn bounds(mesh: &Mesh<Part>, rotation: &Rotation3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let far = Vector3::repeat(f64::INFINITY);
    let points = mesh.vertices.iter().map(|v| rotation * v.coords);
    points.fold((far, -far), |(low, high), p| (low.inf(&p), high.sup(&p)))
}

/// The rotation after which the longest side lies along x, the shortest along y, and the convex side faces +y.
fn sides_in_order(mesh: &Mesh<Part>, rotation: &Rotation3<f64>) -> Rotation3<f64> {
    let (low, high) = bounds(mesh, rotation);
    let size = high - low;
    let mut axes = [0, 1, 2];
    axes.sort_by(|&a, &b| size[b].total_cmp(&size[a]).then(a.cmp(&b)));
    let [longest, middle, shortest] = axes.map(|a| Vector3::ith(a, 1.0));
    // x = longest, y = shortest, z right-handed; the middle one's sense follows
    let z = longest.cross(&shortest);
    let z = if z.dot(&middle) > 0.0 { middle } else { -middle };
    let order = Rotation3::from_matrix_unchecked(Matrix3::from_rows(&[
        longest.transpose(),
        shortest.transpose(),
        z.transpose(),
    ]));
    outer_side_up(mesh, &(order * rotation))
}

/// The same orientation with the outer side, toward which the part bulges, facing +y: half a turn about x where needed.
fn outer_side_up(mesh: &Mesh<Part>, rotation: &Rotation3<f64>) -> Rotation3<f64> {
    let (low, high) = bounds(mesh, rotation);
    let middle = (low + high) / 2.0;
    // a bulge toward +y has its far points, away from the middle, at small y
    let moments = mesh.vertices.iter().map(|v| rotation * v.coords - middle);
    let samples: Vec<(f64, f64)> = moments.map(|p| (p.x * p.x + p.z * p.z, p.y)).collect();
    let count = samples.len().max(1) as f64;
    let (far, height) = samples.iter().fold((0.0, 0.0), |(f, h), s| (f + s.0, h + s.1));
    let covariance: f64 = samples.iter().map(|s| (s.0 - far / count) * (s.1 - height / count)).sum();
    if covariance > 0.0 { half_turn() * rotation } else { *rotation }
}

/// Half a turn about x, without rounding.
fn half_turn() -> Rotation3<f64> {
    Rotation3::from_matrix_unchecked(Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0)))
}

#[cfg(test)]
mod tests;
