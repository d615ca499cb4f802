//! Random numbers (splitmix64), by sequence or by counter. They are computed here, so that no update of a dependency
//! changes the phantoms.
//!
//! The counter form gives voxel n its value without the values before it, so that noise does not depend on the order in
//! which voxels are filled, nor on the number of threads.
//!
//! **Source:** Steele, Lea, Flood 2014 (splitmix64), as in docs/force-model.md 11; Box and Muller 1958.

use std::f64::consts::TAU;

const GAMMA: u64 = 0x9E37_79B9_7F4A_7C15;

/// One stream of random numbers.
#[derive(Debug, Clone)]
pub(crate) struct Rng {
    seed: u64,
    drawn: u64,
}

impl Rng {
    /// Stream number `stream` of `seed`. Streams of one seed are independent, and so are equal streams of neighbouring seeds.
    pub(crate) fn new(seed: u64, stream: u64) -> Self {
        Self { seed: mix(mix(seed).wrapping_add(stream.wrapping_mul(GAMMA))), drawn: 0 }
    }

    /// The next number of the stream, uniform in [0, 1).
    pub(crate) fn unit(&mut self) -> f64 {
        self.drawn += 1;
        unit_at(self.seed, self.drawn - 1)
    }

    /// The next number of the stream, uniform in [lo, hi).
    pub(crate) fn range(&mut self, lo: f64, hi: f64) -> f64 {
        lo + (hi - lo) * self.unit()
    }

    /// Number `n` of the stream, uniform in [0, 1). The stream does not advance.
    pub(crate) fn unit_at(&self, n: u64) -> f64 {
        unit_at(self.seed, n)
    }

    /// Number `n` of the stream, standard normal, from the uniform numbers 2n and 2n + 1. The stream does not advance.
    pub(crate) fn normal_at(&self, n: u64) -> f64 {
        let radius = (-2.0 * (1.0 - unit_at(self.seed, 2 * n)).ln()).sqrt();
        radius * (TAU * unit_at(self.seed, 2 * n + 1)).cos()
    }
}

/// u = (splitmix64 of state seed + (n + 1) γ) >> 11, times 2⁻⁵³.
fn unit_at(seed: u64, n: u64) -> f64 {
    let bits = mix(seed.wrapping_add(n.wrapping_add(1).wrapping_mul(GAMMA)));
    (bits >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
}

fn mix(state: u64) -> u64 {
    let z = (state ^ (state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_generator_is_splitmix64() {
        // first outputs for state 1234567, published with the reference implementation
        let expected: [u64; 3] =
            [6_457_827_717_110_365_317, 3_203_168_211_198_807_973, 9_817_491_932_198_370_423];
        for (n, e) in expected.into_iter().enumerate() {
            assert_eq!(mix(1_234_567u64.wrapping_add((n as u64 + 1).wrapping_mul(GAMMA))), e);
        }
    }

    #[test]
    fn sequence_and_counter_agree() {
        let mut rng = Rng::new(5, 2);
        let fixed = rng.clone();
        for n in 0..100 {
            assert_eq!(rng.unit(), fixed.unit_at(n));
        }
        assert_ne!(Rng::new(5, 3).unit(), Rng::new(5, 2).unit());
        assert_ne!(Rng::new(6, 2).unit(), Rng::new(5, 2).unit());
    }

    #[test]
    fn the_normal_numbers_have_the_moments_of_a_normal() {
        let rng = Rng::new(1, 0);
        let n = 200_000;
        let moment = |p: i32| (0..n).map(|i| rng.normal_at(i).powi(p)).sum::<f64>() / n as f64;
        // five standard errors each
        let se = 5.0 / (n as f64).sqrt();
        assert!(moment(1).abs() < se);
        assert!((moment(2) - 1.0).abs() < 2f64.sqrt() * se);
        assert!(moment(3).abs() < 15f64.sqrt() * se);
        assert!((moment(4) - 3.0).abs() < 96f64.sqrt() * se);
        let lag = (1..n).map(|i| rng.normal_at(i) * rng.normal_at(i - 1)).sum::<f64>() / n as f64;
        assert!(lag.abs() < se);
    }
}
