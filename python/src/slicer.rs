//! A plan as a scene for 3D Slicer.

use std::path::PathBuf;

use bonemill_planner::pipeline::Refused;
use bonemill_planner::plan::Need;
use bonemill_planner::{slicer as rust, stages};
use pyo3::prelude::*;

use crate::finished::{Finished, NotDone};
use crate::plan::Plan;
use crate::{apart, errors};

/// Why there is no scene.
enum Failed {
    Plan(NotDone),
    Scene(Box<Refused>),
}

/// Writes the scene of a plan, which was written to `saved` unless it was read from its own folder, into the folder `out`; returns the folder.
#[pyfunction]
pub fn to_slicer(
    py: Python<'_>,
    plan: &Plan,
    saved: Option<PathBuf>,
    out: PathBuf,
    progress: Option<Py<PyAny>>,
) -> PyResult<PathBuf> {
    let finished = Finished::new(plan, saved)?;
    let written = apart::run(py, progress, None, move |progress| {
        progress.expect(&[stages::SLICER, &[stages::WRITE_FILES]].concat());
        let plan = finished.read(Need::All).map_err(Failed::Plan)?;
        rust::export(&plan, &out, progress)
            .map_err(|e| Failed::Scene(Box::new(Refused::new(e, &plan.record.case, &plan.case_path()))))
    })?;
    match written {
        Ok(folder) => Ok(folder),
        Err(Failed::Plan(error)) => Err(error.into()),
        Err(Failed::Scene(error)) => Err(errors::refused(&error)),
    }
}
