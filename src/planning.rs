//! Where the command hands a case to the planner and gets a filled directory back.

use std::path::Path;

use bonemill_planner::Progress;
use bonemill_planner::case::Case;
use bonemill_planner::plan::{PlanRecord, StagedDirectory};

/// Plans `case` and writes the plan's files into the staged directory.
pub fn plan_into(
    _case: &Case,
    case_path: &Path,
    _staged: &StagedDirectory,
    _progress: &dyn Progress,
) -> anyhow::Result<PlanRecord> {
    anyhow::bail!("{}: this build has no planner", case_path.display())
}
