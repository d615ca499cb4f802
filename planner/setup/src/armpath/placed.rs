//! The arm where it stands, and the joint positions along a path of points and shaft axes.
//!
//! Points and unit axes come in work; which joint vectors the arm takes there is decided over the whole sequence
//! ([`bonemill_robot::resolve`]). A waypoint out of reach is an error that names it.

use crate::PlanError;
use bonemill_arm::Arm;
use bonemill_arm::arm::AxisPose;
use bonemill_geometry::{Base, Point, Rigid, Work};
use bonemill_robot::resolve::{
    DensePath, Meeting, OutOfReach, PosePath, Posture, ReachReason, Resolved, RollFrame, Stiffness, resolve,
};
use bonemill_robot::room::Room;
use nalgebra::{Unit, Vector3};

/// The arm where it stands.
#[derive(Debug, Clone, Copy)]
pub struct Placed<'a> {
    /// Its kinematics.
    pub arm: &'a Arm,
    /// Where the patient is.
    pub base_from_work: &'a Rigid<Base, Work>,
    /// Which posture it must be in.
    pub posture: Posture<'a>,
    /// What its links must keep clear of.
    pub room: Option<&'a Room>,
}

/// Joint positions along the path.
#[derive(Debug, Clone)]
pub struct ArmMotion {
    /// At the waypoints.
    pub resolved: Resolved,
    /// With places between them.
    pub dense: DensePath,
}

impl<'a> Placed<'a> {
    /// A point and a shaft axis in work, converted to the arm's base.
    pub fn pose(&self, position: Point<Work>, axis: &Unit<Vector3<f64>>) -> AxisPose {
        AxisPose {
            position: *self.base_from_work * position,
            axis: Unit::new_normalize(self.base_from_work.rotate(axis)),
        }
    }

    /// Spins are counted about the approach.
    pub fn frame(&self) -> RollFrame {
        RollFrame::about(&Unit::new_normalize(self.base_from_work.rotate(&Vector3::z())))
    }

    /// The link that keeps the arm from taking a pose, and what it meets; `None` where it can take the pose, or something else is why.
    pub fn meets(&self, position: Point<Work>, axis: &Unit<Vector3<f64>>) -> Option<Meeting> {
        let room = Some(self.room?);
        let poses = [self.pose(position, axis)];
        let frame = self.frame();
        let path = PosePath {
            poses: &poses,
            length_mm: &[0.0],
            frame,
            stiffness: None,
            posture: self.posture,
            room,
        };
        match resolve(self.arm, &path) {
            Ok(Err(OutOfReach { reason: ReachReason::Meets(meeting), .. })) => Some(meeting),
            _ => None,
        }
    }

    /// Joint positions along points and axes in work.
    ///
    /// `stiffness`: of the joints, and the directions in work in which the arm should yield little; `None` ignores stiffness.
    ///
    /// # Errors
    /// [`PlanError::OutOfReach`] naming the waypoint.
    pub fn motion(
        &self,
        positions: &[Point<Work>],
        axes: &[Unit<Vector3<f64>>],
        length_mm: &[f64],
        stiffness: Option<Stiffness<'_>>,
    ) -> Result<ArmMotion, PlanError> {
        let poses: Vec<AxisPose> = positions.iter().zip(axes).map(|(p, a)| self.pose(*p, a)).collect();
        let in_base: Option<Vec<_>> = stiffness.map(|stiffness| {
            let turned = |u: &Unit<Vector3<f64>>| Unit::new_normalize(self.base_from_work.rotate(u));
            stiffness.toward.iter().map(|u| u.as_ref().map(turned)).collect()
        });
        let stiffness = stiffness
            .zip(in_base.as_deref())
            .map(|(Stiffness { joint, .. }, toward)| Stiffness { joint, toward });
        let path = PosePath {
            poses: &poses,
            length_mm,
            frame: self.frame(),
            stiffness,
            posture: self.posture,
            room: self.room,
        };
        let out_of_reach = |failed: OutOfReach| PlanError::OutOfReach {
            waypoint: failed.pose,
            axis: axes[failed.pose],
            excess: failed.reason.to_string(),
            meets: matches!(failed.reason, ReachReason::Meets(_)),
        };
        let resolved = resolve(self.arm, &path)?.map_err(out_of_reach)?;
        let dense = DensePath::lay(self.arm, &path, &resolved).map_err(out_of_reach)?;
        Ok(ArmMotion { resolved, dense })
    }
}
