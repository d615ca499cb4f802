//! The files of a verification: what it is bound to, and `verification.toml`, written whole or not at all.

use std::io::Write;
use std::path::{Path, PathBuf};

use super::{PlanFileError, Sha256, StoredPlan};

/// The verdict's name in a plan's directory.
pub const VERDICT: &str = "verification.toml";

/// The files of a plan that a verdict holds for.
const BOUND: [&str; 4] = ["plan.toml", "waypoints.csv", "trajectory.csv", "robot.urdf"];

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

/// Writes `verification.toml` into a plan's directory; one that stands there is replaced in one step.
///
/// # Errors
/// [`PlanFileError::Io`]; then what stood there stands there still.
pub fn write_verdict(dir: &Path, text: &str) -> Result<PathBuf, PlanFileError> {
    let path = dir.join(VERDICT);
    let prefix = format!(".{VERDICT}.partial-");
    let write = || -> std::io::Result<()> {
        let mut file = tempfile::Builder::new().prefix(&prefix).tempfile_in(dir)?;
        file.write_all(text.as_bytes())?;
        file.as_file().sync_all()?;
        file.persist(&path).map_err(|e| e.error)?;
        std::fs::File::open(dir)?.sync_all()
    };
    write().map_err(PlanFileError::io("write", &path))?;
    Ok(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_verdict_replaces_the_one_before_and_leaves_nothing_else() {
        let dir = tempfile::tempdir().unwrap();
        write_verdict(dir.path(), "passed = false\n").unwrap();
        let path = write_verdict(dir.path(), "passed = true\n").unwrap();
        assert_eq!(std::fs::read_to_string(path).unwrap(), "passed = true\n");
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
        let gone = dir.path().join("gone");
        assert!(write_verdict(&gone, "").unwrap_err().to_string().contains("verification.toml"));
    }
}
