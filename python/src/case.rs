//! A case: its text and its validated values.

use std::path::PathBuf;

use bonemill_planner::case::{Case as RustCase, with_values as rust_with_values};
use pyo3::prelude::*;

use crate::errors;

/// A validated case and the path of its file.
#[pyclass(frozen, module = "bonemill._native")]
pub struct Case {
    pub case: RustCase,
    pub path: PathBuf,
}

/// The text of the case in `file` with keys set to values (written as TOML) or removed.
#[pyfunction]
pub fn with_values(text: &str, file: PathBuf, values: Vec<(String, Option<String>)>) -> PyResult<String> {
    rust_with_values(text, &file, &values).map_err(|e| errors::case(&e))
}

#[pymethods]
impl Case {
    /// The case in `text`; messages name the file `path`, and paths are relative to it.
    #[new]
    fn new(text: &str, path: PathBuf) -> PyResult<Self> {
        let case = RustCase::parse(text, &path).map_err(|e| errors::case(&e))?;
        Ok(Self { case, path })
    }

    /// The resolved case, every default spelled out, as TOML.
    fn to_toml(&self) -> String {
        self.case.to_toml()
    }

    /// Keys and paths of the files that the case names: CT, labels, and those of the arm.
    fn files(&self) -> Vec<(&'static str, PathBuf)> {
        let images = &self.case.images;
        let images = [("images.ct", images.ct.as_path()), ("images.labels", &images.labels)];
        images.into_iter().chain(self.case.robot.files()).map(|(key, path)| (key, path.to_owned())).collect()
    }
}
