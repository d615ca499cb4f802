//! Replays a finished plan: forward kinematics of the joint trajectory gives burr and shank, which move through the bone.
//!
//! If the case has joint stiffnesses, the arm deflects, and the burr cuts at its deflected position. The deflection tends to
//! C·F, with F at the commanded speed. Because F decreases with the speed at which the burr gives way, the time constant is
//! |C F|/|v| (backward Euler of d = C F(v + ḋ)), which is stable for any step.

use bonemill_cutting::burr::{Discretisation, ElementGrid, Measure, ModelError, Tool};
use bonemill_geometry::Progress;
use bonemill_geometry::{Ct, Point, Rigid, Work};
use bonemill_planfile::StoredPlan;
use bonemill_planfile::toward::{StructureFigures, TowardSpan};
use bonemill_setup::inputs::scene_of;
use bonemill_setup::nearest_structures::{self, NearStructure};
use bonemill_setup::{PlanError, tools};
use bonemill_toolpath::scene::{Scene, SceneStructure};
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;
use thiserror::Error;

use super::channel::simulate_channel;
use super::poses::{self, PoseError, Sampling, TrajectorySample};
use super::rates::StepVolumes;
use super::scene::{bone_of, solid_density};
use super::{Amount, Engine, EngineError, EngineSpec, ForceModel, ModelName, Move, ShankContact, Step};

/// Number of poses per batch; the result depends on it.
const BATCH: usize = 16;
/// Number of elements of the force sum from tip to shaft, and around.
const N_KAPPA: usize = 32;
const N_AROUND: usize = 64;
/// Number of contacts whose place is stored; further ones are only counted.
const KEPT_CONTACTS: usize = 100;

