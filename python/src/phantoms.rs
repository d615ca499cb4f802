//! Phantoms, with which everything can be tried without a patient.

use std::path::PathBuf;

use bonemill_imaging::phantom::{PhantomKind, UnknownPhantom, phantom};
use bonemill_imaging::write_phantom as write_files;
use bonemill_planner::plan::{Replace, StagedDirectory};
use pyo3::prelude::*;

use crate::{apart, errors};

/// Writes a phantom's images, names and case file into a new folder; returns the folder.
#[pyfunction]
pub fn write_phantom(py: Python<'_>, kind: &str, seed: u64, out: PathBuf) -> PyResult<PathBuf> {
    let kind: PhantomKind =
        kind.parse().map_err(|e: UnknownPhantom| errors::CaseError::new_err(errors::words(&e)))?;
    let staged = StagedDirectory::create(&out, Replace::Nothing).map_err(|e| errors::file(&e))?;
    let dir = staged.path().to_owned();
    let made = apart::run(py, None, None, move |_| write_files(&dir, &phantom(kind, seed)))?;
    made.map_err(|e| errors::image(&e))?;
    staged.commit().map_err(|e| errors::file(&e))
}
