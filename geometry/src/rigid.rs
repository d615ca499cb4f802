//! Rigid transforms between two named frames.

use std::fmt;
use std::marker::PhantomData;
use std::ops::Mul;

use nalgebra::{Matrix3, Rotation3, Vector3};

use crate::{Ct, Frame, Lps, Point};

/// `p_to = R p_from + t`. Values are named `to_from_from`, such as `base_from_ct`, so that neighbouring frames match
/// in a product.
pub struct Rigid<To: Frame, From: Frame> {
    /// R: columns are `From`'s axes in `To`.
    pub rotation: Rotation3<f64>,
    /// t: `From`'s origin in `To`, mm.
    pub translation_mm: Vector3<f64>,
    frames: PhantomData<(To, From)>,
}

/// A matrix that was given as a rotation is not one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NotARotation {
    /// max |RᵀR − 1|.
    pub orthogonality_error: f64,
    /// det R; −1 is a mirror.
    pub determinant: f64,
}

impl fmt::Display for NotARotation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "not a rotation: |RᵀR − 1| = {:.3e}, det = {:.6} (expected below 1e-3 and +1)",
            self.orthogonality_error, self.determinant
        )
    }
}
impl std::error::Error for NotARotation {}

impl<To: Frame, From: Frame> Rigid<To, From> {
    /// The transform with this rotation and this translation, mm.
    pub fn new(rotation: Rotation3<f64>, translation_mm: Vector3<f64>) -> Self {
        Self { rotation, translation_mm, frames: PhantomData }
    }

    /// The transform with the rotation nearest to `r`, which must be a rotation to 1e-3.
    ///
    /// # Errors
    /// [`NotARotation`] when RᵀR differs from 1 by more than 1e-3, or det R is not positive, or R is not finite.
    pub fn from_matrix(r: &Matrix3<f64>, translation_mm: Vector3<f64>) -> Result<Self, NotARotation> {
        let orthogonality_error = (r.transpose() * r - Matrix3::identity()).amax();
        let determinant = r.determinant();
        if orthogonality_error > 1e-3 || determinant <= 0.0 || r.iter().any(|v| !v.is_finite()) {
            return Err(NotARotation { orthogonality_error, determinant });
        }
        Ok(Self::new(nearest_rotation(r), translation_mm))
    }

    /// The identity: the two frames coincide.
    pub fn identity() -> Self {
        Self::new(Rotation3::identity(), Vector3::zeros())
    }

    /// The inverse transform.
    pub fn inverse(&self) -> Rigid<From, To> {
        let inv = self.rotation.inverse();
        Rigid::new(inv, -(inv * self.translation_mm))
    }

    /// Transforms a free vector, such as a direction or a force: it is rotated, not translated.
    pub fn rotate(&self, v: &Vector3<f64>) -> Vector3<f64> {
        self.rotation * v
    }
}

impl Rigid<Lps, Ct> {
    /// From RAS+ to LPS: half a turn about z. The only place where anything is converted for files in LPS.
    pub fn lps_from_ct() -> Self {
        let half_turn = Matrix3::from_diagonal(&Vector3::new(-1.0, -1.0, 1.0));
        Self::new(Rotation3::from_matrix_unchecked(half_turn), Vector3::zeros())
    }
}

/// The orthogonal polar factor of a matrix that is a rotation to 1e-3, by Newton's iteration, which converges quadratically.
fn nearest_rotation(r: &Matrix3<f64>) -> Rotation3<f64> {
    let mut m = *r;
    for _ in 0..8 {
        let Some(inverse) = m.try_inverse() else { break };
        m = (m + inverse.transpose()) * 0.5;
    }
    Rotation3::from_matrix_unchecked(m)
}

impl<To: Frame, From: Frame> Clone for Rigid<To, From> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<To: Frame, From: Frame> Copy for Rigid<To, From> {}
impl<To: Frame, From: Frame> PartialEq for Rigid<To, From> {
    fn eq(&self, other: &Self) -> bool {
        self.rotation == other.rotation && self.translation_mm == other.translation_mm
    }
}
impl<To: Frame, From: Frame> fmt::Debug for Rigid<To, From> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}_from_{}({:?}, {:?})", To::NAME, From::NAME, self.rotation, self.translation_mm)
    }
}

impl<To: Frame, From: Frame> Mul<Point<From>> for Rigid<To, From> {
    type Output = Point<To>;
    fn mul(self, p: Point<From>) -> Point<To> {
        Point::from_coords(self.rotation * p.coords + self.translation_mm)
    }
}
impl<A: Frame, B: Frame, C: Frame> Mul<Rigid<B, C>> for Rigid<A, B> {
    type Output = Rigid<A, C>;
    fn mul(self, other: Rigid<B, C>) -> Rigid<A, C> {
        Rigid::new(self.rotation * other.rotation, self.rotation * other.translation_mm + self.translation_mm)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Base, Ct, Work};
    use proptest::prelude::*;

    fn rigid<A: Frame, B: Frame>() -> impl Strategy<Value = Rigid<A, B>> {
        (prop::array::uniform3(-3.0f64..3.0), prop::array::uniform3(-200.0f64..200.0))
            .prop_map(|(r, t)| Rigid::new(Rotation3::new(Vector3::from(r)), Vector3::from(t)))
    }

    proptest! {
        #[test]
        fn the_inverse_brings_every_point_back(x in rigid::<Base, Ct>(), p in prop::array::uniform3(-99.0f64..99.0)) {
            let p = Point::<Ct>::new(p[0], p[1], p[2]);
            prop_assert!((x.inverse() * (x * p)).distance_mm(&p) < 1e-12 * 400.0);
        }

        #[test]
        fn a_product_is_one_after_the_other(a in rigid::<Base, Ct>(), b in rigid::<Ct, Work>(), p in prop::array::uniform3(-99.0f64..99.0)) {
            let p = Point::<Work>::new(p[0], p[1], p[2]);
            prop_assert!(((a * b) * p).distance_mm(&(a * (b * p))) < 1e-12 * 800.0);
        }
    }

    #[test]
    fn a_mirror_a_scale_and_a_nan_are_refused() {
        let t = Vector3::zeros();
        for bad in [
            Matrix3::from_diagonal(&Vector3::new(-1.0, 1.0, 1.0)),
            Matrix3::identity() * 1000.0,
            Matrix3::from_element(f64::NAN),
        ] {
            assert!(Rigid::<Base, Ct>::from_matrix(&bad, t).is_err(), "{bad}");
        }
    }

    #[test]
    fn a_rounded_rotation_is_made_orthonormal() {
        let r = Rotation3::new(Vector3::new(0.3, -0.2, 0.9)).into_inner().map(|v| f64::round(v * 1e4) / 1e4);
        let x = Rigid::<Base, Ct>::from_matrix(&r, Vector3::zeros()).unwrap();
        let m = x.rotation.into_inner();
        assert!((m.transpose() * m - Matrix3::identity()).amax() < 1e-15 * 10.0);
        assert!((m - r).amax() < 1e-4);
    }
}
