//! Finds which of many poses an arm can take without leaving one posture.
//!
//! A path is followed in one posture: on one branch of a UR, or from one joint vector to the next without a jump. So each
//! posture is tested alone. For a UR, every branch is tested at every pose, in closed form over all rolls. An arm without
//! closed form goes from pose to neighbouring pose, and each is solved from its neighbour's joint vector by damped least
//! squares. The result is the posture that takes the most poses.
//!
//! This module does not test whether the motion between two poses is free of jumps; that is tested when the path itself is
//! followed.

use std::collections::VecDeque;

use bonemill_arm::arm::{Arm, AxisPose, InverseKind, ToolGoal, dls};
use bonemill_arm::ur::Branches;
use rayon::prelude::*;

use super::track::{FOLLOWED, drifted, starts};
use super::{EXACT, Follower, Posture, RollFrame, grid};
use crate::room::Room;

/// Number of neighbours from which a pose is tried.
const TRIES: u8 = 3;

/// The poses that an arm can take in one posture.
#[derive(Debug, Clone, PartialEq)]
pub struct Reached {
    /// Whether it takes each pose, shape (poses).
    pub takes: Vec<bool>,
    /// A joint vector for each pose that it takes, where the arm has no closed form; else empty.
    q: Vec<Option<Vec<f64>>>,
}

impl Reached {
    /// Number of poses that are taken.
    pub fn count(&self) -> usize {
        self.takes.iter().filter(|takes| **takes).count()
    }

    /// The joint vector of a pose, mm or rad; `None` where it is not taken, and for arms with a closed form.
    pub fn q(&self, pose: usize) -> Option<&[f64]> {
        self.q.get(pose)?.as_deref()
    }
}

