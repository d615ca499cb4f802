//! `bonemill phantom`: a test body as images, labels and a case file.

use std::fs;
use std::path::Path;

use anyhow::Context;
use bonemill_imaging::phantom::{PhantomKind, phantom};
use bonemill_imaging::{write_ct_i16, write_labels_u8};
use bonemill_planner::Progress;
use bonemill_planner::plan::{Replace, StagedDirectory};

use crate::args::PhantomArgs;
use crate::outcome::Outcome;

/// The case's name among a phantom's files.
pub const CASE_FILE: &str = "case.toml";

pub fn run(args: &PhantomArgs, progress: &dyn Progress) -> anyhow::Result<Outcome> {
    let staged = StagedDirectory::create(&args.out, Replace::Nothing)?;
    write_into(staged.path(), args.kind, args.seed, progress)?;
    let out = staged.commit()?;
    let what = format!("{} phantom, seed {}; next: bonemill plan {CASE_FILE}", args.kind, args.seed);
    Ok(Outcome::written("phantom", &out, &what))
}

/// Writes the phantom's files into an existing folder.
pub fn write_into(dir: &Path, kind: PhantomKind, seed: u64, progress: &dyn Progress) -> anyhow::Result<()> {
    progress.stage("make phantom");
    let phantom = phantom(kind, seed);
    progress.stage("write phantom");
    write_ct_i16(dir.join("ct.nii.gz"), &phantom.ct)?;
    write_labels_u8(dir.join("labels.nii.gz"), &phantom.labels)?;
    let names: serde_json::Map<_, _> =
        phantom.label_names.iter().map(|(name, value)| (name.clone(), (*value).into())).collect();
    let names = serde_json::to_string_pretty(&names).context("cannot write the labels' names")? + "\n";
    for (name, text) in [("labels.json", names.as_str()), (CASE_FILE, phantom.case_toml.as_str())] {
        let path = dir.join(name);
        fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(())
}
