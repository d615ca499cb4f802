//! A plan's files but for its report, written into a staged directory.

use std::path::Path;

use bonemill_planfile::{NOTES, PlanContents, PlanFileError, PlanRecord, StagedDirectory};
use bonemill_setup::armpath::write_trajectory;

use crate::access_csv::{access_csv, dropped_csv};
use crate::{Plan, record};

/// Writes the files of `plan`, but for its report, into the staged directory; `case_path` is where its case was read from.
///
/// # Errors
/// [`PlanFileError`] when a file cannot be written or a figure is not finite; the caller drops the staged directory.
pub fn save(plan: &Plan, case_path: &Path, staged: &StagedDirectory) -> Result<PlanRecord, PlanFileError> {
    let record = record(plan, staged.relative(case_path)?);
    let (setup, moves) = (&plan.setup, &plan.moves);
    let [access, dropped, ..] = NOTES;
    let contents = PlanContents {
        record: &record,
        waypoints: &moves.waypoints,
        forces: &moves.forces,
        arm: &setup.arm,
        notes: &[
            (access, access_csv(&plan.access.allowed)),
            (dropped, dropped_csv(&plan.access.dropped, &setup.scene)),
        ],
    };
    contents.write(case_path, staged, |file| {
        write_trajectory(&moves.law, &setup.arm, setup.case.robot.rate_hz, file)
    })?;
    Ok(record)
}
