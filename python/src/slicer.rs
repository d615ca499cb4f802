//! A plan as a scene for 3D Slicer, and as segments of its CT.

use std::path::PathBuf;

use bonemill_planner::pipeline::Refused;
use bonemill_planner::plan::{Need, StoredPlan};
use bonemill_planner::{PlanError, slicer as rust, stages};
use numpy::PyArray3;
use pyo3::prelude::*;

use crate::finished::{Finished, NotDone};
use crate::plan::Plan;
use crate::{apart, arrays, errors};

/// Why there is no scene.
enum Failed {
    Plan(NotDone),
    Scene(Box<Refused>),
}

impl From<Failed> for PyErr {
    fn from(failed: Failed) -> Self {
        match failed {
            Failed::Plan(error) => error.into(),
            Failed::Scene(error) => errors::refused(&error),
        }
    }
}

/// Of a plan that was read again.
fn of_stored<T>(
    finished: &Finished,
    work: impl FnOnce(&StoredPlan) -> Result<T, PlanError>,
) -> Result<T, Failed> {
    let plan = finished.read(Need::All).map_err(Failed::Plan)?;
    work(&plan).map_err(|e| Failed::Scene(Box::new(Refused::new(e, &plan.record.case, &plan.case_path()))))
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
        of_stored(&finished, |plan| rust::export(plan, &out, progress))
    })?;
    Ok(written?)
}

/// Labels on the CT's grid [i, j, k]; the affine from voxels to ct, row by row; each label with its name.
type Parts<'py> = (Bound<'py, PyArray3<u8>>, Vec<[f64; 4]>, Vec<(u8, String)>);

/// What a plan removes and leaves; `saved` as for [`to_slicer`].
#[pyfunction]
pub fn segments<'py>(
    py: Python<'py>,
    plan: &Plan,
    saved: Option<PathBuf>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Parts<'py>> {
    let finished = Finished::new(plan, saved)?;
    let found = apart::run(py, progress, None, move |progress| {
        progress.expect(stages::SLICER);
        of_stored(&finished, |plan| rust::segments(plan, progress))
    })??;
    let grid = found.labels.grid();
    let (axes, spacing, origin) = (grid.axes(), grid.spacing_mm(), grid.origin().coords);
    let row = |a: usize| {
        [axes[(a, 0)] * spacing[0], axes[(a, 1)] * spacing[1], axes[(a, 2)] * spacing[2], origin[a]]
    };
    let affine = vec![row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]];
    let names = found.list.iter().map(|s| (s.label, s.name.clone())).collect();
    let (grid, labels) = found.labels.into_parts();
    Ok((arrays::to_numpy(py, grid.dims(), labels)?, affine, names))
}
