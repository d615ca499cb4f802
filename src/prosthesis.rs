//! `bonemill prosthesis`: a job file, or a drawn prosthesis, to a folder with part, toolpath, program and report.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context;
use bonemill_planner::Progress;
use bonemill_planner::case::prosthesis::ProsthesisJob;
use bonemill_planner::part::phantom::Operculum;
use bonemill_planner::plan::{Replace, StagedDirectory, replace};
use bonemill_planner::stages::WRITE_FILES;
use bonemill_prosthesis::{JobRecord, phantom, plan, save, verify};

use crate::args::ProsthesisArgs;
use crate::outcome::Outcome;

/// Where a drawn prosthesis lies in the folder that was made of it.
const PHANTOM_DIR: &str = "phantom";

pub fn run(args: &ProsthesisArgs, progress: &dyn Progress) -> anyhow::Result<Outcome> {
    // a job that cannot be read is told before anything about the output
    let given = args.job.as_deref().map(|path| Ok::<_, anyhow::Error>((read_job(path)?, path.to_path_buf())));
    let given = given.transpose()?;
    let staged = StagedDirectory::create(&args.out, Replace::Prosthesis)?;
    progress.expect(&[bonemill_prosthesis::STAGES, &[WRITE_FILES]].concat());
    let (job, job_path) = match given {
        Some(given) => given,
        None => draw(args.seed, &staged)?,
    };
    let part = job_path.parent().unwrap_or(Path::new("")).join(&job.part.file);
    staged.relative(&part).with_context(|| format!("{}: `part.stl` is no file", job_path.display()))?;
    // what stands in the folder is replaced, and its block with it
    let before = JobRecord::read(&args.out).ok();
    let replaces = before.as_ref().and_then(|before| before.holds(&args.out, &job, &job_path));
    let plan = plan(&job, &job_path, replaces, progress)?;
    progress.stage("write files");
    let record = save(&plan, &job_path, &staged)?;
    let out = staged.commit()?;
    plan.keep_block()?;
    Ok(Outcome::made(&out, &record))
}

fn read_job(path: &Path) -> anyhow::Result<ProsthesisJob> {
    let text = fs::read_to_string(path).with_context(|| format!("cannot read the job {}", path.display()))?;
    Ok(ProsthesisJob::parse(&text, path)?)
}

/// Writes a drawn prosthesis into the folder, so that its inputs can be found again.
fn draw(seed: u64, staged: &StagedDirectory) -> anyhow::Result<(ProsthesisJob, PathBuf)> {
    let dir = staged.path().join(PHANTOM_DIR);
    fs::create_dir(&dir).with_context(|| format!("cannot create {}", dir.display()))?;
    let job_path = phantom::write(&dir, &Operculum::drawn(seed), phantom::FACETS)?;
    Ok((read_job(&job_path)?, job_path))
}

/// `bonemill verify` of such a folder.
pub fn verify_folder(dir: &Path, all: bool, progress: &dyn Progress) -> anyhow::Result<Outcome> {
    progress.expect(bonemill_prosthesis::VERIFY_STAGES);
    let failed = || format!("the prosthesis in {} cannot be verified", dir.display());
    let verdict = match verify::verify(dir, progress) {
        Ok(verdict) => verdict,
        // a verdict on what stood here before would be read as one on this
        Err(error) => {
            let _ = fs::remove_file(dir.join("verification.toml"));
            return Err(error).with_context(failed);
        }
    };
    replace(dir, "verification.toml", verdict.to_toml().as_bytes())?;
    Ok(Outcome::judged(&dir.join("verification.toml"), &verdict, all))
}
