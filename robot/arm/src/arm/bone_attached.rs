//! The 4-DOF bone-attached arm in closed form: three linear joints and a tilt.
//!
//! D's robot has this layout; its geometry, limits and speeds are unpublished, so all numbers here and in
//! `urdf/bone_attached.urdf` are assumed. With L the distance from burr to pivot and q = (x, y, z, t):
//! axis(t) = (−sin t, 0, cos t), burr = (x + L sin t, y, z + L (1 − cos t)), both in base.
//! So the tool axis stays in base's x–z plane; within the limits, every burr position can be combined with every tilt.
//!
//! Invariants: [`ik`] ∘ forward kinematics is the identity up to rounding; the formulas agree with the URDF (tested).
//!
//! **Source:** layout: Dillon et al. 2016; formulas: derived here from the URDF.

use bonemill_geometry::{Base, Point};
use nalgebra::Vector3;

use super::{Arm, JointExcess, joint};
use crate::error::RobotError;

/// The URDF of the arm; every number in it is assumed.
pub const URDF: &str = include_str!("../../urdf/bone_attached.urdf");

/// Distance from the burr's centre back along the shaft to the tilt's pivot, mm. Assumed.
pub const PIVOT_TO_BURR_MM: f64 = 50.0;

/// Acceleration limits of x, y, z [mm/s²] and tilt [rad/s²]: full speed within 0.1 s. Assumed; jerks follow from them.
pub const ACCELERATION_LIMITS: [f64; 4] = [150.0, 150.0, 150.0, 6.0];

impl Arm {
    /// The 4-DOF bone-attached arm. Its URDF ends at the burr, so it needs no mount.
    ///
    /// # Errors
    /// None in practice, because a test checks the description. The type is that of [`Arm::from_urdf`].
    pub fn bone_attached() -> Result<Self, RobotError> {
        let arm = Self::from_urdf(URDF, "bone-attached")?.with_limits(None, Some(&ACCELERATION_LIMITS))?;
        Ok(arm.with_bone_attached_inverse())
    }
}

/// Shaft axis at a tilt, in base: (−sin t, 0, cos t), unit, from burr to handpiece.
pub fn axis(tilt_rad: f64) -> Vector3<f64> {
    let (sin, cos) = tilt_rad.sin_cos();
    Vector3::new(-sin, 0.0, cos)
}

/// Joint positions (mm, mm, mm, rad) that bring the burr's centre to a point at a tilt.
///
/// x = p_x − L sin t, y = p_y, z = p_z − L (1 − cos t). Joint limits are not checked; see [`beyond_limits`].
pub fn ik(burr_center: Point<Base>, tilt_rad: f64) -> [f64; 4] {
    let (sin, _) = tilt_rad.sin_cos();
    // 1 − cos t = 2 sin²(t/2) stays accurate at small tilts
    let half = (0.5 * tilt_rad).sin();
    let (x, z) = (PIVOT_TO_BURR_MM * sin, PIVOT_TO_BURR_MM * 2.0 * half * half);
    [burr_center.x() - x, burr_center.y(), burr_center.z() - z, tilt_rad]
}

/// The tilt whose axis is nearest to a requested axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NearestTilt {
    /// The tilt, rad, in (−π, π].
    pub tilt_rad: f64,
    /// Angle between its axis and the requested one, rad, in [0, π/2]; 0 if that lies in base's x–z plane.
    pub error_rad: f64,
}

/// The tilt nearest to a tool axis given in base, of any length; `None` for base ±y and for zero, where all tilts are
/// equally near.
///
/// t = atan2(−a_x, a_z), error = atan2(|a_y|, |(a_x, a_z)|).
pub fn tilt_for_axis(axis_base: &Vector3<f64>) -> Option<NearestTilt> {
    let in_plane = axis_base.x.hypot(axis_base.z);
    // + 0.0 turns −0 into 0, so that an untilted axis gives 0 and a reversed one +π
    let nearest = NearestTilt {
        tilt_rad: (-axis_base.x + 0.0).atan2(axis_base.z),
        error_rad: axis_base.y.abs().atan2(in_plane),
    };
    (axis_base.iter().all(|a| a.is_finite()) && in_plane > 1e-12 * axis_base.y.abs()).then_some(nearest)
}

/// The joint furthest beyond the limits of `arm` when its first four joints are at `q`; `None` if all are within limits.
pub fn beyond_limits(arm: &Arm, q: &[f64; 4]) -> Option<JointExcess> {
    joint::worst_excess(arm.joints(), q)
}
