//! Registration of the patient: base_from_ct fitted to paired fiducials.
//!
//! Minimise Σ |R ctᵢ + t − baseᵢ|²: with H = Σ (ctᵢ − c̄t)(baseᵢ − b̄ase)ᵀ = U Σ Vᵀ, R = V diag(1, 1, det V Uᵀ) Uᵀ,
//! t = b̄ase − R c̄t. This is a closed form: it needs no start and no iteration.
//!
//! Points that lie (nearly) on a line leave the rotation about it undetermined, and a mirrored or scaled set fits no
//! rigid body; both are refused. Points paired in the wrong order give a large residual; if another order fits far
//! better, it is named. FRE is the fit's RMS residual. It alone says nothing about the target, so the expected error
//! there (TRE) is predicted from the points' layout and a localisation error (FLE).
//!
//! **Source:** Arun, Huang & Blostein 1987 with Umeyama 1991's sign; FRE and TRE: Fitzpatrick, West & Maurer 1998, eq. (46)
//! TRE² = FLE²/N (1 + ⅓ Σₖ dₖ²/fₖ²), FRE² = (1 − 2/N) FLE².

mod order;

use bonemill_geometry::{Base, Ct, Point, Rigid};
use nalgebra::{Matrix3, Rotation3, Vector3};
use thiserror::Error;

pub use order::BetterOrder;
use order::{ALIKE_MM, better_order, is_far_better};

/// Points whose second-largest spread is below this share of the largest count as a line.
const LINE_SHARE: f64 = 0.05;

/// Least second-largest spread, mm: points nearer than this to a line do not determine the rotation about it.
const LINE_MM: f64 = 2.0;

/// Ratios of the two sets' sizes that are accepted as equal sizes.
const SCALES: std::ops::RangeInclusive<f64> = 0.95..=1.05;

/// Why no registration can be computed from the points.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum RegistrationFault {
    /// There are too few points, or they are not in pairs.
    #[error("{ct} points in ct and {base} in base, expected at least three, in pairs")]
    Count {
        /// Number of points in ct.
        ct: usize,
        /// Number of points in base.
        base: usize,
    },
    /// A coordinate is NaN or infinite.
    #[error("fiducial {index} has a coordinate that is not a finite number")]
    NotFinite {
        /// Index of the point, from 0.
        index: usize,
    },
    /// The points lie on a line.
    #[error(
        "the fiducials lie within {across_mm:.2} mm of a line {along_mm:.1} mm long: the rotation about it is not determined; \
         add a point well beside it"
    )]
    Collinear {
        /// RMS distance from the line, mm.
        across_mm: f64,
        /// RMS extent along it, mm.
        along_mm: f64,
    },
    /// One set is larger than the other.
    #[error("the points in base are spread {ratio:.3} times as far as in ct: is one of them not in mm?")]
    Scale {
        /// RMS spread in base over that in ct.
        ratio: f64,
    },
    /// One set is the other's mirror image.
    #[error(
        "the points fit as a mirror image (RMS {mirrored_mm:.2} mm) and not as a rigid body ({rigid_mm:.2} mm): the sign of \
         one axis is wrong in one of the two sets, or left and right are exchanged{}",
        better_order.as_ref().map_or(String::new(), |order| format!("; or the order is wrong: {order}"))
    )]
    Mirrored {
        /// RMS residual of the best rigid fit, mm.
        rigid_mm: f64,
        /// RMS residual of the best mirrored fit, mm.
        mirrored_mm: f64,
        /// Another order of the points that fits as a rigid body.
        better_order: Option<BetterOrder>,
    },
}

/// A fitted registration, its residuals and what is needed to predict its error.
#[derive(Debug, Clone, PartialEq)]
pub struct Fitted {
    /// p_base = R p_ct + t.
    pub base_from_ct: Rigid<Base, Ct>,
    /// |R ctᵢ + t − baseᵢ|, mm, shape (N).
    pub residual_mm: Vec<f64>,
    /// Root of the mean squared residual, mm.
    pub fre_mm: f64,
    /// Another order of the base points that fits far better.
    pub better_order: Option<BetterOrder>,
    /// The points' centroid, in ct.
    centroid: Vector3<f64>,
    /// Their principal axes, in ct, as columns.
    axes: Matrix3<f64>,
    /// Per principal axis: mean squared distance of the points from it, mm².
    from_axis_mm2: Vector3<f64>,
}

