//! Why no case can be made of labels.

use std::path::PathBuf;

use thiserror::Error;

use crate::error::CaseError;

/// Why no case can be made.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum DraftError {
    /// No label is named like a target.
    #[error("no label's name tells the target: name it with --target NAME|NUMBER; the labels are {labels}")]
    NoTarget {
        /// The labels.
        labels: String,
    },
    /// Several are.
    #[error("the names of several labels tell a target: {names}: choose with --target NAME|NUMBER")]
    SeveralTargets {
        /// Their names.
        names: String,
    },
    /// An option names no label.
    #[error("{option}: there is no label {name:?}{}; the labels are {labels}",
        nearest.as_ref().map_or(String::new(), |nearest| format!(", did you mean {nearest:?}?")))]
    NoSuchLabel {
        /// The option.
        option: &'static str,
        /// What it names.
        name: String,
        /// The label that it resembles.
        nearest: Option<String>,
        /// All labels.
        labels: String,
    },
    /// An option names several labels, which differ by case or accents.
    #[error("{option}: {name:?} may be each of {names}: give its name as it is written, or its number")]
    SeveralLabels {
        /// The option.
        option: &'static str,
        /// What it names.
        name: String,
        /// The labels.
        names: String,
    },
    /// An option names a label without a voxel.
    #[error("{option}: label {name} is in no voxel of the label map")]
    Empty {
        /// The option.
        option: &'static str,
        /// The label.
        name: String,
    },
    /// Options take one label for two things, or twice for one.
    #[error("label {name} is given twice, by {first} and by {second}; expected once")]
    Twice {
        /// The label.
        name: String,
        /// The first option.
        first: &'static str,
        /// The second.
        second: &'static str,
    },
    /// Two structures would have one name.
    #[error(
        "the structures {first} and {second} would both be named {name:?}: give each label once, under a name of its own"
    )]
    NameTwice {
        /// The name.
        name: String,
        /// One label.
        first: String,
        /// The other.
        second: String,
    },
    /// Too few fiducials.
    #[error("{found} fiducials; expected at least three points, in the order in which the arm touches them")]
    Fiducials {
        /// How many.
        found: usize,
    },
    /// An approach without direction.
    #[error(
        "the approach's points lie in one place; expected the first outside and the last inside the bone"
    )]
    Approach,
    /// A path cannot stand in a case file.
    #[error("{}: the path is not Unicode, which a case file is", path.display())]
    Path {
        /// The path.
        path: PathBuf,
    },
    /// The case's values are refused.
    #[error("the case that would be written is refused: {0}")]
    Refused(CaseError),
}
