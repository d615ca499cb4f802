//! A second opinion on a finished plan.

use std::path::PathBuf;

use bonemill_planner::plan::save_verification;
use bonemill_planner::verify::verify as rust_verify;
use pyo3::prelude::*;

use crate::apart;
use crate::finished::{Finished, NotDone};
use crate::plan::Plan;

/// The verdict on a plan, which lies in `saved` unless it was read from its own folder, as `verification.toml` has it;
/// `keep`: that file and its part of the report are written there, as the command does.
#[pyfunction]
pub fn verify(
    py: Python<'_>,
    plan: &Plan,
    saved: Option<PathBuf>,
    keep: bool,
    progress: Option<Py<PyAny>>,
) -> PyResult<String> {
    let finished = Finished::new(plan, saved)?;
    let done = apart::run(py, progress, None, move |progress| {
        let verdict = rust_verify(&finished.read()?, progress)?;
        if keep {
            progress.stage("write verdict");
            save_verification(finished.dir(), &verdict)?;
        }
        Ok::<_, NotDone>(verdict.to_toml())
    })?;
    Ok(done?)
}
