//! Density that varies from place to place: random numbers on a lattice, smooth between its points.
//!
//! The value at a place depends on the seed and the place alone, so voxels may be filled in any order.

use super::rng::Rng;
use super::shapes::V3;

/// A smooth random field with values in [-1, 1) and no trend.
#[derive(Debug, Clone)]
pub(super) struct Variation {
    rng: Rng,
    /// Distance of neighbouring lattice points, mm: about half of the shortest wavelength.
    spacing_mm: f64,
}

impl Variation {
    /// The field of a stream of random numbers.
    pub(super) fn new(rng: Rng, spacing_mm: f64) -> Self {
        Self { rng, spacing_mm }
    }

    /// The field at a place: cubic blend of the eight lattice points around it.
    pub(super) fn at(&self, p: &V3) -> f64 {
        let scaled = p / self.spacing_mm;
        let corner = scaled.map(f64::floor);
        let share = (scaled - corner).map(|t| t * t * (3.0 - 2.0 * t));
        let mut sum = 0.0;
        for n in 0..8u32 {
            let bit = |a: u32| f64::from(n >> a & 1);
            let weight: f64 = (0..3)
                .map(|a| if bit(a) > 0.0 { share[a as usize] } else { 1.0 - share[a as usize] })
                .product();
            sum += weight * self.lattice(&(corner + V3::new(bit(0), bit(1), bit(2))));
        }
        sum
    }

    /// The value of a lattice point, whose coordinates lie within ±2¹⁹.
    fn lattice(&self, corner: &V3) -> f64 {
        const HALF: f64 = 524_288.0;
        let place = |a: usize| (corner[a] + HALF) as u64;
        2.0 * self.rng.unit_at(place(0) | place(1) << 20 | place(2) << 40) - 1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_field_is_smooth_bounded_and_without_trend() {
        let field = Variation::new(Rng::new(4, 1), 2.0);
        let (mut sum, mut steepest) = (0.0, 0.0f64);
        for n in 0..8000 {
            let p = V3::new((n % 20) as f64, (n / 20 % 20) as f64, (n / 400) as f64) * 1.3 - V3::repeat(11.0);
            let value = field.at(&p);
            assert!((-1.0..1.0).contains(&value));
            sum += value;
            steepest = steepest.max((field.at(&(p + V3::x() * 1e-4)) - value).abs() / 1e-4);
        }
        assert!((sum / 8000.0).abs() < 0.05, "{sum}");
        // the blend's slope is 3/2 at most, between values 2 apart and lattice points 2 mm apart
        assert!(steepest <= 1.5 && steepest > 0.1, "{steepest}");
    }
}
