//! A second opinion on a finished plan: checks by code that did not make the plan.
//!
//! The checks start from the result. Forward kinematics turns the trajectory into poses of the burr; the burr's sweep is
//! tested point by point on a lattice of half the planner's spacing; the shank is tested against everything that still
//! stands at each moment; distances to structures are exact to their label boxes; and every figure that the plan states is
//! computed again. Volumes are counted on the planner's own voxels, so that a correct figure needs no tolerance. A [`Check`]
//! holds its value, its limit, the margin and the place of the worst value.
//!
//! Shared with the planner are frames and grids, the NIfTI reader, the arm's forward kinematics, and the reader of plan
//! files. Not shared are path, space, access, orientation, removal, engagement, pipeline and time law; Cargo and a test of the
//! source tree enforce this. Definitions are those of the plan format: closed label boxes, obstacle bone without specks and
//! without sheets thinner than the band within the band of the target; soft tissue outside the target is free.
//!
//! Not checked: whether the CT shows the patient; whether the registration is correct (only its fiducials' positions, their
//! fit and the expected error; the uncertainty module computes the effect of errors); forces in newtons (only their
//! consistency); collisions of the arm's links (only their height above the mounting plane).
//!
//! Invariants: checks are independent of each other; equal plans give equal bytes on any number of threads.

mod anatomy;
mod boxes;
mod bricks;
mod carve;
mod channel;
mod check;
mod clearance;
mod columns;
mod edge;
mod edt;
mod error;
mod figures;
mod follow;
mod forces;
mod gouge;
mod lattice;
mod links;
mod motion;
mod moves;
mod provenance;
mod reach;
mod registration;
mod requirements;
mod rest;
mod result;
mod shaft;
pub mod uncertainty;
mod voxels;

use bonemill_geometry::{Ct, Grid, Point, Rigid, Work};
use nalgebra::Vector3;

pub(crate) use anatomy::Anatomy;
pub(crate) use boxes::Boxes;
pub use check::{Check, LimitSide, Place, Short};
pub use error::VerifyError;
pub use result::Verification;

use anatomy::BoxExtent;
use bonemill_geometry::Progress;
use bonemill_planfile::{StoredPlan, digests, read_case_text};
use lattice::{FineLattice, Obstacle, grid_over};
use motion::MotionLimits;
use moves::{Executed, Moves};
use voxels::Voxels;

/// Largest number of points of the fine lattice: about 1.5 GB.
const MOST_POINTS: f64 = 8e7;
/// Rounding by which a planning grid may be smaller than the target, voxels.
const GRID_ROUNDING: f64 = 1e-3;
/// The shank's distance to a structure is computed up to this much beyond its clearance, mm.
const SHANK_LOOK_MM: f64 = 1.0;
/// Rounding of a clearance that was written, mm.
const CLEARANCE_ROUNDING_MM: f64 = 1e-9;

