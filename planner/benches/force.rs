//! Speed of the force and volume kernels compared with simple loops in the same run; only the ratios have a meaning.
#![allow(missing_docs, clippy::expect_used)] // criterion's macros make undocumented functions; the inputs are fixed

use std::f64::consts::PI;
use std::hint::black_box;

use bonemill_geometry::{Grid, Point, Volume, Work, basis};
use bonemill_planner::ball::{BallVolumes, ball_box_volume};
use bonemill_planner::burr::{
    AtPoints, Discretisation, ElementGrid, EngagedSamples, Feed, ForceKernel, Material, Measure, Motion,
    OrientationKernel, Tool, burr_force,
};
use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::{Unit, Vector3};

const RPM: f64 = 60_000.0;
const CENTER: Point<Work> = Point::new(0.03, -0.02, 0.01);

/// A porous half-space at 0.25 mm: the burr's upper half is free.
fn bone() -> Volume<f32, Work> {
    let grid = Grid::aligned([40, 40, 40], 0.25, Point::new(-4.9, -4.8, -4.85)).expect("a grid");
    let density = |n: usize| {
        let p = grid.center(grid.voxel(n)).coords;
        let cells = (1.9 * p.x).sin() * (2.3 * p.y + 1.0).sin() * (2.1 * p.z).sin();
        if p.z > 0.9 || cells > 0.35 { 0.0 } else { 0.8 + 0.1 * cells as f32 }
    };
    let data = (0..grid.len()).map(density).collect();
    Volume::new(grid, data).expect("one value per voxel")
}

/// The simplest implementation: a sum over every node of every blade, without torque.
fn plain_loop(
    bone: &Volume<f32, Work>,
    tool: &Tool,
    k: [f64; 3],
    axis: &Unit<Vector3<f64>>,
    v: Vector3<f64>,
) -> Vector3<f64> {
    let (n_gamma, n_kappa, blades, r) = (16, 64, tool.blades() as usize, tool.radius_mm());
    let rotation = basis::from_z(axis);
    let f = rotation.inverse() * v * (60.0 / (RPM * blades as f64));
    let step = PI / n_kappa as f64;
    let mut force = Vector3::zeros();
    for i in 0..blades {
        for j in 0..n_gamma {
            for e in 0..n_kappa {
                let psi = 2.0 * PI * (i as f64 - (j as f64 + 0.5) / n_gamma as f64) / blades as f64;
                let kappa = (e as f64 + 0.5) * step;
                let (sp, cp, sk, ck) = (psi.sin(), psi.cos(), kappa.sin(), kappa.cos());
                let n = Vector3::new(sk * cp, sk * sp, -ck);
                let t = n.dot(&f).max(0.0);
                let w = bone.trilinear(CENTER + rotation * n * r, 0.0) / 0.8;
                let e_v = Vector3::new(sp, -cp, 0.0);
                let e_a = Vector3::new(ck * cp, ck * sp, sk);
                force -= (e_v * k[0] + n * k[1] + e_a * k[2]) * (t * w * r * step);
            }
        }
    }
    rotation * force / n_gamma as f64
}

