//! A finished plan, replayed through the bone.

use std::path::PathBuf;

use bonemill_planner::plan::{StoredPlan, save_simulation};
use bonemill_planner::simulate::{
    ModelName, NoSuchModel, Sampling, SimulateError, Simulation, SimulationRow, simulate as rust_simulate,
};
use numpy::{IntoPyArray, PyArray1};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::{apart, errors};

/// A column's name and a row's value; `None` is an empty cell.
type Column = (&'static str, fn(&SimulationRow) -> Option<f64>);

/// The columns of `simulation.csv` that hold numbers, in its order.
const COLUMNS: [Column; 13] = [
    ("time_s", |r| Some(r.time_s)),
    ("x_mm", |r| Some(r.position.x())),
    ("y_mm", |r| Some(r.position.y())),
    ("z_mm", |r| Some(r.position.z())),
    ("fx_n", |r| Some(r.force_n.x)),
    ("fy_n", |r| Some(r.force_n.y)),
    ("fz_n", |r| Some(r.force_n.z)),
    ("torque_nmm", |r| Some(r.torque_nmm)),
    ("power_w", |r| Some(r.power_w)),
    ("mrr_mm3_s", |r| Some(r.mrr_mm3_s)),
    ("force_toward_n", |r| r.force_toward_n),
    ("distance_mm", |r| r.distance_mm),
    ("deflection_um", |r| r.deflection_um),
];

/// Columns by name, places of the structures (−1: none), figures.
type Simulated<'py> =
    (Vec<(&'static str, Bound<'py, PyArray1<f64>>)>, Bound<'py, PyArray1<i64>>, Bound<'py, PyDict>);

/// Replays the plan in `dir`; `keep`: `simulation.csv` is written beside it, as the command does.
#[pyfunction]
pub fn simulate<'py>(
    py: Python<'py>,
    dir: PathBuf,
    model: &str,
    step_mm: f64,
    keep: bool,
    progress: Option<Py<PyAny>>,
) -> PyResult<Simulated<'py>> {
    let model: ModelName =
        model.parse().map_err(|e: NoSuchModel| errors::ModelError::new_err(errors::words(&e)))?;
    let done = apart::run(py, progress, None, move |progress| {
        let plan = StoredPlan::load(&dir).map_err(|e| errors::words(&e))?;
        let sampling = Sampling::Step { step_mm };
        let simulated =
            rust_simulate(&plan, model, sampling, progress).map_err(|e: SimulateError| errors::words(&e))?;
        if keep {
            save_simulation(&dir, &simulated, &plan.record.case).map_err(|e| errors::words(&e))?;
        }
        Ok::<_, String>(simulated)
    })?;
    to_python(py, &done.map_err(errors::PlanError::new_err)?)
}

fn to_python<'py>(py: Python<'py>, simulation: &Simulation) -> PyResult<Simulated<'py>> {
    let column = |(name, value): &Column| {
        let values = simulation.rows.iter().map(|r| value(r).map_or(f64::NAN, |v| v + 0.0));
        (*name, values.collect::<Vec<_>>().into_pyarray(py))
    };
    let structures = simulation.rows.iter().map(|r| r.structure.map_or(-1, |n| n as i64));
    let figures = PyDict::new(py);
    figures.set_item("peak_force_n", simulation.peak_force_n())?;
    figures.set_item("mean_force_n", simulation.mean_force_n())?;
    figures.set_item("energy_j", simulation.energy_j())?;
    figures.set_item("stopped", simulation.stopped)?;
    figures.set_item("compliant", simulation.compliant)?;
    Ok((COLUMNS.iter().map(column).collect(), structures.collect::<Vec<_>>().into_pyarray(py), figures))
}
