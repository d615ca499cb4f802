//! Measurements behind the published tables: each has a name, takes a size, and gives tables.
//!
//! `cargo run --release -p bonemill-experiments -- NAME` runs one and prints its tables; with `--out` they are written as Markdown and
//! CSV. `bonemill` itself does not carry them. Nothing here decides anything: experiments call the planner as its users do, and count.
//!
//! Invariants: the same size gives the same tables, but for columns of wall-clock time; a body that is not there (scans that
//! are not part of the repository) is left out and said.

pub mod arms;
pub mod body;
pub mod cli;
pub mod engine;
pub mod force_error;
pub mod hard_cases;
mod orientation;
mod pareto;
pub mod peers;
mod prostheses;
mod table;
mod trials;

use std::io;
use std::path::{Path, PathBuf};

use bonemill_imaging::ImageError;
use bonemill_planner::case::CaseError;
use bonemill_planner::{PlanError, Progress};

pub use table::Table;

/// How much is run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Size<'a> {
    /// Bodies of each kind: seeds 1 to this.
    pub seeds: u64,
    /// A case of the user's beside them, for experiments that take one.
    pub case: Option<&'a Path>,
}

/// What an experiment can fail of.
#[derive(Debug, thiserror::Error)]
pub enum ExperimentError {
    /// No such experiment.
    #[error("no experiment is called {name:?}; there are {known}")]
    Unknown {
        /// The name asked for.
        name: String,
        /// Those there are, each with what it measures.
        known: String,
    },
    /// A table or picture.
    #[error("cannot write {}", path.display())]
    Write {
        /// The file or folder.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// A temporary folder.
    #[error("cannot write a phantom's files to the temporary folder")]
    Folder(#[source] io::Error),
    /// A case of the user's.
    #[error("cannot read the case {}", .0.display())]
    NoCase(PathBuf),
    /// A phantom's image.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// Its case.
    #[error(transparent)]
    Case(#[from] CaseError),
    /// Planning.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// A burr or material that cannot be.
    #[error(transparent)]
    Model(#[from] bonemill_planner::burr::ModelError),
    /// An arm that cannot be, or what is asked of it.
    #[error(transparent)]
    Robot(#[from] bonemill_robot::RobotError),
    /// A grid that cannot be.
    #[error(transparent)]
    Grid(#[from] bonemill_geometry::GridError),
    /// A prosthesis.
    #[error(transparent)]
    Prosthesis(#[from] bonemill_planner::prosthesis::ProsthesisError),
    /// Its toolpath.
    #[error(transparent)]
    Machining(#[from] bonemill_planner::machining::MachiningError),
    /// What the engine refuses.
    #[error(transparent)]
    Engine(#[from] bonemill_planner::simulate::EngineError),
    /// Values that do not fit their grid.
    #[error(transparent)]
    Values(#[from] bonemill_geometry::VolumeError),
}

/// What runs an experiment.
pub type Run = fn(Size, &dyn Progress) -> Result<Vec<Table>, ExperimentError>;

/// An experiment.
#[derive(Debug, Clone, Copy)]
pub struct Experiment {
    /// Its name.
    pub name: &'static str,
    /// What it measures, in a line.
    pub about: &'static str,
    /// What runs it.
    pub run: Run,
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
        about: "whole plans with the least force in their time beside straight shafts at constant speed: blocks, heads, a scan",
        run: trials::felt,
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
        name: "hard-cases",
        about: "small bodies, each hard in one way: what must become of each, and what does",
        run: hard_cases::run,
    },
    Experiment {
        name: "random-scenes",
        about: "random bodies planned and verified, 25 a seed; one that fails is made as simple as it can be",
        run: hard_cases::run_random,
    },
];

/// On one thread: what is timed there is the work, not the machine.
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
