//! `bonemill phantom`: writes a test body as images, labels and a case file.

use std::path::{Path, PathBuf};

use bonemill_imaging::phantom::{PhantomKind, phantom};
use bonemill_imaging::{PHANTOM_CASE_FILE, write_phantom};
use bonemill_planner::Progress;
use bonemill_planner::plan::{Replace, StagedDirectory};
use bonemill_planner::stages::PHANTOM;

use crate::args::PhantomArgs;
use crate::outcome::Outcome;

pub fn run(args: &PhantomArgs, progress: &dyn Progress) -> anyhow::Result<Outcome> {
    let staged = StagedDirectory::create(&args.out, Replace::Nothing)?;
    progress.expect(PHANTOM);
    write_into(staged.path(), args.kind, args.seed, progress)?;
    let out = staged.commit()?;
    let case = shell_word(&out.join(PHANTOM_CASE_FILE));
    let plan = shell_word(&vacant_beside(&out));
    let what = format!("{} phantom, seed {}; next: bonemill plan {case} --out {plan}", args.kind, args.seed);
    Ok(Outcome::written("phantom", &out, &what))
}

/// A folder beside `dir` that is not there yet, named after it.
pub fn vacant_beside(dir: &Path) -> PathBuf {
    let name = dir.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let named =
        |n: u32| dir.with_file_name(if n == 1 { format!("{name}-plan") } else { format!("{name}-plan-{n}") });
    (1..1000).map(named).find(|path| !path.exists()).unwrap_or_else(|| named(1))
}

/// A path as one word of a POSIX shell.
pub fn shell_word(path: &Path) -> String {
    let text = path.to_string_lossy();
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "/._-+,:=@%".contains(c);
    if text.chars().all(is_plain) { text.into_owned() } else { format!("'{}'", text.replace('\'', r"'\''")) }
}

/// Writes the phantom's files into an existing folder.
pub fn write_into(dir: &Path, kind: PhantomKind, seed: u64, progress: &dyn Progress) -> anyhow::Result<()> {
    progress.stage("make phantom");
    let phantom = phantom(kind, seed);
    progress.stage("write phantom");
    Ok(write_phantom(dir, &phantom)?)
}
