//! What 3D Slicer saves beside images: points, lines and curves (`.mrk.json`, `.fcsv`), and rigid transforms (`.h5`, `.tfm`, `.txt`).
//!
//! Slicer's files are in LPS or RAS, and each says which; what comes out is in `ct` (RAS+, mm). A file that does not say is refused,
//! because a guess would mirror the patient silently. Deformations, and matrices that scale or mirror, are refused too.

mod fcsv;
mod markups;
mod transform;

use std::io;
use std::path::{Path, PathBuf};

use bonemill_geometry::NotARotation;
use thiserror::Error;

pub use markups::{MarkupPoint, Markups, read_markups};
pub use transform::read_base_from_ct;

/// A file of 3D Slicer cannot be used.
#[derive(Debug, Error)]
#[error("{}: {problem}", path.display())]
pub struct SlicerFileError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong with it.
    pub problem: SlicerFileProblem,
}

/// What is wrong with a file of 3D Slicer.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SlicerFileProblem {
    /// The system cannot read it.
    #[error("cannot be read: {0}")]
    Unreadable(io::Error),
    /// It is no text.
    #[error("is not a text file; expected {expected}")]
    NotText {
        /// What can be read.
        expected: &'static str,
    },
    /// It is not JSON.
    #[error("expected the JSON that 3D Slicer writes for markups: {0}")]
    Json(serde_json::Error),
    /// A part is not what it should be.
    #[error("{place}: found {found}, expected {expected}")]
    Part {
        /// The key, line or point.
        place: String,
        /// What stands there.
        found: String,
        /// What should.
        expected: &'static str,
    },
    /// The matrix of a transform scales, shears or mirrors.
    #[error("the transform is not rigid: {0}")]
    NotRigid(NotARotation),
}

impl SlicerFileProblem {
    fn part(place: impl Into<String>, found: impl Into<String>, expected: &'static str) -> Self {
        Self::Part { place: place.into(), found: found.into(), expected }
    }
}

/// The text of a file; `expected`: what can be read, for one that is no text.
fn text_of(path: &Path, expected: &'static str) -> Result<String, SlicerFileProblem> {
    let bytes = std::fs::read(path).map_err(SlicerFileProblem::Unreadable)?;
    String::from_utf8(bytes).map_err(|_| SlicerFileProblem::NotText { expected })
}

/// A finite number.
fn number(word: &str) -> Option<f64> {
    word.trim().parse().ok().filter(|v: &f64| v.is_finite())
}
