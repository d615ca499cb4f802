//! Kinematics against hand-written products, finite differences and the `k` crate; the bone-attached arm against its closed
//! form.

use bonemill_geometry::{Base, Flange, Point, Rigid};
use nalgebra::{Matrix3, Rotation3, Vector3};
use proptest::prelude::*;

use super::*;
use bone_attached::{PIVOT_TO_BURR_MM, URDF, axis, ik, tilt_for_axis};

/// A five-joint arm with oblique origins and axes, fixed joints before and between, and `world` above `base_link`.
const OBLIQUE: &str = r#"<robot name="oblique">
  <link name="world"/><link name="base_link"/><link name="a"/><link name="b"/><link name="c"/>
  <link name="d"/><link name="e"/><link name="f"/><link name="tool0"/>
  <joint name="floor" type="fixed"><parent link="world"/><child link="base_link"/><origin xyz="1 2 3" rpy="0.1 0.2 0.3"/></joint>
  <joint name="j1" type="revolute"><parent link="base_link"/><child link="a"/><origin xyz="0.1 -0.2 0.3" rpy="0.4 -0.5 0.6"/>
    <axis xyz="0 0 1"/><limit lower="-3" upper="3" velocity="2" effort="1"/></joint>
  <joint name="j2" type="prismatic"><parent link="a"/><child link="b"/><origin xyz="0.05 0.01 -0.02" rpy="1.1 0.2 -0.7"/>
    <axis xyz="1 1 0"/><limit lower="-0.1" upper="0.2" velocity="0.05" effort="1"/></joint>
  <joint name="glue" type="fixed"><parent link="b"/><child link="c"/><origin xyz="0.02 0 0.1" rpy="0 1.5707963267948966 0"/></joint>
  <joint name="j3" type="continuous"><parent link="c"/><child link="d"/><origin xyz="0 0.2 0" rpy="0 0 1"/>
    <axis xyz="0.36 0.48 -0.8"/><limit velocity="1" effort="1"/></joint>
  <joint name="j4" type="revolute"><parent link="d"/><child link="e"/><origin xyz="0.07 0 0.03" rpy="-2 0.3 0"/>
    <axis xyz="0 -2 0"/><limit lower="-1" upper="2" velocity="3" effort="1"/></joint>
  <joint name="j5" type="prismatic"><parent link="e"/><child link="f"/><origin rpy="0.2 0.1 3"/>
    <axis xyz="0 0 -1"/><limit lower="0" upper="0.1" velocity="0.01" effort="1"/></joint>
  <joint name="flange" type="fixed"><parent link="f"/><child link="tool0"/><origin xyz="0 0 0.09" rpy="0 0 0.5"/></joint>
</robot>"#;

fn oblique() -> Arm {
    Arm::from_urdf(OBLIQUE, "oblique").unwrap()
}

fn origin(xyz_m: [f64; 3], rpy_rad: [f64; 3]) -> Rigid<Flange, Flange> {
    let [roll, pitch, yaw] = rpy_rad;
    let r = Rotation3::from_axis_angle(&Vector3::z_axis(), yaw)
        * Rotation3::from_axis_angle(&Vector3::y_axis(), pitch)
        * Rotation3::from_axis_angle(&Vector3::x_axis(), roll);
    Rigid::new(r, Vector3::from(xyz_m) * 1000.0)
}

fn turn(axis: [f64; 3], angle_rad: f64) -> Rigid<Flange, Flange> {
    // Rodrigues' formula, written out
    let a = Vector3::from(axis).normalize();
    let k = a.cross_matrix();
    let r = Matrix3::identity() + k * angle_rad.sin() + k * k * (1.0 - angle_rad.cos());
    Rigid::new(Rotation3::from_matrix_unchecked(r), Vector3::zeros())
}

fn slide(axis: [f64; 3], mm: f64) -> Rigid<Flange, Flange> {
    Rigid::new(Rotation3::identity(), Vector3::from(axis).normalize() * mm)
}

fn any_q() -> impl Strategy<Value = [f64; 5]> {
    (-3.0f64..3.0, -100.0f64..200.0, -7.0f64..7.0, -1.0f64..2.0, 0.0f64..100.0)
        .prop_map(|(a, b, c, d, e)| [a, b, c, d, e])
}

