//! Arms: serial chains of prismatic and revolute joints with their limits and what they hold.
//!
//! Positions, velocities and accelerations are mm and rad by the joint's kind; poses are [`bonemill_geometry::Rigid`] from flange to base.
//! An [`Arm`] is plain data: every function is pure, and threads may share one. It is checked when it is built. After
//! that, the only possible errors are a joint vector of the wrong length or with values that are not finite.
//!
//! Every arm has inverse kinematics ([`Arm::inverse`]): UR arms and the bone-attached arm in closed form, others by damped
//! least squares.

pub mod bone_attached;
pub mod dls;
pub mod inverse;
mod joint;
mod kinematics;
mod mount;
mod reader;
mod urdf;

pub use inverse::{AxisPose, Solutions};
pub use joint::{Joint, JointExcess, JointKind};
pub use kinematics::compliance_mm_per_n;
pub use mount::{BlockMount, Mount, ToolMount};
pub(crate) use reader::read_text;
pub use reader::{NAMES, load, read_urdf};

use crate::error::RobotError;
use crate::ur::{UrGeometry, UrModel};
pub use dls::ToolGoal;
pub use inverse::InverseKind;
use urdf::Segment;

/// The kinds of arm that are planned for in different ways.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ArmKind {
    /// Three linear joints and a tilt.
    BoneAttached,
    /// A Universal Robots arm.
    Ur,
    /// Any other serial arm.
    Other,
}

/// A serial arm: kinematics, limits, what it holds.
#[derive(Debug, Clone, PartialEq)]
pub struct Arm {
    urdf_text: String,
    base_link: String,
    segments: Vec<Segment>,
    joints: Vec<Joint>,
    mount: Mount,
    inverse: InverseKind,
}

impl Arm {
    /// The arm that a URDF describes, from `base_link` (else the root) to `tool0` (else the only tip).
    ///
    /// Accelerations and jerks that the URDF's `<limit>` does not state are assumed: every joint reaches full speed in
    /// 0.1 s, and full acceleration in 0.02 s.
    /// `source_name` is the name of the file or arm in messages.
    ///
    /// # Errors
    /// [`RobotError::ParseUrdf`] where the text is not a URDF; [`RobotError::Urdf`] where links and joints do not form an open
    /// chain with one tip, where no joint moves, or where a number or limit is impossible.
    pub fn from_urdf(text: &str, source_name: &str) -> Result<Self, RobotError> {
        let urdf::Description { base, segments, joints } = urdf::parse(text, source_name)?;
        let (mount, inverse) = (ToolMount::default().into(), InverseKind::Numeric);
        Ok(Self { urdf_text: text.to_owned(), base_link: base, segments, joints, mount, inverse })
    }

    /// The same arm within tighter limits, one value per joint, mm/s or rad/s and mm/s² or rad/s².
    ///
    /// Velocities: the stricter of the given value and the URDF's. Accelerations: the given value. `None` leaves the limits
    /// unchanged.
    ///
    /// # Errors
    /// [`RobotError::Length`] or [`RobotError::Value`] (not finite, not above 0).
    pub fn with_limits(
        mut self,
        velocity: Option<&[f64]>,
        acceleration: Option<&[f64]>,
    ) -> Result<Self, RobotError> {
        let dof = self.dof();
        if let Some(velocity) = velocity {
            check_positive("velocity_limits", velocity, dof, "mm/s or rad/s")?;
            for (joint, &limit) in self.joints.iter_mut().zip(velocity) {
                joint.velocity_limit = joint.velocity_limit.min(limit);
            }
        }
        if let Some(acceleration) = acceleration {
            check_positive("acceleration_limits", acceleration, dof, "mm/s² or rad/s²")?;
            for (joint, &limit) in self.joints.iter_mut().zip(acceleration) {
                joint.acceleration_limit = limit;
                joint.jerk_limit = joint::assumed_jerk(limit);
            }
        }
        Ok(self)
    }

    /// The same arm with other jerk limits, one per joint, mm/s³ or rad/s³.
    ///
    /// # Errors
    /// [`RobotError::Length`] or [`RobotError::Value`] (not finite, not above 0).
    pub fn with_jerk_limits(mut self, jerk: &[f64]) -> Result<Self, RobotError> {
        check_positive("jerk_limits", jerk, self.dof(), "mm/s³ or rad/s³")?;
        for (joint, &limit) in self.joints.iter_mut().zip(jerk) {
            joint.jerk_limit = limit;
        }
        Ok(self)
    }

