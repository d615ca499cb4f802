//! A case: its text and its validated values.

use std::path::PathBuf;

use bonemill_geometry::Point;
use bonemill_imaging::slicer::{SlicerFileError, read_base_from_ct, read_markups};
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
/// A file, and how the case names it.
type NamedFile = (PathBuf, PathBuf);
/// CT with its series, label map, further files of labels.
type Images = ((NamedFile, Option<String>), NamedFile, Vec<NamedFile>);
/// Files of 3D Slicer: registration, fiducials; or the fiducials' places in ct.
type Place = (Option<PathBuf>, Option<PathBuf>, Option<Vec<[f64; 3]>>);

/// The text of a case of images, to lie in `file`, and what the user should know.
#[pyfunction]
pub fn draft_case(
    py: Python<'_>,
    images: Images,
    wanted: Wanted,
    place: Place,
    file: PathBuf,
) -> PyResult<(String, Vec<String>)> {
    let (((ct, named_ct), ct_series), (labels, named_labels), further) = images;
    let (target, structures, ignored, robot, approach) = wanted;
    let place = known_place(place)?;
    let (series, named) = (ct_series.clone(), named_labels.clone());
    let read = move |_: &dyn bonemill_planner::Progress| {
        Survey::read(&ct, series.as_deref(), (&labels, &named), &further)
    };
    let survey = apart::run(py, None, None, read)?.map_err(|e| match &e {
        SurveyError::Image(image) => errors::image(image),
        _ => errors::CaseError::new_err(errors::words(&e)),
    })?;
    let wishes = Wishes { target: target.map(TargetWish::Label), structures, ignored };
    let refused = |e| errors::CaseError::new_err(errors::words(&e));
    let choice = choose(&survey.labels, &wishes).map_err(refused)?;
    let ct_series = ct_series.as_deref().map(bonemill_imaging::series_name);
    let images = ImagePaths { ct: named_ct, ct_series, labels: named_labels };
    let known = (robot.as_str(), approach.map(Vector3::from), place);
    let (_, drafted) = survey.draft(images, &choice, known, &file).map_err(refused)?;
    Ok((drafted.text, [survey.warnings, drafted.notes].concat()))
}

/// Where the patient is, by at most one of what may tell it.
fn known_place((registration, fiducials, points): Place) -> PyResult<KnownPlace> {
    let refused = |e: SlicerFileError| errors::CaseError::new_err(errors::words(&e));
    if let Some(path) = registration {
        return Ok(KnownPlace::Registered(read_base_from_ct(&path).map_err(refused)?));
    }
    if let Some(path) = fiducials {
        let read = read_markups(&path).map_err(refused)?;
        return Ok(KnownPlace::Fiducials(read.points.iter().map(|point| point.position).collect()));
    }
    let point = |[x, y, z]: [f64; 3]| Point::new(x, y, z);
    Ok(points
        .map_or(KnownPlace::Unknown, |points| KnownPlace::Fiducials(points.into_iter().map(point).collect())))
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
