//! `bonemill report`: a streamed run beside its plan, as a page, a summary or an object.

use anyhow::Context;
use bonemill_planner::plan::{Need, StoredPlan};
use bonemill_planner::report::run::page;
use bonemill_planner::run::RunComparison;

use crate::args::ReportArgs;
use crate::outcome::{self, Outcome};

pub fn run(args: &ReportArgs) -> anyhow::Result<Outcome> {
    let dir = &args.plan;
    // what the plan was made from has no part in it
    let plan = StoredPlan::load_with(dir, None, Need::Nothing)?;
    let log =
        std::fs::read_to_string(&args.run).with_context(|| format!("cannot read {}", args.run.display()))?;
    let found = RunComparison::of(&plan, &log).with_context(|| {
        format!("{} cannot be compared with the plan in {}", args.run.display(), dir.display())
    })?;
    if let Some(out) = &args.out {
        outcome::is_page(out)?;
        std::fs::write(out, page(&found, &dir.to_string_lossy()))
            .with_context(|| format!("cannot write {}", out.display()))?;
    }
    Ok(Outcome::executed(&found, args.out.as_deref()))
}
