//! Tests of the force along a path in bone that is the same everywhere.

use bonemill_case::{MaterialSpec, Measure};

use super::super::moves::Executed;
use super::*;

const RADIUS_MM: f64 = 2.5;

fn burr() -> Burr {
    Burr {
        radius_mm: RADIUS_MM,
        flutes: 8,
        spindle_rpm: 20_000.0,
        spin: -1,
        turns_both_ways: false,
        neck_radius_mm: 0.0,
    }
}

fn sum() -> BurrSum {
    let material = MaterialSpec {
        k_n_mm2: [100.0, 60.0, 20.0],
        k_edge_n_mm: [0.0; 3],
        rho_ref_g_cm3: 1.0,
        exponent: 1.0,
        measure: Measure::Db,
        t0_mm: 0.0,
    };
    BurrSum::new(&burr(), &material, NODES)
}

/// Rows along a polyline, 0.01 mm and 0.01 s apart.
fn rows(corners: &[[f64; 3]]) -> (Executed, Vec<f64>) {
    let corners: Vec<Vector3<f64>> = corners.iter().map(|p| Vector3::from(*p)).collect();
    let mut points: Vec<_> = corners.first().copied().into_iter().collect();
    for pair in corners.windows(2) {
        let count = ((pair[1] - pair[0]).norm() / 0.01).ceil().max(1.0);
        points.extend((1..=count as usize).map(|n| pair[0].lerp(&pair[1], n as f64 / count)));
    }
    let time_s = (0..points.len()).map(|n| n as f64 * 0.01).collect();
    let count = points.len();
    (Executed { points, axes: vec![Vector3::z(); count], next: vec![0; count] }, time_s)
}

/// Torque per speed at the end of every step, N mm/(mm/s), along a path in bone that is everywhere.
fn torques(corners: &[[f64; 3]], read: impl Fn(&DrivenPath, &DrivenForce)) {
    let (executed, time_s) = rows(corners);
    let path = DrivenPath::new(&executed, &time_s);
    let space = swept_box(&path, [Vector3::repeat(-50.0), Vector3::repeat(50.0)], RADIUS_MM);
    let force = DrivenForce::along(&path, &executed.axes, (&sum(), &burr()), space, |_| 1.0);
    read(&path, &force);
}

/// 60 r/n times K_t r/2, the torque per speed of a full slot and of a plunge.
const FULL: f64 = 60.0 * RADIUS_MM / 20_000.0 * 100.0 * RADIUS_MM / 2.0;

/// Down to a corner and on along x; then up and back, and down to the same corner again. `skin_mm`: how far the first visit stays from the
/// corner.
fn visited_twice(skin_mm: f64) -> Vec<[f64; 3]> {
    let radius = skin_mm / (2f64.sqrt() - 1.0);
    let mut corners = vec![[0.0, 0.0, 6.0]];
    corners.extend((0..=20).map(|n| {
        let (s, c) = (f64::from(n) / 20.0 * std::f64::consts::FRAC_PI_2).sin_cos();
        [radius - radius * c, 0.0, radius - radius * s]
    }));
    corners.extend([[6.0, 0.0, 0.0], [6.0, 0.0, 12.0], [0.0, 0.0, 12.0], [0.0, 0.0, 0.0]]);
    corners
}

#[test]
fn a_slot_through_bone_is_the_closed_form_all_the_way() {
    torques(&[[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [8.0, 0.3, 0.0]], |path, force| {
        assert_eq!(force.instants.len(), path.steps.len());
        for instant in &force.instants {
            let off = instant.end.torque_nmm(1.0) / FULL - 1.0;
            assert!(off.abs() < 0.01, "{off} at {}", instant.step.center);
        }
    });
}

#[test]
fn the_same_way_again_cuts_nothing() {
    torques(&[[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 0.0, 0.0]], |path, force| {
        let back = |instant: &&Instant| instant.step.direction.x < 0.0;
        let most = force.instants.iter().filter(back).map(|i| i.end.torque_nmm(1.0)).fold(0.0, f64::max);
        assert!(most < 1e-3 * FULL && path.steps.len() > 150, "{most}");
    });
}

#[test]
fn the_skin_at_a_rounded_corner_gives_force_however_thin_it_is() {
    let at_the_end = |skin_mm: f64| {
        let found = std::cell::Cell::new((0.0, 0.0));
        torques(&visited_twice(skin_mm), |path, force| {
            let end = path.steps[path.steps.len() - 1];
            let last = force.instants.iter().rfind(|i| i.step.center == end.center);
            let before = force
                .instants
                .iter()
                .filter(|i| i.step.direction.z < -0.99 && i.step.piece == end.piece && i.step.center.z > 0.1);
            let before = before.map(|i| i.end.torque_nmm(1.0)).fold(0.0, f64::max);
            found.set((last.map_or(0.0, |i| i.end.torque_nmm(1.0)), before));
        });
        found.get()
    };
    // the quarter of the ball that looks down and away from the slot cuts: half of a plunge
    for skin_mm in [0.025, 0.01, 0.005] {
        let (end, before) = at_the_end(skin_mm);
        assert!((end / (0.5 * FULL) - 1.0).abs() < 0.05, "{skin_mm}: {end} of {FULL}");
        assert!(before < 1e-3 * FULL, "{skin_mm}: {before}");
    }
    let (end, _) = at_the_end(0.0);
    assert!(end < 0.02 * FULL, "{end} of {FULL}");
}

#[test]
fn the_mean_over_a_plunge_is_that_of_the_volume_that_it_removes() {
    let depth_mm = 0.3;
    let (executed, time_s) = rows(&[[0.0, 0.0, RADIUS_MM], [0.0, 0.0, RADIUS_MM - depth_mm]]);
    let path = DrivenPath::new(&executed, &time_s);
    let space = swept_box(&path, [Vector3::repeat(-50.0), Vector3::repeat(50.0)], RADIUS_MM);
    let in_bone = |p: Point<Work>| f64::from(u8::from(p.z() < 0.0));
    let force = DrivenForce::along(&path, &executed.axes, (&sum(), &burr()), space, in_bone);
    let way = |i: &Instant| i.step.took_s * i.step.mean_mm_s;
    let mean_mm: f64 = force.instants.iter().map(|i| way(i) * i.mean.torque_nmm(1.0) / FULL).sum();
    // a cap of the ball over its cross-section
    let cap_mm = depth_mm.powi(2) * (RADIUS_MM - depth_mm / 3.0) / RADIUS_MM.powi(2);
    assert!(path.steps.len() < 8 && (mean_mm / cap_mm - 1.0).abs() < 0.06, "{mean_mm}, {cap_mm}");
}
