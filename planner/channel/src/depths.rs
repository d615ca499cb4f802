//! Where along its line a tool first meets bone, and where its contact with bone reaches an area.

use bonemill_setup::{ChannelFault, PlanError};

use crate::axis::ChannelAxis;
use crate::bone::{BoneField, ToolPose};
use crate::front::ToolFront;

/// Step of the search along the line, mm.
const STEP_MM: f64 = 0.1;
/// How exactly a contact area's depth is found, mm.
const DEPTH_MM: f64 = 1e-3;
/// A contact area is sought this far, mm.
const MOST_DEPTH_MM: f64 = 60.0;

/// The depth at which the front first meets bone, mm, to [`STEP_MM`] and from the side of air.
///
/// # Errors
/// [`ChannelFault::NoBone`] where it meets none from `from_mm` to `to_mm`.
pub fn first_contact_mm(
    front: &ToolFront,
    bone: &BoneField<'_>,
    axis: &ChannelAxis,
    [from_mm, to_mm]: [f64; 2],
) -> Result<f64, PlanError> {
    let count = ((to_mm - from_mm) / STEP_MM).ceil().max(1.0) as usize;
    let depth = |n: usize| from_mm + n as f64 * STEP_MM;
    let meets = |n: &usize| contact_mm2(front, bone, axis, depth(*n)) > 0.0;
    let first = (0..=count).find(meets).ok_or(ChannelFault::NoBone { from_mm: -from_mm, to_mm })?;
    Ok(depth(first.saturating_sub(1)))
}

/// The first depth at which the front's area in bone is at least `wanted_mm2`, mm.
///
/// # Errors
/// [`ChannelFault::ContactArea`] with the most that was found.
pub fn of_contact_area_mm(
    front: &ToolFront,
    bone: &BoneField<'_>,
    axis: &ChannelAxis,
    from_mm: f64,
    wanted_mm2: f64,
) -> Result<f64, PlanError> {
    let mut most = (0.0, from_mm);
    let mut depth = from_mm;
    while depth < from_mm + MOST_DEPTH_MM {
        let area = contact_mm2(front, bone, axis, depth);
        if area >= wanted_mm2 {
            return Ok(bisected(depth - STEP_MM, depth, |d| contact_mm2(front, bone, axis, d) >= wanted_mm2));
        }
        if area > most.0 {
            most = (area, depth);
        }
        depth += STEP_MM;
    }
    let (most_mm2, depth_mm) = most;
    Err(ChannelFault::ContactArea { wanted_mm2, most_mm2, depth_mm }.into())
}

fn contact_mm2(front: &ToolFront, bone: &BoneField<'_>, axis: &ChannelAxis, depth_mm: f64) -> f64 {
    front.meets(bone, &ToolPose::new(axis.at(depth_mm), &axis.out)).contact_mm2
}

/// Where between `low`, at which `holds` is false, and `high` it becomes true.
fn bisected(mut low: f64, mut high: f64, holds: impl Fn(f64) -> bool) -> f64 {
    while high - low > DEPTH_MM {
        let middle = 0.5 * (low + high);
        if holds(middle) { high = middle } else { low = middle }
    }
    high
}
