//! A part to be machined, from its file to a solid.
//!
//! A file (STL, OBJ or PLY) gives facets ([`read_facets`]); [`Solid::from_facets`] checks that they bound one solid, repairs what
//! can be repaired without doubt, lists every change, and refuses the rest with its place. [`phantom`] draws parts to
//! test with.
//!
//! Invariant: a [`Solid`] is closed, manifold, oriented outwards, in one piece, and no two of its facets cross deeper than
//! [`CROSSING_TOLERANCE_MM`]. Lengths are mm. Not here: stock, toolpaths.
//!
//! ```
//! use bonemill_imaging::part::{Facets, LengthUnit, RepairLimits, Solid};
//! // a tetrahedron with edges of 10 mm along the axes, one facet turned inwards
//! let facets = Facets::new(
//!     vec![[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0, 10.0, 0.0], [0.0, 0.0, 10.0]],
//!     vec![[0, 1, 2], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
//! );
//! let solid = Solid::from_facets(facets, Some(LengthUnit::Mm), &RepairLimits::default())?;
//! assert!((solid.mesh.volume_mm3() - 1000.0 / 6.0).abs() < 1e-9);
//! assert_eq!(solid.changes.len(), 1);
//! # Ok::<(), bonemill_imaging::part::PartError>(())
//! ```

mod change;
mod crossings;
mod edges;
mod error;
mod facets;
mod holes;
pub mod phantom;
mod pieces;
mod pinches;
mod ply;
mod polygon;
mod read;
mod solid;
mod stl;
mod triangle_pair;
mod turn;
mod unit;
mod weld;

pub use change::Change;
pub use error::{FacetPlace, PartError};
pub use facets::{Facets, MOST_FACETS};
pub use read::{MeshFormat, parse_facets, read_facets};
pub use solid::{CROSSING_TOLERANCE_MM, RepairLimits, Solid};
pub use stl::{rounded, stl_bytes, stl_bytes_lps};
pub use unit::{LONGEST_MM, LengthUnit, SHORTEST_MM};
