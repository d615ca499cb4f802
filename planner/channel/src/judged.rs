//! Whether a planned channel keeps what its case asks for, and if not, why.

use bonemill_case::ChannelSpec;

use crate::plan::ChannelPlan;

/// Rounding of the joints' limits, as a share.
const LIMIT_ROUNDING: f64 = 1e-6;

/// Every reason why the plan falls short.
pub fn shortfalls(plan: &ChannelPlan, spec: &ChannelSpec) -> Vec<String> {
    let case = &plan.setup.case;
    let mut reasons = plan.setup.registered.shortfalls(case);
    let kept = plan.channel.kept.iter().zip(&case.structures);
    for (kept, structure) in kept.filter_map(|(kept, structure)| Some((kept.as_ref()?, structure))) {
        if kept.clearance_mm < structure.clearance_mm {
            reasons.push(format!(
                "the channel keeps {:.3} mm of {} at a depth of {:.1} mm: {} mm are asked for (structure.clearance_mm)",
                kept.clearance_mm, structure.name, kept.depth_mm, structure.clearance_mm
            ));
        }
        if kept.touch_probability > spec.touch_probability {
            reasons.push(format!(
                "the registration's error (σ = {:.3} mm) lets the tool touch {} with a probability of {:.2e}: at most {:.2e} is asked for \
                 (path.touch_probability)",
                kept.sigma_mm, structure.name, kept.touch_probability, spec.touch_probability
            ));
        }
    }
    if let Some(bone) = plan.holder_in_bone {
        reasons.push(format!(
            "the holder would stand in bone at the deepest pose (waypoint {}): its front must be drawn back by {:.1} mm; use a longer tool \
             (drill.flute_mm, shank.segments) or a shallower channel",
            deepest_waypoint(plan),
            bone.deep_mm
        ));
    }
    let holder = plan.holder_clearance_mm.iter().zip(&case.structures);
    for (clearance_mm, structure) in holder.filter_map(|(mm, structure)| Some(((*mm)?, structure))) {
        if clearance_mm < structure.shank_clearance_mm {
            reasons.push(format!(
                "the holder comes to {clearance_mm:.2} mm from {} (waypoint {}): {} mm are asked for (structure.shank_clearance_mm)",
                structure.name,
                deepest_waypoint(plan),
                structure.shank_clearance_mm
            ));
        }
    }
    let time_s = |waypoint: usize| plan.motion.waypoint_times_s.get(waypoint).copied().unwrap_or_default();
    reasons.extend(plan.arm.link_distance.as_ref().and_then(|near| near.shortfall(time_s)));
    let ratios = plan.motion.limit_ratios;
    let worst = ratios.velocity.max(ratios.acceleration).max(ratios.jerk);
    if worst.is_nan() || worst > 1.0 + LIMIT_ROUNDING {
        reasons.push(format!("joint limits are passed: {worst:.6} of what is allowed"));
    }
    reasons
}

/// The first waypoint at which the tool is deepest.
pub fn deepest_waypoint(plan: &ChannelPlan) -> usize {
    let deepest = plan.plunge.iter().map(|row| row.depth_mm).fold(f64::NEG_INFINITY, f64::max);
    plan.plunge.iter().position(|row| row.depth_mm >= deepest).unwrap_or(0)
}
