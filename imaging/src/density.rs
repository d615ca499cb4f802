//! Bone density from Hounsfield units: the calibration curve of the scanner and specimen.
//!
//! The curve is piecewise linear between its points and constant outside them, so noise below air or a metal streak
//! above the last point never extrapolates into a negative or absurd density. Invariants, checked in
//! [`DensityTable::new`]: at least two points, all finite, HU strictly increasing, densities not negative. The curve
//! may fall (a contrast agent, a phantom material); nothing here requires that it rises.

use crate::ImageError;

/// A piecewise linear calibration curve from HU to g/cm³.
#[derive(Debug, Clone, PartialEq)]
pub struct DensityTable {
    hu: Vec<f64>,
    g_cm3: Vec<f64>,
    /// g/cm³ per HU on each piece; one fewer than the points.
    slopes: Vec<f64>,
}

impl DensityTable {
    /// The curve through (`hu[n]`, `g_cm3[n]`), constant outside the first and last point.
    ///
    /// # Errors
    /// [`ImageError::DensityTableLength`] when there are fewer than two points or the lists differ in length;
    /// [`ImageError::DensityTablePoint`] when a value is not finite, an HU is not above the one before it, or a density is
    /// negative.
    pub fn new(hu: &[f64], g_cm3: &[f64]) -> Result<Self, ImageError> {
        if hu.len() != g_cm3.len() || hu.len() < 2 {
            return Err(ImageError::DensityTableLength { hu: hu.len(), g_cm3: g_cm3.len() });
        }
        let mut previous = f64::NEG_INFINITY;
        for (index, (&h, &d)) in hu.iter().zip(g_cm3).enumerate() {
            if !(h.is_finite() && h > previous && d.is_finite() && d >= 0.0) {
                return Err(ImageError::DensityTablePoint { index, hu: h, g_cm3: d });
            }
            previous = h;
        }
        let slopes =
            hu.windows(2).zip(g_cm3.windows(2)).map(|(h, d)| (d[1] - d[0]) / (h[1] - h[0])).collect();
        Ok(Self { hu: hu.to_vec(), g_cm3: g_cm3.to_vec(), slopes })
    }

    /// Density at `hu`, g/cm³: linear between the points, constant outside. For NaN it is the first density.
    #[inline]
    pub fn density_g_cm3(&self, hu: f64) -> f64 {
        // number of points at or below hu; 0 for NaN
        let above = self.hu.iter().take_while(|&&h| h <= hu).count();
        match above.checked_sub(1) {
            None => self.g_cm3[0],
            Some(n) if n == self.slopes.len() => self.g_cm3[n],
            Some(n) => self.g_cm3[n] + self.slopes[n] * (hu - self.hu[n]),
        }
    }

    /// The points' HU, strictly increasing.
    pub fn hu(&self) -> &[f64] {
        &self.hu
    }

    /// The points' densities, g/cm³, not negative.
    pub fn g_cm3(&self) -> &[f64] {
        &self.g_cm3
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn default_table() -> DensityTable {
        DensityTable::new(
            &[-1000.0, -400.0, -150.0, 100.0, 300.0, 2000.0, 4927.0],
            &[0.01, 0.602, 0.924, 1.075, 1.145, 1.856, 3.379],
        )
        .unwrap()
    }

    #[test]
    fn the_points_are_met_and_the_ends_hold() {
        let t = default_table();
        for (h, d) in t.hu().iter().zip(t.g_cm3()) {
            assert!((t.density_g_cm3(*h) - d).abs() < 1e-15);
        }
        assert_eq!(t.density_g_cm3(-3000.0), 0.01);
        assert_eq!(t.density_g_cm3(1e9), 3.379);
        assert_eq!(t.density_g_cm3(f64::NAN), 0.01);
        assert!((t.density_g_cm3(200.0) - 1.110).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn a_rising_curve_rises(a in -2000.0f64..6000.0, b in -2000.0f64..6000.0) {
            let t = default_table();
            prop_assert!(t.density_g_cm3(a.min(b)) <= t.density_g_cm3(a.max(b)));
        }
    }

    #[test]
    fn bad_tables_are_refused_with_the_point() {
        let bad = |hu: &[f64], d: &[f64]| DensityTable::new(hu, d).unwrap_err();
        assert!(matches!(bad(&[0.0], &[1.0]), ImageError::DensityTableLength { hu: 1, g_cm3: 1 }));
        assert!(matches!(bad(&[0.0, 1.0], &[1.0]), ImageError::DensityTableLength { hu: 2, g_cm3: 1 }));
        for (hu, d) in [([0.0, 0.0], [1.0, 1.0]), ([0.0, f64::NAN], [1.0, 1.0]), ([0.0, 1.0], [1.0, -0.1])] {
            assert!(matches!(bad(&hu, &d), ImageError::DensityTablePoint { index: 1, .. }));
        }
        assert!(matches!(
            bad(&[f64::NEG_INFINITY, 0.0], &[0.0, 1.0]),
            ImageError::DensityTablePoint { index: 0, .. }
        ));
    }
}
