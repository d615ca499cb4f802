//! The bodies that phantoms are made of, as signed distances in mm, negative inside.
//!
//! All of them are 1-Lipschitz except [`Ellipsoid`] and the flanks of a tapering [`Tube`], so a value is never larger than
//! the true distance. Whatever must keep a clearance is built from the 1-Lipschitz ones only.

use nalgebra::Vector3;

pub(super) type V3 = Vector3<f64>;

/// A tube along a polyline, its radius linear between knots, its ends round.
#[derive(Debug, Clone)]
pub(super) struct Tube {
    segments: Vec<Segment>,
    /// A box around the tube: its centre and half its size.
    bounds: (V3, V3),
}

#[derive(Debug, Clone)]
struct Segment {
    from: V3,
    along: V3,
    inverse_square: f64,
    radius: f64,
    growth: f64,
}

impl Tube {
    /// A tube through the knots (point, radius), mm, in straight pieces. Two equal neighbouring knots give a ball.
    pub(super) fn straight(knots: &[(V3, f64)]) -> Self {
        let segment = |w: &[(V3, f64)]| {
            let along = w[1].0 - w[0].0;
            let inverse_square = 1.0 / along.norm_squared().max(1e-12);
            Segment { from: w[0].0, along, inverse_square, radius: w[0].1, growth: w[1].1 - w[0].1 }
        };
        let corner = |sign: f64, pick: fn(&V3, &V3) -> V3| {
            let first = V3::repeat(-sign * f64::MAX);
            knots.iter().fold(first, |all, (p, r)| pick(&all, &p.add_scalar(sign * r)))
        };
        let (lo, hi) = (corner(-1.0, V3::inf), corner(1.0, V3::sup));
        let bounds = (lo * 0.5 + hi * 0.5, hi * 0.5 - lo * 0.5);
        Self { segments: knots.windows(2).map(segment).collect(), bounds }
    }

    /// A tube along a Catmull-Rom curve through the knots, in `pieces` straight pieces between two knots.
    pub(super) fn curved(knots: &[(V3, f64)], pieces: usize) -> Self {
        let knot = |i: isize| knots[i.clamp(0, knots.len() as isize - 1) as usize];
        let mut points = Vec::with_capacity(knots.len() * pieces + 1);
        for i in 0..knots.len() as isize - 1 {
            let (a, b, c, d) = (knot(i - 1), knot(i), knot(i + 1), knot(i + 2));
            for n in 0..pieces {
                let t = n as f64 / pieces as f64;
                let curve = b.0
                    + (c.0 - a.0) * (0.5 * t)
                    + (a.0 * 2.0 - b.0 * 5.0 + c.0 * 4.0 - d.0) * (0.5 * t * t)
                    + (b.0 * 3.0 - a.0 - c.0 * 3.0 + d.0) * (0.5 * t * t * t);
                points.push((curve, b.1 + (c.1 - b.1) * t));
            }
        }
        points.push(knot(knots.len() as isize - 1));
        Self::straight(&points)
    }

    /// Signed distance, mm; infinite for a tube without segments.
    pub(super) fn distance(&self, p: &V3) -> f64 {
        self.segments.iter().map(|s| s.distance(p)).fold(f64::INFINITY, f64::min)
    }

    /// Whether `p` is inside.
    pub(super) fn contains(&self, p: &V3) -> bool {
        self.outside_bounds(p) <= 0.0 && self.distance(p) <= 0.0
    }

    /// A lower bound of the distance, mm: positive outside the box around the tube.
    fn outside_bounds(&self, p: &V3) -> f64 {
        ((p - self.bounds.0).abs() - self.bounds.1).max()
    }

    /// The part of the tube whose distance from `center` is below `reach_mm`.
    pub(super) fn near(&self, center: &V3, reach_mm: f64) -> Self {
        let outside = self.outside_bounds(center);
        let near = |s: &&Segment| outside < reach_mm && s.distance(center) < reach_mm;
        Self { segments: self.segments.iter().filter(near).cloned().collect(), bounds: self.bounds }
    }
}

impl Segment {
    fn distance(&self, p: &V3) -> f64 {
        let from = p - self.from;
        let t = (from.dot(&self.along) * self.inverse_square).clamp(0.0, 1.0);
        (from - self.along * t).norm() - (self.radius + self.growth * t)
    }
}

