//! Error of the orientation kernel against the converged sum, as quantiles over random bone, feeds and axes.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stderr)] // a test's helpers are tests

use bonemill_geometry::{Grid, Point, Volume, Work};
use bonemill_planner::burr::{
    AtPoints, Discretisation, ElementGrid, EngagedForce, EngagedSamples, Feed, ForceKernel, Material,
    Measure, OrientationKernel, OverPatches, Patch, Tool,
};
use bonemill_planner::engagement::share_beyond;
use nalgebra::{Unit, Vector3};

const RPM: f64 = 60_000.0;
const ORIGIN: Point<Work> = Point::new(0.0, 0.0, 0.0);

/// Numbers in [0, 1): a fixed sequence.
struct Sequence(u64);

impl Sequence {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }
    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.next()
    }
    fn direction(&mut self) -> Unit<Vector3<f64>> {
        loop {
            let v = Vector3::from_fn(|_, _| self.between(-1.0, 1.0));
            if (0.1..1.0).contains(&v.norm()) {
                return Unit::new_normalize(v);
            }
        }
    }
}

/// Foam under a surface, with air cells and noise, in voxels of 0.25 mm around a burr of 2.5 mm; removed behind a plane.
fn bone(s: &mut Sequence) -> Volume<f64, Work> {
    let grid = Grid::aligned([26, 26, 26], 0.25, Point::new(-3.2, -3.1, -3.15)).unwrap();
    let surface = s.between(-1.5, 2.5);
    let cells: Vec<_> =
        (0..6).map(|_| (Vector3::from_fn(|_, _| s.between(-3.0, 3.0)), s.between(0.8, 2.2))).collect();
    let data = (0..grid.len())
        .map(|n| {
            let p = grid.center(grid.voxel(n)).coords;
            let d = cells.iter().map(|(c, r)| (p - c).norm() - r).fold(surface - p.z, f64::min);
            0.8 * (0.5 + d / 0.25).clamp(0.0, 1.0) * s.between(0.9, 1.1)
        })
        .collect();
    Volume::new(grid, data).unwrap()
}

struct Scene {
    bone: Volume<f64, Work>,
    /// The volume of an earlier pass, with a sharp edge as of exact capsules.
    pass: (Vector3<f64>, f64),
    feed: Unit<Vector3<f64>>,
    axis: Unit<Vector3<f64>>,
}

impl Scene {
    fn new(s: &mut Sequence) -> Self {
        let across = Vector3::new(0.0, s.between(1.2, 3.0), s.between(-0.5, 1.5));
        let feed = if s.next() < 0.7 { Vector3::x_axis() } else { s.direction() };
        let mut axis = s.direction();
        // tilts up to 70° from +z
        while axis.z < 0.34 {
            axis = s.direction();
        }
        Self { bone: bone(s), pass: (across, 2.5), feed, axis }
    }

    /// Density of the uncut bone, times the share of a patch outside the earlier pass.
    fn mean_weight(&self, n: &Vector3<f64>, patch: &Patch) -> f64 {
        let x = n * 2.5;
        let (across, r) = self.pass;
        let away = Vector3::new(0.0, x.y - across.y, x.z - across.z);
        let share = share_beyond(away.norm() - r, patch.sides_mm(&away.normalize()));
        share * self.bone.trilinear(ORIGIN + x, 0.0) / 0.8
    }

    /// Density of the uncut bone, or 0 where the sample lies in a straight earlier pass along x.
    fn weight(&self, n: &Vector3<f64>) -> f64 {
        let x = n * 2.5;
        let (across, r) = self.pass;
        if (x.yz() - across.yz()).norm() < r { 0.0 } else { self.bone.trilinear(ORIGIN + x, 0.0) / 0.8 }
    }
}

fn quantile(sorted: &[f64], q: f64) -> f64 {
    sorted[((sorted.len() - 1) as f64 * q).round() as usize]
}

fn converged(tool: &Tool, material: &Material, measure: Measure, scene: &Scene) -> EngagedForce {
    let disc = Discretisation::new(1024 / tool.blades() as usize, 512, ElementGrid::Kappa, measure).unwrap();
    let kernel = ForceKernel::new(tool, material, &disc);
    kernel.engaged_force(
        &scene.axis,
        &Feed::new(&scene.feed, 1.5, RPM),
        &mut AtPoints(|n: &Vector3<f64>| scene.weight(n)),
    )
}

