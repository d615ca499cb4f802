//! A case: its text and its validated values.

use std::path::PathBuf;

use bonemill_planner::case::draft::{ImagePaths, KnownPlace, TargetWish, Wishes, choose};
use bonemill_planner::case::{Case as RustCase, with_values as rust_with_values};
use bonemill_planner::survey::{Survey, SurveyError};
use nalgebra::Vector3;
use pyo3::prelude::*;

use crate::{apart, errors};

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

/// Target, structures, labels left alone, arm and approach of a case to be made.
type Wanted = (Option<String>, Vec<String>, Vec<String>, String, Option<[f64; 3]>);

/// The text of a case of a CT and a label map, to lie in `file`, and what the user should know; `named`: as the case names the two.
#[pyfunction]
pub fn draft_case(
    py: Python<'_>,
    images: (PathBuf, PathBuf),
    named: (PathBuf, PathBuf),
    wanted: Wanted,
    file: PathBuf,
) -> PyResult<(String, Vec<String>)> {
    let ((ct, labels), (named_ct, named_labels)) = (images, named);
    let (target, structures, ignored, robot, approach) = wanted;
    let read = move |_: &dyn bonemill_planner::Progress| Survey::read(&ct, None, &labels, &[]);
    let survey = apart::run(py, None, None, read)?.map_err(|e| match &e {
        SurveyError::Image(image) => errors::image(image),
        _ => errors::CaseError::new_err(errors::words(&e)),
    })?;
    let wishes = Wishes { target: target.map(TargetWish::Label), structures, ignored };
    let refused = |e| errors::CaseError::new_err(errors::words(&e));
    let choice = choose(&survey.labels, &wishes).map_err(refused)?;
    let images = ImagePaths { ct: named_ct, ct_series: None, labels: named_labels };
    let known = (robot.as_str(), approach.map(Vector3::from), KnownPlace::Unknown);
    let (_, drafted) = survey.draft(images, &choice, known, &file).map_err(refused)?;
    Ok((drafted.text, [survey.warnings, drafted.notes].concat()))
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

    /// Keys and paths of the files that the case names.
    fn files(&self) -> Vec<(String, PathBuf)> {
        self.case.files().into_iter().map(|(key, path)| (key, path.to_owned())).collect()
    }
}
