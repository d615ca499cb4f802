//! The stages in their order.

use std::path::{Path, PathBuf};

use crate::catalogue::Mounted;
use crate::machining::{Block, Machining, MachiningError, MachiningJob, TipMove};
use crate::orient::Laid;
use crate::proof::{Proof, ProofJob};
use bonemill_case::prosthesis::{MachineKind, ProsthesisJob};
use bonemill_geometry::{Block as BlockFrame, Mesh, Part, Progress, Rigid};
use bonemill_imaging::part::{RepairLimits, Solid, read_facets, rounded};
use bonemill_planfile::{Sha256, Value};

use crate::block::{self, TakenBlock};
use crate::{Placing, ProsthesisError, RobotMotion, figures, record, robot, settings, toolpath_csv};

/// What finishing may leave beyond the step that was asked for, mm: chords, rounding and the samples of the proof.
const UNCUT_TOLERANCE_MM: f64 = 0.02;

/// Everything about a prosthesis that was planned.
#[derive(Debug)]
pub struct ProsthesisPlan {
    /// The job.
    pub job: ProsthesisJob,
    /// The part's file, relative to the job's folder, and its digest.
    pub input: (PathBuf, Sha256),
    /// The part as it was read, checked and repaired.
    pub solid: Solid,
    /// How it lies.
    pub placing: Placing,
    /// Where the part lies in the block's frame: as chosen, along y perhaps out of the middle.
    pub block_from_part: Rigid<BlockFrame, Part>,
    /// The part in the block's frame, in single precision as part.stl has it.
    pub part: Mesh<BlockFrame>,
    /// The block.
    pub taken: TakenBlock,
    /// Where the block lies.
    pub block: Block,
    /// The toolpath.
    pub machining: Machining,
    /// The same moves by an arm, for a job that names one that can follow them.
    pub robot: Option<RobotMotion>,
    /// The program.
    pub program: String,
    /// What the program was judged with.
    pub proof_job: ProofJob,
    /// What it leaves.
    pub proof: Proof,
    /// Figures by name, in the order of the file; names end in units.
    pub metrics: Vec<(String, Value)>,
    /// What the user should know.
    pub warnings: Vec<String>,
    /// Why the plan falls short; empty when it does not.
    pub shortfalls: Vec<String>,
}

/// Plans a prosthesis; `job_path` is the job's file, to whose folder the job's paths are relative. `replaces`: the block of the plan that this one
/// replaces, which is out of the catalogue ([`JobRecord::holds`](crate::JobRecord::holds)).
///
/// # Errors
/// [`ProsthesisError`] where there is no part, no block or no toolpath. What falls short of the job is no error but
/// [`ProsthesisPlan::shortfalls`].
pub fn plan(
    job: &ProsthesisJob,
    job_path: &Path,
    replaces: Option<&str>,
    progress: &dyn Progress,
) -> Result<ProsthesisPlan, ProsthesisError> {
    let folder = job_path.parent().unwrap_or(Path::new(""));
    progress.stage("read part");
    let (solid, sha256) = read_part(job, folder)?;
    progress.stage("lay part");
    let placing = Placing::of(&solid.mesh, job.orient, |laid| time_s(job, &solid, laid));
    progress.stage("take block");
    let taken = block::take(job, folder, &placing.chosen.size_mm, replaces)?;
    let block = block::around(job, &taken.mounted, &placing.chosen.size_mm);
    let machining_job = settings::machining(job, block);
    let mill = Mill { job, solid: &solid, machining_job: &machining_job, block: &taken.mounted.id, progress };
    let mut milled = mill.at(&placing.chosen)?;
    if milled.proof.thickest_uncut_mm > job.process.finishing_step_mm {
        let mut moved = placing.chosen.clone();
        let shift_mm = crate::machining::shift_to_reach_mm(&milled.part, &machining_job, job.stock.gap_mm[1]);
        moved.block_from_part.translation_mm.y += shift_mm;
        // the better of the two by what the proof finds
        if shift_mm != 0.0
            && let Ok(other) = mill.at(&moved)
            && other.proof.thickest_uncut_mm < milled.proof.thickest_uncut_mm
        {
            milled = other;
        }
    }
    let robot = match job.machine.kind {
        MachineKind::FiveAxis => None,
        MachineKind::Ur(model) => {
            progress.stage("move arm");
            let moves = &milled.machining.moves;
            let motion = robot::motion(model, job.machine.on_flange, &block, moves);
            Some(motion.map_err(|source| mill.failed(source))?)
        }
    };
    let told_of = figures::Milled {
        job,
        solid: &solid,
        given: &placing.given,
        runs: &placing.runs,
        chosen: &placing.chosen,
        block: &block,
        machining_job: &machining_job,
        machining: &milled.machining,
        outline_line: figures::outline_line(&milled.program),
        proof_job: &milled.proof_job,
        proof: &milled.proof,
        robot: robot.as_ref(),
    };
    let (told, left) = (told_of.told(), told_of.left().to_vec());
    // the reason takes the place of the first line's words: all other lines stay where they are
    let program = mill.program(&milled.machining.moves, &told.shortfalls);
    let Milled { block_from_part, part, machining, proof_job, proof, .. } = milled;
    let machining = Machining { left, ..machining };
    Ok(ProsthesisPlan {
        job: job.clone(),
        input: (job.part.file.clone(), sha256),
        solid,
        placing,
        block_from_part,
        part,
        taken,
        block,
        machining,
        robot: robot.and_then(Result::ok),
        program,
        proof_job,
        proof,
        metrics: told.metrics,
        warnings: told.warnings,
        shortfalls: told.shortfalls,
    })
}

