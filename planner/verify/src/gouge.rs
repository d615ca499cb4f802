//! Checks on the fine lattice that the burr's sweep leaves obstacle bone standing, and that links remove nothing.
//!
//! Obstacle bone may lie inside the sweep by at most the band, within which a scan does not tell bone from air; its volume is
//! reported. Links and retracts must not reach anything with mass, in the target or outside, before a cut does, except for
//! what lies between the points of the planner's grid.

use bonemill_planfile::StoredPlan;
use nalgebra::Vector3;

use super::carve::{MoveSegment, NEVER, Removed, deepest};
use super::check::{Check, Place};
use super::lattice::{HAS_MASS, OBSTACLE, SHEET, SLIVER};
use super::moves::{Executed, MoveClass, Moves, angle_rad};

/// Largest volume that links may remove between the points of the planner's grid, as a share of the removed volume.
const LINK_SHARE: f64 = 5e-4;
/// For the sweep, rows of the trajectory are joined to stretches of at most this length, mm.
const STRETCH_MM: f64 = 0.1;

/// Checks gouging by the moves and by the trajectory, and links through material.
pub fn gouge(
    plan: &StoredPlan,
    removed: &Removed,
    moves: &Moves,
    executed: &Executed,
    band_mm: f64,
) -> Vec<Check> {
    let Removed { lattice, pieces, first } = *removed;
    let radius = plan.record.case.burr.radius_mm;
    let is_obstacle = |n: usize| lattice.class[n] & OBSTACLE != 0;
    let by_moves = deepest(&lattice.grid, pieces, radius, |n, _| first[n] != NEVER && is_obstacle(n));
    let stretches = stretches(executed);
    let by_arm = deepest(&lattice.grid, &stretches, radius, |n, _| is_obstacle(n));
    let volume = |flags| lattice.volume_mm3(flags, |n| first[n] != NEVER);
    let said = |name| plan.record.metrics.number(name).unwrap_or(f64::NAN);
    let gouge = |name, found: Option<(f64, usize, u32)>| {
        Check::at_most(name, found.map_or(0.0, |f| f.0), band_mm, "mm deep")
    };
    let row_place = |row: u32| Place::Instant {
        time_s: plan.trajectory.time_s.get(row as usize).copied().unwrap_or(0.0),
        waypoint: executed.next.get(row as usize).copied().unwrap_or(0) as usize,
    };
    vec![
        gouge("bone outside the target, by moves", by_moves)
            .at(by_moves.map(|f| Place::Waypoint(f.2 as usize)))
            .noting(format!(
                "untargeted_bone_by_points_mm3 = {:.2}, counted at points {} mm apart: {:.2} mm³ of specks and sheets and {:.2} mm³ of \
                 other bone, all within the band unless this fails; the plan's untargeted_bone_by_voxels_mm3 = {voxels:.2}, counted at \
                 voxel centres {spacing} mm apart, {deepest:.3} mm deep",
                volume(OBSTACLE | SHEET),
                lattice.spacing_mm(),
                volume(SHEET),
                volume(OBSTACLE),
                spacing = plan.record.case.grid.spacing_mm,
                voxels = said("untargeted_bone_by_voxels_mm3"),
                deepest = said("deepest_in_obstacle_mm"),
            )),
        gouge("bone outside the target, by the arm", by_arm).at(by_arm.map(|f| row_place(f.2))),
    ]
    .into_iter()
    .chain(links(plan, removed, moves))
    .collect()
}

/// The largest depth to which a link or retract reaches material that no earlier move reached, and the volume of all such
/// material, except for what links beyond the tilt limit remove as their rows' masses say: what removes material is a cut, but a cut
/// keeps the limit.
fn links(plan: &StoredPlan, reached: &Removed, moves: &Moves) -> [Check; 2] {
    let Removed { lattice, pieces, first } = *reached;
    let radius = plan.record.case.burr.radius_mm;
    let is_free = |number: u32| moves.kinds.get(number as usize) == Some(&MoveClass::Free);
    let has_mass = |n: usize| lattice.is(n, HAS_MASS) && !lattice.is(n, SLIVER);
    let taken = |n: usize| has_mass(n) && first[n] != NEVER && is_free(first[n]);
    let free: Vec<MoveSegment> = pieces.iter().filter(|p| is_free(p.number)).copied().collect();
    let found = deepest(&lattice.grid, &free, radius, |n, number| first[n] == number && taken(n));
    let limit_rad = plan.record.case.orientation.tilt_limit_rad;
    let is_said = |number: u32| {
        let mut axes = moves.ends(number as usize).into_iter().map(|n| &moves.axes[n]);
        plan.waypoints[number as usize].mass_mg > 0.0
            && axes.any(|axis| angle_rad(axis, &Vector3::z()) > limit_rad)
    };
    let said: Vec<bool> = (0..moves.len() as u32).map(|number| is_free(number) && is_said(number)).collect();
    let volume = lattice.volume_mm3(HAS_MASS, |n| taken(n) && !said[first[n] as usize]);
    let removed = lattice.volume_mm3(HAS_MASS, |n| first[n] != NEVER);
    // a lattice point may be this far from a point of the planner's grid
    let spacing = plan.record.case.grid.spacing_mm;
    let unseen_mm = 0.5 * 3f64.sqrt() * spacing;
    let place = found.map(|f| Place::Waypoint(f.2 as usize));
    // plus one spherical cap cut into a face that lies between two planes of its points
    let bite = std::f64::consts::PI * (0.5 * spacing).powi(2) * radius;
    let limit = LINK_SHARE * removed + spacing.powi(3) + bite;
    [
        Check::at_most("links in bone", found.map_or(0.0, |f| f.0), unseen_mm, "mm deep")
            .of("depth")
            .at(place.clone()),
        Check::at_most("links in bone", volume, limit, "mm³").of("in all").at(place),
    ]
}

/// The trajectory's polyline with fewer points; a stretch's number is the row at which it ends.
fn stretches(executed: &Executed) -> Vec<MoveSegment> {
    let mut found = Vec::new();
    let mut from: Option<Vector3<f64>> = None;
    for (row, p) in executed.points.iter().enumerate() {
        let a = *from.get_or_insert(*p);
        if (p - a).norm() >= STRETCH_MM || row + 1 == executed.len() {
            found.push(MoveSegment { a, b: *p, number: row as u32 });
            from = Some(*p);
        }
    }
    found
}
