//! Checks the rows of `forces.csv`, and computes the figures made of them again.
//!
//! A row is right if the point at its distance along its direction lies in the structure, no part of the structure is nearer,
//! and its force is max(0, F·u). So the direction itself need not be computed, which is ambiguous where several points are
//! equally near.

use std::collections::HashSet;

use bonemill_planfile::{ForceToward, StoredPlan};
use rayon::prelude::*;

use super::anatomy::Kept;
use super::boxes::Boxes;
use super::check::{Check, Place};
use super::columns::{INFLUENCE_MM, ROUNDING, Worst};
use super::figures::stated;

/// Relative rounding of a sum over all moves.
const SUM_SHARE: f64 = 1e-9;
/// A burr whose surface is within this distance of a structure is near it, mm.
pub const NEAR_MM: f64 = 2.0;

/// The figures may leave out a structure that is farther from the burr's surface than the burr's radius, the largest clearance and this, mm. The
/// planner has the same rule and its own figure for it: a check shares nothing with what it checks.
const FAR_MM: f64 = 12.0;

/// Deviations of a row from the correct values.
#[derive(Debug, Clone, Copy)]
struct Off {
    distance_mm: f64,
    direction: f64,
    force_n: f64,
    peak_n: f64,
    mean_n: f64,
}