    /// The same arm with the closed form of a UR's geometry. If `calibrated`, its results are only the starts of a search.
    pub(crate) fn with_ur_inverse(mut self, geometry: UrGeometry, calibrated: bool) -> Self {
        self.inverse = InverseKind::Ur { geometry, calibrated };
        self
    }

    /// The same arm with the closed form of the bone-attached layout.
    fn with_bone_attached_inverse(mut self) -> Self {
        self.inverse = InverseKind::BoneAttached;
        self
    }

    /// The same arm with a tool or a block on its flange. The bone-attached layout's closed form leaves it out.
    #[must_use]
    pub fn with_mount(mut self, mount: impl Into<Mount>) -> Self {
        self.mount = mount.into();
        self
    }

    /// Completes an arm that was read back from the URDF written for a model: adds the model's assumed limits and its closed
    /// form, which a URDF cannot hold. For any other name the arm is unchanged.
    ///
    /// # Errors
    /// [`RobotError::Length`] where the URDF has another number of joints than the model.
    pub fn of_model(self, name: &str) -> Result<Self, RobotError> {
        if name == "bone-attached" {
            let arm = self.with_limits(None, Some(&bone_attached::ACCELERATION_LIMITS))?;
            return Ok(arm.with_bone_attached_inverse());
        }
        match UrModel::by_name(name) {
            // `true`: the search makes the inverse exact whether or not the URDF is calibrated
            Some(model) => Ok(self.with_assumed_ur_limits()?.with_ur_inverse(model.geometry(), true)),
            None => Ok(self),
        }
    }

    /// The kind of arm.
    pub fn kind(&self) -> ArmKind {
        match self.inverse {
            InverseKind::BoneAttached => ArmKind::BoneAttached,
            InverseKind::Ur { .. } => ArmKind::Ur,
            InverseKind::Numeric => ArmKind::Other,
        }
    }

    /// Number of moving joints.
    pub fn dof(&self) -> usize {
        self.joints.len()
    }

    /// The moving joints from base to tip.
    pub fn joints(&self) -> &[Joint] {
        &self.joints
    }

    /// What the arm holds, and so the work frame of its tool's poses.
    pub fn mount(&self) -> Mount {
        self.mount
    }

    /// The URDF's text as it was read, for `robot.urdf`. It does not contain limits that were set later.
    pub fn urdf_text(&self) -> &str {
        &self.urdf_text
    }

    /// The URDF's link whose frame is the base.
    pub fn base_link(&self) -> &str {
        &self.base_link
    }

    /// The joint furthest beyond its limits, relative to the joint's range; `None` if all are within their limits.
    ///
    /// # Errors
    /// [`RobotError::Length`] or [`RobotError::Value`] where `q` is not a joint vector of this arm.
    pub fn beyond_limits(&self, q: &[f64]) -> Result<Option<JointExcess>, RobotError> {
        self.check_q(q)?;
        Ok(joint::worst_excess(&self.joints, q))
    }

    /// [`Arm::beyond_limits`] for a joint vector that was checked.
    pub fn excess_at(&self, q: &[f64]) -> Option<JointExcess> {
        joint::worst_excess(&self.joints, q)
    }

    /// How this arm's inverse kinematics are computed.
    pub fn inverse_kind(&self) -> InverseKind {
        self.inverse
    }

    /// Checks that `q` has one finite value per joint.
    fn check_q(&self, q: &[f64]) -> Result<(), RobotError> {
        if q.len() != self.dof() {
            return Err(RobotError::Length { what: "joint position", got: q.len(), expected: self.dof() });
        }
        match q.iter().position(|value| !value.is_finite()) {
            None => Ok(()),
            Some(index) => Err(RobotError::Value {
                what: "joint position",
                index,
                value: q[index],
                unit: self.joints[index].kind.unit(),
                expected: "a finite number",
            }),
        }
    }
}

/// Checks that `values` has one finite value above 0 per joint.
pub fn check_positive(
    what: &'static str,
    values: &[f64],
    expected_len: usize,
    unit: &'static str,
) -> Result<(), RobotError> {
    if values.len() != expected_len {
        return Err(RobotError::Length { what, got: values.len(), expected: expected_len });
    }
    match values.iter().position(|value| !(value.is_finite() && *value > 0.0)) {
        None => Ok(()),
        Some(index) => Err(RobotError::Value {
            what,
            index,
            value: values[index],
            unit,
            expected: "a finite number above 0",
        }),
    }
}

#[cfg(test)]
mod tests;