fn forces(c: &mut Criterion) {
    let (bone, k) = (bone(), [1400.0, 840.0, 140.0]);
    let tool = Tool::new(2.5, 8, -1).expect("a tool");
    let material = Material::new(k, 0.8).expect("a material");
    let axis = Unit::new_normalize(Vector3::new(0.2, -0.4, 1.0));
    let v = Vector3::new(1.2, 0.9, 0.0);
    let feed = Unit::new_normalize(v);
    let disc = Discretisation::new(16, 64, ElementGrid::Kappa, Measure::Db).expect("a discretisation");
    let motion = Motion::new(CENTER, axis.into_inner(), v, RPM).expect("a motion");
    let kernel = ForceKernel::new(&tool, &material, &disc);
    let weight = |n: &Vector3<f64>| material.weight(bone.trilinear(CENTER + n * 2.5, 0.0));

    let mut group = c.benchmark_group("force/64x128");
    group.bench_function("plain_loop", |b| b.iter(|| plain_loop(&bone, &tool, k, black_box(&axis), v)));
    group.bench_function("literal_all_outputs", |b| {
        b.iter(|| burr_force(|p| bone.trilinear(p, 0.0), &tool, &material, &disc, black_box(&motion)))
    });
    group.bench_function("kernel", |b| {
        b.iter(|| kernel.engaged_force(black_box(&axis), &Feed::new(&feed, 1.5, RPM), &mut AtPoints(weight)))
    });
    group.bench_function("kernel_without_lookups", |b| {
        b.iter(|| {
            kernel.engaged_force(
                black_box(&axis),
                &Feed::new(&feed, 1.5, RPM),
                &mut AtPoints(|n: &Vector3<f64>| f64::from(n.z < 0.3)),
            )
        })
    });
    group.finish();

    for samples in [2048, 4096, 8192] {
        let orientation = OrientationKernel::new(&tool, &material, Measure::Db, samples, 8);
        let necked = tool.clone().with_neck(1.1).expect("a neck");
        let with_neck = OrientationKernel::new(&necked, &material, Measure::Db, samples, 8);
        let dz = OrientationKernel::new(&tool, &material, Measure::Dz, samples, 8);
        let mut engaged = EngagedSamples::default();
        let mut group = c.benchmark_group(format!("orientation/{samples}"));
        group.bench_function("gather", |b| {
            b.iter(|| {
                orientation.gather(
                    &mut engaged,
                    &Feed::new(black_box(&feed), 1.5, RPM),
                    &mut AtPoints(weight),
                )
            })
        });
        orientation.gather(&mut engaged, &Feed::new(&feed, 1.5, RPM), &mut AtPoints(weight));
        let n = engaged.len();
        group.bench_function(format!("axis_db_{n}_engaged"), |b| {
            b.iter(|| orientation.force_for_axis(&engaged, black_box(&axis), RPM))
        });
        group.bench_function(format!("axis_db_neck_{n}_engaged"), |b| {
            b.iter(|| with_neck.force_for_axis(&engaged, black_box(&axis), RPM))
        });
        group.bench_function(format!("axis_dz_{n}_engaged"), |b| {
            b.iter(|| dz.force_for_axis(&engaged, black_box(&axis), RPM))
        });
        group.finish();
    }
}

fn volumes(c: &mut Criterion) {
    let bone = bone();
    let grid = bone.grid();
    let block = [[0; 3], grid.dims()];
    let (mut volumes, r) = (BallVolumes::new(), 2.0);
    let mut count = 0;
    volumes.for_each(grid, CENTER, r, block, |row| row, |_, _| count += 1);
    let mut group = c.benchmark_group(format!("ball/r8voxels_{count}"));
    group.bench_function("box_by_box", |b| {
        let h = grid.spacing_mm() * 0.5;
        let boxes: Vec<_> = (0..grid.len())
            .map(|n| grid.center(grid.voxel(n)) - CENTER)
            .filter(|p| (p.abs() - h).sup(&Vector3::zeros()).norm() < r)
            .collect();
        b.iter(|| boxes.iter().map(|p| ball_box_volume(r, (p - h).into(), (p + h).into())).sum::<f64>())
    });
    group.bench_function("lattice", |b| {
        b.iter(|| {
            let mut sum = 0.0;
            volumes.for_each(grid, black_box(CENTER), r, block, |row| row, |_, v| sum += v);
            sum
        })
    });
    // the query of a step along a path: the bone that earlier balls have left
    let behind = CENTER + Vector3::new(-0.25, 0.0, 0.0);
    let left: Vec<bool> =
        (0..grid.len()).map(|n| grid.center(grid.voxel(n)).distance_mm(&behind) > r - 0.22).collect();
    group.bench_function("lattice_front_only", |b| {
        b.iter(|| {
            let mut sum = 0.0;
            volumes.for_each(
                grid,
                black_box(CENTER),
                r,
                block,
                |row| row.filter(|n| left[*n]),
                |_, v| sum += v,
            );
            sum
        })
    });
    group.bench_function("lattice_nothing_wanted", |b| {
        b.iter(|| volumes.for_each(grid, black_box(CENTER), r, block, |_| None, |_, _| ()))
    });
    group.finish();
}

criterion_group!(benches, forces, volumes);
criterion_main!(benches);
