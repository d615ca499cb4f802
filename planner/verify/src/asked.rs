//! What a case requires of a plan as a whole: that it does not fall short, by its own word and by its rows.
//!
//! A plan that falls short says why. Its word is a check of its own, so that such a plan never passes; the time and the forces that
//! the case asks for are looked at as well, so that a plan whose word was taken out is still caught. Coverage is counted on voxels,
//! beside the volumes; clearances, the shank and the joints' limits have checks of their own.

use bonemill_planfile::StoredPlan;

use super::check::{Check, Place};
use super::moves::{MoveClass, Moves};

/// The names of the checks that say that a plan falls short of its case, as opposed to one that is wrong.
pub const SHORT: [&str; 4] = [MEETS, COVERAGE, TIME, FORCE];
const MEETS: &str = "plan meets its case";
/// Of [`super::figures`].
pub const COVERAGE: &str = "coverage";
const TIME: &str = "time asked for";
const FORCE: &str = "force asked for";
/// A time that was asked for is met to this share of itself.
const TIME_SHARE: f64 = 1e-3;
/// Rounding of forces in the file, as a share.
const ROUNDING: f64 = 1e-6;

/// The plan's own word; the time and the forces that the case asks for, where it does.
pub fn asked(plan: &StoredPlan, moves: &Moves) -> Vec<Check> {
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

/// The largest share of each cap that a cut takes.
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
            // a cap of 0 N allows none
            Some(if force_n > 0.0 { force_n / most_n } else { 0.0 })
        }));
    }
    if let Some(most_um) = caps.deflection_um {
        checks.push(share("speed.deflection_um", &|w| Some(w.deflection_toward_um? / most_um)));
    }
    checks
}
