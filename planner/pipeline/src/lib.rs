//! Milling with a ball burr: the whole way from a case to a plan.
//!
//! images → scene → free space → path with its removal times → access → engagement → orientation → forces → speed →
//! joint trajectory. Every stage takes values and hands values on; none keeps state. What a stage cannot do is a
//! result with its reason ([`Plan::shortfalls`]); an error is only what leaves nothing to plan.

mod access_csv;
mod arm_axes;
mod attempt;
mod axis_cost;
mod bounds;
mod choose;
mod compared;
mod direction_sets;
mod figures;
mod force_error;
mod free_axes;
mod in_time;
mod judged;
mod laid;
mod levels;
mod metrics;
mod modelled;
mod move_limits;
mod orient;
mod path_error;
mod path_forces;
mod percent;
mod plan;
mod prepared;
mod push;
mod raster;
mod reach;
mod record;
mod reference;
mod refused;
mod rest;
mod rows;
mod sampled;
mod save;
mod sense;
mod speed_levels;
mod speeds;
mod spin;
mod start;
mod tilt;
mod time_reason;
mod too_little;

use std::collections::BTreeMap;
use std::path::Path;

use attempt::Attempt;
use bonemill_case::Case;
use bonemill_cutting::cutter::Ball;
use bonemill_geometry::Progress;
use bonemill_setup::{Setup, Stopwatch, nearest_structures, room};
use bonemill_toolpath::access::ShankObstacles;
use bonemill_toolpath::path;
use bonemill_toolpath::scene::{ChosenWay, Scene};
use bonemill_toolpath::space::BurrSpace;
use start::Start;

pub use bonemill_setup::PlanError;
pub use choose::{Choices, Chosen};
pub use compared::{Compared, JUDGED, Worse};
pub use figures::Figures;
pub use force_error::ForceError;
pub use in_time::Goal;
pub use laid::Raster;
pub use metrics::{Coverage, Volumes};
pub use modelled::{AxisFacts, Modelled, PathFacts, SpeedFacts};
pub use orient::{BlockedTurn, Oriented};
pub use path_error::PathError;
pub use percent::{percent, rounded_percent};
pub use plan::{Plan, PlanResults, PlannedMoves, ShankAccess};
pub use prepared::{Prepared, with_prepared};
pub use raster::LinesDraft;
pub use reach::Dropped;
pub use record::record;
pub use reference::{Reference, StructureForces};
pub use refused::{Refused, place};
pub use rest::{RestCause, rest_of};
pub use save::save;
pub use speed_levels::{Exceeded, SpeedLevels};

/// Plans a case; paths in it are relative to the folder of `case_path`.
///
/// # Errors
/// [`PlanError`] for images that cannot be read or trusted, targets that cannot be planned for, and options of the
/// case that this version does not support.
pub fn plan(case: &Case, case_path: &Path, progress: &dyn Progress) -> Result<Plan, PlanError> {
    let mut watch = Stopwatch::new(progress);
    let setup = Setup::read(case, case_path, &mut watch)?;
    room::judge_base(setup.room.as_ref()).map_err(|error| setup.registered.blame(case, error))?;
    let way = setup.scene.way.as_ref().map(ChosenWay::text);
    planned(case, setup, watch).map_err(|error| match way {
        Some(way) if error.is_infeasible() || matches!(error, PlanError::NothingReachable { .. }) => {
            PlanError::AlongChosen { way, source: Box::new(error) }
        }
        _ => error,
    })
}

/// Plans a case whose inputs are read.
fn planned(case: &Case, setup: Setup, mut watch: Stopwatch) -> Result<Plan, PlanError> {
    let space = watch.run("free space", || free_space(&setup.case, &setup.scene))?;
    let solid = watch.run("solid", || shank_obstacles(&setup.case, &setup.scene));
    let reversed = spin::reversed(&setup.case);
    let start = Start::new(&setup, &space, &solid);
    let mut attempt = spin::better(&start, reversed.as_ref(), &setup.registered, &mut watch)?;
    let moves = (attempt.waypoint_rows(), attempt.force_rows());
    let least = nearest_structures::least_distances(&setup.scene, &path::centers(attempt.prepared.points()));
    let modelled = Modelled::of(&attempt, &least)?;
    let figures = Figures::of(case, &moves.0, &moves.1, attempt.prepared.length_mm(), &least);
    // what stands beside the references is what the files state
    attempt.compared.plan = figures.forces();
    let (warnings, shortfalls) =
        (attempt.warnings(&setup, &modelled)?, attempt.shortfalls(&setup, &modelled)?);
    let Attempt { prepared, chosen, timing, coverage, compared, .. } = attempt;
    let access = ShankAccess { allowed: chosen.oriented.allowed, dropped: prepared.reached.dropped.clone() };
    drop(prepared);
    Ok(Plan {
        setup,
        moves: PlannedMoves { waypoints: moves.0, forces: moves.1, law: timing.driven.law },
        access,
        results: PlanResults { coverage, figures, compared },
        modelled,
        warnings,
        shortfalls,
        seconds: watch.into_seconds(),
    })
}

/// Where the burr's centre may be.
fn free_space<'a>(case: &Case, scene: &'a Scene) -> Result<BurrSpace<'a>, PlanError> {
    let radius_mm = case.burr.radius_mm;
    let space = BurrSpace::new(scene, Ball { radius_mm }, &case.clearances_mm())?;
    if space.reachable().contains(&true) {
        Ok(space)
    } else {
        Err(PlanError::NothingReachable { radius_mm, reason: why_nothing(scene, radius_mm)? })
    }
}

/// What the shank of a case may not touch.
fn shank_obstacles(case: &Case, scene: &Scene) -> ShankObstacles {
    let clearances: Vec<f64> = case.structures.iter().map(|s| s.shank_clearance_mm).collect();
    ShankObstacles::new(scene, &clearances)
}

/// Why no target voxel can be reached.
fn why_nothing(scene: &Scene, radius_mm: f64) -> Result<&'static str, PlanError> {
    let without_structures = BurrSpace::new(scene, Ball { radius_mm }, &[])?;
    Ok(if without_structures.reachable().contains(&true) {
        "the clearances of the structures leave no room for it: see structure.clearance_mm and the burr's radius"
    } else {
        "bone outside the target leaves no room for it, or closes every way in: see approach.direction, target and the \
         burr's radius"
    })
}

/// The direction of a line as an angle in (−π/2, π/2], rad.
pub fn half_turn(angle_rad: f64) -> f64 {
    let turned = angle_rad.rem_euclid(std::f64::consts::PI);
    if turned > std::f64::consts::FRAC_PI_2 { turned - std::f64::consts::PI } else { turned }
}

/// How many places were dropped for each reason.
pub fn dropped_by_reason(dropped: &[Dropped]) -> BTreeMap<&str, usize> {
    let mut counts = BTreeMap::new();
    for place in dropped {
        *counts.entry(place.reason.as_str()).or_insert(0) += 1;
    }
    counts
}
