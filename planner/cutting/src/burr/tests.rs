//! Tests of `burr`.

use bonemill_geometry::{Grid, Point, Volume, Work};
use nalgebra::{Rotation3, Unit, Vector3};
use proptest::prelude::*;

use super::*;

const ORIGIN: Point<Work> = Point::new(0.0, 0.0, 0.0);
const RPM: f64 = 20_000.0;

fn tool(spin: i32) -> Tool {
    Tool::new(2.5, 8, spin).unwrap()
}

fn foam() -> Material {
    Material::new([100.0, 60.0, 20.0], 0.8).unwrap()
}

fn disc(measure: Measure) -> Discretisation {
    Discretisation::new(8, 32, ElementGrid::Kappa, measure).unwrap()
}

fn motion(axis: Vector3<f64>, velocity: Vector3<f64>, rpm: f64) -> Motion<Work> {
    Motion::new(ORIGIN, axis, velocity, rpm).unwrap()
}

/// Voxels of random density about a burr of 2.5 mm, a third of them empty.
fn bone(seed: &[f64]) -> Volume<f64, Work> {
    let grid = Grid::aligned([8, 8, 8], 0.9, Point::new(-3.1, -3.2, -3.0)).unwrap();
    let mut state = seed.iter().fold(0.37, |s, v| (s + v * 12.9898).fract().abs());
    let data = (0..grid.len())
        .map(|_| {
            state = (state * 997.0 + 0.123_456_7).fract();
            (1.5 * state - 0.5).max(0.0)
        })
        .collect();
    Volume::new(grid, data).unwrap()
}

fn vector() -> impl Strategy<Value = Vector3<f64>> {
    prop::array::uniform3(-1.0f64..1.0)
        .prop_map(Vector3::from)
        .prop_filter("a direction", |v| v.norm() > 0.05)
}

fn spin() -> impl Strategy<Value = i32> {
    prop_oneof![Just(-1), Just(1)]
}

fn measures() -> impl Strategy<Value = Measure> {
    prop_oneof![Just(Measure::Dz), Just(Measure::Db)]
}

fn near(a: &Vector3<f64>, b: &Vector3<f64>, tolerance: f64) -> bool {
    (a - b).norm() <= tolerance * b.norm().max(1e-9)
}

