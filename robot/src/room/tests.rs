//! Distances are bounds: no sampled distance, at a posture or on the way between two, is below what is said.

use super::*;
use crate::resolve::{PosePath, Posture, ReachReason, RollFrame, resolve};
use bonemill_arm::ToolMount;
use bonemill_arm::arm::AxisPose;
use bonemill_arm::ur::UrModel;
use bonemill_geometry::{Capsule, Ct, Grid, Rigid, Volume};
use nalgebra::{Matrix3, Rotation3, Vector3};
use std::f64::consts::PI;

/// Numbers in 0..1, the same each time.
fn stream(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    }
}

fn arm() -> Arm {
    arm_of(UrModel::Ur5e)
}

fn arm_of(model: UrModel) -> Arm {
    let mount = Rigid::new(Rotation3::from_euler_angles(PI, 0.0, 0.0), Vector3::new(0.0, 0.0, 180.0));
    Arm::ur(model, None).unwrap().with_mount(ToolMount { flange_from_burr: mount })
}

fn handpiece() -> Handpiece {
    vec![Capsule::new([0.0, 0.0, 27.5], [0.0, 0.0, 180.0], 6.0)]
}

fn obstacle(name: &str, shape: Shape) -> Obstacle {
    Obstacle { name: name.into(), shape }
}

/// A table, a lamp, a ball and a rod around the arm.
fn obstacles() -> Vec<Obstacle> {
    let turn = Rotation3::from_euler_angles(0.1, -0.2, 0.7);
    let block = Rigid::<Base, Base>::new(turn, Vector3::new(450.0, 100.0, -80.0));
    let ball = Point::new(-300.0, -350.0, 500.0);
    vec![
        obstacle(
            "table",
            Shape::Box { box_from_base: block.inverse(), half_mm: Vector3::new(300.0, 200.0, 40.0) },
        ),
        obstacle(
            "lamp",
            Shape::Cylinder {
                from: Point::new(200.0, -500.0, 600.0),
                to: Point::new(300.0, -400.0, 900.0),
                radius_mm: 120.0,
            },
        ),
        obstacle("ball", Shape::Capsule(Capsule { from: ball, to: ball, radius_mm: 90.0 })),
    ]
}

fn room() -> Room {
    Room::new(&arm(), &handpiece(), obstacles(), 10.0).unwrap()
}

/// The least distance of points on the links' axes from everything, by samples at most `step_mm` apart.
fn sampled_mm(room: &Room, q: &[f64; 6], step_mm: f64) -> f64 {
    let placed = room.links.place(q);
    let mut least = f64::INFINITY;
    for link in 1..LINKS {
        for capsule in placed.capsules(link) {
            let steps = (capsule.length_mm() / step_mm).ceil().max(1.0);
            for n in 0..=steps as usize {
                let way = (capsule.to - capsule.from) * (n as f64 / steps);
                let p = capsule.from + way;
                for obstacle in room.obstacles() {
                    least = least.min(obstacle.at_least_mm(&p, f64::INFINITY) - capsule.radius_mm);
                }
                for (other, _) in room.links.pairs.iter().filter(|(_, k)| *k == link) {
                    let others = placed.capsules(*other).map(|c| c.distance_mm(&p));
                    least = least.min(others.fold(f64::INFINITY, f64::min) - capsule.radius_mm);
                }
            }
        }
    }
    least
}

#[test]
fn a_posture_s_distance_is_below_every_sample_and_near_the_least() {
    let (room, mut next) = (room(), stream(3));
    let mut seen = [0usize; 2];
    for n in 0..100_000 {
        let q: [f64; 6] = std::array::from_fn(|_| (2.0 * next() - 1.0) * PI);
        let found = room.nearest(&q, [f64::NEG_INFINITY, 300.0]).unwrap();
        // coarse samples bound the distance from above, too
        let sampled = sampled_mm(&room, &q, if n % 50 == 0 { 1.0 } else { 40.0 });
        assert!(found.distance_mm <= sampled + 1e-9, "{n}: {found:?} {sampled}");
        if n % 50 == 0 && sampled < 300.0 {
            // half a step of the samples, and a piece with its share
            let off = sampled - found.distance_mm;
            assert!(
                off <= 0.5 + PIECE_MM + PIECE_SHARE * sampled.max(0.0) + 1e-9,
                "{n}: {found:?} {sampled}"
            );
        }
        seen[usize::from(matches!(found.other, Some(Other::Link(_))))] += 1;
    }
    assert!(seen.iter().all(|count| *count > 1000), "both kinds are met: {seen:?}");
}

