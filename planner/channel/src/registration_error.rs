//! How far the registration lets a point of the patient be off in one direction: a small rigid motion, normal with mean 0.
//!
//! The error at x is δ(x) = t + ω × d with d = x − c, c the fiducials' centroid. Its variance along a unit vector n is
//! σ²(x, n) = σ_t² + (d × n)ᵀ C (d × n). With N fiducials, each localised with the standard deviation σ = FLE/√3 along every axis,
//! σ_t² = σ²/N and C = σ² K⁻¹ with K = Σ (|qᵢ|² 1 − qᵢ qᵢᵀ) over the points' offsets qᵢ from c. Without fiducials the case
//! states σ_t and C = 0.
//!
//! **Source:** Fitzpatrick, West & Maurer 1998; with residuals, FLE² = FRE²/(1 − 2/N).

use bonemill_arm::registration::fit;
use bonemill_case::{Registration, RobotSpec};
use bonemill_geometry::{Base, Ct, Point};
use bonemill_setup::PlanError;
use nalgebra::{Matrix3, Vector3};
use statrs::distribution::{ContinuousCDF, Normal};

/// The registration's error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RegistrationError {
    translation_mm2: f64,
    about: Vector3<f64>,
    rotation_rad2: Matrix3<f64>,
}

/// A small rigid motion of the patient.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SmallMotion {
    translation_mm: Vector3<f64>,
    rotation_rad: Vector3<f64>,
    about: Vector3<f64>,
}

impl SmallMotion {
    /// How far it moves a point, mm.
    pub fn of_point(&self, p: Point<Ct>) -> Vector3<f64> {
        self.translation_mm + self.of_direction(&(p.coords - self.about))
    }

    /// By how much it turns a vector.
    pub fn of_direction(&self, v: &Vector3<f64>) -> Vector3<f64> {
        self.rotation_rad.cross(v)
    }
}

impl RegistrationError {
    /// The same standard deviation along every axis, everywhere, mm.
    pub fn uniform(sigma_mm: f64) -> Self {
        let rotation_rad2 = Matrix3::zeros();
        Self { translation_mm2: sigma_mm * sigma_mm, about: Vector3::zeros(), rotation_rad2 }
    }

    /// The same along every axis, and about every axis through a point.
    #[cfg(test)]
    pub fn of_rotation(sigma_mm: f64, about: Point<Ct>, sigma_rad: f64) -> Self {
        let rotation_rad2 = Matrix3::identity() * sigma_rad * sigma_rad;
        Self { translation_mm2: sigma_mm * sigma_mm, about: about.coords, rotation_rad2 }
    }

    /// Of a case's fiducials, else `sigma_mm` along every axis.
    ///
    /// # Errors
    /// [`PlanError::Registration`] where the fiducials give no registration.
    pub fn of_case(robot: &RobotSpec, sigma_mm: f64) -> Result<Self, PlanError> {
        let Registration::Fiducials { ct_mm, base_mm } = &robot.base_from_ct else {
            return Ok(Self::uniform(sigma_mm));
        };
        let ct: Vec<Point<Ct>> = ct_mm.iter().map(|p| Point::from_coords(Vector3::from(*p))).collect();
        let base: Vec<Point<Base>> = base_mm.iter().map(|p| Point::from_coords(Vector3::from(*p))).collect();
        let variance_mm2 = fit(&ct, &base)?.fle_mm().powi(2) / 3.0;
        let n = ct.len() as f64;
        let about = ct.iter().map(|p| p.coords).sum::<Vector3<f64>>() / n;
        let offsets = ct.iter().map(|p| p.coords - about);
        let inertia: Matrix3<f64> =
            offsets.map(|q| Matrix3::identity() * q.norm_squared() - q * q.transpose()).sum();
        // a fit that was accepted has points that are not on a line
        let rotation_rad2 = inertia.try_inverse().unwrap_or_else(Matrix3::zeros) * variance_mm2;
        Ok(Self { translation_mm2: variance_mm2 / n, about, rotation_rad2 })
    }

    /// Standard deviation of the error at a point along a unit vector, mm.
    pub fn sigma_mm(&self, at: Point<Ct>, along: &Vector3<f64>) -> f64 {
        let lever = (at.coords - self.about).cross(along);
        (self.translation_mm2 + lever.dot(&(self.rotation_rad2 * lever))).max(0.0).sqrt()
    }

    /// How many independent standard normal numbers make an error: translations, and rotations where there are any.
    pub fn numbers(&self) -> usize {
        if self.rotation_rad2.amax() > 0.0 { 6 } else { 3 }
    }

    /// The error of so many standard normal numbers: its translation, mm, and rotation, rad.
    pub fn of_numbers(&self, numbers: &[f64]) -> SmallMotion {
        let three = |from: usize| Vector3::from_fn(|n, _| numbers.get(from + n).copied().unwrap_or(0.0));
        let eigen = self.rotation_rad2.symmetric_eigen();
        let sigmas = eigen.eigenvalues.map(|v| v.max(0.0).sqrt());
        let rotation_rad = eigen.eigenvectors * sigmas.component_mul(&three(3));
        SmallMotion {
            translation_mm: self.translation_mm2.sqrt() * three(0),
            rotation_rad,
            about: self.about,
        }
    }

    /// The error along a unit direction that is exceeded with a probability above 0 and at most 0.5, mm.
    pub fn exceeded_mm(&self, at: Point<Ct>, along: &Vector3<f64>, probability: f64) -> f64 {
        -self.sigma_mm(at, along) * Normal::standard().inverse_cdf(probability)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bonemill_case::Case;

    #[test]
    fn fiducials_give_the_error_that_the_fit_expects() {
        let text = "structure = []\n[images]\nct = \"c\"\nlabels = \"l\"\n[target]\nlabel = 1\n";
        let mut robot = Case::parse(text, std::path::Path::new("case.toml")).unwrap().robot;
        let ct_mm = vec![[0.0, 0.0, 0.0], [60.0, 5.0, -3.0], [10.0, 45.0, 8.0], [-20.0, 12.0, 30.0]];
        let mut base_mm = ct_mm.clone();
        base_mm[1][2] += 0.4;
        robot.base_from_ct = Registration::Fiducials { ct_mm: ct_mm.clone(), base_mm: base_mm.clone() };
        let error = RegistrationError::of_case(&robot, 9.0).unwrap();
        let points = |list: &[[f64; 3]]| list.iter().map(|p| Vector3::from(*p)).collect::<Vec<_>>();
        let (ct, base) = (points(&ct_mm), points(&base_mm));
        let ct: Vec<_> = ct.into_iter().map(Point::<Ct>::from_coords).collect();
        let base: Vec<_> = base.into_iter().map(Point::<Base>::from_coords).collect();
        let fitted = fit(&ct, &base).unwrap();
        for at in [Point::new(20.0, 10.0, 5.0), Point::new(90.0, -40.0, 10.0)] {
            let squares: f64 = [Vector3::x(), Vector3::y(), Vector3::z()]
                .iter()
                .map(|n| error.sigma_mm(at, n).powi(2))
                .sum();
            assert!((squares.sqrt() - fitted.tre_mm(&at)).abs() < 1e-9, "{}", squares.sqrt());
        }
        let stated = RegistrationError::uniform(0.2);
        assert!((stated.sigma_mm(Point::new(90.0, 0.0, 0.0), &Vector3::y()) - 0.2).abs() < 1e-15);
    }
}