/// Checks every row, whether a row is missing or superfluous, and the figures of each structure.
pub fn forces(plan: &StoredPlan, kept: &[Kept], boxes: &[Option<Boxes<'_>>]) -> Vec<Check> {
    const NAME: &str = "forces.csv";
    let again = |row: &ForceToward| row_again(row, plan, boxes.get(row.structure).and_then(Option::as_ref));
    let off: Vec<Off> = plan.forces.par_iter().map(again).collect();
    let worst = |of: fn(&Off) -> f64, subject, unit| {
        let found = Worst::of(off.iter().map(of).enumerate());
        Worst(found.0, found.1.map(|row| plan.forces[row].waypoint)).check(NAME, subject, ROUNDING, unit)
    };
    let distances = distances(plan, boxes);
    let (wrong, first) = wrong_rows(plan, kept, &distances);
    let mut checks = vec![
        Check::none_wrong(NAME, wrong)
            .of("a row for each structure within its influence")
            .at(first.map(Place::Waypoint)),
        worst(|off| off.distance_mm, "distance_mm", "mm"),
        worst(|off| off.direction, "toward", "mm"),
        worst(|off| off.force_n, "force_toward_n", "N"),
        worst(|off| off.peak_n, "peak_toward_n", "N"),
        worst(|off| off.mean_n, "mean_toward_n", "N"),
    ];
    checks.extend(distances.iter().enumerate().flat_map(|(n, mm)| figures(plan, n, mm)));
    checks
}

fn row_again(row: &ForceToward, plan: &StoredPlan, boxes: Option<&Boxes<'_>>) -> Off {
    let (Some(boxes), Some(waypoint)) = (boxes, plan.waypoints.get(row.waypoint)) else {
        let none = f64::INFINITY;
        return Off { distance_mm: none, direction: none, force_n: none, peak_n: none, mean_n: none };
    };
    let end = waypoint.position + row.toward * row.distance_mm;
    Off {
        distance_mm: (boxes.distance_mm(waypoint.position) - row.distance_mm).abs(),
        direction: boxes.distance_mm(end).max((row.toward.norm() - 1.0).abs()),
        force_n: (waypoint.force_n.dot(&row.toward).max(0.0) - row.force_toward_n).abs(),
        // between the component where the move ends and the whole force within the move
        peak_n: (row.force_toward_n - row.peak_toward_n)
            .max(row.peak_toward_n - waypoint.peak_force_n)
            .max(0.0),
        // at most the largest within the move, and the mean of the whole force
        mean_n: (row.mean_toward_n - row.peak_toward_n)
            .max(row.mean_toward_n - waypoint.mean_force_n)
            .max(waypoint.mean_force_n - waypoint.peak_force_n)
            .max(0.0),
    }
}

/// Distance of the burr's centre at every waypoint, mm, per structure; empty for one that the label map lacks.
fn distances(plan: &StoredPlan, boxes: &[Option<Boxes<'_>>]) -> Vec<Vec<f64>> {
    let along =
        |boxes: &Boxes<'_>| plan.waypoints.par_iter().map(|w| boxes.distance_mm(w.position)).collect();
    boxes.iter().map(|boxes| boxes.as_ref().map_or(Vec::new(), along)).collect()
}

/// Number of rows that are missing or superfluous, and the first waypoint with such a row.
fn wrong_rows(plan: &StoredPlan, kept: &[Kept], distances: &[Vec<f64>]) -> (usize, Option<usize>) {
    let there: HashSet<(usize, usize)> = plan.forces.iter().map(|f| (f.waypoint, f.structure)).collect();
    let radius_mm = plan.record.case.burr.radius_mm;
    let is_wrong = |&(index, n): &(usize, usize)| {
        let (Some(kept), Some(distance_mm)) = (kept.get(n), distances[n].get(index)) else {
            return there.contains(&(index, n));
        };
        let beyond_mm = distance_mm - kept.clearance_mm - radius_mm - INFLUENCE_MM;
        let is_named = plan.waypoints[index].structure == Some(n);
        // exactly at the limit both are right
        (is_named || beyond_mm.abs() > ROUNDING)
            && there.contains(&(index, n)) != (is_named || beyond_mm < 0.0)
    };
    let all = (0..plan.waypoints.len()).flat_map(|i| (0..distances.len()).map(move |n| (i, n)));
    let wrong: Vec<_> = all.filter(is_wrong).collect();
    (wrong.len(), wrong.first().map(|(index, _)| *index))
}

/// Of a figure that is compared at the waypoint where it is said to be.
const AT_WAYPOINT: &str = " at its waypoint";

/// Checks the figures of the case's structure n, given its distances.
fn figures(plan: &StoredPlan, n: usize, distances_mm: &[f64]) -> Vec<Check> {
    let Some(structure) = plan.record.case.structures.get(n) else { return Vec::new() };
    let radius_mm = plan.record.case.burr.radius_mm;
    let said = |keys: &[&str]| stated(plan, &[&["structures", structure.name.as_str()], keys].concat());
    let mut checks = Vec::new();
    let mut check = |keys: &[&str], at: &str, [least, most]: [f64; 2]| {
        let said = said(keys);
        let off = said.map_or(f64::INFINITY, |said| (least - said).max(said - most).max(0.0));
        let subject = format!("structures.{}.{}{at}", structure.name, keys.join("."));
        let found = if least == most { format!("{most:.6}") } else { format!("{least:.6} to {most:.6}") };
        let said = said.map_or("nothing".into(), |said| format!("{said:.6}"));
        checks.push(
            Check::at_most("figures", off, ROUNDING + SUM_SHARE * most.abs(), "")
                .of(subject)
                .noting(format!("says {said}, found {found}")),
        );
    };
    let case = &plan.record.case;
    let widest_mm =
        case.structures.iter().map(|s| s.clearance_mm.max(s.shank_clearance_mm)).fold(0.0, f64::max);
    let [least, at_waypoint] = ["least_surface_distance_mm", "least_surface_distance_waypoint"];
    let is_far = |mm: &f64| {
        *mm > 2.0 * radius_mm + widest_mm + FAR_MM
            && [least, at_waypoint].iter().all(|key| said(&[key]).is_none())
    };
    if let Some(least_mm) = distances_mm.iter().copied().reduce(f64::min).filter(|mm| !is_far(mm)) {
        check(&[least], "", [least_mm - radius_mm; 2]);
        let there = said(&[at_waypoint]).and_then(|index| distances_mm.get(index as usize));
        check(&[least], AT_WAYPOINT, [there.map_or(f64::NAN, |mm| mm - radius_mm); 2]);
    }
    for (table, most_mm) in [(&[][..], structure.clearance_mm + INFLUENCE_MM), (&["near"][..], NEAR_MM)] {
        let within =
            || plan.forces.iter().filter(|f| f.structure == n && f.distance_mm - radius_mm <= most_mm);
        // (mean force toward it, time, waypoint) of every move that removes something
        let mut toward: Vec<(f64, f64, usize)> = within()
            .filter(|f| plan.waypoints.get(f.waypoint).is_some_and(|w| w.mass_mg > 0.0))
            .map(|f| (f.mean_toward_n, took_s(plan, f.waypoint), f.waypoint))
            .collect();
        toward.sort_by(|a, b| a.0.total_cmp(&b.0));
        let first = toward.iter().position(|(force, ..)| *force > 0.0).unwrap_or(toward.len());
        let peak = within().map(|f| f.peak_toward_n).fold(0.0, f64::max);
        for (key, found) in [
            ("mean_force_toward_n", [mean(&toward[first..]); 2]),
            ("mean_force_toward_with_zeros_n", [mean(&toward); 2]),
            ("p75_force_toward_n", upper_quartile(&toward[first..])),
            ("p75_force_toward_with_zeros_n", upper_quartile(&toward)),
            ("peak_force_toward_n", [peak; 2]),
            ("cutting_s", [toward.iter().map(|(_, time, _)| time).sum(); 2]),
        ] {
            check(&[table, &[key]].concat(), "", found);
        }
        let place = said(&[table, &["peak_force_toward_waypoint"]].concat());
        let there = within().find(|f| place == Some(f.waypoint as f64));
        check(
            &[table, &["peak_force_toward_n"]].concat(),
            AT_WAYPOINT,
            [there.map_or(0.0, |there| there.peak_toward_n); 2],
        );
    }
    checks
}

/// Duration of the move to a waypoint, s.
pub fn took_s(plan: &StoredPlan, waypoint: usize) -> f64 {
    let before = waypoint.checked_sub(1).map_or(0.0, |before| plan.waypoints[before].time_s);
    plan.waypoints[waypoint].time_s - before
}

/// Mean of forces weighted by their times.
fn mean(ascending: &[(f64, f64, usize)]) -> f64 {
    let time: f64 = ascending.iter().map(|(_, time, _)| time).sum();
    if time > 0.0 { ascending.iter().map(|(force, time, _)| force * time).sum::<f64>() / time } else { 0.0 }
}

/// The least of ascending forces that is not exceeded during three quarters of the time; two values where the rounding of that
/// time decides.
fn upper_quartile(ascending: &[(f64, f64, usize)]) -> [f64; 2] {
    let whole_s: f64 = ascending.iter().map(|(_, time, _)| time).sum();
    [-SUM_SHARE, SUM_SHARE].map(|doubt| {
        let mut left_s = (0.75 + doubt) * whole_s;
        let found = ascending.iter().find(|(_, time, _)| {
            left_s -= time;
            left_s <= 0.0
        });
        found.map_or(0.0, |(force, ..)| *force)
    })
}
