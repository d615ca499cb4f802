//! The clearance with which a structure is not touched with a given probability.

use bonemill_geometry::{Ct, Point};
use statrs::distribution::{ChiSquared, ContinuousCDF, Normal};

use super::{RigidError, UncertaintyError, kept, not_negative};

/// The clearance with which every plan that keeps it leaves the structure untouched with probability `keep`, mm.
///
/// c = √(χ²_k⁻¹(1 − β)) · max σ(x) + Φ⁻¹(1 − β') σ_s, where σ(x) is the largest standard deviation of the registration's error
/// at a point x of the structure, k the error's rank, and σ_s the standard deviation of the boundary; β = β' = (1 − keep)/2, or
/// β = 1 − keep for the only error if there is just one. With probability 1 − β the rigid error lies in its ellipsoid. Then
/// every point moves by at most √χ² σ(x), in any direction, so a burr that stays c away does not touch the structure.
///
/// `structure`: points of its surface, ct; `boundary_sigma_mm` ≥ 0; `keep` 0.5 to below 1.
///
/// # Errors
/// [`UncertaintyError::Value`] for numbers out of range.
///
/// **Source:** the ellipsoid bound is Scheffé 1953; margins from registration uncertainty: Siebold et al. 2016.
pub fn clearance_mm(
    registration: &RigidError,
    boundary_sigma_mm: f64,
    structure: impl IntoIterator<Item = Point<Ct>>,
    keep: f64,
) -> Result<f64, UncertaintyError> {
    let boundary = not_negative("boundary sigma, mm", boundary_sigma_mm)?;
    let miss = 1.0 - kept(keep)?;
    let rank = registration.rank();
    let worst = structure.into_iter().map(|p| registration.worst_sigma_mm(p)).fold(0.0, f64::max);
    let moves = rank > 0 && worst > 0.0;
    let miss = if moves && boundary > 0.0 { 0.5 * miss } else { miss };
    let by_registration =
        ChiSquared::new(rank.max(1) as f64).map_or(f64::INFINITY, |chi2| chi2.inverse_cdf(1.0 - miss).sqrt());
    let by_boundary = Normal::standard().inverse_cdf(1.0 - miss);
    Ok(if moves { by_registration * worst } else { 0.0 } + by_boundary.max(0.0) * boundary)
}

#[cfg(test)]
mod tests {
    use super::super::draws::Draws;
    use super::*;

    const ABOUT: Point<Ct> = Point::new(0.0, 0.0, 0.0);

    #[test]
    fn one_direction_and_no_error_are_textbook() {
        let one = RigidError::of_sigmas([0.5, 0.0, 0.0], [0.0; 3], ABOUT).unwrap();
        // √χ²₁⁻¹(0.95) = 1.959964
        let found = clearance_mm(&one, 0.0, [ABOUT], 0.95).unwrap();
        assert!((found - 0.5 * 1.959_964).abs() < 1e-5, "{found}");
        let none = RigidError::of_sigmas([0.0; 3], [0.0; 3], ABOUT).unwrap();
        assert_eq!(clearance_mm(&none, 0.0, [ABOUT], 0.95).unwrap(), 0.0);
        let found = clearance_mm(&none, 0.4, [ABOUT], 0.95).unwrap();
        assert!((found - 0.4 * 1.644_854).abs() < 1e-5, "{found}");
        assert!(clearance_mm(&none, -1.0, [ABOUT], 0.95).is_err());
        assert!(clearance_mm(&none, 0.1, [ABOUT], 1.0).is_err());
    }

    #[test]
    fn a_burr_at_that_clearance_on_every_side_touches_no_more_often() {
        // a ball of 2 mm around a far point, approached from all sides
        let error = RigidError::of_sigmas([0.2, 0.1, 0.3], [0.004, 0.01, 0.002], ABOUT).unwrap();
        let (center, radius) = (Point::<Ct>::new(30.0, 10.0, -20.0), 2.0);
        let on_ball = |r: f64| {
            (0..500).map(move |n| {
                let z = 1.0 - (2 * n + 1) as f64 / 500.0;
                let (s, c) = (2.399_963_2 * f64::from(n)).sin_cos();
                let w = (1.0 - z * z).sqrt();
                center + nalgebra::Vector3::new(w * c, w * s, z) * r
            })
        };
        for keep in [0.9, 0.99] {
            let clearance = clearance_mm(&error, 0.1, on_ball(radius), keep).unwrap();
            let n = 4000;
            let touched = (0..n).filter(|k| {
                let mut draws = Draws::of_sample(11, *k);
                let motion = error.draw(&mut draws);
                let thicker = 0.1 * draws.normal();
                on_ball(radius + clearance)
                    .any(|p| motion.in_images(p).distance_mm(&center) < radius + thicker)
            });
            let share = touched.count() as f64 / n as f64;
            assert!(share <= 1.0 - keep, "{share} at {keep}");
            // the bound is not needlessly large
            assert!(clearance < 3.0, "{clearance}");
        }
    }
}
