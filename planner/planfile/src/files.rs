//! The files of a plan's directory, and copying them.

use std::path::Path;

use super::inputs::CASE_COPY;
use super::{FORCES, PLUNGE, PlanFileError, REPORT, StagedDirectory, StoredPlan};

/// Files of a plan's directory besides `plan.toml`.
pub const FILES: [&str; 5] = ["waypoints.csv", FORCES, "trajectory.csv", "robot.urdf", REPORT];
/// Files for human readers; of them a command reads `dropped.csv` only, to say why a part of the target stays.
pub const NOTES: [&str; 3] = ["access.csv", "dropped.csv", PLUNGE];

/// Copies the files of a plan, except `plan.toml`, into the staged directory.
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
    // a plan of an earlier version has no copy of its case
    let case = Some(plan.case_path()).filter(|path| path.exists());
    case.map_or(Ok(()), |path| copy(&path, CASE_COPY))
}
