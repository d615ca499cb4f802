//! Simulates bone removal by a moving burr and the force on it: pose by pose for a tool moved by hand, or along a finished
//! plan.
//!
//! - [`Bone`]: densities and kinds from the images; [`Lattice`]: the remaining bone;
//! - [`Engine`]: from pose to pose: force, removal, and contact of the shank;
//! - [`Lattice::touched_surface`]: the surface that a viewer must redraw; [`replay`]: a finished plan along its trajectory;
//! - [`PlungeEngine`]: the same for drills and reamers that plunge;
//! - [`ForceModel`]: the fluted burr ([`FlutedBurr`]) and the lumped removal rate ([`Lumped`]).
//!
//! Sources: Dillon et al. 2016, II-C; Faieghi et al., II (voxmap and point shell, elemental forces); Yang & Chen, 2
//! (swept volume, removal rate, shank collision). Each module states where it differs from them, and why.

mod bone;
mod carve;
mod channel;
mod engagement;
mod engine;
mod error;
mod force_models;
mod lattice;
mod log;
mod model;
mod plunge;
mod poses;
mod rates;
mod replay;
mod save;
mod scene;
mod shank;
mod shank_clearance;
mod surface;
mod swept;
#[cfg(test)]
mod tests;
mod trail;
mod uncut;

pub use bone::{Amount, Bone, VoxelKind};
pub use carve::Piece;
pub use channel::simulate_channel;
pub use engagement::{BurrNodes, Engagement};
pub use engine::{Engine, EngineSpec, Move, Pose, Step};
pub use error::EngineError;
pub use force_models::{ModelName, NoSuchModel};
pub use lattice::Lattice;
pub use log::observe;
pub use model::{CutForce, FlutedBurr, ForceModel, Lumped, LumpedForm, force_per_coefficient};
pub use plunge::{BrickSamples, Holes, PlungeEngine, PlungeSpec};
pub use poses::{PoseError, Sampling};
pub use replay::{
    SimulateError, SimulatedToward, Simulation, SimulationRow, SimulationSetup, replay, simulate,
};
pub use save::{SIMULATION, save_rows};
pub use scene::{bone_of, solid_density};
pub use shank::ShankContact;
pub use surface::BrickMesh;
