//! Arms without closed form, step by step: damped least squares along the path.
//!
//! The path is followed from a given start if that is possible; else from several starts at the first pose, each moved
//! towards the middle of its ranges as far as the task leaves that free. A few starts are followed to the end, those of
//! least posture cost first, and the whole path with the least joint motion and posture cost is taken. Every step starts
//! from the last joint vector, so the branch never changes.

use bonemill_arm::arm::{Arm, AxisPose, ToolGoal, dls};
use nalgebra::DVector;

use super::{EXACT, Follower, OutOfReach, PosePath, Posture, ReachReason, Resolved, yielding};

/// Number of starts of the search, and number of solutions that are followed to the end.
const STARTS: u32 = 48;
pub(super) const FOLLOWED: usize = 4;
/// Number of steps towards the middle of the ranges at the first pose.
const SETTLE: usize = 60;
/// Size of a step towards the middle of the ranges, as a share of the free distance.
const DRIFT: f64 = 0.05;
/// Step of the finite differences, as a share of a joint's motion at full speed in one second.
const SLOPE_S: f64 = 1e-4;
/// Largest change of a joint from one pose to the next, as a share of its motion at full speed in one second.
const JUMP_S: f64 = 0.5;

pub(super) fn resolve(arm: &Arm, path: &PosePath<'_>) -> Result<Resolved, OutOfReach> {
    if let Posture::From(near) = path.posture
        && let Some(start) = start_near(arm, &path.poses[0], near)
        && let Ok((_, resolved)) = follow(arm, path, start, 0)
    {
        return Ok(resolved);
    }
    let starts = starts(arm, &path.poses[0]).map_err(|reason| OutOfReach { pose: 0, reason })?;
    let mut best: Option<(f64, Resolved)> = None;
    let mut farthest: Option<OutOfReach> = None;
    for (branch, start) in starts.into_iter().take(FOLLOWED).enumerate() {
        match follow(arm, path, start, branch as u8) {
            Ok((cost, resolved)) if best.as_ref().is_none_or(|(least, _)| cost < *least) => {
                best = Some((cost, resolved));
            }
            Ok(_) => {}
            Err(failed) if farthest.as_ref().is_none_or(|other| failed.pose > other.pose) => {
                farthest = Some(failed);
            }
            Err(_) => {}
        }
    }
    let failed = farthest.unwrap_or(OutOfReach { pose: 0, reason: ReachReason::Jump });
    best.map(|(_, resolved)| resolved).ok_or(failed)
}

/// A joint vector for the first pose from one nearby, within the ranges.
pub(super) fn start_near(arm: &Arm, pose: &AxisPose, near: &[f64]) -> Option<Vec<f64>> {
    if near.len() != arm.dof() {
        return None;
    }
    let found = dls::solve(arm, &ToolGoal::Axis(*pose), near);
    (found.is_within(EXACT) && arm.excess_at(&found.q).is_none()).then_some(found.q)
}

/// Joint vectors for the first pose within the ranges, the one of least posture cost first.
pub(super) fn starts(arm: &Arm, pose: &AxisPose) -> Result<Vec<Vec<f64>>, ReachReason> {
    let mut found: Vec<(f64, Vec<f64>)> = Vec::new();
    let mut nearest = (f64::INFINITY, ReachReason::Jump);
    for k in 0..STARTS {
        let end = dls::solve(arm, &ToolGoal::Axis(*pose), &arm.start(k));
        if !end.is_within(EXACT) {
            let short = end.short_mm + 100.0 * end.short_rad;
            let reason = if end.short_mm > 100.0 * end.short_rad {
                ReachReason::Beyond { short_mm: end.short_mm }
            } else {
                ReachReason::Axis { short_rad: end.short_rad }
            };
            if short < nearest.0 {
                nearest = (short, reason);
            }
            continue;
        }
        let mut q = end.q;
        arm.bring_into_range(&mut q);
        for _ in 0..SETTLE {
            let drifted = drifted(arm, &q, |_| 0.0);
            let settled = dls::solve(arm, &ToolGoal::Axis(*pose), &drifted);
            if !settled.is_within(EXACT)
                || arm.excess_at(&settled.q).is_some_and(|_| arm.excess_at(&q).is_none())
            {
                break;
            }
            q = settled.q;
        }
        match arm.excess_at(&q) {
            Some(excess) => {
                if nearest.0.is_infinite() || matches!(nearest.1, ReachReason::Limit(_)) {
                    nearest.1 = ReachReason::Limit(excess);
                }
            }
            None => found.push((posture(arm, &q), q)),
        }
    }
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    found.dedup_by(|a, b| a.1.iter().zip(&b.1).all(|(a, b)| (a - b).abs() < 1e-3));
    if found.is_empty() { Err(nearest.1) } else { Ok(found.into_iter().map(|(_, q)| q).collect()) }
}

