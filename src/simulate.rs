//! `bonemill simulate`: replays a plan's trajectory, poses from standard input, or a force log.

use std::path::Path;

use anyhow::Context;
use bonemill_planner::Progress;
use bonemill_planner::calibrate::{Coefficient, CoefficientFit, calibrate};
use bonemill_planner::plan::{Need, StoredPlan, read_force_log};
use bonemill_planner::save;
use bonemill_planner::simulate::{Sampling, SimulationSetup, observe, simulate};
use bonemill_planner::stages;
use serde_json::json;

use crate::args::{SimulateArgs, Talk};
use crate::drill_log;
use crate::outcome::Outcome;
use crate::stream;

pub fn run(args: &SimulateArgs, progress: &dyn Progress, talk: Talk) -> anyhow::Result<Outcome> {
    progress.stage("read plan");
    let place = args.folder.plan.display();
    let plan = args.folder.load(Need::All).with_context(|| format!("the plan in {place} cannot be read"))?;
    let cannot = || format!("the plan in {place} cannot be simulated");
    if args.stream {
        return stream::run(&plan, args.model, progress, talk);
    }
    if let Some(log) = &args.calibrate {
        return match (plan.record.case.job.channel(), &args.coefficients) {
            (None, wanted) => fit(&plan, log, wanted.as_deref().unwrap_or(&Coefficient::ALL), progress),
            (Some(_), None) => drill_log::fit(&plan, log),
            (Some(_), Some(_)) => anyhow::bail!(
                "--coefficients: they are a burr's; what is fitted for a drill or reamer is material.edge_model of the plan's case"
            ),
        };
    }
    let replayed = stages::of_simulation(&plan.record.case);
    progress.expect(&[&[stages::READ_PLAN], replayed, &[stages::WRITE_FILES]].concat());
    let sampling = match args.rate_hz {
        Some(rate_hz) => Sampling::Rate { rate_hz },
        None => Sampling::Step { step_mm: args.step_mm },
    };
    let simulation = simulate(&plan, args.model, sampling, progress).with_context(cannot)?;
    progress.stage("write files");
    let out = save::simulation(&plan.dir, &simulation, &plan.record)?;
    Ok(Outcome::simulated(&out, &simulation, &plan.record))
}

/// Fits the burr's coefficients to a log.
fn fit(
    plan: &StoredPlan,
    log: &Path,
    coefficients: &[Coefficient],
    progress: &dyn Progress,
) -> anyhow::Result<Outcome> {
    progress.expect(&[&[stages::READ_PLAN], stages::CALIBRATE].concat());
    let rows = read_force_log(log)?;
    let setup = SimulationSetup::read(plan, progress)?;
    progress.stage("mill along the log");
    let observations = observe(&setup, &rows)?;
    progress.stage("fit");
    let fit = calibrate(&observations, coefficients)
        .with_context(|| format!("{}: no calibration; `--coefficients` fits fewer", log.display()))?;
    Ok(Outcome::values("simulate", text(&fit), values(&fit)))
}

fn text(fit: &CoefficientFit) -> String {
    let line = |e: &bonemill_planner::calibrate::Estimate| {
        let (key, unit) = (e.coefficient.key(), e.coefficient.unit());
        format!("{key} = {:.5} ± {:.5} {unit} (95 %)\n", e.value, e.half_width)
    };
    let lines: String = fit.estimates.iter().map(line).collect();
    format!("{lines}the model leaves {:.4} N of a force component, over {} rows\n", fit.residual_n, fit.used)
}

fn values(fit: &CoefficientFit) -> serde_json::Value {
    let estimates: serde_json::Map<_, _> = fit
        .estimates
        .iter()
        .map(|e| {
            let value = json!({ "value": e.value, "half_width": e.half_width, "unit": e.coefficient.unit() });
            (e.coefficient.key().to_owned(), value)
        })
        .collect();
    json!({ "coefficients": estimates, "residual_n": fit.residual_n, "rows": fit.used })
}