proptest! {
    #![proptest_config(bonemill_geometry::fixed!(48))]

    #[test]
    fn cutting_is_linear_in_speed_period_and_coefficients(
        seed in prop::array::uniform3(0f64..1.0), axis in vector(), v in vector(), s in spin(), m in measures(),
        factor in 0.1f64..10.0,
    ) {
        let bone = bone(&seed);
        let force = |velocity, rpm, k: f64| {
            let material = Material::new([100.0 * k, 60.0 * k, 20.0 * k], 0.8).unwrap();
            burr_force(|p| bone.trilinear(p, 0.0), &tool(s), &material, &disc(m), &motion(axis, velocity, rpm)).force_n
        };
        let one = force(v, RPM, 1.0);
        prop_assert!(near(&force(v * factor, RPM, 1.0), &(one * factor), 1e-12));
        prop_assert!(near(&force(v, RPM * factor, 1.0), &(one / factor), 1e-12));
        prop_assert!(near(&force(v, RPM, factor), &(one * factor), 1e-12));
    }

    /// The same azimuths shared among more or fewer blades.
    #[test]
    fn cutting_does_not_depend_on_the_number_of_blades_and_edges_are_proportional(
        seed in prop::array::uniform3(0f64..1.0), axis in vector(), v in vector(), s in spin(),
    ) {
        let bone = bone(&seed);
        let force = |blades: u32| {
            let tool = Tool::new(2.5, blades, s).unwrap();
            let edge = foam().with_edge([0.2, 0.3, 0.05], 0.0).unwrap();
            let disc = Discretisation::new(64 / blades as usize, 32, ElementGrid::Kappa, Measure::Db).unwrap();
            burr_force(|p| bone.trilinear(p, 0.0), &tool, &edge, &disc, &motion(axis, v, RPM))
        };
        let (two, eight) = (force(2), force(8));
        for m in 0..3 {
            let cut = [two.basis_cut_mm2[m], eight.basis_cut_mm2[m]];
            let edge = [two.basis_edge_mm[m] * 4.0, eight.basis_edge_mm[m]];
            prop_assert!((cut[0] - cut[1]).norm() < 1e-12 * cut[1].norm().max(1e-6));
            prop_assert!((edge[0] - edge[1]).norm() < 1e-11 * edge[1].norm().max(1e-3));
        }
    }

    /// db: the spindle's power is K_t times the weighted removal rate, node by node.
    #[test]
    fn db_conserves_energy(
        seed in prop::array::uniform3(0f64..1.0), axis in vector(), v in vector(), s in spin(), helix in -0.7f64..0.7,
        neck in 0.0f64..2.0,
    ) {
        let bone = bone(&seed);
        let tool = tool(s).with_helix(helix).unwrap().with_neck(neck).unwrap();
        let f = burr_force(|p| bone.trilinear(p, 0.0), &tool, &foam(), &disc(Measure::Db), &motion(axis, v, RPM));
        let expected = 100.0 * f.weighted_mrr_mm3_s;
        prop_assert!((f.spindle_power_mw - expected).abs() <= 1e-12 * expected);
    }

    /// Turn the bone, the shaft and the feed together: the force turns, to the error of the nodes.
    #[test]
    fn the_force_turns_with_the_scene(
        axis in vector(), v in vector(), turn in vector(), s in spin(), m in measures(), normal in vector(),
    ) {
        let turn = Rotation3::new(turn * 3.0);
        let n = normal.normalize();
        let fade = |d: f64| (0.8 * (0.5 - d)).clamp(0.0, 0.8);
        let fine = Discretisation::new(32, 128, ElementGrid::Kappa, m).unwrap();
        let here = burr_force(|p: Point<Work>| fade(n.dot(&p.coords)), &tool(s), &foam(), &fine, &motion(axis, v, RPM));
        let there = burr_force(
            |p: Point<Work>| fade((turn * n).dot(&p.coords)), &tool(s), &foam(), &fine,
            &motion(turn * axis, turn * v, RPM),
        );
        // two node sets that share nothing but the integral; a sliver of bone, below a twentieth of a slot, takes finer ones
        prop_assume!(here.force_n.norm() > 0.02 * v.norm());
        prop_assert!(near(&(turn * here.force_n), &there.force_n, 3e-3));
        prop_assert!((here.torque_nmm - there.torque_nmm).abs() < 3e-3 * here.torque_nmm);
    }

    /// A mirror that holds the feed and the shaft swaps the spins and mirrors the force.
    #[test]
    fn the_other_spin_is_the_mirror_image(seed in prop::array::uniform3(0f64..1.0), x in -1f64..1.0, z in -1f64..1.0) {
        prop_assume!(x.hypot(z) > 0.05);
        let bone = bone(&seed);
        let mirror = |v: Vector3<f64>| Vector3::new(v.x, -v.y, v.z);
        let at = |s, mirrored: bool| {
            let density = |p: Point<Work>| {
                bone.trilinear(if mirrored { Point::from_coords(mirror(p.coords)) } else { p }, 0.0)
            };
            burr_force(density, &tool(s), &foam(), &disc(Measure::Db), &motion(Vector3::z(), Vector3::new(x, 0.0, z), RPM))
        };
        let (a, b) = (at(-1, false), at(1, true));
        prop_assert!(near(&mirror(a.force_n), &b.force_n, 1e-11));
        prop_assert!((a.torque_nmm - b.torque_nmm).abs() < 1e-11 * a.torque_nmm);
    }

    #[test]
    fn the_kernel_is_the_sum(
        seed in prop::array::uniform3(0f64..1.0), axis in vector(), v in vector(), s in spin(), m in measures(),
        helix in -0.7f64..0.7, offset in 0.0f64..0.3, t0 in prop_oneof![Just(0.0), 1e-5f64..1e-3],
    ) {
        let bone = bone(&seed);
        let tool = tool(s).with_helix(helix).unwrap().with_kappa(0.1, 2.7).unwrap();
        let material = foam().with_edge([0.2, 0.3, 0.05], t0).unwrap().with_density_law(1.7, 0.05).unwrap();
        let disc = disc(m).with_sample_offset(offset).unwrap();
        let literal = burr_force(|p| bone.trilinear(p, 0.0), &tool, &material, &disc, &motion(axis, v, RPM));
        let kernel = ForceKernel::new(&tool, &material, &disc);
        let weight =
            |n: &Vector3<f64>| material.weight(bone.trilinear(ORIGIN + n * kernel.sample_radius_mm(), 0.0));
        let (axis, feed) = (Unit::new_normalize(axis), Unit::new_normalize(v));
        let fast = kernel.engaged_force(&axis, &Feed::new(&feed, v.norm(), RPM), &mut AtPoints(weight));
        prop_assert!(near(&fast.force_n(v.norm()), &literal.force_n, 1e-12));
        prop_assert!((fast.torque_nmm(v.norm()) - literal.torque_nmm).abs() <= 1e-12 * literal.torque_nmm);
    }
}

