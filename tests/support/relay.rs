//! Computes a finished plan's trajectory again, for faults that the trajectory must follow.

use bonemill_planner::path::MoveKind;
use bonemill_planner::plan::{StoredPlan, Trajectory};
use bonemill_robot::arm::bone_attached;
use bonemill_robot::timelaw::{CornerTolerance, JointPath, PathLimits, PreparedPath};

/// Computes the trajectory again through the present waypoints, under their caps.
pub fn relay(plan: &mut StoredPlan) {
    let (mut q, mut pose, mut burr_mm, mut caps, mut at) = (vec![], vec![], vec![], vec![], vec![]);
    for n in 0..plan.waypoints.len() {
        let (from, to) = (&plan.waypoints[n.saturating_sub(1)], &plan.waypoints[n]);
        let way = to.position - from.position;
        let turn = from.axis.angle(&to.axis);
        let parts = (turn / 0.02).max(way.norm() / 0.5).ceil().max(1.0);
        for k in 1..=parts as usize {
            let share = k as f64 / parts;
            let axis = plan.record.frames.base_from_ct.rotate(&from.axis.lerp(&to.axis, share).normalize());
            let place = plan.record.frames.base_from_ct * (from.position + way * share);
            let tilt = bone_attached::tilt_for_axis(&axis).unwrap().tilt_rad;
            q.extend(bone_attached::ik(place, tilt));
            pose.push([place.x(), place.y(), place.z(), axis.x, axis.y, axis.z]);
            burr_mm.push(way.norm() / parts);
            caps.push(to.speed_mm_s);
        }
        at.push(burr_mm.len() - 1);
    }
    let limits = PathLimits::of_arm(&plan.arm, CornerTolerance { burr_mm: 0.01, axis_rad: 1e-3 }).unwrap();
    let path = JointPath { q: &q, burr_mm: &burr_mm, pose: &pose, stops: &[] };
    let law = PreparedPath::new(&path, &limits).unwrap().law(&caps).unwrap();
    for (waypoint, place) in plan.waypoints.iter_mut().zip(at) {
        waypoint.time_s = law.waypoint_times_s()[place];
    }
    let rows = law.rows(plan.record.case.robot.rate_hz).unwrap().collect();
    plan.trajectory = Trajectory { dof: rows.dof, time_s: rows.time_s, q: rows.q, qd: rows.qd };
}

/// Computes the trajectory with other caps for one kind of move than the rows state.
pub fn relay_at(plan: &mut StoredPlan, factor: f64, is: fn(MoveKind) -> bool) {
    let caps: Vec<f64> = plan.waypoints.iter().map(|w| w.speed_mm_s).collect();
    plan.waypoints.iter_mut().filter(|w| is(w.kind)).for_each(|w| w.speed_mm_s *= factor);
    relay(plan);
    plan.waypoints.iter_mut().zip(caps).for_each(|(w, cap)| w.speed_mm_s = cap);
}
