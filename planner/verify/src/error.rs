//! Errors that make verification impossible. A plan that fails a check is not an error.

use std::io;
use std::path::PathBuf;

use bonemill_arm::RobotError;
use bonemill_geometry::{GridError, VolumeError};
use bonemill_imaging::ImageError;
use bonemill_imaging::part::PartError;
use thiserror::Error;

use bonemill_planfile::PlanFileError;

/// Why a plan cannot be verified.
#[derive(Debug, Error)]
pub enum VerifyError {
    /// An image cannot be read or is refused.
    #[error("{}: {problem}", path.display())]
    Image {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        problem: ReadProblem,
    },
    /// The planner's reader of images, or of names of labels, refuses a file.
    #[error(transparent)]
    Imaging(#[from] ImageError),
    /// A file of the plan cannot be read.
    #[error(transparent)]
    File(#[from] PlanFileError),
    /// A row of the trajectory is not a joint vector of the plan's arm.
    #[error(transparent)]
    Robot(#[from] RobotError),
    /// A lattice cannot be made.
    #[error(transparent)]
    Grid(#[from] GridError),
    /// The mesh of the tool cannot be read.
    #[error("mesh.stl: {}", path.display())]
    Tool {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: Box<PartError>,
    },
    /// `labels.json` does not contain the name of a label.
    #[error("label name '{name}' is neither in the label file itself nor in the labels.json beside it")]
    LabelName {
        /// The name.
        name: String,
    },
    /// No voxel has the target's label.
    #[error("the plan's target has no voxel in its label map")]
    NoTarget,
    /// The plan has no waypoints or no trajectory.
    #[error("the plan has no waypoint: there is nothing to verify")]
    Empty,
}

/// Why an image is refused.
#[derive(Debug, Error)]
pub enum ReadProblem {
    /// The system or the gzip stream.
    #[error("cannot be read: {0}")]
    Unreadable(#[from] io::Error),
    /// No header of a NIfTI-1 file.
    #[error("is neither NIfTI-1 nor NIfTI-2 in a single file")]
    NotNifti,
    /// A field of an NRRD header is missing or cannot be used.
    #[error("`{field}` in its header: expected {expected}")]
    Header {
        /// The field.
        field: String,
        /// What was expected.
        expected: &'static str,
    },
    /// A header field has a value that cannot be.
    #[error("{field} is {value}; expected {expected}")]
    Field {
        /// Its name in `nifti1.h`.
        field: &'static str,
        /// Its value.
        value: f64,
        /// What it may be.
        expected: &'static str,
    },
    /// The file's length contradicts its header.
    #[error("holds {found} bytes after its header; expected {expected}")]
    Length {
        /// Bytes after the header, at most a few more than expected.
        found: usize,
        /// Bytes by the header, which are at least those of the voxels.
        expected: usize,
    },
    /// A voxel that is no grey value or no label.
    #[error("voxel number {voxel} is {value}; expected {expected}")]
    Voxel {
        /// Its number in the file.
        voxel: usize,
        /// Its value after scaling.
        value: f64,
        /// What it may be.
        expected: &'static str,
    },
    /// The transform cannot be used, or two statements about the voxels' places differ.
    #[error("its affine transform cannot be used: {0}")]
    Affine(&'static str),
    /// A grid of impossible size.
    #[error(transparent)]
    Grid(#[from] GridError),
    /// Our own bug: voxels and grid differ.
    #[error(transparent)]
    Volume(#[from] VolumeError),
}
