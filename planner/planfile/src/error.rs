//! Errors of reading and writing a plan's files.

use std::fmt;
use std::io;
use std::path::PathBuf;

use bonemill_arm::RobotError;
use bonemill_case::CaseError;
use thiserror::Error;

use super::Sha256;

/// Reading or writing a plan's files failed.
#[derive(Debug, Error)]
pub enum PlanFileError {
    /// The operating system refused.
    #[error("cannot {doing} {}", path.display())]
    Io {
        /// What was being done, e.g. `read`.
        doing: &'static str,
        /// The file or folder.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// A plan was asked for in the folder of a prosthesis.
    #[error("{} holds a prosthesis, expected a plan: `verify`, `view` and `export` read both", path.display())]
    Prosthesis {
        /// The folder.
        path: PathBuf,
    },
    /// The output path has no name for a folder.
    #[error("{}: expected the name of a folder to write", path.display())]
    NoName {
        /// The path.
        path: PathBuf,
    },
    /// The folder that would be replaced is the one in which this process runs, or holds it.
    #[error("{} is the folder in which this runs, or holds it, and would be replaced: choose another folder, such as one in it", path.display())]
    WorkingFolder {
        /// The folder to write.
        path: PathBuf,
    },
    /// Something that is not a plan is where a plan should be written.
    #[error("{} exists and is not {expected}: {why}; remove it or choose another folder", path.display())]
    Occupied {
        /// The path.
        path: PathBuf,
        /// What may be replaced.
        expected: &'static str,
        /// What was found.
        why: String,
    },
    /// An input of the new plan lies in the directory that it would replace.
    #[error("{} lies in {}, which the new plan would replace: choose another folder", path.display(), target.display())]
    WouldBeLost {
        /// The input.
        path: PathBuf,
        /// The directory.
        target: PathBuf,
    },
    /// A table's header, row or cell is not as specified.
    #[error("{}:{line}: column `{column}`: found {found:?}, expected {expected}", path.display())]
    Cell {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// The column's name.
        column: &'static str,
        /// The cell's text.
        found: String,
        /// What it should be.
        expected: String,
    },
    /// A row has too few or too many cells, or the header differs.
    #[error("{}:{line}: found {found}, expected {expected}", path.display())]
    Row {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// What is there.
        found: String,
        /// What should be there.
        expected: String,
    },
    /// A value is not finite and cannot be written. This is a bug of the planner; it is reported instead of written.
    #[error("{what} is {value}, which is not finite: the plan was not written")]
    NotFinite {
        /// Which value.
        what: String,
        /// NaN or an infinity.
        value: f64,
    },
    /// A waypoint names a structure that the case does not have.
    #[error("waypoint {index} names structure {structure}, of {count}: the plan was not written")]
    NoSuchStructure {
        /// The waypoint.
        index: usize,
        /// The structure's index.
        structure: usize,
        /// How many there are.
        count: usize,
    },
    /// A key of `plan.toml` is missing or has a wrong value.
    #[error("{}{}: `{key}`: expected {expected}", path.display(), line.map_or(String::new(), |n| format!(":{n}")))]
    Record {
        /// The file.
        path: PathBuf,
        /// Line of the key, from 1.
        line: Option<usize>,
        /// The key.
        key: String,
        /// What it should hold.
        expected: &'static str,
    },
    /// The case in `plan.toml`, or the file itself, is not valid.
    #[error("the plan's case is not valid")]
    Case(#[from] CaseError),
    /// An input has changed since the plan was made.
    #[error(
        "{} has changed since the plan was made (SHA-256 {found}, was {expected}): plan again, or bring the file back",
        path.display()
    )]
    InputChanged {
        /// The input.
        path: PathBuf,
        /// Its digest now.
        found: String,
        /// Its digest in the plan.
        expected: String,
    },
    /// Inputs are neither at their recorded paths nor at the other places that are searched.
    #[error(
        "inputs of the plan {} are missing: {}. Put them back or beside the plan's folder, name the folder that holds them \
         (--inputs DIR; in Python inputs=DIR), or plan with --pack (pack=True), which keeps copies in the plan",
        plan.display(),
        missing.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")
    )]
    InputsMissing {
        /// The plan's folder.
        plan: PathBuf,
        /// The inputs that were not found.
        missing: Vec<MissingInput>,
    },
    /// The plan's URDF does not describe an arm, or the case's limits do not fit the arm.
    #[error("{}: no arm for this plan", path.display())]
    Arm {
        /// The URDF.
        path: PathBuf,
        /// What is wrong with it.
        source: Box<RobotError>,
    },
    /// The plan does not list an input.
    #[error("{} does not list `{missing}` among its inputs", path.display())]
    InputNotListed {
        /// The plan.
        path: PathBuf,
        /// What should be listed.
        missing: String,
    },
}

/// An input that was not found.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MissingInput {
    /// Its path when the plan was made.
    pub recorded: PathBuf,
    /// Its digest.
    pub sha256: Sha256,
    /// Its size, if the plan records it.
    pub bytes: Option<u64>,
}

impl fmt::Display for MissingInput {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} (SHA-256 {:.10}…", self.recorded.display(), self.sha256.to_string())?;
        self.bytes.map_or(Ok(()), |bytes| write!(f, ", {bytes} bytes"))?;
        f.write_str(")")
    }
}

impl PlanFileError {
    /// Makes a [`PlanFileError::Io`] with its context, for `map_err`.
    pub fn io(doing: &'static str, path: impl Into<PathBuf>) -> impl FnOnce(io::Error) -> Self {
        let path = path.into();
        move |source| PlanFileError::Io { doing, path, source }
    }
}
