//! Checks the requirements of a case on the plan as a whole: the plan must state no shortfall, and must keep the requested
//! time and forces.
//!
//! A plan that falls short states its reasons. One check tests this statement, so that such a plan never passes. The requested
//! time and forces are also checked from the rows, so that a plan whose statement was deleted is still found. Coverage is
//! counted on voxels, beside the volumes; clearances, the shank and the joints' limits have separate checks.

use bonemill_planfile::StoredPlan;

use super::check::{Check, Place};
use super::moves::{MoveClass, Moves};

/// The names of the checks for a plan that falls short of its case; all other checks are for a plan that is wrong.
pub const SHORT: [&str; 5] = [MEETS, COVERAGE, TIME, FORCE, DRIVEN];
pub const MEETS: &str = "plan meets its case";
/// Name of the check of coverage, made in [`super::figures`].
pub const COVERAGE: &str = "coverage";
const TIME: &str = "time asked for";
const FORCE: &str = "force asked for";
/// Name of the checks of the same caps along the driven motion, made in [`super::driven`].
pub const DRIVEN: &str = "driven force asked for";
/// Relative accuracy to which a requested time is met.
const TIME_SHARE: f64 = 1e-3;
/// Relative rounding of forces in the file.
const ROUNDING: f64 = 1e-6;

/// Checks the plan's stated shortfalls, and the time and forces that the case requests, if any.
pub fn requirements(plan: &StoredPlan, moves: &Moves) -> Vec<Check> {
    let shortfalls = &plan.record.shortfalls;
    let mut checks = vec![Check::none_wrong(MEETS, shortfalls.len()).noting(shortfalls.join("; "))];
    let speed = &plan.record.case.speed;
    if let Some(asked_s) = speed.total_time_s {
        let end_s = moves.times_s.last().copied().unwrap_or(0.0);
        let note = format!("asked for {asked_s:.4} s, takes {end_s:.4} s");
        checks
            .push(Check::at_most(TIME, (end_s - asked_s).abs(), TIME_SHARE * asked_s, "s off").noting(note));
    }
    if speed.mode.keeps_caps() {
        checks.extend(forces(plan, moves));
    }
    checks
}

/// The largest ratio of a cut's force to each cap.
fn forces(plan: &StoredPlan, moves: &Moves) -> Vec<Check> {
    let (caps, radius_mm) = (&plan.record.case.speed.caps, plan.record.case.burr.radius_mm);
    let share = |subject: &str, of: &dyn Fn(&bonemill_planfile::Waypoint) -> Option<f64>| {
        let cuts = plan.waypoints.iter().enumerate().filter(|(n, _)| moves.kinds[*n] == MoveClass::Cut);
        let found = cuts.filter_map(|(n, w)| Some((of(w)?, n))).max_by(|a, b| a.0.total_cmp(&b.0));
        let (share, n) = found.map_or((0.0, None), |(share, n)| (share, Some(n)));
        Check::at_most(FORCE, share, 1.0 + ROUNDING, "of the cap").of(subject).at(n.map(Place::Waypoint))
    };
    let mut checks = Vec::new();
    if let Some(most_n) = caps.force_n {
        checks.push(share("speed.force_n", &|w| Some(w.force_n.norm() / most_n)));
    }
    if let Some(curve) = &caps.force_toward_n {
        checks.push(share("speed.force_toward_n", &|w| {
            let (force_n, most_n) = (w.force_toward_n?, curve.at(w.distance_mm? - radius_mm));
            // a cap of 0 N allows no force
            Some(if force_n > 0.0 { force_n / most_n } else { 0.0 })
        }));
    }
    if let Some(most_um) = caps.deflection_um {
        checks.push(share("speed.deflection_um", &|w| Some(w.deflection_toward_um? / most_um)));
    }
    checks
}
