//! Poses and bones that are difficult for simulators.

use super::*;

/// Density 0.8 below z = 0, nothing above.
fn floor(h_mm: f64) -> Volume<f32, Work> {
    block(8.0, h_mm, |p| if p.z < 0.0 { 0.8 } else { 0.0 })
}

/// A full slot's force, N.
const FULL_N: f64 = 0.632;

/// A snapshot that two equal states share.
fn state(engine: &Engine<'_, f32, FlutedBurr>) -> (Amount, Amount, Pose) {
    (*engine.removed(), engine.lattice().left(), engine.pose())
}

#[test]
fn grazing_contact_is_small_and_grows_smoothly_with_depth() {
    let bone = floor(0.25);
    let mut last = 0.0;
    for depth in [-0.3, 0.0, 0.01, 0.05, 0.1, 0.2, 0.4] {
        let z = RADIUS_MM - depth;
        let mut engine = engine(&bone, pose(-4.0, 0.0, z));
        let steps = straight(&mut engine, pose(4.0, 0.0, z), 80);
        let force = steps[40].force.force_n.norm();
        assert!(force.is_finite() && force >= last, "{depth}: {force} after {last}");
        last = force;
        if depth < -0.25 {
            assert_eq!(force, 0.0, "a voxel above the bone");
        }
        // along the path the force varies little where it is not tiny
        let middle: Vec<f64> = steps[20..60].iter().map(|s| s.force.force_n.norm()).collect();
        let mean = middle.iter().sum::<f64>() / 40.0;
        let ripple = middle.iter().map(|f| (f - mean).abs()).fold(0.0, f64::max);
        assert!(depth < 0.2 || ripple < 0.03 * mean, "{depth}: {ripple} of {mean}");
    }
    assert!(last > 0.01);
}

#[test]
fn leaving_and_coming_back_finds_nothing_left() {
    let bone = uniform(6.0, 0.25);
    let mut engine = engine(&bone, pose(0.0, 0.0, 12.0));
    straight(&mut engine, pose(0.0, 0.0, 0.0), 60);
    let out = straight(&mut engine, pose(0.0, 0.0, 12.0), 60);
    let back = straight(&mut engine, pose(0.0, 0.0, 0.0), 60);
    for step in out.iter().chain(&back) {
        assert!(step.force.force_n.norm() < 2e-3 * FULL_N, "{:?}", step.force);
    }
    engine.settle();
    // a ball that moves in from the top face
    let expected = PI * RADIUS_MM.powi(2) * 6.0 + 2.0 / 3.0 * PI * RADIUS_MM.powi(3);
    assert!((engine.removed().total_mm3() - expected).abs() < 2e-3 * expected);
}

#[test]
fn exactly_tangent_faces() {
    // two slots that touch along a line, and a pass on top of a face at exactly one radius
    let bone = uniform(9.0, 0.25);
    let mut engine = engine(&bone, pose(-4.0, -RADIUS_MM, 0.0));
    straight(&mut engine, pose(4.0, -RADIUS_MM, 0.0), 40);
    engine.settle();
    let first = engine.removed().total_mm3();
    straight(&mut engine, pose(4.0, RADIUS_MM, 0.0), 1);
    let second = straight(&mut engine, pose(-4.0, RADIUS_MM, 0.0), 40);
    let full = 1.5 * PI * RADIUS_MM.powi(2);
    for step in &second[30..] {
        assert!((step.mrr_mm3_s - full).abs() < 0.01 * full, "{} of {full}", step.mrr_mm3_s);
    }
    engine.settle();
    assert!(engine.removed().total_mm3() > 1.9 * first);
    // the block's face lies at z = 9; voxel centres end half a voxel below
    let mut above = super::engine(&bone, pose(-4.0, 0.0, 9.0 + RADIUS_MM));
    let steps = straight(&mut above, pose(4.0, 0.0, 9.0 + RADIUS_MM), 40);
    // there the density has faded by half
    assert!(steps.iter().all(|s| s.force.force_n.norm() < 0.02 * FULL_N));
    above.settle();
    assert!(above.removed().total_mm3() < 1e-3);
}

