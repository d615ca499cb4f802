//! What is wrong with an image file, each with the field, its value and what was expected.

use std::io;
use std::path::PathBuf;

use bonemill_geometry::GridError;
use thiserror::Error;

use super::super::stored::StreamFault;
use super::super::straight::{AffineFault, SHEAR_LIMIT_RAD, SPACING_RANGE_MM};
use super::affine::AffineSource;

/// Why a file cannot be used as an image for planning.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum NiftiProblem {
    /// The system cannot open or read the file.
    #[error("cannot be read: {0}")]
    Unreadable(io::Error),
    /// The file ends inside the header.
    #[error("ends after {found_bytes} bytes; expected a NIfTI header of {expected_bytes} bytes")]
    NoHeader {
        /// Bytes in the file, decompressed.
        found_bytes: usize,
        /// Bytes of the header.
        expected_bytes: usize,
    },
    /// The header's size field is that of no NIfTI file.
    #[error(
        "is not NIfTI: the header's first number is {sizeof_hdr}, expected 348 (NIfTI-1) or 540 (NIfTI-2)"
    )]
    NotNifti {
        /// The field, little endian.
        sizeof_hdr: i32,
    },
    /// The magic is wrong.
    #[error(
        "is not NIfTI: magic {:?}, expected {:?}",
        String::from_utf8_lossy(found),
        String::from_utf8_lossy(expected)
    )]
    Magic {
        /// The bytes there.
        found: Vec<u8>,
        /// Those of a single file of its version.
        expected: &'static [u8],
    },
    /// The file is the header of a two-file image, and the other file cannot be read.
    #[error("is the header of a .hdr/.img pair, whose voxels in {} cannot be read: {error}", path.display())]
    Pair {
        /// Where the voxels should be.
        path: PathBuf,
        /// The system's reason.
        error: io::Error,
    },
    /// The dimensions make no volume.
    #[error("dim {dim:?}: expected 1 to 7 dimensions (first number), each at least 1")]
    Dims {
        /// `dim` as stored.
        dim: [i64; 8],
    },
    /// More than one volume.
    #[error("dim {dim:?}: {volumes} volumes in one file; expected one (cut out the one to plan on)")]
    Volumes {
        /// `dim` as stored.
        dim: [i64; 8],
        /// Product of the dimensions past the third.
        volumes: u64,
    },
    /// The number of voxels is past the reader's limit.
    #[error("dims {dims:?} are {voxels} voxels; expected at most {limit} (crop or resample the scan)")]
    TooLarge {
        /// Voxels along i, j, k.
        dims: [usize; 3],
        /// Their product.
        voxels: u64,
        /// The limit.
        limit: u64,
    },
    /// A voxel's type is not a single number.
    #[error("voxel type {code} ({name}); expected an integer or float of 8 to 64 bits")]
    VoxelType {
        /// `datatype` as stored.
        code: i16,
        /// Its name.
        name: &'static str,
    },
    /// `bitpix` contradicts `datatype`.
    #[error("bitpix {bitpix} contradicts voxel type {code}, which has {expected} bits")]
    Bits {
        /// `bitpix` as stored.
        bitpix: i16,
        /// `datatype` as stored.
        code: i16,
        /// Bits of that type.
        expected: usize,
    },
    /// `vox_offset` is not a position behind the header.
    #[error("vox_offset {vox_offset}: expected a whole number of bytes, from {least} to 16777216")]
    VoxOffset {
        /// The field.
        vox_offset: f64,
        /// The first byte at which voxels may start.
        least: usize,
    },
    /// Slope or intercept are not finite.
    #[error("scl_slope {}, scl_inter {}: expected finite numbers (slope 0: no scaling)", *slope as f32, *inter as f32)]
    Scaling {
        /// `scl_slope`.
        slope: f64,
        /// `scl_inter`.
        inter: f64,
    },
    /// The standard does not define this unit of length.
    #[error("unit of length {code} in xyzt_units; expected 0 (unknown: mm), 1 (m), 2 (mm) or 3 (µm)")]
    Units {
        /// The three bits of the field.
        code: u8,
    },
    /// The file cannot hold what its header announces.
    #[error(
        "dims {dims:?} need {expected_bytes} bytes, but the file's {file_bytes} bytes can hold at most \
         {at_most_bytes}: truncated, or the header is wrong"
    )]
    FileTooSmall {
        /// Voxels along i, j, k.
        dims: [usize; 3],
        /// Bytes announced, header included.
        expected_bytes: u64,
        /// Bytes in the file.
        file_bytes: u64,
        /// The most bytes that they can hold, decompressed.
        at_most_bytes: u64,
    },
    /// The file ends before the last voxel.
    #[error(
        "ends after {found_bytes} bytes of voxels, expected {expected_bytes}: truncated, or dims are wrong"
    )]
    Truncated {
        /// Bytes of voxels announced.
        expected_bytes: u64,
        /// Bytes of voxels found.
        found_bytes: u64,
    },
    /// The compressed stream is damaged.
    #[error("gzip stream is damaged or cut off: {0}")]
    Corrupt(io::Error),
    /// The file goes on after the last voxel.
    #[error("{surplus_bytes} bytes or more after the last voxel: dims, voxel type or vox_offset are wrong")]
    Surplus {
        /// Bytes found there before reading stopped.
        surplus_bytes: u64,
    },
    /// The memory for the voxels cannot be allocated.
    #[error("{bytes} bytes of memory for the voxels cannot be had")]
    Memory {
        /// Bytes requested.
        bytes: u64,
    },
    /// The header does not say where the voxels lie.
    #[error(
        "has neither sform nor qform (both codes are 0), so left and right are unknown; pixdim alone is not \
         used. Expected a header with orientation: write one from the original scan"
    )]
    NoTransform,
    /// The transform that the case chooses is not set.
    #[error("the case asks for the {wanted}, whose code is 0 (sform {sform_code}, qform {qform_code})")]
    TransformUnset {
        /// The transform that was requested.
        wanted: AffineSource,
        /// `sform_code`.
        sform_code: i32,
        /// `qform_code`.
        qform_code: i32,
    },
    /// A transform holds NaN or infinity.
    #[error("the {which} holds a value that is not finite")]
    AffineNotFinite {
        /// Of sform or qform.
        which: AffineSource,
    },
    /// The qform's quaternion or voxel sizes are impossible.
    #[error(
        "the qform is impossible: b² + c² + d² = {quaternion_square} (at most 1), pixdim {} (above 0)",
        size_text(pixdim)
    )]
    Qform {
        /// b² + c² + d².
        quaternion_square: f64,
        /// `pixdim[1..=3]`.
        pixdim: [f64; 3],
    },
    /// The axes do not span space.
    #[error(
        "the {which} is singular: its axes span a volume of {relative_volume:.2e} of a box's, expected 1"
    )]
    AffineSingular {
        /// Of sform or qform.
        which: AffineSource,
        /// |det| divided by the product of the axes' lengths.
        relative_volume: f64,
    },
    /// The axes are not perpendicular.
    #[error(
        "the {which} has shear: axes off the right angle by {off_rad:.2e} rad (limit {limit_rad:.0e}), \
         {off_voxels:.2} voxels at the far corner (limit 0.1). Resample the scan to a straight grid"
    )]
    Shear {
        /// Of sform or qform.
        which: AffineSource,
        /// Largest deviation from 90°, rad.
        off_rad: f64,
        /// The limit, rad.
        limit_rad: f64,
        /// Displacement of the far corner when the nearest grid with perpendicular axes is used, voxels.
        off_voxels: f64,
    },
    /// The voxels have an impossible size.
    #[error("voxels of {spacing_mm:?} mm by the {which}; expected {} to {} mm: wrong unit?", range_mm[0], range_mm[1])]
    Spacing {
        /// Of sform or qform.
        which: AffineSource,
        /// Spacing along i, j, k, mm.
        spacing_mm: [f64; 3],
        /// Smallest and largest accepted spacing, mm.
        range_mm: [f64; 2],
    },
    /// sform and qform place the volume differently.
    #[error(
        "sform (code {sform_code}) and qform (code {qform_code}) differ by {voxels:.3} voxels at a corner, \
         limit {limit}: set images.ct_affine (of a label map images.labels_affine) to \"sform\" or \"qform\", whichever holds"
    )]
    Disagreement {
        /// `sform_code`.
        sform_code: i32,
        /// `qform_code`.
        qform_code: i32,
        /// Largest distance between a corner's two positions, in units of the smallest voxel spacing.
        voxels: f64,
        /// The limit.
        limit: f64,
    },
    /// The sform's columns and `pixdim` give the voxels different sizes.
    #[error(
        "voxels of {} mm by the sform's columns, {} mm by pixdim: {voxels:.3} voxels apart at the far corner, limit {limit}. Write the header anew from the original scan; or, if the sform is certainly right, set \
         images.ct_affine (of a label map images.labels_affine) to \"sform\"",
        size_text(affine_mm),
        size_text(pixdim_mm)
    )]
    VoxelSizes {
        /// Lengths of the sform's columns, mm.
        affine_mm: [f64; 3],
        /// `pixdim[1..=3]`, mm.
        pixdim_mm: [f64; 3],
        /// Largest distance between a corner's two positions, in units of the smallest voxel spacing.
        voxels: f64,
        /// The limit.
        limit: f64,
    },
    /// The grid itself is impossible.
    #[error(transparent)]
    Grid(#[from] GridError),
    /// Grey values are not finite, or too large for single precision.
    #[error("voxel {first:?} is {value}; expected finite numbers everywhere, {count} are not finite")]
    VoxelsNotFinite {
        /// The first one, (i, j, k).
        first: [usize; 3],
        /// Its value.
        value: f64,
        /// How many.
        count: u64,
    },
    /// Labels are not whole numbers, or out of range.
    #[error("voxel {first:?} is {value}; expected whole numbers 0 to 65535 everywhere, {count} are no label")]
    NotLabels {
        /// The first one, (i, j, k).
        first: [usize; 3],
        /// Its value after scaling.
        value: f64,
        /// How many.
        count: u64,
    },
}

