//! The folder of a prosthesis.

use std::path::Path;

use bonemill_imaging::part::stl_bytes;
use bonemill_planfile::{PlanFileError, REPORT, StagedDirectory};

use crate::{JobRecord, ProsthesisError, ProsthesisPlan, record, report, toolpath_csv};

/// The part in the block's frame.
pub const PART: &str = "part.stl";
/// The moves.
pub const TOOLPATH: &str = "toolpath.csv";
/// The program.
pub const PROGRAM: &str = "program.nc";

/// The joints of an arm over time, where the job names one.
pub const TRAJECTORY: &str = "trajectory.csv";

/// Writes the plan's files into a staged folder; `job_path` is the job's file. What `job.toml` holds.
///
/// # Errors
/// [`ProsthesisError::Files`].
pub fn save(
    plan: &ProsthesisPlan,
    job_path: &Path,
    staged: &StagedDirectory,
) -> Result<JobRecord, ProsthesisError> {
    let record = record_of(plan, job_path, staged)?;
    staged.write(record::FILE_NAME, &record.to_toml()?)?;
    let part = staged.path().join(PART);
    std::fs::write(&part, stl_bytes(&plan.part)).map_err(PlanFileError::io("write", part))?;
    staged.write(TOOLPATH, toolpath_csv::text(&plan.machining.moves))?;
    staged.write(PROGRAM, &plan.program)?;
    if let Some(robot) = &plan.robot {
        let path = staged.path().join(TRAJECTORY);
        std::fs::write(&path, &robot.csv).map_err(PlanFileError::io("write", path))?;
    }
    staged.write(REPORT, report::html(plan, &record))?;
    Ok(record)
}

/// The record, with paths as seen from the finished folder.
fn record_of(
    plan: &ProsthesisPlan,
    job_path: &Path,
    staged: &StagedDirectory,
) -> Result<JobRecord, ProsthesisError> {
    use bonemill_case::prosthesis::BlockSource;
    let folder = job_path.parent().unwrap_or(Path::new(""));
    let mut job = plan.job.clone();
    job.part.file = staged.relative(&folder.join(&job.part.file))?;
    if let BlockSource::Catalogue(path) = &mut job.stock.source {
        *path = staged.relative(&folder.join(&*path))?;
    }
    Ok(JobRecord {
        job,
        version: env!("CARGO_PKG_VERSION").into(),
        part_sha256: plan.input.1,
        block_from_part: plan.block_from_part,
        block_id: plan.taken.mounted.id.clone(),
        block: plan.block,
        tab_boxes_mm: plan.machining.tab_boxes.clone(),
        metrics: plan.metrics.clone(),
        warnings: plan.warnings.clone(),
        shortfalls: plan.shortfalls.clone(),
        is_as_written: true,
    })
}
