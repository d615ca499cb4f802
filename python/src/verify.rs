//! A second opinion on a finished plan.

use std::path::PathBuf;

use bonemill_planner::plan::{StoredPlan, write_verdict};
use bonemill_planner::verify::verify as rust_verify;
use pyo3::prelude::*;

use crate::{apart, errors};

/// The verdict on the plan in `dir`, as `verification.toml` has it; `keep`: it is written beside the plan.
#[pyfunction]
pub fn verify(py: Python<'_>, dir: PathBuf, keep: bool, progress: Option<Py<PyAny>>) -> PyResult<String> {
    let done = apart::run(py, progress, None, move |progress| {
        let plan = StoredPlan::load(&dir).map_err(|e| errors::words(&e))?;
        let verdict = rust_verify(&plan, progress).map_err(|e| errors::words(&e))?.to_toml();
        if keep {
            write_verdict(&dir, &verdict).map_err(|e| errors::words(&e))?;
        }
        Ok::<_, String>(verdict)
    })?;
    done.map_err(errors::PlanError::new_err)
}