#[test]
fn walls_thinner_than_a_voxel_count_with_the_mass_that_they_have() {
    // sheets 0.1 mm thick every millimetre, as partial volume of 0.25 mm voxels
    let bone = block(6.0, 0.25, |p| {
        let across = (p.x.rem_euclid(1.0) - 0.5).abs();
        2.0 * ((0.05 + 0.125 - across) / 0.25).clamp(0.0, 0.4)
    });
    let mut engine = engine(&bone, pose(-8.6, 0.0, 0.0));
    let steps = straight(&mut engine, pose(8.6, 0.0, 0.0), 172);
    engine.settle();
    let whole = Bone::new(&bone).unwrap().whole();
    let tube = PI * RADIUS_MM.powi(2) / 144.0;
    let share = engine.removed().total_mg() / whole.total_mg();
    assert!((share - tube).abs() < 0.01 * tube, "{share} of {tube}");
    // the removal by the surface's rates equals the cells' loss
    let by_surface: f64 = steps.iter().map(|s| s.removed.total_mg()).sum();
    assert!((by_surface / engine.removed().total_mg() - 1.0).abs() < 0.01, "{by_surface}");
    assert!(steps.iter().all(|s| s.force.force_n.norm().is_finite()));
}

#[test]
fn one_long_step_removes_what_many_short_ones_do() {
    let bone = uniform(10.0, 0.25);
    let run = |count| {
        let mut engine = engine(&bone, pose(-7.0, 0.3, -0.4));
        let last = straight(&mut engine, pose(7.0, -0.8, 1.3), count).pop().unwrap();
        engine.settle();
        (engine.removed().total_mm3(), last)
    };
    let (one, far) = run(1);
    for count in [2, 7, 100, 3000] {
        let (many, near) = run(count);
        assert!((one - many).abs() < 1e-6 * one, "{count} steps: {many}, one: {one}");
        // in solid bone the force at the end is that of a full slot, too
        let off = (far.force.force_n - near.force.force_n).norm();
        assert!(off < 2e-3 * far.force.force_n.norm(), "{count}: {off}");
    }
}

#[test]
fn standing_reversing_and_turning_cut_nothing() {
    let bone = uniform(6.0, 0.25);
    let mut engine = engine(&bone, pose(-3.0, 0.0, 0.0));
    straight(&mut engine, pose(2.0, 0.0, 0.0), 37);
    let before = state(&engine);
    let here = engine.pose();
    for seconds in [0.0, 1e-3, 1.0] {
        let step = engine.step(Move::straight(here, seconds)).unwrap();
        assert_eq!((step.force, step.mrr_mm3_s), (CutForce::default(), 0.0));
    }
    assert_eq!(state(&engine), before);
    // pure rotation, also by half a turn
    for axis in [Vector3::x(), Vector3::new(0.3, 0.2, -1.0), Vector3::z()] {
        let to = Pose::new(here.center, axis).unwrap();
        assert_eq!(engine.step(Move::straight(to, 0.1)).unwrap().force, CutForce::default());
    }
    assert_eq!(state(&engine), before);
    // straight back
    let back = straight(&mut engine, pose(-3.0, 0.0, 0.0), 50);
    assert!(back.iter().all(|s| s.force.force_n.norm() < 2e-3 * FULL_N));
    engine.settle();
    let [now, then] = [engine.removed().total_mm3(), capsule_mm3(5.0)];
    assert!((now - then).abs() < 2e-3 * then, "{now} of {then}");
}

#[test]
fn a_million_steps_in_place_change_nothing_and_keep_nothing() {
    let bone = uniform(6.0, 0.5);
    let mut engine = engine(&bone, pose(0.0, 0.0, 4.0));
    straight(&mut engine, pose(0.0, 0.0, 2.0), 10);
    let (before, here) = (state(&engine), engine.pose());
    let memory = engine.lattice().stored_bricks();
    for _ in 0..1_000_000 {
        engine.step(Move::straight(here, 1e-3)).unwrap();
    }
    assert_eq!(state(&engine), before);
    assert_eq!(engine.lattice().stored_bricks(), memory);
}

/// A trembling hand: micrometres to and fro, thousands of times. Removal stays within the trail's tolerance.
#[test]
fn trembling_in_place_does_not_drill() {
    let bone = uniform(5.0, 0.25);
    let mut engine = engine(&bone, pose(0.0, 0.0, 1.0));
    engine.settle();
    let before = engine.removed().total_mm3();
    for n in 0..20_000 {
        let t = n as f64;
        let center = Point::new(2e-3 * (t * 1.7).sin(), 2e-3 * (t * 2.3).cos(), 1.0 + 1e-3 * (t * 0.7).sin());
        let to = Pose { center, axis: engine.pose().axis };
        engine.step(Move::straight(to, 1e-3)).unwrap();
    }
    engine.settle();
    let (after, r) = (engine.removed().total_mm3(), RADIUS_MM);
    // the ball grown by the amplitude
    let most = 4.0 / 3.0 * PI * ((r + 4e-3).powi(3) - r.powi(3));
    assert!(after - before < most, "{} of {most}", after - before);
}

