//! A cylinder with flat ends on rows of voxels; all lengths are in voxels.

use std::ops::Range;

use nalgebra::Vector3;

use super::clip;

/// If the axis' slope against the layers is below this, the cylinder's ellipse in a layer is not computed, and its box is
/// used instead.
const LEAST_SLOPE: f64 = 0.1;
/// Margin for the rounding of an extent, voxels.
const ROUNDING: f64 = 1e-6;

/// A cylinder about the line from `start` along d, |d| > 0, where w·d lies between two numbers, with w from the start.
#[derive(Debug)]
pub(super) struct Cylinder {
    start: Vector3<f64>,
    along: Vector3<f64>,
    between: [f64; 2],
    radius_squared: f64,
    /// Values for every row, computed once: 1/|d|², 1/d.x, the quadratic coefficient 1 − d.x²/|d|² and its inverse.
    per_length_squared: f64,
    per_along_x: f64,
    quadratic: f64,
    per_quadratic: f64,
}

impl Cylinder {
    pub(super) fn new(start: Vector3<f64>, along: Vector3<f64>, between: [f64; 2], radius: f64) -> Self {
        let per_length_squared = 1.0 / along.norm_squared();
        let quadratic = 1.0 - along.x * along.x * per_length_squared;
        Self {
            start,
            along,
            between,
            radius_squared: radius * radius,
            per_length_squared,
            per_along_x: 1.0 / along.x,
            quadratic,
            per_quadratic: 1.0 / quadratic,
        }
    }

    /// The interval of x in which (x, y, z) lies in the cylinder: |w|² − (w·d)²/|d|² ≤ r², limited to the range of w·d.
    #[inline]
    pub(super) fn chord(&self, y: f64, z: f64) -> Option<(f64, f64)> {
        let (d, [first, last]) = (&self.along, self.between);
        let (wy, wz) = (y - self.start.y, z - self.start.z);
        let side = wy * d.y + wz * d.z;
        let (mut lo, mut hi) = if d.x.abs() < 1e-12 {
            // the axis is perpendicular to the row: the whole row or no part of it lies between the ends
            if !(first..=last).contains(&side) {
                return None;
            }
            (f64::NEG_INFINITY, f64::INFINITY)
        } else {
            let (s0, s1) = ((first - side) * self.per_along_x, (last - side) * self.per_along_x);
            (s0.min(s1), s0.max(s1))
        };
        let half_linear = -d.x * side * self.per_length_squared;
        let constant = wy * wy + wz * wz - side * side * self.per_length_squared - self.radius_squared;
        if self.quadratic < 1e-12 {
            // the axis is along the row: the row is inside or outside as a whole
            if constant > 0.0 {
                return None;
            }
        } else {
            let discriminant = half_linear * half_linear - self.quadratic * constant;
            if discriminant < 0.0 {
                return None;
            }
            let root = discriminant.sqrt();
            lo = lo.max((-half_linear - root) * self.per_quadratic);
            hi = hi.min((-half_linear + root) * self.per_quadratic);
        }
        (lo <= hi).then_some((self.start.x + lo, self.start.x + hi))
    }
}

/// Bounds of the rows that a cylinder may meet, and of the part of each row, with a margin for rounding.
#[derive(Debug)]
pub(super) struct Outline {
    start: Vector3<f64>,
    /// The cylinder's bounding box.
    extent: [(f64, f64); 3],
    /// Displacement of the infinite cylinder's ellipse along x and y from layer to layer, and half the size of the ellipse's
    /// box; infinite where the axis is too flat.
    per_layer: [f64; 2],
    half: [f64; 2],
}

impl Outline {
    /// The outline of the cylinder of `radius` about `start` + t·axis (unit) for t between two values.
    pub(super) fn new(start: Vector3<f64>, axis: &Vector3<f64>, between: [f64; 2], radius: f64) -> Self {
        let across = |a: usize| (1.0 - axis[a] * axis[a]).max(0.0).sqrt();
        let extent = [0, 1, 2].map(|a| {
            let disc = radius * across(a) + ROUNDING;
            let [s, t] = between.map(|at| start[a] + at * axis[a]);
            (s.min(t) - disc, s.max(t) + disc)
        });
        let (per_layer, half) = if axis.z.abs() > LEAST_SLOPE {
            let per_z = 1.0 / axis.z;
            let half = [1, 0].map(|other| radius * across(other) * per_z.abs() + ROUNDING);
            ([axis.x * per_z, axis.y * per_z], half)
        } else {
            ([0.0; 2], [f64::INFINITY; 2])
        };
        Self { start, extent, per_layer, half }
    }

    /// The layers along z that it may meet, of `n`.
    pub(super) fn layers(&self, n: usize) -> Range<usize> {
        clip(self.extent[2].0, self.extent[2].1, n)
    }

    /// The voxels along x and y that it may meet in layer `z`.
    #[inline]
    pub(super) fn in_layer(&self, z: f64, dims: [usize; 3]) -> [Range<usize>; 2] {
        [0, 1].map(|a| {
            let ((lo, hi), half) = (self.extent[a], self.half[a]);
            let middle = self.start[a] + (z - self.start.z) * self.per_layer[a];
            clip(lo.max(middle - half), hi.min(middle + half), dims[a])
        })
    }
}
