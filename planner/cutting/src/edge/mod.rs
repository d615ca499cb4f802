//! The force of bone on cutting edges by oblique cutting: drills, reamers, any cutter that is a chain of edge elements.
//!
//! Each element feels a force normal to its rake face and one along it, in proportion to the chip that it takes
//! (docs/force-model.md 9):
//!
//! ```text
//! A_u = f δ cos μ/N_c        df_n = k_c A_u        df_t = k_f k_c A_u
//! ```
//!
//! turned into the tool's frame by [`element_force`]. k_c and k_f come from a [`CoefficientModel`]. [`EdgeLoads`] holds the forces of
//! all elements at one feed and speed, in bone of the reference density; [`EdgeLoads::sum`] adds those of the elements that are
//! engaged, each with its weight. Force and moment are those ON the cutter, in the tool frame: thrust is F_z, the resisting torque
//! −M_z.
//!
//! [`PlungeFitting`] fits the coefficients to thrust and torque that were logged while a drill enters bone.
//!
//! Left out: ploughing at the edge, wear, heat, and what rubs behind the edges (margins, the wall of the hole).
//!
//! **Source:** Faieghi et al., (1) to (7), corrected as docs/force-model.md 9 explains.
//!
//! ```
//! use bonemill_cutting::cutter::{Cutter, TwistDrill, TwistDrillSpec};
//! use bonemill_cutting::edge::{CoefficientModel, EdgeLoads};
//! let spec = TwistDrillSpec { radius_mm: 1.25, point_deg: 59.0, helix_deg: 20.0, chisel_deg: 116.0, web_mm: 0.15, lips: 2, flute_mm: 30.0 };
//! let drill = TwistDrill::new(spec)?;
//! let loads = EdgeLoads::new(&drill.edges(0.02, 64)?, 0.02, 500.0, &CoefficientModel::constant(150.0, 0.4)?);
//! let force = loads.all_engaged();
//! assert!((0.5..1.5).contains(&force.thrust_n()) && (2.0..3.0).contains(&force.torque_nmm()));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod coefficients;
mod element;
mod fit;
mod loads;
#[cfg(test)]
mod tests;

pub use coefficients::{CoefficientModel, Cut};
pub use element::{element_force, force_directions, uncut_area_mm2};
pub use fit::{PlungeFit, PlungeFitError, PlungeFitting, PlungeInstant, Regression};
pub use loads::{CutterForce, EdgeLoad, EdgeLoads};
