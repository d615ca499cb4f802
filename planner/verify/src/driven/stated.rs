//! Compares the driven force with the forces that the plan states: their peaks and their means by time.
//!
//! A peak is stated of every move; the driven one must not be larger, wherever it occurs: between waypoints, in a corner, in a
//! link. A mean is stated of the moves that remove something, each with its time; the driven one must not be larger.

use bonemill_planfile::StoredPlan;
use nalgebra::Vector3;
use rayon::prelude::*;

use super::super::anatomy::Kept;
use super::super::check::{Check, Short};
use super::super::columns::INFLUENCE_MM;
use super::super::figures::stated;
use super::super::forces::{NEAR_MM, took_s};
use super::super::moves::MoveClass;
use super::super::{Boxes, Evidence};
use super::{DrivenForce, Instant, accepted_n};

/// A mean near a structure is small and of few cuts: the driven one may be larger by this share and this much, N.
const NEAR_MEAN: [f64; 2] = [0.2, 1e-3];

/// The checks of peaks and means.
pub fn checks(evidence: &Evidence, force: &DrivenForce) -> Vec<Check> {
    let plan = evidence.plan;
    let largest = force.largest(|instant| Some(instant.end_n().norm()));
    let row_n = |waypoint: usize| plan.waypoints.get(waypoint).map_or(0.0, |w| w.peak_force_n);
    let mut checks = vec![peak(evidence, &["peak_force_n"], largest, row_n)];
    let cutting = |waypoint: usize| plan.waypoints.get(waypoint).is_some_and(|w| w.mass_mg > 0.0);
    let sum_ns = force.sum_ns(evidence, cutting, |instant| instant.mean_n().norm());
    checks.push(mean(plan, &["mean_force_n"], (sum_ns, accepted_n), cutting));
    for (n, boxes) in evidence.boxes.iter().enumerate() {
        let (Some(boxes), Some(kept)) = (boxes, evidence.anatomy.kept.get(n)) else { continue };
        checks.extend(toward(evidence, force, n, boxes, kept));
    }
    checks
}

/// The checks of the forces toward structure `n`: at any distance up to its influence, and near it.
fn toward(evidence: &Evidence, force: &DrivenForce, n: usize, boxes: &Boxes<'_>, kept: &Kept) -> Vec<Check> {
    let radius_mm = evidence.plan.record.case.burr.radius_mm;
    let influence_mm = kept.clearance_mm + INFLUENCE_MM;
    let toward = force.toward(evidence, boxes, radius_mm + influence_mm.max(NEAR_MM));
    let tables = [(None, influence_mm), (Some("near"), NEAR_MM)];
    let within = |(table, most_mm)| {
        let span = Span { n, table, name: &kept.name, most_mm: radius_mm + most_mm };
        span.checks(evidence, force, &toward)
    };
    tables.into_iter().flat_map(within).collect()
}

/// The forces toward one structure while the burr's centre is within a distance of it.
struct Span<'a> {
    /// The structure's index and name.
    n: usize,
    name: &'a str,
    /// The table of the plan's figures.
    table: Option<&'a str>,
    most_mm: f64,
}

impl Span<'_> {
    fn keys(&self, key: &'static str) -> Vec<&str> {
        ["structures", self.name].into_iter().chain(self.table).chain([key]).collect()
    }

    fn checks(&self, evidence: &Evidence, force: &DrivenForce, toward: &[Option<Toward>]) -> Vec<Check> {
        let plan = evidence.plan;
        // what is stated of each waypoint within the distance, N
        let mut rows_n = vec![None; plan.waypoints.len()];
        for row in plan.forces.iter().filter(|f| f.structure == self.n && f.distance_mm <= self.most_mm) {
            if let Some(row_n) = rows_n.get_mut(row.waypoint) {
                *row_n = Some(row.peak_toward_n);
            }
        }
        let row_n = |waypoint: usize| rows_n.get(waypoint).copied().flatten();
        let of = |instant: &Instant, force_n: Vector3<f64>| {
            let toward = toward[instant.index].filter(|toward| toward.distance_mm <= self.most_mm)?;
            Some(force_n.dot(&toward.direction).max(0.0))
        };
        // a cut that ends beyond the distance is stated there
        let is_stated = |waypoint: usize| {
            evidence.moves.kinds.get(waypoint) != Some(&MoveClass::Cut) || row_n(waypoint).is_some()
        };
        let largest = force.largest(|instant| {
            of(instant, instant.end_n()).filter(|_| is_stated(instant.waypoint(evidence)))
        });
        let is_counted = |waypoint: usize| {
            row_n(waypoint).is_some() && plan.waypoints.get(waypoint).is_some_and(|w| w.mass_mg > 0.0)
        };
        let sum_ns =
            force.sum_ns(evidence, is_counted, |instant| of(instant, instant.mean_n()).unwrap_or(0.0));
        let near_n = |n: f64| n * (1.0 + NEAR_MEAN[0]) + NEAR_MEAN[1];
        let accepted = if self.table.is_some() { near_n } else { accepted_n };
        vec![
            peak(evidence, &self.keys("peak_force_toward_n"), largest, |waypoint| {
                row_n(waypoint).unwrap_or(0.0)
            }),
            mean(plan, &self.keys("mean_force_toward_with_zeros_n"), (sum_ns, accepted), is_counted),
        ]
    }
}

