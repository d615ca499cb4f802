//! Tests of the sum against the closed forms of docs/force-model.md 6, and of one reference case to the last digits.

use bonemill_geometry::{Ct, Grid, Point, Volume};

use super::*;

const FEED: Vector3<f64> = Vector3::new(1.0, 0.0, 0.0);
const PLUNGE: Vector3<f64> = Vector3::new(0.0, 0.0, -1.0);
const SPEED_MM_S: f64 = 1.5;

fn burr() -> Burr {
    Burr {
        radius_mm: 2.5,
        flutes: 8,
        spindle_rpm: 20_000.0,
        spin: -1,
        turns_both_ways: false,
        neck_radius_mm: 0.0,
    }
}

fn foam(measure: Measure) -> MaterialSpec {
    MaterialSpec {
        k_n_mm2: [100.0, 60.0, 20.0],
        k_edge_n_mm: [0.0; 3],
        rho_ref_g_cm3: 0.8,
        exponent: 1.0,
        measure,
        t0_mm: 0.0,
    }
}

/// Force, N, and torque, N mm, with the shaft along z in bone that `is_bone` tells by the normal.
fn found(
    material: MaterialSpec,
    feed: &Vector3<f64>,
    is_bone: fn(&Vector3<f64>) -> bool,
) -> (Vector3<f64>, f64) {
    let sum = BurrSum::new(&burr(), &material, [96, 192]);
    let engaged =
        sum.engaged(&Vector3::z(), feed, SPEED_MM_S, |n, _| if is_bone(n) { sum.weight(0.8) } else { 0.0 });
    (engaged.force_n(SPEED_MM_S), engaged.torque_nmm(SPEED_MM_S))
}

fn is_near(found: (Vector3<f64>, f64), force_n: [f64; 3], torque_nmm: f64) {
    let off = (found.0 - Vector3::from(force_n)).norm();
    assert!(off < 1e-3 * found.0.norm(), "{found:?} {force_n:?}");
    assert!((found.1 - torque_nmm).abs() < 1e-3 * torque_nmm, "{found:?} {torque_nmm}");
}

#[test]
fn a_full_slot_and_a_plunge_are_the_closed_forms() {
    let all = |_: &Vector3<f64>| true;
    is_near(found(foam(Measure::Dz), &FEED, all), [-0.225, 0.441_786_5, -0.095_493_0], 1.193_662_1);
    is_near(found(foam(Measure::Db), &FEED, all), [-0.265_071_9, 0.5625, -0.1125], 1.406_25);
    is_near(found(foam(Measure::Dz), &PLUNGE, all), [0.0, 0.0, 0.15], 0.9375);
    is_near(found(foam(Measure::Db), &PLUNGE, all), [0.0, 0.0, 0.417_643_8], 1.406_25);
}

#[test]
fn half_a_slot_is_the_closed_form() {
    let c = 60.0 * SPEED_MM_S * 2.5 / 20_000.0 / (2.0 * PI);
    for (measure, i2, i3) in [(Measure::Dz, PI / 2.0, 4.0 / 3.0), (Measure::Db, 2.0, PI / 2.0)] {
        // bone at y below 0, spin -1
        let force_n =
            [100.0 * i2 / 2.0 - 60.0 * PI * i3 / 4.0, 100.0 * PI * i2 / 4.0 + 60.0 * i3 / 2.0, -20.0 * i3];
        let half = found(foam(measure), &FEED, |n| n.y < 0.0);
        is_near(half, force_n.map(|f| f * c), 100.0 * c * 2.5 * i3);
    }
}

#[test]
fn edges_push_whatever_the_speed_and_less_on_thin_chips() {
    let edge = MaterialSpec { k_n_mm2: [0.0; 3], k_edge_n_mm: [0.04, 0.06, 0.01], ..foam(Measure::Db) };
    let all = |_: &Vector3<f64>| true;
    let r8 = 8.0 * 2.5;
    is_near(found(edge, &FEED, all), [-2.0 * 0.06 / PI * r8, 0.04 * r8, -0.01 * r8], 0.04 * r8 * 2.5);
    let faded = found(MaterialSpec { t0_mm: 1e-3, ..edge }, &FEED, all);
    assert!(faded.1 > 0.0 && faded.1 < 0.5 * 0.04 * r8 * 2.5, "{faded:?}");
}

#[test]
fn a_neck_does_not_cut() {
    let engaged = |neck_radius_mm| {
        let sum = BurrSum::new(&Burr { neck_radius_mm, ..burr() }, &foam(Measure::Db), [48, 96]);
        sum.engaged(&Vector3::z(), &Vector3::z(), SPEED_MM_S, |n, _| {
            assert!(n.z <= (1.0 - (neck_radius_mm / 2.5_f64).powi(2)).sqrt() + 1e-12);
            1.0
        })
    };
    assert!(engaged(1.0).torque_nmm(1.0) < engaged(0.0).torque_nmm(1.0));
}

/// v07_halfspace_tilt_shaft_db of the reference cases: a half-space that fades over a voxel, the shaft tilted by 35°, 64 by 128 nodes.
#[test]
fn a_reference_case_comes_out_to_ten_digits() {
    let grid = Grid::<Ct>::aligned(
        [40; 3],
        0.4,
        Point::new(-7.670_000_000_000_001, -7.870_000_000_000_001, -7.590_000_000_000_001),
    )
    .unwrap();
    let density = |n| 0.8 * (0.5 + (-1.0 - grid.center(grid.voxel(n)).coords.z) / 0.4).clamp(0.0, 1.0);
    let field = Volume::new(grid.clone(), (0..grid.len()).map(density).collect()).unwrap();
    let sum = BurrSum::new(&burr(), &foam(Measure::Db), [64, 128]);
    let axis = Vector3::new(0.0, -0.573_576_436_351_046, 0.819_152_044_288_991_8);
    let engaged = sum.engaged(&axis, &FEED, SPEED_MM_S, |n, _| {
        sum.weight(field.trilinear(Point::from_coords(n * 2.5), 0.0))
    });
    let expected =
        Vector3::new(-0.018_073_881_586_017_453, 0.134_564_770_620_263_45, 0.152_615_129_178_234_75);
    let off = (engaged.force_n(SPEED_MM_S) - expected).norm() / expected.norm();
    assert!(off < 1e-10, "{off}");
    assert!((engaged.torque_nmm(SPEED_MM_S) - 0.355_424_846_797_465_05).abs() < 1e-10);
}
