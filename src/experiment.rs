//! `bonemill experiment`: measurements by name.

use std::path::Path;

use crate::args::ExperimentArgs;
use crate::outcome::Outcome;

/// An experiment's name and what runs it.
type Entry = (&'static str, fn(Option<&Path>) -> anyhow::Result<Outcome>);

/// Every experiment, by name.
const EXPERIMENTS: &[Entry] = &[];

pub fn run(args: &ExperimentArgs) -> anyhow::Result<Outcome> {
    match EXPERIMENTS.iter().find(|(name, _)| *name == args.name) {
        Some((_, experiment)) => experiment(args.out.as_deref()),
        None => anyhow::bail!("no experiment is called \"{}\"; there are {}", args.name, names()),
    }
}

fn names() -> String {
    let names: Vec<_> = EXPERIMENTS.iter().map(|(name, _)| *name).collect();
    if names.is_empty() { "none in this version".into() } else { names.join(", ") }
}
