//! The files of a plan to which a verification is bound.

use std::path::Path;

use super::{FORCES, PlanFileError, Sha256, StoredPlan};

/// Name of the verification's file in a plan's directory.
pub const VERDICT: &str = "verification.toml";

/// The files of a plan for which a verification is valid.
const BOUND: [&str; 5] = ["plan.toml", "waypoints.csv", FORCES, "trajectory.csv", "robot.urdf"];

/// Name and digest of the files for which a verification of the plan in `dir` is valid.
///
/// # Errors
/// [`PlanFileError::Io`] when one cannot be read.
pub fn digests(dir: &Path) -> Result<Vec<(String, Sha256)>, PlanFileError> {
    BOUND.iter().map(|name| Ok(((*name).to_owned(), Sha256::of_file(&dir.join(name))?))).collect()
}

/// The text of the plan's case file as it is now.
///
/// # Errors
/// [`PlanFileError::Io`] when it cannot be read.
pub fn read_case_text(plan: &StoredPlan) -> Result<String, PlanFileError> {
    let path = plan.case_path();
    std::fs::read_to_string(&path).map_err(PlanFileError::io("read", path))
}