/// The poses that the arm can take in the posture that takes the most of them.
///
/// `seeds`: poses to start from, in the order in which they are tried, for arms without closed form; `neighbours`: the poses
/// that are a small step away from a pose.
pub fn reached(
    arm: &Arm,
    poses: &[AxisPose],
    (frame, posture, room): (RollFrame, Posture<'_>, Option<&Room>),
    seeds: &[usize],
    neighbours: impl Fn(usize) -> Vec<usize> + Sync,
) -> Reached {
    let in_closed_form = |takes| Reached { takes, q: vec![] };
    match arm.inverse_kind() {
        InverseKind::BoneAttached => {
            let follower = Follower { arm, frame, branch: 0 };
            let takes = |pose: &AxisPose| {
                let mut q = [0.0; 4];
                follower.step(pose, 0.0, &mut q).is_ok() && arm.excess_at(&q).is_none()
            };
            in_closed_form(poses.iter().map(takes).collect())
        }
        InverseKind::Ur { .. } => {
            let allowed = if let Posture::Of(branches) = posture { branches } else { Branches::ALL };
            let found: Vec<grid::Branch> =
                poses.par_iter().map(|pose| grid::branches(arm, pose, &frame, room)).collect();
            let count =
                |set: fn(&grid::Branch) -> u8, b: u8| found.iter().filter(|f| set(f) >> b & 1 == 1).count();
            let best = (0..8u8).filter(|b| allowed.contains(*b)).max_by_key(|b| {
                // of equal branches the first
                (count(|f| f.above, *b), count(|f| f.any, *b), u8::MAX - b)
            });
            let best = best.unwrap_or(0);
            in_closed_form(found.iter().map(|f| f.any >> best & 1 == 1).collect())
        }
        InverseKind::Numeric => {
            let first = seeds.iter().find_map(|seed| Some((*seed, starts(arm, &poses[*seed]).ok()?)));
            let Some((seed, starts)) = first else {
                return Reached { takes: vec![false; poses.len()], q: vec![None; poses.len()] };
            };
            let spread: Vec<Reached> = starts[..starts.len().min(FOLLOWED)]
                .par_iter()
                .map(|start| spread(arm, poses, seed, start, &neighbours))
                .collect();
            let most = spread.iter().map(Reached::count).max();
            let best = spread.into_iter().find(|reached| Some(reached.count()) == most);
            best.unwrap_or_else(|| in_closed_form(vec![false; poses.len()]))
        }
    }
}

/// Goes from pose to neighbouring pose by damped least squares, starting with one joint vector at `seed`.
fn spread(
    arm: &Arm,
    poses: &[AxisPose],
    seed: usize,
    start: &[f64],
    neighbours: &(impl Fn(usize) -> Vec<usize> + Sync),
) -> Reached {
    let mut q: Vec<Option<Vec<f64>>> = vec![None; poses.len()];
    let mut tries = vec![0u8; poses.len()];
    let mut queue = VecDeque::from([seed]);
    q[seed] = Some(start.to_vec());
    while let Some(from) = queue.pop_front() {
        let Some(near) = q[from].clone() else { continue };
        for to in neighbours(from) {
            if q[to].is_some() || tries[to] >= TRIES {
                continue;
            }
            tries[to] += 1;
            // first with a step toward the middle of the ranges, as when a path is followed; if that fails, without it
            let solved = [drifted(arm, &near, |_| 0.0), near.clone()].into_iter().find_map(|from| {
                let found = dls::solve(arm, &ToolGoal::Axis(poses[to]), &from);
                (found.is_within(EXACT) && arm.excess_at(&found.q).is_none()).then_some(found.q)
            });
            if solved.is_some() {
                q[to] = solved;
                queue.push_back(to);
            }
        }
    }
    Reached { takes: q.iter().map(Option::is_some).collect(), q }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bonemill_arm::JointKind;
    use bonemill_arm::ToolMount;
    use bonemill_arm::ur::UrModel;
    use bonemill_geometry::{Point, Rigid};
    use nalgebra::{Rotation3, Unit, Vector3};
    use std::f64::consts::PI;

    /// Poses at one place, tilted by up to 60° from the vertical in twelve directions.
    fn fan(at: Point<bonemill_geometry::Base>) -> (Vec<AxisPose>, impl Fn(usize) -> Vec<usize> + Sync) {
        let axis = |n: usize| {
            let (tilt, turn) = ((n / 12) as f64 * 0.105, (n % 12) as f64 * PI / 6.0);
            Unit::new_normalize(Vector3::new(tilt.sin() * turn.cos(), tilt.sin() * turn.sin(), tilt.cos()))
        };
        let poses: Vec<AxisPose> = (0..132).map(|n| AxisPose { position: at, axis: axis(n) }).collect();
        let neighbours = |n: usize| {
            let (ring, place) = (n / 12, n % 12);
            let beside = [ring * 12 + (place + 1) % 12, ring * 12 + (place + 11) % 12];
            let across = [ring.checked_sub(1), (ring < 10).then_some(ring + 1)];
            across.into_iter().flatten().map(|ring| ring * 12 + place).chain(beside).collect()
        };
        (poses, neighbours)
    }

    /// A UR5e with a straight handpiece, once with its closed form and once without, its wrist within `wrist_rad` of its
    /// middle.
    fn arms(wrist_rad: f64) -> [Arm; 2] {
        let ur = Arm::ur(UrModel::Ur5e, None).unwrap();
        let text = ur.urdf_text().to_owned();
        let mount = Rigid::new(Rotation3::from_euler_angles(PI, 0.0, 0.0), Vector3::new(0.0, 0.0, 180.0));
        let limited: String = text
            .split_inclusive("</joint>")
            .map(|joint| {
                let ends = [("lower=\"-", -PI / 2.0 - wrist_rad), ("upper=\"", -PI / 2.0 + wrist_rad)];
                let mut joint = joint.to_owned();
                if joint.contains("wrist_2_joint") {
                    for (key, value) in ends {
                        let from = joint.find(key).unwrap() + key.trim_end_matches('-').len();
                        let to = from + joint[from..].find('"').unwrap();
                        joint.replace_range(from..to, &format!("{value}"));
                    }
                }
                joint
            })
            .collect();
        let other = Arm::from_urdf(&limited, "limited").unwrap();
        assert!(other.joints().iter().all(|joint| joint.kind == JointKind::Revolute));
        let same = other.clone().of_model("ur5e").unwrap();
        [same, other].map(|arm| arm.with_mount(ToolMount { flange_from_burr: mount }))
    }

    #[test]
    fn going_from_pose_to_pose_finds_what_the_closed_form_finds() {
        let at = Point::new(480.0, 60.0, 40.0);
        for wrist_rad in [0.35, 3.0] {
            let [ur, other] = arms(wrist_rad);
            let (poses, neighbours) = fan(at);
            let frame = RollFrame::about(&Vector3::z_axis());
            let closed = reached(&ur, &poses, (frame, Posture::Any, None), &[0], &neighbours);
            let found = reached(&other, &poses, (frame, Posture::Any, None), &[0], &neighbours);
            // the forward kinematics of each joint vector give its pose
            for (n, pose) in poses.iter().enumerate() {
                assert_eq!(found.takes[n], found.q(n).is_some());
                let Some(q) = found.q(n) else { continue };
                let tool = other.burr(q).unwrap();
                assert!((tool.translation_mm - pose.position.coords).norm() < 1e-6);
                assert!((tool.rotation * Vector3::z()).angle(&pose.axis) < 1e-6);
                assert_eq!(other.beyond_limits(q).unwrap(), None);
            }
            // the search is not limited to 36 rolls, so it misses no pose that the closed form finds
            let missed = closed.takes.iter().zip(&found.takes).filter(|(c, f)| **c && !**f).count();
            assert!(missed <= 2, "{missed} of {} at ±{wrist_rad} rad", closed.count());
            assert_eq!(closed.count() == poses.len(), wrist_rad > 1.0, "{}", closed.count());
        }
    }

    #[test]
    fn an_arm_that_is_too_far_away_takes_nothing() {
        let (poses, neighbours) = fan(Point::new(2000.0, 0.0, 0.0));
        for arm in arms(3.0) {
            let frame = RollFrame::about(&Vector3::z_axis());
            assert_eq!(reached(&arm, &poses, (frame, Posture::Any, None), &[0, 5], &neighbours).count(), 0);
        }
    }
}
