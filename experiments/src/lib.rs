//! The measurements behind the published tables. Each has a name, takes a size, and gives tables.
//!
//! `cargo run --release -p bonemill-experiments -- NAME` runs one and prints its tables; with `--out` they are written as
//! Markdown and CSV. The command `bonemill` does not contain them. Experiments call the planner as its users do.
//!
//! Invariants: the same size gives the same tables, except columns of wall-clock time; if a body is missing (scans that are not
//! part of the repository), it is left out and the table says so.

pub mod arms;
pub mod body;
pub mod cli;
mod cross_validation;
pub mod engine;
mod figures;
pub mod force_error;
pub mod haptic;
pub mod hard_cases;
mod link_capsules;
mod orientation;
mod pareto;
pub mod peers;
mod prostheses;
mod safest_channel;
mod speed_vs_error;
mod stream_faults;
mod table;
mod trials;

use std::io;
use std::path::{Path, PathBuf};

use bonemill_imaging::ImageError;
use bonemill_planner::case::CaseError;
use bonemill_planner::{PlanError, Progress};

pub use table::Table;

/// The size of an experiment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Size<'a> {
    /// Bodies of each kind: seeds 1 to this.
    pub seeds: u64,
    /// First seed, for experiments on random cases.
    pub first: u64,
    /// The user's own case, for experiments that take one.
    pub case: Option<&'a Path>,
    /// Universal Robots' ROS 2 description, for `link-capsules`.
    pub meshes: Option<&'a Path>,
}

impl Size<'_> {
    /// Numbers of random cases, 25 for each seed.
    pub(crate) fn cases(&self) -> std::ops::Range<u64> {
        let first = 25 * (self.first - 1);
        first..first + 25 * self.seeds
    }
}

