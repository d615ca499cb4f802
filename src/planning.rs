//! Plans a case and fills a plan's directory.

use std::path::Path;

use bonemill_planner::Progress;
use bonemill_planner::case::Case;
use bonemill_planner::pipeline::Refused;
use bonemill_planner::plan::{self, PlanRecord, StagedDirectory};
use bonemill_planner::report::CtSlices;
use bonemill_planner::save;

/// Plans `case` and writes the plan's files into the staged directory; with `pack`, also copies of its inputs.
pub fn plan_into(
    case: &Case,
    case_path: &Path,
    (pack, ct_slices): (bool, CtSlices),
    staged: &StagedDirectory,
    progress: &dyn Progress,
) -> anyhow::Result<PlanRecord> {
    if let Some(channel) = case.job.channel() {
        let plan = bonemill_planner::channel::plan(case, channel, case_path, progress)
            .map_err(|e| Refused::new(e, case, case_path))?;
        progress.stage("write files");
        let packed = pack.then(|| plan::pack_inputs(&plan.setup.inputs, case_path, staged)).transpose()?;
        return Ok(save::channel(&plan, packed.as_deref().unwrap_or(case_path), staged, ct_slices)?);
    }
    let plan =
        bonemill_planner::plan(case, case_path, progress).map_err(|e| Refused::new(e, case, case_path))?;
    plan.shortfalls.iter().for_each(|reason| progress.note(&format!("will fall short: {reason}")));
    progress.stage("write files");
    let packed = pack.then(|| plan::pack_inputs(&plan.setup.inputs, case_path, staged)).transpose()?;
    Ok(save::plan(&plan, packed.as_deref().unwrap_or(case_path), staged, ct_slices)?)
}