#[test]
fn a_smaller_question_has_the_same_answer() {
    let (room, mut next) = (room(), stream(4));
    for _ in 0..5000 {
        let q: [f64; 6] = std::array::from_fn(|_| (2.0 * next() - 1.0) * PI);
        let [far, near] = [400.0, 10.0].map(|cap| room.nearest(&q, [f64::NEG_INFINITY, cap]).unwrap());
        // the coarser answer may be lower by its piece and share
        assert!((near.distance_mm - far.distance_mm.min(10.0)).abs() < 2.0, "{near:?} {far:?}");
        assert!(near.other.is_some() == (near.distance_mm < 10.0));
    }
}

#[test]
fn no_posture_between_two_is_nearer_than_is_said() {
    let (room, mut next) = (room(), stream(5));
    let mut tight = 0;
    for n in 0..400 {
        let q0: [f64; 6] = std::array::from_fn(|_| (2.0 * next() - 1.0) * PI);
        let turn = [0.02, 0.3, 1.5][n % 3];
        let q1: [f64; 6] = std::array::from_fn(|j| q0[j] + (2.0 * next() - 1.0) * turn);
        let q = [q0, q1].concat();
        let said = room.along(LinkMotion { q: &q }).unwrap().nearest.distance_mm;
        let mut least = f64::INFINITY;
        for k in 0..=400 {
            let share = f64::from(k) / 400.0;
            let q: [f64; 6] = std::array::from_fn(|j| q0[j] + (q1[j] - q0[j]) * share);
            least = least.min(sampled_mm(&room, &q, 20.0));
        }
        assert!(said <= least + 1e-9, "{n}: {said} {least}");
        tight += usize::from(said > least.min(200.0) - 0.2 * least.clamp(0.0, 200.0) - 12.0);
    }
    assert!(tight > 360, "the bound is near the truth in {tight} of 400");
}

#[test]
fn bounds_of_motion_hold_for_every_point_of_a_link() {
    let mut next = stream(6);
    let rooms = UrModel::ALL.map(|model| Room::new(&arm_of(model), &handpiece(), vec![], 10.0).unwrap());
    for n in 0..20_000 {
        let room = &rooms[n % rooms.len()];
        let q0: [f64; 6] = std::array::from_fn(|_| (2.0 * next() - 1.0) * PI);
        let q1: [f64; 6] = std::array::from_fn(|j| q0[j] + (2.0 * next() - 1.0) * 0.5);
        let (a, b) = (room.links.place(&q0), room.links.place(&q1));
        for link in 0..LINKS {
            let most = room.links.most_moved_mm(link, &q0, &q1);
            for (before, after) in a.capsules(link).zip(b.capsules(link)) {
                let moved = before.from.distance_mm(&after.from).max(before.to.distance_mm(&after.to));
                assert!(moved <= most + 1e-9, "{}: {moved} {most}", link_name(link));
            }
        }
    }
}

#[test]
fn a_folded_arm_meets_itself() {
    let room = room();
    assert!(room.links.pairs.iter().all(|(i, k)| k - i >= 2));
    let folded = [0.0, -1.2, 3.05, 0.0, 1.5, 0.0];
    let nearest = room.nearest(&folded, [10.0; 2]).unwrap();
    assert!(matches!(nearest.other, Some(Other::Link(_))), "{nearest:?}");
}

#[test]
fn the_base_is_held_against_the_patient_and_what_reaches_above_its_plane() {
    let with = |obstacles| Room::new(&arm(), &handpiece(), obstacles, 10.0).unwrap();
    let table = |top_mm: f64, aside_mm: f64| {
        let middle = Vector3::new(aside_mm, 0.0, 0.5 * (top_mm - 60.0));
        let box_from_base = Rigid::<Base, Base>::new(Rotation3::identity(), -middle);
        let half_mm = Vector3::new(300.0, 300.0, 0.5 * (top_mm + 60.0));
        obstacle("table", Shape::Box { box_from_base, half_mm })
    };
    // it stands on one, and is in the other
    assert_eq!(with(vec![table(0.5, 0.0)]).base().other, None);
    let inside = with(vec![table(0.5, 0.0), table(30.0, 0.0)]);
    let Nearest { distance_mm, link, other } = *inside.base();
    assert!(distance_mm < -20.0 && link == BASE && other == Some(Other::Obstacle(1)), "{distance_mm}");
    // beside it, the distance is that of the base's widest place; a path is no farther
    let beside = with(vec![table(30.0, 420.0)]);
    assert!((20.0..60.0).contains(&beside.base().distance_mm), "{:?}", beside.base());
    let up = [0.0, -PI / 2.0, 0.0, -PI / 2.0, 0.0, 0.0];
    let least = beside.along(LinkMotion { q: &up }).unwrap().nearest;
    assert_eq!((least.link, least.distance_mm), (BASE, beside.base().distance_mm));
    // the base of a room for another place is found anew
    assert_eq!(inside.among(vec![]).base().other, None);
    for (shape, is_above) in [
        (
            Shape::Cylinder {
                from: Point::new(0.0, 0.0, -90.0),
                to: Point::new(0.0, 0.0, 0.0),
                radius_mm: 90.0,
            },
            false,
        ),
        (
            Shape::Cylinder {
                from: Point::new(-90.0, 0.0, -60.0),
                to: Point::new(90.0, 0.0, -60.0),
                radius_mm: 70.0,
            },
            true,
        ),
        (
            Shape::Capsule(Capsule {
                from: Point::new(0.0, 0.0, -90.0),
                to: Point::new(0.0, 0.0, -50.0),
                radius_mm: 50.0,
            }),
            false,
        ),
        (
            Shape::Capsule(Capsule {
                from: Point::new(0.0, 0.0, -90.0),
                to: Point::new(0.0, 0.0, -40.0),
                radius_mm: 50.0,
            }),
            true,
        ),
    ] {
        assert_eq!(with(vec![obstacle("thing", shape)]).base().other.is_some(), is_above);
    }
    // a patient around the base
    let grid =
        Grid::<Ct>::new([8; 3], Vector3::repeat(30.0), Matrix3::identity(), Vector3::repeat(-120.0)).unwrap();
    let field = Volume::new(grid.clone(), vec![0.0; grid.len()]).unwrap();
    let patient = Shape::Head(Head::new(field, &Rigid::identity()));
    assert!(with(vec![obstacle("patient", patient)]).base().distance_mm < 0.0);
}

