//! Arms: description, kinematics, and where the patient is.
//!
//! From a URDF to an [`Arm`]: checked once, plain data afterwards, mm and rad throughout (metres end in the readers).
//! Forward kinematics, Jacobian, inverse and compliance hold for any serial arm; UR arms ([`ur`]) and the shipped 4-DOF
//! [`arm::bone_attached`] have their inverse in closed form. [`registration`] fits fiducials.
//!
//! Only [`arm::load`], [`arm::read_urdf`] and [`ur::read_calibration`] open a file; out of reach is a value ([`JointExcess`]), not
//! an error.

pub mod arm;
mod error;
pub mod registration;
pub mod ur;

pub use arm::{Arm, ArmKind, Joint, JointExcess, JointKind, ToolMount, read_urdf};
pub use error::{CalibrationFault, RobotError, UrdfFault};
