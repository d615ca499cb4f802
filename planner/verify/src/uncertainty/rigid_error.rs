//! The error of a registration: a small rigid motion with a normal distribution.
//!
//! δ(x) = t + ω × (x − c) moves a point x of the patient; (t, ω) has mean 0 and covariance Σ, 6 × 6, mm and rad, c is the
//! point about which ω turns. Then δ(x) has the covariance J Σ Jᵀ with J = [1, −[x − c]×].
//!
//! **Source:** Siebold et al. 2016 ("Safety margins in robotic bone milling"), the target registration error's covariance.

use bonemill_geometry::{Ct, Point};
use nalgebra::{Matrix3, Matrix3x6, Matrix6, Rotation3, Vector3, Vector6};

use super::UncertaintyError;
use super::draws::Draws;

/// Largest asymmetry and negative variance that can be rounding, relative to the largest entry.
const ROUNDING: f64 = 1e-9;

/// A normal rigid error.
#[derive(Debug, Clone, PartialEq)]
pub struct RigidError {
    covariance: Matrix6<f64>,
    /// Columns √λ v, by which standard normal numbers are multiplied.
    root: Matrix6<f64>,
    about: Point<Ct>,
    rank: usize,
}

impl RigidError {
    /// The error with this covariance of (t mm, ω rad) about a point of ct.
    ///
    /// # Errors
    /// [`UncertaintyError::Covariance`] where it is not finite, not symmetric, or has a negative variance.
    pub fn new(covariance: Matrix6<f64>, about: Point<Ct>) -> Result<Self, UncertaintyError> {
        let refuse = |fault| UncertaintyError::Covariance { fault };
        if !covariance.iter().all(|v| v.is_finite()) || !about.is_finite() {
            return Err(refuse("a number is not finite"));
        }
        let largest = covariance.amax();
        if (covariance - covariance.transpose()).amax() > ROUNDING * largest {
            return Err(refuse("it is not symmetric"));
        }
        let eigen = covariance.symmetric_eigen();
        if eigen.eigenvalues.iter().any(|v| *v < -ROUNDING * largest) {
            return Err(refuse("a variance is negative"));
        }
        let mut root = eigen.eigenvectors;
        for (mut column, value) in root.column_iter_mut().zip(eigen.eigenvalues.iter()) {
            column *= value.max(0.0).sqrt();
        }
        // mm and rad have different scales, so the rank is computed after scaling by the diagonal
        let scaled = Matrix6::from_fn(|i, j| {
            let size = (covariance[(i, i)] * covariance[(j, j)]).sqrt();
            if size > 0.0 { covariance[(i, j)] / size } else { 0.0 }
        });
        let rank = scaled.symmetric_eigen().eigenvalues.iter().filter(|v| **v > ROUNDING).count();
        Ok(Self { covariance, root, about, rank })
    }

    /// Independent errors with these standard deviations along and about ct's axes.
    ///
    /// # Errors
    /// As [`RigidError::new`].
    pub fn of_sigmas(
        translation_mm: [f64; 3],
        rotation_rad: [f64; 3],
        about: Point<Ct>,
    ) -> Result<Self, UncertaintyError> {
        let [x, y, z] = translation_mm;
        let [a, b, c] = rotation_rad;
        let sigmas = Vector6::new(x, y, z, a, b, c);
        if sigmas.iter().any(|s| *s < 0.0) {
            return Err(UncertaintyError::Covariance { fault: "a standard deviation is negative" });
        }
        Self::new(Matrix6::from_diagonal(&sigmas.component_mul(&sigmas)), about)
    }

    /// Standard deviations along (mm) and about (rad) ct's axes.
    pub fn sigmas(&self) -> [f64; 6] {
        std::array::from_fn(|n| self.covariance[(n, n)].sqrt())
    }

    /// Number of independent directions in which it varies, 0 to 6.
    pub fn rank(&self) -> usize {
        self.rank
    }

