//! The scene of a straight channel: what the tool sweeps is the target, and the approach is the way out.

use bonemill_case::{Case, Target};
use bonemill_planfile::{ChannelRecord, PlanRecord};

/// The target begins this far before the first contact with bone, mm, so that it holds bone beside the tool's point.
const BEFORE_CONTACT_MM: f64 = 0.5;

/// The case whose scene is that of a channel: its target is a cylinder around the tool's way through bone.
pub fn scene_case(case: &Case, channel: &ChannelRecord) -> Case {
    let at = |depth_mm: f64| channel.entry.coords + channel.direction.as_ref() * depth_mm;
    let target = Target::Frustum {
        from_mm: at(channel.contact_depth_mm - BEFORE_CONTACT_MM),
        to_mm: at(channel.depth_mm),
        from_radius_mm: channel.radius_mm,
        to_radius_mm: channel.radius_mm,
    };
    let mut case = case.clone();
    case.target = target;
    case.approach = Some(-channel.direction.into_inner());
    case.burr.radius_mm = channel.radius_mm;
    case
}

/// The case whose scene a finished plan was made on: its own, or that of its channel.
pub fn scene_case_of(record: &PlanRecord) -> Case {
    match record.channel() {
        Some(channel) => scene_case(&record.case, &channel),
        None => record.case.clone(),
    }
}
