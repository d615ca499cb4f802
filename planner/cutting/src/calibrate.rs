//! Coefficients of the burr model from a force log, by least squares, with confidence intervals.
//!
//! The model is linear in K_t, K_r, K_a and K_te, K_re, K_ae: F = Σ K_m G_m, with G_m the force per unit of a
//! coefficient at a pose (`bonemill_simulate::force_per_coefficient`). So one linear fit over all observations gives
//! them, and its covariance their intervals (95 %, Student's t; errors taken as independent, of one size, and without
//! bias: a force sensor's drift is none of these).
//!
//! A log cannot tell coefficients apart whose forces look alike in it: the edge term from the cutting term at a
//! single feed speed, K_a from K_r in a plunge. Such a log is refused, with the names; it is not answered with
//! numbers that mean nothing.

use std::str::FromStr;

use nalgebra::{DMatrix, DVector, Vector3};
use thiserror::Error;

/// A coefficient of the model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Coefficient {
    /// K_t, N/mm².
    Tangential,
    /// K_r, N/mm².
    Radial,
    /// K_a, N/mm².
    Axial,
    /// K_te, N/mm.
    TangentialEdge,
    /// K_re, N/mm.
    RadialEdge,
    /// K_ae, N/mm.
    AxialEdge,
}

impl Coefficient {
    /// Every coefficient, in the order of an observation.
    pub const ALL: [Self; 6] = [
        Self::Tangential,
        Self::Radial,
        Self::Axial,
        Self::TangentialEdge,
        Self::RadialEdge,
        Self::AxialEdge,
    ];

    /// Its key in a case file.
    pub fn key(self) -> &'static str {
        match self {
            Self::Tangential => "k_t",
            Self::Radial => "k_r",
            Self::Axial => "k_a",
            Self::TangentialEdge => "k_te",
            Self::RadialEdge => "k_re",
            Self::AxialEdge => "k_ae",
        }
    }

    /// Its unit.
    pub fn unit(self) -> &'static str {
        if (self as usize) < 3 { "N/mm²" } else { "N/mm" }
    }
}

impl FromStr for Coefficient {
    type Err = NoSuchCoefficient;

    fn from_str(key: &str) -> Result<Self, NoSuchCoefficient> {
        Self::ALL.into_iter().find(|c| c.key() == key).ok_or_else(|| NoSuchCoefficient(key.into()))
    }
}

/// A key that no coefficient has.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("no coefficient is called {0:?}: expected k_t, k_r, k_a, k_te, k_re or k_ae")]
pub struct NoSuchCoefficient(String);

/// One row of a log: what was measured, and what the model says of that place.
#[derive(Debug, Clone, PartialEq)]
pub struct Observation {
    /// Force per unit of each coefficient, in the order of [`Coefficient::ALL`]: mm² and mm.
    pub per_coefficient: [Vector3<f64>; 6],
    /// Measured force on the burr in the same frame, N.
    pub force_n: Vector3<f64>,
}

/// A fitted coefficient.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// Which.
    pub coefficient: Coefficient,
    /// Its value.
    pub value: f64,
    /// Half the width of its 95 % interval.
    pub half_width: f64,
}

/// A fit.
#[derive(Debug, Clone, PartialEq)]
pub struct CoefficientFit {
    /// The coefficients that were fitted.
    pub estimates: Vec<Estimate>,
    /// Root mean square of what the model leaves of a force component, N.
    pub residual_n: f64,
    /// Observations in which the burr cut.
    pub used: usize,
}