/// A part at a place in its block, and what comes of it.
struct Milled {
    block_from_part: Rigid<BlockFrame, Part>,
    part: Mesh<BlockFrame>,
    machining: Machining,
    program: String,
    proof_job: ProofJob,
    proof: Proof,
}

/// What mills a part, wherever it lies in its block.
struct Mill<'a> {
    job: &'a ProsthesisJob,
    solid: &'a Solid,
    machining_job: &'a MachiningJob,
    block: &'a str,
    progress: &'a dyn Progress,
}

impl Mill<'_> {
    /// Toolpath, program and proof of the part laid like this.
    fn at(&self, laid: &Laid) -> Result<Milled, ProsthesisError> {
        let Self { job, machining_job, progress, .. } = *self;
        progress.stage("plan toolpath");
        let part = laid_part(self.solid, &laid.block_from_part);
        let machining = crate::machining::plan(&part, machining_job).map_err(|e| self.failed(e))?;
        progress.stage("write program");
        let program = self.program(&machining.moves, &[]);
        progress.stage("prove program");
        let proof_job = settings::proof(job, &machining_job.block, &machining.tab_boxes);
        let proof = crate::proof::prove(&program, &part, &proof_job)?;
        Ok(Milled { block_from_part: laid.block_from_part, part, machining, program, proof_job, proof })
    }

    fn program(&self, moves: &[TipMove], shortfalls: &[String]) -> String {
        let version = env!("CARGO_PKG_VERSION");
        let made_for = record::made_for(self.job, self.block, version, &toolpath_csv::text(moves));
        crate::program::write(moves, self.machining_job, &made_for, shortfalls)
    }

    fn failed(&self, source: MachiningError) -> ProsthesisError {
        ProsthesisError::Machining { block: self.block.to_owned(), source: Box::new(source) }
    }
}

/// The job's part, checked and repaired, and its file's digest; `folder` is the job's.
///
/// # Errors
/// [`ProsthesisError::Part`], [`ProsthesisError::Files`].
pub fn read_part(job: &ProsthesisJob, folder: &Path) -> Result<(Solid, Sha256), ProsthesisError> {
    let path = folder.join(&job.part.file);
    let unit = job.part.unit.and_then(|word| word.parse().ok());
    let solid =
        read_facets(&path).and_then(|facets| Solid::from_facets(facets, unit, &RepairLimits::default()));
    let solid = solid.map_err(|source| ProsthesisError::Part { path: path.clone(), source })?;
    Ok((solid, Sha256::of_file(&path)?))
}

/// The part in the block's frame, rounded as its file will be.
pub(crate) fn laid_part(solid: &Solid, block_from_part: &Rigid<BlockFrame, Part>) -> Mesh<BlockFrame> {
    rounded(&solid.mesh.transformed(block_from_part))
}

/// How long an orientation takes to machine in a block cut to size, s; `None` where it cannot be machined.
fn time_s(job: &ProsthesisJob, solid: &Solid, laid: &Laid) -> Option<f64> {
    let trial = Trial::new(job, solid, laid);
    Some(crate::machining::plan(&trial.part, &trial.machining).ok()?.times.limited_s)
}

/// A part in an orientation, in a block that is cut to what it needs: for comparisons, whatever is in stock.
#[derive(Debug, Clone)]
pub struct Trial {
    /// The part in the block's frame.
    pub part: Mesh<BlockFrame>,
    /// The job for the toolpath.
    pub machining: MachiningJob,
}

impl Trial {
    /// The part laid like this.
    pub fn new(job: &ProsthesisJob, solid: &Solid, laid: &Laid) -> Self {
        let size_mm = block::needed_mm(job, &laid.size_mm);
        let block = block::around(job, &Mounted { id: String::new(), size_mm }, &laid.size_mm);
        Self { part: laid_part(solid, &laid.block_from_part), machining: settings::machining(job, block) }
    }

    /// The job for the proof of a toolpath of it.
    pub fn proof_job(&self, job: &ProsthesisJob, machining: &Machining) -> ProofJob {
        settings::proof(job, &self.machining.block, &machining.tab_boxes)
    }
}

impl ProsthesisPlan {
    /// Keeps the block out of the stock. What falls short is not milled as it is: its block goes back with the plan.
    ///
    /// # Errors
    /// [`ProsthesisError::Catalogue`].
    pub fn keep_block(&self) -> Result<(), ProsthesisError> {
        if self.shortfalls.is_empty() { self.taken.keep() } else { Ok(()) }
    }
}

/// Thickest stock that a program may leave for a finishing step, mm.
pub fn most_uncut_mm(finishing_step_mm: f64) -> f64 {
    finishing_step_mm + UNCUT_TOLERANCE_MM
}
