//! Arms, their kinematics, and the time law along a joint path. This crate re-exports the robot's crates under one name.
//!
//! A URDF is checked once and becomes an [`Arm`], which is plain data in mm and rad (the readers convert metres).
//! Forward kinematics, Jacobian, inverse and compliance work for any serial arm. UR arms ([`ur`]) and the supplied 4-DOF
//! [`arm::bone_attached`] have an inverse in closed form. [`resolve`] chooses joint vectors along a whole path of points
//! and axes, keeping the links clear of what stands in the [`room`]; [`timelaw`] turns them into a motion that keeps velocity, acceleration and jerk limits at every instant, and
//! [`export`] writes it.
//!
//! Invariants: only [`arm::load`], [`arm::read_urdf`] and [`ur::read_calibration`] open a file; exporters write to a writer
//! that the caller opens; a pose out of reach is a value ([`JointExcess`], [`resolve::OutOfReach`]), not an error; the same
//! input gives the same output, bit for bit, on any number of threads. The path itself comes from the planner, and
//! streaming to hardware is in the Python package.
//!
//! ```
//! use bonemill_geometry::Point;
//! use bonemill_robot::{Arm, arm::bone_attached, timelaw::{CornerTolerance, JointPath, PathLimits, PreparedPath}};
//!
//! let arm = Arm::bone_attached()?;
//! let from = bone_attached::ik(Point::new(0.0, 0.0, 10.0), 0.0);
//! let to = bone_attached::ik(Point::new(8.0, 0.0, 4.0), 0.5);
//! assert_eq!(arm.beyond_limits(&to)?, None);
//! assert!((arm.burr(&to)?.translation_mm.x - 8.0).abs() < 1e-12);
//!
//! let limits = PathLimits::of_arm(&arm, CornerTolerance::default())?;
//! let pose = [[0.0, 0.0, 10.0, 0.0, 0.0, 1.0], [8.0, 0.0, 4.0, -0.5f64.sin(), 0.0, 0.5f64.cos()]];
//! let path = JointPath { q: &[from, to].concat(), burr_mm: &[0.0, 10.0], pose: &pose, stops: &[] };
//! let law = PreparedPath::new(&path, &limits)?.law(&[0.0, 2.0])?;
//! assert!(law.duration_s() > 5.0 && law.duration_s() < 5.3);
//! # Ok::<(), bonemill_robot::RobotError>(())
//! ```

pub mod export;
pub mod resolve;
pub mod room;
pub mod stream;
pub mod timelaw;

pub use bonemill_arm::{
    Arm, ArmKind, CalibrationFault, Joint, JointExcess, JointKind, RobotError, ToolMount, UrdfFault, arm,
    read_urdf, registration, ur,
};
