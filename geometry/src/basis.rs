//! An orthonormal basis from its z axis, without branches at the poles.

use nalgebra::{Rotation3, Unit, Vector3};

/// R = [x y z] with z the given unit vector.
///
/// s = copysign(1, z_z), q = −1/(s + z_z), b = z_x z_y q;
/// x = (1 + s z_x² q, s b, −s z_x), y = (b, s + z_y² q, −z_y).
///
/// **Source:** Duff et al. 2017, "Building an orthonormal basis, revisited", listing 3.
pub fn from_z(z: &Vector3<f64>) -> Rotation3<f64> {
    let s = 1f64.copysign(z.z);
    let q = -1.0 / (s + z.z);
    let b = z.x * z.y * q;
    let x = Vector3::new(1.0 + s * z.x * z.x * q, s * b, -s * z.x);
    let y = Vector3::new(b, s + z.y * z.y * q, -z.y);
    Rotation3::from_matrix_unchecked(nalgebra::Matrix3::from_columns(&[x, y, *z]))
}

/// Point `n` of `count` that are spread evenly over the sphere: a spiral with the golden angle.
pub fn on_sphere(n: usize, count: usize) -> Unit<Vector3<f64>> {
    let golden_rad = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let z = 1.0 - (2 * n + 1) as f64 / count as f64;
    let (sin, cos) = (golden_rad * n as f64).sin_cos();
    let across = (1.0 - z * z).sqrt();
    Unit::new_normalize(Vector3::new(across * cos, across * sin, z))
}

/// The shaft's axis at the angles θ and φ: a(θ, φ) = Rx(θ) Ry(φ) e_z = (sin φ, −sin θ cos φ, cos θ cos φ).
///
/// `theta_rad` tilts in the y–z plane, `phi_rad` out of it; both 0 is +z.
pub fn axis_from_angles(theta_rad: f64, phi_rad: f64) -> Vector3<f64> {
    let (st, ct) = theta_rad.sin_cos();
    let (sp, cp) = phi_rad.sin_cos();
    Vector3::new(sp, -st * cp, ct * cp)
}

/// (θ, φ) of a unit axis, rad: the inverse of [`axis_from_angles`] with φ in [−π/2, π/2].
pub fn angles_from_axis(axis: &Vector3<f64>) -> (f64, f64) {
    // + 0.0 turns −0 into 0, so that an untilted axis gives 0 and not −0 or π
    ((-axis.y + 0.0).atan2(axis.z), axis.x.clamp(-1.0, 1.0).asin())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn is_a_rotation_with_the_given_z(v in prop::array::uniform3(-1.0f64..1.0)) {
            let v = Vector3::from(v);
            prop_assume!(v.norm() > 1e-3);
            let z = v.normalize();
            let r = from_z(&z).into_inner();
            prop_assert!((r.transpose() * r - nalgebra::Matrix3::identity()).amax() < 1e-14);
            prop_assert!((r.determinant() - 1.0).abs() < 1e-14);
            prop_assert_eq!(r.column(2).into_owned(), z);
        }

        #[test]
        fn angles_and_axis_are_inverse(theta in -1.5f64..1.5, phi in -1.5f64..1.5) {
            let (t, p) = angles_from_axis(&axis_from_angles(theta, phi));
            prop_assert!((t - theta).abs() < 1e-12 && (p - phi).abs() < 1e-12);
        }
    }

    #[test]
    fn both_poles_are_finite() {
        for z in [Vector3::z(), -Vector3::z()] {
            assert!(from_z(&z).into_inner().iter().all(|v| v.is_finite()));
        }
    }
}
