//! I_n as a function of one angle.

use std::f64::consts::PI;

use nalgebra::{Matrix3, Unit, Vector3};

/// I_n(θ) = mean + d₁ cos(θ − ψ) + d₂ cos(2θ − φ) while the shaft turns by θ about a fixed axis.
///
/// For a shaft across the turning axis, as on a robot with one tilt joint, d₁ = 0 and this is A + B cos(2θ − φ); a shaft
/// that sweeps a cone has both.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InertiaAlongTurn {
    mean: f64,
    /// cos and sin parts of the first and second harmonic.
    first: [f64; 2],
    second: [f64; 2],
}

/// Steps of the scan for the maximum where both harmonics are there; 5° apart no two maxima fall between two steps.
const SCAN: usize = 72;

impl InertiaAlongTurn {
    /// `scaled` is S/(m r²); the axis is Rot(`about`, θ) `from`.
    pub(super) fn new(scaled: &Matrix3<f64>, from: &Unit<Vector3<f64>>, about: &Unit<Vector3<f64>>) -> Self {
        // a(θ) = w + cos θ p + sin θ q
        let w = about.into_inner() * about.dot(from);
        let p = from.into_inner() - w;
        let q = about.cross(&p);
        let form = |a: &Vector3<f64>, b: &Vector3<f64>| a.dot(&(scaled * b));
        let (pp, qq, pq) = (form(&p, &p), form(&q, &q), form(&p, &q));
        Self {
            mean: 1.0 - form(&w, &w) - 0.5 * (pp + qq),
            first: [-2.0 * form(&w, &p), -2.0 * form(&w, &q)],
            second: [-0.5 * (pp - qq), -pq],
        }
    }

    /// I_n at θ, rad.
    pub fn at(&self, theta_rad: f64) -> f64 {
        let (s, c) = theta_rad.sin_cos();
        self.mean
            + self.first[0] * c
            + self.first[1] * s
            + self.second[0] * (c * c - s * s)
            + self.second[1] * 2.0 * s * c
    }

    /// The constant A.
    pub fn mean(&self) -> f64 {
        self.mean
    }

    /// The amplitude B ≥ 0 and phase φ of B cos(2θ − φ), rad.
    pub fn second_harmonic(&self) -> (f64, f64) {
        (self.second[0].hypot(self.second[1]), self.second[1].atan2(self.second[0]))
    }

    /// The θ in [`low_rad`, `high_rad`] with the largest I_n; the lowest of equals. `None` for an empty interval.
    pub fn argmax(&self, low_rad: f64, high_rad: f64) -> Option<f64> {
        let is_interval = low_rad <= high_rad;
        if !is_interval {
            return None;
        }
        let inner = self.maxima().into_iter().flat_map(|theta| {
            // the first turn of the maximum at or above the interval's low end
            let first = theta + ((low_rad - theta) / (2.0 * PI)).ceil() * 2.0 * PI;
            (first <= high_rad).then_some(first)
        });
        let mut best = low_rad;
        let mut candidates: Vec<f64> = inner.chain([high_rad]).collect();
        candidates.sort_by(f64::total_cmp);
        for theta in candidates {
            if self.at(theta) > self.at(best) {
                best = theta;
            }
        }
        Some(best)
    }

    /// The local maxima over a full turn: two without the first harmonic, one or two with it.
    fn maxima(&self) -> Vec<f64> {
        let (second, phase) = self.second_harmonic();
        let first = self.first[0].hypot(self.first[1]);
        if first <= 1e-15 {
            return vec![0.5 * phase, 0.5 * phase + PI];
        }
        if second <= 1e-15 {
            return vec![self.first[1].atan2(self.first[0])];
        }
        let step = 2.0 * PI / SCAN as f64;
        let falling = |&theta: &f64| self.slope(theta) > 0.0 && self.slope(theta + step) <= 0.0;
        (0..SCAN).map(|k| k as f64 * step).filter(falling).map(|theta| self.zero_slope(theta, step)).collect()
    }

    /// dI_n/dθ.
    fn slope(&self, theta: f64) -> f64 {
        let (s, c) = theta.sin_cos();
        let (s2, c2) = (2.0 * theta).sin_cos();
        self.first[1] * c - self.first[0] * s + 2.0 * (self.second[1] * c2 - self.second[0] * s2)
    }

    /// Bisection to the last bit: the slope falls through 0 between `low` and `low + width`.
    fn zero_slope(&self, mut low: f64, mut width: f64) -> f64 {
        for _ in 0..60 {
            width *= 0.5;
            if self.slope(low + width) > 0.0 {
                low += width;
            }
        }
        low
    }
}
