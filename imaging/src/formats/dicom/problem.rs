//! What is wrong with a DICOM file or series: each with the file, the attribute, its value and what was expected.

use std::fmt;
use std::path::PathBuf;

use thiserror::Error;

use super::super::straight::AffineFault;

/// A series of a folder, as far as it helps to choose one.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SeriesFound {
    /// Its name, by [`super::series_name`].
    pub name: String,
    /// Modality, such as CT.
    pub modality: String,
    /// Number of slices.
    pub slices: usize,
    /// Columns and rows of the first one.
    pub size: [usize; 2],
}

impl fmt::Display for SeriesFound {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [columns, rows] = self.size;
        write!(f, "{} ({}, {} slices of {columns}×{rows})", self.name, self.modality, self.slices)
    }
}

/// Why DICOM files cannot be used for planning. Files are named without their folder.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum DicomProblem {
    /// A file cannot be read as DICOM.
    #[error("{file}: cannot be read as DICOM: {reason}")]
    Unreadable {
        /// The file.
        file: String,
        /// The reader's words.
        reason: String,
    },
    /// An element announces more bytes than the file has left.
    #[error(
        "{file}: element {tag} at byte {at} announces {length} bytes, and the file ends before: truncated or damaged"
    )]
    Length {
        /// The file.
        file: String,
        /// Group and element.
        tag: String,
        /// Where it stands.
        at: u64,
        /// Bytes announced.
        length: u64,
    },
    /// Nothing in the folder is a slice with a place.
    #[error(
        "holds no series of slices with ImagePositionPatient and ImageOrientationPatient (localizers do not count)"
    )]
    NoSeries,
    /// Several series, and no choice.
    #[error(
        "holds several series; choose one by its name, as images.ct_series in the case or --ct-series where a case is made: {}",
        list(found)
    )]
    SeveralSeries {
        /// All of them.
        found: Vec<SeriesFound>,
    },
    /// The series that the case chooses is not there.
    #[error("has no series {name} (images.ct_series); expected one of {}", list(found))]
    SeriesAbsent {
        /// The choice, as a name.
        name: String,
        /// Those that are there.
        found: Vec<SeriesFound>,
    },
    /// An attribute is missing or cannot be used.
    #[error("{file}: {attribute} is {found}; expected {expected}")]
    Attribute {
        /// The file.
        file: String,
        /// Its name in the standard.
        attribute: &'static str,
        /// The value, or that it is absent.
        found: String,
        /// What was expected.
        expected: &'static str,
    },
    /// A slice differs from the first one in what all slices of a series share.
    #[error(
        "{file}: {attribute} differs from that of {first}; expected one series with one size, orientation and spacing"
    )]
    Unlike {
        /// The file.
        file: String,
        /// The attribute.
        attribute: &'static str,
        /// The first slice's file.
        first: String,
    },
    /// A single slice.
    #[error("{file}: is a single slice; expected the whole scan: name the folder with its series")]
    SingleSlice {
        /// The file.
        file: String,
    },
    /// Two slices at one position.
    #[error(
        "{first} and {second} lie at the same position, {position_mm:.3} mm along the slices' normal; expected each slice once"
    )]
    Doubled {
        /// One file.
        first: String,
        /// The other.
        second: String,
        /// ImagePositionPatient along the normal, mm.
        position_mm: f64,
    },
    /// Slices are missing.
    #[error(
        "between {before} at {before_mm:.3} mm and {after} at {after_mm:.3} mm along the normal {missing} slices are missing: \
         slices lie {spacing_mm:.3} mm apart elsewhere"
    )]
    Missing {
        /// The slice before the gap.
        before: String,
        /// Its position, mm.
        before_mm: f64,
        /// The slice behind it.
        after: String,
        /// Its position, mm.
        after_mm: f64,
        /// How many.
        missing: usize,
        /// Distance of neighbours elsewhere, mm.
        spacing_mm: f64,
    },
    /// Slices are unevenly spaced.
    #[error(
        "{before} at {before_mm:.3} mm and {after} at {after_mm:.3} mm along the normal lie {:.3} mm apart, others {spacing_mm:.3} mm: \
         uneven spacing. Reconstruct or resample the scan evenly", after_mm - before_mm
    )]
    Uneven {
        /// The slice before.
        before: String,
        /// Its position, mm.
        before_mm: f64,
        /// The slice behind it.
        after: String,
        /// Its position, mm.
        after_mm: f64,
        /// The middle distance of neighbours, mm.
        spacing_mm: f64,
    },
    /// Positions go aside from slice to slice.
    #[error(
        "the slices are sheared: their positions run {tilt_deg:.2}° off their normal, as with a tilted gantry. Resample the scan \
         to a straight grid, e.g. with 3D Slicer's \"acquisition geometry regularization\""
    )]
    Tilted {
        /// Angle between the line of positions and the normal, degrees.
        tilt_deg: f64,
    },
    /// A slice lies beside the line of the others.
    #[error(
        "{file} lies {off_mm:.3} mm beside the line of the other slices' positions; expected at most a tenth of a voxel"
    )]
    Aside {
        /// The file.
        file: String,
        /// Its distance from the line, mm.
        off_mm: f64,
    },
    /// The pixels cannot be decoded.
    #[error("{file}, frame {frame}: its pixels cannot be decoded: {reason}")]
    Pixels {
        /// The file.
        file: String,
        /// The frame, counted from 1.
        frame: u32,
        /// Why.
        reason: String,
    },
    /// Too many voxels, or none.
    #[error("sizes {dims:?}; expected 1 to {limit} voxels")]
    Sizes {
        /// Voxels along i, j, k.
        dims: [usize; 3],
        /// The limit.
        limit: u64,
    },
    /// Positions and orientation give no grid.
    #[error("positions and orientation give no grid: {0}")]
    Affine(#[from] AffineFault),
    /// A segmentation without a voxel in it.
    #[error("{file}: holds no segment's voxel")]
    Empty {
        /// The file.
        file: String,
    },
    /// More than one segmentation in a folder.
    #[error("holds several segmentations: {}; expected one: name its file", files.iter().map(|f| f.display().to_string()).collect::<Vec<_>>().join(", "))]
    SeveralSegmentations {
        /// All of them.
        files: Vec<PathBuf>,
    },
    /// No segmentation where labels are expected.
    #[error("holds no DICOM segmentation (SEG); expected one, or a folder with one mask per structure")]
    NoSegmentation,
    /// Names of segments are not unique.
    #[error("{file}: two segments are named {name:?}; expected each name once")]
    NameTwice {
        /// The file.
        file: String,
        /// The name.
        name: String,
    },
}

fn list(found: &[SeriesFound]) -> String {
    let all: Vec<String> = found.iter().map(ToString::to_string).collect();
    all.join("; ")
}
