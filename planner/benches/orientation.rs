//! Speed of choosing the shaft's direction: time per edge of the layered graph compared with a graph that stores its edges,
//! and time per orientation cost. Only the ratios have a meaning.
#![allow(missing_docs, clippy::expect_used)] // criterion's macros make undocumented functions; the inputs are fixed

use std::hint::black_box;

use bonemill_geometry::{Grid, Point, Volume, Work};
use bonemill_planner::burr::{AtPoints, EngagedSamples, Feed, Material, Measure, OrientationKernel, Tool};
use bonemill_planner::cost::{CostModel, Proximity, Ranked, SeveralStructures};
use bonemill_planner::metrics::Moments;
use bonemill_planner::orientation::sequence::{BestSequence, Forbidden, Problem, best_sequence};
use bonemill_planner::orientation::{Directions, FreeSets, TiltFamily, TurnLimits, TurnPrice};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use nalgebra::{Unit, Vector3};

const WEIGHT_MM: f64 = 1.0;
const RATE: TurnLimits = TurnLimits { price: TurnPrice::Smoothness(WEIGHT_MM), most_rad_per_mm: 0.4 };
const STEP_MM: f64 = 0.25;

fn family() -> TiltFamily {
    TiltFamily { hinge: Vector3::x_axis(), zero: Vector3::z_axis(), lower_rad: -1.05, upper_rad: 1.05 }
}

/// The simplest implementation of a layered graph: all edges are stored, then relaxed.
struct Ladder {
    edges: Vec<Vec<(u32, u32, f64)>>,
}

impl Ladder {
    fn new(problem: &Problem) -> Self {
        let n = problem.directions.len();
        let reach = (RATE.most_rad_per_mm * STEP_MM).max(1.5 * problem.directions.spacing_rad());
        let rung = |i: usize| {
            let pairs = (0..n).flat_map(|a| (0..n).map(move |b| (a, b)));
            let edge = |(a, b): (usize, usize)| {
                let angle = problem.directions.angle_rad(a, b);
                let fits = angle <= reach && problem.free.contains(i - 1, a) && problem.free.contains(i, b);
                fits.then(|| (a as u32, b as u32, angle * angle * WEIGHT_MM / STEP_MM))
            };
            pairs.filter_map(edge).collect()
        };
        Self { edges: (1..problem.free.len()).map(rung).collect() }
    }

    fn shortest(&self, problem: &Problem) -> f64 {
        let n = problem.directions.len();
        let own = |i: usize, k: usize| f64::from(problem.cost[i * n + k]) * STEP_MM;
        let mut best: Vec<f64> = (0..n).map(|k| own(0, k)).collect();
        let mut came_from = Vec::with_capacity(self.edges.len() * n);
        for (rung, edges) in self.edges.iter().enumerate() {
            let mut next = vec![f64::INFINITY; n];
            let mut from = vec![0u32; n];
            for (a, b, turn) in edges {
                let total = best[*a as usize] + turn;
                if total < next[*b as usize] {
                    next[*b as usize] = total;
                    from[*b as usize] = *a;
                }
            }
            next.iter_mut().enumerate().for_each(|(k, v)| *v += own(rung + 1, k));
            came_from.extend(from);
            best = next;
        }
        black_box(came_from);
        best.into_iter().fold(f64::INFINITY, f64::min)
    }
}

