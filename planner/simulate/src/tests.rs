//! Hard cases of the engine, compared with closed forms or brute force.

use std::f64::consts::PI;

use bonemill_cutting::burr::{Discretisation, ElementGrid, Material, Measure, Tool};
use bonemill_cutting::cutter::ShankCylinder;
use bonemill_geometry::{Grid, Point, Volume, Work};
use nalgebra::Vector3;
use proptest::prelude::*;

use super::*;

mod hard;
mod images;
mod shank;
mod surface;

const RPM: f64 = 20_000.0;
const RADIUS_MM: f64 = 2.5;

/// A cubic block about the origin whose density is a function of the place.
fn block(half_mm: f64, h_mm: f64, density: impl Fn(Vector3<f64>) -> f64) -> Volume<f32, Work> {
    let n = (2.0 * half_mm / h_mm).round() as usize;
    let corner = -half_mm + 0.5 * h_mm;
    let grid = Grid::aligned([n; 3], h_mm, Point::new(corner, corner, corner)).unwrap();
    let data = (0..grid.len()).map(|v| density(grid.center(grid.voxel(v)).coords) as f32).collect();
    Volume::new(grid, data).unwrap()
}

pub(super) fn uniform(half_mm: f64, h_mm: f64) -> Volume<f32, Work> {
    block(half_mm, h_mm, |_| 0.8)
}

fn spec() -> EngineSpec {
    let tool = Tool::new(RADIUS_MM, 8, -1).unwrap();
    let material = Material::new([100.0, 60.0, 20.0], 0.8).unwrap();
    let disc = Discretisation::new(8, 32, ElementGrid::Kappa, Measure::Db).unwrap();
    EngineSpec { tool, material, disc, spindle_rpm: RPM, shank: Vec::new(), cells_per_radius: 10.0 }
}

fn burr(spec: &EngineSpec) -> FlutedBurr {
    FlutedBurr { tool: spec.tool.clone(), material: spec.material.clone() }
}

fn pose(x: f64, y: f64, z: f64) -> Pose {
    Pose::new(Point::new(x, y, z), Vector3::z()).unwrap()
}

pub(super) fn engine<'a>(bone: &'a Volume<f32, Work>, start: Pose) -> Engine<'a, f32, FlutedBurr> {
    let spec = spec();
    let model = burr(&spec);
    Engine::new(Bone::new(bone).unwrap(), spec, model, start).unwrap()
}

/// A move at 1.5 mm/s.
fn to(from: Pose, to: Pose) -> Move {
    Move::straight(to, from.center.distance_mm(&to.center) / 1.5)
}

/// `count` equal steps to a place.
fn straight(engine: &mut Engine<'_, f32, FlutedBurr>, end: Pose, count: usize) -> Vec<Step> {
    let start = engine.pose();
    (1..=count)
        .map(|n| {
            let center = start.center + (end.center - start.center) * (n as f64 / count as f64);
            let next = Pose { center, axis: end.axis };
            engine.step(to(engine.pose(), next)).unwrap()
        })
        .collect()
}

fn capsule_mm3(length_mm: f64) -> f64 {
    PI * RADIUS_MM.powi(2) * length_mm + 4.0 / 3.0 * PI * RADIUS_MM.powi(3)
}

#[test]
fn a_full_slot_has_its_closed_form() {
    let bone = uniform(8.0, 0.25);
    let mut engine = engine(&bone, pose(-4.0, 0.03, 0.07));
    let steps = straight(&mut engine, pose(4.0, 0.03, 0.07), 80);
    let expected = Vector3::new(-0.265_071_9, 0.5625, -0.1125);
    for step in &steps[1..] {
        assert!((step.force.force_n - expected).norm() < 2e-3 * expected.norm(), "{:?}", step.force);
        assert!((step.mrr_mm3_s - 1.5 * PI * RADIUS_MM.powi(2)).abs() < 2e-3 * step.mrr_mm3_s);
        assert!(step.force.peak_n >= step.force.force_n.norm());
    }
    engine.settle();
    let (found, expected) = (engine.removed().total_mm3(), capsule_mm3(8.0));
    assert!((found - expected).abs() < 1.5e-3 * expected, "{found} of {expected}");
}

