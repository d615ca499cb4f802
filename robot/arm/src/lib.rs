//! Arms: description, kinematics, and registration of the patient.
//!
//! A URDF is checked once and becomes an [`Arm`], which is plain data in mm and rad (the readers convert metres).
//! Forward kinematics, Jacobian, inverse and compliance work for any serial arm. UR arms ([`ur`]) and the supplied 4-DOF
//! [`arm::bone_attached`] have an inverse in closed form. [`registration`] fits fiducials.
//!
//! Only [`arm::load`], [`arm::read_urdf`] and [`ur::read_calibration`] open a file. A pose out of reach is a value
//! ([`JointExcess`]), not an error.

pub mod arm;
mod error;
pub mod registration;
pub mod ur;

pub use arm::{Arm, ArmKind, Joint, JointExcess, JointKind, Mount, ToolMount, read_urdf};
pub use error::{CalibrationFault, RobotError, UrdfFault};
