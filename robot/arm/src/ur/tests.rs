//! The closed form against forward kinematics and against a search, at singular and unreachable poses; calibrations.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use bonemill_geometry::{Base, Flange, Rigid};
use nalgebra::{Rotation3, Vector3};
use proptest::prelude::*;

use super::calibration::{Calibration, JointOrigin};
use super::ik::wrapped;
use super::*;
use crate::error::CalibrationFault;

/// A fixed stream of numbers in 0..1.
struct Stream(u64);

impl Stream {
    fn next(&mut self) -> f64 {
        // SplitMix64
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn q(&mut self) -> [f64; 6] {
        std::array::from_fn(|_| (self.next() - 0.5) * TAU)
    }
}

/// Forward kinematics from the DH table alone, written with 4 × 4 products.
fn by_dh(model: UrModel, q: &[f64; 6]) -> Rigid<Base, Flange> {
    let mut t = nalgebra::Matrix4::<f64>::identity();
    for (row, q) in model.dh().iter().zip(q) {
        let ((st, ct), (sa, ca)) = ((q + row.theta).sin_cos(), row.alpha.sin_cos());
        let (a, d) = (row.a_m * 1000.0, row.d_m * 1000.0);
        t *= nalgebra::Matrix4::new(
            ct,
            -st * ca,
            st * sa,
            a * ct,
            st,
            ct * ca,
            -ct * sa,
            a * st,
            0.0,
            sa,
            ca,
            d,
            0.0,
            0.0,
            0.0,
            1.0,
        );
    }
    let rotation = Rotation3::from_matrix_unchecked(t.fixed_view::<3, 3>(0, 0).into_owned());
    Rigid::new(rotation, t.fixed_view::<3, 1>(0, 3).into_owned())
}

/// Greatest differences of two poses, mm and (as entries of the rotation) rad.
fn apart(a: &Rigid<Base, Flange>, b: &Rigid<Base, Flange>) -> (f64, f64) {
    let turn = a.rotation.matrix() - b.rotation.matrix();
    ((a.translation_mm - b.translation_mm).norm(), turn.amax())
}

fn is_among(solutions: &UrSolutions, q: &[f64; 6], within: f64) -> bool {
    solutions.iter().any(|(_, found)| found.iter().zip(q).all(|(a, b)| wrapped(a - b).abs() < within))
}

#[test]
fn the_urdf_is_the_dh_table() {
    let mut stream = Stream(1);
    for model in UrModel::ALL {
        let arm = Arm::ur(model, None).unwrap();
        assert_eq!(arm.dof(), 6);
        for _ in 0..500 {
            let q = stream.q();
            let (mm, rad) = apart(&arm.forward(&q).unwrap(), &by_dh(model, &q));
            assert!(mm < 1e-10 && rad < 1e-14, "{mm} mm, {rad}");
        }
    }
}

#[test]
fn every_branch_reproduces_the_pose_and_the_joints_asked_for_are_among_them() {
    let mut stream = Stream(7);
    let (mut worst_mm, mut worst_rad, mut branches) = (0f64, 0f64, 0usize);
    for model in UrModel::ALL {
        let (arm, geometry) = (Arm::ur(model, None).unwrap(), model.geometry());
        for k in 0..20_000 {
            let mut q = stream.q();
            // every tenth pose is singular or nearly so
            let near = [0.0, 1e-12, 1e-9, 1e-6, 1e-3][k / 10 % 5] * (stream.next() - 0.5);
            match k % 30 {
                0 => q[4] = near,
                10 => q[2] = near,
                20 => q[4] = PI + near,
                _ => {}
            }
            let pose = arm.forward(&q).unwrap();
            let solutions = geometry.inverse(&pose, q[5]);
            for (_, found) in solutions.iter() {
                assert!(found.iter().all(|q| q.is_finite() && q.abs() <= PI));
                let (mm, rad) = apart(&arm.forward(found).unwrap(), &pose);
                (worst_mm, worst_rad) = (worst_mm.max(mm), worst_rad.max(rad));
            }
            branches += solutions.len();
            assert!(solutions.len() >= 2 && solutions.short_mm == 0.0, "{q:?}");
            if k % 10 != 0 {
                assert!(is_among(&solutions, &q, 1e-6), "{q:?} is not among {solutions:?}");
            }
        }
    }
    assert!(worst_mm < 1e-9 && worst_rad < 1e-9, "{worst_mm} mm, {worst_rad} rad");
    // half of all poses are reached by both shoulders, wrists and elbows
    assert!(branches > 60_000 * 4, "{branches}");
}

#[test]
fn no_branch_is_missing_against_a_search() {
    let mut stream = Stream(3);
    let model = UrModel::Ur5e;
    let numeric = Arm::from_urdf(Arm::ur(model, None).unwrap().urdf_text(), "searched").unwrap();
    let mut found = 0;
    for _ in 0..40 {
        let q = stream.q();
        let tool = numeric.burr(&q).unwrap();
        let searched = numeric.inverse(&tool).unwrap();
        let closed = model.geometry().inverse(&numeric.forward(&q).unwrap(), 0.0);
        for q in &searched.q {
            let q: [f64; 6] = q[..].try_into().unwrap();
            assert!(is_among(&closed, &q, 1e-5), "{q:?} was found by search, not among {closed:?}");
            found += 1;
        }
    }
    assert!(found > 120, "the search itself finds too little: {found}");
}

#[test]
fn out_of_reach_says_by_how_much() {
    let geometry = UrModel::Ur5e.geometry();
    let level = Rotation3::from_axis_angle(&Vector3::y_axis(), FRAC_PI_2);
    let at = |mm: Vector3<f64>| geometry.inverse(&Rigid::new(level, mm), 0.0);
    assert!(at(Vector3::new(3000.0, 0.0, 200.0)).is_empty());
    // the pose is reached when it is moved in by the missing distance, and not when it is moved by a little less
    for far in [
        Vector3::new(1100.0, 130.0, 162.5),
        Vector3::new(0.0, 0.0, 1500.0),
        Vector3::new(-900.0, 800.0, -300.0),
    ] {
        let short = at(far).short_mm;
        assert!(short > 1.0, "{far:?}");
        assert!(at(far).iter().next().is_none());
        let reached = |pull: f64| {
            (0..4000).any(|k| {
                let (a, b) = (f64::from(k % 80) / 80.0 * TAU, f64::from(k / 80) / 50.0 * PI);
                let way = Vector3::new(a.cos() * b.sin(), a.sin() * b.sin(), b.cos());
                !at(far + way * pull).is_empty()
            })
        };
        assert!(
            reached(short * 1.05),
            "{far:?} is short by {short} mm, but that does not bring it into reach"
        );
        // straight above the base both the shoulder's cylinder and the elbow limit the reach, and the way out is not straight
        assert!(far.x == 0.0 || !reached(short * 0.8), "{far:?} is reached with less than {short} mm");
    }
    // the wrist inside the cylinder about the first axis
    let upright = Rotation3::from_axis_angle(&Vector3::x_axis(), PI);
    let inside = geometry.inverse(&Rigid::new(upright, Vector3::new(100.0, 0.0, 400.0)), 0.0);
    assert!(inside.is_empty() && (inside.short_mm - 33.3).abs() < 1e-9, "{}", inside.short_mm);
}

#[test]
fn singular_poses_have_a_stated_answer() {
    for model in UrModel::ALL {
        let (arm, geometry) = (Arm::ur(model, None).unwrap(), model.geometry());
        // wrist: q₆ is the caller's value, which the elbow reaches
        let q = [0.3, -1.2, 1.4, -0.7, 0.0, 0.9];
        let pose = arm.forward(&q).unwrap();
        let solutions = geometry.inverse(&pose, 0.9);
        assert!(solutions.wrist_singular && is_among(&solutions, &q, 1e-6));
        let free = geometry.inverse(&pose, -2.0);
        let bound = |q: &[f64; 6]| q[4].abs() > 1e-9 || (q[5] + 2.0).abs() < 1e-12;
        assert!(free.iter().count() >= 4 && free.iter().all(|(_, q)| bound(q)));
        // elbow: stretched, the two coincide
        let stretched = [0.3, -1.2, 0.0, -0.7, 1.1, 0.9];
        let solutions = geometry.inverse(&arm.forward(&stretched).unwrap(), 0.0);
        assert!(is_among(&solutions, &stretched, 1e-6));
        // shoulder: the wrist as near to the first axis as it can be
        let g = geometry;
        let (q3, q234) = (1.2f64, 0.4f64);
        // a₂ c₂ + a₃ c₂₃ + d₅ s₂₃₄ = 0 by q₂
        let (k1, k2) = (g.a2_mm + g.a3_mm * q3.cos(), g.a3_mm * q3.sin());
        let rest = -g.d5_mm * q234.sin();
        let q2 = (rest / k1.hypot(k2)).acos() - k2.atan2(k1);
        let overhead = [0.3, q2, q3, q234 - q2 - q3, 1.1, 0.9];
        let pose = arm.forward(&overhead).unwrap();
        let solutions = geometry.inverse(&pose, 0.0);
        assert!(solutions.len() >= 4);
        for (_, found) in solutions.iter() {
            let (mm, rad) = apart(&arm.forward(found).unwrap(), &pose);
            assert!(mm < 1e-9 && rad < 1e-9, "{mm} {rad}");
        }
    }
}

/// At the exact wrist singularity q₆ is free as far as the elbow reaches.
#[test]
fn every_reachable_pose_with_a_singular_wrist_has_solutions_whatever_the_callers_q6() {
    let mut stream = Stream(11);
    for model in UrModel::ALL {
        let (arm, geometry) = (Arm::ur(model, None).unwrap(), model.geometry());
        let mut moved = 0;
        for k in 0..4000 {
            let mut q = stream.q();
            q[4] = [0.0, PI][k % 2];
            let pose = arm.forward(&q).unwrap();
            let asked = [0.0, (stream.next() - 0.5) * TAU][k / 2 % 2];
            let solutions = geometry.inverse(&pose, asked);
            for (_, found) in solutions.iter() {
                let (mm, rad) = apart(&arm.forward(found).unwrap(), &pose);
                assert!(mm < 1e-9 && rad < 1e-9, "{q:?}: {mm} mm, {rad} rad");
            }
            assert!(!solutions.is_empty() && solutions.short_mm == 0.0, "{q:?} has no solution");
            // a value that was moved is the nearest: a little nearer to the one asked for, the branch is gone
            for (branch, found) in solutions.iter().filter(|(_, found)| found[4].sin().abs() < 1e-12) {
                let away = wrapped(found[5] - asked);
                if away.abs() > 1e-5 {
                    moved += 1;
                    let nearer = geometry.inverse(&pose, asked + away - 1e-6f64.copysign(away));
                    let q6 = nearer.branches[branch].map(|q| wrapped(q[5] - found[5]).abs());
                    assert!(q6.is_some_and(|off| off < 1e-9), "{q:?}: {q6:?}");
                }
            }
            assert!(!arm.inverse(&arm.burr(&q).unwrap()).unwrap().q.is_empty(), "{q:?}");
        }
        assert!(moved > 100, "{model:?}: {moved}");
    }
}

#[test]
fn shoulder_and_elbow_singular_at_once_are_still_reached() {
    // the wrist almost touches the cylinder about the first axis, where a square root amplifies rounding, and the arm is
    // stretched
    let found_among_a_million = [
        (UrModel::Ur5e, [0.418_252_915_470_652_63, -1.518_023_968_259_074_6, 0.0]),
        (UrModel::Ur10e, [3.002_709_794_545_157_5, -1.641_389_280_836_598_9, -3.148_889_284_118_595_3e-13]),
    ];
    let wrists = [
        [-2.073_099_931_825_045_6, 0.147_513_469_722_083_93, -0.921_108_993_076_170_9],
        [-0.733_548_149_187_128_2, -2.854_698_586_040_062, 0.702_757_825_646_723_2],
    ];
    for ((model, [q1, q2, q3]), [q4, q5, q6]) in found_among_a_million.into_iter().zip(wrists) {
        let arm = Arm::ur(model, None).unwrap();
        let pose = arm.forward(&[q1, q2, q3, q4, q5, q6]).unwrap();
        let solutions = model.geometry().inverse(&pose, q6);
        assert!(!solutions.is_empty(), "{model:?} is short by {} mm", solutions.short_mm);
        for (_, found) in solutions.iter() {
            let (mm, rad) = apart(&arm.forward(found).unwrap(), &pose);
            assert!(mm < 1e-9 && rad < 1e-9, "{mm} {rad}");
        }
    }
}

proptest! {
    #[test]
    fn the_edge_of_reach_is_reached(q in prop::array::uniform6(-3.0f64..3.0), model in 0..UrModel::ALL.len()) {
        let model = UrModel::ALL[model];
        let (arm, mut q) = (Arm::ur(model, None).unwrap(), q);
        q[2] = 0.0;
        let edge = arm.forward(&q).unwrap();
        prop_assert!(!model.geometry().inverse(&edge, 0.0).is_empty());
    }

    #[test]
    fn a_wrapped_angle_is_the_same_direction(angle in -50.0f64..50.0) {
        let turned = wrapped(angle);
        prop_assert!(turned.abs() <= PI);
        prop_assert!((turned.sin() - angle.sin()).abs() < 1e-13 && (turned.cos() - angle.cos()).abs() < 1e-13);
    }
}

/// Deltas of the size that factories write: metres along the parallel axes, which cancel.
const DELTAS: &str = "
delta_theta: [ 9.0e-08, 0.178, 6.683, -0.5780814, 6.1e-06, -5.0e-07 ]
delta_a: [ -0.00024, 0.0038, 0.0345, 0.0001, -0.0002, 0 ]
delta_d: [ 9.2e-05, 12.062, 17.6719, -29.73399, -2.8e-05, 0.0002 ]
delta_alpha: [ 0.00115, 0.003585, 0.00392, 0.0004, -0.002, 0 ]
";

#[test]
fn small_deltas_move_the_flange_by_millimetres_and_the_inverse_is_exact() {
    let text = "mounting:\n  delta_theta: [1e-4, -2e-4, 3e-4, 1e-4, 0, 0]\n  delta_a: [0, 0.0004, -0.0003, 0, 0, 0]\n  \
                delta_d: [0.0002, 0, 0, 0.0001, 0, 0]\n  delta_alpha: [0.0005, -0.0004, 0.0003, 0.0002, 0, 0]\n";
    let calibration = Calibration::parse(text).unwrap();
    let (nominal, arm) =
        (Arm::ur(UrModel::Ur5e, None).unwrap(), Arm::ur(UrModel::Ur5e, Some(&calibration)).unwrap());
    let mut stream = Stream(5);
    let mut most_mm = 0f64;
    for _ in 0..60 {
        let mut q = stream.q();
        // away from singular postures, where a branch may end
        q[2] = 1.3f64.copysign(q[2]);
        q[4] = 1.1f64.copysign(q[4]);
        let pose = arm.forward(&q).unwrap();
        most_mm = most_mm.max(apart(&pose, &nominal.forward(&q).unwrap()).0);
        let tool = arm.burr(&q).unwrap();
        let solutions = arm.inverse(&tool).unwrap();
        assert!(!solutions.q.is_empty());
        for found in &solutions.q {
            let (mm, rad) = apart(&arm.forward(found).unwrap(), &pose);
            assert!(mm < 2e-9 && rad < 2e-9, "{mm} mm {rad} rad");
        }
        assert!(
            solutions.q.iter().any(|found| found.iter().zip(&q).all(|(a, b)| wrapped(a - b).abs() < 1e-6))
        );
    }
    assert!((0.3..5.0).contains(&most_mm), "{most_mm}");
}

#[test]
fn the_three_forms_of_a_calibration_are_read() {
    let yaml = Calibration::parse(DELTAS).unwrap();
    let conf = DELTAS.replace(':', " =");
    let conf = format!(
        "[mounting]{conf}joint_checksum = [ 0xb3241580, 0xb10112f1 ]\ncalibration_status = 2 # 0 == none\n"
    );
    assert_eq!(Calibration::parse(&conf).unwrap(), yaml);
    // the nominal UR5e as the ROS driver describes it
    let half = PI / 2.0;
    let origins = [
        ("shoulder", [0.0, 0.0, 0.1625, 0.0, 0.0, 0.0]),
        ("upper_arm", [0.0, 0.0, 0.0, half, 0.0, 0.0]),
        ("forearm", [-0.425, 0.0, 0.0, 0.0, 0.0, 0.0]),
        ("wrist_1", [-0.3922, 0.0, 0.1333, 0.0, 0.0, 0.0]),
        ("wrist_2", [0.0, -0.0997, 0.0, half, 0.0, 0.0]),
        ("wrist_3", [0.0, 0.0996, 0.0, half, PI, PI]),
    ];
    let mut ros = String::from("kinematics:\n");
    for (name, [x, y, z, roll, pitch, yaw]) in origins {
        ros += &format!(
            "  {name}:\n    x: {x}\n    y: {y}\n    z: {z}\n    roll: {roll}\n    pitch: {pitch}\n    yaw: {yaw}\n"
        );
    }
    ros += "  hash: calib_123\n";
    let ros = Calibration::parse(&ros).unwrap();
    assert!(
        matches!(ros, Calibration::Origins(origins) if origins[0] == JointOrigin { xyz_m: [0.0, 0.0, 0.1625], rpy_rad: [0.0; 3] })
    );
    let (arm, nominal) = (Arm::ur(UrModel::Ur5e, Some(&ros)).unwrap(), Arm::ur(UrModel::Ur5e, None).unwrap());
    let q = [0.3, -1.2, 1.4, -0.7, 0.8, 0.9];
    let (mm, rad) = apart(&arm.forward(&q).unwrap(), &nominal.forward(&q).unwrap());
    assert!(mm < 1e-9 && rad < 1e-12, "{mm} {rad}");
}

#[test]
fn what_is_no_calibration_is_refused() {
    let fault = |text: &str| Calibration::parse(text).unwrap_err();
    assert!(matches!(fault("a: [1, 2"), CalibrationFault::Syntax(_)));
    assert!(matches!(fault(""), CalibrationFault::Unknown));
    assert!(matches!(fault("some: thing"), CalibrationFault::Unknown));
    assert!(matches!(fault("delta_theta: [0, 0, 0, 0, 0]"), CalibrationFault::Number { .. }));
    assert!(matches!(fault("delta_theta: [0, 0, 0, 0, 0, .nan]"), CalibrationFault::Number { .. }));
    assert!(
        matches!(fault("delta_theta: [0, 0, 0, 0, 0, 0]"), CalibrationFault::Missing { key } if key == "delta_a")
    );
    assert!(matches!(fault("kinematics:\n  shoulder:\n    x: 0\n"), CalibrationFault::Missing { .. }));
    // the deltas of another model
    let far = "delta_theta: [0,0,0,0,0,0]\ndelta_a: [0,-0.2,0,0,0,0]\ndelta_d: [0,0,0,0,0,0]\ndelta_alpha: [0,0,0,0,0,0]\n";
    let error = Arm::ur(UrModel::Ur5e, Some(&Calibration::parse(far).unwrap())).unwrap_err().to_string();
    assert!(error.contains("ur5e") && error.contains("another model"), "{error}");
    // degrees: the flange stays in place and turns
    for at in ["delta_theta", "delta_alpha"] {
        let turned = "delta_theta: [0,0,0,0,0,0]\ndelta_a: [0,0,0,0,0,0]\ndelta_d: [0,0,0,0,0,0]\ndelta_alpha: [0,0,0,0,0,0]\n"
            .replace(&format!("{at}: [0,0,0,0,0,0]"), &format!("{at}: [0,0,0,0,0,0.5]"));
        let error =
            Arm::ur(UrModel::Ur5e, Some(&Calibration::parse(&turned).unwrap())).unwrap_err().to_string();
        assert!(error.contains("0.500 rad") && error.contains("degrees"), "{error}");
    }
}