/// Why an experiment cannot be run.
#[derive(Debug, thiserror::Error)]
pub enum ExperimentError {
    /// There is no experiment of this name.
    #[error("no experiment is called {name:?}; there are {known}")]
    Unknown {
        /// The given name.
        name: String,
        /// All experiments, each with what it measures.
        known: String,
    },
    /// A table or picture cannot be written.
    #[error("cannot write {}", path.display())]
    Write {
        /// The file or folder.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// `link-capsules` without its meshes.
    #[error("needs --meshes DIR: a checkout of github.com/UniversalRobots/Universal_Robots_ROS2_Description")]
    NoMeshes,
    /// A link's mesh cannot be read.
    #[error("{}", path.display())]
    Mesh {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: bonemill_planner::part::PartError,
    },
    /// Places of meshes in their links' frames cannot be read.
    #[error("{} does not give shoulder_offset, elbow_offset and three visual_offset", path.display())]
    Offsets {
        /// The file or folder.
        path: PathBuf,
        /// The system's reason, where there is one.
        source: Option<io::Error>,
    },
    /// A temporary folder cannot be made.
    #[error("cannot write a phantom's files to the temporary folder")]
    Folder(#[source] io::Error),
    /// The user's case does not exist.
    #[error("cannot read the case {}", .0.display())]
    NoCase(PathBuf),
    /// A phantom's image cannot be written.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// A case is invalid.
    #[error(transparent)]
    Case(#[from] CaseError),
    /// Planning failed.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// A burr or material is invalid.
    #[error(transparent)]
    Model(#[from] bonemill_planner::burr::ModelError),
    /// An arm, or a request to it, is invalid.
    #[error(transparent)]
    Robot(#[from] bonemill_robot::RobotError),
    /// A drill or reamer is invalid.
    #[error(transparent)]
    Cutter(bonemill_planner::cutter::CutterError),
    /// Forces that could overflow the sums of an engine.
    #[error(transparent)]
    Overflow(haptic::Overflow),
    /// A log gives no coefficients.
    #[error(transparent)]
    Fit(#[from] bonemill_planner::edge::PlungeFitError),
    /// A grid is invalid.
    #[error(transparent)]
    Grid(#[from] bonemill_geometry::GridError),
    /// A prosthesis cannot be planned.
    #[error(transparent)]
    Prosthesis(#[from] bonemill_prosthesis::ProsthesisError),
    /// A part's toolpath cannot be laid.
    #[error(transparent)]
    Machining(#[from] bonemill_prosthesis::machining::MachiningError),
    /// The simulation's engine refused its input.
    #[error(transparent)]
    Engine(#[from] bonemill_planner::simulate::EngineError),
    /// A plan's files cannot be read.
    #[error(transparent)]
    PlanFile(#[from] bonemill_planner::plan::PlanFileError),
    /// A plan cannot be verified.
    #[error(transparent)]
    Verify(#[from] bonemill_planner::verify::VerifyError),
    /// A plan cannot be streamed.
    #[error(transparent)]
    Stream(#[from] bonemill_robot::stream::StreamError),
    /// The number of values does not match the grid.
    #[error(transparent)]
    Values(#[from] bonemill_geometry::VolumeError),
}

/// The function that runs an experiment.
pub type Runner = fn(Size, &dyn Progress) -> Result<Vec<Table>, ExperimentError>;

/// An experiment.
#[derive(Debug, Clone, Copy)]
pub struct Experiment {
    /// Its name.
    pub name: &'static str,
    /// What it measures, in one line.
    pub about: &'static str,
    /// The function that runs it.
    pub run: Runner,
}

/// Every experiment, by name.
pub const EXPERIMENTS: &[Experiment] = &[
    Experiment {
        name: "inverse",
        about: "the UR inverse on 10⁶ poses an arm, singular ones among them",
        run: arms::run_inverse,
    },
    Experiment {
        name: "kinematics",
        about: "forward kinematics and Jacobians for other libraries to compare with: long tables, for --out with --quiet",
        run: arms::run_kinematics,
    },
    Experiment {
        name: "link-capsules",
        about: "capsules that enclose the links of UR arms, proved on the meshes in --meshes, and their excess",
        run: link_capsules::run,
    },
    Experiment {
        name: "peers",
        about: "distance fields, time law and kinematics beside the Python packages edt, toppra and pin, one thread",
        run: peers::run,
    },
    Experiment {
        name: "force-error",
        about: "the burr's force: error against the converged sum, and time, over the discretisations",
        run: force_error::run,
    },
    Experiment {
        name: "trials",
        about: "the three trials of Dillon et al. 2016 on the foam block, greedy and optimal",
        run: trials::run,
    },
    Experiment {
        name: "trials-felt",
        about: "whole plans beside straight shafts in the same time, by two arms: blocks, heads, a scan; what each lever gives",
        run: trials::felt,
    },
    Experiment {
        name: "turning",
        about: "what turning the shaft earns over the joints' accelerations, the tilt limit and the mount's lever",
        run: trials::turning,
    },
    Experiment {
        name: "trials-sweep",
        about: "how the reductions of those trials change over what is assumed",
        run: trials::sweep,
    },
    Experiment {
        name: "pareto",
        about: "force toward the nerve against total time and removed volume: block, temporal bone and --case",
        run: pareto::run,
    },
    Experiment {
        name: "speed-vs-error",
        about: "whole plans with every approximation coarser and finer: time, the plan's own error, change against the finest (--case: your own)",
        run: speed_vs_error::run,
    },
    Experiment {
        name: "orientation",
        about: "optimal against greedy orientation, one and two angles: cost, forces, rates, violations, time",
        run: orientation::run,
    },
    Experiment {
        name: "prostheses",
        about: "drawn prostheses (--seeds 25: the published set) and the reference, from STL to a proven program: orientation, time, deviation",
        run: prostheses::run,
    },
    Experiment {
        name: "engine-convergence",
        about: "removed volume and force of the voxel engine against closed forms, from coarse to fine cells",
        run: engine::convergence::run,
    },
    Experiment {
        name: "engine-speed",
        about: "time of an engine's step over voxmaps and tools, beside a loop over the tool's box",
        run: engine::speed::run,
    },
    Experiment {
        name: "stream-faults",
        about: "what a burr does when streaming fails: 100 runs a seed of every fault on a simulated arm, of the plan in --case",
        run: stream_faults::run,
    },
    Experiment {
        name: "haptic-steps",
        about: "time and error of a haptic step, drilling and reaming: the published engines and ours over resolutions",
        run: haptic::run,
    },
    Experiment {
        name: "haptic-loop",
        about: "the haptic loop at 1 kHz and the surface of what changed, together for a minute: late steps, frames a second",
        run: haptic::together::run,
    },
    Experiment {
        name: "safest-channel",
        about: "the safest channel to the cochlea's basal turn: temporal bones over the registration's error, each plan verified",
        run: safest_channel::run,
    },
    Experiment {
        name: "cross-validation",
        about: "thrust and torque of drilling left out of the calibration: three published regressions, negative torques counted",
        run: cross_validation::run,
    },
    Experiment {
        name: "hard-cases",
        about: "small bodies, each hard in one way: what must become of each, and what does",
        run: hard_cases::run,
    },
    Experiment {
        name: "stability",
        about: "how far a plan moves where its input moves a little",
        run: hard_cases::run_stability,
    },
    Experiment {
        name: "random-scenes",
        about: "random bodies planned and verified, 25 a seed; one that fails is made as simple as it can be",
        run: hard_cases::run_random,
    },
    Experiment {
        name: "agree",
        about: "random bodies under random keys: plan, verify, simulate and a twin of the case must agree, 25 a seed",
        run: hard_cases::run_agree,
    },
    Experiment {
        name: "agree-channels",
        about: "random drills beside a nerve: plan, verify, simulate and a twin of the case must agree, 25 a seed",
        run: hard_cases::run_agree_channels,
    },
    Experiment {
        name: "agree-prostheses",
        about: "random parts, tools and blocks: plan, proof and verify must agree, and every change of the folder be found, 25 a seed",
        run: prostheses::agree::run,
    },
];

/// Runs `work` on one thread, so that the time does not depend on the number of cores.
pub(crate) fn alone<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    match rayon::ThreadPoolBuilder::new().num_threads(1).build() {
        Ok(pool) => pool.install(work),
        Err(_) => work(),
    }
}

#[cfg(test)]
mod tests {
    use super::EXPERIMENTS;

    #[test]
    fn names_are_distinct() {
        let mut names: Vec<_> = EXPERIMENTS.iter().map(|e| e.name).collect();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), EXPERIMENTS.len());
    }
}
