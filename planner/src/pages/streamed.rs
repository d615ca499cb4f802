//! A stored plan's values as streaming takes them: joints, the room to structures at each waypoint, forces and hold points in the
//! arm's base.

use bonemill_robot::stream::{HoldPlace, Near, Standing, StreamInput, StructureKept, WaypointNear};

use bonemill_planfile::{HoldPoint, PlanFileError, Sha256, StoredPlan, Waypoint, hold_points, verified};

/// What streaming takes of a plan; whether its files are what a passed verification judged is looked up.
///
/// # Errors
/// [`PlanFileError::Io`] when the trajectory cannot be read again for its digest.
pub fn stream_input(stored: &StoredPlan) -> Result<StreamInput<'_>, PlanFileError> {
    let case = &stored.record.case;
    let standing = match verified(&stored.dir) {
        Ok(_) => Standing::Verified,
        Err(error) => Standing::Unverified(error.to_string()),
    };
    let digest = Sha256::of_file(&stored.dir.join("trajectory.csv"))?;
    let name = |structure: usize| case.structures.get(structure).map_or("a structure", |s| &s.name);
    let hold = |hold: HoldPoint| HoldPlace {
        row: hold.row,
        why: format!("{} mm from {}", hold.distance_mm, name(hold.structure)),
    };
    let kept =
        |s: &bonemill_case::Structure| StructureKept { name: s.name.clone(), clearance_mm: s.clearance_mm };
    Ok(StreamInput {
        arm: &stored.arm,
        model: case.robot.model.clone(),
        time_s: &stored.trajectory.time_s,
        q: &stored.trajectory.q,
        structures: case.structures.iter().map(kept).collect(),
        waypoints: waypoints(stored),
        holds: hold_points(stored).into_iter().map(hold).collect(),
        registration_assumed: stored.record.frames.registration_assumed,
        standing,
        digest: digest.to_string(),
    })
}

/// Structures near each waypoint, with directions in base.
fn waypoints(stored: &StoredPlan) -> Vec<WaypointNear> {
    let base_from_ct = &stored.record.frames.base_from_ct;
    let radius_mm = stored.record.cutter_radius_mm();
    let empty = |w: &Waypoint| WaypointNear { time_s: w.time_s, near: Vec::new() };
    let mut waypoints: Vec<WaypointNear> = stored.waypoints.iter().map(empty).collect();
    for force in &stored.forces {
        if let Some(waypoint) = waypoints.get_mut(force.waypoint) {
            waypoint.near.push(Near {
                structure: force.structure,
                gap_mm: force.distance_mm - radius_mm,
                toward: base_from_ct.rotate(&force.toward),
                force_n: force.force_toward_n,
            });
        }
    }
    waypoints
}