#[test]
fn at_rest_and_in_air_nothing_happens() {
    let edge = foam().with_edge([0.2, 0.3, 0.05], 0.0).unwrap();
    let at = |rho: f64, v: Vector3<f64>| {
        burr_force(|_| rho, &tool(-1), &edge, &Discretisation::default(), &motion(Vector3::z(), v, RPM))
    };
    for f in [at(0.8, Vector3::zeros()), at(0.0, Vector3::x()), at(-1.0, Vector3::x())] {
        assert_eq!((f.force_n, f.moment_nmm, f.torque_nmm), (Vector3::zeros(), Vector3::zeros(), 0.0));
        assert_eq!((f.mrr_mm3_s, f.contact_area_mm2, f.t_max_mm, f.peak_force_n), (0.0, 0.0, 0.0, 0.0));
    }
}

/// Closed forms of uniform bone for a plunge, both measures and spins: no side force, resisting torque.
#[test]
fn a_plunge_pushes_straight_back() {
    for s in [-1, 1] {
        for (measure, fz, torque) in [(Measure::Dz, 0.15, 0.9375), (Measure::Db, 0.417_643_8, 1.40625)] {
            let fine = Discretisation::new(16, 512, ElementGrid::Kappa, measure).unwrap();
            let v = Vector3::new(0.0, 0.0, -1.5);
            let f = burr_force(|_: Point<Work>| 0.8, &tool(s), &foam(), &fine, &motion(Vector3::z(), v, RPM));
            assert!(f.force_n.xy().norm() < 1e-14);
            assert!((f.force_n.z / fz - 1.0).abs() < 1e-4, "{}", f.force_n.z);
            assert!((f.torque_nmm / torque - 1.0).abs() < 1e-4);
        }
    }
}

#[test]
fn every_axis_has_a_frame() {
    for axis in [-Vector3::z(), Vector3::z() * 1e-200, Vector3::x() * 1e200, Vector3::new(1e-9, 0.0, -1.0)] {
        let f = burr_force(
            |_: Point<Work>| 0.8,
            &tool(-1),
            &foam(),
            &Discretisation::default(),
            &motion(axis, Vector3::y(), RPM),
        );
        assert!(f.force_n.norm() > 0.1 && f.force_n.iter().all(|c| c.is_finite()));
    }
}

#[test]
fn bad_input_is_refused_by_name() {
    let nan = f64::NAN;
    assert!(
        Tool::new(0.0, 8, -1).is_err() && Tool::new(2500.0, 8, -1).is_err() && Tool::new(nan, 8, 1).is_err()
    );
    assert!(Tool::new(2.5, 0, -1).is_err() && Tool::new(2.5, 8, 0).is_err() && Tool::new(2.5, 8, 2).is_err());
    assert!(tool(1).with_neck(2.5).is_err() && tool(1).with_kappa(1.0, 1.0).is_err());
    assert!(tool(1).with_kappa(0.0, 3.2).is_err() && tool(1).with_helix(1.5).is_err());
    assert!(Material::new([1.0, -1.0, 0.0], 0.8).is_err() && Material::new([1.0; 3], 0.0).is_err());
    assert!(foam().with_edge([nan, 0.0, 0.0], 0.0).is_err() && foam().with_edge([0.0; 3], -1.0).is_err());
    assert!(foam().with_density_law(-1.0, 0.0).is_err() && foam().with_density_law(1.0, -0.1).is_err());
    assert!(Discretisation::new(0, 64, ElementGrid::Z, Measure::Dz).is_err());
    assert!(Discretisation::default().with_sample_offset(nan).is_err());
    let refused = |axis, v, rpm| Motion::new(ORIGIN, axis, v, rpm).unwrap_err().to_string();
    assert!(refused(Vector3::zeros(), Vector3::x(), RPM).contains("shaft axis = (0, 0, 0)"));
    assert!(refused(Vector3::new(nan, 0.0, 1.0), Vector3::x(), RPM).contains("shaft axis"));
    assert!(refused(Vector3::z(), Vector3::x() * nan, RPM).contains("velocity"));
    assert!(refused(Vector3::z(), Vector3::x(), 0.0).contains("rpm"));
}
