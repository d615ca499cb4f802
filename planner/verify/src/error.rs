//! Why a plan cannot be verified at all; a plan that fails a check is no error.

use bonemill_arm::RobotError;
use bonemill_geometry::GridError;
use bonemill_imaging::ImageError;
use thiserror::Error;

use bonemill_planfile::PlanFileError;

/// Why there is no verification.
#[derive(Debug, Error)]
pub enum VerifyError {
    /// An image cannot be read or trusted.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// A file of the plan cannot be read.
    #[error(transparent)]
    File(#[from] PlanFileError),
    /// A row of the trajectory is no joint vector of the plan's arm.
    #[error(transparent)]
    Robot(#[from] RobotError),
    /// A lattice cannot be made.
    #[error(transparent)]
    Grid(#[from] GridError),
    /// A label is named that `labels.json` does not know.
    #[error("label name '{name}' is not in the labels.json beside the label map")]
    LabelName {
        /// The name.
        name: String,
    },
    /// The target's label is in no voxel.
    #[error("the plan's target has no voxel in its label map")]
    NoTarget,
    /// There is nothing to verify.
    #[error("the plan has no waypoint: there is nothing to verify")]
    Empty,
}
