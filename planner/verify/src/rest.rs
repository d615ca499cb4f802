//! Checks that enough of the target is removed, and counts the plan's causes for the rest again, in groups.
//!
//! Doubtful voxels count in favour of the plan.

use bonemill_planfile::{StoredPlan, Value};

use super::check::Check;
use super::figures::{counted, more, table};
use super::lattice::{OUTSIDE, TARGET};
use super::voxels::{Doubtful, Voxels};

/// Whether a cause belongs to a group.
type IsIn = fn(&str) -> bool;

/// The voxels that the burr removes, that it can reach under the clearances, and that it could reach without clearances.
pub struct Sets<'a> {
    /// Voxels in the ball somewhere along the path.
    pub swept: &'a Doubtful<Vec<bool>>,
    /// Voxels that the ball can reach under the clearances.
    pub reachable: &'a Doubtful<Vec<bool>>,
    /// Voxels that the ball could reach if it kept away from bone only.
    pub open: &'a Doubtful<Vec<bool>>,
}

/// Checks the removed share of the target, and the causes for the rest.
pub fn target_share(plan: &StoredPlan, voxels: &Voxels, sets: &Sets<'_>) -> Vec<Check> {
    let removed = voxels.volume_mm3(TARGET, &[sets.swept]);
    let (target, outside) = (voxels.volume_mm3(TARGET, &[]), voxels.volume_mm3(OUTSIDE, &[]));
    let whole = [target[0] + outside[0], target[1] + outside[1]];
    let share = |removed: f64, whole: f64| if whole > 0.0 { (removed / whole).min(1.0) } else { 1.0 };
    let shares = [share(removed[0], whole[1]), share(removed[1], whole[0])];
    let (stays, closed) = (complement(sets.swept), complement(sets.open));
    let kept = complement(sets.reachable);
    let groups: [(&str, IsIn, [f64; 2]); 4] = [
        ("clearances", is_clearance, voxels.volume_mm3(TARGET, &[&stays, &kept, sets.open])),
        ("bone and burr", is_bone, voxels.volume_mm3(TARGET, &[&stays, &closed])),
        ("shank and path", is_path, voxels.volume_mm3(TARGET, &[&stays, sets.reachable])),
        ("the scan's end", |cause| cause == "end of the scan", outside),
    ];
    let mut checks = vec![
        Check::at_least("removed of the target", shares[1], plan.record.case.least_share, "of it")
            .noting(format!("removed {:.1} of {:.1} mm³", removed[1], whole[1])),
        Check { unit: "of it", ..counted("removed_share by voxels", more(plan, "removed_share"), shares) },
        counted("not_removed_mm3", said(plan, |_| true), [whole[0] - removed[1], whole[1] - removed[0]]),
    ];
    for (name, is_in, found) in groups {
        checks.push(counted(&format!("not_removed_mm3 by {name}"), said(plan, is_in), found));
    }
    checks
}

fn is_clearance(cause: &str) -> bool {
    cause.starts_with("clearance of ") || cause == "several clearances at once"
}

fn is_bone(cause: &str) -> bool {
    ["burr's radius", "bone around", "thin bone"].iter().any(|of_bone| cause.starts_with(of_bone))
}

fn is_path(cause: &str) -> bool {
    cause.starts_with("shank or tilt") || cause == "path's spacing"
}

/// The volume that the plan states for some causes, mm³.
fn said(plan: &StoredPlan, is_in: impl Fn(&str) -> bool) -> Option<f64> {
    let causes = table(plan, "not_removed_mm3")?.iter().filter(|(cause, _)| is_in(cause));
    Some(causes.map(|(_, mm3)| if let Value::Number(mm3) = mm3 { *mm3 } else { f64::NAN }).sum())
}

fn complement(set: &Doubtful<Vec<bool>>) -> Doubtful<Vec<bool>> {
    let not = |voxels: &[bool]| voxels.iter().map(|is_in| !is_in).collect();
    Doubtful { surely: not(&set.possibly), possibly: not(&set.surely) }
}
