//! Arms, their kinematics, and the law of time along a joint path.
//!
//! From a URDF to an [`Arm`]: checked once, plain data afterwards, mm and rad throughout (metres end in the reader).
//! Forward kinematics, Jacobian and compliance hold for any serial arm; the shipped 4-DOF [`arm::bone_attached`] has its
//! inverse in closed form. [`timelaw`] turns a polyline of joint positions with speed caps into the fastest motion that
//! keeps velocity and acceleration limits at every instant, and [`export`] writes it.
//!
//! Invariants: only [`arm::read_urdf`] opens a file, exporters write to what they are handed; out of reach is a value
//! ([`JointExcess`]), not an error; same input, same output, bit for bit, on any number of threads.
//! Not here: where to go (the planner), UR arms' inverse kinematics, limits on jerk, streaming to hardware.
//!
//! ```
//! use bonemill_geometry::Point;
//! use bonemill_robot::{Arm, arm::bone_attached, timelaw::{JointPath, PathLimits, PreparedPath}};
//!
//! let arm = Arm::bone_attached()?;
//! let from = bone_attached::ik(Point::new(0.0, 0.0, 10.0), 0.0);
//! let to = bone_attached::ik(Point::new(8.0, 0.0, 4.0), 0.5);
//! assert_eq!(arm.beyond_limits(&to)?, None);
//! assert!((arm.burr(&to)?.translation_mm.x - 8.0).abs() < 1e-12);
//!
//! let limits = PathLimits::of_arm(&arm, PathLimits::CORNER_TOLERANCE_MM)?;
//! let path = JointPath { q: &[from, to].concat(), burr_mm: &[0.0, 10.0], stops: &[] };
//! let law = PreparedPath::new(&path, &limits)?.law(&[0.0, 2.0])?;
//! assert!(law.duration_s() > 5.0 && law.duration_s() < 5.1);
//! # Ok::<(), bonemill_robot::RobotError>(())
//! ```

pub mod arm;
mod error;
pub mod export;
pub mod timelaw;

pub use arm::{Arm, Joint, JointExcess, JointKind, ToolMount, read_urdf};
pub use error::{RobotError, UrdfFault};
