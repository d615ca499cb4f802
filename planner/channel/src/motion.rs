//! The joints along a channel: joint vectors at its waypoints and the time law through them.

use bonemill_robot::timelaw::{JointPath, LimitRatios, PreparedPath, TimeLaw};
use bonemill_setup::armpath::{ArmMotion, Placed, path_limits};
use bonemill_setup::{PlanError, Setup};
use nalgebra::Unit;

use crate::axis::ChannelAxis;
use crate::strokes::TipPlace;

/// The arm's motion.
#[derive(Debug)]
pub struct ToolMotion {
    /// The joints.
    pub motion: ArmMotion,
    /// Over time.
    pub law: TimeLaw,
    /// When each waypoint is passed, s.
    pub waypoint_times_s: Vec<f64>,
    /// Greatest speed within the move that ends at each waypoint, mm/s.
    pub driven_mm_s: Vec<f64>,
    /// How near it comes to the joints' limits.
    pub limit_ratios: LimitRatios,
}

/// The motion of an arm along a channel. It stops where the tool turns back.
///
/// # Errors
/// [`PlanError::OutOfReach`] naming the waypoint, [`PlanError::Robot`].
pub fn motion(
    setup: &Setup,
    placed: &Placed<'_>,
    axis: &ChannelAxis,
    places: &[TipPlace],
) -> Result<ToolMotion, PlanError> {
    let work_from_ct = setup.scene.ct_from_work.inverse();
    let along = Unit::new_normalize(work_from_ct.rotate(&axis.out));
    let positions: Vec<_> = places.iter().map(|place| work_from_ct * axis.at(place.depth_mm)).collect();
    let axes = vec![along; places.len()];
    let motion = placed.motion(&positions, &axes, &lengths_mm(places), None)?;
    let dense = &motion.dense;
    let limits = path_limits(&setup.arm)?;
    let turns = places.iter().zip(&dense.waypoints).filter(|(place, _)| place.turns_back);
    let stops: Vec<usize> = turns.map(|(_, at)| *at).collect();
    let path = JointPath { q: &dense.q, burr_mm: &dense.burr_mm, pose: &dense.pose, stops: &stops };
    let caps: Vec<f64> = places.iter().map(|place| place.speed_mm_s).collect();
    let law = PreparedPath::new(&path, &limits)?.law(&dense.per_place(&caps))?;
    let times = law.waypoint_times_s();
    let waypoint_times_s = dense.waypoints.iter().map(|place| times[*place]).collect();
    let driven_mm_s = dense.greatest_per_waypoint(&law.burr_speeds_mm_s());
    let limit_ratios = law.limit_ratios(&limits);
    Ok(ToolMotion { motion, law, waypoint_times_s, driven_mm_s, limit_ratios })
}

/// Length of the move that ends at each waypoint, mm.
pub fn lengths_mm(places: &[TipPlace]) -> Vec<f64> {
    let before = places.first().into_iter().chain(places);
    places.iter().zip(before).map(|(place, before)| (place.depth_mm - before.depth_mm).abs()).collect()
}
