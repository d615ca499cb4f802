//! What a cutter sweeps when it turns once: a solid of revolution, and what that sweeps when it moves.
//!
//! Its profile is a polyline (z, r) along the axis; between two points it is a frustum. Everything here is exact for that polyline:
//! inside or not, the distance of the surface, and whether a straight move passes a point. Makers of curved profiles choose chords
//! fine enough and say by how much they are off. Directions of the axis do not change within a move.

use std::f64::consts::PI;

use bonemill_geometry::{Point, Tool};
use nalgebra::Vector3;

use crate::cutter::CutterError;

mod mesh;

/// More points than this are no profile.
const MOST_POINTS: usize = 10_000;
/// Pieces of a ball's meridian: chords off by 5e-5 of its radius.
const BALL_PIECES: usize = 160;

/// A closed solid of revolution about the tool's z axis.
#[derive(Debug, Clone, PartialEq)]
pub struct SolidOfRevolution {
    /// (z, r), mm, z rising.
    profile: Vec<[f64; 2]>,
    max_radius_mm: f64,
}

impl SolidOfRevolution {
    /// The solid with this profile of points [z, r], mm: z does not fall, and rises in all; r is 0 or more, and not 0 everywhere.
    /// Flat discs close both ends.
    ///
    /// # Errors
    /// [`CutterError::Profile`] with the first point that is wrong.
    pub fn new(profile: &[[f64; 2]]) -> Result<Self, CutterError> {
        let wrong = |index: usize, expected| {
            let [z_mm, r_mm] = profile.get(index).copied().unwrap_or_default();
            Err(CutterError::Profile { index, z_mm, r_mm, expected })
        };
        if profile.len() < 2 || profile.len() > MOST_POINTS {
            return wrong(0, "2 to 10 000 points");
        }
        for (index, [z, r]) in profile.iter().enumerate() {
            if !(z.abs() <= 1e4 && (0.0..=1e3).contains(r)) {
                return wrong(index, "z within ±10 000 mm and r from 0 to 1000 mm");
            }
            if index > 0 && *z < profile[index - 1][0] {
                return wrong(index, "z not below that of the point before");
            }
        }
        let max_radius_mm = profile.iter().map(|p| p[1]).fold(0.0, f64::max);
        if profile[profile.len() - 1][0] <= profile[0][0] || max_radius_mm <= 0.0 {
            return wrong(profile.len() - 1, "a solid with a height and a radius");
        }
        Ok(Self { profile: profile.to_vec(), max_radius_mm })
    }

    /// A ball about the origin.
    ///
    /// # Errors
    /// [`CutterError::Profile`] for a radius that is not from above 0 to 1000 mm.
    pub fn ball(radius_mm: f64) -> Result<Self, CutterError> {
        let point = |n: usize| {
            let (sin, cos) = (PI * n as f64 / BALL_PIECES as f64).sin_cos();
            [-radius_mm * cos, radius_mm * sin.max(0.0)]
        };
        Self::new(&(0..=BALL_PIECES).map(point).collect::<Vec<_>>())
    }

    /// Points [z, r] of its profile, mm, z rising.
    pub fn profile(&self) -> &[[f64; 2]] {
        &self.profile
    }

    /// Its largest radius, mm.
    pub fn max_radius_mm(&self) -> f64 {
        self.max_radius_mm
    }

    /// Where it starts and ends along the axis, mm.
    pub fn z_range_mm(&self) -> [f64; 2] {
        [self.profile[0][0], self.profile[self.profile.len() - 1][0]]
    }

    /// Its volume, mm³.
    pub fn volume_mm3(&self) -> f64 {
        let frustum =
            |[[z0, r0], [z1, r1]]: [[f64; 2]; 2]| PI / 3.0 * (z1 - z0) * (r0 * r0 + r0 * r1 + r1 * r1);
        self.pieces().map(frustum).sum()
    }

    /// Its radius at a height, mm; at a step the larger; `None` beyond its ends.
    pub fn radius_at_mm(&self, z_mm: f64) -> Option<f64> {
        let at = |[[z0, r0], [z1, r1]]: [[f64; 2]; 2]| {
            (z0 <= z_mm && z_mm <= z1)
                .then(|| if z1 > z0 { r0 + (r1 - r0) * (z_mm - z0) / (z1 - z0) } else { r0.max(r1) })
        };
        self.pieces().filter_map(at).reduce(f64::max)
    }

    /// The lowest height at which its radius is at least this, mm; its top where it never is.
    pub fn front_height_mm(&self, radius_mm: f64) -> f64 {
        let mut before: Option<[f64; 2]> = None;
        for &[z, r] in &self.profile {
            if r >= radius_mm {
                return match before {
                    Some([z0, r0]) if r > r0 && r0 < radius_mm => z0 + (z - z0) * (radius_mm - r0) / (r - r0),
                    _ => z,
                };
            }
            before = Some([z, r]);
        }
        self.z_range_mm()[1]
    }

    /// Whether a point lies in it.
    pub fn contains(&self, p: Point<Tool>) -> bool {
        let radius2 = p.x() * p.x() + p.y() * p.y();
        self.radius_at_mm(p.z()).is_some_and(|r| radius2 <= r * r)
    }

