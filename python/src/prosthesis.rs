//! A prosthesis: planned from its job file, looked at, saved.

use std::path::PathBuf;

use bonemill_planner::case::prosthesis::ProsthesisJob;
use bonemill_planner::plan::{Replace, StagedDirectory};
use bonemill_prosthesis::{ProsthesisError, ProsthesisPlan as RustPlan, plan, save};
use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::{apart, errors, values};

/// A planned prosthesis. A block from a catalogue goes back when the plan is not saved.
#[pyclass(frozen, module = "bonemill._native")]
pub struct ProsthesisPlan {
    plan: Box<RustPlan>,
    job_path: PathBuf,
}

/// Plans the job in a file; `progress(stage, done, of)` is told how far it is.
#[pyfunction]
pub fn prosthesis(
    py: Python<'_>,
    job: PathBuf,
    progress: Option<Py<PyAny>>,
    threads: Option<usize>,
) -> PyResult<ProsthesisPlan> {
    let text = std::fs::read_to_string(&job)?;
    let path = job.clone();
    let made = apart::run(py, progress, threads, move |progress| {
        let job = ProsthesisJob::parse(&text, &path)?;
        progress.expect(bonemill_prosthesis::STAGES);
        plan(&job, &path, None, progress).map(Box::new)
    })?;
    let plan = made.map_err(|e: ProsthesisError| errors::prosthesis(&e))?;
    Ok(ProsthesisPlan { plan, job_path: job })
}

#[pymethods]
impl ProsthesisPlan {
    /// Figures by name; names end in units.
    #[getter]
    fn metrics<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        values::dict(py, &self.plan.metrics)
    }

    /// What the user should know.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.plan.warnings.clone()
    }

    /// Why the plan falls short; empty when it does not.
    #[getter]
    fn shortfalls(&self) -> Vec<String> {
        self.plan.shortfalls.clone()
    }

    /// Number of the block, and its sides along x, y and z, mm.
    #[getter]
    fn block(&self) -> (String, [f64; 3]) {
        let mounted = &self.plan.taken.mounted;
        (mounted.id.clone(), mounted.size_mm)
    }

    /// The G-code.
    #[getter]
    fn program(&self) -> &str {
        &self.plan.program
    }

    /// Side and kind of every move, and its numbers: x, y, z (block's frame, mm), a (rad), feed (mm/min), time (s).
    fn moves<'py>(
        &self,
        py: Python<'py>,
    ) -> (Vec<&'static str>, Vec<&'static str>, Bound<'py, PyArray2<f64>>) {
        let moves = &self.plan.machining.moves;
        let numbers = Array2::from_shape_fn((moves.len(), 6), |(row, column)| {
            let m = &moves[row];
            match column {
                0..3 => m.tip_mm[column],
                3 => m.a_rad,
                4 => m.feed_mm_min,
                _ => m.time_s,
            }
        });
        let sides = moves.iter().map(|m| m.side.name()).collect();
        let kinds = moves.iter().map(|m| m.kind.name()).collect();
        (sides, kinds, numbers.into_pyarray(py))
    }

    /// Points of the part's surface (block's frame, mm) and what the program leaves there, mm: rows x, y, z, deviation.
    fn deviations<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        let samples = &self.plan.proof.samples;
        let at = |(row, column): (usize, usize)| match column {
            0..3 => samples[row].at_mm[column],
            _ => samples[row].deviation_mm,
        };
        Array2::from_shape_fn((samples.len(), 4), at).into_pyarray(py)
    }

    /// Writes the folder; the block stays taken unless the plan falls short.
    fn save(&self, out: PathBuf) -> PyResult<PathBuf> {
        let staged = StagedDirectory::create(&out, Replace::Prosthesis).map_err(|e| errors::file(&e))?;
        save(&self.plan, &self.job_path, &staged).map_err(|e| errors::prosthesis(&e))?;
        let out = staged.commit().map_err(|e| errors::file(&e))?;
        self.plan.keep_block().map_err(|e| errors::prosthesis(&e))?;
        Ok(out)
    }
}
