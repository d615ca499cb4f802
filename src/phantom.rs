//! `bonemill phantom`: writes a test body as images, labels and a case file.

use std::path::Path;

use bonemill_imaging::phantom::{PhantomKind, phantom};
use bonemill_imaging::{PHANTOM_CASE_FILE, write_phantom};
use bonemill_planner::Progress;
use bonemill_planner::plan::{Replace, StagedDirectory};

use crate::args::PhantomArgs;
use crate::outcome::Outcome;

pub fn run(args: &PhantomArgs, progress: &dyn Progress) -> anyhow::Result<Outcome> {
    let staged = StagedDirectory::create(&args.out, Replace::Nothing)?;
    write_into(staged.path(), args.kind, args.seed, progress)?;
    let out = staged.commit()?;
    let what = format!("{} phantom, seed {}; next: bonemill plan {PHANTOM_CASE_FILE}", args.kind, args.seed);
    Ok(Outcome::written("phantom", &out, &what))
}

/// Writes the phantom's files into an existing folder.
pub fn write_into(dir: &Path, kind: PhantomKind, seed: u64, progress: &dyn Progress) -> anyhow::Result<()> {
    progress.stage("make phantom");
    let phantom = phantom(kind, seed);
    progress.stage("write phantom");
    Ok(write_phantom(dir, &phantom)?)
}
