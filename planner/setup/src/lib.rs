//! A case and its images as a machinist's setup: cutter, material, shank, arm, scene, and where the patient is.

mod error;
pub mod inputs;
pub mod near;
pub mod registration;
pub mod tools;

pub use error::{PlanError, Unreached};
