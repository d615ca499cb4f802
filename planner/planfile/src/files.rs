//! Which files a plan's directory holds, and their copies.

use std::path::Path;

use super::inputs::CASE_COPY;
use super::{FORCES, PlanFileError, REPORT, StagedDirectory, StoredPlan};

/// What a plan's directory holds, beside `plan.toml`.
pub const FILES: [&str; 5] = ["waypoints.csv", FORCES, "trajectory.csv", "robot.urdf", REPORT];
/// What it holds for a reader alone: no command needs it.
pub const NOTES: [&str; 2] = ["access.csv", "dropped.csv"];

/// Copies the files of a plan that was read, but for `plan.toml`, into the staged directory.
///
/// # Errors
/// [`PlanFileError`] when a file cannot be read or written.
pub fn copy_files(plan: &StoredPlan, staged: &StagedDirectory) -> Result<(), PlanFileError> {
    let copy = |from: &Path, name: &str| {
        std::fs::copy(from, staged.path().join(name)).map(drop).map_err(PlanFileError::io("copy", from))
    };
    for name in FILES {
        copy(&plan.dir.join(name), name)?;
    }
    for (name, path) in NOTES.map(|name| (name, plan.dir.join(name))).iter().filter(|(_, path)| path.exists())
    {
        copy(path, name)?;
    }
    // a plan of an earlier version holds no copy of its case
    let case = Some(plan.case_path()).filter(|path| path.exists());
    case.map_or(Ok(()), |path| copy(&path, CASE_COPY))
}
