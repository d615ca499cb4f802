//! What every other crate builds on: frames, grids, volumes, triangle meshes, capsules, progress, and stopping long computations.
//!
//! If two frames are mixed up, or a voxel index with millimetres, no error is seen, and beside a nerve that is
//! dangerous. So points and transforms carry their frame in the type, and [`Grid`] is the only place where an index
//! becomes millimetres. Lengths are mm. This crate does no input or output and knows no image format.
//!
//! ```
//! use bonemill_geometry::{Base, Ct, Point, Rigid};
//! use nalgebra::{Rotation3, Vector3};
//! let base_from_ct: Rigid<Base, Ct> = Rigid::new(Rotation3::identity(), Vector3::new(0.0, 0.0, 5.0));
//! let p_base: Point<Base> = base_from_ct * Point::<Ct>::new(1.0, 2.0, 3.0);
//! assert_eq!(p_base.z(), 8.0);
//! ```

pub mod basis;
pub mod cancel;
pub mod capsule;
mod frame;
mod grid;
mod mesh;
mod progress;
mod rigid;
mod target;
#[doc(hidden)]
pub mod testkit;
mod volume;

pub use capsule::Capsule;
pub use frame::{Approach, Base, Block, Ct, Flange, Frame, Link, Lps, Part, Point, Tool, Work};
pub use grid::{Grid, GridError};
pub use mesh::Mesh;
pub use progress::{JobPosition, Progress, Stage};
pub use rigid::{NotARotation, Rigid};
pub use target::{Sheets, Target, TargetRegion};
pub use volume::{Volume, VolumeError, trilinear};
