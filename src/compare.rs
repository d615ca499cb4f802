//! `bonemill compare`: the comparison of two plans, as a table, a JSON object or a page.

use anyhow::Context;
use bonemill_planner::compare::Comparison;
use bonemill_planner::plan::{Need, StoredPlan};
use bonemill_planner::report::compare::page;

use crate::args::CompareArgs;
use crate::outcome::{self, Outcome};

pub fn run(args: &CompareArgs) -> anyhow::Result<Outcome> {
    // the plans' inputs are not needed
    let read = |dir| StoredPlan::load_with(dir, None, Need::Nothing);
    let plans = [read(&args.first)?, read(&args.second)?];
    let plans = plans.each_ref();
    let names = [&args.first, &args.second].map(|dir| dir.to_string_lossy());
    let names = names.each_ref().map(AsRef::as_ref);
    let comparison = Comparison::of(plans);
    if let Some(out) = &args.out {
        outcome::is_page(out)?;
        std::fs::write(out, page(&comparison, names, plans))
            .with_context(|| format!("cannot write {}", out.display()))?;
    }
    Ok(Outcome::compared(&comparison, names, args.all, args.out.as_deref()))
}