/// Why a plan cannot be simulated.
#[derive(Debug, Error)]
pub enum SimulateError {
    /// The plan's images cannot be used.
    #[error(transparent)]
    Images(#[from] PlanError),
    /// The trajectory cannot be used.
    #[error(transparent)]
    Poses(#[from] PoseError),
    /// The arm's compliance cannot be computed.
    #[error("compliance of the arm at {time_s:.3} s")]
    Compliance {
        /// When.
        time_s: f64,
        /// The reason.
        source: bonemill_arm::RobotError,
    },
    /// The engine refused burr, bone or a pose.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// Densities and grid do not match; this is a bug.
    #[error(transparent)]
    Volume(#[from] bonemill_geometry::VolumeError),
}

impl From<ModelError> for SimulateError {
    fn from(error: ModelError) -> Self {
        Self::Engine(error.into())
    }
}

/// One row of `simulation.csv`.
#[derive(Debug, Clone, PartialEq)]
pub struct SimulationRow {
    /// Time in the plan, s.
    pub time_s: f64,
    /// Position of the burr's centre, including deflection.
    pub position: Point<Ct>,
    /// Mean force on the burr over a turn, ct, N.
    pub force_n: Vector3<f64>,
    /// Largest force over a turn, N.
    pub peak_n: f64,
    /// Resisting torque, N mm.
    pub torque_nmm: f64,
    /// Spindle power, W.
    pub power_w: f64,
    /// Mean removal rate of the step that ends here, mm³/s; rates times durations add up to the removed volume.
    pub mrr_mm3_s: f64,
    /// Index in the case of the structure with the smallest distance less clearance.
    pub structure: Option<usize>,
    /// Force toward it, N, not negative.
    pub force_toward_n: Option<f64>,
    /// Distance from the burr's centre to it, mm.
    pub distance_mm: Option<f64>,
    /// Distance of the burr from its commanded position, µm; `None` without a stiffness.
    pub deflection_um: Option<f64>,
}

/// A structure near the burr at one pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SimulatedToward {
    /// Its index in the case.
    pub structure: usize,
    /// Distance from the burr's centre, mm.
    pub distance_mm: f64,
    /// Force toward it, N, not negative; `None` inside it.
    pub force_n: Option<f64>,
}

/// The outcome of a simulation.
#[derive(Debug, Clone, PartialEq)]
pub struct Simulation {
    /// One row per pose, including the first.
    pub rows: Vec<SimulationRow>,
    /// For each structure of the case, the least distance over all poses, and the force toward it while something is removed.
    pub structures: Vec<StructureFigures>,
    /// Amount removed, by kind.
    pub removed: Amount,
    /// The same computed from the surface's rates; the difference is a measure of the step's error.
    pub removed_by_rate: Amount,
    /// The first contacts of the shank, with their times.
    pub contacts: Vec<(f64, ShankContact)>,
    /// Number of steps that the shank stopped.
    pub stopped: usize,
    /// Side of a cell of the lattice, mm.
    pub cell_mm: f64,
    /// Largest radius of the cutter, mm.
    pub radius_mm: f64,
    /// Whether the arm deflected.
    pub compliant: bool,
}

impl Simulation {
    /// Largest force (each averaged over a turn), N.
    pub fn peak_force_n(&self) -> f64 {
        self.rows.iter().map(|row| row.force_n.norm()).fold(0.0, f64::max)
    }

    /// Mean force over the time in which something is removed, N.
    pub fn mean_force_n(&self) -> f64 {
        let (mut sum, mut seconds) = (0.0, 0.0);
        for (row, span_s) in self.spans().filter(|(row, _)| row.mrr_mm3_s > 0.0) {
            sum += row.force_n.norm() * span_s;
            seconds += span_s;
        }
        if seconds > 0.0 { sum / seconds } else { 0.0 }
    }

    /// Energy that the spindle spends, J.
    pub fn energy_j(&self) -> f64 {
        self.spans().map(|(row, span_s)| row.power_w * span_s).sum()
    }

    /// Rows, each with the time for which it stands.
    fn spans(&self) -> impl Iterator<Item = (&SimulationRow, f64)> {
        self.rows.iter().enumerate().map(|(n, row)| (row, span_s(&self.rows, n)))
    }
}

/// The time for which a row's force stands: half of the step that ends there and half of the next, s. Sums are then those of the
/// trapezoidal rule.
fn span_s(rows: &[SimulationRow], n: usize) -> f64 {
    let after_s = rows[(n + 1).min(rows.len() - 1)].time_s;
    0.5 * (after_s - rows[n.saturating_sub(1)].time_s)
}

/// The input of the engine for a plan: scene, densities and tool.
pub struct SimulationSetup {
    /// The scene, as the planner made it.
    pub scene: Scene,
    /// Densities of all solid voxels.
    pub density_g_cm3: bonemill_geometry::Volume<f32, Work>,
    /// Burr, shank, material and resolution.
    pub spec: EngineSpec,
    clearances_mm: Vec<f64>,
}

impl SimulationSetup {
    /// Reads the images of a plan.
    ///
    /// # Errors
    /// [`SimulateError::Images`] for images that cannot be read.
    pub fn read(plan: &StoredPlan, progress: &dyn Progress) -> Result<Self, SimulateError> {
        let case = &plan.record.case;
        let scene = scene_of(plan, progress)?;
        let density_g_cm3 = solid_density(&scene, &case.density.table)?;
        let tool = tools::tool(&plan.record.burr())?;
        let (material, measure) = tools::material(&case.material)?;
        let spec = EngineSpec {
            disc: discretisation(&tool, measure)?,
            tool,
            material,
            spindle_rpm: case.burr.spindle_rpm,
            shank: tools::shank(case),
            cells_per_radius: EngineSpec::CELLS_PER_RADIUS,
        };
        let clearances_mm = case.clearances_mm();
        Ok(Self { scene, density_g_cm3, spec, clearances_mm })
    }

    /// The structures near a burr's centre: first the one with the smallest distance less clearance, then the others within their
    /// influence.
    ///
    /// Inside a structure there is no direction toward it; then only this structure is given, at distance 0 and without a force.
    pub fn toward(&self, center: Point<Work>, force_n: &Vector3<f64>) -> Vec<SimulatedToward> {
        let radius_mm = self.spec.tool.radius_mm();
        match nearest_structures::structures_within(&self.scene, &self.clearances_mm, radius_mm, center) {
            Ok(near) => near
                .iter()
                .map(|NearStructure { structure, proximity, .. }| SimulatedToward {
                    structure: *structure,
                    distance_mm: proximity.distance_mm,
                    force_n: Some(force_n.dot(&proximity.toward).max(0.0)),
                })
                .collect(),
            Err(_) => {
                let p = self.scene.ct_from_work * center;
                let holds = |s: &SceneStructure| s.field.as_ref().is_some_and(|f| f.distance(p) <= 0.0);
                let inside = self.scene.structures.iter().position(holds);
                let inside =
                    inside.map(|structure| SimulatedToward { structure, distance_mm: 0.0, force_n: None });
                inside.into_iter().collect()
            }
        }
    }
}

/// The simulation's force sum; it is coarser than the planner's, with an error of 2e-3 of |F|.
fn discretisation(tool: &Tool, measure: Measure) -> Result<Discretisation, ModelError> {
    let n_gamma = N_AROUND.div_ceil(tool.blades() as usize);
    Discretisation::new(n_gamma, N_KAPPA, ElementGrid::Kappa, measure)
}

/// Simulates a plan: reads its images again, and replays its trajectory.
///
/// # Errors
/// [`SimulateError`].
pub fn simulate(
    plan: &StoredPlan,
    model: ModelName,
    sampling: Sampling,
    progress: &dyn Progress,
) -> Result<Simulation, SimulateError> {
    if plan.record.case.job.channel().is_some() {
        return simulate_channel(plan, sampling, progress);
    }
    let setup = SimulationSetup::read(plan, progress)?;
    let model = model.model(&plan.record.case, &setup.spec)?;
    replay(plan, &setup, model, sampling, progress)
}

/// Replays a plan's trajectory with a force model.
///
/// # Errors
/// [`SimulateError`].
pub fn replay(
    plan: &StoredPlan,
    setup: &SimulationSetup,
    model: impl ForceModel,
    sampling: Sampling,
    progress: &dyn Progress,
) -> Result<Simulation, SimulateError> {
    progress.stage("forward kinematics");
    let base_from_work = plan.record.frames.base_from_ct * setup.scene.ct_from_work;
    let samples = poses::sample(&plan.trajectory, &plan.arm, &base_from_work.inverse(), sampling)?;
    let moves = poses::moves(&samples);
    progress.stage("simulate");
    let bone = bone_of(&setup.scene, &setup.density_g_cm3)?;
    let start = samples.first().map(|s| s.pose).ok_or(PoseError::Empty)?;
    let mut engine = Engine::new(bone, setup.spec.clone(), model, start)?;
    let mut steps = Vec::with_capacity(moves.len());
    let mut places = vec![start.center];
    let mut volumes = StepVolumes::default();
    let stiffness = plan.record.case.robot.joint_stiffness.as_deref();
    match stiffness {
        None => {
            for batch in moves.chunks(BATCH) {
                let made = engine.steps(batch)?;
                for (step, to) in made.iter().zip(batch) {
                    let stopped = step.contact.is_some();
                    let stays = places.last().copied().unwrap_or(start.center);
                    let place = if stopped { stays } else { to.to.center };
                    volumes.push((place - stays).norm(), step.removed.total_mm3());
                    places.push(place);
                }
                volumes.look(engine.removed().total_mm3(), engine.pending_mm());
                steps.extend(made);
                progress.advance(steps.len(), moves.len());
            }
        }
        Some(stiffness) => {
            let compliances = compliances(plan, &base_from_work, &samples, stiffness)?;
            let mut deflection = Vector3::zeros();
            for (n, (to, compliance)) in moves.iter().zip(&compliances).enumerate() {
                let step = yielding_step(&mut engine, to, compliance, &mut deflection)?;
                let place = engine.pose().center;
                let before = places.last().copied().unwrap_or(start.center);
                volumes.push((place - before).norm(), step.removed.total_mm3());
                volumes.look(engine.removed().total_mm3(), engine.pending_mm());
                places.push(place);
                steps.push(step);
                if n % 256 == 0 {
                    progress.advance(n, moves.len());
                }
            }
        }
    }
    engine.settle();
    volumes.look(engine.removed().total_mm3(), 0.0);
    let removed_mm3 = volumes.removed_mm3();
    let cell_mm = engine.lattice().spacing_mm();
    let removed = *engine.removed();
    progress.stage("distances");
    let replayed = Replayed { setup, samples: &samples, places: &places, steps: &steps };
    let (rows, toward): (Vec<_>, Vec<_>) =
        replayed.rows(&removed_mm3, stiffness.is_some()).into_iter().unzip();
    let mut simulation = Simulation {
        structures: structure_figures(setup, &places, &rows, &toward),
        rows,
        removed,
        removed_by_rate: Amount::default(),
        contacts: Vec::new(),
        stopped: 0,
        cell_mm,
        radius_mm: setup.spec.tool.radius_mm(),
        compliant: stiffness.is_some(),
    };
    for (step, sample) in steps.iter().zip(samples.iter().skip(1)) {
        simulation.removed_by_rate.merge(&step.removed);
        if let Some(contact) = step.contact {
            simulation.stopped += 1;
            if simulation.contacts.len() < KEPT_CONTACTS {
                simulation.contacts.push((sample.time_s, contact));
            }
        }
    }
    Ok(simulation)
}

/// Compliance at every sample except the first, work, mm/N.
fn compliances(
    plan: &StoredPlan,
    base_from_work: &Rigid<bonemill_geometry::Base, Work>,
    samples: &[TrajectorySample],
    stiffness: &[f64],
) -> Result<Vec<Matrix3<f64>>, SimulateError> {
    let turn = base_from_work.rotation.matrix();
    let one = |sample: &TrajectorySample| {
        let found = plan.arm.compliance(&sample.q, stiffness);
        let c = found.map_err(|source| SimulateError::Compliance { time_s: sample.time_s, source })?;
        Ok(turn.transpose() * c * turn)
    };
    samples.par_iter().skip(1).map(one).collect()
}

/// One step of a burr that deflects; `deflection` is its present deflection, work, mm.
fn yielding_step<M: ForceModel>(
    engine: &mut Engine<'_, f32, M>,
    to: &Move,
    compliance: &Matrix3<f64>,
    deflection: &mut Vector3<f64>,
) -> Result<Step, EngineError> {
    let before = *deflection;
    let mut off = before;
    let aim = Move { to: super::Pose { center: to.to.center + before, ..to.to }, ..*to };
    let way_mm = (aim.to.center - engine.pose().center).norm();
    let step = engine.step_yielding(&aim, |force| {
        let target = compliance * force.force_n;
        let speed_mm_s = way_mm / to.seconds;
        let settles_s = if speed_mm_s > 0.0 { target.norm() / speed_mm_s } else { 0.0 };
        let part = if to.seconds > 0.0 { to.seconds / (to.seconds + settles_s) } else { 0.0 };
        off = before + (target - before) * part;
        off - before
    })?;
    if step.contact.is_none() {
        *deflection = off;
    }
    Ok(step)
}

/// What was replayed: poses asked for, places taken, and the steps between them.
struct Replayed<'a> {
    setup: &'a SimulationSetup,
    samples: &'a [TrajectorySample],
    places: &'a [Point<Work>],
    steps: &'a [Step],
}

impl Replayed<'_> {
    /// Every pose, and the structures near it. `removed_mm3`: by step; `compliant`: whether the arm gives way.
    fn rows(&self, removed_mm3: &[f64], compliant: bool) -> Vec<(SimulationRow, Vec<SimulatedToward>)> {
        let Self { setup, samples, places, steps } = *self;
        let still = Step::nothing(None);
        let row = |n: usize| {
            let (sample, center) = (&samples[n], places[n]);
            let step = if n == 0 { &still } else { &steps[n - 1] };
            let force = &step.force;
            let toward = setup.toward(center, &force.force_n);
            let first = toward.first();
            let before = n.checked_sub(1);
            let seconds = before.map_or(0.0, |before| sample.time_s - samples[before].time_s);
            let removed_mm3 = before.map_or(0.0, |before| removed_mm3[before]);
            let row = SimulationRow {
                time_s: sample.time_s,
                position: setup.scene.ct_from_work * center,
                force_n: setup.scene.ct_from_work.rotate(&force.force_n),
                peak_n: force.peak_n,
                torque_nmm: force.torque_nmm,
                power_w: force.spindle_power_mw * 1e-3,
                mrr_mm3_s: if seconds > 0.0 { removed_mm3 / seconds } else { 0.0 },
                structure: first.map(|t| t.structure),
                force_toward_n: first.and_then(|t| t.force_n),
                distance_mm: first.map(|t| t.distance_mm),
                deflection_um: compliant.then(|| (center - sample.pose.center).norm() * 1e3),
            };
            (row, toward)
        };
        (0..samples.len().min(places.len()).min(steps.len() + 1)).into_par_iter().map(row).collect()
    }
}

/// Figures of each structure of the scene; a force counts while something is removed.
fn structure_figures(
    setup: &SimulationSetup,
    places: &[Point<Work>],
    rows: &[SimulationRow],
    toward: &[Vec<SimulatedToward>],
) -> Vec<StructureFigures> {
    let least = nearest_structures::least_distances(&setup.scene, &places[..rows.len()]);
    let mut spans = vec![Vec::new(); least.len()];
    for (index, (row, toward)) in rows.iter().zip(toward).enumerate() {
        let seconds = span_s(rows, index);
        for near in toward {
            if let Some(force_n) = near.force_n.filter(|_| row.mrr_mm3_s > 0.0) {
                spans[near.structure]
                    .push((TowardSpan { seconds, force_n, peak_n: force_n, row: index }, near.distance_mm));
            }
        }
    }
    let radius_mm = setup.spec.tool.radius_mm();
    let of = |n: usize| StructureFigures::of(least[n], &spans[n], [radius_mm, setup.clearances_mm[n]]);
    (0..least.len()).map(of).collect()
}
