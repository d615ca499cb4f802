//! Runs an experiment by its name: gives its tables as text, and as files if a folder is given.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use bonemill_planner::Progress;

use crate::{EXPERIMENTS, ExperimentError, Size, Table};

/// The experiment to run, and its options.
#[derive(Debug, clap::Args)]
pub struct ExperimentArgs {
    /// Name of the experiment; an unknown name lists all
    pub name: String,
    /// Bodies of each kind: seeds 1 to N
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u64).range(1..=1000))]
    pub seeds: u64,
    /// First seed, for `agree`, `agree-channels` and `agree-prostheses`
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    pub first: u64,
    /// Your own case file in addition to the bodies, for `pareto`
    #[arg(long, value_name = "FILE")]
    pub case: Option<PathBuf>,
    /// Checkout of Universal Robots' ROS 2 description, for `link-capsules`
    #[arg(long, value_name = "DIR")]
    pub meshes: Option<PathBuf>,
    /// Folder for tables, as Markdown and CSV, and pictures, as SVG
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

/// Result of an experiment: its tables as Markdown, and its shortfalls.
pub struct ExperimentOutput {
    /// For a terminal.
    pub text: String,
    /// What was not as expected; empty otherwise.
    pub shortfalls: Vec<String>,
}

/// Runs an experiment.
///
/// # Errors
/// [`ExperimentError`]: an unknown name, a file that cannot be written, and errors of the experiment itself.
pub fn run(args: &ExperimentArgs, progress: &dyn Progress) -> Result<ExperimentOutput, ExperimentError> {
    let Some(experiment) = EXPERIMENTS.iter().find(|e| e.name == args.name) else {
        let known: Vec<_> = EXPERIMENTS.iter().map(|e| format!("{} ({})", e.name, e.about)).collect();
        return Err(ExperimentError::Unknown { name: args.name.clone(), known: known.join("; ") });
    };
    let tables = (experiment.run)(
        Size {
            seeds: args.seeds,
            first: args.first,
            case: args.case.as_deref(),
            meshes: args.meshes.as_deref(),
        },
        progress,
    )?;
    if let Some(dir) = &args.out {
        tables.iter().try_for_each(|table| write(dir, table))?;
    }
    let text: Vec<_> = tables.iter().map(Table::markdown).collect();
    let shortfalls = tables.iter().flat_map(|table| table.shortfalls.iter().cloned()).collect();
    Ok(ExperimentOutput { text: text.join("\n"), shortfalls })
}

fn write(dir: &Path, table: &Table) -> Result<(), ExperimentError> {
    let failed = |path: &Path| {
        let path = path.to_owned();
        move |source: io::Error| ExperimentError::Write { path, source }
    };
    fs::create_dir_all(dir).map_err(failed(dir))?;
    let picture = table.picture.clone().map(|svg| ("svg", svg));
    for (ending, text) in [("md", table.markdown()), ("csv", table.csv())].into_iter().chain(picture) {
        let path = dir.join(&table.name).with_extension(ending);
        fs::write(&path, text).map_err(failed(&path))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_unknown_experiment_lists_those_there_are() {
        let args = ExperimentArgs {
            name: "nonsense".into(),
            seeds: 1,
            first: 1,
            case: None,
            meshes: None,
            out: None,
        };
        let Err(error) = run(&args, &()) else { panic!("it ran") };
        let text = error.to_string();
        assert!(text.contains("no experiment is called \"nonsense\"; there are "), "{text}");
        assert!(EXPERIMENTS.iter().all(|e| text.contains(e.name)));
    }
}