/// Verifies a plan.
///
/// Reads the plan's images again. A plan that fails is not an error: its [`Verification`] tells which checks failed.
///
/// # Errors
/// [`VerifyError`] when there is nothing to verify or an image cannot be read.
pub fn verify(plan: &StoredPlan, progress: &dyn Progress) -> Result<Verification, VerifyError> {
    if plan.waypoints.is_empty() || plan.trajectory.is_empty() {
        return Err(VerifyError::Empty);
    }
    // before anything is judged: a file that is changed meanwhile does not get the verdict
    let files = digests(&plan.dir)?;
    let case = &plan.record.case;
    progress.stage("read images");
    let anatomy = Anatomy::read(plan)?;
    let boxes: Vec<Option<Boxes<'_>>> =
        anatomy.kept.iter().map(|kept| Boxes::new(&anatomy.labels, kept.label)).collect();
    let mut checks = provenance::provenance(plan, &read_case_text(plan)?)?;
    checks.extend(registration::registration(&plan.record, &anatomy, &boxes));

    progress.stage("check motion");
    let moves = Moves::new(plan);
    let executed = Executed::new(plan, &moves)?;
    let limits = MotionLimits {
        arm: &plan.arm,
        rate_hz: case.robot.rate_hz,
        end_s: moves.times_s.last().copied().unwrap_or(0.0),
    };
    checks.extend(motion::motion(&plan.trajectory, &limits));
    checks.extend(follow::follow(plan, &moves, &executed)?);
    checks.extend(follow::speeds(plan, &moves, &executed));
    checks.extend(links::links(plan, &executed)?);
    if let Some(spec) = case.job.channel() {
        let looked_at = channel::LookedAt { plan, spec, anatomy: &anatomy, boxes: &boxes };
        checks.extend(looked_at.checks(&moves, &executed, progress)?);
        return Ok(Verification { checks, files });
    }

    progress.stage("check rows");
    checks.extend(columns::rows(plan, &moves, &executed));
    checks.extend(columns::structures(plan, &anatomy.kept, &boxes));
    checks.extend(forces::forces(plan, &anatomy.kept, &boxes));
    checks.extend(figures::totals(plan, &moves));
    checks.extend(requirements::requirements(plan, &moves));

    progress.stage("check clearances");
    checks.extend(clearances(plan, &anatomy, &boxes, &moves, &executed));

    progress.stage("classify bone");
    let ct_from_grid = &plan.record.frames.ct_from_grid();
    let grid_from_ct = ct_from_grid.inverse();
    let aim = anatomy.aim_box(&grid_from_ct).ok_or(VerifyError::NoTarget)?;
    let spacing = case.grid.spacing_mm;
    let band_mm =
        [anatomy.ct.grid().diagonal_mm(), anatomy.labels.grid().diagonal_mm(), spacing * 3f64.sqrt()]
            .into_iter()
            .fold(0.0, f64::max);
    let (grid, missed) = fine_grid(plan, &anatomy, &aim, &moves, band_mm)?;
    checks.push(Check::none_wrong("burr stays where it is checked", missed).noting(if missed > 0 {
        "waypoints too far from the target for the lattice"
    } else {
        ""
    }));
    checks.push(Check::at_most("lattice spacing", grid.spacing_mm().x, spacing, "mm"));
    let (voxels, beyond_mm) = planned_voxels(plan, &anatomy)?;
    let rule = Obstacle { band_mm, sheets: case.sheets };
    let fine = FineLattice::new(&anatomy, &case.density, grid, &voxels, &rule)?;

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
    let edge_mm2 = edge::edge_bone_mm2(&anatomy, case.density.bone_hu, &voxels, 2.0 * case.burr.radius_mm);
    checks.extend(figures::beyond_scan(plan, &voxels, edge_mm2));

    progress.stage("remove bone");
    let radius = case.burr.radius_mm;
    let first = carve::first_moves(&fine.grid, &pieces, radius);
    let removed = carve::Removed { lattice: &fine, pieces: &pieces, first: &first };
    checks.extend(gouge::gouge(plan, &removed, &moves, &executed, band_mm));
    checks.extend(figures::resolution(plan, &fine, &first, &voxels, &swept));
    checks.extend(figures::masses(plan, &anatomy, &voxels, &removed, &moves));
    drop((voxels, swept, reachable));

    progress.stage("check shank");
    let cylinders = shaft::cylinders(case);
    let poses = shaft::poses(plan, &moves, &executed);
    let standing = shaft::standing(&fine, &first);
    let far = shaft::far_bone(&anatomy, case, &fine, &grid_from_ct);
    checks.extend(shaft::against_bone(&poses, &cylinders, &standing, &far, ct_from_grid));
    drop((standing, far, first, fine));
    for (kept, boxes) in anatomy.kept.iter().zip(&boxes) {
        let Some(boxes) = boxes else { continue };
        // with a clearance of 0 the shank must still not touch, so the certain distance must be above 0
        let limit = kept.shank_clearance_mm.max(f64::MIN_POSITIVE);
        let most_mm = kept.shank_clearance_mm + SHANK_LOOK_MM;
        let found = shaft::against_structure(&poses, &cylinders, boxes, ct_from_grid, most_mm);
        let (least, place) = found.unwrap_or((most_mm, None));
        let check = Check::at_least("clearance of the shank", least, limit, "mm").of(kept.name.clone());
        let note = if place.is_none() { "or more" } else { "" };
        checks.push(check.at(place).noting(note));
    }
    Ok(Verification { checks, files })
}

