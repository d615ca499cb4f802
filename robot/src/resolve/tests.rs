//! Whole paths: no joint jumps, every pose is met, the branch does not change, and an impossible path is reported with its
//! place.

use std::f64::consts::{FRAC_PI_2, PI};

use bonemill_arm::ToolMount;
use bonemill_arm::ur::UrModel;
use bonemill_geometry::{Point, Rigid};
use nalgebra::{Rotation3, Unit, Vector3};

use super::*;

/// A UR5e with a handpiece 180 mm long, bent by an angle from the flange's axis.
fn ur5e(bend_rad: f64) -> Arm {
    let turn = Rotation3::from_axis_angle(&Vector3::x_axis(), PI - bend_rad);
    Arm::ur(UrModel::Ur5e, None)
        .unwrap()
        .with_mount(ToolMount { flange_from_burr: Rigid::new(turn, turn * Vector3::new(0.0, 0.0, -180.0)) })
}

/// A raster of 20 × 20 mm about a point, the shaft swinging.
fn raster(center: [f64; 3], swing_rad: f64, count: usize) -> (Vec<AxisPose>, Vec<f64>) {
    let poses: Vec<AxisPose> = (0..count)
        .map(|i| {
            let (row, along) = (i / 80, i % 80);
            let along = if row % 2 == 0 { along } else { 79 - along };
            let tilt = swing_rad * (0.02 * i as f64).sin();
            AxisPose {
                position: Point::new(
                    center[0] + 0.25 * along as f64 - 10.0,
                    center[1] + 1.0 * (row % 20) as f64 - 10.0,
                    center[2] - 1.0 * (row / 20) as f64,
                ),
                axis: Unit::new_normalize(Vector3::new(tilt.sin(), 0.1, tilt.cos())),
            }
        })
        .collect();
    let lengths = lengths(&poses);
    (poses, lengths)
}

fn lengths(poses: &[AxisPose]) -> Vec<f64> {
    let moves = poses.windows(2).map(|pair| pair[0].position.distance_mm(&pair[1].position));
    std::iter::once(0.0).chain(moves).collect()
}

fn path<'a>(poses: &'a [AxisPose], length_mm: &'a [f64]) -> PosePath<'a> {
    PosePath {
        poses,
        length_mm,
        frame: RollFrame::about(&Vector3::z_axis()),
        stiffness: None,
        posture: Posture::Any,
        room: None,
    }
}

/// Every pose is met, inside all limits, and no joint jumps.
fn check(arm: &Arm, poses: &[AxisPose], resolved: &Resolved) {
    let dof = arm.dof();
    let mut before: Option<&[f64]> = None;
    for (pose, q) in poses.iter().zip(resolved.q.chunks_exact(dof)) {
        let tool = arm.burr(q).unwrap();
        assert!((tool.translation_mm - pose.position.coords).norm() < 1e-7);
        assert!((tool.rotation * Vector3::z() - pose.axis.into_inner()).norm() < 1e-7);
        assert_eq!(arm.beyond_limits(q).unwrap(), None);
        if let Some(before) = before {
            assert!(q.iter().zip(before).all(|(a, b)| (a - b).abs() < 0.6), "{before:?} to {q:?}");
        }
        before = Some(q);
    }
}

#[test]
fn a_raster_is_followed_without_a_flip() {
    for bend in [0.0, 0.6] {
        let arm = ur5e(bend);
        let (poses, length_mm) = raster([450.0, 0.0, 100.0], 0.5, 2000);
        let resolved = resolve(&arm, &path(&poses, &length_mm)).unwrap().unwrap();
        check(&arm, &poses, &resolved);
        let slowest =
            resolved.q.chunks_exact(6).map(|q| arm.slowest_mm_s(q).unwrap()).fold(f64::INFINITY, f64::min);
        assert!(slowest > 20.0, "{slowest} mm/s");
    }
}

/// ∫ Σ (dq/ds)² ds of the joints.
fn motion(q: &[f64], length_mm: &[f64]) -> f64 {
    let moves = q.chunks_exact(6).zip(q.chunks_exact(6).skip(1)).zip(&length_mm[1..]);
    moves.map(|((a, b), mm)| a.iter().zip(b).map(|(a, b)| (b - a).powi(2)).sum::<f64>() / mm).sum()
}

