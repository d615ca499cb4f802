//! Whether a plan's files are those that a passed verification judged.

use std::path::PathBuf;

use bonemill_planner::plan::verified as rust_verified;
use pyo3::prelude::*;

use crate::errors::{PlanFileError, words};

/// Name and SHA-256 of the files of the plan in `dir` that its passed verification holds for.
///
/// # Errors
/// `PlanFileError` with the file, its digest and the verified one; or that there is no verification, or that it failed.
#[pyfunction]
pub fn verified(dir: PathBuf) -> PyResult<Vec<(String, String)>> {
    let found = rust_verified(&dir).map_err(|error| PlanFileError::new_err(words(&error)))?;
    Ok(found.files().iter().map(|(name, digest)| (name.clone(), digest.to_string())).collect())
}
