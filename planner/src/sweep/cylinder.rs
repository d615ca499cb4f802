//! A straight piece of a cylinder with flat ends on rows of voxels: what a part of a shank holds.

use nalgebra::Vector3;
use std::ops::Range;

use super::clip;

/// Steeper than this against z, the lines across which a cylinder meets a layer are not looked for: the box does.
const LEAST_SLOPE: f64 = 0.1;
/// What rounding may take from an extent, voxels.
const ROUNDING: f64 = 1e-6;

/// A cylinder along `axis` (unit) through `center`, between two places on the axis; in voxel units.
#[derive(Debug)]
pub(super) struct Cylinder {
    pub center: Vector3<f64>,
    pub axis: Vector3<f64>,
    /// The ends, places on the axis from the centre.
    pub ends: [f64; 2],
    pub radius: f64,
}

/// A layer of voxels that a cylinder meets.
pub(super) struct Layer {
    /// The rows that it may meet, and the places in them; a hair more.
    pub rows: Range<usize>,
    pub places: Range<usize>,
}

impl Cylinder {
    /// Layers along z that it may meet, of `n`.
    pub(super) fn layers(&self, n: usize) -> Range<usize> {
        let (lo, hi) = self.extent(2);
        clip(lo, hi, n)
    }

    /// Where it lies along an axis of the grid.
    fn extent(&self, a: usize) -> (f64, f64) {
        let disc = self.radius * (1.0 - self.axis[a] * self.axis[a]).max(0.0).sqrt() + ROUNDING;
        let [s, t] = self.ends.map(|at| self.center[a] + at * self.axis[a]);
        (s.min(t) - disc, s.max(t) + disc)
    }

    /// What of layer `z` it may meet: the box of the ellipse in which the endless cylinder does, within its own box.
    pub(super) fn layer(&self, z: f64, dims: [usize; 3]) -> Layer {
        let d = &self.axis;
        let range = |a: usize| {
            let (mut lo, mut hi) = self.extent(a);
            if d.z.abs() > LEAST_SLOPE {
                let other = d[1 - a];
                let middle = self.center[a] + (z - self.center.z) * d[a] / d.z;
                let half = self.radius * (1.0 - other * other).max(0.0).sqrt() / d.z.abs() + ROUNDING;
                (lo, hi) = (lo.max(middle - half), hi.min(middle + half));
            }
            clip(lo, hi, dims[a])
        };
        Layer { rows: range(1), places: range(0) }
    }

    /// The interval of x in which (x, y, z) lies in it: |w|² − (w·d)² ≤ r², cut to the ends' w·d, with w from the centre.
    #[inline]
    pub(super) fn chord(&self, y: f64, z: f64) -> Option<(f64, f64)> {
        let d = &self.axis;
        let (wy, wz) = (y - self.center.y, z - self.center.z);
        let side = wy * d.y + wz * d.z;
        let constant = wy * wy + wz * wz - side * side - self.radius * self.radius;
        let quadratic = 1.0 - d.x * d.x;
        let (mut lo, mut hi) = if quadratic < 1e-12 {
            // along the row: inside or outside as a whole
            if constant > 0.0 {
                return None;
            }
            (f64::NEG_INFINITY, f64::INFINITY)
        } else {
            let half_linear = d.x * side;
            let discriminant = half_linear * half_linear - quadratic * constant;
            if discriminant < 0.0 {
                return None;
            }
            let (root, per) = (discriminant.sqrt(), 1.0 / quadratic);
            ((half_linear - root) * per, (half_linear + root) * per)
        };
        let [s, t] = self.ends;
        if d.x.abs() < 1e-12 {
            if !(s..=t).contains(&side) {
                return None;
            }
        } else {
            let (s, t) = ((s - side) / d.x, (t - side) / d.x);
            (lo, hi) = (lo.max(s.min(t)), hi.min(s.max(t)));
        }
        (lo <= hi).then_some((self.center.x + lo, self.center.x + hi))
    }
}
