//! `bonemill experiment`: measurements by name.

use std::fs;
use std::path::Path;

use anyhow::Context;
use bonemill_experiments::{EXPERIMENTS, Size, Table};
use bonemill_planner::Progress;

use crate::args::ExperimentArgs;
use crate::outcome::Outcome;

pub fn run(args: &ExperimentArgs, progress: &dyn Progress) -> anyhow::Result<Outcome> {
    let Some(experiment) = EXPERIMENTS.iter().find(|e| e.name == args.name) else {
        let known: Vec<_> = EXPERIMENTS.iter().map(|e| format!("{} ({})", e.name, e.about)).collect();
        anyhow::bail!("no experiment is called \"{}\"; there are {}", args.name, known.join("; "));
    };
    let tables = (experiment.run)(Size { seeds: args.seeds, case: args.case.as_deref() }, progress)?;
    if let Some(dir) = &args.out {
        tables.iter().try_for_each(|table| write(dir, table))?;
    }
    let text: Vec<_> = tables.iter().map(Table::markdown).collect();
    let shortfalls = tables.iter().flat_map(|table| table.shortfalls.iter().cloned()).collect();
    Ok(Outcome::text("experiment", text.join("\n")).falling_short(shortfalls))
}

fn write(dir: &Path, table: &Table) -> anyhow::Result<()> {
    fs::create_dir_all(dir).with_context(|| format!("cannot make {}", dir.display()))?;
    let picture = table.picture.clone().map(|svg| ("svg", svg));
    for (ending, text) in [("md", table.markdown()), ("csv", table.csv())].into_iter().chain(picture) {
        let path = dir.join(&table.name).with_extension(ending);
        fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(())
}
