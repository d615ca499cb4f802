//! The verdict on a plan, and the files to which it is bound.
//!
//! `verification.toml` holds the SHA-256 of every file of the plan that was judged. [`verified`] computes them again. It
//! refuses a plan whose verification failed, is missing or belongs to other bytes, and names the file and both digests. This
//! finds accidents and mix-ups, not a verdict that somebody edited.

use std::path::{Path, PathBuf};

use thiserror::Error;
use toml::{Table, Value};

use super::files::NOTES;
use super::inputs::CASE_COPY;
use super::{FORCES, PlanFileError, Sha256, StoredPlan};

/// Name of the verification's file in a plan's directory.
pub const VERDICT: &str = "verification.toml";

/// The files of a plan for which a verification is valid.
const BOUND: [&str; 5] = ["plan.toml", "waypoints.csv", FORCES, "trajectory.csv", "robot.urdf"];
/// Failed checks that a refusal names.
const NAMED: usize = 3;

/// Name and digest of the files for which a verification of the plan in `dir` is valid: all that the planner wrote except the
/// report, to which simulation and verification add their parts.
///
/// # Errors
/// [`PlanFileError::Io`] when one cannot be read.
pub fn digests(dir: &Path) -> Result<Vec<(String, Sha256)>, PlanFileError> {
    let present = optional().filter(|name| dir.join(name).exists());
    let names = BOUND.into_iter().chain(present);
    names.map(|name| Ok((name.to_owned(), Sha256::of_file(&dir.join(name))?))).collect()
}

/// Files that some plans do not hold.
fn optional() -> impl Iterator<Item = &'static str> {
    NOTES.into_iter().chain([CASE_COPY])
}

/// A passed verification of the files that stand in a plan's directory. Only [`verified`] makes one.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Verified {
    files: Vec<(String, Sha256)>,
    version: String,
}

impl Verified {
    /// The files that were judged, with their digests.
    pub fn files(&self) -> &[(String, Sha256)] {
        &self.files
    }

    /// The version of the program that judged them.
    pub fn version(&self) -> &str {
        &self.version
    }
}

/// Why a plan does not count as verified.
#[derive(Debug, Error)]
pub enum Unverified {
    /// Nobody verified it.
    #[error("{} has no {VERDICT}: run `bonemill verify` on it first", dir.display())]
    Absent {
        /// The plan.
        dir: PathBuf,
    },
    /// The verification found something.
    #[error("{}: the verification failed: {}", path.display(), failed.join("; "))]
    Failed {
        /// The verdict.
        path: PathBuf,
        /// Names of the first checks that failed, and how many more there are.
        failed: Vec<String>,
    },
    /// A file is not the one that was verified.
    #[error(
        "{} is not the file that was verified (SHA-256 {found}, verified {expected}): verify again, or bring the file back",
        path.display()
    )]
    Changed {
        /// The file.
        path: PathBuf,
        /// Its digest now.
        found: Sha256,
        /// Its digest in the verdict.
        expected: Sha256,
    },
    /// The verdict says nothing of a file.
    #[error("{} says nothing of {name}: verify again", path.display())]
    NotListed {
        /// The verdict.
        path: PathBuf,
        /// The file.
        name: &'static str,
    },
    /// The verdict is not what `bonemill verify` writes.
    #[error("{}: `{key}`: expected {expected}; verify again", path.display())]
    Damaged {
        /// The verdict.
        path: PathBuf,
        /// The key.
        key: String,
        /// What it should hold.
        expected: &'static str,
    },
    /// A file cannot be read.
    #[error(transparent)]
    File(#[from] PlanFileError),
}

/// The passed verification of the plan in `dir` as its files are now.
///
/// # Errors
/// [`Unverified`]: there is none, it failed, it is damaged, or a file is missing, not listed or has other bytes.
pub fn verified(dir: &Path) -> Result<Verified, Unverified> {
    let path = dir.join(VERDICT);
    if !path.exists() {
        return Err(Unverified::Absent { dir: dir.into() });
    }
    let text = std::fs::read_to_string(&path).map_err(PlanFileError::io("read", &path))?;
    let damaged = |key: &str, expected| Unverified::Damaged { path: path.clone(), key: key.into(), expected };
    let verdict: Table = text.parse().map_err(|_| damaged("", "a TOML file"))?;
    let passed =
        verdict.get("passed").and_then(Value::as_bool).ok_or_else(|| damaged("passed", "true or false"))?;
    let failed = failed_checks(&verdict);
    if !passed || !failed.is_empty() {
        return Err(Unverified::Failed { path, failed: first_names(failed) });
    }
    let listed = verdict.get("files").and_then(Value::as_table).ok_or_else(|| damaged("files", "a table"))?;
    let expected_digest = |name: &str| -> Result<Option<Sha256>, Unverified> {
        let Some(value) = listed.get(name) else { return Ok(None) };
        let digest = value.as_str().and_then(|text| text.parse().ok());
        digest.map(Some).ok_or_else(|| damaged(&format!("files.{name}"), "64 hexadecimal digits"))
    };
    let mut files = Vec::new();
    for name in BOUND.into_iter().chain(optional()) {
        let file = dir.join(name);
        let Some(expected) = expected_digest(name)? else {
            if BOUND.contains(&name) || file.exists() {
                return Err(Unverified::NotListed { path, name });
            }
            continue;
        };
        let found = Sha256::of_file(&file)?;
        if found != expected {
            return Err(Unverified::Changed { path: file, found, expected });
        }
        files.push((name.to_owned(), found));
    }
    let version = verdict.get("version").and_then(Value::as_str).unwrap_or_default().to_owned();
    Ok(Verified { files, version })
}

