//! Plans a case and fills a plan's directory.

use std::path::Path;

use bonemill_imaging::is_dicom;
use bonemill_planner::case::Case;
use bonemill_planner::pipeline::Refused;
use bonemill_planner::plan::{self, PlanRecord, StagedDirectory};
use bonemill_planner::report::CtSlices;
use bonemill_planner::report::images::{body_figures, image_figures};
use bonemill_planner::save;
use bonemill_planner::{Progress, Setup};
use serde_json::{Value, json};

/// What the command tells of a plan that was made.
pub struct Planned {
    /// The plan's record.
    pub record: PlanRecord,
    /// What it was made on, for machines.
    pub images: Value,
    /// How many copies in the plan have a DICOM header.
    pub headers: usize,
}

/// Plans `case` and writes the plan's files into the staged directory; with `pack`, also copies of its inputs.
pub fn plan_into(
    case: &Case,
    case_path: &Path,
    (pack, ct_slices): (bool, CtSlices),
    staged: &StagedDirectory,
    progress: &dyn Progress,
) -> anyhow::Result<Planned> {
    let packed =
        |setup: &Setup| pack.then(|| plan::pack_inputs(&setup.inputs, case_path, staged)).transpose();
    let planned = |record: PlanRecord, setup: &Setup| {
        let headers = setup.inputs.iter().filter(|(_, file)| pack && is_dicom(file)).count();
        Planned { record, images: images(setup), headers }
    };
    if let Some(channel) = case.job.channel() {
        let plan = bonemill_planner::channel::plan(case, channel, case_path, progress)
            .map_err(|e| Refused::new(e, case, case_path))?;
        progress.stage("write files");
        let copy = packed(&plan.setup)?;
        let record = save::channel(&plan, copy.as_deref().unwrap_or(case_path), staged, ct_slices)?;
        return Ok(planned(record, &plan.setup));
    }
    let plan =
        bonemill_planner::plan(case, case_path, progress).map_err(|e| Refused::new(e, case, case_path))?;
    plan.shortfalls.iter().for_each(|reason| progress.note(&format!("will fall short: {reason}")));
    progress.stage("write files");
    let copy = packed(&plan.setup)?;
    let record = save::plan(&plan, copy.as_deref().unwrap_or(case_path), staged, ct_slices)?;
    Ok(planned(record, &plan.setup))
}

/// CT, labels, target and structures, as the report shows them.
fn images(setup: &Setup) -> Value {
    let image = image_figures(setup).map(|image| {
        json!({
            "voxels": image.voxels, "voxel_mm": image.voxel_mm, "extent_mm": image.extent_mm,
            "axes": image.axes, "oblique_deg": image.oblique_deg,
        })
    });
    let [ct, labels] = image;
    let body = body_figures(setup).into_iter();
    let body = body
        .map(|body| json!({ "name": body.name, "volume_mm3": body.volume_mm3, "median_hu": body.median_hu }));
    json!({ "ct": ct, "labels": labels, "bodies": body.collect::<Vec<_>>() })
}