/// Sorted |F − F_converged| / |F_converged| of the scenes in which something is cut, for a kernel's force.
fn errors(expected: &[EngagedForce], found: impl Fn(usize) -> Vector3<f64>) -> Vec<f64> {
    let error = |(n, e): (usize, &EngagedForce)| {
        let e = e.force_n(1.5);
        // a thirtieth of a full slot
        (e.norm() > 0.1).then(|| (found(n) - e).norm() / e.norm())
    };
    let mut errors: Vec<f64> = expected.iter().enumerate().filter_map(error).collect();
    errors.sort_by(f64::total_cmp);
    errors
}

fn measure(label: &str, tool: &Tool, material: &Material, measure: Measure, limits: [f64; 4]) {
    let mut sequence = Sequence(20_161_201);
    let scenes: Vec<Scene> = (0..60).map(|_| Scene::new(&mut sequence)).collect();
    let expected: Vec<EngagedForce> = scenes.iter().map(|s| converged(tool, material, measure, s)).collect();
    let table = |what: &str, e: &[f64]| {
        let [a, b, c, d] = [0.5, 0.75, 0.99, 1.0].map(|q| quantile(e, q));
        eprintln!(
            "{label:<12} {what:<14} {:3} scenes: q50 {a:.1e} q75 {b:.1e} q99 {c:.1e} max {d:.1e}",
            e.len()
        );
        [a, b, c, d]
    };
    let mut at_default = None;
    for (m, merged) in [(512, 1), (1024, 1), (1024, 2), (2048, 2), (2048, 4), (4096, 1), (4096, 8), (8192, 1)]
    {
        let kernel = OrientationKernel::new(tool, material, measure, m, merged);
        let mut samples = EngagedSamples::default();
        let found: Vec<Vector3<f64>> = scenes
            .iter()
            .map(|s| {
                kernel.gather(
                    &mut samples,
                    &Feed::new(&s.feed, 1.5, RPM),
                    &mut OverPatches(|n: &Vector3<f64>, patch: &Patch| s.mean_weight(n, patch)),
                );
                kernel.force_for_axis(&samples, &s.axis, RPM).force_n(1.5)
            })
            .collect();
        let errors = errors(&expected, |n| found[n]);
        assert!(errors.len() > 40);
        let quantiles = table(&format!("{m} by {merged}"), &errors);
        if (m, merged) == (OrientationKernel::DEFAULT_SAMPLES, OrientationKernel::DEFAULT_MERGED) {
            at_default = Some(quantiles);
        }
    }
    for (n_gamma, n_kappa) in [(8, 32), (12, 48), (16, 64), (24, 96)] {
        let disc = Discretisation::new(n_gamma, n_kappa, ElementGrid::Kappa, measure).unwrap();
        let kernel = ForceKernel::new(tool, material, &disc);
        let force = |n: usize| {
            let s: &Scene = &scenes[n];
            kernel
                .engaged_force(
                    &s.axis,
                    &Feed::new(&s.feed, 1.5, RPM),
                    &mut OverPatches(|n: &Vector3<f64>, patch: &Patch| s.mean_weight(n, patch)),
                )
                .force_n(1.5)
        };
        table(&format!("{n_kappa} × {}", 8 * n_gamma), &errors(&expected, force));
    }
    let found = at_default.expect("the default is among those tried");
    assert!(found.iter().zip(limits).all(|(f, limit)| *f <= limit), "{label}: {found:?} above {limits:?}");
}

fn tool() -> Tool {
    Tool::new(2.5, 8, -1).unwrap()
}

fn foam() -> Material {
    Material::new([1400.0, 840.0, 140.0], 0.8).unwrap()
}

#[test]
fn db_with_a_neck() {
    measure("db, neck", &tool().with_neck(1.1).unwrap(), &foam(), Measure::Db, [2e-3, 3e-3, 8e-3, 1e-2]);
}

