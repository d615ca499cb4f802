//! How a part is milled from two opposite sides of a block: from a closed mesh to the moves of a cutter.
//!
//! The part lies in its block ([`Block`]) and the cutter comes along y: side A from +y, side B, after half a turn about x, from −y, and side C
//! cuts the strip that holds the part. Seen along the cutter, a part is a height map, and where the tip may be is that map
//! dilated by the cutter's profile. So every stage works on maps over one fine raster ([`raster`]), and the last pass on heights that are exact for
//! the triangles ([`dropcutter`]).
//!
//! [`plan`] does all: envelope of the part by side ([`envelope`]), silhouette and its offsets ([`silhouette`]), the strip ([`strip`]), levels and
//! finishing by rows and, where it is steep, by rings of equal step ([`rings`]), links over the stock as it then is ([`stock`]), the contour, what is left and where
//! ([`leftover`]), and how long it takes ([`time`]). [`trajectory`] drives the moves by an arm.
//!
//! Invariants: at every position of the cutter its tip is at or above the exact dropped height, so the part is never cut beyond
//! [`GOUGE_TOLERANCE_MM`]; same input, same moves, on any number of threads. Not here: files, G-code, and the proof, which shares nothing with this.
//!
//! **Source:** Castelli et al. 2020, section 4, for the sides, the strip and the order; where this departs from it, the module says so.

pub mod dropcutter;
mod effort;
pub mod envelope;
mod error;
mod job;
pub mod leftover;
mod moves;
mod part;
mod pass;
mod passes;
mod plan;
pub mod raster;
mod reach;
pub mod rings;
mod sides;
pub mod silhouette;
pub mod stock;
pub mod strip;
mod surface;
pub mod time;
pub mod trajectory;
mod zigzag;

pub use error::MachiningError;
pub use job::{Block, EndMill, HolderSegment, MachiningJob};
pub use moves::{Facing, Kind, Side, TipMove};
pub use plan::{Machining, Warning, assess, plan, plan_zigzag};
pub use reach::shift_to_reach_mm;
pub use zigzag::ZigZag;

/// How deep a cut may go into the part at most, mm: chords of the path (0.005), its last bisection (0.003), rounding to 0.001 and the
/// proof's own sampling stay below it.
pub const GOUGE_TOLERANCE_MM: f64 = 0.02;

#[cfg(test)]
mod tests;
