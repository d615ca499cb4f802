//! Speed of inverse kinematics, Jacobian, time law and redundancy resolution, compared in the same run with another Rust
//! library where there is one.
#![allow(missing_docs, clippy::expect_used)] // criterion's macros make undocumented functions; the inputs are fixed

use std::hint::black_box;

use bonemill_geometry::{Point, Rigid};
use bonemill_robot::arm::AxisPose;
use bonemill_robot::resolve::{DensePath, PosePath, Posture, RollFrame, resolve};
use bonemill_robot::timelaw::{CornerTolerance, JointPath, PathLimits, PreparedPath};
use bonemill_robot::ur::UrModel;
use bonemill_robot::{Arm, ToolMount};
use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::{Rotation3, Unit, Vector3};

const Q: [f64; 6] = [0.3, -1.2, 1.4, -0.7, 0.9, 0.4];

fn ur5e() -> Arm {
    let turn = Rotation3::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI - 0.5);
    let mount = ToolMount { flange_from_burr: Rigid::new(turn, turn * Vector3::new(0.0, 0.0, -180.0)) };
    Arm::ur(UrModel::Ur5e, None).expect("the shipped arm").with_mount(mount)
}

fn kinematics(c: &mut Criterion) {
    let arm = ur5e();
    let pose = arm.forward(&Q).expect("six joints");
    let geometry = UrModel::Ur5e.geometry();
    c.bench_function("ur5e/inverse, all branches", |b| b.iter(|| geometry.inverse(black_box(&pose), 0.0)));
    c.bench_function("ur5e/forward", |b| b.iter(|| arm.forward(black_box(&Q))));
    c.bench_function("ur5e/Jacobian", |b| b.iter(|| arm.jacobian(black_box(&Q))));
    let robot = urdf_rs::read_from_string(arm.urdf_text()).expect("our own URDF");
    let chain = k::Chain::<f64>::from(&robot);
    let serial = k::SerialChain::from_end(chain.find("wrist_3_link-tool0").expect("its tip"));
    c.bench_function("ur5e/Jacobian by k", |b| {
        b.iter(|| {
            serial.set_joint_positions_unchecked(black_box(&Q));
            serial.update_transforms();
            k::jacobian(&serial)
        });
    });
}

/// A raster of steps of 0.25 mm with a swinging shaft, in front of a UR5e.
fn raster(count: usize) -> (Vec<AxisPose>, Vec<f64>) {
    let poses: Vec<AxisPose> = (0..count)
        .map(|i| {
            let (row, along) = (i / 80, i % 80);
            let along = if row % 2 == 0 { along } else { 79 - along };
            let tilt = 0.5 * (0.01 * i as f64).sin();
            AxisPose {
                position: Point::new(
                    440.0 + 0.25 * along as f64,
                    -10.0 + (row % 20) as f64,
                    100.0 - 0.05 * (row / 20) as f64,
                ),
                axis: Unit::new_normalize(Vector3::new(tilt.sin(), 0.1, tilt.cos())),
            }
        })
        .collect();
    let mut length_mm = vec![0.0];
    length_mm.extend(poses.windows(2).map(|pair| pair[0].position.distance_mm(&pair[1].position)));
    (poses, length_mm)
}

fn paths(c: &mut Criterion) {
    let arm = ur5e();
    let (poses, length_mm) = raster(20_000);
    let frame = RollFrame::about(&Vector3::z_axis());
    let path = PosePath {
        poses: &poses,
        length_mm: &length_mm,
        frame,
        stiffness: None,
        posture: Posture::Any,
        room: None,
    };
    let mut group = c.benchmark_group("20 000 waypoints");
    group.sample_size(10);
    group.bench_function("redundancy", |b| b.iter(|| resolve(black_box(&arm), &path)));
    let resolved = resolve(&arm, &path).expect("matching lists").expect("in reach");
    group.bench_function("places between", |b| b.iter(|| DensePath::lay(&arm, &path, black_box(&resolved))));
    let dense = DensePath::lay(&arm, &path, &resolved).expect("in reach");
    let limits =
        PathLimits::of_arm(&arm, CornerTolerance { burr_mm: 0.02, axis_rad: 1e-3 }).expect("the arm's");
    let joint_path = JointPath { q: &dense.q, burr_mm: &dense.burr_mm, pose: &dense.pose, stops: &[] };
    let caps = vec![1.5; dense.len()];
    group.bench_function("time law", |b| {
        b.iter(|| PreparedPath::new(black_box(&joint_path), &limits).and_then(|path| path.law(&caps)));
    });
}

criterion_group!(benches, kinematics, paths);
criterion_main!(benches);