/// Fits base_from_ct to points given in both frames, in pairs.
///
/// # Errors
/// One of the variants of [`RegistrationFault`].
pub fn fit(ct: &[Point<Ct>], base: &[Point<Base>]) -> Result<Fitted, RegistrationFault> {
    if ct.len() != base.len() || ct.len() < 3 {
        return Err(RegistrationFault::Count { ct: ct.len(), base: base.len() });
    }
    if let Some(index) = ct.iter().zip(base).position(|(a, b)| !(a.is_finite() && b.is_finite())) {
        return Err(RegistrationFault::NotFinite { index });
    }
    let from: Vec<Vector3<f64>> = ct.iter().map(|p| p.coords).collect();
    let to: Vec<Vector3<f64>> = base.iter().map(|p| p.coords).collect();
    let (from_centre, to_centre) = (mean(&from), mean(&to));
    check_line(&from, &from_centre)?;
    check_line(&to, &to_centre)?;
    let spread = |points: &[Vector3<f64>], centre: &Vector3<f64>| {
        (points.iter().map(|p| (p - centre).norm_squared()).sum::<f64>() / points.len() as f64).sqrt()
    };
    let ratio = spread(&to, &to_centre) / spread(&from, &from_centre);
    if !SCALES.contains(&ratio) {
        return Err(RegistrationFault::Scale { ratio });
    }
    let centred = |points: &[Vector3<f64>], centre| -> Vec<_> { points.iter().map(|p| p - centre).collect() };
    let (a, b) = (centred(&from, from_centre), centred(&to, to_centre));
    let pairs = || a.iter().zip(&b);
    let cross: Matrix3<f64> = pairs().map(|(a, b)| a * b.transpose()).sum();
    let rms = |turn: &Matrix3<f64>| {
        (pairs().map(|(a, b)| (turn * a - b).norm_squared()).sum::<f64>() / ct.len() as f64).sqrt()
    };
    let [rigid, mirrored] = orthogonal(&cross);
    let (rigid_mm, mirrored_mm) = (rms(&rigid), rms(&mirrored));
    let better_order = better_order(&a, &b, rigid_mm);
    // points in a plane fit equally well mirrored; a true mirror image fits only as a mirror image
    let order_explains = better_order.as_ref().is_some_and(|order| order.fre_mm + ALIKE_MM < mirrored_mm);
    if is_far_better(mirrored_mm, rigid_mm) && !order_explains {
        return Err(RegistrationFault::Mirrored { rigid_mm, mirrored_mm, better_order });
    }
    let rotation = Rotation3::from_matrix_unchecked(rigid);
    let base_from_ct = Rigid::new(rotation, to_centre - rotation * from_centre);
    let residual_mm: Vec<f64> =
        ct.iter().zip(base).map(|(a, b)| (base_from_ct * *a).distance_mm(b)).collect();
    let axes = principal(&from, &from_centre).1;
    let from_axis_mm2 = Vector3::from_fn(|k, _| {
        let axis = axes.column(k);
        from.iter().map(|p| (p - from_centre).cross(&axis).norm_squared()).sum::<f64>() / from.len() as f64
    });
    let (fre_mm, centroid) = (rigid_mm, from_centre);
    Ok(Fitted { base_from_ct, residual_mm, fre_mm, better_order, centroid, axes, from_axis_mm2 })
}

impl Fitted {
    /// The localisation error estimated from the residuals, mm: FLE² = FRE²/(1 − 2/N).
    ///
    /// Three points leave small residuals whatever their error is, so the estimate √3 FRE is only a guess then.
    pub fn fle_mm(&self) -> f64 {
        let n = self.residual_mm.len() as f64;
        self.fre_mm / (1.0 - 2.0 / n).sqrt()
    }

    /// The expected error of the registration at a point, mm RMS.
    pub fn tre_mm(&self, at: &Point<Ct>) -> f64 {
        let n = self.residual_mm.len() as f64;
        let offset = at.coords - self.centroid;
        let turns: f64 = (0..3)
            .map(|k| {
                offset.cross(&self.axes.column(k)).norm_squared()
                    / self.from_axis_mm2[k].max(f64::MIN_POSITIVE)
            })
            .sum();
        self.fle_mm() * ((1.0 + turns / 3.0) / n).sqrt()
    }
}

