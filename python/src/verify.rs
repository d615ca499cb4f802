//! A second opinion on a finished plan.

use std::path::PathBuf;

use bonemill_planner::plan::{Need, StoredPlan};
use bonemill_planner::uncertainty::{
    self as rust, ErrorModel, Risk, Sigmas, UncertaintyError, simulate_errors,
};
use bonemill_planner::verify::verify as rust_verify;
use bonemill_planner::{save, stages};
use pyo3::prelude::*;

use crate::apart;
use crate::finished::{Finished, NotDone};
use crate::plan::Plan;

/// Standard deviations: registration (mm, degrees), boundary (mm), density and coefficients (shares); probability with which
/// structures must stay untouched; seed.
type Errors = ([f64; 5], f64, u64);
/// Name; number of samples in which it is touched, and of all samples; their share with its 95 % interval; 5, 50 and 95 %
/// quantiles of the distance, and the clearance with which it would stay untouched, mm.
type StructureRisk = (String, (usize, usize), [f64; 3], [f64; 3], f64);
/// Name, planned value, and 5, 50 and 95 % quantiles, N.
type ForceSpread = (String, f64, [f64; 3]);
/// The risks under errors.
type Risks = (Vec<StructureRisk>, Vec<ForceSpread>);

/// The verification of a plan, which was written to `saved` unless it was read from its own folder, as in `verification.toml`.
/// With `keep`, that file and its part of the report are written there, as by the command; with `samples`, the plan is also
/// evaluated under this many random `errors`.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "keyword arguments of a Python function")]
pub fn verify(
    py: Python<'_>,
    plan: &Plan,
    saved: Option<PathBuf>,
    keep: bool,
    samples: Option<usize>,
    errors: Errors,
    progress: Option<Py<PyAny>>,
) -> PyResult<(String, Option<Risks>)> {
    let finished = Finished::new(plan, saved)?;
    let done = apart::run(py, progress, None, move |progress| {
        let plan = finished.read(Need::All)?;
        let model = samples.map(|n| model(&plan, n, errors)).transpose()?;
        let checked = stages::of_verification(&plan.record.case);
        let drawn_after = if model.is_some() { stages::DRAW_ERRORS } else { &[] };
        let written = if keep { &[stages::WRITE_VERDICT][..] } else { &[] };
        progress.expect(&[checked, drawn_after, written].concat());
        let verdict = rust_verify(&plan, progress)?;
        let drawn = model.map(|m| simulate_errors(&plan, &m, progress).map(|risk| (m, risk))).transpose()?;
        if keep {
            progress.stage("write verdict");
            save::verification(finished.dir(), &verdict, drawn.as_ref().map(|(m, risk)| (m, risk)))?;
        }
        Ok::<_, NotDone>((verdict.to_toml(), drawn.map(|(_, risk)| risks(risk))))
    })?;
    Ok(done?)
}

fn model(plan: &StoredPlan, samples: usize, errors: Errors) -> Result<ErrorModel, UncertaintyError> {
    let ([registration_mm, registration_deg, boundary_mm, density_share, coefficient_share], keep, seed) =
        errors;
    let registration_rad = registration_deg.to_radians();
    let sigmas = Sigmas { registration_mm, registration_rad, boundary_mm, density_share, coefficient_share };
    ErrorModel::about_path(plan, &sigmas, samples, seed, keep)
}

fn risks(risk: Risk) -> Risks {
    let structure = |s: rust::StructureRisk| {
        let t = s.touched;
        (s.name, (t.hits, t.samples), [t.estimate, t.low, t.high], s.kept_mm, s.clearance_mm)
    };
    let structures = risk.structures.into_iter().map(structure).collect();
    (structures, risk.forces.into_iter().map(|f| (f.name, f.planned_n, f.spread_n)).collect())
}