#[test]
fn every_model_follows_a_line_before_it_clear_of_itself() {
    for model in UrModel::ALL {
        let arm = arm_of(model);
        let room = Room::new(&arm, &handpiece(), vec![], 10.0).unwrap();
        let (poses, length_mm) = line_at(0.5 * model.reach_mm());
        let found = resolve(&arm, &path(&poses, &length_mm, Some(&room))).unwrap().unwrap();
        let least = room.along(LinkMotion { q: &found.q }).unwrap().nearest;
        assert!(least.distance_mm >= 10.0 - 0.6, "{model:?}: {least:?}");
    }
}

/// A line of poses with the shaft upright before the arm.
fn line() -> (Vec<AxisPose>, Vec<f64>) {
    line_at(420.0)
}

fn line_at(x_mm: f64) -> (Vec<AxisPose>, Vec<f64>) {
    let axis = nalgebra::Unit::new_normalize(Vector3::z());
    let pose = |n: usize| AxisPose { position: Point::new(x_mm + n as f64 * 0.5, 60.0, 80.0), axis };
    ((0..60).map(pose).collect(), vec![0.5; 60])
}

fn path<'a>(poses: &'a [AxisPose], length_mm: &'a [f64], room: Option<&'a Room>) -> PosePath<'a> {
    let frame = RollFrame::about(&Vector3::z_axis());
    PosePath { poses, length_mm, frame, stiffness: None, posture: Posture::Any, room }
}

#[test]
fn a_path_goes_round_what_it_would_hit_or_names_it() {
    let (poses, length_mm) = line();
    let arm = arm();
    let free = resolve(&arm, &path(&poses, &length_mm, None)).unwrap().unwrap();
    // a ball where the elbow is without it
    let elbow = arm.joint_places(&free.q[..6]).unwrap()[2];
    let in_the_way = obstacle("lamp", Shape::Capsule(Capsule { from: elbow, to: elbow, radius_mm: 60.0 }));
    let room = Room::new(&arm, &handpiece(), vec![in_the_way], 10.0).unwrap();
    let before = room.along(LinkMotion { q: &free.q }).unwrap().nearest;
    assert!(before.distance_mm < 0.0 && room.name(before.other) == "lamp", "{before:?}");
    let found = resolve(&arm, &path(&poses, &length_mm, Some(&room))).unwrap().unwrap();
    let after = room.along(LinkMotion { q: &found.q }).unwrap().nearest;
    assert!(after.distance_mm >= 10.0 - 0.6, "{after:?}");
    let single = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let alone = single.install(|| resolve(&arm, &path(&poses, &length_mm, Some(&room))).unwrap().unwrap());
    assert_eq!(alone, found, "the same on any number of threads");
    // a slab through the flange leaves no posture
    let at = Rigid::<Base, Base>::new(Rotation3::identity(), Vector3::new(430.0, 60.0, 260.0));
    let slab = Shape::Box { box_from_base: at.inverse(), half_mm: Vector3::new(400.0, 400.0, 30.0) };
    let room = Room::new(&arm, &handpiece(), vec![obstacle("shelf", slab)], 10.0).unwrap();
    let refused = resolve(&arm, &path(&poses, &length_mm, Some(&room))).unwrap().unwrap_err();
    let ReachReason::Meets(meeting) = &refused.reason else { panic!("{refused:?}") };
    assert!(meeting.other == "shelf" && meeting.distance_mm < 0.0, "{meeting:?}");
    assert!(refused.reason.to_string().contains("runs into shelf by up to"), "{}", refused.reason);
}