/// Checks the burr's distance from every structure, along the moves and along the trajectory.
fn clearances(
    plan: &StoredPlan,
    anatomy: &Anatomy,
    boxes: &[Option<Boxes<'_>>],
    moves: &Moves,
    executed: &Executed,
) -> Vec<Check> {
    let radius = plan.record.case.burr.radius_mm;
    let ct_from_grid = plan.record.frames.ct_from_grid();
    let mut checks = Vec::new();
    for (kept, boxes) in anatomy.kept.iter().zip(boxes) {
        let name = kept.name.clone();
        let Some(boxes) = boxes else {
            checks.push(Check::none_wrong("structures are in the label map", 1).of(name));
            continue;
        };
        let limit = kept.clearance_mm - CLEARANCE_ROUNDING_MM;
        let nearest = |points| clearance::nearest_along(boxes, &ct_from_grid, points);
        if let Some(n) = nearest(&moves.points) {
            let check = Check::at_least("clearance of moves", n.distance_mm - radius, limit, "mm");
            checks.push(check.of(name.clone()).at(Place::Waypoint(n.at)));
        }
        if let Some(n) = nearest(&executed.points) {
            let place = Place::Instant {
                time_s: plan.trajectory.time_s[n.at],
                waypoint: executed.next[n.at] as usize,
            };
            let check = Check::at_least("clearance of the arm's burr", n.distance_mm - radius, limit, "mm");
            checks.push(check.of(name).at(place));
        }
    }
    checks
}

/// The fine lattice over target and sweep, inside the scan, and the number of waypoints outside it.
fn fine_grid(
    plan: &StoredPlan,
    anatomy: &Anatomy,
    aim: &[Vector3<f64>; 2],
    moves: &Moves,
    band_mm: f64,
) -> Result<(Grid<Work>, usize), VerifyError> {
    let case = &plan.record.case;
    let reach_mm = case.burr.radius_mm + band_mm + case.grid.spacing_mm;
    let room = LatticeBounds {
        aim,
        scan: &scan_box(anatomy, &plan.record.frames.ct_from_grid().inverse()),
        reach_mm,
        around_mm: reach_mm + case.grid.margin_mm + 2.0 * case.burr.radius_mm,
        most_points: MOST_POINTS,
    };
    let (corners, h, missed) = room.fine_box(&moves.points, 0.5 * case.grid.spacing_mm);
    Ok((grid_over(corners, h, 0.5 * h)?, missed))
}

/// The limits of the fine lattice. Boxes are given by smallest and largest corner, mm in work.
struct LatticeBounds<'a> {
    /// The target.
    aim: &'a [Vector3<f64>; 2],
    /// The images, beyond which there is air.
    scan: &'a [Vector3<f64>; 2],
    /// Margin around the sweep, mm.
    reach_mm: f64,
    /// Margin around the target if the sweep is too wide, mm.
    around_mm: f64,
    /// Largest number of points that fits into memory.
    most_points: f64,
}

