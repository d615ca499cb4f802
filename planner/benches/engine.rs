//! Speed of the engine's steps compared with a plain loop over the tool's box in the same run; only the ratios have a meaning.
#![allow(missing_docs, clippy::expect_used)] // criterion's macros make undocumented functions; the inputs are fixed

use std::hint::black_box;

use bonemill_geometry::{Grid, Point, Volume, Work};
use bonemill_planner::burr::{Discretisation, ElementGrid, Material, Measure, Tool};
use bonemill_planner::simulate::{Bone, Engine, EngineSpec, FlutedBurr, Lattice, Move, Piece, Pose};
use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use nalgebra::Vector3;

const SIDE_MM: f64 = 50.0;
const RADIUS_MM: f64 = 2.5;

fn bone(n: usize) -> Volume<u8, Work> {
    let h = SIDE_MM / n as f64;
    let grid = Grid::aligned([n; 3], h, Point::from_coords(Vector3::repeat(0.5 * h))).expect("a grid");
    Volume::filled(grid, 1)
}

fn spec() -> EngineSpec {
    EngineSpec {
        tool: Tool::new(RADIUS_MM, 8, -1).expect("a tool"),
        material: Material::new([1400.0, 840.0, 140.0], 0.8).expect("a material"),
        disc: Discretisation::new(8, 32, ElementGrid::Kappa, Measure::Db).expect("a discretisation"),
        spindle_rpm: 60_000.0,
        shank: Vec::new(),
        cells_per_radius: EngineSpec::CELLS_PER_RADIUS,
    }
}

/// A path to and fro along lines in the bone's upper face, one stepover apart, deeper in every round.
struct Way(usize);

impl Way {
    fn next(&mut self, step_mm: f64) -> Vector3<f64> {
        self.0 += 1;
        let per_line = (40.0 / step_mm) as usize;
        let (line, at) = (self.0 / per_line, (self.0 % per_line) as f64 * step_mm);
        let x = if line.is_multiple_of(2) { 5.0 + at } else { 45.0 - at };
        Vector3::new(x, 5.0 + 1.7 * (line % 24) as f64, SIDE_MM - 0.03 - 1.5 * (line / 24) as f64)
    }
}

/// Tests every voxel of the ball's box at every step.
fn box_loop(bone: &Volume<u8, Work>, removed: &mut [bool], center: Vector3<f64>) -> f64 {
    let (grid, dims) = (bone.grid(), bone.grid().dims());
    let c = grid.continuous_index(Point::from_coords(center));
    let reach = RADIUS_MM / grid.spacing_mm().x;
    let range = |a: usize| {
        let end = ((c[a] + reach).ceil().max(0.0) as usize + 1).min(dims[a]);
        ((c[a] - reach).floor().max(0.0) as usize).min(end)..end
    };
    let mut mass = 0.0;
    for k in range(2) {
        for j in range(1) {
            for i in range(0) {
                let off = [i as f64 - c[0], j as f64 - c[1], k as f64 - c[2]];
                let voxel = i + dims[0] * (j + dims[1] * k);
                if off.iter().map(|v| v * v).sum::<f64>() <= reach * reach && !removed[voxel] {
                    removed[voxel] = true;
                    mass += f64::from(bone.data()[voxel]);
                }
            }
        }
    }
    mass
}

fn steps(c: &mut Criterion) {
    let mut group = c.benchmark_group("engine/step_0.1mm");
    for n in [128, 512] {
        let bone = bone(n);
        group.bench_function(BenchmarkId::new("engine", format!("{n}³")), |b| {
            let spec = spec();
            let model = FlutedBurr { tool: spec.tool.clone(), material: spec.material.clone() };
            let mut way = Way(0);
            let pose = |p: Vector3<f64>| Pose::new(Point::from_coords(p), Vector3::z()).expect("a pose");
            let start = pose(way.next(0.1));
            let mut engine =
                Engine::new(Bone::new(&bone).expect("a bone"), spec, model, start).expect("an engine");
            b.iter(|| engine.step(Move::straight(pose(way.next(0.1)), 0.1 / 1.5)));
        });
        group.bench_function(BenchmarkId::new("box_loop_without_force", format!("{n}³")), |b| {
            let (mut removed, mut way) = (vec![false; bone.data().len()], Way(0));
            b.iter(|| black_box(box_loop(&bone, &mut removed, way.next(0.1))));
        });
    }
    group.finish();
}

fn removal(c: &mut Criterion) {
    let bone = bone(256);
    let mut group = c.benchmark_group("engine/remove_0.5mm");
    for cells in [5.0, 10.0, 20.0] {
        group.bench_function(format!("{cells}_cells_per_radius"), |b| {
            let mut lattice =
                Lattice::new(Bone::new(&bone).expect("a bone"), RADIUS_MM, cells).expect("a lattice");
            let mut way = Way(0);
            let mut from = Point::from_coords(way.next(0.5));
            b.iter(|| {
                let to = Point::from_coords(way.next(0.5));
                let piece = Piece { from, to, continues: true };
                from = to;
                lattice.remove(&[piece], RADIUS_MM)
            });
        });
    }
    group.finish();
}

criterion_group!(benches, steps, removal);
criterion_main!(benches);
