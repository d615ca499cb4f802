//! The signed distance to a cutter: a cylinder without upper end whose lower edge is rounded.
//!
//! It is the set {r ≤ R − r_c, h ≥ r_c} grown by r_c, h above the tip and r from the axis; so its distance is that of the set, less r_c:
//! d = √(max(r − R', 0)² + max(−h', 0)²) + min(max(r − R', −h'), 0) − r_c with R' = R − r_c, h' = h − r_c. It is convex.

use nalgebra::Vector3;

/// How closely a place on a motion is sought, mm.
const PLACE_MM: f64 = 5e-4;

/// A cutter by its radii, mm.
#[derive(Debug, Clone, Copy)]
pub struct CutterShape {
    /// Radius, mm.
    pub radius_mm: f64,
    /// Radius of the corner, mm.
    pub corner_mm: f64,
}

impl CutterShape {
    /// Signed distance of a point, given from the tip in the machine's axes, mm.
    pub fn distance_mm(&self, from_tip: &Vector3<f64>) -> f64 {
        let length = |a: f64, b: f64| (a * a + b * b).sqrt();
        let r = length(from_tip.x, from_tip.y) - (self.radius_mm - self.corner_mm);
        let below = self.corner_mm - from_tip.z;
        length(r.max(0.0), below.max(0.0)) + r.max(below).min(0.0) - self.corner_mm
    }

    /// Signed distance of a point to what the cutter sweeps on a straight motion, mm.
    ///
    /// The distance to a convex body is convex along a straight line, so a golden section finds its minimum.
    pub fn swept_mm(&self, point: &Vector3<f64>, from: &Vector3<f64>, to: &Vector3<f64>) -> f64 {
        let along = to - from;
        let at = |t: f64| self.distance_mm(&(point - from - along * t));
        let across2 = along.x * along.x + along.y * along.y;
        if along.z == 0.0 {
            // level: the nearest place of the axis
            let t = if across2 > 0.0 {
                ((point - from).xy().dot(&along.xy()) / across2).clamp(0.0, 1.0)
            } else {
                0.0
            };
            return at(t);
        }
        let golden = 0.5 * (5f64.sqrt() - 1.0);
        let (mut low, mut high) = (0.0, 1.0);
        let (mut a, mut b) = (1.0 - golden, golden);
        let (mut at_a, mut at_b) = (at(a), at(b));
        let length = along.norm();
        while (high - low) * length > PLACE_MM {
            if at_a < at_b {
                (high, b, at_b) = (b, a, at_a);
                a = high - golden * (high - low);
                at_a = at(a);
            } else {
                (low, a, at_a) = (a, b, at_b);
                b = low + golden * (high - low);
                at_b = at(b);
            }
        }
        at_a.min(at_b).min(at(0.0)).min(at(1.0))
    }
}
