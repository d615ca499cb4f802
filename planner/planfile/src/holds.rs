//! Where a streamed plan holds: each `[[hold]]` of its case as a row of the trajectory.
//!
//! The arm holds before the first move that could bring the burr's surface nearer to the structure than the hold's distance.
//!
//! Not here: how far the burr is drawn back. The burr is wider than its neck, so that the way along the shaft is free only as far
//! as it was milled; the way back along the rows is free, since the burr came by it.

use bonemill_cutting::cutter::MoveKind;
use nalgebra::Vector3;

use super::StoredPlan;
use super::gaps::Nearness;

/// A hold of the case, in the plan.
#[derive(Debug, Clone, PartialEq)]
pub struct HoldPoint {
    /// Place of the structure in the case.
    pub structure: usize,
    /// The hold's distance of the burr's surface to it, mm.
    pub distance_mm: f64,
    /// The first move that could come nearer: a row of `waypoints.csv`.
    pub before_waypoint: usize,
    /// The last row of `trajectory.csv` before that move begins: there the arm holds.
    pub row: usize,
    /// The row at which the burr began this pass: along the rows from here to `row` lies the way back.
    pub way_in_row: usize,
    /// From the burr along the shaft to the handpiece, unit, in base.
    pub along_shaft: Vector3<f64>,
}

/// Holds that the plan meets, in the order of its rows; one that the burr never comes near enough for has none.
pub fn hold_points(plan: &StoredPlan) -> Vec<HoldPoint> {
    let case = &plan.record.case;
    let point = |hold: &bonemill_case::Hold| {
        let structure = case.structures.iter().position(|s| s.name == hold.structure)?;
        let before_waypoint = Nearness::of(plan, structure).first_move_within(hold.distance_mm)?;
        hold_point(plan, structure, hold.distance_mm, before_waypoint)
    };
    let mut found: Vec<HoldPoint> = case.holds.iter().filter_map(point).collect();
    found.sort_by_key(|hold| hold.row);
    found
}

fn hold_point(
    plan: &StoredPlan,
    structure: usize,
    distance_mm: f64,
    before_waypoint: usize,
) -> Option<HoldPoint> {
    let before = plan.waypoints.get(..=before_waypoint.saturating_sub(1))?;
    let start = before.last()?;
    let way_in = before.iter().rev().find(|w| w.kind != MoveKind::Cut).or(before.first())?;
    let row_at = |time_s: f64| plan.trajectory.time_s.partition_point(|t| *t <= time_s).saturating_sub(1);
    Some(HoldPoint {
        structure,
        distance_mm,
        before_waypoint,
        row: row_at(start.time_s),
        way_in_row: row_at(way_in.time_s),
        along_shaft: plan.record.frames.base_from_ct.rotation * start.axis,
    })
}
