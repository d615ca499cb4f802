//! What an axis costs at a waypoint by Dillon's equations (5) to (12). Reported always; axes are chosen by it only with
//! `cost.objective = "dillon"`, else by levels of force.
//!
//! ```text
//! F_v = max(0, F·û_v)      α_1 = α_max exp(−κ max(0, r_v − r_v,min))      α_2 = 1 − α_1
//! C = α_1 F_v/|F| + α_2 (1 − I_n)
//! ```
//!
//! û_v points from the burr's centre to the nearest structure, r_v away. With a stiffness, the deflection
//! Δp = J χ⁻¹ Jᵀ F takes the place of F: only directions enter, so the caller passes either vector. Without mass nothing is
//! cut: C = 0.

mod several;

pub use several::{Ranked, SeveralStructures, Terms};

use nalgebra::{Unit, Vector3};

use crate::burr::ModelError;
use crate::burr::checked;
use crate::importance::Importance;

/// The weights of the cost.
#[derive(Debug, Clone, PartialEq)]
pub struct CostModel {
    importance: Importance,
    alpha_max: f64,
}

/// What stands near the burr.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Proximity {
    /// Unit direction from the burr's centre to the nearest point of the structure.
    pub toward: Unit<Vector3<f64>>,
    /// r_v: distance from the burr's centre to that point, mm.
    pub distance_mm: f64,
    /// r_v,min: burr radius plus the structure's clearance, mm.
    pub least_mm: f64,
}

/// The cost of one axis at one waypoint, with its parts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cost {
    /// α_1.
    pub alpha_1: f64,
    /// The component toward the structure, 0 if it points away: N for a force, mm for a deflection.
    pub toward: f64,
    /// That component over the magnitude, 0 to 1.
    pub fraction: f64,
    /// C, 0 to 1.
    pub cost: f64,
}

impl CostModel {
    /// `kappa_per_mm`: how fast α_1 falls with distance; `alpha_max`: α_1 at r_v,min (0.5 as printed, 0.8 matches the text).
    ///
    /// # Errors
    /// [`ModelError::OutOfRange`] unless κ ≥ 0 and 0 ≤ α_max ≤ 1.
    pub fn new(kappa_per_mm: f64, alpha_max: f64) -> Result<Self, ModelError> {
        checked("alpha_max", alpha_max, |a| (0.0..=1.0).contains(&a), "0 to 1")?;
        Ok(Self { importance: Importance::new(kappa_per_mm)?, alpha_max })
    }

    /// α_1 = α_max exp(−κ max(0, r_v − r_v,min)): never above α_max, also inside the clearance.
    ///
    /// **Source:** Dillon et al. 2016, equation (8), clamped (docs/force-model.md 8, resolution 10).
    pub fn alpha_1(&self, distance_mm: f64, least_mm: f64) -> f64 {
        self.alpha_max * self.importance.nearness(distance_mm, least_mm)
    }
}

impl Proximity {
    /// From the burr's centre and the nearest point of the structure, in one frame.
    ///
    /// # Errors
    /// [`ModelError::Vector`] when the burr's centre lies on the point, so that there is no direction;
    /// [`ModelError::OutOfRange`] for a clearance distance that is not positive.
    pub fn new(to_nearest_mm: Vector3<f64>, least_mm: f64) -> Result<Self, ModelError> {
        checked("least distance of burr and structure, mm", least_mm, |r| r > 0.0, "positive")?;
        let toward = crate::burr::direction("from burr to nearest structure, mm", to_nearest_mm)?;
        Ok(Self { toward, distance_mm: to_nearest_mm.norm(), least_mm })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn vector() -> impl Strategy<Value = Vector3<f64>> {
        prop::array::uniform3(-1.0f64..1.0).prop_map(Vector3::from)
    }

    proptest! {
        #![proptest_config(bonemill_geometry::fixed!(256))]

        #[test]
        fn cost_is_between_0_and_1_and_ignores_the_force_s_size(
            force in vector(), to in vector(), i_n in 0.0f64..1.0, scale in 0.1f64..100.0,
        ) {
            prop_assume!(to.norm() > 1e-3 && force.norm() > 1e-3);
            let model = CostModel::new(0.7, 0.8).unwrap();
            let near = Ranked { proximity: Proximity::new(to * 10.0, 3.5).unwrap(), priority: 1 };
            let terms = model.terms(&[near], SeveralStructures::Nearest);
            let [a, b] = [force, force * scale].map(|force| terms.cost(&force, i_n, 1.0));
            prop_assert!((0.0..=1.0).contains(&a.cost) && (0.0..=1.0).contains(&a.fraction));
            prop_assert!((a.cost - b.cost).abs() < 1e-14);
            // toward and away: one of them is 0
            let back = terms.cost(&-force, i_n, 1.0);
            prop_assert_eq!(a.toward * back.toward, 0.0);
        }

        #[test]
        fn alpha_falls_with_distance(d in 0.0f64..20.0) {
            let model = CostModel::new(0.7, 0.8).unwrap();
            prop_assert!(model.alpha_1(d + 0.1, 3.0) <= model.alpha_1(d, 3.0) && model.alpha_1(d, 3.0) <= 0.8);
        }
    }

    #[test]
    fn bad_input_is_refused() {
        assert!(CostModel::new(-1.0, 0.5).is_err() && CostModel::new(1.0, 1.5).is_err());
        assert!(CostModel::new(f64::NAN, 0.5).is_err());
        assert!(matches!(Proximity::new(Vector3::zeros(), 3.0), Err(ModelError::Vector { .. })));
        assert!(Proximity::new(Vector3::x(), 0.0).is_err());
    }
}
