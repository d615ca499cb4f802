//! Image formats side by side: each is recognised by a file's first bytes, and read as values on a grid in `ct` (RAS+, mm), with
//! the files that were read.
//!
//! A format is a module with one function, `read`, and a variant of [`Format`], by which it is recognised. A file of a format that is
//! recognised but not read is refused, with how to convert it ([`ForeignFormat`]); an unknown file is taken for NIfTI, whose reader
//! reports what is wrong with it. A wrong transform mirrors the patient silently: what cannot be read for certain is refused.

mod foreign;
mod nifti;
mod source;
#[cfg(test)]
mod tests;

use std::fmt;
use std::fs::File;
use std::path::{Path, PathBuf};

use bonemill_geometry::{Ct, Volume};

use crate::error::ImageError;

pub use foreign::ForeignFormat;
pub use nifti::{
    AffineChoice, AffineReport, AffineSource, DISAGREEMENT_LIMIT_VOXELS, NiftiProblem, SHEAR_LIMIT_RAD,
    SPACING_RANGE_MM,
};
use nifti::{Faults, Voxel};
use source::ImageSource;

/// A volume with where it came from.
#[derive(Debug, Clone)]
pub struct Image<T> {
    /// The values in `ct`.
    pub volume: Volume<T, Ct>,
    /// Where they came from.
    pub provenance: Provenance,
    /// Oddities of the file that was read all the same.
    pub warnings: Vec<ReadWarning>,
}

/// Where an image's values and their placement came from.
#[derive(Debug, Clone, PartialEq)]
pub struct Provenance {
    /// Every file that was read, in the order in which it was: the one that was named, or those in the folder that was.
    pub files: Vec<PathBuf>,
    /// What places the voxels in `ct`.
    pub placement: Placement,
}

/// What places an image's voxels in `ct`, by format.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Placement {
    /// One of a NIfTI header's transforms.
    Nifti(AffineReport),
}

impl fmt::Display for Placement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Nifti(affine) => affine.fmt(f),
        }
    }
}

/// Something odd about a file that was read all the same.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum ReadWarning {
    /// `scl_slope` is NaN; values were taken as stored.
    SlopeNotANumber,
    /// The header does not name its unit of length; taken for mm.
    UnitUnknown,
    /// Lengths were converted to mm.
    UnitConverted {
        /// The header's unit.
        unit: &'static str,
    },
    /// Bytes after the last voxel were left out.
    Padding {
        /// How many.
        bytes: u64,
    },
}

impl fmt::Display for ReadWarning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::SlopeNotANumber => write!(f, "scl_slope is NaN: values are taken as stored"),
            Self::UnitUnknown => write!(f, "the unit of length is not given: taken for mm"),
            Self::UnitConverted { unit } => write!(f, "lengths are converted from {unit} to mm"),
            Self::Padding { bytes } => write!(f, "{bytes} bytes after the last voxel are left out"),
        }
    }
}

/// Reads a CT's grey values.
///
/// # Errors
/// [`ImageError`] when the file cannot be read or trusted, or a voxel is not a finite number.
pub fn read_ct(path: impl AsRef<Path>, choice: AffineChoice) -> Result<Image<f32>, ImageError> {
    read(path.as_ref(), choice, |first, f| NiftiProblem::VoxelsNotFinite {
        first,
        value: f.value,
        count: f.count,
    })
}

/// Reads a label map; its values must be whole numbers 0 to 65535 after scaling.
///
/// # Errors
/// [`ImageError`] when the file cannot be read or trusted, or a voxel is no label.
pub fn read_labels(path: impl AsRef<Path>, choice: AffineChoice) -> Result<Image<u16>, ImageError> {
    read(path.as_ref(), choice, |first, f| NiftiProblem::NotLabels { first, value: f.value, count: f.count })
}

/// A format that is read.
enum Format {
    Nifti,
}

impl Format {
    /// The format of a file that begins with these bytes, decompressed; or the one that is not read.
    fn detect(head: &[u8]) -> Result<Self, ForeignFormat> {
        foreign::format_of(head).map_or(Ok(Self::Nifti), Err)
    }
}

fn read<T: Voxel>(
    path: &Path,
    choice: AffineChoice,
    faulty: impl Fn([usize; 3], Faults) -> NiftiProblem,
) -> Result<Image<T>, ImageError> {
    let foreign = |format| ImageError::Foreign { path: path.into(), format };
    if path.is_dir() {
        return Err(foreign(foreign::folder(path)));
    }
    let nifti = |problem| ImageError::Nifti { path: path.into(), problem };
    let file = File::open(path).map_err(|e| nifti(NiftiProblem::Unreadable(e)))?;
    let source = ImageSource::new(path, file).map_err(|e| nifti(NiftiProblem::from(e)))?;
    match Format::detect(&source.head).map_err(foreign)? {
        Format::Nifti => nifti::read(source, choice, faulty).map_err(nifti),
    }
}
