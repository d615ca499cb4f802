//! Errors of reading images, density tables, label names and structures.

use std::io;
use std::path::PathBuf;

use thiserror::Error;

use crate::formats::{DicomProblem, ForeignFormat, FormatProblem, NiftiProblem};
use crate::hounsfield::{GreyKind, GreyRange};
use crate::names::LabelNamesProblem;

/// Why images, tables or structures cannot be used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ImageError {
    /// The two lists of a density table do not pair up, or hold fewer than two points.
    #[error("density table has {hu} HU and {g_cm3} g/cm³ values; expected as many of each, at least 2")]
    DensityTableLength {
        /// Number of HU values.
        hu: usize,
        /// Number of densities.
        g_cm3: usize,
    },
    /// A point of a density table is not finite, not above the one before it, or negative in density.
    #[error(
        "density table, point {index}: {hu} HU, {g_cm3} g/cm³; expected finite values, HU above the point \
         before, density not negative"
    )]
    DensityTablePoint {
        /// Place in the lists, from 0.
        index: usize,
        /// The HU given.
        hu: f64,
        /// The density given, g/cm³.
        g_cm3: f64,
    },
    /// A folder, or an image in a format that is not read.
    #[error("{}: {format}", path.display())]
    Foreign {
        /// The file or folder.
        path: PathBuf,
        /// What it is.
        format: ForeignFormat,
    },
    /// An image file cannot be used.
    #[error("{}: {problem}", path.display())]
    Nifti {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        problem: NiftiProblem,
    },
    /// An NRRD or MetaImage file, or a folder of masks, cannot be used.
    #[error("{}: {problem}", path.display())]
    Format {
        /// The file or folder.
        path: PathBuf,
        /// What is wrong with it.
        problem: FormatProblem,
    },
    /// DICOM files cannot be used.
    #[error("{}: {problem}", path.display())]
    Dicom {
        /// The file or folder.
        path: PathBuf,
        /// What is wrong with them.
        problem: DicomProblem,
    },
    /// An image file cannot be written.
    #[error("{}: cannot be written: {problem}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        problem: io::Error,
    },
    /// The list of label names cannot be used.
    #[error("{}: {problem}", path.display())]
    LabelNames {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        problem: LabelNamesProblem,
    },
    /// The grey values are not Hounsfield units.
    #[error(
        "the scan's grey values are not Hounsfield units: {range}. {kind}. Expected air near -1000, water \
         near 0 and bone above 200"
    )]
    NotHounsfield {
        /// What the values look like.
        kind: GreyKind,
        /// Their distribution.
        range: GreyRange,
    },
    /// A structure's label is in no voxel of the map.
    #[error("label {label} is in no voxel of the label map; expected one of {present:?}")]
    LabelAbsent {
        /// The label that was requested.
        label: u16,
        /// The labels in the map without 0, ascending, at most 64.
        present: Vec<u16>,
    },
    /// A region is not a box.
    #[error(
        "region from {min_mm:?} to {max_mm:?} mm, reach {reach_mm} mm: expected finite, ordered corners and a reach of at least 0"
    )]
    Region {
        /// Smallest coordinates, mm.
        min_mm: [f64; 3],
        /// Largest coordinates, mm.
        max_mm: [f64; 3],
        /// Reach, mm.
        reach_mm: f64,
    },
    /// A grid has more voxels than 32-bit voxel numbers can name.
    #[error("a grid of {voxels} voxels; expected at most {} for a distance field", u32::MAX)]
    TooManyVoxels {
        /// Voxels of the grid.
        voxels: usize,
    },
    /// An upper bound for distances is not a positive number.
    #[error("maximal distance {max_distance_mm} mm; expected finite and positive")]
    MaxDistance {
        /// The distance given, mm.
        max_distance_mm: f64,
    },
}