fn edges(c: &mut Criterion) {
    let sets = [
        ("plane", Directions::in_plane(&family(), 2f64.to_radians(), 1.05), 2000),
        ("cap", Directions::cap(6f64.to_radians(), 1.05), 400),
    ];
    for (name, directions, waypoints) in sets {
        let n = directions.len();
        let cost: Vec<f32> = (0..n * waypoints).map(|k| ((k * 7919) % 1009) as f32 / 1009.0).collect();
        // directions are free on one side of a boundary that moves, as beside a wall
        let free =
            FreeSets::fill(waypoints, n, |i, k| directions.axes()[k].y < 0.4 + 0.3 * (i as f64 * 0.01).sin());
        let forbidden = Forbidden::default();
        let problem = Problem {
            directions: &directions,
            cost: &cost,
            free: &free,
            length_mm: &vec![STEP_MM; waypoints],
            turns: RATE,
            forbidden: &forbidden,
        };
        let BestSequence::Sequence { total, edges, .. } = best_sequence(&problem) else { return };
        let ladder = Ladder::new(&problem);
        let stored: usize = ladder.edges.iter().map(Vec::len).sum();
        assert!((ladder.shortest(&problem) - total).abs() < 1e-6 * total || stored as u64 != edges);
        let mut group = c.benchmark_group(format!("edges/{name}/{waypoints}x{n}"));
        group.throughput(Throughput::Elements(edges));
        group.bench_function("looked_up", |b| b.iter(|| best_sequence(black_box(&problem))));
        group.throughput(Throughput::Elements(stored as u64));
        group.bench_function("stored", |b| b.iter(|| ladder.shortest(black_box(&problem))));
        group.finish();
    }
}

fn cost(c: &mut Criterion) {
    const RPM: f64 = 60_000.0;
    let grid = Grid::<Work>::aligned([40, 40, 40], 0.25, Point::new(-4.9, -4.8, -4.85)).expect("a grid");
    let density = |n: usize| {
        let p = grid.center(grid.voxel(n)).coords;
        let cells = (1.9 * p.x).sin() * (2.3 * p.y + 1.0).sin() * (2.1 * p.z).sin();
        // a layer of 1.5 mm beside an earlier line
        if p.z > -1.0 || p.y > 0.8 || cells > 0.35 { 0.0 } else { 0.8 + 0.1 * cells as f32 }
    };
    let bone =
        Volume::new(grid.clone(), (0..grid.len()).map(density).collect()).expect("one value per voxel");
    let tool = Tool::new(2.5, 8, -1).and_then(|t| t.with_neck(1.1)).expect("a tool");
    let material = Material::new([1400.0, 840.0, 140.0], 0.8).expect("a material");
    let center = Point::new(0.03, -0.02, 0.01);
    let feed = Unit::new_normalize(Vector3::new(1.0, 0.1, 0.0));
    let model = CostModel::new(0.7, 0.8).expect("a model");
    let proximity = Proximity::new(Vector3::new(0.5, -4.0, -1.0), 3.5).expect("a structure");
    let terms = model.terms(&[Ranked { proximity, priority: 1 }], SeveralStructures::Nearest);
    let mut moments = Moments::new(2.5);
    moments.add(0.3, &Vector3::new(1.8, -0.4, -1.6));
    moments.add(0.2, &Vector3::new(2.0, 0.3, -1.2));
    let axes: Vec<_> = Directions::cap(6f64.to_radians(), 1.05).axes().to_vec();
    for measure in [Measure::Db, Measure::Dz] {
        let (samples, merged) = (OrientationKernel::DEFAULT_SAMPLES, OrientationKernel::DEFAULT_MERGED);
        let kernel = OrientationKernel::new(&tool, &material, measure, samples, merged);
        let mut engaged = EngagedSamples::default();
        kernel.gather(
            &mut engaged,
            &Feed::new(&feed, 1.5, RPM),
            &mut AtPoints(|n: &Vector3<f64>| material.weight(bone.trilinear(center + n * 2.5, 0.0))),
        );
        let mut group = c.benchmark_group(format!("orientation_cost/{measure:?}/{}_engaged", engaged.len()));
        group.throughput(Throughput::Elements(axes.len() as u64));
        group.bench_function("all_axes_of_a_cap", |b| {
            b.iter(|| {
                let cost = |axis: &Unit<Vector3<f64>>| {
                    let force = kernel.force_for_axis(&engaged, axis, RPM).force_n(1.5);
                    terms.cost(&force, moments.inertia_normalised(axis), moments.mass_mg()).cost
                };
                axes.iter().map(cost).sum::<f64>()
            })
        });
        group.finish();
    }
}

criterion_group!(benches, edges, cost);
criterion_main!(benches);