/// Shafts swing slowly, quickly, and in one jump.
#[test]
fn rolls_chosen_at_some_poses_are_as_good_as_those_chosen_at_every_pose() {
    let arm = ur5e(0.3);
    let InverseKind::Ur { geometry, .. } = arm.inverse_kind() else { panic!() };
    for (swing_rad, at_once_rad) in [(0.1, 0.0), (0.6, 0.0), (0.3, 0.6)] {
        let (mut poses, length_mm) = raster([450.0, 0.0, 100.0], swing_rad, 2000);
        let turn = Rotation3::from_axis_angle(&Vector3::y_axis(), at_once_rad);
        poses[1000..1020].iter_mut().for_each(|pose| pose.axis = turn * pose.axis);
        let path = path(&poses, &length_mm);
        let [some, every] = [grid::some_poses(&path), grid::every_pose(&path)];
        assert!(some.len() < every.len() / 2 && some[0] == 0 && *some.last().unwrap() == 1999);
        for pair in some.windows(2).filter(|pair| pair[1] > pair[0] + 1) {
            let along_mm: f64 = length_mm[pair[0] + 1..=pair[1]].iter().sum();
            let turned_rad = poses[pair[0]].axis.angle(&poses[pair[1]].axis);
            assert!(along_mm <= 1.0 + 1e-9 && turned_rad <= 0.1 + 1e-9, "{along_mm} {turned_rad}");
        }
        let nodes = grid::Nodes::new(&arm, geometry, &path);
        let [of_some, of_every] = [&some, &every].map(|at| nodes.resolved(at).unwrap());
        let handed_out = resolve(&arm, &path).unwrap().unwrap();
        check(&arm, &poses, &handed_out);
        assert_eq!(of_some.branch, of_every.branch);
        let [found, every] = [&handed_out, &of_every].map(|resolved| motion(&resolved.q, &length_mm));
        assert!(
            found <= 1.01 * every,
            "{found} for {every}, {swing_rad} {at_once_rad} on {}",
            of_some.branch
        );
        // after a jump of the axis a joint moves too fast, and every pose is used
        assert_eq!(grid::hurries(&of_some.q, 6), at_once_rad > 0.0);
    }
}

#[test]
fn the_dense_path_keeps_to_the_line_and_bounds_the_burr_s_speed() {
    for arm in [ur5e(0.6), Arm::bone_attached().unwrap()] {
        let bone = arm.dof() == 4;
        let (mut poses, _) = raster(if bone { [0.0; 3] } else { [450.0, 0.0, 100.0] }, 0.8, 400);
        if bone {
            for pose in &mut poses {
                pose.axis = Unit::new_normalize(Vector3::new(pose.axis.x, 0.0, pose.axis.z));
            }
        }
        // a long link, a short move with a great turn, a rotation in place
        let last = poses[poses.len() - 1];
        let turned = |tilt: f64| Unit::new_normalize(Vector3::new(tilt.sin(), 0.0, tilt.cos()));
        poses.push(AxisPose { position: last.position + Vector3::new(30.0, 5.0, 20.0), axis: turned(0.0) });
        let far = poses[poses.len() - 1].position;
        poses.push(AxisPose { position: far + Vector3::new(0.05, 0.0, 0.0), axis: turned(0.6) });
        poses.push(AxisPose { position: far + Vector3::new(0.05, 0.0, 0.0), axis: turned(-0.6) });
        let length_mm = lengths(&poses);
        let path = path(&poses, &length_mm);
        let resolved = resolve(&arm, &path).unwrap().unwrap();
        let dense = DensePath::lay(&arm, &path, &resolved).unwrap();
        assert_eq!(dense.waypoints.len(), poses.len());
        let dof = arm.dof();
        let mut way_mm = 0.0;
        for k in 1..dense.len() {
            let (a, b) = (&dense.q[(k - 1) * dof..k * dof], &dense.q[k * dof..(k + 1) * dof]);
            let [from, to] = [k - 1, k].map(|k| Vector3::from_column_slice(&dense.pose[k][..3]));
            let [from_axis, to_axis] = [k - 1, k].map(|k| Vector3::from_column_slice(&dense.pose[k][3..]));
            let mut before: Option<Vector3<f64>> = None;
            for n in 0..=20 {
                let share = f64::from(n) / 20.0;
                let q: Vec<f64> = a.iter().zip(b).map(|(a, b)| a + share * (b - a)).collect();
                let tool = arm.burr(&q).unwrap();
                let on_line = from + (to - from) * share;
                assert!((tool.translation_mm - on_line).norm() < 0.004, "place {k}");
                let axis = tool.rotation * Vector3::z();
                let even = (from_axis + (to_axis - from_axis) * share).normalize();
                assert!(axis.angle(&even) < 1.2e-3, "place {k}: {}", axis.angle(&even));
                if let Some(before) = before {
                    let speed = (tool.translation_mm - before).norm() * 20.0;
                    assert!(
                        speed <= dense.burr_mm[k] * (1.0 + 1e-6) + 1e-12,
                        "place {k}: {speed} > {}",
                        dense.burr_mm[k]
                    );
                }
                before = Some(tool.translation_mm);
            }
            way_mm += dense.burr_mm[k];
        }
        let straight: f64 = length_mm.iter().sum();
        assert!((0.999..1.03).contains(&(way_mm / straight)), "{way_mm} of {straight} mm");
    }
}

