//! Images in: CT and label maps from NIfTI-1 files into frames, densities, distance fields.
//!
//! A wrong affine mirrors the anatomy and a grey value taken for HU invents bone, both silently. So this crate refuses
//! what it cannot read for certain, and says which file, which voxel, what was expected. Lengths are mm.

mod affine;
mod decode;
mod density;
mod distance;
mod error;
mod header;
mod hounsfield;
mod names;
pub mod phantom;
mod read;
mod resample;
pub mod scene;
mod structures;
pub mod surface;
mod write;

pub use affine::{
    AffineChoice, AffineReport, AffineSource, DISAGREEMENT_LIMIT_VOXELS, SHEAR_LIMIT_RAD, SPACING_RANGE_MM,
};
pub use density::DensityTable;
pub use distance::{DistanceField, distance_transform, distance_transform_label, distance_within};
pub use error::{ImageError, NiftiProblem};
pub use hounsfield::{GreyKind, GreyRange, looks_like_hu};
pub use names::{LabelNames, LabelNamesProblem, read_label_names};
pub use read::{Image, ReadWarning, read_ct, read_labels};
pub use resample::{AIR_HU, resample_density, resample_hu, resample_hu_and_density, resample_nearest};
pub use scene::{
    Class, FarObstacles, Scene, SceneError, SceneSpec, SceneStructure, TargetShape, build_scene,
};
pub use structures::{Region, StructureField};
pub use write::{write_ct_i16, write_labels_u8};
