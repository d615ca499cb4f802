//! What is wrong with an NRRD or MetaImage file, or with a folder of masks: each with the field, its value and what was expected.

use std::io;
use std::path::PathBuf;

use thiserror::Error;

use super::stored::StreamFault;
use super::straight::AffineFault;

/// Why a header and its data cannot be used as an image for planning.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum FormatProblem {
    /// The system cannot open or read the file.
    #[error("cannot be read: {0}")]
    Unreadable(io::Error),
    /// A file with voxels that the header names cannot be used.
    #[error("its data in {}: {problem}", path.display())]
    Data {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        problem: Box<FormatProblem>,
    },
    /// The header has no end, or is longer than any program writes.
    #[error("the header does not end within {limit_bytes} bytes")]
    Endless {
        /// Most bytes that are read.
        limit_bytes: u64,
    },
    /// A line of the header is no field.
    #[error("line {line} of the header is {text:?}; expected a field and its value")]
    Line {
        /// Counted from 1.
        line: usize,
        /// The line's beginning.
        text: String,
    },
    /// A field that is needed is not there.
    #[error("the header has no field `{field}`: {expected}")]
    Missing {
        /// The field.
        field: &'static str,
        /// What it is needed for.
        expected: &'static str,
    },
    /// A field stands twice.
    #[error("the header has the field `{field}` twice; expected it once")]
    Twice {
        /// The field.
        field: String,
    },
    /// A field's value cannot be used.
    #[error("`{field}` is {value:?}; expected {expected}")]
    Field {
        /// The field.
        field: String,
        /// The value's beginning.
        value: String,
        /// What was expected.
        expected: &'static str,
    },
    /// The number of voxels is past the reader's limit.
    #[error("sizes {dims:?} with {components} numbers a voxel: expected 1 to {limit} numbers")]
    Sizes {
        /// Voxels along i, j, k.
        dims: [usize; 3],
        /// Numbers of each voxel.
        components: usize,
        /// The limit.
        limit: u64,
    },
    /// The file cannot hold what its header announces.
    #[error(
        "{expected_bytes} bytes are announced, but the file can hold at most {at_most_bytes}: truncated, or the header is wrong"
    )]
    FileTooSmall {
        /// Bytes announced.
        expected_bytes: u64,
        /// The most bytes that the file can hold, decompressed.
        at_most_bytes: u64,
    },
    /// The data end before the last voxel.
    #[error(
        "ends after {found_bytes} bytes of voxels, expected {expected_bytes}: truncated, or the sizes are wrong"
    )]
    Truncated {
        /// Bytes of voxels announced.
        expected_bytes: u64,
        /// Bytes of voxels found.
        found_bytes: u64,
    },
    /// The file goes on after the last voxel.
    #[error(
        "{surplus_bytes} bytes or more after the last voxel: sizes, type or what is to be skipped are wrong"
    )]
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
    /// Text in place of numbers, or not as many as announced.
    #[error("the text has {found} numbers before {text:?}; expected {expected} numbers")]
    Text {
        /// Numbers that were read.
        found: u64,
        /// What follows them; empty at the end.
        text: String,
        /// Numbers announced.
        expected: u64,
    },
    /// The header's axes give no grid.
    #[error("the header's axes give no grid: {0}")]
    Affine(#[from] AffineFault),
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
        /// Its value.
        value: f64,
        /// How many.
        count: u64,
    },
    /// A segmentation without a voxel in it.
    #[error("holds no segment: its image is a single voxel, or no voxel has a segment's value")]
    Empty,
    /// Two segments have one name.
    #[error("two segments are named {name:?}; expected each name once")]
    NameTwice {
        /// The name.
        name: String,
    },
    /// Masks of one folder lie on different grids.
    #[error("the mask {} lies on another grid than {}; expected one grid in a folder of masks", path.display(), first.display())]
    OtherGrid {
        /// The mask.
        path: PathBuf,
        /// The folder's first mask.
        first: PathBuf,
    },
}

impl FormatProblem {
    /// A field with a value that cannot be used; only its first characters are told.
    pub(super) fn field(field: &str, value: &str, expected: &'static str) -> Self {
        Self::Field { field: field.to_owned(), value: beginning(value), expected }
    }
}

/// The first characters of a text.
pub(super) fn beginning(text: &str) -> String {
    text.chars().take(60).collect()
}

impl From<io::Error> for FormatProblem {
    fn from(error: io::Error) -> Self {
        Self::Unreadable(error)
    }
}

impl From<StreamFault> for FormatProblem {
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
