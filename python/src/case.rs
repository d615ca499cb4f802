//! A case's text and what it says.

use std::path::PathBuf;

use bonemill_planner::case::Case as RustCase;
use pyo3::prelude::*;

use crate::errors;

/// A validated case and where its file stands.
#[pyclass(frozen, module = "bonemill._native")]
pub struct Case {
    pub case: RustCase,
    pub path: PathBuf,
}

#[pymethods]
impl Case {
    /// The case in `text`; `path` is the file that messages name and paths are relative to.
    #[new]
    fn new(text: &str, path: PathBuf) -> PyResult<Self> {
        let case = RustCase::parse(text, &path).map_err(|e| errors::case(&e))?;
        Ok(Self { case, path })
    }

    /// The resolved case, every default spelled out, as TOML.
    fn to_toml(&self) -> String {
        self.case.to_toml()
    }

    /// Paths of CT and labels, as the case names them.
    fn images(&self) -> (PathBuf, PathBuf) {
        (self.case.images.ct.clone(), self.case.images.labels.clone())
    }
}
