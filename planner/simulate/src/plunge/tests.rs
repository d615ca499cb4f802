//! Plunges against the sum over all elements, half-spaces, second holes and swept volumes.

use bonemill_cutting::cutter::{Cutter, TwistDrill, TwistDrillSpec};
use bonemill_cutting::edge::CoefficientModel;
use bonemill_geometry::Grid;

use super::*;

const FEED_MM_REV: f64 = 0.02;

fn drill() -> TwistDrill {
    TwistDrill::new(TwistDrillSpec::FAIEGHI).unwrap()
}

fn loads(drill: &TwistDrill) -> EdgeLoads {
    let model = CoefficientModel::constant(150.0, 0.4).unwrap();
    EdgeLoads::new(&drill.edges(FEED_MM_REV, 24).unwrap(), FEED_MM_REV, 1000.0, &model)
}

fn block() -> Volume<f32, Work> {
    let grid = Grid::aligned([61, 61, 61], 0.2, Point::new(-6.0, -6.0, -12.0)).unwrap();
    Volume::filled(grid, 1.0)
}

fn spec<'c>(drill: &'c TwistDrill, loads: &'c EdgeLoads) -> PlungeSpec<'c> {
    PlungeSpec {
        solid: drill.solid(),
        loads,
        turns: 12,
        ahead_mm: FEED_MM_REV / 4.0,
        tool_from_work: Rotation3::identity(),
    }
}

fn close(a: CutterForce, b: CutterForce, share: f64) {
    assert!((a.thrust_n() - b.thrust_n()).abs() <= share * b.thrust_n().abs(), "{a:?} {b:?}");
    assert!((a.torque_nmm() - b.torque_nmm()).abs() <= share * b.torque_nmm().abs(), "{a:?} {b:?}");
}

#[test]
fn a_plunge_feels_all_its_edges_in_bone_whatever_the_steps() {
    let (drill, bone) = (drill(), block());
    let loads = loads(&drill);
    for step_mm in [0.001, 0.02, 0.3] {
        let mut engine = PlungeEngine::new(&bone, &spec(&drill, &loads), Point::new(0.0, 0.0, -3.0)).unwrap();
        let mut z = -3.0;
        for _ in 0..(if step_mm < 0.01 { 400 } else { 20 }) {
            z -= step_mm;
            let force = engine.step(Point::new(0.0, 0.0, z), |rho| rho);
            close(force, loads.all_engaged(), 1e-6);
            assert!(force.lateral_n() < 1e-6);
        }
        // back up, and down again to where it was: air
        for z in [z + 0.5, z + 0.2, z + 1e-6, z] {
            assert_eq!(engine.step(Point::new(0.0, 0.0, z), |rho| rho), CutterForce::default());
        }
        close(engine.step(Point::new(0.0, 0.0, z - step_mm), |rho| rho), loads.all_engaged(), 1e-6);
    }
}

/// Entering, elements engage one after the other; leaving, they disengage in the same order.
#[test]
fn entry_and_breakthrough_engage_element_by_element() {
    let (drill, bone) = (drill(), block());
    let loads = loads(&drill);
    let mut engine = PlungeEngine::new(&bone, &spec(&drill, &loads), Point::new(0.0, 0.0, 1.0)).unwrap();
    let mut thrusts = Vec::new();
    for n in 1..=1500 {
        let z = 1.0 - 0.01 * f64::from(n);
        let force = engine.step(Point::new(0.0, 0.0, z), |rho| rho);
        // the block's faces at z = 0 and -12; voxels fade over a spacing
        let inside = |at: Point<bonemill_geometry::Tool>| {
            let height = at.z() + z - FEED_MM_REV / 4.0;
            (1.0 - height / 0.2).clamp(0.0, 1.0) * (1.0 + (height + 12.0) / 0.2).clamp(0.0, 1.0)
        };
        let expected = loads.sum(12, |_, at| inside(at));
        assert!((force.thrust_n() - expected.thrust_n()).abs() < 1e-6 + 1e-6 * expected.thrust_n(), "{z}");
        thrusts.push(force.thrust_n());
    }
    assert!(thrusts[0] == 0.0 && thrusts[1499] == 0.0);
    let full = loads.all_engaged().thrust_n();
    assert!(thrusts.iter().filter(|t| **t > 0.999 * full).count() > 1000);
}

