//! What removes bone: the shapes of cutters, their cutting edges, and the shank behind them.
//!
//! A cutter that spins removes what its solid of revolution passes through ([`SolidOfRevolution`]); a ball is the case whose volumes
//! and sweeps have closed forms ([`ball`]). Its cutting edges are chains of small elements, each with the angles of oblique cutting
//! ([`EdgeElement`]). [`TwistDrill`], [`GlenoidReamer`] and [`MeshCutter`] yield both, and a mesh for a viewer, as [`Cutter`].
//! Behind the cutter the shank ([`ShankCylinder`]) must stay out of bone. What the edges feel is physics, not shape: see `bonemill-cutting`.
//!
//! Tool frame: z along the shaft to the handpiece. The origin of a ball is its centre; that of every other cutter is where its axis
//! meets the lowest cutting edge (a drill's chisel edge, a reamer's pole) or, of a mesh, the plane of its lowest point. Edges turn in the positive sense about z, as in the
//! source; a cutter that turns the other way is its mirror image, with the same thrust and torque.
//!
//! ```
//! use bonemill_cutting::cutter::{Cutter, TwistDrill, TwistDrillSpec};
//! let drill = TwistDrill::new(TwistDrillSpec { web_mm: 0.2, ..TwistDrillSpec::FAIEGHI })?;
//! let edges = drill.edges(0.02, 64)?;
//! assert_eq!((edges.copies, edges.elements.len()), (2, 128));   // 64 along the lip, 64 along the chisel edge
//! assert_eq!(drill.solid().max_radius_mm(), 1.25);
//! # Ok::<(), bonemill_cutting::cutter::CutterError>(())
//! ```

pub mod ball;
mod ball_shape;
mod drill;
mod edge;
mod error;
mod mesh_cutter;
mod moves;
mod reamer;
mod shank;
mod solid;
#[cfg(test)]
mod tests;

pub use ball_shape::Ball;
pub use drill::{TwistDrill, TwistDrillSpec};
pub use edge::{Cutter, CuttingEdges, EdgeElement, EdgeKind};
pub use error::{CutterError, checked};
pub use mesh_cutter::{EdgeSource, MeshCutter, MeshCutterSpec};
pub use moves::MoveKind;
pub use reamer::{GlenoidReamer, GlenoidReamerSpec};
pub use shank::ShankCylinder;
pub use solid::SolidOfRevolution;