/// Derivative of a pose by a joint, by differences: of its place, and its angular velocity.
pub(super) fn derivative<A: bonemill_geometry::Frame, B: bonemill_geometry::Frame>(
    pose: impl Fn(&[f64]) -> Rigid<A, B>,
    q: &[f64],
    j: usize,
) -> [Vector3<f64>; 2] {
    let step = 1e-5;
    let at = |sign: f64| {
        let mut moved = q.to_vec();
        moved[j] += sign * step;
        pose(&moved)
    };
    let (ahead, behind) = (at(1.0), at(-1.0));
    let linear = (ahead.translation_mm - behind.translation_mm) / (2.0 * step);
    let turned = (ahead.rotation.into_inner() - behind.rotation.into_inner())
        * pose(q).rotation.inverse().into_inner()
        / (2.0 * step);
    [linear, Vector3::new(turned[(2, 1)], turned[(0, 2)], turned[(1, 0)])]
}

proptest! {
    #[test]
    fn the_pose_is_the_product_written_by_hand(q in any_q()) {
        let by_hand = origin([0.1, -0.2, 0.3], [0.4, -0.5, 0.6]) * turn([0.0, 0.0, 1.0], q[0])
            * origin([0.05, 0.01, -0.02], [1.1, 0.2, -0.7]) * slide([1.0, 1.0, 0.0], q[1])
            * origin([0.02, 0.0, 0.1], [0.0, std::f64::consts::FRAC_PI_2, 0.0])
            * origin([0.0, 0.2, 0.0], [0.0, 0.0, 1.0]) * turn([0.36, 0.48, -0.8], q[2])
            * origin([0.07, 0.0, 0.03], [-2.0, 0.3, 0.0]) * turn([0.0, -2.0, 0.0], q[3])
            * origin([0.0; 3], [0.2, 0.1, 3.0]) * slide([0.0, 0.0, -1.0], q[4])
            * origin([0.0, 0.0, 0.09], [0.0, 0.0, 0.5]);
        let pose = oblique().forward(&q).unwrap();
        prop_assert!((pose.translation_mm - by_hand.translation_mm).amax() < 1e-10);
        prop_assert!((pose.rotation.into_inner() - by_hand.rotation.into_inner()).amax() < 1e-13);
    }

    #[test]
    fn the_jacobian_is_the_derivative(q in any_q()) {
        let arm = oblique();
        let jacobian = arm.jacobian(&q).unwrap();
        for j in 0..5 {
            let [linear, angular] = derivative(|q| arm.forward(q).unwrap(), &q, j);
            prop_assert!((jacobian.fixed_view::<3, 1>(0, j) - linear).amax() < 1e-5, "joint {}", j);
            prop_assert!((jacobian.fixed_view::<3, 1>(3, j) - angular).amax() < 1e-9, "joint {}", j);
        }
    }

    #[test]
    fn levers_bound_the_burr_s_motion(q in any_q()) {
        let mount = ToolMount { flange_from_burr: Rigid::new(Rotation3::identity(), Vector3::new(3.0, -40.0, 90.0)) };
        let arm = oblique().with_mount(mount);
        let jacobian = arm.burr_jacobian(&q).unwrap();
        for (column, lever) in jacobian.column_iter().zip(arm.lever_mm()) {
            prop_assert!(column.norm() <= lever * (1.0 + 1e-12));
        }
    }

    #[test]
    fn the_burr_is_never_farther_than_the_chain_is_long(
        q in prop::array::uniform6(-6.2f64..6.2), at in prop::array::uniform3(-200.0f64..200.0),
    ) {
        let mount = ToolMount { flange_from_burr: Rigid::new(Rotation3::identity(), at.into()) };
        let arm = Arm::ur(crate::ur::UrModel::Ur5e, None).unwrap().with_mount(mount);
        let burr = arm.burr(&q).unwrap().translation_mm;
        prop_assert!(burr.norm() <= arm.farthest_mm().unwrap());
        let far = arm.farthest_mm().unwrap() - Vector3::from(at).norm();
        prop_assert!(far > 850.0 && far < 1400.0, "{} mm", far);
    }

    #[test]
    fn the_closed_form_brings_the_burr_there(
        p in prop::array::uniform3(-60.0f64..60.0), tilt in -1.2f64..1.2,
    ) {
        let pose = Arm::bone_attached().unwrap().burr(&ik(Point::new(p[0], p[1], p[2]), tilt)).unwrap();
        prop_assert!((pose.translation_mm - Vector3::from(p)).amax() < 1e-12 * 100.0);
        prop_assert!((pose.rotation * Vector3::z() - axis(tilt)).amax() < 1e-15 * 2.0);
    }

    #[test]
    fn the_nearest_tilt_is_the_nearest(a in prop::array::uniform3(-1.0f64..1.0), other in -3.1f64..3.1) {
        let wanted = Vector3::from(a);
        prop_assume!(wanted.norm() > 1e-3 && wanted.x.hypot(wanted.z) > 1e-6);
        let nearest = tilt_for_axis(&wanted).unwrap();
        prop_assert!((axis(nearest.tilt_rad).angle(&wanted) - nearest.error_rad).abs() < 1e-7);
        prop_assert!(axis(other).angle(&wanted) >= nearest.error_rad - 1e-7);
    }
}

