//! The effect on a plan of errors of registration, segmentation, density and cutting coefficients.
//!
//! Two functions answer two questions. Before planning: how large must a structure's clearance be so that it is not touched
//! with a given probability ([`clearance_mm`])? After planning: how likely is it that the finished plan touches each
//! structure, and how large may the errors of its forces be ([`simulate_errors`])? The first is a bound for every plan; the
//! second is a Monte-Carlo simulation of one plan with confidence intervals, so it is less cautious.
//!
//! The registration's error is rigid and normal, given by its covariance ([`RigidError`]). Each structure's boundary has one
//! normal offset. Forces are scaled: in each sample, K and density each have one normal factor. Not modelled: that a shifted
//! burr meets other bone, errors that differ from voxel to voxel, the robot's own deflection.
//!
//! The same seed gives the same numbers, on any number of threads.

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

/// Why the effect of errors cannot be computed.
#[derive(Debug, Error)]
pub enum UncertaintyError {
    /// A matrix is not a covariance.
    #[error("the covariance is not one: {fault}; expected 6 × 6, symmetric, no variance below 0")]
    Covariance {
        /// What is wrong.
        fault: &'static str,
    },
    /// A number is out of range.
    #[error("{what} = {value}: expected {expected}")]
    Value {
        /// Name of the number.
        what: &'static str,
        /// The number.
        value: f64,
        /// What was expected.
        expected: &'static str,
    },
    /// The plan's images cannot be read.
    #[error(transparent)]
    Verify(#[from] VerifyError),
}

/// Checks that a number is finite and not negative.
fn not_negative(what: &'static str, value: f64) -> Result<f64, UncertaintyError> {
    if value.is_finite() && value >= 0.0 {
        return Ok(value);
    }
    Err(UncertaintyError::Value { what, value, expected: "a finite number, at least 0" })
}

/// Checks that the probability of touching nothing that is asked for is in range.
fn kept(value: f64) -> Result<f64, UncertaintyError> {
    if (0.5..1.0).contains(&value) {
        return Ok(value);
    }
    let expected = "0.5 to below 1, the probability with which every structure must stay untouched";
    Err(UncertaintyError::Value { what: "keep", value, expected })
}