fn mean(points: &[Vector3<f64>]) -> Vector3<f64> {
    points.iter().sum::<Vector3<f64>>() / points.len() as f64
}

/// RMS extents along the principal axes, greatest first, and the axes as columns.
fn principal(points: &[Vector3<f64>], centre: &Vector3<f64>) -> (Vector3<f64>, Matrix3<f64>) {
    let second: Matrix3<f64> = points.iter().map(|p| (p - centre) * (p - centre).transpose()).sum();
    let eigen = (second / points.len() as f64).symmetric_eigen();
    let mut order = [0, 1, 2];
    order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
    let extents = Vector3::from_fn(|k, _| eigen.eigenvalues[order[k]].max(0.0).sqrt());
    (extents, Matrix3::from_columns(&order.map(|k| eigen.eigenvectors.column(k).into_owned())))
}

fn check_line(points: &[Vector3<f64>], centre: &Vector3<f64>) -> Result<(), RegistrationFault> {
    let (extents, _) = principal(points, centre);
    let (along_mm, across_mm) = (extents[0], extents[1]);
    if across_mm < (LINE_SHARE * along_mm).max(LINE_MM) {
        return Err(RegistrationFault::Collinear { across_mm, along_mm });
    }
    Ok(())
}

/// The best rotation and the best mirrored rotation for a cross-covariance.
fn orthogonal(cross: &Matrix3<f64>) -> [Matrix3<f64>; 2] {
    let svd = cross.svd(true, true);
    let (Some(u), Some(vt)) = (svd.u, svd.v_t) else { return [Matrix3::identity(); 2] };
    let mut least = 0;
    for k in 1..3 {
        if svd.singular_values[k] < svd.singular_values[least] {
            least = k;
        }
    }
    let sign = (vt.transpose() * u.transpose()).determinant().signum();
    [sign, -sign].map(|sign| {
        let mut flip = Matrix3::identity();
        flip[(least, least)] = sign;
        vt.transpose() * flip * u.transpose()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const POINTS: [[f64; 3]; 5] =
        [[0.0, 0.0, 0.0], [60.0, 5.0, -3.0], [10.0, 45.0, 8.0], [-20.0, 12.0, 30.0], [33.0, 27.0, 21.0]];

    pub(super) fn ct() -> Vec<Point<Ct>> {
        POINTS.iter().map(|p| Point::from_coords(Vector3::from(*p))).collect()
    }

    pub(super) fn moved(by: &Rigid<Base, Ct>, points: &[Point<Ct>]) -> Vec<Point<Base>> {
        points.iter().map(|p| *by * *p).collect()
    }

    pub(super) fn some() -> Rigid<Base, Ct> {
        Rigid::new(Rotation3::new(Vector3::new(0.4, -1.1, 2.0)), Vector3::new(450.0, -30.0, 90.0))
    }

    pub(super) fn noisy(points: &[Point<Base>], noise: &[[f64; 3]]) -> Vec<Point<Base>> {
        points.iter().zip(noise).map(|(p, n)| *p + Vector3::from(*n)).collect()
    }

    proptest! {
        #[test]
        fn exact_points_give_the_motion_back(
            r in prop::array::uniform3(-3.0f64..3.0), t in prop::array::uniform3(-800.0f64..800.0), n in 3usize..6,
        ) {
            let truth = Rigid::new(Rotation3::new(Vector3::from(r)), Vector3::from(t));
            let points = &ct()[..n];
            let fitted = fit(points, &moved(&truth, points)).unwrap();
            let found = fitted.base_from_ct;
            prop_assert!((found.rotation.matrix() - truth.rotation.matrix()).amax() < 1e-12);
            prop_assert!((found.translation_mm - truth.translation_mm).amax() < 1e-9);
            prop_assert!(fitted.fre_mm < 1e-10 && fitted.residual_mm.iter().all(|r| *r < 1e-9));
        }

        #[test]
        fn no_rigid_motion_nearby_fits_better(
            noise in prop::collection::vec(prop::array::uniform3(-0.5f64..0.5), 5),
            turn in prop::array::uniform3(-0.01f64..0.01), shift in prop::array::uniform3(-0.3f64..0.3),
        ) {
            let noisy = noisy(&moved(&some(), &ct()), &noise);
            let fitted = fit(&ct(), &noisy).unwrap();
            let best = fitted.base_from_ct;
            let turned = Rotation3::new(Vector3::from(turn)) * best.rotation;
            let other = Rigid::new(turned, best.translation_mm + Vector3::from(shift));
            let sum = |by: &Rigid<Base, Ct>| -> f64 {
                moved(by, &ct()).iter().zip(&noisy).map(|(a, b)| a.distance_mm(b).powi(2)).sum()
            };
            prop_assert!(sum(&best) <= sum(&other) + 1e-9);
            prop_assert!((fitted.fre_mm - (sum(&best) / 5.0).sqrt()).abs() < 1e-9);
        }
    }

    /// A fixed stream of approximately normal numbers.
    fn normals() -> impl FnMut() -> f64 {
        let mut state = 17u64;
        move || {
            let mut sum = 0.0;
            for _ in 0..12 {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                sum += (state >> 11) as f64 / (1u64 << 53) as f64;
            }
            sum - 6.0
        }
    }

    #[test]
    fn the_predicted_error_at_the_target_is_the_one_found() {
        let (fle_mm, rounds) = (0.6, 4000);
        let mut normal = normals();
        let target = Point::<Ct>::new(90.0, -40.0, 10.0);
        let (mut found, mut predicted) = (0.0, 0.0);
        for _ in 0..rounds {
            let mut shift = || Vector3::new(normal(), normal(), normal()) * (fle_mm / 3f64.sqrt());
            let noisy: Vec<Point<Base>> = moved(&some(), &ct()).iter().map(|p| *p + shift()).collect();
            let fitted = fit(&ct(), &noisy).unwrap();
            found += (fitted.base_from_ct * target).distance_mm(&(some() * target)).powi(2);
            predicted += fitted.tre_mm(&target).powi(2);
        }
        let ratio = (predicted / found).sqrt();
        assert!((0.95..1.05).contains(&ratio), "{ratio}");
    }

    #[test]
    fn what_gives_no_registration_is_refused() {
        let fault = |from: &[Point<Ct>], to: &[Point<Base>]| fit(from, to).unwrap_err();
        let to = moved(&some(), &ct());
        assert!(matches!(fault(&ct()[..2], &to[..2]), RegistrationFault::Count { ct: 2, base: 2 }));
        assert!(matches!(fault(&ct(), &to[..4]), RegistrationFault::Count { ct: 5, base: 4 }));
        let mut nan = ct();
        nan[3] = Point::new(0.0, f64::NAN, 0.0);
        assert!(matches!(fault(&nan, &to), RegistrationFault::NotFinite { index: 3 }));
        // on a line, exactly and nearly
        for off in [0.0, 0.5] {
            let line: Vec<Point<Ct>> = (0..5)
                .map(|k| Point::new(f64::from(k) * 20.0, off * f64::from(k % 2), f64::from(k) * 3.0))
                .collect();
            let error = fault(&line, &moved(&some(), &line));
            assert!(matches!(error, RegistrationFault::Collinear { .. }), "{error}");
        }
        let metres: Vec<Point<Base>> = to.iter().map(|p| Point::from_coords(p.coords / 1000.0)).collect();
        assert!(matches!(
            fault(&ct(), &metres),
            RegistrationFault::Collinear { .. } | RegistrationFault::Scale { .. }
        ));
        let larger: Vec<Point<Base>> = to.iter().map(|p| Point::from_coords(p.coords * 1.1)).collect();
        assert!(
            matches!(fault(&ct(), &larger), RegistrationFault::Scale { ratio } if (ratio - 1.1).abs() < 1e-9)
        );
        let mirrored: Vec<Point<Base>> = to.iter().map(|p| Point::new(-p.x(), p.y(), p.z())).collect();
        assert!(matches!(fault(&ct(), &mirrored), RegistrationFault::Mirrored { .. }));
    }

    #[test]
    fn points_in_a_plane_are_enough() {
        let flat: Vec<Point<Ct>> =
            [[0.0, 0.0], [50.0, 0.0], [0.0, 40.0], [45.0, 38.0]].map(|[x, y]| Point::new(x, y, 7.0)).to_vec();
        let fitted = fit(&flat, &moved(&some(), &flat)).unwrap();
        assert!((fitted.base_from_ct.rotation.matrix() - some().rotation.matrix()).amax() < 1e-12);
    }
}
