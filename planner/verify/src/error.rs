//! Errors that make verification impossible. A plan that fails a check is not an error.

use std::path::PathBuf;

use bonemill_arm::RobotError;
use bonemill_geometry::GridError;
use bonemill_imaging::ImageError;
use bonemill_part::PartError;
use thiserror::Error;

use bonemill_planfile::PlanFileError;

/// Why a plan cannot be verified.
#[derive(Debug, Error)]
pub enum VerifyError {
    /// An image cannot be read or is refused.
    #[error(transparent)]
    Image(#[from] ImageError),
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
    #[error("label name '{name}' is not in the labels.json beside the label map")]
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