    /// Distance of its surface, mm; negative inside.
    pub fn signed_distance_mm(&self, p: Point<Tool>) -> f64 {
        self.signed_distance_at_mm(p.x().hypot(p.y()), p.z())
    }

    /// The same for a point at a radius and height, mm.
    pub fn signed_distance_at_mm(&self, radius_mm: f64, z_mm: f64) -> f64 {
        let [bottom, top] = [self.profile[0], self.profile[self.profile.len() - 1]];
        let discs = [[[bottom[0], 0.0], bottom], [[top[0], 0.0], top]];
        let nearest2 = self.pieces().chain(discs).map(|piece| distance2(piece, [z_mm, radius_mm]));
        let distance = nearest2.fold(f64::INFINITY, f64::min).sqrt();
        let inside = self.radius_at_mm(z_mm).is_some_and(|r| radius_mm <= r);
        if inside { -distance } else { distance }
    }

    /// Whether the solid passes the point `p` on a straight move: `p` in tool coordinates at the end of the move, `way_mm` from start
    /// to end, both with the axis along z.
    ///
    /// Each frustum is convex in the parameter of the move: |p_xy + s v_xy|² − r(z)² is a quadratic in s over an interval of s.
    pub fn sweep_contains(&self, p: Point<Tool>, way_mm: Vector3<f64>) -> bool {
        let (x2, xv, v2) = (
            p.x() * p.x() + p.y() * p.y(),
            p.x() * way_mm.x + p.y() * way_mm.y,
            way_mm.x * way_mm.x + way_mm.y * way_mm.y,
        );
        // a quick no: beyond the largest radius all the way
        let nearest = if v2 > 0.0 { (-xv / v2).clamp(0.0, 1.0) } else { 0.0 };
        if x2 + nearest * (2.0 * xv + nearest * v2) > self.max_radius_mm * self.max_radius_mm {
            return false;
        }
        self.pieces().filter(|[a, b]| b[0] > a[0]).any(|[[z0, r0], [z1, r1]]| {
            let Some([from, to]) = interval(p.z(), way_mm.z, z0, z1) else { return false };
            let slope = (r1 - r0) / (z1 - z0);
            let (r, rv) = (r0 + slope * (p.z() - z0), slope * way_mm.z);
            let [a, b, c] = [v2 - rv * rv, xv - r * rv, x2 - r * r];
            let value = |s: f64| c + s * (2.0 * b + s * a);
            let vertex = if a > 0.0 { (-b / a).clamp(from, to) } else { from };
            value(from) <= 0.0 || value(to) <= 0.0 || value(vertex) <= 0.0
        })
    }

    /// What it sweeps when it moves by `length_mm` towards its tip, in tool coordinates at the end.
    ///
    /// Exact where the radius rises to one largest value and falls again; a notch is taken for swept.
    #[must_use]
    pub fn swept_towards_tip(&self, length_mm: f64) -> Self {
        let widest = self.profile.iter().position(|p| p[1] >= self.max_radius_mm).unwrap_or(0);
        let mut swept: Vec<[f64; 2]> = Vec::with_capacity(self.profile.len() + 1);
        let mut most = 0f64;
        for [z, r] in &self.profile[..=widest] {
            most = most.max(*r);
            swept.push([*z, most]);
        }
        let mut rest = Vec::new();
        let mut most = 0f64;
        for [z, r] in self.profile[widest..].iter().rev() {
            most = most.max(*r);
            rest.push([*z + length_mm.max(0.0), most]);
        }
        swept.extend(rest.into_iter().rev());
        Self { profile: swept, max_radius_mm: self.max_radius_mm }
    }

    fn pieces(&self) -> impl Iterator<Item = [[f64; 2]; 2]> + '_ {
        self.profile.windows(2).map(|w| [w[0], w[1]])
    }
}

/// Squared distance of a point of the half-plane from a segment.
fn distance2([a, b]: [[f64; 2]; 2], p: [f64; 2]) -> f64 {
    let (along, from) = ([b[0] - a[0], b[1] - a[1]], [p[0] - a[0], p[1] - a[1]]);
    let length2 = along[0] * along[0] + along[1] * along[1];
    let dot = along[0] * from[0] + along[1] * from[1];
    let s = if length2 > 0.0 { (dot / length2).clamp(0.0, 1.0) } else { 0.0 };
    (from[0] - s * along[0]).powi(2) + (from[1] - s * along[1]).powi(2)
}

/// The part of 0..1 in which z + s v lies from z0 to z1.
fn interval(z: f64, v: f64, z0: f64, z1: f64) -> Option<[f64; 2]> {
    if v == 0.0 {
        return (z0 <= z && z <= z1).then_some([0.0, 1.0]);
    }
    let (a, b) = ((z0 - z) / v, (z1 - z) / v);
    let (from, to) = (a.min(b).max(0.0), a.max(b).min(1.0));
    (from <= to).then_some([from, to])
}

#[cfg(test)]
mod tests;