#[test]
fn no_bone_and_the_densest_bone() {
    for (density, expected) in [(0.0, 0.0), (3.0, 3.0 / 0.8)] {
        let bone = block(6.0, 0.25, |_| density);
        let mut engine = engine(&bone, pose(-2.0, 0.0, 0.0));
        let step = straight(&mut engine, pose(2.0, 0.0, 0.0), 40).pop().unwrap();
        let full = Vector3::new(-0.265_071_9, 0.5625, -0.1125) * expected;
        assert!((step.force.force_n - full).norm() <= 3e-3 * full.norm(), "{:?}", step.force);
        engine.settle();
        let mass = engine.removed().total_mg();
        assert!((mass - density * capsule_mm3(4.0)).abs() <= 2e-3 * mass, "{mass}");
    }
}

#[test]
fn outside_the_grid_is_air() {
    let bone = uniform(3.0, 0.25);
    let mut engine = engine(&bone, pose(40.0, -90.0, 500.0));
    let far = engine.step(to(engine.pose(), pose(-800.0, 3e4, 2.0))).unwrap();
    assert_eq!(far.force, CutForce::default());
    // straight through the block, in and out again in one step
    engine.step(to(engine.pose(), pose(-50.0, 0.0, 0.0))).unwrap();
    engine.settle();
    let before = engine.removed().total_mm3();
    let through = engine.step(to(engine.pose(), pose(50.0, 0.0, 0.0))).unwrap();
    assert_eq!(through.force, CutForce::default());
    engine.settle();
    let tube = PI * RADIUS_MM.powi(2) * 6.0;
    assert!((engine.removed().total_mm3() - before - tube).abs() < 2e-3 * tube);
}

#[test]
fn what_is_no_pose_or_no_time_is_refused_and_changes_nothing() {
    let bone = uniform(4.0, 0.25);
    let mut engine = engine(&bone, pose(0.0, 0.0, 3.0));
    straight(&mut engine, pose(0.0, 0.0, 1.0), 20);
    let before = state(&engine);
    for bad in [f64::NAN, f64::INFINITY, 1e9] {
        assert!(Pose::new(Point::new(bad, 0.0, 0.0), Vector3::z()).is_err());
        let to = Pose { center: Point::new(0.0, bad, 0.0), axis: before.2.axis };
        assert!(matches!(engine.step(Move::straight(to, 0.1)), Err(EngineError::Pose { .. })));
        let good = Move::straight(pose(0.0, 0.0, 0.5), 0.1);
        assert!(engine.steps(&[good, Move::straight(to, 0.1)]).is_err());
    }
    for axis in [Vector3::zeros(), Vector3::new(f64::NAN, 0.0, 1.0)] {
        assert!(Pose::new(Point::new(0.0, 0.0, 0.0), axis).is_err());
    }
    for seconds in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(engine.step(Move::straight(pose(0.0, 0.0, 0.5), seconds)).is_err(), "{seconds} s");
    }
    assert_eq!(state(&engine), before);
}

#[test]
fn what_is_no_bone_is_refused() {
    let oblique = {
        let turn = nalgebra::Rotation3::new(Vector3::new(0.1, 0.0, 0.0)).into_inner();
        let grid = Grid::<Work>::new([4; 3], Vector3::repeat(1.0), turn, Vector3::zeros()).unwrap();
        Volume::filled(grid, 1f32)
    };
    assert!(matches!(Bone::new(&oblique), Err(EngineError::Grid { .. })));
    let flat = Grid::<Work>::new(
        [4; 3],
        Vector3::new(1.0, 1.0, 2.0),
        nalgebra::Matrix3::identity(),
        Vector3::zeros(),
    );
    assert!(Bone::new(&Volume::filled(flat.unwrap(), 1f32)).is_err());
    let bone = uniform(4.0, 0.25);
    let other = uniform(4.0, 0.5).map(|_| bonemill_toolpath::scene::Class(1));
    assert!(matches!(Bone::new(&bone).unwrap().with_classes(&other), Err(EngineError::Classes { .. })));
    let tiny = Lattice::new(Bone::new(&bone).unwrap(), 1e-3, 1000.0);
    assert!(matches!(tiny, Err(EngineError::TooFine { .. })), "{:?}", tiny.map(|l| l.spacing_mm()));
}
