//! Verifies a plan that mills a target in layers.

use bonemill_geometry::Progress;

use super::bricks::Cylinder;
use super::check::{Check, Place};
use super::extents::{fine_grid, planned_voxels};
use super::lattice::{FineLattice, Obstacle};
use super::{
    Boxes, Evidence, VerifyError, carve, clearance, columns, driven, edge, figures, forces, gouge,
    provenance, reach, requirements, rest, shaft, voxels,
};

/// The shank's distance to a structure is computed up to this much beyond its clearance, mm.
const SHANK_LOOK_MM: f64 = 1.0;
/// Rounding of a clearance that was written, mm.
const CLEARANCE_ROUNDING_MM: f64 = 1e-9;

/// The checks that only a milled target has.
///
/// # Errors
/// [`VerifyError`] for a target that the images lack.
pub fn checks(evidence: &Evidence, progress: &dyn Progress) -> Result<Vec<Check>, VerifyError> {
    let Evidence { plan, anatomy, boxes, moves, executed, .. } = *evidence;
    progress.stage("check rows");
    let mut checks = provenance::choices(plan);
    checks.extend(columns::rows(plan, moves, executed));
    checks.extend(columns::structures(plan, &anatomy.kept, boxes));
    checks.extend(forces::forces(plan, &anatomy.kept, boxes));
    checks.extend(figures::totals(plan, moves));
    checks.extend(requirements::requirements(plan, moves));

    progress.stage("check forces");
    checks.extend(driven::checks(evidence)?);

    progress.stage("check clearances");
    checks.extend(clearances(evidence));
    checks.extend(bone(evidence, progress)?);
    Ok(checks)
}

/// Checks the burr's distance from every structure, along the moves and along the trajectory.
fn clearances(evidence: &Evidence) -> Vec<Check> {
    let Evidence { plan, moves, executed, .. } = *evidence;
    let radius = plan.record.case.burr.radius_mm;
    let ct_from_grid = plan.record.frames.ct_from_grid();
    evidence.of_structures(|kept, boxes| {
        let limit = kept.clearance_mm - CLEARANCE_ROUNDING_MM;
        let check = |subject, points, place: &dyn Fn(usize) -> Place| {
            let n = clearance::nearest_along(boxes, &ct_from_grid, points)?;
            let check = Check::at_least(subject, n.distance_mm - radius, limit, "mm");
            Some(check.of(kept.name.clone()).at(place(n.at)))
        };
        let moves = check("clearance of moves", &moves.points, &Place::Waypoint);
        let arm = check("clearance of the arm's burr", &executed.points, &|row| evidence.instant(row));
        moves.into_iter().chain(arm).collect()
    })
}

/// Classifies the bone anew, removes it along the moves, and checks volumes, gouges, masses and the shank against it.
fn bone(evidence: &Evidence, progress: &dyn Progress) -> Result<Vec<Check>, VerifyError> {
    let Evidence { plan, anatomy, target, boxes, moves, executed } = *evidence;
    progress.stage("classify bone");
    let case = &plan.record.case;
    let mut checks = Vec::new();
    let ct_from_grid = &plan.record.frames.ct_from_grid();
    let grid_from_ct = ct_from_grid.inverse();
    let wanted = anatomy.aim_box(&grid_from_ct).ok_or(VerifyError::NoTarget)?;
    let spacing = case.grid.spacing_mm;
    let band_mm =
        [anatomy.ct.grid().diagonal_mm(), anatomy.labels.grid().diagonal_mm(), spacing * 3f64.sqrt()]
            .into_iter()
            .fold(0.0, f64::max);
    let (grid, missed) = fine_grid(plan, anatomy, &wanted, moves, band_mm)?;
    checks.push(Check::none_wrong("burr stays where it is checked", missed).noting(if missed > 0 {
        "waypoints too far from the target for the lattice"
    } else {
        ""
    }));
    checks.push(Check::at_most("lattice spacing", grid.spacing_mm().x, spacing, "mm"));
    let (voxels, beyond_mm) = planned_voxels(plan, target)?;
    let rule = Obstacle { band_mm, sheets: case.sheets };
    let fine = FineLattice::new(target, &case.density, grid, &voxels, &rule)?;

    progress.stage("count voxels");
    let pieces = carve::pieces(&moves.points);
    checks.push(Check::at_most("planning grid around the target", beyond_mm, voxels::DOUBT_MM, "mm beyond"));
    let swept = carve::swept(&voxels.grid, &pieces, case.burr.radius_mm);
    let kept: Vec<(&Boxes<'_>, f64)> = boxes
        .iter()
        .zip(&anatomy.kept)
        .filter_map(|(boxes, kept)| Some((boxes.as_ref()?, kept.clearance_mm)))
        .collect();
    let reachable = reach::reachable(case, &kept, &voxels, band_mm);
    checks.extend(figures::volumes(plan, &voxels, &swept, &reachable));
    let open =
        if kept.is_empty() { reachable.clone() } else { reach::reachable(case, &[], &voxels, band_mm) };
    let sets = rest::Sets { swept: &swept, reachable: &reachable, open: &open };
    checks.extend(rest::target_share(plan, &voxels, &sets));
    drop(open);
    let edge_mm2 = edge::edge_bone_mm2(anatomy, case.density.bone_hu, &voxels, 2.0 * case.burr.radius_mm);
    checks.extend(figures::beyond_scan(plan, &voxels, edge_mm2));

    progress.stage("remove bone");
    let radius = case.burr.radius_mm;
    let first = carve::first_moves(&fine.grid, &pieces, radius);
    let removed = carve::Removed { lattice: &fine, pieces: &pieces, first: &first };
    checks.extend(gouge::gouge(plan, &removed, moves, executed, band_mm));
    checks.extend(figures::resolution(plan, &fine, &first, &voxels, &swept));
    checks.extend(figures::masses(plan, anatomy, &voxels, &removed, moves));
    drop((voxels, swept, reachable));

    progress.stage("check shank");
    let cylinders = shaft::cylinders(case);
    let poses = shaft::poses(plan, moves, executed);
    let standing = shaft::standing(&fine, &first);
    let far = shaft::far_bone(target, case, &fine, &grid_from_ct);
    checks.extend(shaft::against_bone(&poses, &cylinders, &standing, &far, ct_from_grid));
    drop((standing, far, first, fine));
    checks.extend(shank_clearances(evidence, &poses, &cylinders));
    Ok(checks)
}

/// Checks the shank's distance from every structure.
fn shank_clearances(evidence: &Evidence, poses: &[shaft::ShankPose], cylinders: &[Cylinder]) -> Vec<Check> {
    let Evidence { plan, anatomy, boxes, .. } = *evidence;
    let ct_from_grid = &plan.record.frames.ct_from_grid();
    let mut checks = Vec::new();
    for (kept, boxes) in anatomy.kept.iter().zip(boxes) {
        let Some(boxes) = boxes else { continue };
        // with a clearance of 0 the shank must still not touch, so the certain distance must be above 0
        let limit = kept.shank_clearance_mm.max(f64::MIN_POSITIVE);
        let most_mm = kept.shank_clearance_mm + SHANK_LOOK_MM;
        let found = shaft::against_structure(poses, cylinders, boxes, ct_from_grid, most_mm);
        let (least, place) = found.unwrap_or((most_mm, None));
        let check = Check::at_least("clearance of the shank", least, limit, "mm").of(kept.name.clone());
        let note = if place.is_none() { "or more" } else { "" };
        checks.push(check.at(place).noting(note));
    }
    checks
}
