//! The burr's coefficients from a log of measured forces.

use std::path::PathBuf;

use bonemill_geometry::Point;
use bonemill_planner::calibrate::{
    Coefficient, CoefficientFit, NoSuchCoefficient, calibrate as rust_calibrate,
};
use bonemill_planner::plan::{ForceLogRow, Need, read_force_log};
use bonemill_planner::simulate::{SimulationSetup, observe};
use bonemill_planner::stages;
use numpy::PyReadonlyArray2;
use pyo3::prelude::*;

use crate::finished::{Finished, NotDone};
use crate::plan::Plan;
use crate::{apart, errors};

/// The source of the log.
#[derive(FromPyObject)]
pub enum Log<'py> {
    /// Rows of time_s, position (mm, ct), axis, force (N, ct): 10 finite columns with increasing time, checked by the caller.
    Rows(PyReadonlyArray2<'py, f64>),
    /// A file.
    File(PathBuf),
}

/// Key, value, half the 95 % interval and unit of every coefficient; residual, N; rows used.
type Fitted = (Vec<(&'static str, f64, f64, &'static str)>, f64, usize);

/// Fits `coefficients` to a log of poses along which the plan's bone is milled; `saved` has the same meaning as for a simulation.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "keyword arguments of a Python function")]
pub fn calibrate(
    py: Python<'_>,
    plan: &Plan,
    saved: Option<PathBuf>,
    log: Log<'_>,
    coefficients: Vec<String>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Fitted> {
    let wanted: Result<Vec<Coefficient>, NoSuchCoefficient> =
        coefficients.iter().map(|key| key.parse()).collect();
    let wanted = wanted.map_err(|e| errors::ModelError::new_err(e.to_string()))?;
    let rows = match log {
        Log::Rows(array) => array.as_array().rows().into_iter().map(|v| row(|n| v[n])).collect(),
        Log::File(path) => read_force_log(&path).map_err(|e| errors::file(&e))?,
    };
    let finished = Finished::new(plan, saved)?;
    let done: Result<CoefficientFit, NotDone> = apart::run(py, progress, None, move |progress| {
        progress.expect(stages::CALIBRATE);
        let setup = SimulationSetup::read(&finished.read(Need::All)?, progress)?;
        progress.stage("mill along the log");
        let observations = observe(&setup, &rows)?;
        progress.stage("fit");
        Ok(rust_calibrate(&observations, &wanted)?)
    })?;
    let fit = done?;
    let estimate = |e: &bonemill_planner::calibrate::Estimate| {
        (e.coefficient.key(), e.value, e.half_width, e.coefficient.unit())
    };
    Ok((fit.estimates.iter().map(estimate).collect(), fit.residual_n, fit.used))
}

/// A row of the log; `v` returns its columns.
fn row(v: impl Fn(usize) -> f64) -> ForceLogRow {
    ForceLogRow {
        time_s: v(0),
        position: Point::new(v(1), v(2), v(3)),
        axis: [v(4), v(5), v(6)].into(),
        force_n: [v(7), v(8), v(9)].into(),
    }
}
