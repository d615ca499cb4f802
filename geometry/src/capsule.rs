//! Capsules: every point within a radius of a segment. Distances between them have a closed form.
//!
//! A capsule is convex, so it holds a triangle if it holds the three corners.

use nalgebra::Vector3;

use crate::{Frame, Point, Rigid};

/// Every point within `radius_mm` of the segment from `from` to `to`, in frame `F`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Capsule<F: Frame> {
    /// One end of the axis.
    pub from: Point<F>,
    /// The other end; the same point for a ball.
    pub to: Point<F>,
    /// Radius, mm.
    pub radius_mm: f64,
}

impl<F: Frame> Capsule<F> {
    /// The capsule about the segment between two points, mm.
    pub const fn new(from_mm: [f64; 3], to_mm: [f64; 3], radius_mm: f64) -> Self {
        let [a, b, c] = from_mm;
        let [d, e, f] = to_mm;
        Self { from: Point::new(a, b, c), to: Point::new(d, e, f), radius_mm }
    }

    /// The middle of the axis.
    pub fn middle(&self) -> Point<F> {
        Point::from_coords(0.5 * (self.from.coords + self.to.coords))
    }

    /// Length of the axis, mm.
    pub fn length_mm(&self) -> f64 {
        self.from.distance_mm(&self.to)
    }

    /// Distance of a point from the capsule's surface, mm; negative inside.
    pub fn distance_mm(&self, p: &Point<F>) -> f64 {
        point_segment_mm(&p.coords, &self.from.coords, &self.to.coords) - self.radius_mm
    }

    /// Distance between the surfaces of two capsules, mm; where they overlap, less the depth along the shortest way between
    /// their axes.
    pub fn to_capsule_mm(&self, other: &Self) -> f64 {
        let axes = [&self.from.coords, &self.to.coords];
        let others = [&other.from.coords, &other.to.coords];
        segments_mm(axes, others) - self.radius_mm - other.radius_mm
    }

    /// The capsule in another frame.
    pub fn moved<To: Frame>(&self, to_from_f: &Rigid<To, F>) -> Capsule<To> {
        Capsule { from: *to_from_f * self.from, to: *to_from_f * self.to, radius_mm: self.radius_mm }
    }
}

/// Squared distance of `p` from the segment a–b.
pub fn segment_distance_squared(p: &Vector3<f64>, a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    let along = b - a;
    let length_squared = along.norm_squared();
    let t = if length_squared > 0.0 { ((p - a).dot(&along) / length_squared).clamp(0.0, 1.0) } else { 0.0 };
    (p - a - along * t).norm_squared()
}

/// Distance of a point from a segment, mm.
pub fn point_segment_mm(p: &Vector3<f64>, from: &Vector3<f64>, to: &Vector3<f64>) -> f64 {
    segment_distance_squared(p, from, to).sqrt()
}

/// Distance between two segments, mm.
///
/// The squared distance is a convex quadratic in both shares, so its least value in the unit square is found by clamping one
/// share, solving for the other, clamping it, and solving for the first again.
///
/// **Source:** Ericson 2005, Real-Time Collision Detection, 5.1.9.
pub fn segments_mm(a: [&Vector3<f64>; 2], b: [&Vector3<f64>; 2]) -> f64 {
    let (u, v, w) = (a[1] - a[0], b[1] - b[0], a[0] - b[0]);
    let (uu, vv, uv) = (u.norm_squared(), v.norm_squared(), u.dot(&v));
    let (uw, vw) = (u.dot(&w), v.dot(&w));
    if uu <= 0.0 {
        return point_segment_mm(a[0], b[0], b[1]);
    }
    if vv <= 0.0 {
        return point_segment_mm(b[0], a[0], a[1]);
    }
    let square = uu * vv - uv * uv;
    // nearly parallel segments: any share of the first will do, because ends are tried below
    let s = if square > 1e-12 * uu * vv { ((uv * vw - uw * vv) / square).clamp(0.0, 1.0) } else { 0.0 };
    let t = ((uv * s + vw) / vv).clamp(0.0, 1.0);
    let s = ((uv * t - uw) / uu).clamp(0.0, 1.0);
    let inner = (w + u * s - v * t).norm();
    if square > 1e-6 * uu * vv {
        return inner;
    }
    let ends = [
        point_segment_mm(a[0], b[0], b[1]),
        point_segment_mm(a[1], b[0], b[1]),
        point_segment_mm(b[0], a[0], a[1]),
        point_segment_mm(b[1], a[0], a[1]),
    ];
    ends.into_iter().fold(inner, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Base;

    /// Numbers in −1..1, the same each time.
    fn stream(seed: u64) -> impl FnMut() -> f64 {
        let mut state = seed;
        move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        }
    }

    /// The least distance of two segments by samples of the first, each with its exact distance to the second; the samples'
    /// spacing is halved about the best one.
    fn searched_mm(a: [&Vector3<f64>; 2], b: [&Vector3<f64>; 2]) -> f64 {
        let (mut low, mut high, mut least) = (0.0, 1.0, f64::INFINITY);
        for _ in 0..60 {
            let at = |n: usize| low + (high - low) * n as f64 / 8.0;
            let mm = |s: f64| point_segment_mm(&(a[0] + (a[1] - a[0]) * s), b[0], b[1]);
            let best = (0..=8).min_by(|m, n| mm(at(*m)).total_cmp(&mm(at(*n)))).unwrap();
            least = f64::min(least, mm(at(best)));
            (low, high) = (at(best.saturating_sub(1)), at((best + 1).min(8)));
        }
        least
    }

    #[test]
    fn the_closed_form_of_two_segments_is_the_searched_minimum() {
        let mut next = stream(1);
        for n in 0..20_000 {
            let mut point = || Vector3::new(next(), next(), next()) * 100.0;
            let (p, q, r) = (point(), point(), point());
            // a quarter is parallel or nearly so, a quarter has a segment of no length
            let s = match n % 4 {
                0 => r + (q - p) * 0.7 + point() * 1e-7 * f64::from(n % 8),
                1 => r,
                _ => point(),
            };
            let (found, searched) = (segments_mm([&p, &q], [&r, &s]), searched_mm([&p, &q], [&r, &s]));
            assert!((found - searched).abs() < 1e-6, "{n}: {found} {searched}");
            assert!((found - segments_mm([&r, &s], [&q, &p])).abs() < 1e-6);
        }
    }

    #[test]
    fn a_capsule_holds_what_is_nearer_to_its_axis_than_its_radius() {
        let capsule = Capsule::<Base>::new([0.0; 3], [0.0, 0.0, 10.0], 2.0);
        assert_eq!(capsule.distance_mm(&Point::new(0.0, 3.0, 5.0)), 1.0);
        assert_eq!(capsule.distance_mm(&Point::new(0.0, 0.0, 13.0)), 1.0);
        assert_eq!(capsule.distance_mm(&Point::new(0.0, 0.0, 5.0)), -2.0);
        let beside = Capsule::new([5.0, 0.0, 0.0], [5.0, 9.0, 0.0], 1.0);
        assert_eq!(capsule.to_capsule_mm(&beside), 2.0);
        assert_eq!(capsule.length_mm(), 10.0);
    }
}