#[test]
fn a_path_to_the_edge_of_reach_is_followed_and_one_beyond_it_is_told() {
    let arm = ur5e(0.0);
    let pose = |x: f64| AxisPose { position: Point::new(x, 30.0, 100.0), axis: Vector3::z_axis() };
    let resolved_to = |last_mm: f64| {
        let poses: Vec<AxisPose> = (0..=80).map(|n| pose(last_mm - 20.0 + 0.25 * f64::from(n))).collect();
        let length_mm = lengths(&poses);
        (resolve(&arm, &path(&poses, &length_mm)).unwrap(), poses)
    };
    let is_reached = |x: f64| resolve(&arm, &path(&[pose(x)], &[0.0])).unwrap().is_ok();
    let (mut within, mut beyond) = (600.0, 1200.0);
    assert!(is_reached(within) && !is_reached(beyond));
    for _ in 0..60 {
        let middle = 0.5 * (within + beyond);
        if is_reached(middle) { within = middle } else { beyond = middle }
    }
    let (resolved, poses) = resolved_to(within);
    check(&arm, &poses, &resolved.unwrap());
    let failed = resolved_to(within + 0.3).0.unwrap_err();
    assert_eq!(failed.pose, 79);
    assert!(
        matches!(failed.reason, ReachReason::Beyond { short_mm } if (0.02..0.06).contains(&short_mm)),
        "{failed:?}"
    );
}

#[test]
fn out_of_reach_is_told_with_place_and_distance() {
    let arm = ur5e(0.0);
    let (mut poses, _) = raster([450.0, 0.0, 100.0], 0.0, 200);
    poses[120].position = Point::new(2500.0, 0.0, 100.0);
    let length_mm = lengths(&poses);
    let failed = resolve(&arm, &path(&poses, &length_mm)).unwrap().unwrap_err();
    assert_eq!(failed.pose, 120);
    assert!(
        matches!(failed.reason, ReachReason::Beyond { short_mm } if (1000.0..2000.0).contains(&short_mm)),
        "{failed:?}"
    );
    // the bone-attached arm cannot leave its plane
    let bone = Arm::bone_attached().unwrap();
    let pose = AxisPose {
        position: Point::new(0.0, 0.0, 0.0),
        axis: Unit::new_normalize(Vector3::new(0.0, 0.3, 1.0)),
    };
    let failed = resolve(&bone, &path(&[pose], &[0.0])).unwrap().unwrap_err();
    assert!(
        matches!(failed.reason, ReachReason::Axis { short_rad } if (short_rad - 0.3f64.atan()).abs() < 1e-9)
    );
    let far = AxisPose { position: Point::new(0.0, 0.0, 500.0), axis: Vector3::z_axis() };
    let failed = resolve(&bone, &path(&[far], &[0.0])).unwrap().unwrap_err();
    assert!(matches!(failed.reason, ReachReason::Limit(excess) if excess.joint == 2));
}

#[test]
fn a_wrist_singularity_is_avoided_where_the_roll_can_and_told_where_it_cannot() {
    // the shaft is level and points along base x; with a straight tool the path crosses the wrist's singular plane
    let level = Unit::new_normalize(Vector3::new(1.0, 0.0, 0.0));
    let through = |bend: f64| {
        let arm = ur5e(bend);
        // the flange's axis crosses the direction of the parallel axes on the way: at the wrist's q₅ = 0
        let poses: Vec<AxisPose> = (0..200)
            .map(|i| {
                let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), -2.2 + 0.012 * f64::from(i));
                let axis = turn * level;
                AxisPose { position: Point::new(-500.0 + 0.02 * f64::from(i), 100.0, 350.0), axis }
            })
            .collect();
        let length_mm = lengths(&poses);
        let frame = RollFrame::about(&Unit::new_normalize(Vector3::new(0.1, -1.0, 0.2)));
        let path = PosePath { frame, ..path(&poses, &length_mm) };
        let resolved = resolve(&arm, &path).unwrap();
        resolved.map(|resolved| {
            let least = resolved.q.chunks_exact(6).map(|q| q[4].sin().abs()).fold(f64::INFINITY, f64::min);
            let laid = DensePath::lay(&arm, &path, &resolved);
            // the dense path has no jump
            laid.iter().for_each(|dense| check_continuous(&dense.q));
            (least, laid.map(|dense| dense.len()))
        })
    };
    // with a bent tool, the roll avoids the singularity
    let (least, laid) = through(0.7).unwrap();
    assert!(least > 0.05, "{least}");
    assert!(laid.is_ok());
    // with a straight tool the path may fail or succeed, but a result must be correct
    match through(0.0) {
        Ok((_, Ok(places))) => assert!(places >= 200),
        Ok((_, Err(failed))) | Err(failed) => assert_eq!(failed.reason, ReachReason::Jump),
    }
}

