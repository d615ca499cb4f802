//! The direction in which the target sees the most air, when the case gives none.
//!
//! From a sample of the target's voxels, rays are cast through the CT; a ray sees air when it enters air, or leaves the
//! scan where neither bone nor target lies at its edge, without meeting untargeted bone or a structure. The direction is the mean of all that see air, weighted towards
//! the best one (a mean shift on the sphere). Directions are laid out in the target's own inertia axes, so a mirrored
//! or turned scan gives the mirrored or turned approach.

use bonemill_geometry::{Ct, Point};
use nalgebra::{Matrix3, Vector3};

/// Rays cast from each sampled voxel.
const DIRECTIONS: usize = 400;
/// Target voxels that cast rays.
const SOURCES: usize = 250;
/// Half-width of the mean shift's cone, rad.
const CONE_RAD: f64 = 0.6;

/// The approach for `target` (voxel centres), or `None` when no ray gets out.
///
/// `blocked(p)`: p is untargeted bone or structure; `open(p)`: p is air or beyond the scan.
pub(super) fn most_air(
    target: &[Point<Ct>],
    step_mm: f64,
    reach_mm: f64,
    blocked: impl Fn(Point<Ct>) -> bool,
    open: impl Fn(Point<Ct>) -> bool,
) -> Option<Vector3<f64>> {
    let axes = inertia_axes(target);
    let directions: Vec<_> = sphere(DIRECTIONS).map(|d| axes * d).collect();
    let stride = target.len().div_ceil(SOURCES).max(1);
    let steps = (reach_mm / step_mm) as usize;
    let sees = |from: Point<Ct>, d: &Vector3<f64>| {
        for n in 1..=steps {
            let p = from + d * (n as f64 * step_mm);
            if blocked(p) {
                return false;
            }
            if open(p) && n as f64 * step_mm > 2.0 * step_mm {
                return true;
            }
        }
        false
    };
    let score: Vec<f64> = directions
        .iter()
        .map(|d| target.iter().step_by(stride).filter(|p| sees(**p, d)).count() as f64)
        .collect();
    // within a cone, so that one lucky ray does not decide
    let smooth = |about: &Vector3<f64>| -> (f64, Vector3<f64>) {
        let mut sum = (0.0, Vector3::zeros());
        for (d, s) in directions.iter().zip(&score) {
            let angle = d.dot(about).clamp(-1.0, 1.0).acos();
            let weight = s * (1.0 - (angle / CONE_RAD).powi(2)).max(0.0);
            sum.0 += weight;
            sum.1 += d * weight;
        }
        sum
    };
    let best = directions.iter().max_by(|a, b| smooth(a).0.total_cmp(&smooth(b).0))?;
    let mut about = *best;
    for _ in 0..30 {
        let (total, mean) = smooth(&about);
        if total <= 0.0 {
            return None;
        }
        about = mean.try_normalize(1e-12)?;
    }
    Some(about)
}

/// Near-uniform unit directions (Fibonacci).
fn sphere(n: usize) -> impl Iterator<Item = Vector3<f64>> {
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    (0..n).map(move |i| {
        let z = 1.0 - (2 * i + 1) as f64 / n as f64;
        let r = (1.0 - z * z).sqrt();
        let (s, c) = (golden * i as f64).sin_cos();
        Vector3::new(r * c, r * s, z)
    })
}

/// Principal axes as columns, each turned to where the third moment is positive: they mirror with the points.
fn inertia_axes(points: &[Point<Ct>]) -> Matrix3<f64> {
    let n = points.len().max(1) as f64;
    let mean = points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / n;
    let covariance = points
        .iter()
        .map(|p| {
            let d = p.coords - mean;
            d * d.transpose()
        })
        .sum::<Matrix3<f64>>()
        / n;
    let eigen = covariance.symmetric_eigen();
    let mut order = [0, 1, 2];
    order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
    let columns = order.map(|c| {
        let axis: Vector3<f64> = eigen.eigenvectors.column(c).into_owned();
        let skew: f64 = points.iter().map(|p| (p.coords - mean).dot(&axis).powi(3)).sum();
        if skew < 0.0 { -axis } else { axis }
    });
    Matrix3::from_columns(&columns)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;

    /// A skewed lump in a half-space of bone: air beyond a plane.
    fn lump(turn: Matrix3<f64>) -> (Vec<Point<Ct>>, Vector3<f64>) {
        let points = (0..6000)
            .map(|n| Vector3::new((n % 30) as f64 * 0.4, (n / 30 % 20) as f64 * 0.3, (n / 600) as f64 * 0.25))
            .filter(|p| p.x + 2.0 * p.y < 14.0 && p.z + 0.3 * p.x < 4.0)
            .map(|p| Point::from_coords(turn * p))
            .collect();
        (points, turn * Vector3::new(0.2, -0.1, 1.0).normalize())
    }

    fn approach(turn: Matrix3<f64>) -> (Vector3<f64>, Vector3<f64>) {
        let (points, normal) = lump(turn);
        let plane = 4.0; // just above the lump
        let targets: Vec<Vector3<f64>> = points.iter().map(|p| p.coords).collect();
        let is_target = |p: Point<Ct>| targets.iter().any(|t| (t - p.coords).norm_squared() < 0.12);
        let found = most_air(
            &points,
            0.5,
            30.0,
            |p| p.coords.dot(&normal) < plane && !is_target(p),
            |p| p.coords.dot(&normal) > plane + 0.5,
        );
        (found.unwrap(), normal)
    }

    #[test]
    fn points_out_of_the_half_space_and_turns_and_mirrors_with_it() {
        let (straight, normal) = approach(Matrix3::identity());
        assert!(straight.dot(&normal) > 0.9, "{straight} {normal}");
        let turn = Rotation3::new(Vector3::new(0.7, -0.3, 1.1)).into_inner();
        let mirror = Matrix3::from_diagonal(&Vector3::new(-1.0, 1.0, 1.0));
        for change in [turn, mirror, turn * mirror] {
            let (turned, _) = approach(change);
            assert!(
                (change * straight).angle(&turned) < 0.035,
                "off by {} rad",
                (change * straight).angle(&turned)
            );
        }
    }

    #[test]
    fn walled_in_is_none() {
        let (points, _) = lump(Matrix3::identity());
        assert_eq!(most_air(&points, 0.5, 30.0, |_| true, |_| false), None);
    }
}
