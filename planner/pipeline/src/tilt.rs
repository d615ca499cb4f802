//! The axes that an arm can point the shaft along, and how fast it turns them.

use bonemill_arm::{Arm, ArmKind};
use bonemill_geometry::{Base, Rigid, Work};
use bonemill_toolpath::orientation::{TiltFamily, TurnTime};
use bonemill_toolpath::scene::Scene;
use nalgebra::{Unit, Vector3, Vector6};

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

/// How long the arm needs to turn the shaft about the burr in a posture `q`, by the turn about the hinge of `family`, or the slowest of
/// the turns about work x and y.
///
/// A turn at 1 rad/s with the burr at rest takes the least joint velocities that solve J q̇ = (0, ω), the spin about the shaft left
/// free; joint j then allows q̇_max,j/|q̇_j| rad/s and q̈_max,j/|q̇_j| rad/s². `None` where the arm cannot turn so at all.
pub fn turn_time(
    arm: &Arm,
    q: &[f64],
    base_from_work: &Rigid<Base, Work>,
    family: Option<&TiltFamily>,
) -> Option<TurnTime> {
    let axis = arm.tool_at(q).rotation * Vector3::z();
    let across = |v: Vector3<f64>| v - axis * axis.dot(&v);
    let mut jacobian = arm.tool_jacobian_at(q);
    for mut column in jacobian.column_iter_mut() {
        let turn = across(column.fixed_rows::<3>(3).into_owned());
        column.fixed_rows_mut::<3>(3).copy_from(&(LEVER_MM * turn));
    }
    let inverse = jacobian.pseudo_inverse(SINGULAR).ok()?;
    let hinges = family.map_or(vec![Vector3::x_axis(), Vector3::y_axis()], |family| vec![family.hinge]);
    let (mut rate_rad_s, mut acceleration_rad_s2) = (f64::INFINITY, f64::INFINITY);
    let count = hinges.len();
    for hinge in hinges {
        let turn = LEVER_MM * across(base_from_work.rotation * hinge.into_inner());
        let rates = &inverse * Vector6::new(0.0, 0.0, 0.0, turn.x, turn.y, turn.z);
        for (joint, rate) in arm.joints().iter().zip(rates.iter()).filter(|(_, rate)| rate.abs() > SINGULAR) {
            rate_rad_s = rate_rad_s.min(joint.velocity_limit / rate.abs());
            acceleration_rad_s2 = acceleration_rad_s2.min(joint.acceleration_limit / rate.abs());
        }
    }
    let is_known = rate_rad_s.is_finite() && acceleration_rad_s2.is_finite();
    is_known.then_some(TurnTime { rate_rad_s, acceleration_rad_s2, factor: FIRST_FACTOR[count - 1] })
}

/// Driven over predicted time of turns, before it is measured on the plan itself, in a plane and over a cap: as it is on blocks with the
/// bone-attached arm and a UR5e.
const FIRST_FACTOR: [f64; 2] = [1.8, 6.0];
/// A turn by 1 rad weighs as much as the burr's way of so many mm.
const LEVER_MM: f64 = 100.0;
/// Singular values, mm, and joint velocities below this count as none.
const SINGULAR: f64 = 1e-6;