#[test]
fn db_whole_sphere() {
    measure("db", &tool(), &foam(), Measure::Db, [2e-3, 3e-3, 8e-3, 1e-2]);
}

#[test]
fn dz_whole_sphere() {
    measure("dz", &tool(), &foam(), Measure::Dz, [1.5e-3, 2.5e-3, 5e-3, 8e-3]);
}

#[test]
fn edge_and_cut_with_a_helix() {
    let tool = tool().with_helix(0.5).unwrap();
    let material = foam().with_edge([0.04, 0.06, 0.01], 2e-5).unwrap();
    measure("edge", &tool, &material, Measure::Db, [3.5e-3, 5e-3, 1e-2, 1.5e-2]);
}

/// Uniform bone has closed forms; the poles of the shaft are among the samples.
#[test]
fn uniform_bone_has_its_closed_form() {
    let c = 60.0 * 1.5 * 2.5 / RPM;
    let [k_t, k_r, k_a] = [1400.0, 840.0, 140.0];
    let pi = std::f64::consts::PI;
    let side = Vector3::new(-pi * k_r / 8.0, k_t / 2.0, -k_a / 2.0) * c;
    let plunge = Vector3::new(0.0, 0.0, pi * k_r / 4.0 - k_a / 2.0) * c;
    let kernel = OrientationKernel::new(&tool(), &foam(), Measure::Db, 4096, 8);
    for (feed, expected, torque) in
        [(Vector3::x_axis(), side, k_t * c * 1.25), (-Vector3::z_axis(), plunge, k_t * c * 1.25)]
    {
        let mut samples = EngagedSamples::default();
        kernel.gather(&mut samples, &Feed::new(&feed, 1.5, RPM), &mut AtPoints(|_: &Vector3<f64>| 1.0));
        assert_eq!(samples.len(), 512);
        let f = kernel.force_for_axis(&samples, &Vector3::z_axis(), RPM);
        let off = (f.force_n(1.5) - expected).norm() / expected.norm();
        // in a plunge the pole is the centre of the lattice, which is its worst case
        assert!(off < if feed.z < 0.0 { 1e-2 } else { 2e-3 }, "{off}");
        assert!((f.torque_nmm(1.5) / torque - 1.0).abs() < 5e-3);
        assert!((f.mrr_mm2 / (pi * 6.25) - 1.0).abs() < 1e-6);
    }
}

/// A slow turn of the axis changes the force slowly, also past the neck and past a pole in bone: smoothly without merging, and
/// with merging in steps smaller than the lattice's error.
#[test]
fn the_force_is_continuous_in_the_axis() {
    let mut sequence = Sequence(7);
    for (merged, most) in [(1, 1e-3), (8, 5e-3)] {
        for tool in [tool(), tool().with_neck(1.1).unwrap()] {
            let kernel = OrientationKernel::new(&tool, &foam(), Measure::Db, 4096, merged);
            let scene = Scene::new(&mut sequence);
            let mut samples = EngagedSamples::default();
            kernel.gather(
                &mut samples,
                &Feed::new(&scene.feed, 1.5, RPM),
                &mut AtPoints(|n: &Vector3<f64>| scene.weight(n)),
            );
            let force = |angle: f64| {
                let axis = Unit::new_normalize(Vector3::new(angle.sin(), 0.1 * angle, angle.cos()));
                kernel.force_for_axis(&samples, &axis, RPM).force_n(1.5)
            };
            let step = 1e-4;
            for k in 0..10_000 {
                let angle = f64::from(k) * step;
                let change = (force(angle + step) - force(angle)).norm();
                assert!(change < most * force(angle).norm(), "merged {merged}: {change} at {angle}");
            }
        }
    }
}

#[test]
fn nothing_in_front_is_no_force() {
    let kernel = OrientationKernel::new(&tool(), &foam(), Measure::Db, 256, 4);
    let mut samples = EngagedSamples::default();
    kernel.gather(
        &mut samples,
        &Feed::new(&Vector3::x_axis(), 1.5, RPM),
        &mut AtPoints(|_: &Vector3<f64>| 0.0),
    );
    assert!(samples.is_empty());
    assert_eq!(kernel.force_for_axis(&samples, &Vector3::z_axis(), RPM), EngagedForce::ZERO);
}
