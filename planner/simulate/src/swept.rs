//! The burr's recent path behind it: decides which nodes of the burr's surface lie outside the volume that it has swept.

use nalgebra::{Unit, Vector3};

use super::lattice::{crossing, share};
use super::trail::TrailPiece;

impl TrailPiece {
    /// Whether the burr continues along this piece's line; then the piece covers no part of the burr's front.
    pub(super) fn leads_to(&self, center: &Vector3<f64>, feed: &Unit<Vector3<f64>>) -> bool {
        const STRAIGHT_MM: f64 = 1e-9;
        let (along, onwards) = (self.to - self.from, center - self.to);
        along.dot(feed) > 0.0
            && onwards.dot(feed) >= 0.0
            && along.cross(feed).norm() <= STRAIGHT_MM
            && onwards.cross(feed).norm() <= STRAIGHT_MM
    }
}

/// A piece, prepared for tests of the points center + normal·radius, which differ only in their normal.
pub(super) struct SweptPiece {
    /// Vector from its start to the centre, and vector along it, mm.
    from_start: Vector3<f64>,
    along: Vector3<f64>,
    /// Squared length of the first vector plus the squared radius; squared length of the second, and its inverse (0 for a point).
    squared: f64,
    along2: f64,
    per_along2: f64,
    radius_mm: f64,
    is_own: bool,
}

impl SweptPiece {
    pub(super) fn new(piece: &TrailPiece, center: &Vector3<f64>, radius_mm: f64) -> Self {
        let (from_start, along) = (center - piece.from, piece.to - piece.from);
        let along2 = along.norm_squared();
        Self {
            from_start,
            along,
            squared: from_start.norm_squared() + radius_mm * radius_mm,
            along2,
            per_along2: if along2 > 0.0 { 1.0 / along2 } else { 0.0 },
            radius_mm,
            is_own: piece.is_own,
        }
    }

    /// The share of the patch around the point with this normal that lies outside the capsule.
    ///
    /// On the burr's own recent surface there is no edge: a node is either inside or outside. If the burr continues straight,
    /// every node is outside.
    #[inline]
    pub(super) fn part_outside(&self, normal: &Vector3<f64>, radius_mm: f64, half_mm: f64) -> f64 {
        let along = self.from_start.dot(&self.along) + self.radius_mm * normal.dot(&self.along);
        let t = (along * self.per_along2).clamp(0.0, 1.0);
        let squared = self.squared + 2.0 * self.radius_mm * normal.dot(&self.from_start)
            - t * (2.0 * along - t * self.along2);
        if self.is_own {
            // when the burr is at the same place again, its points lie on the earlier surface; up to rounding they count as inside
            return if squared <= radius_mm * radius_mm * (1.0 + 1e-12) { 0.0 } else { 1.0 };
        }
        if squared >= (radius_mm + half_mm).powi(2) {
            return 1.0;
        }
        let depth = squared.max(0.0).sqrt() - radius_mm;
        if depth <= -half_mm {
            return 0.0;
        }
        let outwards = self.from_start + normal * self.radius_mm - self.along * t;
        share(depth, half_mm, crossing(&outwards, normal), 1e-9 * radius_mm)
    }
}
