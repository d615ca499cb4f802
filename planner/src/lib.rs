//! Plans how a robot mills bone.

pub mod case;
pub mod plan;
mod progress;

pub use progress::Progress;