fn follow(
    arm: &Arm,
    path: &PosePath<'_>,
    start: Vec<f64>,
    branch: u8,
) -> Result<(f64, Resolved), OutOfReach> {
    let follower = Follower { arm, frame: path.frame, branch };
    let mut q = start;
    let mut cost = 0.0;
    let mut all = Vec::with_capacity(path.poses.len() * arm.dof());
    for (i, pose) in path.poses.iter().enumerate() {
        let before = q.clone();
        if i > 0 {
            q = drifted(arm, &q, |q| yielding(arm, path, i, q));
        }
        let failed = |reason| OutOfReach { pose: i, reason };
        follower.step(pose, 0.0, &mut q).map_err(failed)?;
        let moves = || {
            arm.joints()
                .iter()
                .zip(q.iter().zip(&before))
                .map(|(joint, (a, b))| (a - b).abs() / joint.velocity_limit)
        };
        let apart_mm = if i == 0 { 0.0 } else { path.length_mm[i] };
        let turned = if i == 0 { 0.0 } else { pose.axis.angle(&path.poses[i - 1].axis) };
        if i > 0 && moves().fold(0.0, f64::max) > may_take_s(apart_mm, turned) {
            return Err(failed(ReachReason::Jump));
        }
        if let Some(excess) = arm.excess_at(&q) {
            return Err(failed(ReachReason::Limit(excess)));
        }
        cost += (posture(arm, &q) + yielding(arm, path, i, &q)) * apart_mm
            + moves().map(|m| m * m).sum::<f64>() / apart_mm.max(0.05);
        all.extend_from_slice(&q);
    }
    Ok((cost, Resolved { roll_rad: vec![0.0; path.poses.len()], q: all, branch }))
}

/// The longest that a joint may take from one pose to the next at its full speed without a jump, s.
pub(super) fn may_take_s(apart_mm: f64, turned_rad: f64) -> f64 {
    JUMP_S + 0.2 * apart_mm + 10.0 * turned_rad
}

/// Posture cost: Σ of squared distances from the middle of each range, as shares of the half range.
fn posture(arm: &Arm, q: &[f64]) -> f64 {
    arm.joints().iter().zip(q).map(|(joint, q)| share(joint, *q).powi(2)).sum()
}

/// −1 at the lower limit, 0 in the middle, 1 at the upper; 0 for a joint without limits.
pub(super) fn share(joint: &bonemill_arm::Joint, q: f64) -> f64 {
    if !joint.is_bounded() {
        return 0.0;
    }
    (q - 0.5 * (joint.lower + joint.upper)) / (0.5 * (joint.upper - joint.lower))
}

/// A step towards the middle of the ranges and towards a smaller `yielding` that, to first order, moves neither burr nor
/// axis.
pub(super) fn drifted(arm: &Arm, q: &[f64], yielding: impl Fn(&[f64]) -> f64) -> Vec<f64> {
    if arm.dof() <= 5 {
        return q.to_vec();
    }
    let axis = arm.tool_at(q).rotation * nalgebra::Vector3::z();
    let mut jacobian = arm.tool_jacobian_at(q);
    for (mut column, joint) in jacobian.column_iter_mut().zip(arm.joints()) {
        let turn = column.fixed_rows::<3>(3).into_owned();
        column.fixed_rows_mut::<3>(3).copy_from(&((turn - axis * axis.dot(&turn)) * 100.0));
        column *= joint.velocity_limit;
    }
    let mut near = q.to_vec();
    let wish = arm.joints().iter().enumerate().map(|(j, joint)| {
        let mut at = |step: f64| {
            near[j] = q[j] + step * joint.velocity_limit;
            let yields = yielding(&near);
            near[j] = q[j];
            yields
        };
        // half the slope, because the share is half the derivative of its square
        let slope = (at(SLOPE_S) - at(-SLOPE_S)) / (4.0 * SLOPE_S);
        -DRIFT * (share(joint, q[j]) + slope.clamp(-1.0, 1.0))
    });
    let wish = DVector::from_iterator(arm.dof(), wish);
    let square = &jacobian * jacobian.transpose();
    // the task has five dimensions; the row of the roll is zero
    let Ok(inverse) = square.pseudo_inverse(1e-9 * square.trace().max(f64::MIN_POSITIVE)) else {
        return q.to_vec();
    };
    let free = &wish - jacobian.transpose() * (inverse * (&jacobian * &wish));
    let joints = arm.joints().iter().zip(free.iter());
    q.iter().zip(joints).map(|(q, (joint, free))| q + free * joint.velocity_limit).collect()
}