/// Compares the largest driven force with a stated peak. `row_n`: what is stated of a waypoint, N.
fn peak(
    evidence: &Evidence,
    keys: &[&str],
    largest: Option<(f64, &Instant)>,
    row_n: impl Fn(usize) -> f64,
) -> Check {
    let plan = evidence.plan;
    let stated_n = stated(plan, keys).unwrap_or(f64::NAN);
    let driven_n = largest.map_or(0.0, |found| found.0);
    let check = Check::at_most("driven force", driven_n, accepted_n(stated_n), "N").of(keys.join("."));
    let Some((_, instant)) = largest else { return check };
    let waypoint = instant.waypoint(evidence);
    check.at(instant.place(evidence)).noting(format!(
        "states {} N, and {} N at that waypoint at {} mm/s; driven {} N at {} mm/s",
        Short(stated_n),
        Short(row_n(waypoint)),
        Short(plan.waypoints.get(waypoint).map_or(0.0, |row| row.driven_mm_s)),
        Short(driven_n),
        Short(instant.step.end_mm_s)
    ))
}

/// Compares a driven mean with a stated one. `sum_ns`: the driven force over time, N s, during the moves that are counted; `accepted`: what
/// the mean may be for a stated one, N.
fn mean(
    plan: &StoredPlan,
    keys: &[&str],
    (sum_ns, accepted): (f64, fn(f64) -> f64),
    is_counted: impl Fn(usize) -> bool,
) -> Check {
    let stated_n = stated(plan, keys).unwrap_or(f64::NAN);
    let time_s: f64 = (0..plan.waypoints.len()).filter(|n| is_counted(*n)).map(|n| took_s(plan, n)).sum();
    let driven_n = if time_s > 0.0 { sum_ns / time_s } else { 0.0 };
    Check::at_most("driven mean force", driven_n, accepted(stated_n), "N")
        .of(keys.join("."))
        .noting(format!("states {} N", Short(stated_n)))
}

/// Where a structure is, seen from the burr.
#[derive(Debug, Clone, Copy)]
pub struct Toward {
    /// Distance of the burr's centre, mm.
    pub distance_mm: f64,
    /// Unit direction to its nearest point, in work.
    pub direction: Vector3<f64>,
}

impl DrivenForce<'_> {
    /// Where a structure is at every instant; `None` where it is farther than `within_mm` from the burr's centre.
    pub fn toward(&self, evidence: &Evidence, boxes: &Boxes<'_>, within_mm: f64) -> Vec<Option<Toward>> {
        let ct_from_grid = evidence.plan.record.frames.ct_from_grid();
        let grid_from_ct = ct_from_grid.inverse();
        let at = |instant: &Instant| {
            let center = ct_from_grid * instant.center();
            let (distance_mm, nearest) = boxes.nearest_within(center, within_mm)?;
            let direction = grid_from_ct.rotate(&(nearest - center)).try_normalize(1e-9)?;
            Some(Toward { distance_mm, direction })
        };
        self.instants.par_iter().map(at).collect()
    }

    /// The sum of a force times the time of its step, N s, over the instants of the counted moves.
    fn sum_ns(
        &self,
        evidence: &Evidence,
        is_counted: impl Fn(usize) -> bool,
        of: impl Fn(&Instant) -> f64,
    ) -> f64 {
        let waypoint = |instant: &Instant| evidence.executed.waypoint_at(instant.step.middle_row);
        let counted = self.instants.iter().filter(|instant| is_counted(waypoint(instant)));
        counted.map(|instant| of(instant) * instant.step.took_s).sum()
    }
}
