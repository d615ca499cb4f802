//! Detects fiducials that are paired in a wrong order: searches for another order of one set that fits far better.
//!
//! A fit's RMS residual follows from the cross-covariance H = Σ aᵢ bᵢᵀ of the centred points alone:
//! FRE² = (Σ|aᵢ|² + Σ|bᵢ|² − 2 (σ₁ + σ₂ + sign(det H) σ₃)) / N, with H's singular values σ₁ ≥ σ₂ ≥ σ₃. Up to
//! [`EVERY_ORDER`] points every order is tried. With more points, pairs are exchanged as long as the fit improves, which
//! finds one or two exchanged pairs but not every order.
//!
//! An order is far better if its FRE is below a third of the given order's FRE and at least [`LEAST_GAIN_MM`] less. So
//! there is no false alarm for a symmetric layout, in which several orders fit equally well, or for a layout that fits well.
//!
//! **Source:** the residual: Arun, Huang & Blostein 1987, eq. (11) to (13).

use nalgebra::{Matrix3, Vector3};

/// Largest number of points for which every order is tried: 5040 orders.
const EVERY_ORDER: usize = 7;
/// Largest number of points for which pairs are exchanged.
const MOST_POINTS: usize = 100;
/// A better fit has an FRE below this share of the given one's.
const FAR_BETTER: f64 = 1.0 / 3.0;
/// A better fit has an FRE that is at least this much less, mm. Smaller gains can come from a fiducial that was touched
/// inaccurately. Assumed.
const LEAST_GAIN_MM: f64 = 0.5;
/// Orders whose FREs differ by less than this fit equally well, mm; the one that moves the fewest points is named.
pub(super) const ALIKE_MM: f64 = 0.1;

/// An order of the base points that fits far better than the given one.
#[derive(Debug, Clone, PartialEq)]
pub struct BetterOrder {
    /// `base[order[i]]` belongs to `ct[i]`; from 0.
    pub order: Vec<usize>,
    /// FRE in that order, mm.
    pub fre_mm: f64,
}

impl std::fmt::Display for BetterOrder {
    /// Prints the order with points numbered from 1.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let moved: Vec<usize> = (0..self.order.len()).filter(|n| self.order[*n] != *n).collect();
        match moved.as_slice() {
            [a, b] => write!(f, "exchanging fiducials {} and {}", a + 1, b + 1)?,
            _ => {
                let order: Vec<String> = self.order.iter().map(|n| (n + 1).to_string()).collect();
                write!(f, "taking the base points in the order {}", order.join(", "))?;
            }
        }
        write!(f, " would bring the FRE to {:.2} mm", self.fre_mm)
    }
}

/// Whether a fit is far better than the given one.
pub(super) fn is_far_better(other_mm: f64, fre_mm: f64) -> bool {
    other_mm < FAR_BETTER * fre_mm && other_mm + LEAST_GAIN_MM < fre_mm
}

/// The order of `base` that fits far better than the given one, if there is one. Both sets are relative to their
/// centroids, mm.
pub(super) fn better_order(ct: &[Vector3<f64>], base: &[Vector3<f64>], fre_mm: f64) -> Option<BetterOrder> {
    // if even an FRE of 0 is not far better, no order is
    if !is_far_better(0.0, fre_mm) {
        return None;
    }
    let pairs = Pairs { ct, base };
    let found = if ct.len() <= EVERY_ORDER {
        pairs.every_order(fre_mm)
    } else if ct.len() <= MOST_POINTS {
        pairs.exchanged().filter(|found| is_far_better(found.fre_mm, fre_mm))
    } else {
        None
    };
    found.filter(|found| found.order.iter().enumerate().any(|(n, from)| n != *from))
}

/// Centred points of both sets, mm.
struct Pairs<'a> {
    ct: &'a [Vector3<f64>],
    base: &'a [Vector3<f64>],
}

impl Pairs<'_> {
    /// FRE of the best rotation for a cross-covariance, mm.
    fn fre_mm(&self, cross: &Matrix3<f64>) -> f64 {
        let sigma = cross.singular_values();
        let least = sigma.min();
        let turned = sigma.sum() - if cross.determinant() < 0.0 { 2.0 * least } else { 0.0 };
        let squares: f64 = self.ct.iter().chain(self.base).map(Vector3::norm_squared).sum();
        ((squares - 2.0 * turned) / self.ct.len() as f64).max(0.0).sqrt()
    }

    fn cross(&self, order: &[usize]) -> Matrix3<f64> {
        self.ct.iter().zip(order).map(|(a, n)| a * self.base[*n].transpose()).sum()
    }

    /// The best of all orders; among those that fit equally well the one that moves the fewest points.
    fn every_order(&self, given_mm: f64) -> Option<BetterOrder> {
        let mut far_better = Vec::new();
        let mut order: Vec<usize> = (0..self.ct.len()).collect();
        loop {
            let fre_mm = self.fre_mm(&self.cross(&order));
            if is_far_better(fre_mm, given_mm) {
                far_better.push(BetterOrder { order: order.clone(), fre_mm });
            }
            if !next_order(&mut order) {
                break;
            }
        }
        let best_mm = far_better.iter().map(|found| found.fre_mm).fold(f64::INFINITY, f64::min);
        let alike = far_better.into_iter().filter(|found| found.fre_mm <= best_mm + ALIKE_MM);
        alike.min_by_key(|found| found.order.iter().enumerate().filter(|(n, from)| n != *from).count())
    }

    /// Exchanges the pair that improves the fit most, until no exchange improves it.
    fn exchanged(&self) -> Option<BetterOrder> {
        let count = self.ct.len();
        let mut order: Vec<usize> = (0..count).collect();
        let mut cross = self.cross(&order);
        let mut fre_mm = self.fre_mm(&cross);
        for _ in 0..count {
            let swaps = (0..count).flat_map(|a| (a + 1..count).map(move |b| [a, b]));
            let tried = swaps.map(|[a, b]| {
                let change =
                    (self.ct[a] - self.ct[b]) * (self.base[order[b]] - self.base[order[a]]).transpose();
                let cross = cross + change;
                (self.fre_mm(&cross), [a, b], cross)
            });
            let (found_mm, [a, b], found) = tried.min_by(|x, y| x.0.total_cmp(&y.0))?;
            if found_mm + 1e-6 >= fre_mm {
                break;
            }
            order.swap(a, b);
            (fre_mm, cross) = (found_mm, found);
        }
        Some(BetterOrder { order, fre_mm })
    }
}

