//! What removes bone: the shapes of cutters, and the shank behind them.
//!
//! A cutter that spins removes what its solid of revolution passes through; a ball is the case whose volumes and sweeps have closed
//! forms ([`ball`]). Behind it the shank ([`ShankCylinder`]) must stay out of bone. What the edges feel is physics, not shape: see `bonemill-cutting`.

pub mod ball;
mod ball_shape;
mod moves;
mod shank;

pub use ball_shape::Ball;
pub use moves::MoveKind;
pub use shank::ShankCylinder;
