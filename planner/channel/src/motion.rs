//! The joints along a channel: joint vectors at its waypoints and the time law through them.

use bonemill_arm::Arm;
use bonemill_arm::arm::AxisPose;
use bonemill_case::RobotSpec;
use bonemill_geometry::{Base, Ct, Rigid};
use bonemill_motion::resolve::{DensePath, OutOfReach, PosePath, Posture, RollFrame, resolve};
use bonemill_motion::timelaw::{CornerTolerance, JointPath, LimitRatios, PathLimits, PreparedPath, TimeLaw};
use bonemill_setup::PlanError;
use nalgebra::{Matrix3, Unit};

use crate::axis::ChannelAxis;
use crate::strokes::TipPlace;

/// How far the trajectory may leave the line at a corner, mm. A channel has none but its turns, at which it stops.
const CORNER_MM: f64 = 0.01;

/// The arm's motion.
#[derive(Debug)]
pub struct ToolMotion {
    /// Joint vectors at the waypoints, mm or rad, shape (waypoints × dof).
    pub q: Vec<f64>,
    /// The branch of the arm's inverse that the path is on.
    pub branch: u8,
    /// The motion.
    pub law: TimeLaw,
    /// When each waypoint is passed, s.
    pub waypoint_times_s: Vec<f64>,
    /// How near it comes to the joints' limits.
    pub limit_ratios: LimitRatios,
    /// The lowest place of the arm's links over its mounting plane, mm, where that is known.
    pub lowest_link_mm: Option<f64>,
}

/// The motion of an arm along a channel.
///
/// # Errors
/// [`PlanError::OutOfReach`] naming the waypoint, [`PlanError::Robot`].
pub fn motion(
    arm: &Arm,
    robot: &RobotSpec,
    base_from_ct: &Rigid<Base, Ct>,
    axis: &ChannelAxis,
    places: &[TipPlace],
) -> Result<ToolMotion, PlanError> {
    let along = Unit::new_normalize(base_from_ct.rotate(&axis.out));
    let pose = |place: &TipPlace| AxisPose { position: *base_from_ct * axis.at(place.depth_mm), axis: along };
    let poses: Vec<AxisPose> = places.iter().map(pose).collect();
    let length_mm = lengths_mm(places);
    let posture = robot.branch.map_or(Posture::Any, Posture::Of);
    let path = PosePath {
        poses: &poses,
        length_mm: &length_mm,
        frame: RollFrame::about(&along),
        stiffness: None,
        posture,
    };
    let out_of_reach = |failed: OutOfReach| PlanError::OutOfReach {
        waypoint: failed.pose,
        axis: axis.out,
        excess: failed.reason.to_string(),
    };
    let resolved = resolve(arm, &path)?.map_err(out_of_reach)?;
    let dense = DensePath::lay(arm, &path, &resolved).map_err(out_of_reach)?;
    let limits =
        PathLimits::of_arm(arm, CornerTolerance { burr_mm: CORNER_MM, ..CornerTolerance::default() })?;
    let turns = places.iter().zip(&dense.waypoints).filter(|(place, _)| place.turns_back);
    let stops: Vec<usize> = turns.map(|(_, at)| *at).collect();
    let joint_path = JointPath { q: &dense.q, burr_mm: &dense.burr_mm, pose: &dense.pose, stops: &stops };
    let caps: Vec<f64> = places.iter().map(|place| place.speed_mm_s).collect();
    let law = PreparedPath::new(&joint_path, &limits)?.law(&dense.per_place(&caps))?;
    let times = law.waypoint_times_s();
    let waypoint_times_s = dense.waypoints.iter().map(|place| times[*place]).collect();
    let limit_ratios = law.limit_ratios(&limits);
    let mut lowest_link_mm: Option<f64> = None;
    for q in dense.q.chunks_exact(arm.dof()) {
        let Some((height_mm, _)) = arm.lowest_link(q)? else { break };
        lowest_link_mm = Some(lowest_link_mm.map_or(height_mm, |lowest| lowest.min(height_mm)));
    }
    let (q, branch) = (resolved.q, resolved.branch);
    Ok(ToolMotion { q, branch, law, waypoint_times_s, limit_ratios, lowest_link_mm })
}

/// Compliance of the arm at each waypoint, ct, mm/N; none without a stiffness.
///
/// # Errors
/// Where the stiffness does not fit the arm.
pub fn compliances(
    arm: &Arm,
    robot: &RobotSpec,
    base_from_ct: &Rigid<Base, Ct>,
    q: &[f64],
) -> Result<Option<Vec<Matrix3<f64>>>, PlanError> {
    let Some(stiffness) = robot.joint_stiffness.as_deref() else { return Ok(None) };
    let turn = base_from_ct.rotation.into_inner();
    let one = |q: &[f64]| Ok(turn.transpose() * arm.compliance(q, stiffness)? * turn);
    q.chunks_exact(arm.dof()).map(one).collect::<Result<Vec<_>, PlanError>>().map(Some)
}

/// Length of the move that ends at each waypoint, mm.
pub fn lengths_mm(places: &[TipPlace]) -> Vec<f64> {
    let before = places.first().into_iter().chain(places);
    places.iter().zip(before).map(|(place, before)| (place.depth_mm - before.depth_mm).abs()).collect()
}