/// Why a log says nothing.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum CalibrateError {
    /// Not enough rows.
    #[error("{found} observations in which the burr cuts: expected at least {needed}")]
    TooFew {
        /// Rows with a cut.
        found: usize,
        /// Rows needed.
        needed: usize,
    },
    /// A number is none.
    #[error("observation {index}: a force or direction is not finite")]
    NotFinite {
        /// Which, from 0.
        index: usize,
    },
    /// Forces of different coefficients look alike in the log.
    #[error(
        "the log cannot tell {} apart: their forces look alike in it (condition {condition:.1e}, at most {most:.0e}); vary feed \
         speed, depth and the shaft's tilt, or fix some of them", names.join(", ")
    )]
    Alike {
        /// Keys of the coefficients.
        names: Vec<&'static str>,
        /// Ratio of the largest to the least singular value, columns scaled.
        condition: f64,
        /// What is allowed.
        most: f64,
    },
    /// A coefficient that no bone has.
    #[error(
        "the log says {name} = {value:.4} ± {half_width:.4} {unit}, and a coefficient is above 0: is the force that on the burr, in \
         the frame of the poses?"
    )]
    Senseless {
        /// Key of the coefficient.
        name: &'static str,
        /// Its value.
        value: f64,
        /// Half its interval.
        half_width: f64,
        /// Its unit.
        unit: &'static str,
    },
    /// The noise hides a coefficient.
    #[error(
        "the log cannot tell {name}: {value:.4} ± {half_width:.4} {unit}, an interval wider than the largest coefficient of its \
         kind; the model leaves {residual_n:.4} N of a component: log more, or cut deeper"
    )]
    Uncertain {
        /// Key of the coefficient.
        name: &'static str,
        /// Its value.
        value: f64,
        /// Half its interval.
        half_width: f64,
        /// Its unit.
        unit: &'static str,
        /// Root mean square residual, N.
        residual_n: f64,
    },
}

/// Condition of the scaled problem above which coefficients cannot be separated.
const MOST_CONDITION: f64 = 1e5;
/// A direction of the problem with less than this share in a coefficient is not its fault.
const SHARE: f64 = 0.3;
/// A coefficient of 0 comes out within this share of the largest of its kind.
const ROUNDING: f64 = 1e-9;
/// Forces per coefficient below this are none, mm² or mm.
const NOTHING: f64 = 1e-12;

/// Fits the coefficients `wanted` to the log; those not wanted are 0.
///
/// # Errors
/// [`CalibrateError`] when the log cannot tell them.
///
/// **Source:** ordinary least squares; the linear model is docs/force-model.md 3.
pub fn calibrate(log: &[Observation], wanted: &[Coefficient]) -> Result<CoefficientFit, CalibrateError> {
    for (index, row) in log.iter().enumerate() {
        let finite = |v: &Vector3<f64>| v.iter().all(|c| c.is_finite());
        if !(finite(&row.force_n) && row.per_coefficient.iter().all(finite)) {
            return Err(CalibrateError::NotFinite { index });
        }
    }
    let columns: Vec<usize> =
        Coefficient::ALL.iter().filter(|c| wanted.contains(c)).map(|c| *c as usize).collect();
    let cuts = |row: &&Observation| columns.iter().any(|c| row.per_coefficient[*c].amax() > NOTHING);
    let rows: Vec<&Observation> = log.iter().filter(cuts).collect();
    let (used, unknowns) = (rows.len(), columns.len());
    let needed = unknowns + 1;
    if used < needed || unknowns == 0 {
        return Err(CalibrateError::TooFew { found: used, needed: needed.max(2) });
    }
    let design = DMatrix::from_fn(3 * used, unknowns, |i, j| rows[i / 3].per_coefficient[columns[j]][i % 3]);
    let measured = DVector::from_fn(3 * used, |i, _| rows[i / 3].force_n[i % 3]);
    let scale: Vec<f64> = design.column_iter().map(|c| c.norm()).collect();
    let names = |which: &dyn Fn(usize) -> bool| -> Vec<&'static str> {
        (0..unknowns).filter(|j| which(*j)).map(|j| Coefficient::ALL[columns[j]].key()).collect()
    };
    let alike = |names, condition| CalibrateError::Alike { names, condition, most: MOST_CONDITION };
    if scale.iter().any(|s| *s <= NOTHING) {
        return Err(alike(names(&|j| scale[j] <= NOTHING), f64::INFINITY));
    }
    let scaled = DMatrix::from_fn(3 * used, unknowns, |i, j| design[(i, j)] / scale[j]);
    let svd = scaled.svd(true, true);
    let (Some(u), Some(v_t)) = (&svd.u, &svd.v_t) else {
        return Err(alike(names(&|_| true), f64::INFINITY));
    };
    let (most, least) = (svd.singular_values.max(), svd.singular_values.min());
    if least * MOST_CONDITION < most {
        let weakest = svd.singular_values.imin();
        let condition = if least > 0.0 { most / least } else { f64::INFINITY };
        return Err(alike(names(&|j| v_t[(weakest, j)].abs() > SHARE), condition));
    }
    let along = (u.transpose() * &measured).component_div(&svd.singular_values);
    let solution = v_t.transpose() * along;
    let value: Vec<f64> = (0..unknowns).map(|j| solution[j] / scale[j]).collect();
    let residual = &measured - &design * DVector::from_vec(value.clone());
    let freedom = (3 * used - unknowns) as f64;
    let variance = residual.norm_squared() / freedom;
    let half_width = |j: usize| {
        let spread: f64 = (0..unknowns).map(|k| (v_t[(k, j)] / svd.singular_values[k]).powi(2)).sum();
        student_t95(freedom) * (variance * spread).sqrt() / scale[j]
    };
    let estimates: Vec<Estimate> = (0..unknowns)
        .map(|j| Estimate {
            coefficient: Coefficient::ALL[columns[j]],
            value: value[j],
            half_width: half_width(j),
        })
        .collect();
    let residual_n = (residual.norm_squared() / (3 * used) as f64).sqrt();
    for estimate in &estimates {
        let alike = estimates.iter().filter(|e| e.coefficient.unit() == estimate.coefficient.unit());
        let largest = alike.map(|e| e.value.abs()).fold(0.0, f64::max);
        // not above 0 with all that its interval allows; nor where it is no number
        let reaches = estimate.value + estimate.half_width >= -ROUNDING * largest;
        if !(largest > 0.0 && reaches && estimate.half_width.is_finite()) {
            return Err(CalibrateError::Senseless {
                name: estimate.coefficient.key(),
                value: estimate.value,
                half_width: estimate.half_width,
                unit: estimate.coefficient.unit(),
            });
        }
        if estimate.half_width > largest {
            return Err(CalibrateError::Uncertain {
                name: estimate.coefficient.key(),
                value: estimate.value,
                half_width: estimate.half_width,
                unit: estimate.coefficient.unit(),
                residual_n,
            });
        }
    }
    Ok(CoefficientFit { estimates, residual_n, used })
}

