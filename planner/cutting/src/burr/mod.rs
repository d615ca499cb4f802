//! The force of bone on a spherical burr: Dillon's equations (3) and (4).
//!
//! The burr's surface is cut into elements: `blades` meridians, `n_gamma` increments of rotation, `n_kappa` elements from
//! the tip to the shaft. Each element that moves into bone takes a chip t = n·f, f the feed per tooth, and feels
//!
//! ```text
//! dF = −(K_t e_v + K_r n + K_a e_a) t w dl − (K_te e_v + K_re n + K_ae e_a) E w dS
//! ```
//!
//! with w the density weight of the bone there. Three ways to the same sum:
//! - [`burr_force`]: the sum as it is written, with every derived output; the reference for the others;
//! - [`ForceKernel`]: the same nodes, factored over rings; for the planner and the simulation;
//! - [`OrientationKernel`]: another quadrature, whose samples do not depend on the shaft, so that one gathering of bone
//!   serves every candidate axis of a waypoint; also for places within moves.
//!
//! Units: mm, s, N, rad, g/cm³, N/mm². Tool frame: origin at the burr's centre, z along the shaft to the handpiece, x and y by
//! [`bonemill_geometry::basis::from_z`]; polar angle κ from the TIP. The force is the force ON the burr.
//! Not modelled: chips where the cutting speed falls to the feed's (sin κ < |v|/(ωr) ≈ 3e-4), tool bending, wear, heat.
//!
//! ```
//! use bonemill_geometry::{Point, Work};
//! use bonemill_cutting::burr::{Discretisation, Material, Motion, Tool, burr_force};
//! use nalgebra::Vector3;
//! let tool = Tool::new(2.5, 8, -1)?;
//! let foam = Material::new([100.0, 60.0, 20.0], 0.8)?;
//! let motion = Motion::new(Point::<Work>::new(0.0, 0.0, 0.0), Vector3::z(), Vector3::new(1.5, 0.0, 0.0), 20_000.0)?;
//! let force = burr_force(|_| 0.8, &tool, &foam, &Discretisation::default(), &motion);
//! // a full slot pushes the burr back against the feed, and aside
//! assert!(force.force_n.x < -0.2 && force.force_n.y > 0.4);
//! # Ok::<(), bonemill_cutting::burr::ModelError>(())
//! ```

mod error;
mod force;
mod input;
mod kernel;
mod orientation;
pub mod rings;
mod samples;
pub mod sums;
#[cfg(test)]
mod tests;

pub use error::{ModelError, checked};
pub use force::{BurrForce, GRAZING, burr_force};
pub use input::{Discretisation, Element, ElementGrid, Material, Measure, Motion, Tool, direction};
pub use kernel::{AtPoints, BoneAround, EngagedForce, Feed, ForceKernel, OverPatches, Patch, TILE_REACH};
pub use orientation::OrientationKernel;
pub use samples::EngagedSamples;