#[test]
fn at_zero_the_burr_is_at_the_origin_and_the_shaft_points_up() {
    let arm = Arm::bone_attached().unwrap();
    let pose = arm.burr(&[0.0; 4]).unwrap();
    assert_eq!(pose, Rigid::identity());
    assert_eq!(arm.dof(), 4);
    assert_eq!(arm.lever_mm(), [1.0, 1.0, 1.0, PIVOT_TO_BURR_MM]);
    assert_eq!(arm.urdf_text(), URDF);
    let kinds = arm.joints().iter().map(|joint| joint.kind).collect::<Vec<_>>();
    assert_eq!(
        kinds,
        [JointKind::Prismatic, JointKind::Prismatic, JointKind::Prismatic, JointKind::Revolute]
    );
    let velocity = arm.joints().iter().map(|joint| joint.velocity_limit).collect::<Vec<_>>();
    assert_eq!(velocity, [15.0, 15.0, 15.0, 0.6]);
    let acceleration = arm.joints().iter().map(|joint| joint.acceleration_limit).collect::<Vec<_>>();
    assert_eq!(acceleration, [150.0, 150.0, 150.0, 6.0]);
}

#[test]
fn the_workspace_is_within_the_limits() {
    let arm = Arm::bone_attached().unwrap();
    let ends = |r: f64| [-r, 0.0, r];
    for (x, y, z) in ends(25.0)
        .iter()
        .flat_map(|x| ends(25.0).map(|y| (*x, y)))
        .flat_map(|(x, y)| ends(30.0).map(|z| (x, y, z)))
    {
        for tilt in ends(60f64.to_radians()) {
            let q = ik(Point::new(x, y, z), tilt);
            assert_eq!(
                bone_attached::beyond_limits(&arm, &q),
                None,
                "burr ({x}, {y}, {z}) mm, tilt {tilt} rad"
            );
        }
    }
}

#[test]
fn out_of_reach_says_by_how_much() {
    let arm = Arm::bone_attached().unwrap();
    let at = |x: f64, tilt: f64| arm.beyond_limits(&ik(Point::<Base>::new(x, 0.0, 0.0), tilt)).unwrap();
    let excess = at(88.5, 0.0).unwrap();
    assert_eq!((excess.joint, excess.limit, excess.kind), (0, 85.0, JointKind::Prismatic));
    assert!((excess.excess - 3.5).abs() < 1e-12);
    assert!(excess.to_string().contains("3.5000 mm"), "{excess}");
    let excess = at(0.0, -1.3).unwrap();
    assert!(excess.joint == 3 && (excess.excess - (1.3 - 70f64.to_radians())).abs() < 1e-12);
    assert_eq!(at(85.0, 0.0), None);
}