/// Two passes half a radius apart: the second removes the crescent that the first left, whose area is known exactly.
#[test]
fn a_second_pass_beside_the_first_meets_the_crescent_that_is_left() {
    let bone = uniform(10.0, 0.25);
    // the exact crescent of two passes half a radius apart: removal rate = v (area of the new disc less the overlap)
    let apart = 0.5 * RADIUS_MM;
    let overlap = {
        let (r, d) = (RADIUS_MM, apart);
        2.0 * r * r * (d / (2.0 * r)).acos() - 0.5 * d * (4.0 * r * r - d * d).sqrt()
    };
    let area = PI * RADIUS_MM.powi(2) - overlap;
    let mut engine = engine(&bone, pose(-5.0, 0.0, 0.0));
    straight(&mut engine, pose(5.0, 0.0, 0.0), 100);
    straight(&mut engine, pose(5.0, apart, 0.0), 10);
    let back = straight(&mut engine, pose(-5.0, apart, 0.0), 100);
    let middle: Vec<f64> = back[20..80].iter().map(|s| s.mrr_mm3_s / 1.5).collect();
    let mean = middle.iter().sum::<f64>() / middle.len() as f64;
    assert!((mean - area).abs() < 0.01 * area, "{mean} of {area}");
    let ripple = middle.iter().map(|v| (v - mean).abs()).fold(0.0, f64::max);
    assert!(ripple < 0.01 * mean, "{ripple} of {mean}");
}

#[test]
fn spindle_power_is_the_cutting_energy_of_what_is_removed() {
    let bone = block(7.0, 0.3, |p| 0.4 + 0.3 * (p.x * 1.3).sin() * (p.y * 0.9).cos());
    let mut engine = engine(&bone, pose(-4.0, 0.2, 0.1));
    let axis = Vector3::new(0.3, -0.4, 1.0);
    for n in 1..40 {
        let next = Pose::new(Point::new(-4.0 + 0.2 * n as f64, 0.2, 0.1 - 0.05 * n as f64), axis).unwrap();
        let step = engine.step(to(engine.pose(), next)).unwrap();
        let energy = 100.0 * step.weighted_mrr_mm3_s;
        assert!((step.force.spindle_power_mw - energy).abs() <= 1e-12 * energy, "{step:?}");
        assert!(energy > 0.0);
    }
}

/// The lumped model in its energy form has the burr's power; as printed it has K_t per cross-section.
#[test]
fn the_lumped_models_know_the_same_removal() {
    let bone = uniform(6.0, 0.25);
    let tool = spec().tool;
    let energy = LumpedForm::CuttingEnergy { k_n_mm2: 100.0, k_r: 0.6 };
    let printed = LumpedForm::AsPrinted { k_t_n_mm2: 0.4, k_r: 0.6 };
    let area = PI * RADIUS_MM.powi(2);
    for (form, tangential) in
        [(energy, 100.0 * 1.5 * area / (2.0 * PI * RPM / 60.0 * RADIUS_MM)), (printed, 0.4 * area)]
    {
        let model = Lumped::new(tool.clone(), form).unwrap();
        let bone = Bone::new(&bone).unwrap();
        let mut engine = Engine::new(bone, spec(), model, pose(-2.0, 0.0, 0.0)).unwrap();
        let step = engine.step(to(engine.pose(), pose(-1.0, 0.0, 0.0))).unwrap();
        // feed along x: radial −x; spin −1 pushes the burr towards +y, as the fluted burr's sum does
        let f = step.force.force_n;
        assert!((f - Vector3::new(-0.6, 1.0, 0.0) * tangential).norm() < 5e-3 * tangential, "{f}");
        assert!((step.force.torque_nmm - tangential * RADIUS_MM).abs() < 5e-3 * step.force.torque_nmm);
    }
    let negative = LumpedForm::CuttingEnergy { k_n_mm2: -1.0, k_r: 0.0 };
    assert!(Lumped::new(tool, negative).is_err());
}

#[test]
fn mass_removed_and_mass_left_are_the_whole() {
    for (h, cells) in [(0.5, 10.0), (0.25, 10.0), (0.1, 10.0), (0.1, 5.0)] {
        let bone = block(4.0, h, |p| if (p.x * 5.0).sin() > 0.3 { 0.0 } else { 1.0 + 0.3 * p.y });
        let spec = EngineSpec { cells_per_radius: cells, ..spec() };
        let model = burr(&spec);
        let bone = Bone::new(&bone).unwrap();
        let whole = bone.whole();
        let mut engine = Engine::new(bone, spec, model, pose(-3.0, -1.0, 4.0)).unwrap();
        let mut last = 0.0;
        for end in [pose(3.0, -1.0, 2.0), pose(3.0, 2.0, 2.0), pose(-3.0, 2.0, 2.0), pose(0.0, 0.0, -1.0)] {
            straight(&mut engine, end, 20);
            let (removed, left) = (engine.removed(), engine.lattice().left());
            let mass = removed.total_mg() + left.total_mg();
            assert!((mass - whole.total_mg()).abs() < 1e-12 * whole.total_mg(), "{mass}");
            let volume = removed.total_mm3() + left.total_mm3();
            assert!((volume - whole.total_mm3()).abs() < 1e-12 * whole.total_mm3());
            assert!(removed.total_mg() > last, "removal only grows");
            last = removed.total_mg();
        }
        assert!(last > 0.05 * whole.total_mg());
    }
}

