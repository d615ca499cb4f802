//! A case and its images as a machinist's setup: cutter, material, shank, arm, scene, and where the patient is.

pub mod armpath;
pub mod channel;
mod channel_fault;
mod error;
pub mod inputs;
mod label_files;
pub mod mesh_tool;
pub mod mount;
pub mod nearest_structures;
pub mod reach;
pub mod registration;
pub mod room;
mod setup;
pub mod stand;
mod stopwatch;
pub mod survey;
pub mod tools;

pub use channel_fault::ChannelFault;
pub use error::{PlanError, Unreached};
pub use label_files::LabelFileFault;
pub use setup::Setup;
pub use stopwatch::Stopwatch;
