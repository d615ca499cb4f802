//! Image formats side by side: each is recognised by a file's first bytes, and read as values on a grid in `ct` (RAS+, mm), with
//! the files that were read.
//!
//! A format is a module with a function `read`, and a variant of [`Format`], by which it is recognised. A file of a format that is
//! recognised but not read is refused, with how to convert it ([`ForeignFormat`]); an unknown file is taken for NIfTI, whose reader
//! reports what is wrong with it. A wrong transform mirrors the patient silently: what cannot be read for certain is refused.

mod dicom;
mod fit;
mod foreign;
mod labels;
mod masks;
mod metaimage;
mod nifti;
mod nrrd;
mod problem;
mod raster;
mod source;
mod stored;
mod straight;
#[cfg(test)]
mod tests;

use std::fmt;
use std::fs::File;
use std::path::{Path, PathBuf};

use bonemill_geometry::{Ct, Volume};

use crate::error::ImageError;
use crate::names::LabelNames;

pub use dicom::{DicomProblem, SeriesFound, is_dicom, series_name};
pub use fit::Fit;
pub use foreign::ForeignFormat;
pub use labels::{AddFault, Added, LabelMap, Shared, displacement_mm, whole};
pub use masks::MASK_ENDINGS;
pub use nifti::{AffineChoice, AffineReport, AffineSource, NiftiProblem};
pub use problem::FormatProblem;
use raster::Voxels;
use source::ImageSource;
use stored::Faults;
pub use straight::{AffineFault, DISAGREEMENT_LIMIT_VOXELS, SHEAR_LIMIT_RAD, SPACING_RANGE_MM};

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
    /// An NRRD header's space, directions and origin.
    Nrrd,
    /// A MetaImage header's matrix and offset.
    MetaImage,
    /// Positions and orientation of DICOM slices.
    Dicom,
}

impl Placement {
    /// Whether the format is NIfTI, of whose transforms one can be chosen.
    pub fn is_nifti(&self) -> bool {
        matches!(self, Self::Nifti(_))
    }
}

impl fmt::Display for Placement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Nifti(affine) => affine.fmt(f),
            Self::Nrrd => f.write_str("NRRD space directions and origin"),
            Self::MetaImage => f.write_str("MetaImage TransformMatrix and Offset"),
            Self::Dicom => f.write_str("DICOM ImagePositionPatient and ImageOrientationPatient"),
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
    /// DICOM localizers of the folder were left out.
    Localizers {
        /// How many files.
        count: usize,
    },
    /// DICOM slices without RescaleSlope and RescaleIntercept.
    RescaleAbsent,
    /// DICOM's PixelPaddingValue was replaced by air.
    PixelPadding {
        /// How many voxels.
        voxels: u64,
    },
    /// Fractions of a DICOM segmentation were compared with a threshold.
    Threshold {
        /// The least stored value that belongs to a segment.
        least: u8,
        /// The value that stands for 1.
        most: u8,
    },
    /// Voxels of a segmentation have a value that no segment has.
    Unnamed {
        /// How many.
        voxels: u64,
    },
}

impl fmt::Display for ReadWarning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::SlopeNotANumber => write!(f, "scl_slope is NaN: values are taken as stored"),
            Self::UnitUnknown => write!(f, "the unit of length is not given: taken for mm"),
            Self::UnitConverted { unit } => write!(f, "lengths are converted from {unit} to mm"),
            Self::Padding { bytes } => write!(f, "{bytes} bytes after the last voxel are left out"),
            Self::Localizers { count } => write!(f, "{count} localizers are left out"),
            Self::RescaleAbsent => {
                write!(f, "slices have no RescaleSlope and RescaleIntercept: values are taken as stored")
            }
            Self::PixelPadding { voxels } => {
                write!(f, "{voxels} voxels hold the PixelPaddingValue: they are taken for air, -1000 HU")
            }
            Self::Threshold { least, most } => {
                write!(f, "fractions of at least {least} of {most} are taken to belong to their segment")
            }
            Self::Unnamed { voxels } => write!(f, "{voxels} voxels have a value without a segment: left out"),
        }
    }
}

