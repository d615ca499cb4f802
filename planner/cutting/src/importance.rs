//! How much a push toward a structure counts: the one law of importance.
//!
//! ```text
//! w = exp(−κ max(0, r_v − r_v,min)) / √rank
//! ```
//!
//! The rank is the priority over the smallest of the case, so that only their ratios count. r_v is the distance from the burr's centre to the structure, r_v,min that at the structure's clearance. A newton toward the most
//! important structure at its clearance weighs 1, and one toward the fourth half as much. Levels of push, lines, sense of cut,
//! axes and channels are chosen by it. Dillon's α₁ is α_max times the same nearness ([`crate::cost`]): D has no weight for priorities, and chooses
//! one structure where several are near.
//!
//! **Source:** Dillon et al. 2016, equation (8), for the nearness; the root of the rank is this project's own.

use crate::burr::ModelError;
use crate::burr::checked;
use crate::cost::Proximity;

/// The law, with its decay.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Importance {
    kappa_per_mm: f64,
}

impl Importance {
    /// `kappa_per_mm`: how fast the weight falls with distance.
    ///
    /// # Errors
    /// [`ModelError::OutOfRange`] unless κ ≥ 0.
    pub fn new(kappa_per_mm: f64) -> Result<Self, ModelError> {
        checked("kappa, 1/mm", kappa_per_mm, |k| k >= 0.0, "0 or more")?;
        Ok(Self { kappa_per_mm })
    }

    /// exp(−κ max(0, r_v − r_v,min)), 0 to 1: 1 at the clearance and within it.
    pub fn nearness(&self, distance_mm: f64, least_mm: f64) -> f64 {
        (-self.kappa_per_mm * (distance_mm - least_mm).max(0.0)).exp()
    }

    /// w of a structure of a rank, 1 for the most important.
    pub fn weight(&self, near: &Proximity, rank: f64) -> f64 {
        Self::by_rank(self.nearness(near.distance_mm, near.least_mm), rank)
    }

    /// What counts as `value` for the most important structure, for one of a rank.
    pub fn by_rank(value: f64, rank: f64) -> f64 {
        value / rank.sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    #[test]
    fn a_push_counts_less_with_distance_and_rank() {
        let law = Importance::new(0.7).unwrap();
        let at = |mm: f64| Proximity::new(Vector3::x() * mm, 3.5).unwrap();
        assert_eq!(
            [law.weight(&at(3.5), 1.0), law.weight(&at(2.0), 1.0), law.weight(&at(3.5), 4.0)],
            [1.0, 1.0, 0.5]
        );
        assert!((law.weight(&at(4.5), 1.0) - (-0.7f64).exp()).abs() < 1e-15);
        assert!(Importance::new(-0.1).is_err() && Importance::new(f64::NAN).is_err());
    }
}
