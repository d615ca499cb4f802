//! Universal Robots' e-series, UR20 and UR30: nominal kinematics, the URDF made from them, calibration and closed-form inverse.
//!
//! base is the DH table's frame 0, the frame in which the controller and its pendant show positions. In ROS descriptions
//! `base_link` is turned by π about z relative to it; joint values are the same. `tool0` is the DH table's frame 6.
//!
//! A real arm differs from the nominal parameters by 1–2 mm; [`Calibration`] holds those of one arm. Accelerations and
//! jerks are unpublished; [`LIMITS_ASSUMED`] holds assumed values.
//!
//! Metres are used only here, where UR's data enter. Invariants: the URDF and [`UrGeometry`] describe the same arm
//! (tested); the inverse of a calibrated arm starts from the nominal branches and is exact.
//!
//! **Source:** DH parameters, ranges and speeds: Universal Robots, "DH parameters for calculations of kinematics and
//! dynamics" and the data sheets; of UR16e, UR20 and UR30 `config/ur*/{default_kinematics,joint_limits}.yaml` of Universal Robots'
//! ROS 2 description, version 2.4.5.

pub mod branch;
pub mod calibration;
pub mod ik;
pub mod links;
mod urdf;

use std::f64::consts::{FRAC_PI_2, TAU};

pub use branch::{Branches, branch_name};
pub use calibration::{Calibration, read_calibration, read_ur};
pub use ik::{UrGeometry, UrSolutions};
pub use urdf::has_ur_joints;

use crate::arm::Arm;
use crate::error::RobotError;

/// Acceleration and jerk limits of every joint: 5 rad/s² and 250 rad/s³, that is full acceleration within 0.02 s. Assumed:
/// well below the 40 rad/s² that the controller accepts, and equal to the 5 rad/s² of ROS descriptions.
pub const LIMITS_ASSUMED: (f64, f64) = (5.0, 250.0);

/// A Universal Robots arm whose numbers are known.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum UrModel {
    /// 500 mm of reach.
    Ur3e,
    /// 850 mm of reach.
    Ur5e,
    /// 1300 mm of reach.
    Ur10e,
    /// 900 mm of reach.
    Ur16e,
    /// 1750 mm of reach.
    Ur20,
    /// 1300 mm of reach.
    Ur30,
}

/// One row of a DH table: Rz(q + θ) Tz(d) Tx(a) Rx(α); metres and radians, as UR gives them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct DhRow {
    pub theta: f64,
    pub d_m: f64,
    pub a_m: f64,
    pub alpha: f64,
}

impl UrModel {
    /// All models.
    pub const ALL: [Self; 6] = [Self::Ur3e, Self::Ur5e, Self::Ur10e, Self::Ur16e, Self::Ur20, Self::Ur30];

    /// The names of all models, for messages.
    pub fn names() -> String {
        Self::ALL.map(Self::name).join(", ")
    }

    /// Name in a case file, such as `ur5e`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ur3e => "ur3e",
            Self::Ur5e => "ur5e",
            Self::Ur10e => "ur10e",
            Self::Ur16e => "ur16e",
            Self::Ur20 => "ur20",
            Self::Ur30 => "ur30",
        }
    }

    /// The model with this name, if there is one.
    pub fn by_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|model| model.name() == name)
    }

    /// Reach from the base's axis to the wrist, mm, as the data sheets print it.
    pub fn reach_mm(self) -> f64 {
        match self {
            Self::Ur3e => 500.0,
            Self::Ur5e => 850.0,
            Self::Ur10e | Self::Ur30 => 1300.0,
            Self::Ur16e => 900.0,
            Self::Ur20 => 1750.0,
        }
    }

    /// The nominal DH table.
    pub(crate) fn dh(self) -> [DhRow; 6] {
        let [a2, a3, d1, d4, d5, d6] = match self {
            Self::Ur3e => [-0.24355, -0.2132, 0.15185, 0.13105, 0.08535, 0.0921],
            Self::Ur5e => [-0.425, -0.3922, 0.1625, 0.1333, 0.0997, 0.0996],
            Self::Ur10e => [-0.6127, -0.57155, 0.1807, 0.17415, 0.11985, 0.11655],
            Self::Ur16e => [-0.4784, -0.36, 0.1807, 0.17415, 0.11985, 0.11655],
            Self::Ur20 => [-0.862, -0.7287, 0.2363, 0.201, 0.1593, 0.1543],
            Self::Ur30 => [-0.637, -0.5037, 0.2363, 0.201, 0.1593, 0.1543],
        };
        let row = |d_m, a_m, alpha| DhRow { theta: 0.0, d_m, a_m, alpha };
        [
            row(d1, 0.0, FRAC_PI_2),
            row(0.0, a2, 0.0),
            row(0.0, a3, 0.0),
            row(d4, 0.0, FRAC_PI_2),
            row(d5, 0.0, -FRAC_PI_2),
            row(d6, 0.0, 0.0),
        ]
    }

    /// The nominal geometry for the closed-form inverse.
    pub fn geometry(self) -> UrGeometry {
        let dh = self.dh();
        let mm = |metres: f64| metres * 1000.0;
        UrGeometry {
            d1_mm: mm(dh[0].d_m),
            a2_mm: mm(dh[1].a_m),
            a3_mm: mm(dh[2].a_m),
            d4_mm: mm(dh[3].d_m),
            d5_mm: mm(dh[4].d_m),
            d6_mm: mm(dh[5].d_m),
        }
    }

    /// Joint speed limits, rad/s: 180°/s, but 360°/s for the UR3e's wrist, 120°/s for the first two joints of the arms above the UR5e, and
    /// 150°/s for the elbow and 210°/s for the wrist of UR20 and UR30.
    pub(crate) fn velocity(self) -> [f64; 6] {
        let (half, third) = (TAU / 2.0, TAU / 3.0);
        match self {
            Self::Ur3e => [half, half, half, TAU, TAU, TAU],
            Self::Ur5e => [half; 6],
            Self::Ur10e | Self::Ur16e => [third, third, half, half, half, half],
            Self::Ur20 | Self::Ur30 => {
                let [elbow, wrist] = [150.0, 210.0].map(f64::to_radians);
                [third, third, elbow, wrist, wrist, wrist]
            }
        }
    }
}

impl Arm {
    /// A UR arm with its nominal kinematics, or those of a calibration; its chain ends at `tool0`.
    ///
    /// # Errors
    /// [`RobotError::Calibration`] where the calibration is not of this model: the flange would be more than 20 mm from the
    /// nominal one.
    pub fn ur(model: UrModel, calibration: Option<&Calibration>) -> Result<Self, RobotError> {
        let text = urdf::text(model, calibration);
        let arm = Self::from_urdf(&text, model.name())?
            .with_assumed_ur_limits()?
            .with_ur_inverse(model.geometry(), calibration.is_some());
        if calibration.is_some() {
            calibration::check(model, &arm)?;
        }
        Ok(arm)
    }

    /// The arm with assumed acceleration and jerk limits, which URDFs of UR arms do not state.
    pub(crate) fn with_assumed_ur_limits(self) -> Result<Self, RobotError> {
        let (acceleration, jerk) = LIMITS_ASSUMED;
        self.with_limits(None, Some(&[acceleration; 6]))?.with_jerk_limits(&[jerk; 6])
    }
}

#[cfg(test)]
mod tests;