/// Reads a CT's grey values, HU: an image file, or a folder with one DICOM series.
///
/// # Errors
/// [`ImageError`] when the file cannot be read or trusted, or a voxel is not a finite number.
pub fn read_ct(path: impl AsRef<Path>, choice: AffineChoice) -> Result<Image<f32>, ImageError> {
    read_ct_series(path, choice, None)
}

/// As [`read_ct`]; of a folder with several DICOM series that with a name, by [`series_name`], or with a SeriesInstanceUID.
///
/// # Errors
/// As [`read_ct`].
pub fn read_ct_series(
    path: impl AsRef<Path>,
    choice: AffineChoice,
    series: Option<&str>,
) -> Result<Image<f32>, ImageError> {
    let path = path.as_ref();
    let dicom = || {
        dicom::read_series(path, series).map_err(|problem| ImageError::Dicom { path: path.into(), problem })
    };
    if path.is_dir() {
        let foreign = ImageError::Foreign { path: path.into(), format: ForeignFormat::Folder };
        return if dicom::holds_dicom(path) { dicom() } else { Err(foreign) };
    }
    let nifti_fault =
        |first, f: Faults| NiftiProblem::VoxelsNotFinite { first, value: f.value, count: f.count };
    let fault = |first, f: Faults| FormatProblem::VoxelsNotFinite { first, value: f.value, count: f.count };
    let format_failed = |problem| ImageError::Format { path: path.into(), problem };
    let (format, source) = open(path)?;
    match format {
        Format::Nifti => {
            let read = nifti::read(source, choice, nifti_fault);
            read.map(|(image, _)| image).map_err(|problem| ImageError::Nifti { path: path.into(), problem })
        }
        Format::Nrrd => {
            let (voxels, _) = nrrd::read(source, false, fault).map_err(format_failed)?;
            image(path, voxels, Placement::Nrrd).map_err(format_failed)
        }
        Format::MetaImage => {
            let voxels = metaimage::read(source, fault).map_err(format_failed)?;
            image(path, voxels, Placement::MetaImage).map_err(format_failed)
        }
        Format::Dicom => dicom(),
    }
}

/// Reads a label map; its values must be whole numbers 0 to 65535 after scaling. Of a voxel with several labels one is given:
/// [`read_label_map`] gives all, and the names that stand in the file.
///
/// # Errors
/// [`ImageError`] when the file cannot be read or trusted, or a voxel is no label.
pub fn read_labels(path: impl AsRef<Path>, choice: AffineChoice) -> Result<Image<u16>, ImageError> {
    read_label_map(path, choice).map(|map| map.image)
}

/// Reads labels with their names: an image file, a segmentation (.seg.nrrd, DICOM SEG), or a folder with one of them or with one
/// mask per structure.
///
/// # Errors
/// As [`read_labels`].
pub fn read_label_map(path: impl AsRef<Path>, choice: AffineChoice) -> Result<LabelMap, ImageError> {
    let path = path.as_ref();
    let dicom =
        || dicom::read_segments(path).map_err(|problem| ImageError::Dicom { path: path.into(), problem });
    if path.is_dir() {
        let masks = masks::files(path);
        return if !masks.is_empty() {
            masks::read(path, &masks, choice)
        } else if dicom::holds_dicom(path) {
            dicom()
        } else {
            Err(ImageError::Foreign { path: path.into(), format: ForeignFormat::Folder })
        };
    }
    let nifti_fault = |first, f: Faults| NiftiProblem::NotLabels { first, value: f.value, count: f.count };
    let fault = |first, f: Faults| FormatProblem::NotLabels { first, value: f.value, count: f.count };
    let format_failed = |problem| ImageError::Format { path: path.into(), problem };
    let (format, source) = open(path)?;
    match format {
        Format::Nifti => {
            let read = nifti::read(source, choice, nifti_fault);
            let (image, extensions) =
                read.map_err(|problem| ImageError::Nifti { path: path.into(), problem })?;
            let names = nifti::names(&extensions)
                .map_err(|problem| ImageError::LabelNames { path: path.into(), problem })?;
            Ok(LabelMap { image, names, further: vec![] })
        }
        Format::Nrrd => nrrd_labels(path, source, fault),
        Format::MetaImage => {
            let voxels = metaimage::read(source, fault).map_err(format_failed)?;
            let image = image(path, voxels, Placement::MetaImage).map_err(format_failed)?;
            Ok(LabelMap { image, names: None, further: vec![] })
        }
        Format::Dicom => dicom(),
    }
}

