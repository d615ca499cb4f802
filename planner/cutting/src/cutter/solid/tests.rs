//! Solids against closed forms, their own meshes, and moves made in many small steps.

use proptest::prelude::*;

use super::*;

fn cone() -> SolidOfRevolution {
    SolidOfRevolution::new(&[[0.0, 0.0], [1.0, 2.0], [3.0, 2.0]]).unwrap()
}

#[test]
fn volumes_and_areas_are_those_of_the_mesh_and_of_closed_forms() {
    let solid = cone();
    assert!((solid.volume_mm3() - PI * (4.0 / 3.0 + 8.0)).abs() < 1e-12);
    let mesh = solid.mesh(720);
    assert!((mesh.volume_mm3() / solid.volume_mm3() - 1.0).abs() < 2e-5);
    let ball = SolidOfRevolution::ball(2.5).unwrap();
    assert!((ball.volume_mm3() / (4.0 / 3.0 * PI * 2.5f64.powi(3)) - 1.0).abs() < 2e-4);
    assert!((ball.signed_distance_mm(Point::new(1.0, 2.0, 2.0)) - 0.5).abs() < 1e-3);
}

#[test]
fn distances_are_signed_and_steps_have_discs() {
    let solid = SolidOfRevolution::new(&[[-2.0, 1.0], [0.0, 1.0], [0.0, 3.0], [2.0, 3.0]]).unwrap();
    for (p, distance) in [
        ([0.0, 0.0, -2.5], 0.5),
        ([2.0, 0.0, -0.5], 0.5),
        ([2.0, 0.0, 0.25], -0.25),
        ([0.0, 0.0, -1.0], -1.0),
        ([0.0, 4.0, 1.0], 1.0),
        ([4.0, 0.0, 3.0], 2f64.sqrt()),
    ] {
        let [x, y, z] = p;
        assert!((solid.signed_distance_mm(Point::new(x, y, z)) - distance).abs() < 1e-12, "{p:?}");
    }
}

#[test]
fn profiles_that_are_none_are_refused_at_their_point() {
    for (profile, at) in [
        (vec![[0.0, 1.0]], 0),
        (vec![[0.0, 1.0], [1.0, -1.0]], 1),
        (vec![[0.0, 1.0], [1.0, 1.0], [0.5, 1.0]], 2),
        (vec![[0.0, f64::NAN], [1.0, 1.0]], 0),
        (vec![[0.0, 1.0], [0.0, 2.0]], 1),
        (vec![[0.0, 0.0], [1.0, 0.0]], 1),
    ] {
        let found = SolidOfRevolution::new(&profile);
        assert!(matches!(found, Err(CutterError::Profile { index, .. }) if index == at), "{found:?}");
    }
}

#[test]
fn a_plunge_sweeps_the_lower_surface_and_what_was_passed() {
    let ball = SolidOfRevolution::ball(1.0).unwrap();
    let capsule = ball.swept_towards_tip(2.0);
    assert_eq!(capsule.z_range_mm(), [-1.0, 3.0]);
    assert!((capsule.signed_distance_mm(Point::new(0.5, 0.0, 1.0)) + 0.5).abs() < 1e-12);
    assert!((capsule.volume_mm3() - ball.volume_mm3() - 2.0 * PI).abs() < 1e-9);
}

proptest! {
    /// A move passes what any of its many poses holds, and no more.
    #[test]
    fn a_sweep_is_the_union_of_its_poses(
        p in prop::array::uniform3(-5.0f64..5.0), way in prop::array::uniform3(-4.0f64..4.0),
    ) {
        let (solid, way, p) = (cone(), Vector3::from(way), Point::<Tool>::new(p[0], p[1], p[2]));
        let poses = 2000;
        let nearest = (0..=poses).map(|n| solid.signed_distance_mm(p + way * (n as f64 / poses as f64)));
        let nearest = nearest.fold(f64::INFINITY, f64::min);
        let slack = way.norm() / poses as f64;
        let passes = solid.sweep_contains(p, way);
        prop_assert!(if passes { nearest <= slack } else { nearest >= 0.0 }, "{passes} {nearest}");
    }

    /// No point is nearer to another than the distance field says, and it says the distance of the surface.
    #[test]
    fn distances_grow_by_at_most_one(
        a in prop::array::uniform3(-5.0f64..5.0), b in prop::array::uniform3(-5.0f64..5.0),
    ) {
        let (solid, a, b) = (cone(), Point::<Tool>::from_coords(a.into()), Point::<Tool>::from_coords(b.into()));
        let change = solid.signed_distance_mm(a) - solid.signed_distance_mm(b);
        prop_assert!(change.abs() <= a.distance_mm(&b) + 1e-12);
        prop_assert_eq!(solid.contains(a), solid.signed_distance_mm(a) <= 0.0);
    }
}
