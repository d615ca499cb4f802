//! The stages in their order.

use std::path::{Path, PathBuf};

use bonemill_case::prosthesis::{MachineKind, ProsthesisJob};
use bonemill_catalogue::Mounted;
use bonemill_geometry::{Block as BlockFrame, Mesh, Part, Progress, Rigid};
use bonemill_machining::{Block, Job, Machining, MachiningError, Warning};
use bonemill_part::orient::Laid;
use bonemill_part::{RepairLimits, Solid, read_facets, rounded};
use bonemill_planfile::{Sha256, Value};
use bonemill_proof::deviation::FARTHEST_MM;
use bonemill_proof::{Proof, ProofJob};

use crate::block::{self, TakenBlock};
use crate::{MOST_GOUGE_MM, Placing, ProsthesisError, RobotMotion, robot, settings};

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

/// Plans a prosthesis; `job_path` is the job's file, to whose folder the job's paths are relative.
///
/// # Errors
/// [`ProsthesisError`] where there is no part, no block or no toolpath. What falls short of the job is no error but
/// [`ProsthesisPlan::shortfalls`].
pub fn plan(
    job: &ProsthesisJob,
    job_path: &Path,
    progress: &dyn Progress,
) -> Result<ProsthesisPlan, ProsthesisError> {
    let folder = job_path.parent().unwrap_or(Path::new(""));
    progress.stage("read part");
    let (solid, sha256) = read_part(job, folder)?;
    progress.stage("lay part");
    let placing = Placing::of(&solid.mesh, job.orient, |laid| time_s(job, &solid, laid));
    progress.stage("take block");
    let taken = block::take(job, folder, &placing.chosen.size_mm)?;
    let block = block::around(job, &taken.mounted, &placing.chosen.size_mm);
    let machining_job = settings::machining(job, block);
    let mill = Mill { job, solid: &solid, machining_job: &machining_job, block: &taken.mounted.id, progress };
    let mut milled = mill.at(&placing.chosen)?;
    if milled.proof.thickest_uncut_mm > job.process.finishing_step_mm {
        let mut moved = placing.chosen.clone();
        let shift_mm =
            bonemill_machining::shift_to_reach_mm(&milled.part, &machining_job, job.stock.gap_mm[1]);
        moved.block_from_part.translation_mm.y += shift_mm;
        // the better of the two by what the proof finds
        if shift_mm != 0.0
            && let Ok(other) = mill.at(&moved)
            && other.proof.thickest_uncut_mm < milled.proof.thickest_uncut_mm
        {
            milled = other;
        }
    }
    let Milled { block_from_part, part, machining, program, proof_job, proof } = milled;
    let (robot, stuck) = match job.machine.kind {
        MachineKind::FiveAxis => (None, None),
        MachineKind::Ur(model) => {
            progress.stage("move arm");
            match robot::motion(model, job.machine.on_flange, &block, &machining.moves)
                .map_err(|source| mill.failed(source))?
            {
                Ok(motion) => (Some(motion), None),
                Err(reason) => (None, Some(reason)),
            }
        }
    };
    let mut plan = ProsthesisPlan {
        job: job.clone(),
        input: (job.part.file.clone(), sha256),
        solid,
        placing,
        block_from_part,
        part,
        taken,
        block,
        machining,
        robot,
        program,
        proof_job,
        proof,
        metrics: Vec::new(),
        warnings: Vec::new(),
        shortfalls: stuck.into_iter().collect(),
    };
    plan.judge(&machining_job);
    plan.measure();
    Ok(plan)
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
    machining_job: &'a Job,
    block: &'a str,
    progress: &'a dyn Progress,
}

