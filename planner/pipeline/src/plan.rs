//! A plan in memory: its setup, how burr and arm move, and the results.

use bonemill_planfile::{ForceToward, Waypoint};
use bonemill_robot::timelaw::TimeLaw;
use bonemill_setup::Setup;
use bonemill_toolpath::orientation::Permissible;

use super::{Compared, Coverage, Dropped, Figures, Modelled};

/// A plan with all that its files and its report say.
#[derive(Debug)]
pub struct Plan {
    /// What it was planned on; the case as it was given. What the planner chose is in `modelled`.
    pub setup: Setup,
    /// How burr and arm move.
    pub moves: PlannedMoves,
    /// Where the shank can go.
    pub access: ShankAccess,
    /// Volumes, forces and distances.
    pub results: PlanResults,
    /// What was modelled how.
    pub modelled: Modelled,
    /// What the user should know.
    pub warnings: Vec<String>,
    /// Why the plan falls short of its case, if it does.
    pub shortfalls: Vec<String>,
    /// Wall-clock seconds by stage of planning; never written into the plan's files.
    pub seconds: Vec<(&'static str, f64)>,
}

/// How burr and arm move.
#[derive(Debug)]
pub struct PlannedMoves {
    /// The rows of `waypoints.csv`.
    pub waypoints: Vec<Waypoint>,
    /// The rows of `forces.csv`.
    pub forces: Vec<ForceToward>,
    /// The motion of the joints.
    pub law: TimeLaw,
}

/// The directions that are free for the shank along the path, and the places that it cannot reach.
#[derive(Debug)]
pub struct ShankAccess {
    /// Directions that are open at each waypoint.
    pub allowed: Vec<Permissible>,
    /// Places that the path leaves out.
    pub dropped: Vec<Dropped>,
}

/// The results of a plan.
#[derive(Debug)]
pub struct PlanResults {
    /// Volumes.
    pub coverage: Coverage,
    /// Forces, times and distances in one number each.
    pub figures: Figures,
    /// Forces toward the structures, compared with a straight shaft at constant speed in the same time.
    pub compared: Compared,
}
