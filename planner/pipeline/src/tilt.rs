//! The axes that an arm can point the shaft along, and how fast it turns them.

use bonemill_arm::{Arm, ArmKind};
use bonemill_geometry::{Base, Rigid, Work};
use bonemill_scene::Scene;
use bonemill_toolpath::orientation::TiltFamily;
use nalgebra::{Unit, Vector3};

/// How fast an arm that can point anywhere turns the shaft while it cuts, rad/s: as the bone-attached arm does. Assumed.
const TILT_RATE_RAD_S: f64 = 0.6;
/// How far it tilts the shaft from the approach, rad: 70°, as the bone-attached arm does. Assumed; the case's limit binds
/// cuts beside it.
const TILT_RANGE_RAD: f64 = 70.0 * std::f64::consts::PI / 180.0;
/// The axes to choose from, in work: those of the bone-attached arm's tilt; for an arm that can point anywhere the y–z
/// plane of θ, which is where the bone-attached arm tilts under the assumed registration.
pub fn tilt_family(arm: &Arm, base_from_work: &Rigid<Base, Work>, scene: &Scene) -> TiltFamily {
    if arm.kind() != ArmKind::BoneAttached {
        let work_from_approach = scene.ct_from_work.inverse() * scene.ct_from_approach();
        return TiltFamily {
            hinge: Unit::new_normalize(work_from_approach.rotate(&Vector3::x())),
            zero: Vector3::z_axis(),
            lower_rad: -TILT_RANGE_RAD,
            upper_rad: TILT_RANGE_RAD,
        };
    }
    let work_from_base = base_from_work.rotation.inverse();
    let tilt = &arm.joints()[3];
    TiltFamily {
        // the joint turns the axis from z towards −x: about −y
        hinge: Unit::new_normalize(work_from_base * -Vector3::y()),
        zero: Unit::new_normalize(work_from_base * Vector3::z()),
        lower_rad: tilt.lower,
        upper_rad: tilt.upper,
    }
}

/// How fast the arm turns the shaft while it cuts, rad/s.
pub fn tilt_rate_rad_s(arm: &Arm) -> f64 {
    match arm.kind() {
        ArmKind::BoneAttached => arm.joints()[3].velocity_limit,
        ArmKind::Ur | ArmKind::Other => TILT_RATE_RAD_S,
    }
}