impl Mill<'_> {
    /// Toolpath, program and proof of the part laid like this.
    fn at(&self, laid: &Laid) -> Result<Milled, ProsthesisError> {
        let Self { job, machining_job, progress, .. } = *self;
        progress.stage("plan toolpath");
        let part = laid_part(self.solid, laid);
        let machining = bonemill_machining::plan(&part, machining_job).map_err(|e| self.failed(e))?;
        progress.stage("write program");
        let program = bonemill_program::write(&machining.moves, job.process.spindle_rpm);
        progress.stage("prove program");
        let proof_job = settings::proof(job, &machining_job.block, machining.tab_box);
        let proof = bonemill_proof::prove(&program, &part, &proof_job)?;
        Ok(Milled { block_from_part: laid.block_from_part, part, machining, program, proof_job, proof })
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
fn laid_part(solid: &Solid, laid: &Laid) -> Mesh<BlockFrame> {
    rounded(&solid.mesh.transformed(&laid.block_from_part))
}

/// How long an orientation takes to machine in a block cut to size, s; `None` where it cannot be machined.
fn time_s(job: &ProsthesisJob, solid: &Solid, laid: &Laid) -> Option<f64> {
    let trial = Trial::new(job, solid, laid);
    Some(bonemill_machining::plan(&trial.part, &trial.machining).ok()?.times.limited_s)
}

/// A part in an orientation, in a block that is cut to what it needs: for comparisons, whatever is in stock.
#[derive(Debug, Clone)]
pub struct Trial {
    /// The part in the block's frame.
    pub part: Mesh<BlockFrame>,
    /// The job for the toolpath.
    pub machining: Job,
}

impl Trial {
    /// The part laid like this.
    pub fn new(job: &ProsthesisJob, solid: &Solid, laid: &Laid) -> Self {
        let size_mm = block::needed_mm(job, &laid.size_mm);
        let block = block::around(job, &Mounted { id: String::new(), size_mm }, &laid.size_mm);
        Self { part: laid_part(solid, laid), machining: settings::machining(job, block) }
    }

    /// The job for the proof of a toolpath of it.
    pub fn proof_job(&self, job: &ProsthesisJob, machining: &Machining) -> ProofJob {
        settings::proof(job, &self.machining.block, machining.tab_box)
    }
}

impl ProsthesisPlan {
    /// Keeps the block out of the stock. What falls short is not milled as it is: its block goes back with the plan.
    pub fn keep_block(&self) {
        if self.shortfalls.is_empty() {
            self.taken.keep();
        }
    }

    /// What the user should know, and where the plan falls short.
    fn judge(&mut self, job: &Job) {
        self.warnings
            .extend(self.solid.changes.iter().map(|change| format!("the mesh was repaired: {change}")));
        if self.solid.shallow_crossings > 0 {
            let tolerance_mm = bonemill_part::CROSSING_TOLERANCE_MM;
            let pairs = self.solid.shallow_crossings;
            self.warnings
                .push(format!("{pairs} pairs of facets touch or cross by at most {tolerance_mm} mm"));
        }
        let is_arm = self.job.machine.kind != MachineKind::FiveAxis;
        if let (Some(robot), Some(most_min)) = (&self.robot, self.job.machine.max_time_min)
            && robot.duration_s > 60.0 * most_min
        {
            let takes_min = robot.duration_s / 60.0;
            self.shortfalls
                .push(format!("the arm takes {takes_min:.1} min, but there are {most_min:.1} min"));
        }
        for warning in &self.machining.warnings {
            match warning {
                // an arm has its own reach and its own time
                Warning::Travel { .. } | Warning::Rotary { .. } | Warning::Time { .. } if is_arm => {}
                Warning::Travel { .. } | Warning::Rotary { .. } | Warning::Time { .. } => {
                    self.shortfalls.push(warning.to_string())
                }
                Warning::Feed { .. } | Warning::Strip { .. } => self.warnings.push(warning.to_string()),
            }
        }
        // the proof says whether stock stays, the planner's places say why
        if self.proof.thickest_uncut_mm <= most_uncut_mm(job.process.finishing_step_mm) {
            self.machining.left.clear();
        }
        for left in &self.machining.left {
            let p = left.at_mm;
            self.warnings.push(format!(
                "stock of {:.2} mm³, up to {:.2} mm thick, stays at ({:.1}, {:.1}, {:.1}) mm: {}",
                left.volume_mm3,
                left.deepest_mm,
                p.x,
                p.y,
                p.z,
                reason(left.reason)
            ));
        }
        self.shortfalls.extend(shortfalls(&self.proof, &self.proof_job, job.process.finishing_step_mm));
    }

    /// The figures of `[result.metrics]`.
    fn measure(&mut self) {
        let (times, strip, proof) = (&self.machining.times, &self.machining.strip, &self.proof);
        let residual = |laid: &Laid| {
            let r = laid.residual;
            Value::List([r.xy_mm2, r.xz_mm2, r.yz_mm2].map(Value::from).to_vec())
        };
        let mut metrics: Vec<(String, Value)> = vec![
            ("facets".into(), self.part.triangles.len().into()),
            ("volume_mm3".into(), self.solid.mesh.volume_mm3().into()),
            ("size_mm".into(), list(self.placing.chosen.size_mm.as_slice())),
            ("residual_given_xy_xz_yz_mm2".into(), residual(&self.placing.given)),
        ];
        if let Some(run) = self.placing.runs.last() {
            metrics.push(("published_runs".into(), self.placing.runs.len().into()));
            metrics.push(("residual_published_xy_xz_yz_mm2".into(), residual(&run.laid)));
        }
        let block_mm3: f64 = self.taken.mounted.size_mm.iter().product();
        let cuts = self.machining.moves.iter().filter(|m| m.kind.cuts()).count();
        metrics.extend([
            ("residual_xy_xz_yz_mm2".into(), residual(&self.placing.chosen)),
            ("block_mm3".into(), block_mm3.into()),
            ("moves".into(), self.machining.moves.len().into()),
            ("cuts".into(), cuts.into()),
            ("constant_speed_time_s".into(), times.constant_s.into()),
            ("total_time_s".into(), times.limited_s.into()),
            ("cutting_time_s".into(), times.cutting_s.into()),
            ("strip_mm".into(), strip.thickness_mm.into()),
            ("cutting_force_n".into(), strip.force_n.into()),
            ("strip_strength_over_force".into(), strip.strip_factor.into()),
            ("tab_mm".into(), strip.tab_mm.into()),
            ("tab_strength_over_force".into(), strip.tab_factor.into()),
            ("left_mm3".into(), self.machining.left_mm3().into()),
            ("deepest_gouge_mm".into(), proof.deepest_gouge_mm.into()),
            ("thickest_uncut_mm".into(), proof.thickest_uncut_mm.into()),
            ("uncut_mm3".into(), proof.uncut_mm3.into()),
            ("collisions".into(), proof.collisions.len().into()),
            ("loose_mm3".into(), proof.loose_mm3().into()),
            ("widest_cut_mm".into(), proof.widest_mm.into()),
            ("cuts_too_wide".into(), proof.too_wide.len().into()),
        ]);
        if let Some(robot) = &self.robot {
            metrics.push(("robot_time_s".into(), robot.duration_s.into()));
        }
        self.metrics = metrics;
    }
}

/// Thickest stock that a program may leave for a finishing step, mm.
pub fn most_uncut_mm(finishing_step_mm: f64) -> f64 {
    finishing_step_mm + UNCUT_TOLERANCE_MM
}

/// Why a program falls short by what it leaves.
pub(crate) fn shortfalls(proof: &Proof, job: &ProofJob, finishing_step_mm: f64) -> Vec<String> {
    let mut found = Vec::new();
    if proof.deepest_gouge_mm > MOST_GOUGE_MM {
        let p = proof.gouge_at_mm;
        let (x, y, z) = (p.x, p.y, p.z);
        let deepest_mm = proof.deepest_gouge_mm;
        found.push(format!(
            "the part is cut {deepest_mm:.4} mm deep at ({x:.2}, {y:.2}, {z:.2}) mm; at most {MOST_GOUGE_MM} mm"
        ));
    }
    let most_mm = most_uncut_mm(finishing_step_mm);
    if proof.thickest_uncut_mm > most_mm {
        for place in proof.uncut(most_mm, job) {
            let p = place.at_mm;
            // the proof looks no farther
            let stock = if place.thickest_mm < FARTHEST_MM {
                format!("up to {:.3} mm", place.thickest_mm)
            } else {
                format!("{FARTHEST_MM} mm or more")
            };
            found.push(format!(
                "stock of {stock} is left on {:.2} mm² of the part at ({:.1}, {:.1}, {:.1}) mm; at most {most_mm:.3} mm",
                place.area_mm2, p.x, p.y, p.z
            ));
        }
    }
    if let Some(first) = proof.collisions.first() {
        let (count, line, depth_mm) = (proof.collisions.len(), first.line, first.depth_mm);
        found.push(format!(
            "{count} motions meet the stock with what must not, the first in line {line} by {depth_mm:.3} mm ({:?})",
            first.struck
        ));
    }
    if let Some(first) = proof.loose.first() {
        let (p, volume_mm3) = (first.at_mm, proof.loose_mm3());
        found.push(format!(
            "{} pieces of {volume_mm3:.1} mm³ come loose before the end, the first in line {} with {:.1} mm³ at ({:.1}, {:.1}, {:.1}) mm",
            proof.loose.len(),
            first.line,
            first.volume_mm3,
            p.x,
            p.y,
            p.z
        ));
    }
    if let Some(first) = proof.too_wide.first() {
        found.push(format!(
            "{} cuts are wider than {:.3} mm, the first in line {} with {:.3} mm over {:.2} mm",
            proof.too_wide.len(),
            job.widest_mm,
            first.line,
            first.width_mm,
            first.length_mm
        ));
    }
    found
}

fn reason(reason: bonemill_machining::leftover::Reason) -> &'static str {
    use bonemill_machining::leftover::Reason;
    match reason {
        Reason::Hidden => "the part covers it on both sides",
        Reason::Narrow => "the cutter is too wide for the place",
        Reason::Deep => "the holder would meet the block",
    }
}

pub(crate) fn list(numbers: &[f64]) -> Value {
    Value::List(numbers.iter().map(|&n| n.into()).collect())
}