/// The next order in lexicographic order; false after the last.
fn next_order(order: &mut [usize]) -> bool {
    let Some(at) = order.windows(2).rposition(|pair| pair[0] < pair[1]) else { return false };
    let Some(to) = order.iter().rposition(|n| *n > order[at]) else { return false };
    order.swap(at, to);
    order[at + 1..].reverse();
    true
}

#[cfg(test)]
mod tests {
    use super::super::tests::{ct, moved, noisy, some};
    use super::super::{RegistrationFault, fit};
    use super::*;
    use bonemill_geometry::{Base, Ct, Point};
    use proptest::prelude::*;

    #[test]
    fn every_order_comes_once() {
        let mut order = [0, 1, 2, 3, 4];
        let mut seen = std::collections::BTreeSet::from([order]);
        while next_order(&mut order) {
            assert!(seen.insert(order));
        }
        assert_eq!(seen.len(), 120);
    }

    /// The requested number of points, without symmetry.
    fn many(count: usize) -> Vec<Point<Ct>> {
        let at = |n: f64| Point::new(40.0 * (1.7 * n).sin(), 9.0 * n - 20.0, 35.0 * (0.9 * n * n).cos());
        (0..count).map(|n| at(n as f64)).collect()
    }

    proptest! {
        #[test]
        fn points_in_their_order_raise_no_alarm(
            noise in prop::collection::vec(prop::array::uniform3(-0.4f64..0.4), 12), count in 3usize..12,
        ) {
            for points in [many(count), ct()] {
                let fitted = fit(&points, &noisy(&moved(&some(), &points), &noise)).unwrap();
                prop_assert_eq!(fitted.better_order, None);
            }
        }

        #[test]
        fn two_exchanged_fiducials_are_named(
            noise in prop::collection::vec(prop::array::uniform3(-0.3f64..0.3), 12),
            count in 5usize..12, first in 0usize..12, by in 1usize..11,
        ) {
            let (a, b) = (first % count, (first + 1 + by % (count - 1)) % count);
            let points = many(count);
            let mut base = noisy(&moved(&some(), &points), &noise);
            base.swap(a, b);
            let order = match fit(&points, &base) {
                Ok(fitted) => fitted.better_order,
                Err(RegistrationFault::Mirrored { better_order, .. }) => better_order,
                Err(other) => return Err(TestCaseError::fail(other.to_string())),
            };
            let order = order.ok_or_else(|| TestCaseError::fail("no other order found"))?;
            let said = format!("exchanging fiducials {} and {} would", a.min(b) + 1, a.max(b) + 1);
            prop_assert!(order.to_string().starts_with(&said), "{order}");
            prop_assert!(order.fre_mm < 0.5, "{order}");
        }
    }

    #[test]
    fn a_longer_mix_up_is_named_by_its_order() {
        let points = ct();
        let base = moved(&some(), &points);
        let turned: Vec<Point<Base>> = [1, 2, 0, 3, 4].map(|n| base[n]).to_vec();
        let found = fit(&points, &turned).unwrap().better_order.unwrap();
        // base[order[i]] is the true partner of ct[i]
        assert_eq!(found.order, [2, 0, 1, 3, 4]);
        assert!(found.to_string().contains("in the order 3, 1, 2, 4, 5"), "{found}");
    }

    #[test]
    fn a_symmetric_layout_raises_no_alarm() {
        // a square fits equally well in eight orders
        let square: Vec<Point<Ct>> = [[30.0, 0.0], [0.0, 30.0], [-30.0, 0.0], [0.0, -30.0]]
            .map(|[x, y]| Point::new(x, y, 5.0))
            .to_vec();
        let noise = [[0.9, -0.5, 0.8], [-0.7, 0.2, -1.0], [0.4, 0.9, 0.6], [-0.8, -0.9, -0.3]];
        let fitted = fit(&square, &noisy(&moved(&some(), &square), &noise)).unwrap();
        assert!(fitted.fre_mm > 0.5, "{}", fitted.fre_mm);
        assert_eq!(fitted.better_order, None);
    }
}
