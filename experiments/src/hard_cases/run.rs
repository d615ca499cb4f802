//! Runs a scene as a user would: writes its files, plans, reads the plan back and verifies it.

use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use bonemill_planner::case::Case;
use bonemill_planner::plan::{PlanFileError, PlanRecord, Replace, StagedDirectory, StoredPlan};
use bonemill_planner::report::CtSlices;
use bonemill_planner::save;
use bonemill_planner::verify::{Check, verify};
use bonemill_planner::{PlanError, Progress};

use super::scene::{Expect, Scene};

/// How a plan says that the shank meets bone as it turns.
const CANNOT_TURN: &str = "the shank cannot turn as it must";

/// A result whose error is only printed.
type Told<T> = Result<T, Box<dyn std::error::Error>>;

/// The result of a scene.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum End {
    /// A plan that passes every check.
    Verified,
    /// The plan states that it falls short, and verify reports the same and no other fault; or the case cannot be planned.
    FallsShort(String),
    /// Bad input.
    Refused(String),
    /// A plan that fails checks: their names, and their texts.
    Faulty(Vec<&'static str>, String),
    /// Something that must never happen: a panic, a file that cannot be written or read back.
    Broken(String),
}

impl End {
    /// Whether it is the expected result.
    pub fn keeps(&self, expect: &Expect) -> bool {
        match (self, expect) {
            (Self::Verified, Expect::Verified) => true,
            (Self::FallsShort(said), Expect::FallsShort(words))
            | (Self::Refused(said), Expect::Refused(words)) => said.contains(words),
            _ => false,
        }
    }

    /// The result in one word.
    pub fn word(&self) -> &'static str {
        match self {
            Self::Verified => "verified",
            Self::FallsShort(_) => "fell short",
            Self::Refused(_) => "refused",
            Self::Faulty(..) => "FAULTY",
            Self::Broken(_) => "BROKEN",
        }
    }

    /// The reason for the result.
    pub fn reason(&self) -> String {
        match self {
            Self::Verified => "every check passed".into(),
            Self::FallsShort(why) | Self::Refused(why) | Self::Faulty(_, why) | Self::Broken(why) => {
                why.clone()
            }
        }
    }
}

impl fmt::Display for End {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.word(), self.reason())
    }
}

/// Runs a scene in a temporary folder.
pub fn run(scene: &Scene) -> End {
    run_judged(scene, |_| Vec::new())
}

/// The same with another judge, who says what is wrong with a plan beside what verify finds.
pub(super) fn run_judged(scene: &Scene, mut judge: impl FnMut(&StoredPlan) -> Vec<String>) -> End {
    let folder = match tempfile::tempdir() {
        Ok(folder) => folder,
        Err(error) => return End::Broken(format!("no folder: {error}")),
    };
    or_panic(|| run_in(scene, folder.path(), &mut judge)).unwrap_or_else(End::Broken)
}

/// What `run` returns, or the panic in which it ends, in words.
pub(crate) fn or_panic<T>(run: impl FnOnce() -> T) -> Result<T, String> {
    catch_unwind(AssertUnwindSafe(run)).map_err(|panic| {
        let said = panic.downcast_ref::<String>().cloned();
        let said = said.or_else(|| panic.downcast_ref::<&str>().map(|s| (*s).to_owned()));
        format!("a panic: {}", said.unwrap_or_default())
    })
}

/// Ignores progress.
pub(super) struct Quiet;
impl Progress for Quiet {
    fn stage(&self, _: &str) {}
    fn advance(&self, _: usize, _: usize) {}
}

fn run_in(scene: &Scene, folder: &Path, judge: &mut dyn FnMut(&StoredPlan) -> Vec<String>) -> End {
    let (text, case_path) = match scene.write(folder) {
        Ok(written) => written,
        Err(error) => return End::Broken(format!("the body cannot be written: {error}")),
    };
    let case = match Case::parse(&text, &case_path) {
        Ok(case) => case,
        Err(error) => return End::Refused(error.to_string()),
    };
    let refused = |error: PlanError| {
        if error.is_infeasible() {
            End::FallsShort(error.to_string())
        } else {
            End::Refused(error.to_string())
        }
    };
    let stored = |fill: &dyn Fn(&StagedDirectory) -> Result<PlanRecord, PlanFileError>| -> Told<StoredPlan> {
        let staged = StagedDirectory::create(&folder.join("plan"), Replace::Plan)?;
        fill(&staged)?;
        Ok(StoredPlan::load(&staged.commit()?)?)
    };
    let stored = match case.job.channel() {
        Some(spec) => match bonemill_planner::channel::plan(&case, spec, &case_path, &Quiet) {
            Ok(plan) => stored(&|staged| save::channel(&plan, &case_path, staged, CtSlices::Shown)),
            Err(error) => return refused(error),
        },
        None => match bonemill_planner::plan(&case, &case_path, &Quiet) {
            Ok(plan) => stored(&|staged| save::plan(&plan, &case_path, staged, CtSlices::Shown)),
            Err(error) => return refused(error),
        },
    };
    let stored = match stored {
        Ok(stored) => stored,
        Err(error) => return End::Broken(format!("the plan does not come back from its files: {error}")),
    };
    match verify(&stored, &Quiet) {
        Err(error) => End::Broken(format!("the plan cannot be verified: {error}")),
        Ok(found) => {
            let shortfalls = &stored.record.shortfalls;
            let judged = judge(&stored);
            // if the plan states that it falls short, only the other failed checks count; so does a plan whose shank cannot turn
            let cannot_turn = shortfalls.iter().any(|reason| reason.starts_with(CANNOT_TURN));
            let is_told = |check: &&Check| cannot_turn && check.name.starts_with("shank in ");
            let failed: Vec<_> = if shortfalls.is_empty() {
                found.failed().collect()
            } else {
                found.wrong().filter(|check| !is_told(check)).collect()
            };
            if !failed.is_empty() {
                let said: Vec<String> = failed.iter().map(ToString::to_string).collect();
                End::Faulty(failed.iter().map(|check| check.name).collect(), said.join("; "))
            } else if !judged.is_empty() {
                End::Faulty(vec!["judged"], judged.join("; "))
            } else if shortfalls.is_empty() {
                End::Verified
            } else {
                End::FallsShort(shortfalls.join("; "))
            }
        }
    }
}