/// A ring.
#[derive(Debug, Clone)]
pub(super) struct Torus {
    pub(super) center: V3,
    /// Unit normal of the ring's plane.
    pub(super) normal: V3,
    /// Radius of the centre line, mm.
    pub(super) major_mm: f64,
}

impl Torus {
    /// Signed distance of the ring whose tube has radius `minor_mm`, mm.
    pub(super) fn distance(&self, p: &V3, minor_mm: f64) -> f64 {
        let from = p - self.center;
        let height = from.dot(&self.normal);
        let in_plane = (from - self.normal * height).norm();
        let off = in_plane - self.major_mm;
        (off * off + height * height).sqrt() - minor_mm
    }
}

/// An ellipsoid along the axes. Its distance is a first-order estimate, used for painting only.
#[derive(Debug, Clone)]
pub(super) struct Ellipsoid {
    pub(super) center: V3,
    pub(super) radii: V3,
}

impl Ellipsoid {
    /// Signed distance, mm, to first order near the surface.
    pub(super) fn distance(&self, p: &V3) -> f64 {
        let q = (p - self.center).component_div(&self.radii);
        let (k, slope) = (q.norm(), q.component_div(&self.radii).norm());
        if slope < 1e-9 { -self.radii.min() } else { k * (k - 1.0) / slope }
    }
}

/// Intersection of bodies with its edges rounded to about `radius_mm`: the part of the sharp intersection that a ball of
/// that radius can reach, exactly where two planes meet at a right angle. It is never larger than the sharp intersection.
pub(super) fn rounded_intersection(distances: &[f64], radius_mm: f64) -> f64 {
    let deepest = distances.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let square: f64 = distances.iter().map(|d| (d + radius_mm).max(0.0).powi(2)).sum();
    deepest.min(-radius_mm) + square.sqrt()
}

/// Share of a voxel that a body covers, from the signed distance of the voxel's centre.
pub(super) fn coverage(distance_mm: f64, spacing_mm: f64) -> f64 {
    (0.5 - distance_mm / spacing_mm).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tube_is_a_capsule_and_a_curve_passes_its_knots() {
        let (a, b) = (V3::new(0.0, 0.0, 0.0), V3::new(10.0, 0.0, 0.0));
        let capsule = Tube::straight(&[(a, 1.0), (b, 2.0)]);
        assert!((capsule.distance(&V3::new(5.0, 4.0, 0.0)) - 2.5).abs() < 1e-12);
        assert!((capsule.distance(&V3::new(13.0, 4.0, 0.0)) - 3.0).abs() < 1e-12);
        let knots = [(a, 1.0), (V3::new(5.0, 5.0, 1.0), 0.5), (b, 1.0), (V3::new(12.0, -3.0, 2.0), 1.0)];
        let curve = Tube::curved(&knots, 8);
        for (p, r) in knots {
            assert!((curve.distance(&p) + r).abs() < 0.1, "{p}");
        }
    }

    #[test]
    fn a_torus_and_an_ellipsoid_measure_their_distance() {
        let ring = Torus { center: V3::zeros(), normal: V3::z(), major_mm: 3.0 };
        assert!((ring.distance(&V3::new(0.0, 6.0, 4.0), 1.0) - 4.0).abs() < 1e-12);
        let egg = Ellipsoid { center: V3::zeros(), radii: V3::new(2.0, 3.0, 4.0) };
        assert!((egg.distance(&V3::new(2.1, 0.0, 0.0)) - 0.1).abs() < 0.01);
        assert!(egg.distance(&V3::zeros()) < -1.9);
    }

    #[test]
    fn a_rounded_corner_is_a_quarter_circle_inside_the_sharp_one() {
        // the corner of x < 0 and y < 0 with radius 2 is an arc around (-2, -2)
        let corner = |x: f64, y: f64| rounded_intersection(&[x, y], 2.0);
        let diagonal = -2.0 + 2.0 * 0.5f64.sqrt();
        assert!(corner(diagonal, diagonal).abs() < 1e-12);
        assert!((corner(0.5, -9.0) - 0.5).abs() < 1e-12 && (corner(-3.0, -9.0) + 3.0).abs() < 1e-12);
        for (x, y) in [(-0.1, -0.1), (1.0, 2.0), (-5.0, -1.0)] {
            assert!(corner(x, y) >= x.max(y));
        }
    }
}
