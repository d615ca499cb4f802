//! Replays a finished plan through the bone.

use std::path::PathBuf;

use bonemill_planner::case::Case;
use bonemill_planner::plan::Need;
use bonemill_planner::report::simulation::values as figures;
use bonemill_planner::simulate::{
    ModelName, NoSuchModel, Sampling, Simulation, SimulationRow, simulate as rust_simulate,
};
use bonemill_planner::{save, stages};
use numpy::{IntoPyArray, PyArray1};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::finished::{Finished, NotDone};
use crate::plan::Plan;
use crate::{apart, errors, values};

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

/// Columns by name, indices of the structures (−1 for none), figures.
type Simulated<'py> =
    (Vec<(&'static str, Bound<'py, PyArray1<f64>>)>, Bound<'py, PyArray1<i64>>, Bound<'py, PyDict>);

/// Replays a plan, which was written to `saved` unless it was read from its own folder. With `keep`, `simulation.csv` and its
/// part of the report are written there, as by the command. Exactly one of `step_mm` and `rate_hz` is given.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "the package's Python names them")]
pub fn simulate<'py>(
    py: Python<'py>,
    plan: &Plan,
    saved: Option<PathBuf>,
    model: &str,
    step_mm: f64,
    rate_hz: Option<f64>,
    keep: bool,
    progress: Option<Py<PyAny>>,
) -> PyResult<Simulated<'py>> {
    let model: ModelName =
        model.parse().map_err(|e: NoSuchModel| errors::ModelError::new_err(e.to_string()))?;
    let sampling = rate_hz.map_or(Sampling::Step { step_mm }, |rate_hz| Sampling::Rate { rate_hz });
    let finished = Finished::new(plan, saved)?;
    let done = apart::run(py, progress, None, move |progress| {
        let plan = finished.read(Need::All)?;
        let replayed = stages::of_simulation(&plan.record.case);
        let written = if keep { &[stages::WRITE_FILES][..] } else { &[] };
        progress.expect(&[replayed, written].concat());
        let simulated = rust_simulate(&plan, model, sampling, progress)?;
        if keep {
            progress.stage("write files");
            save::simulation(finished.dir(), &simulated, &plan.record)?;
        }
        Ok::<_, NotDone>((simulated, plan.record.case))
    })?;
    let (simulated, case) = done?;
    to_python(py, &simulated, &case)
}

fn to_python<'py>(py: Python<'py>, simulation: &Simulation, case: &Case) -> PyResult<Simulated<'py>> {
    let column = |(name, value): &Column| {
        let values = simulation.rows.iter().map(|r| value(r).map_or(f64::NAN, |v| v + 0.0));
        (*name, values.collect::<Vec<_>>().into_pyarray(py))
    };
    let structures = simulation.rows.iter().map(|r| r.structure.map_or(-1, |n| n as i64));
    let structures = structures.collect::<Vec<_>>().into_pyarray(py);
    Ok((COLUMNS.iter().map(column).collect(), structures, values::dict(py, &figures(simulation, case))?))
}
