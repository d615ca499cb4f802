//! Images in: CT and label maps from image files into frames, densities and distances.
//!
//! A wrong affine mirrors the anatomy and a grey value taken for HU invents bone, both silently. So this crate refuses
//! what it cannot read for certain, and says which file, which voxel, what was expected. Lengths are mm. The frame `ct`
//! is NIfTI's own world, RAS+; nothing is flipped.
//!
//! - files: [`read_ct`], [`read_labels`], [`read_label_map`], [`read_label_names`], [`write_ct_i16`], [`write_labels_u8`],
//!   [`write_segments`], [`write_phantom`]; points and transforms of 3D Slicer: [`slicer`];
//! - grey values: [`looks_like_hu`], [`DensityTable`], [`resample_hu_and_density`], [`resample_nearest`]; of each label: [`survey_labels`];
//! - distances on a grid: [`distance_transform`], [`distance_within`]; from any point: [`StructureField`].
//!
//! ```
//! use bonemill_geometry::{Ct, Grid, Point, Volume};
//! use bonemill_imaging::{StructureField, distance_transform};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! // one labelled voxel in a row of 0.5 mm voxels
//! let row: Grid<Ct> = Grid::aligned([9, 1, 1], 0.5, Point::new(0.0, 0.0, 0.0))?;
//! let mut labels = Volume::filled(row, 0u16);
//! labels.data_mut()[2] = 10;
//!
//! // between voxel centres
//! let field = distance_transform(&labels.map(|v| *v == 10))?.ok_or("no voxel")?;
//! assert_eq!((field.distance_mm.data()[8], field.nearest[8]), (3.0, 2));
//! // to the closed voxel box, which ends at 1.25 mm
//! let nerve = StructureField::new(&labels, 10, None)?.ok_or("out of reach")?;
//! assert_eq!(nerve.distance(Point::new(4.25, 0.0, 0.0)), 3.0);
//! # Ok(())
//! # }
//! ```

mod density;
mod distance;
mod error;
mod formats;
mod hounsfield;
mod label_survey;
mod memory;
mod names;
pub mod part;
pub mod phantom;
mod resample;
pub mod slicer;
mod structures;
pub mod surface;
mod write;
mod write_phantom;
mod write_segments;

pub use density::DensityTable;
pub use distance::{DistanceField, distance_only, distance_transform, distance_within};
pub use error::ImageError;
pub use formats::{
    AddFault, Added, AffineChoice, AffineFault, AffineReport, AffineSource, DISAGREEMENT_LIMIT_VOXELS,
    DicomProblem, Fit, ForeignFormat, FormatProblem, Image, LabelMap, MASK_ENDINGS, NiftiProblem, Placement,
    Provenance, ReadWarning, SHEAR_LIMIT_RAD, SPACING_RANGE_MM, SeriesFound, Shared, displacement_mm,
    is_dicom, read_ct, read_ct_series, read_label_map, read_labels, series_name, whole,
};
pub use hounsfield::{GreyKind, GreyRange, looks_like_hu, padding_to_air};
pub use label_survey::{GreyValues, LabelSurvey, bone_extent_x_mm, labels_beside, survey_labels};
pub use memory::available_memory_mb;
pub use names::{LabelNames, LabelNamesProblem, label_names_path, read_label_names};
pub use resample::{AIR_HU, resample_hu, resample_hu_and_density, resample_nearest};
pub use structures::{Region, StructureField};
pub use write::{write_ct_i16, write_labels_u8};
pub use write_phantom::{PHANTOM_CASE_FILE, write_phantom};
pub use write_segments::{Segment, write_segments};