fn check_continuous(q: &[f64]) {
    let rows: Vec<&[f64]> = q.chunks_exact(6).collect();
    assert!(rows.iter().all(|q| q.iter().all(|q| q.is_finite())));
    for (n, pair) in rows.windows(2).enumerate() {
        let step = pair[0].iter().zip(pair[1]).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(step < 0.1, "{step} rad to place {}", n + 1);
    }
}

#[test]
fn joints_at_two_pi_and_narrow_ranges_are_kept() {
    let arm = ur5e(0.0);
    // the last joint winds up: the axis is fixed, and the flange turns with q₁ as the burr goes round the base
    let poses: Vec<AxisPose> = (0..720)
        .map(|i| {
            let angle = f64::from(i) * 0.0087;
            AxisPose {
                position: Point::new(450.0 * angle.cos(), 450.0 * angle.sin(), 100.0),
                axis: Vector3::z_axis(),
            }
        })
        .collect();
    let length_mm = lengths(&poses);
    let resolved = resolve(&arm, &path(&poses, &length_mm)).unwrap().unwrap();
    check(&arm, &poses, &resolved);
    let (first, last) = (resolved.q[0], resolved.q[719 * 6]);
    assert!(
        (last - first - 719.0 * 0.0087).abs() < 1e-6,
        "the first joint turns all the way: {first} to {last}"
    );
    // two rounds need more than a range of ±2π allows, except from its ends
    let twice: Vec<AxisPose> = (0..2200).map(|i| poses[i % 720]).collect();
    let length_mm = lengths(&twice);
    let failed = resolve(&arm, &path(&twice, &length_mm)).unwrap().unwrap_err();
    assert!(matches!(failed.reason, ReachReason::Limit(excess) if excess.joint == 0), "{failed:?}");
}

#[test]
fn any_urdf_is_followed_by_damped_least_squares() {
    // an arm from a UR's URDF, without the closed form
    let text = Arm::ur(UrModel::Ur5e, None).unwrap().urdf_text().to_owned();
    let mount = ur5e(0.6).mount();
    let arm = Arm::from_urdf(&text, "some arm").unwrap().with_mount(mount);
    let (poses, length_mm) = raster([450.0, 0.0, 100.0], 0.3, 400);
    let resolved = resolve(&arm, &path(&poses, &length_mm)).unwrap().unwrap();
    check(&arm, &poses, &resolved);
    let failed =
        resolve(&arm, &path(&[AxisPose { position: Point::new(3000.0, 0.0, 0.0), ..poses[0] }], &[0.0]));
    assert!(matches!(
        failed.unwrap().unwrap_err().reason,
        ReachReason::Beyond { .. } | ReachReason::Axis { .. }
    ));
}

/// An arm's compliance along y at every pose of a raster, mm/N: without stiffness in the cost, and with it.
fn yields(arm: &Arm) -> [Vec<f64>; 2] {
    let (poses, length_mm) = raster([450.0, 0.0, 100.0], 0.1, 200);
    let toward = vec![Some(Vector3::y_axis()); poses.len()];
    // one soft joint
    let joint = [1e7, 1e7, 1e7, 1e4, 1e7, 1e7];
    [None, Some(Stiffness { joint: &joint, toward: &toward })].map(|stiffness| {
        let path = PosePath { stiffness, ..path(&poses, &length_mm) };
        let resolved = resolve(arm, &path).unwrap().unwrap();
        check(arm, &poses, &resolved);
        resolved.q.chunks_exact(6).map(|q| arm.compliance(q, &joint).unwrap()[(1, 1)]).collect()
    })
}