    /// Covariance of a point's displacement, mm².
    pub fn at(&self, p: Point<Ct>) -> Matrix3<f64> {
        let arm = p - self.about;
        let mut j = Matrix3x6::zeros();
        j.fixed_columns_mut::<3>(0).copy_from(&Matrix3::identity());
        j.fixed_columns_mut::<3>(3).copy_from(&-arm.cross_matrix());
        j * self.covariance * j.transpose()
    }

    /// Standard deviation of a point's displacement in the direction in which it is largest, mm.
    pub fn worst_sigma_mm(&self, p: Point<Ct>) -> f64 {
        self.at(p).symmetric_eigenvalues().max().max(0.0).sqrt()
    }

    /// A motion of the patient, drawn from the distribution.
    pub(super) fn draw(&self, draws: &mut Draws) -> PatientShift {
        let standard = Vector6::from_fn(|_, _| draws.normal());
        let (t, omega) = {
            let drawn = self.root * standard;
            (drawn.fixed_rows::<3>(0).into_owned(), drawn.fixed_rows::<3>(3).into_owned())
        };
        PatientShift { rotation: Rotation3::new(omega), translation_mm: t, about: self.about.coords }
    }
}

/// A small rigid motion of the patient.
#[derive(Debug, Clone, Copy)]
pub struct PatientShift {
    rotation: Rotation3<f64>,
    translation_mm: Vector3<f64>,
    about: Vector3<f64>,
}

impl PatientShift {
    /// The position in the images of a point that the robot reaches in the moved patient.
    pub fn in_images(&self, p: Point<Ct>) -> Point<Ct> {
        let back = self.rotation.inverse() * (p.coords - self.about - self.translation_mm);
        Point::from_coords(self.about + back)
    }

    /// Upper bound of the displacement of points within `radius_mm` of the centre of rotation, mm.
    pub fn most_mm(&self, radius_mm: f64) -> f64 {
        self.translation_mm.norm()
            + 2.0 * (0.5 * self.rotation.angle()).sin() * (radius_mm + self.translation_mm.norm())
    }

    /// The centre of rotation, mm in ct.
    pub fn about(&self) -> &Vector3<f64> {
        &self.about
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error() -> RigidError {
        RigidError::of_sigmas([0.2, 0.3, 0.1], [0.01, 0.0, 0.02], Point::new(1.0, 2.0, 3.0)).unwrap()
    }

    #[test]
    fn the_covariance_at_a_point_is_that_of_the_draws() {
        let (error, p) = (error(), Point::new(11.0, -8.0, 30.0));
        let mut sum = Matrix3::zeros();
        let n = 20_000;
        for k in 0..n {
            let d = error.draw(&mut Draws::of_sample(1, k)).in_images(p) - p;
            sum += d * d.transpose() / n as f64;
        }
        let expected = error.at(p);
        assert!((sum - expected).amax() < 0.04 * expected.amax(), "{sum} {expected}");
    }

    #[test]
    fn rank_counts_what_varies_and_the_bound_holds() {
        assert_eq!(error().rank(), 5);
        assert_eq!(RigidError::of_sigmas([0.0; 3], [0.0; 3], Point::new(0.0, 0.0, 0.0)).unwrap().rank(), 0);
        for k in 0..500 {
            let motion = error().draw(&mut Draws::of_sample(2, k));
            let p = Point::new(11.0, 2.0, 13.0);
            assert!((motion.in_images(p) - p).norm() <= motion.most_mm(200f64.sqrt()) + 1e-12);
        }
    }

    #[test]
    fn what_is_no_covariance_is_refused() {
        let about = Point::new(0.0, 0.0, 0.0);
        let mut skew = Matrix6::identity();
        skew[(0, 1)] = 0.5;
        let mut negative = Matrix6::identity();
        negative[(2, 2)] = -0.1;
        for bad in [skew, negative, Matrix6::repeat(f64::NAN)] {
            assert!(RigidError::new(bad, about).is_err());
        }
        assert!(RigidError::of_sigmas([-0.1; 3], [0.0; 3], about).is_err());
    }
}
