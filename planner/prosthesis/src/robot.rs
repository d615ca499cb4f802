//! The toolpath by a UR arm: spindle on the flange, block on a table that turns it between the sides.
//!
//! Assumed: the cutter's tip is 150 mm before the flange and the cutter along the flange's z; the program's zero lies before the arm and
//! a little above its base, the cutter upright. Collisions of the arm's links are not looked at.

use bonemill_arm::arm::{Arm, ToolMount};
use bonemill_arm::ur::UrModel;
use bonemill_export::write_trajectory_csv;
use bonemill_geometry::Rigid;
use bonemill_machining::trajectory::{ArmMotion, spindle_on_flange};
use bonemill_machining::{MachiningError, Move};
use nalgebra::{Isometry3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// Rows of trajectory.csv a second; a controller interpolates between them.
const RATE_HZ: f64 = 50.0;
/// From the flange to the cutter's tip, mm. Assumed.
const TIP_MM: f64 = 150.0;
/// Where the program's zero lies, as shares of the arm's reach: before the base, above it. Assumed.
const PLACE: [f64; 2] = [0.55, 0.05];

/// An arm's motion along a toolpath.
#[derive(Debug)]
pub struct RobotMotion {
    /// The arm.
    pub model: UrModel,
    /// How long it takes, s.
    pub duration_s: f64,
    /// `trajectory.csv`.
    pub csv: Vec<u8>,
}

/// The moves by an arm; `Err` of the inside tells why it cannot.
pub(crate) fn motion(model: UrModel, moves: &[Move]) -> Result<Result<RobotMotion, String>, MachiningError> {
    let mount = Rigid::new(
        Rotation3::from_euler_angles(std::f64::consts::PI, 0.0, 0.0),
        Vector3::new(0.0, 0.0, TIP_MM),
    );
    let arm = Arm::ur(model, None)?.with_mount(ToolMount { flange_from_burr: mount });
    let [before, above] = PLACE.map(|share| share * model.reach_mm());
    let place = Isometry3::from_parts(Translation3::new(before, 0.0, above), UnitQuaternion::identity());
    match spindle_on_flange(&arm, &place, moves)? {
        Ok(motion) => Ok(Ok(written(model, &arm, &motion)?)),
        Err(out) => {
            Ok(Err(format!("the {} cannot follow move {}: {:?}", model.name(), out.pose, out.reason)))
        }
    }
}

fn written(model: UrModel, arm: &Arm, motion: &ArmMotion) -> Result<RobotMotion, MachiningError> {
    let kinds: Vec<_> = arm.joints().iter().map(|joint| joint.kind).collect();
    let mut csv = Vec::new();
    write_trajectory_csv(&mut csv, &motion.law.rows(RATE_HZ)?, &kinds)?;
    Ok(RobotMotion { model, duration_s: motion.law.duration_s(), csv })
}
