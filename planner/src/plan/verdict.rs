//! The files of a verification: what it is bound to; `verification.toml` and its part of `report.html`, each written
//! whole or not at all.

use std::path::{Path, PathBuf};

use super::addition::{ReportPart, add_to_report, replace};
use super::{FORCES, PlanFileError, Sha256, StoredPlan};
use crate::uncertainty::{ErrorModel, Risk};
use crate::verify::Verification;

/// The verdict's name in a plan's directory.
pub const VERDICT: &str = "verification.toml";

/// The files of a plan that a verdict holds for.
const BOUND: [&str; 5] = ["plan.toml", "waypoints.csv", FORCES, "trajectory.csv", "robot.urdf"];

/// Name and digest of the files that a verdict of the plan in `dir` holds for.
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

/// Writes a verdict into its plan's directory, and into its report also what drawn errors do; what stands there is replaced.
/// Without a report, none is made.
///
/// # Errors
/// [`PlanFileError::Io`]; then what stood there stands there still.
pub fn save_verification(
    dir: &Path,
    verification: &Verification,
    risk: Option<(&ErrorModel, &Risk)>,
) -> Result<PathBuf, PlanFileError> {
    replace(dir, VERDICT, verification.to_toml().as_bytes())?;
    let section = crate::report::verification::section(verification, risk);
    add_to_report(dir, ReportPart::Verification, &section)?;
    Ok(dir.join(VERDICT))
}
