//! Checks that the arm's links stay above its mounting plane.
//!
//! Links are lines from joint to joint, from the shoulder to the flange; their radius is not known and not included. A plan
//! whose arm cannot stay above the plane states how far below it goes; then the arm must not go farther below.

use bonemill_arm::ArmKind;
use bonemill_planfile::{StoredPlan, Value};

use super::VerifyError;
use super::check::{Check, Place};
use super::moves::Executed;

/// Tolerance of a height that the plan states, mm, because the motion rounds corners.
const ROUNDED_MM: f64 = 0.5;

/// Checks the lowest point of a UR's links along the trajectory. `None` for other arms, whose mounting plane is not known.
///
/// # Errors
/// [`VerifyError::Robot`] where a row is not a joint vector of the arm.
pub fn links(plan: &StoredPlan, executed: &Executed) -> Result<Option<Check>, VerifyError> {
    if plan.arm.kind() != ArmKind::Ur {
        return Ok(None);
    }
    let mut lowest = (f64::INFINITY, 0);
    for row in 0..plan.trajectory.len() {
        let places = plan.arm.joint_places(plan.trajectory.q_at(row))?;
        let height_mm = places.iter().skip(1).map(|place| place.z()).fold(f64::INFINITY, f64::min);
        if height_mm < lowest.0 {
            lowest = (height_mm, row);
        }
    }
    let stated_mm = match plan.record.modelled("lowest_link_mm") {
        Some(Value::Number(mm)) => Some(*mm),
        _ => None,
    };
    let limit = stated_mm.filter(|mm| *mm < 0.0).map_or(0.0, |mm| mm - ROUNDED_MM);
    let (height_mm, row) = lowest;
    let at = Place::Instant { time_s: plan.trajectory.time_s[row], waypoint: executed.next[row] as usize };
    let check = Check::at_least("links over the mounting plane", height_mm, limit, "mm").at(at);
    Ok(Some(if limit < 0.0 {
        check.noting("the plan says that its arm goes below; make sure that nothing is there")
    } else {
        check.noting("links as lines from joint to joint; their radius comes on top")
    }))
}