#[test]
fn stiffness_counts_for_any_urdf_whose_roll_is_free() {
    let text = Arm::ur(UrModel::Ur5e, None).unwrap().urdf_text().to_owned();
    let arm = Arm::from_urdf(&text, "some arm").unwrap().with_mount(ur5e(FRAC_PI_2 / 2.0).mount());
    let [plain, stiff] = yields(&arm).map(|yields| yields.iter().sum::<f64>() / 200.0);
    assert!(stiff < 0.9 * plain, "{stiff} against {plain}");
}

#[test]
fn stiffness_toward_a_structure_changes_the_posture() {
    let [plain, stiff] = yields(&ur5e(FRAC_PI_2 / 2.0)).map(|yields| yields.into_iter().fold(0.0, f64::max));
    assert!(stiff < 0.8 * plain, "{stiff} against {plain}");
}

/// An arm of seven joints with shoulder and wrist like those of a KUKA LBR iiwa, or with the offsets of a Franka's elbow and wrist (`elbow_m`, `wrist_m`).
fn seven(elbow_m: f64, wrist_m: f64) -> Arm {
    let joint = |n: usize, origin: &str, axis: &str, limits: [f64; 2], speed: f64| {
        format!(
            "<joint name=\"a{n}\" type=\"revolute\"><parent link=\"l{}\"/><child link=\"l{n}\"/><origin xyz=\"{origin}\"/><axis xyz=\"{axis}\"/>\
             <limit lower=\"{}\" upper=\"{}\" velocity=\"{speed}\" effort=\"1\"/></joint>",
            n - 1,
            limits[0],
            limits[1]
        )
    };
    let links: String = (0..8).map(|n| format!("<link name=\"l{n}\"/>")).collect();
    let bends = if elbow_m > 0.0 { [-0.07, 3.07] } else { [-2.09, 2.09] };
    let joints = [
        joint(1, "0 0 0.36", "0 0 1", [-2.96, 2.96], 1.7),
        joint(2, "0 0 0", "0 1 0", [-2.09, 2.09], 1.7),
        joint(3, "0 0 0.42", "0 0 1", [-2.96, 2.96], 1.7),
        joint(4, &format!("{elbow_m} 0 0"), "0 -1 0", bends, 2.2),
        joint(5, &format!("{} 0 0.4", -elbow_m), "0 0 1", [-2.96, 2.96], 2.4),
        joint(6, "0 0 0", "0 1 0", [-2.09, 2.09], 3.1),
        joint(7, &format!("{wrist_m} 0 0.126"), "0 0 1", [-3.05, 3.05], 3.1),
    ];
    let turn = Rotation3::from_axis_angle(&Vector3::x_axis(), PI - 0.6);
    let mount = ToolMount { flange_from_burr: Rigid::new(turn, turn * Vector3::new(0.0, 0.0, -180.0)) };
    Arm::from_urdf(&format!("<robot name=\"seven\">{links}{}</robot>", joints.concat()), "seven")
        .unwrap()
        .with_mount(mount)
}

/// The slowest direction along a path, mm/s.
fn slowest_mm_s(arm: &Arm, resolved: &Resolved) -> f64 {
    let of = |q: &[f64]| arm.slowest_mm_s(q).unwrap();
    resolved.q.chunks_exact(arm.dof()).map(of).fold(f64::INFINITY, f64::min)
}

/// Roll and self-motion are looked for over the whole path: a path that cannot be followed step by step is followed, and others keep farther from
/// singularities.
#[test]
fn the_spare_joint_of_seven_is_planned_over_the_whole_path() {
    let lbr = seven(0.0, 0.0);
    let franka = seven(0.0825, 0.088);
    for (arm, x_mm, z_mm, swing_rad, by_steps_mm_s) in [
        (&lbr, 450.0, 300.0, 0.3, None),
        (&lbr, 450.0, 100.0, 0.3, Some(60.0)),
        (&franka, 550.0, 300.0, 1.0, None),
        (&franka, 450.0, 300.0, 0.3, Some(95.0)),
    ] {
        let (poses, length_mm) = raster([x_mm, 0.0, z_mm], swing_rad, 400);
        let path = path(&poses, &length_mm);
        let resolved = resolve(arm, &path).unwrap().unwrap();
        check(arm, &poses, &resolved);
        assert!(DensePath::lay(arm, &path, &resolved).is_ok());
        let found_mm_s = slowest_mm_s(arm, &resolved);
        assert!(found_mm_s > 100.0, "{found_mm_s}");
        let stepwise = track::resolve(arm, &path);
        match by_steps_mm_s {
            None => assert!(stepwise.is_err()),
            Some(at_most) => assert!(slowest_mm_s(arm, &stepwise.unwrap()) < at_most),
        }
    }
}