/// The two-sided 95 % quantile of Student's t, to 1e-3 from 3 degrees of freedom on.
///
/// **Source:** Cornish–Fisher expansion about the normal quantile; Abramowitz & Stegun 26.7.5.
pub(crate) fn student_t95(freedom: f64) -> f64 {
    let z: f64 = 1.959_963_984_540_054;
    let n = freedom.max(3.0);
    let g1 = (z.powi(3) + z) / 4.0;
    let g2 = (5.0 * z.powi(5) + 16.0 * z.powi(3) + 3.0 * z) / 96.0;
    let g3 = (3.0 * z.powi(7) + 19.0 * z.powi(5) + 17.0 * z.powi(3) - 15.0 * z) / 384.0;
    let g4 = (79.0 * z.powi(9) + 776.0 * z.powi(7) + 1482.0 * z.powi(5) - 1920.0 * z.powi(3) - 945.0 * z)
        / 92_160.0;
    z + g1 / n + g2 / n.powi(2) + g3 / n.powi(3) + g4 / n.powi(4)
}

#[cfg(test)]
mod tests {
    use super::*;

    const TRUE: [f64; 6] = [1400.0, 840.0, 140.0, 0.05, 0.07, 0.02];

    /// Reproducible noise, uniform in ±1.
    fn noise(n: usize) -> f64 {
        let x = (n as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        let x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((x ^ (x >> 31)) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    /// Poses with directions and sizes of their own; `speeds` sets the cutting part against the edge part.
    fn log(count: usize, noise_n: f64, speed: impl Fn(usize) -> f64) -> Vec<Observation> {
        let direction = |n: usize, m: usize| {
            Vector3::new(noise(7 * n + m), noise(11 * n + m + 900), noise(13 * n + m + 77))
        };
        (0..count)
            .map(|n| {
                let per_coefficient = std::array::from_fn(|m| {
                    if m < 3 { direction(n, m) * 1e-3 * speed(n) } else { direction(n, m - 3) * 4.0 }
                });
                let force = per_coefficient.iter().zip(TRUE).map(|(g, k)| g * k).sum::<Vector3<f64>>();
                let error = Vector3::from_fn(|a, _| noise_n * noise(3 * n + a + 5000));
                Observation { per_coefficient, force_n: force + error }
            })
            .collect()
    }

    #[test]
    fn a_clean_log_gives_the_coefficients_back() {
        let fit = calibrate(&log(60, 0.0, |n| 0.5 + (n % 5) as f64), &Coefficient::ALL).unwrap();
        for (estimate, expected) in fit.estimates.iter().zip(TRUE) {
            assert!((estimate.value - expected).abs() < 1e-8 * expected, "{estimate:?}");
            assert!(estimate.half_width < 1e-6 * expected);
        }
        assert_eq!(fit.used, 60);
    }

    /// 95 % intervals hold the truth about 95 times in 100.
    #[test]
    fn intervals_hold_what_they_say() {
        let (mut inside, mut all) = (0, 0);
        for run in 0..200 {
            let full = log(40 * 201, 0.1, |n| 0.5 + (n % 5) as f64);
            let fit = calibrate(&full[40 * run..40 * (run + 1)], &Coefficient::ALL[..3]);
            // the edge part is left out of the fit, so it is taken out of the forces
            let Ok(_) = fit else { continue };
            let without_edge: Vec<Observation> = full[40 * run..40 * (run + 1)]
                .iter()
                .map(|o| {
                    let edge: Vector3<f64> = (3..6).map(|m| o.per_coefficient[m] * TRUE[m]).sum();
                    Observation { force_n: o.force_n - edge, ..o.clone() }
                })
                .collect();
            for (estimate, expected) in
                calibrate(&without_edge, &Coefficient::ALL[..3]).unwrap().estimates.iter().zip(TRUE)
            {
                inside += usize::from((estimate.value - expected).abs() < estimate.half_width);
                all += 1;
            }
        }
        let share = inside as f64 / all as f64;
        assert!(all > 300 && (0.92..0.98).contains(&share), "{share} of {all}");
    }

    #[test]
    fn one_speed_cannot_tell_edge_from_chip() {
        let Err(CalibrateError::Alike { names, condition, .. }) =
            calibrate(&log(60, 0.0, |_| 2.0), &Coefficient::ALL)
        else {
            panic!("told apart")
        };
        assert!(condition > 1e5 && names.len() >= 2, "{names:?} {condition}");
        // and the cutting part alone is told from the same log
        assert!(calibrate(&log(60, 0.0, |_| 2.0), &Coefficient::ALL[..3]).is_ok());
    }

    #[test]
    fn air_noise_and_nonsense_are_refused() {
        let air = Observation { per_coefficient: [Vector3::zeros(); 6], force_n: Vector3::x() };
        assert_eq!(
            calibrate(&vec![air.clone(); 50], &Coefficient::ALL),
            Err(CalibrateError::TooFew { found: 0, needed: 7 })
        );
        let loud = calibrate(&log(8, 1e4, |n| 0.5 + n as f64), &Coefficient::ALL[..3]);
        assert!(matches!(loud, Err(CalibrateError::Uncertain { .. })), "{loud:?}");
        let mut broken = log(20, 0.0, |_| 1.0);
        broken[3].force_n.y = f64::NAN;
        assert_eq!(calibrate(&broken, &Coefficient::ALL), Err(CalibrateError::NotFinite { index: 3 }));
        assert!(calibrate(&log(20, 0.0, |_| 1.0), &[]).is_err());
        // forces the other way, none at all, and too large to be squared
        for factor in [-1.0, 0.0, 1e300] {
            let mut log = log(20, 0.0, |_| 1.0);
            log.iter_mut().for_each(|o| o.force_n *= factor);
            let found = calibrate(&log, &Coefficient::ALL[..3]);
            assert!(matches!(found, Err(CalibrateError::Senseless { .. })), "{factor}: {found:?}");
        }
        // a coefficient without any force in the log
        let mut silent = log(20, 0.0, |_| 1.0);
        silent.iter_mut().for_each(|o| o.per_coefficient[2] = Vector3::zeros());
        let Err(CalibrateError::Alike { names, .. }) = calibrate(&silent, &Coefficient::ALL[..3]) else {
            panic!("told")
        };
        assert_eq!(names, ["k_a"]);
    }

    #[test]
    fn student_s_quantile_is_the_table_s() {
        for (freedom, expected) in [(5.0, 2.570_582), (10.0, 2.228_139), (30.0, 2.042_272), (1e6, 1.959_964)]
        {
            assert!((student_t95(freedom) - expected).abs() < 1e-3, "{freedom}");
        }
    }
}
