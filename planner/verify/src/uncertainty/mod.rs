//! What errors of registration, segmentation, density and cutting coefficients mean for a plan.
//!
//! Two questions. Before planning: how large must a structure's clearance be, so that it is kept with a given probability
//! ([`clearance_mm`])? After planning: how likely does the finished plan touch each structure, and how far may its forces
//! be off ([`simulate_errors`])? The first is a bound that holds whatever the plan does; the second is a Monte-Carlo of
//! this plan with its confidence intervals, so it is less cautious.
//!
//! The registration's error is rigid and normal, given by its covariance ([`RigidError`]); a structure's boundary is off by
//! one normal offset of its own. Forces are scaled: K and density are each off by one normal factor in all of a sample.
//! Not modelled: that a shifted burr meets other bone, errors that differ from voxel to voxel, the robot's own deflection.
//!
//! Same seed, same numbers, on any number of threads.

mod draws;
mod interval;
mod margin;
mod monte_carlo;
mod rigid_error;

use thiserror::Error;

pub use interval::Share;
pub use margin::clearance_mm;
pub use monte_carlo::{ErrorModel, ForceSpread, Risk, Sigmas, StructureRisk, simulate_errors};
pub use rigid_error::RigidError;

use crate::VerifyError;

/// Why uncertainty cannot be judged.
#[derive(Debug, Error)]
pub enum UncertaintyError {
    /// A covariance that is none.
    #[error("the covariance is not one: {fault}; expected 6 × 6, symmetric, no variance below 0")]
    Covariance {
        /// What is wrong.
        fault: &'static str,
    },
    /// A number out of range.
    #[error("{what} = {value}: expected {expected}")]
    Value {
        /// Which.
        what: &'static str,
        /// The number.
        value: f64,
        /// What would be right.
        expected: &'static str,
    },
    /// The plan's images cannot be read.
    #[error(transparent)]
    Verify(#[from] VerifyError),
}

/// A finite number that is not negative.
fn not_negative(what: &'static str, value: f64) -> Result<f64, UncertaintyError> {
    if value.is_finite() && value >= 0.0 {
        return Ok(value);
    }
    Err(UncertaintyError::Value { what, value, expected: "a finite number, at least 0" })
}

/// A probability that can be asked for.
fn probability(value: f64) -> Result<f64, UncertaintyError> {
    if (0.5..1.0).contains(&value) {
        return Ok(value);
    }
    Err(UncertaintyError::Value { what: "probability", value, expected: "0.5 to below 1" })
}