#[test]
fn one_thread_and_two_give_the_same_bits() {
    let bone = block(8.0, 0.25, |p| 0.8 + 0.2 * (p.x * 2.0).sin());
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut engine = engine(&bone, pose(-5.0, -4.0, 3.0));
            let mut all = Vec::new();
            let mut at = engine.pose();
            for line in 0..4 {
                let (y, side) = (-4.0 + 1.5 * line as f64, if line % 2 == 0 { 1.0 } else { -1.0 });
                let moves: Vec<Move> = (0..=100)
                    .map(|n| {
                        let next = pose(side * (-5.0 + 0.1 * n as f64), y, 3.0);
                        let step = to(at, next);
                        at = next;
                        step
                    })
                    .collect();
                moves.chunks(64).for_each(|batch| all.extend(engine.steps(batch).unwrap()));
            }
            engine.settle();
            (all, *engine.removed(), engine.lattice().left())
        })
    };
    let (one, two) = (run(1), run(2));
    assert!(one == two);
    assert!(one.0.iter().filter(|s| s.force.force_n.norm() > 0.1).count() > 300);
}

/// Single steps and batches cut the same bone; they differ only in how much of the path is not in the lattice yet.
#[test]
fn batches_agree_with_single_steps() {
    let bone = uniform(8.0, 0.25);
    let moves: Vec<Move> = {
        let mut at = pose(-5.0, 0.0, 6.5);
        let way = (1..=240).map(|n| {
            let t = n as f64 / 240.0 * 4.0 * PI;
            let next = pose(-5.0 + 10.0 * n as f64 / 240.0, 2.0 * t.sin(), 6.5);
            let step = to(at, next);
            at = next;
            step
        });
        way.collect()
    };
    let mut single = engine(&bone, pose(-5.0, 0.0, 6.5));
    let one: Vec<Step> = moves.iter().map(|m| single.step(*m).unwrap()).collect();
    let mut batched = engine(&bone, pose(-5.0, 0.0, 6.5));
    let many: Vec<Step> = moves.chunks(64).flat_map(|b| batched.steps(b).unwrap()).collect();
    let most = one.iter().map(|s| s.force.force_n.norm()).fold(0.0, f64::max);
    let mut off = Vec::new();
    for (a, b) in one.iter().zip(&many) {
        off.push((a.force.force_n - b.force.force_n).norm() / most);
    }
    off.sort_by(f64::total_cmp);
    let [median, worst] = [off[off.len() / 2], off[off.len() - 1]];
    assert!(median < 2e-3 && worst < 1e-2, "{median} {worst}");
    single.settle();
    batched.settle();
    let (a, b) = (single.removed().total_mm3(), batched.removed().total_mm3());
    assert!((a - b).abs() < 1e-6 * a, "{a} {b}");
}

proptest! {
    #![proptest_config(bonemill_geometry::fixed!(24))]

    /// The lattice's depths are those of the nearest capsule, for any order and division into pieces.
    #[test]
    fn depths_are_the_least_distance_to_any_capsule(
        corners in prop::collection::vec(prop::array::uniform3(-3.0f64..3.0), 2..6), pieces in 1usize..5, spare in 0usize..3,
    ) {
        let bone = uniform(4.0, 0.25);
        let bone = Bone::new(&bone).unwrap();
        let mut lattice = Lattice::new(bone, 1.1, 4.0).unwrap();
        let s = lattice.spacing_mm();
        let mut path = Vec::new();
        for pair in corners.windows(2) {
            let (a, b) = (Vector3::from(pair[0]), Vector3::from(pair[1]));
            for n in 0..pieces {
                let at = |n: usize| Point::from_coords(a + (b - a) * (n as f64 / pieces as f64));
                path.push(Piece { from: at(n), to: at(n + 1), continues: !path.is_empty() });
            }
        }
        let (first, rest) = path.split_at(spare.min(path.len()));
        lattice.remove(first, 1.1);
        lattice.remove(rest, 1.1);
        let [nx, ny, nz] = lattice.cells();
        for n in 0..nx * ny * nz {
            let cell = [n % nx, n / nx % ny, n / (nx * ny)];
            let p = lattice.point(Vector3::from(cell.map(|c| c as f64))).coords;
            let nearest = corners.windows(2).map(|pair| {
                bonemill_geometry::capsule::segment_distance_squared(&p, &pair[0].into(), &pair[1].into()).sqrt()
            });
            let expected = (nearest.fold(f64::INFINITY, f64::min) - 1.1) / s;
            let found = f64::from(lattice.depth_of(cell));
            prop_assert!((found - expected.clamp(-2.0, 2.0)).abs() < 5e-5, "{cell:?}: {found} {expected}");
        }
    }
}