/// A second hole beside the first is engaged in part, and pushes the drill into the first.
#[test]
fn a_hole_beside_is_felt() {
    let (drill, bone) = (drill(), block());
    let loads = loads(&drill);
    let mut engine = PlungeEngine::new(&bone, &spec(&drill, &loads), Point::new(0.0, 0.0, 0.5)).unwrap();
    for n in 1..=80 {
        engine.step(Point::new(0.0, 0.0, 0.5 - 0.1 * f64::from(n)), |rho| rho);
    }
    engine.step(Point::new(1.25, 0.0, 0.5), |rho| rho);
    let mut force = CutterForce::default();
    for n in 1..=40 {
        force = engine.step(Point::new(1.25, 0.0, 0.5 - 0.1 * f64::from(n)), |rho| rho);
    }
    let hole = |at: Point<bonemill_geometry::Tool>| (at.x() + 1.25).hypot(at.y()) > 1.25;
    let expected = loads.sum(200, |_, at| f64::from(u8::from(hole(at))));
    close(force, expected, 0.05);
    assert!((force.force_n - expected.force_n).norm() < 0.06 * expected.force_n.norm());
}

#[test]
fn what_is_gone_is_the_swept_solid() {
    let (drill, bone) = (drill(), block());
    let loads = loads(&drill);
    let mut engine = PlungeEngine::new(&bone, &spec(&drill, &loads), Point::new(0.0, 0.0, -1.0)).unwrap();
    for n in 1..=100 {
        engine.step(Point::new(0.0, 0.0, -1.0 - 0.03 * f64::from(n)), |rho| rho);
    }
    engine.settle();
    let (holes, tip) = (engine.holes(), Vector3::new(0.0, 0.0, -4.0));
    let exact = drill.solid().swept_towards_tip(3.0);
    let (mut most, mut volume) = (0f64, 0.0);
    let h = 0.1;
    for n in 0..40 * 40 * 60usize {
        let [i, j, k] = [n % 40, n / 40 % 40, n / 1600].map(|v| v as f64);
        let p = Vector3::new(h * (i - 19.5), h * (j - 19.5), -4.5 + h * k);
        let expected = exact.signed_distance_mm(Point::from_coords(p - tip));
        let found = holes.distance_mm(&p);
        volume += (0.5 - found / h).clamp(0.0, 1.0) * h.powi(3);
        if expected.abs() < 0.15 {
            most = most.max((found - expected).abs());
        }
    }
    // corners of the profile are rounded by a third of a cell
    assert!(most < 0.35 * holes.cell_mm(), "{most}");
    let top = 5.5;
    let slices = 20_000;
    let cut = |n: usize| {
        let z = -0.5 + (top + 0.5) * (n as f64 + 0.5) / slices as f64;
        exact.radius_at_mm(z).map_or(0.0, |r| std::f64::consts::PI * r * r)
    };
    let expected: f64 = (0..slices).map(cut).sum::<f64>() * (top + 0.5) / slices as f64;
    assert!((volume / expected - 1.0).abs() < 0.02, "{volume} {expected}");
}

/// The bricks that changed, meshed one by one, are the wall of the hole: every vertex lies on the drill's swept solid or on the block's
/// faces, and a call without a change gives nothing.
#[test]
fn the_surface_of_what_changed_is_the_hole_s_wall() {
    let (drill, block) = (drill(), block());
    let loads = loads(&drill);
    let spec = spec(&drill, &loads);
    let mut engine = PlungeEngine::new(&block, &spec, Point::new(0.0, 0.0, 1.0)).unwrap();
    engine.take_touched();
    for n in 0..=400 {
        engine.step(Point::new(0.0, 0.0, 1.0 - 0.01 * f64::from(n)), |density| density);
    }
    engine.settle();
    let meshes: Vec<_> = engine.take_touched().iter().map(|samples| samples.mesh(&block, 0.5)).collect();
    let vertices: Vec<_> = meshes.iter().flat_map(|part| &part.mesh.vertices).collect();
    let cell = engine.holes().cell_mm();
    let wall = vertices.iter().filter(|p| p.z() < -0.5);
    assert!(wall.clone().count() > 500, "{}", vertices.len());
    for p in wall {
        let own = drill.solid().signed_distance_mm(Point::new(p.x(), p.y(), p.z() + 3.0));
        assert!(own.abs() < cell, "{own} mm at {p:?}");
    }
    assert!(meshes.iter().map(|part| part.mesh.triangles.len()).sum::<usize>() > 1000);
    assert!(engine.take_touched().is_empty());
    // what was taken stays as it was while the hole goes deeper
    engine.step(Point::new(0.0, 0.0, -3.2), |density| density);
    engine.settle();
    let taken = engine.take_touched();
    let meshed = || taken.iter().map(|samples| samples.mesh(&block, 0.5)).collect::<Vec<_>>();
    let before = meshed();
    engine.step(Point::new(0.0, 0.0, -4.0), |density| density);
    engine.settle();
    assert!(meshed() == before && !engine.take_touched().is_empty());
}