#[test]
fn an_axis_across_the_tilt_plane_has_no_nearest_tilt() {
    assert_eq!(tilt_for_axis(&Vector3::y()), None);
    assert_eq!(tilt_for_axis(&Vector3::zeros()), None);
    assert_eq!(tilt_for_axis(&Vector3::new(f64::NAN, 0.0, 1.0)), None);
    let up = tilt_for_axis(&Vector3::z()).unwrap();
    assert_eq!((up.tilt_rad.to_bits(), up.error_rad), (0, 0.0));
}

#[test]
fn compliance_is_the_springs_seen_at_the_burr() {
    let arm = Arm::bone_attached().unwrap();
    // tilted by 90°: the pivot's compliance acts along base z, and the shaft lies along −x
    let q = [0.0, 0.0, 0.0, std::f64::consts::FRAC_PI_2];
    let c = arm.compliance(&q, &[100.0, 200.0, 400.0, 1e5]).unwrap();
    let expected = Vector3::new(1.0 / 100.0, 1.0 / 200.0, 1.0 / 400.0 + 50.0 * 50.0 / 1e5);
    assert!((c - Matrix3::from_diagonal(&expected)).amax() < 1e-15);
    assert!(arm.compliance(&q, &[100.0, 200.0, 400.0]).is_err());
    assert!(arm.compliance(&q, &[100.0, 200.0, 400.0, 0.0]).is_err());
}

proptest! {
    /// What the burr yields under a force is the sum of what each joint's spring yields: Δq = χ⁻¹ Jᵀ F, Δp = J Δq.
    #[test]
    fn compliance_is_what_the_joints_springs_yield(
        q in prop::array::uniform5(-0.1f64..0.1), k in prop::array::uniform5(10.0f64..1e5),
        force in prop::array::uniform3(-1.0f64..1.0),
    ) {
        let (arm, force) = (oblique(), Vector3::from(force));
        let (jacobian, c) = (arm.burr_jacobian(&q).unwrap(), arm.compliance(&q, &k).unwrap());
        let torque = jacobian.tr_mul(&force);
        let yields = &jacobian * nalgebra::DVector::from_fn(5, |j, _| torque[j] / k[j]);
        prop_assert!((c * force - yields).norm() <= 1e-12 * yields.norm().max(1.0));
        prop_assert!(force.dot(&yields) >= 0.0 && (c - c.transpose()).amax() <= 1e-15 * c.amax());
    }
}

#[test]
fn limits_of_the_case_tighten_velocities_and_set_accelerations() {
    let arm = Arm::bone_attached().unwrap();
    let arm = arm.with_limits(Some(&[10.0, 20.0, 15.0, 0.1]), Some(&[50.0, 500.0, 150.0, 1.0])).unwrap();
    let velocity = arm.joints().iter().map(|joint| joint.velocity_limit).collect::<Vec<_>>();
    assert_eq!(velocity, [10.0, 15.0, 15.0, 0.1]);
    let acceleration = arm.joints().iter().map(|joint| joint.acceleration_limit).collect::<Vec<_>>();
    assert_eq!(acceleration, [50.0, 500.0, 150.0, 1.0]);
    for bad in [&[1.0, 1.0, 1.0][..], &[1.0, 1.0, 1.0, 0.0], &[1.0, 1.0, 1.0, f64::NAN]] {
        assert!(arm.clone().with_limits(Some(bad), None).is_err());
        assert!(arm.clone().with_limits(None, Some(bad)).is_err());
    }
}

#[test]
fn a_wrong_joint_vector_is_an_error() {
    let arm = Arm::bone_attached().unwrap();
    let text = |q: &[f64]| arm.forward(q).unwrap_err().to_string();
    assert!(text(&[0.0; 3]).contains("3 values, expected 4"));
    assert!(text(&[0.0, f64::NAN, 0.0, 0.0]).contains("joint position[1] = NaN mm"));
    assert!(arm.jacobian(&[0.0; 5]).is_err() && arm.beyond_limits(&[f64::INFINITY; 4]).is_err());
}

#[test]
fn a_urdf_file_is_read_and_a_missing_one_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("arm.urdf");
    std::fs::write(&path, OBLIQUE).unwrap();
    assert_eq!(read_urdf(&path).unwrap(), oblique());
    let missing = read_urdf(&folder.path().join("none.urdf")).unwrap_err().to_string();
    assert!(missing.contains("none.urdf"), "{missing}");
}
