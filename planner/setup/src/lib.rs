//! A case and its images as a machinist's setup: cutter, material, shank, arm, scene, and where the patient is.

mod error;
pub mod channel;
mod channel_fault;
pub mod inputs;
pub mod nearest_structures;
pub mod registration;
mod setup;
mod stopwatch;
pub mod tools;

pub use error::{PlanError, Unreached};
pub use channel_fault::ChannelFault;
pub use setup::Setup;
pub use stopwatch::Stopwatch;
