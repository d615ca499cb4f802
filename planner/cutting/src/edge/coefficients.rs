//! The specific cutting coefficient k_c and the friction coefficient k_f of an element: published regressions.
//!
//! | model | k_c, N/mm² | k_f k_c, N/mm² |
//! |---|---|---|
//! | constant | c | c k_f |
//! | rake (Lazar & Xirouchakis, Faieghi et al.) | c₀ + c₁ (1 − sin γ_n) | d₀ + d₁ (1 − sin γ_n) |
//! | chip (for γ_n = 0, as a reamer's) | exp(c₀) A_u^c₁ V^c₂ | exp(d₀) A_u^d₁ V^d₂ |
//! | power law (Chandrasekharan et al.) | exp(c₀) A_u^c₁ V^c₂ (1 − sin γ_n)^c₃ | likewise |
//! | reciprocal (Zheng et al.) | c₀ + c₁/V | d₀ + d₁/V |
//!
//! A_u in mm², V in mm/s. The friction force per chip area k_f k_c is modelled instead of k_f alone: then thrust and torque are
//! linear in the coefficients of the constant, rake and reciprocal models, and a fit has one optimum. The sources do not print their
//! regressions; the forms are the simplest with the stated variables, and the coefficients come from a calibration.
//! A model gives what it gives: a linear one can turn negative away from the data that it was fitted to, which is reported, not hidden.

use std::f64::consts::PI;

use crate::cutter::EdgeElement;

use super::uncut_area_mm2;
use crate::burr::{ModelError, checked};

/// What a regression looks at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cut {
    /// A_u, mm².
    pub area_mm2: f64,
    /// V, mm/s.
    pub speed_mm_s: f64,
    /// 1 − sin γ_n.
    pub one_less_sin_rake: f64,
}

impl Cut {
    /// What an element does at a feed and speed.
    pub fn of(element: &EdgeElement, feed_mm_rev: f64, spindle_rpm: f64) -> Self {
        let around = 2.0 * PI * element.radius_mm * spindle_rpm / 60.0;
        Self {
            area_mm2: uncut_area_mm2(element, feed_mm_rev),
            speed_mm_s: around / element.mu_rad.cos(),
            one_less_sin_rake: 1.0 - element.gamma_n_rad.sin(),
        }
    }
}

/// k_c and k_f k_c of an element; each pair holds the coefficients of the two.
#[derive(Debug, Clone, PartialEq)]
pub enum CoefficientModel {
    /// The same everywhere.
    Constant([f64; 2]),
    /// Linear in 1 − sin γ_n.
    Rake([[f64; 2]; 2]),
    /// A power law of A_u and V.
    Chip([[f64; 3]; 2]),
    /// A power law of A_u, V and 1 − sin γ_n.
    PowerLaw([[f64; 4]; 2]),
    /// Linear in 1/V.
    Reciprocal([[f64; 2]; 2]),
}

impl CoefficientModel {
    /// k_c, N/mm², and k_f the same everywhere.
    ///
    /// # Errors
    /// [`ModelError::OutOfRange`] unless both are finite, k_c from 0 to 10⁶ and k_f from 0 to 100.
    pub fn constant(k_c_n_mm2: f64, k_f: f64) -> Result<Self, ModelError> {
        checked("k_c, N/mm²", k_c_n_mm2, |k| (0.0..=1e6).contains(&k), "0 to 1e6")?;
        checked("k_f", k_f, |k| (0.0..=100.0).contains(&k), "0 to 100")?;
        Ok(Self::Constant([k_c_n_mm2, k_c_n_mm2 * k_f]))
    }

    /// Its name in tables and logs.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Constant(_) => "constant",
            Self::Rake(_) => "rake",
            Self::Chip(_) => "chip",
            Self::PowerLaw(_) => "power law",
            Self::Reciprocal(_) => "reciprocal",
        }
    }

    /// k_c and k_f k_c, N/mm²: what a chip of 1 mm² gives normal to the rake face and along it.
    pub fn at(&self, cut: &Cut) -> [f64; 2] {
        let power = |k: &[f64]| {
            let logs = [1.0, cut.area_mm2.ln(), cut.speed_mm_s.ln(), cut.one_less_sin_rake.ln()];
            k.iter().zip(logs).map(|(k, l)| k * l).sum::<f64>().exp()
        };
        match self {
            Self::Constant(k) => *k,
            Self::Rake(k) => k.map(|[a, b]| a + b * cut.one_less_sin_rake),
            Self::Reciprocal(k) => k.map(|[a, b]| a + b / cut.speed_mm_s),
            // no chip, no force: the logarithm of 0 is not taken
            Self::Chip(_) | Self::PowerLaw(_) if cut.area_mm2 <= 0.0 => [0.0; 2],
            Self::Chip(k) => [power(&k[0]), power(&k[1])],
            Self::PowerLaw(k) => [power(&k[0]), power(&k[1])],
        }
    }
}