/// In single precision, as most headers store it.
fn size_text(mm: &[f64; 3]) -> String {
    mm.map(|mm| (mm as f32).to_string()).join(" × ")
}

impl NiftiProblem {
    /// Why one of the header's transforms gives no grid.
    pub(super) fn from_affine(which: AffineSource, fault: AffineFault) -> Self {
        match fault {
            AffineFault::Singular { relative_volume } => Self::AffineSingular { which, relative_volume },
            AffineFault::Spacing { spacing_mm } => {
                Self::Spacing { which, spacing_mm, range_mm: SPACING_RANGE_MM }
            }
            AffineFault::Shear { off_rad, off_voxels } => {
                Self::Shear { which, off_rad, limit_rad: SHEAR_LIMIT_RAD, off_voxels }
            }
            AffineFault::Grid(error) => Self::Grid(error),
        }
    }
}

impl From<io::Error> for NiftiProblem {
    fn from(error: io::Error) -> Self {
        // what a decoder finds wrong with its input; a disk has other words
        match error.kind() {
            io::ErrorKind::InvalidInput | io::ErrorKind::InvalidData | io::ErrorKind::UnexpectedEof => {
                Self::Corrupt(error)
            }
            _ => Self::Unreadable(error),
        }
    }
}

impl From<StreamFault> for NiftiProblem {
    fn from(fault: StreamFault) -> Self {
        match fault {
            StreamFault::Io(error) => error.into(),
            StreamFault::Truncated { expected_bytes, found_bytes } => {
                Self::Truncated { expected_bytes, found_bytes }
            }
            StreamFault::Memory { bytes } => Self::Memory { bytes },
        }
    }
}
