//! How exact the forces of a plan are, measured on the plan itself: some of its cuts are computed again, far more finely.
//!
//! What is stated of a move is a mean and a largest force; both come from a few places within the move, with the sum over as many
//! elements as the case's accuracy asks for. Here the same move has `PLACES` places, evenly over its way, with twice as many
//! elements from tip to shaft, at least 128. The bone around, the driven path and the axes are the same, so the error is that of the sums alone.

use bonemill_case::{Accuracy, Case};
use bonemill_cutting::burr::EngagedForce;
use bonemill_setup::nearest_structures::NearStructure;
use bonemill_toolpath::engagement::SweptPath;
use nalgebra::{Unit, Vector3};
use rayon::prelude::*;

use super::PlanError;
use super::path_forces::{FineForce, ForceWithin, ForcedPath, axis_within, mean_of_move, places_of_move};

/// Of so many cuts one is computed again, evenly over the plan, but so many at least and at most.
const ONE_IN: usize = 16;
const FEWEST: usize = 24;
const MOST: usize = 192;
/// Places within each.
const PLACES: usize = 8;
/// Elements from tip to shaft, at least and at most.
const FEWEST_ELEMENTS: u32 = 128;
const MOST_ELEMENTS: u32 = 512;

/// Errors of stated forces at the nominal speed, as shares of the converged ones.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ForceError {
    /// Elements from tip to shaft of the sums whose errors these are.
    pub elements: u32,
    /// Cuts that were computed again.
    pub cuts: usize,
    /// Of the mean |F| over these cuts.
    pub mean_share: f64,
    /// Of the mean |F| of single cuts: Σ |error| Δs over Σ |F| Δs.
    pub of_cuts_share: f64,
    /// Of the mean push toward structures of single cuts: Σ |error| Δs over Σ push Δs; 0 where nothing pushes.
    pub toward_share: f64,
    /// The largest by which a force at one of the places exceeds the largest that is stated of its cut, over the largest |F|.
    pub beyond_share: f64,
}

impl ForceError {
    /// Whether |F| or the push toward structures of single cuts errs by more than a share.
    pub fn exceeds(&self, share: f64) -> bool {
        self.of_cuts_share.max(self.toward_share) > share
    }
}

/// What is asked of a move: mean and largest |F|, and the mean push toward each structure near, N.
struct OfMove {
    mean_n: f64,
    largest_n: f64,
    toward_n: Vec<f64>,
}

impl ForcedPath<'_> {
    /// The error of forces at the ends of moves and within them.
    ///
    /// # Errors
    /// When the tool or the material is not usable.
    pub fn error(
        &self,
        (case, swept, near): (&Case, &SweptPath, &[Vec<NearStructure>]),
        axes: &[Unit<Vector3<f64>>],
        (length_mm, ends, within): (&[f64], &[Option<EngagedForce>], &[Vec<ForceWithin>]),
    ) -> Result<ForceError, PlanError> {
        let elements = case.accuracy.force_elements;
        let force_elements = (2 * elements).clamp(FEWEST_ELEMENTS, MOST_ELEMENTS).max(elements);
        let accuracy = Accuracy { force_elements, ..case.accuracy };
        let fine = FineForce::new(&Case { accuracy, ..case.clone() })?;
        let nominal_mm_s = case.speed.nominal_mm_s;
        let cuts: Vec<usize> = (1..ends.len()).filter(|i| ends[*i].is_some()).collect();
        let step = cuts.len().div_ceil((cuts.len() / ONE_IN).clamp(FEWEST, MOST)).max(1);
        let cuts: Vec<usize> = cuts.iter().copied().step_by(step).collect();
        let stated = |i: usize| {
            let mean = |of: &dyn Fn(&Vector3<f64>, f64) -> f64| {
                let driven = [nominal_mm_s, 1.0, nominal_mm_s];
                mean_of_move(ends[i].as_ref(), &within[i], driven, |way| way, of)
            };
            let sizes = places_of_move(ends[i].as_ref(), &within[i]);
            OfMove {
                mean_n: mean(&|force, _| force.norm()),
                largest_n: sizes.map(|(_, force)| force.force_n(nominal_mm_s).norm()).fold(0.0, f64::max),
                toward_n: near[i]
                    .iter()
                    .map(|near| mean(&|force, at| near.most(force, at).max(0.0)))
                    .collect(),
            }
        };
        let converged = |i: usize| {
            let mut found = OfMove { mean_n: 0.0, largest_n: 0.0, toward_n: vec![0.0; near[i].len()] };
            for place in 0..PLACES {
                let at = (place as f64 + 0.5) / PLACES as f64;
                let weight = |density| fine.material.weight(density);
                let bone = swept.bone_within((i as u32, at), fine.kernel.sample_radius_mm(), weight);
                let Some((feed, bone)) = bone else { continue };
                let force = fine.of(bone, &axis_within(axes, i, at), &feed).force_n(nominal_mm_s);
                found.mean_n += force.norm() / PLACES as f64;
                found.largest_n = found.largest_n.max(force.norm());
                for (toward_n, near) in found.toward_n.iter_mut().zip(&near[i]) {
                    *toward_n += near.most(&force, at).max(0.0) / PLACES as f64;
                }
            }
            found
        };
        let pairs: Vec<_> = cuts.par_iter().map(|i| (length_mm[*i], stated(*i), converged(*i))).collect();
        let sum = |of: &dyn Fn(&OfMove, &OfMove) -> f64| -> f64 {
            pairs.iter().map(|(length_mm, stated, converged)| length_mm * of(stated, converged)).sum()
        };
        let share = |error: f64, of: f64| if of > 0.0 { error / of } else { 0.0 };
        let all = sum(&|_, converged| converged.mean_n);
        let toward = |stated: &OfMove, converged: &OfMove| -> f64 {
            stated.toward_n.iter().zip(&converged.toward_n).map(|(a, b)| (a - b).abs()).sum()
        };
        let largest_n = pairs.iter().map(|(.., converged)| converged.largest_n).fold(0.0, f64::max);
        let beyond_n = pairs.iter().map(|(_, stated, converged)| converged.largest_n - stated.largest_n);
        Ok(ForceError {
            elements,
            cuts: cuts.len(),
            mean_share: share(sum(&|stated, converged| stated.mean_n - converged.mean_n).abs(), all),
            of_cuts_share: share(sum(&|stated, converged| (stated.mean_n - converged.mean_n).abs()), all),
            toward_share: share(sum(&toward), sum(&|_, converged| converged.toward_n.iter().sum())),
            beyond_share: share(beyond_n.fold(0.0, f64::max), largest_n),
        })
    }
}
