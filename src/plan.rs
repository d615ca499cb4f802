//! `bonemill plan`: plans a case file or a phantom and writes the plan's directory.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context;
use bonemill_geometry::Stage;
use bonemill_imaging::PHANTOM_CASE_FILE;
use bonemill_imaging::phantom::PhantomKind;
use bonemill_planner::Progress;
use bonemill_planner::case::{Case, with_values};
use bonemill_planner::pipeline::place;
use bonemill_planner::plan::{KEPT, Replace, StagedDirectory, relative_path};
use bonemill_planner::report::CtSlices;
use bonemill_planner::stages;

use crate::args::PlanArgs;
use crate::outcome::Outcome;
use crate::{phantom, planning};

/// Folder of the phantom's files in its plan.
const PHANTOM_DIR: &str = "phantom";

pub fn run(args: &PlanArgs, progress: &dyn Progress) -> anyhow::Result<Outcome> {
    // errors of the case are reported before errors of the output
    let given = args
        .case
        .as_deref()
        .map(|path| read_case(path).map(|case| (case, path.to_path_buf())))
        .transpose()?;
    let staged = StagedDirectory::create(&args.out, Replace::Plan)?;
    progress.expect(&expected_stages(args.phantom, given.as_ref().map(|(case, _)| case)));
    let (case, case_path) = match given {
        Some(given) => given,
        None => make_phantom(args, &staged, progress)?,
    };
    spare_inputs(&case, &case_path, &staged)?;
    let (case, case_path) = match &args.accuracy {
        Some(level) => at_level(level, &case, &case_path, &staged)?,
        None => (case, case_path),
    };
    // a phantom's files are in the plan anyway
    let pack = args.pack && args.phantom.is_none();
    let ct_slices = if args.no_slices { CtSlices::LeftOut } else { CtSlices::Shown };
    let planned = planning::plan_into(&case, &case_path, (pack, ct_slices), &staged, progress)?;
    let out = staged.commit()?;
    Ok(Outcome::planned(&out, planned))
}

/// The stages of planning a phantom or a case.
fn expected_stages(phantom: Option<PhantomKind>, case: Option<&Case>) -> Vec<Stage> {
    let is_channel = match phantom {
        Some(kind) => matches!(kind, PhantomKind::Tibia | PhantomKind::Glenoid),
        None => case.is_some_and(|case| case.job.channel().is_some()),
    };
    let drawn = if phantom.is_some() { stages::PHANTOM } else { &[] };
    let planned = if is_channel { stages::CHANNEL } else { stages::PLAN };
    [drawn, planned, &[stages::WRITE_FILES]].concat()
}

/// A case from its file.
pub fn read_case(path: &Path) -> anyhow::Result<Case> {
    let text =
        fs::read_to_string(path).with_context(|| format!("cannot read the case {}", path.display()))?;
    Ok(Case::parse(&text, path)?)
}

/// Writes the phantom into the plan, so that the plan's inputs can be found later.
fn make_phantom(
    args: &PlanArgs,
    staged: &StagedDirectory,
    progress: &dyn Progress,
) -> anyhow::Result<(Case, PathBuf)> {
    let kind = args.phantom.context("expected a case or a phantom")?;
    let dir = staged.path().join(PHANTOM_DIR);
    fs::create_dir(&dir).with_context(|| format!("cannot create {}", dir.display()))?;
    phantom::write_into(&dir, kind, args.seed, progress)?;
    let case_path = dir.join(PHANTOM_CASE_FILE);
    Ok((read_case(&case_path)?, case_path))
}

/// The case at a level of accuracy, as a file of the plan's own: what a plan was made from is a file.
fn at_level(
    level: &str,
    case: &Case,
    case_path: &Path,
    staged: &StagedDirectory,
) -> anyhow::Result<(Case, PathBuf)> {
    let text = fs::read_to_string(case_path)
        .with_context(|| format!("cannot read the case {}", case_path.display()))?;
    // what a level decides, it decides where nothing else is given
    let decided = ["grid.spacing_mm", "path.step_mm", "accuracy"].map(|key| (key.to_owned(), None));
    let mut values: Vec<(String, Option<String>)> = decided.into();
    values.push(("accuracy.level".into(), Some(format!("\"{level}\""))));
    // a series by its name, whatever the file says
    values.extend(
        case.images.ct_series.iter().map(|name| ("images.ct_series".into(), Some(format!("\"{name}\"")))),
    );
    let path = if case_path.starts_with(staged.path()) {
        case_path.to_owned()
    } else {
        let folder = staged.path().join(KEPT);
        fs::create_dir(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
        let home = case_path.parent().unwrap_or(Path::new(""));
        for (key, file) in case.files() {
            let named = relative_path(&folder, &home.join(file))?;
            values.push((key, Some(serde_json::Value::from(named.to_string_lossy()).to_string())));
        }
        folder.join(case_path.file_name().unwrap_or_default())
    };
    let text = with_values(&text, case_path, &values)?;
    fs::write(&path, &text).with_context(|| format!("cannot write {}", path.display()))?;
    Ok((Case::parse(&text, &path)?, path))
}

/// Refuses to replace a directory that contains the new plan's own inputs.
fn spare_inputs(case: &Case, case_path: &Path, staged: &StagedDirectory) -> anyhow::Result<()> {
    staged.relative(case_path)?;
    let folder = case_path.parent().unwrap_or(Path::new(""));
    // another file that is not there is told with its line when it is read
    let is_there = |(key, file): &(String, &Path)| key.starts_with("images.") || folder.join(file).exists();
    for (key, file) in case.files().into_iter().filter(is_there) {
        staged.relative(&folder.join(file)).with_context(|| place(case_path, &key))?;
    }
    Ok(())
}