/// An NRRD label map, or 3D Slicer's segmentation.
fn nrrd_labels(
    path: &Path,
    source: ImageSource,
    fault: impl Fn([usize; 3], Faults) -> FormatProblem,
) -> Result<LabelMap, ImageError> {
    let failed = |problem| ImageError::Format { path: path.into(), problem };
    let (mut voxels, keys) = nrrd::read(source, true, fault).map_err(failed)?;
    let Some(segments) = nrrd::segments(&voxels, &keys).map_err(failed)? else {
        let layers = voxels.values.len() / voxels.grid.len();
        if layers > 1 {
            let expected = "one value a voxel, or 3D Slicer's keys of segments";
            return Err(failed(FormatProblem::field("sizes", &layers.to_string(), expected)));
        }
        let image = image(path, voxels, Placement::Nrrd).map_err(failed)?;
        return Ok(LabelMap { image, names: None, further: vec![] });
    };
    let names = LabelNames::new(segments.names)
        .map_err(|problem| ImageError::LabelNames { path: path.into(), problem })?;
    let (values, further) = segments.drawing.finish();
    voxels.values = values;
    let mut image = image(path, voxels, Placement::Nrrd).map_err(failed)?;
    if segments.unnamed_voxels > 0 {
        image.warnings.push(ReadWarning::Unnamed { voxels: segments.unnamed_voxels });
    }
    Ok(LabelMap { image, names: Some(names), further })
}

/// A format that is read.
enum Format {
    Nifti,
    Nrrd,
    MetaImage,
    Dicom,
}

/// Where a DICOM file's mark stands, behind its preamble.
const DICOM_MARK: std::ops::Range<usize> = 128..132;

impl Format {
    /// The format of a file that begins with these bytes, decompressed; or the one that is not read.
    fn detect(head: &[u8]) -> Result<Self, ForeignFormat> {
        if head.starts_with(b"NRRD000") {
            Ok(Self::Nrrd)
        } else if head.get(DICOM_MARK) == Some(b"DICM") {
            Ok(Self::Dicom)
        } else if ["ObjectType", "NDims", "Comment"].iter().any(|key| head.starts_with(key.as_bytes())) {
            Ok(Self::MetaImage)
        } else {
            foreign::format_of(head).map_or(Ok(Self::Nifti), Err)
        }
    }
}

/// A file that was opened, and its format.
fn open(path: &Path) -> Result<(Format, ImageSource), ImageError> {
    let unreadable = |e| ImageError::Nifti { path: path.into(), problem: e };
    let file = File::open(path).map_err(|e| unreadable(NiftiProblem::Unreadable(e)))?;
    let source = ImageSource::new(path, file).map_err(|e| unreadable(NiftiProblem::from(e)))?;
    let format =
        Format::detect(&source.head).map_err(|format| ImageError::Foreign { path: path.into(), format })?;
    Ok((format, source))
}

/// An image of a header's voxels, one value each.
fn image<T>(path: &Path, voxels: Voxels<T>, placement: Placement) -> Result<Image<T>, FormatProblem> {
    let Voxels { grid, values, files, padding_bytes } = voxels;
    let (expected_bytes, found_bytes) = (grid.len() as u64, values.len() as u64);
    let volume =
        Volume::new(grid, values).map_err(|_| FormatProblem::Truncated { expected_bytes, found_bytes })?;
    let files = [path.to_owned()].into_iter().chain(files).collect();
    let warnings =
        (padding_bytes > 0).then_some(ReadWarning::Padding { bytes: padding_bytes }).into_iter().collect();
    Ok(Image { volume, provenance: Provenance { files, placement }, warnings })
}
