//! Normal random numbers from a seed. The numbers of a sample depend only on the seed and the sample's number.

use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::{RngCore, SeedableRng};

/// A stream of standard normal numbers.
#[derive(Debug)]
pub struct Draws(Xoshiro256PlusPlus);

impl Draws {
    /// The stream of a sample.
    pub fn of_sample(seed: u64, sample: u64) -> Self {
        // multiplying by an odd factor gives different states for different samples; the generator mixes the bits
        Self(Xoshiro256PlusPlus::seed_from_u64(seed ^ sample.wrapping_mul(0x9e37_79b9_7f4a_7c15)))
    }

    /// The next number (Box & Muller 1958, one of the pair).
    pub fn normal(&mut self) -> f64 {
        // 53 bits in (0, 1]
        let mut uniform = || ((self.0.next_u64() >> 11) as f64 + 1.0) / (1u64 << 53) as f64;
        let (u, v) = (uniform(), uniform());
        (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn draws_are_standard_normal_and_repeat() {
        let n = 40_000;
        let all: Vec<f64> = (0..n).map(|k| Draws::of_sample(7, k).normal()).collect();
        let mean = all.iter().sum::<f64>() / n as f64;
        let variance = all.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n as f64;
        let beyond_2 = all.iter().filter(|v| v.abs() > 1.959_964).count() as f64 / n as f64;
        assert!(mean.abs() < 0.02 && (variance - 1.0).abs() < 0.03, "{mean} {variance}");
        assert!((beyond_2 - 0.05).abs() < 0.005, "{beyond_2}");
        assert_eq!(Draws::of_sample(7, 3).normal(), Draws::of_sample(7, 3).normal());
    }
}