impl LatticeBounds<'_> {
    /// The box, its spacing (`finest_mm`, or as fine as memory allows), and the number of waypoints in the scan outside it.
    fn fine_box(&self, points: &[Vector3<f64>], finest_mm: f64) -> ([Vector3<f64>; 2], f64, usize) {
        let clip = |[lo, hi]: [Vector3<f64>; 2]| {
            [lo.sup(&self.scan[0]).inf(&self.aim[0]), hi.inf(&self.scan[1]).sup(&self.aim[1])]
        };
        let count = |[lo, hi]: [Vector3<f64>; 2], h: f64| (hi - lo).map(|l| l / h + 2.0).product();
        let around = Vector3::repeat(self.around_mm);
        let near = clip([self.aim[0] - around, self.aim[1] + around]);
        let mut h = finest_mm;
        while count(near, h) > self.most_points {
            h *= 1.25;
        }
        let mut extent = BoxExtent::default();
        points.iter().chain(self.aim).for_each(|p| extent.hold(*p));
        let whole = clip(extent.grown(&Vector3::repeat(self.reach_mm)).unwrap_or(*self.aim));
        if count(whole, h) <= self.most_points {
            return (whole, h, 0);
        }
        let is_in =
            |p: &Vector3<f64>, [lo, hi]: &[Vector3<f64>; 2]| (0..3).all(|a| p[a] >= lo[a] && p[a] <= hi[a]);
        (near, h, points.iter().filter(|p| is_in(p, self.scan) && !is_in(p, &near)).count())
    }
}

/// The planner's voxels, and how far the target with the burr around it extends beyond them, mm.
fn planned_voxels(plan: &StoredPlan, anatomy: &Anatomy) -> Result<(Voxels, f64), VerifyError> {
    let case = &plan.record.case;
    let (dims, h) = (plan.record.frames.grid.dims, case.grid.spacing_mm);
    let ct_from_grid = plan.record.frames.ct_from_grid();
    let [lo, hi] = anatomy.aim_box(&ct_from_grid.inverse()).ok_or(VerifyError::NoTarget)?;
    let size = Vector3::from(dims.map(|d| d as f64)) * h;
    // voxels extend half a spacing beyond their centres
    let below = Vector3::repeat(case.burr.radius_mm - 0.5 * h) - lo;
    let above = hi + Vector3::repeat(case.burr.radius_mm + 0.5 * h) - size;
    // because of rounding, the planner's grid may be smaller by this part of a voxel
    let beyond_mm = below.sup(&above).max() - GRID_ROUNDING * h;
    let grid = Grid::aligned(dims, h, Point::new(0.0, 0.0, 0.0))?;
    Ok((Voxels::new(anatomy, &case.density, ct_from_grid, grid)?, beyond_mm.max(0.0)))
}

/// The box of CT and label map along work's axes.
fn scan_box(anatomy: &Anatomy, grid_from_ct: &Rigid<Work, Ct>) -> [Vector3<f64>; 2] {
    let mut extent = BoxExtent::default();
    for corner in anatomy.ct.grid().corners().into_iter().chain(anatomy.labels.grid().corners()) {
        extent.hold((*grid_from_ct * corner).coords);
    }
    extent.grown(&Vector3::zeros()).unwrap_or([Vector3::zeros(); 2])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_fine_lattice_follows_the_sweep_as_far_as_memory_goes() {
        let cube = |r: f64| [Vector3::repeat(-r), Vector3::repeat(r)];
        let (aim, scan) = (cube(5.0), cube(100.0));
        let room = |most_points| LatticeBounds {
            aim: &aim,
            scan: &scan,
            reach_mm: 3.0,
            around_mm: 8.0,
            most_points,
        };
        let near = [Vector3::new(0.0, 0.0, 9.0)];
        let ([lo, hi], h, missed) = room(2e6).fine_box(&near, 0.25);
        assert_eq!((lo.z, hi.z, h, missed), (-8.0, 12.0, 0.25, 0));
        // a waypoint far away in the scan is outside the lattice; one beyond the scan is in air
        let far = [Vector3::new(0.0, 90.0, 0.0), Vector3::new(0.0, 0.0, 5000.0)];
        let ([lo, hi], h, missed) = room(2e6).fine_box(&far, 0.25);
        assert_eq!((lo.y, hi.y, h, missed), (-13.0, 13.0, 0.25, 1));
        // a target too large for memory gets a coarser lattice, and a check reports it
        let (_, h, _) = room(1e4).fine_box(&near, 0.25);
        assert!(h > 1.0, "{h}");
        assert!(!Check::at_most("lattice spacing", h, 0.5, "mm").passed());
    }
}
