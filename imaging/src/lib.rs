//! Images in: CT and label maps from NIfTI-1 files into frames, densities, distance fields.
//!
//! A wrong affine mirrors the anatomy and a grey value taken for HU invents bone, both silently. So this crate refuses
//! what it cannot read for certain, and says which file, which voxel, what was expected. Lengths are mm.

mod affine;
mod density;
mod error;

pub use affine::AffineChoice;
pub use density::DensityTable;
pub use error::ImageError;