/// What each failed check is called, with its subject.
fn failed_checks(verdict: &Table) -> Vec<String> {
    let checks = verdict.get("check").and_then(Value::as_array).map(Vec::as_slice).unwrap_or_default();
    let failed = checks.iter().filter(|check| check.get("passed").and_then(Value::as_bool) != Some(true));
    let word = |check: &Value, key: &str| check.get(key).and_then(Value::as_str).map(str::to_owned);
    let name = |check: &Value| {
        let name = word(check, "name").unwrap_or_else(|| "a check without a name".into());
        word(check, "subject").map_or(name.clone(), |subject| format!("{name} ({subject})"))
    };
    failed.map(name).collect()
}

fn first_names(mut failed: Vec<String>) -> Vec<String> {
    let more = failed.len().saturating_sub(NAMED);
    failed.truncate(NAMED);
    if failed.is_empty() {
        failed.push("it does not say which check".into());
    }
    if more > 0 {
        failed.push(format!("and {more} more"));
    }
    failed
}

/// The text of the plan's case file as it is now.
///
/// # Errors
/// [`PlanFileError::Io`] when it cannot be read.
pub fn read_case_text(plan: &StoredPlan) -> Result<String, PlanFileError> {
    let path = plan.case_path();
    std::fs::read_to_string(&path).map_err(PlanFileError::io("read", path))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fmt::Write;
    use tempfile::TempDir;

    /// A folder with a plan's files, which hold their names, and a verdict of them.
    fn judged(passed: bool) -> TempDir {
        let dir = tempfile::tempdir().unwrap();
        for name in BOUND.into_iter().chain(["case.toml"]) {
            std::fs::write(dir.path().join(name), name).unwrap();
        }
        write_verdict(&dir, passed);
        dir
    }

    fn write_verdict(dir: &TempDir, passed: bool) {
        let mut text = format!("version = \"1.2\"\npassed = {passed}\nchecks = 1\n[files]\n");
        for (name, digest) in digests(dir.path()).unwrap() {
            writeln!(text, "\"{name}\" = \"{digest}\"").unwrap();
        }
        writeln!(text, "[[check]]\nname = \"clearance\"\nsubject = \"nerve\"\npassed = {passed}").unwrap();
        std::fs::write(dir.path().join(VERDICT), text).unwrap();
    }

    fn edit(dir: &TempDir, name: &str, change: impl Fn(&str) -> String) {
        let path = dir.path().join(name);
        let text = std::fs::read_to_string(&path).unwrap();
        std::fs::write(path, change(&text)).unwrap();
    }

    fn refusal(dir: &TempDir) -> String {
        verified(dir.path()).unwrap_err().to_string()
    }

    #[test]
    fn a_passed_verification_holds_for_the_files_as_they_are() {
        let found = verified(judged(true).path()).unwrap();
        assert_eq!((found.files().len(), found.version()), (6, "1.2"));
    }

    #[test]
    fn a_change_of_any_file_is_named_with_both_digests() {
        for name in BOUND.into_iter().chain(["case.toml"]) {
            let dir = judged(true);
            let expected = Sha256::of_file(&dir.path().join(name)).unwrap();
            edit(&dir, name, |text| format!("{text} "));
            let said = refusal(&dir);
            assert!(said.contains(name) && said.contains(&expected.to_string()), "{said}");
            assert!(matches!(verified(dir.path()), Err(Unverified::Changed { .. })));
            std::fs::remove_file(dir.path().join(name)).unwrap();
            assert!(matches!(verified(dir.path()), Err(Unverified::File(_))), "{name} is gone");
        }
    }

    #[test]
    fn a_failed_absent_or_damaged_verdict_is_refused_with_its_reason() {
        assert!(refusal(&judged(false)).contains("clearance (nerve)"));
        let dir = judged(true);
        edit(&dir, VERDICT, |text| text.replace("subject = \"nerve\"\npassed = true", "passed = false"));
        assert!(refusal(&dir).contains("failed: clearance"), "a verdict that contradicts itself");
        for (from, to, says) in [
            ("passed = true\nchecks", "checks", "`passed`: expected true or false"),
            ("[files]", "[other]", "`files`: expected a table"),
            ("\"trajectory.csv\" = \"", "\"trajectory.csv\" = \"x", "`files.trajectory.csv`"),
            ("\"trajectory.csv\"", "\"another.csv\"", "says nothing of trajectory.csv"),
            ("\"case.toml\"", "\"other.toml\"", "says nothing of case.toml"),
            ("passed", "=", "expected a TOML file"),
        ] {
            let dir = judged(true);
            edit(&dir, VERDICT, |text| text.replace(from, to));
            assert!(refusal(&dir).contains(says), "{from}: {}", refusal(&dir));
        }
        std::fs::remove_file(dir.path().join(VERDICT)).unwrap();
        assert!(refusal(&dir).contains("bonemill verify"));
    }
}
