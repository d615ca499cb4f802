//! Writes a plan, a simulation and a verification as files, with their parts of `report.html`.

use std::path::{Path, PathBuf};

use bonemill_channel::ChannelPlan;
use bonemill_pipeline::Plan;
use bonemill_planfile::{
    PlanFileError, PlanRecord, REPORT, ReportPart, StagedDirectory, VERDICT, add_to_report, replace,
};
use bonemill_simulate::Simulation;
use bonemill_verify::Verification;
use bonemill_verify::uncertainty::{ErrorModel, Risk};

use crate::pages::report::{self, CtSlices};

/// Writes every file of `plan` into the staged directory; `case_path` is where its case was read from.
///
/// # Errors
/// As [`bonemill_pipeline::save`].
pub fn plan(
    plan: &Plan,
    case_path: &Path,
    staged: &StagedDirectory,
    ct_slices: CtSlices,
) -> Result<PlanRecord, PlanFileError> {
    let (record, page) = rayon::join(
        || bonemill_pipeline::save(plan, case_path, staged),
        || staged.write(REPORT, report::html(plan, ct_slices)),
    );
    page?;
    record
}

/// Writes every file of a planned channel into the staged directory; `case_path` is where its case was read from.
///
/// # Errors
/// As [`bonemill_channel::save`].
pub fn channel(
    plan: &ChannelPlan,
    case_path: &Path,
    staged: &StagedDirectory,
    ct_slices: CtSlices,
) -> Result<PlanRecord, PlanFileError> {
    staged.write(REPORT, crate::pages::channel::html(plan, ct_slices))?;
    bonemill_channel::save(plan, case_path, staged)
}

/// Writes a simulation into its plan's directory and replaces an existing one. If there is no report, none is made.
///
/// # Errors
/// [`PlanFileError`] for a value that is not finite, a structure that the case lacks, or a file that cannot be written.
pub fn simulation(
    dir: &Path,
    simulation: &Simulation,
    record: &PlanRecord,
) -> Result<PathBuf, PlanFileError> {
    let path = bonemill_simulate::save_rows(dir, simulation, &record.case)?;
    add_to_report(dir, ReportPart::Simulation, &report::simulation::section(simulation, record))?;
    Ok(path)
}

/// Writes a verification into its plan's directory and replaces an existing one; its part of the report also holds the risks
/// under drawn errors. If there is no report, none is made.
///
/// # Errors
/// [`PlanFileError::Io`]; existing files are then unchanged.
pub fn verification(
    dir: &Path,
    verification: &Verification,
    risk: Option<(&ErrorModel, &Risk)>,
) -> Result<PathBuf, PlanFileError> {
    replace(dir, VERDICT, verification.to_toml().as_bytes())?;
    add_to_report(dir, ReportPart::Verification, &report::verification::section(verification, risk))?;
    Ok(dir.join(VERDICT))
}
