//! Contact of the shank: its place and depth, and that the step is then not made.

use super::*;

const NECK_MM: f64 = 1.1;

fn with_shank<'a>(bone: &'a Volume<f32, Work>, start: Pose) -> Engine<'a, f32, FlutedBurr> {
    let neck = ShankCylinder { from_mm: RADIUS_MM, to_mm: 20.0, radius_mm: NECK_MM };
    let handpiece = ShankCylinder { from_mm: 20.0, to_mm: 40.0, radius_mm: 5.0 };
    let spec = EngineSpec { shank: vec![neck, handpiece], ..spec() };
    let model = burr(&spec);
    Engine::new(Bone::new(bone).unwrap(), spec, model, start).unwrap()
}

/// A ledge: bone fills y > 1, z > 4.
fn ledge() -> Volume<f32, Work> {
    block(8.0, 0.25, |p| if p.y > 1.0 && p.z > 4.0 { 0.8 } else { 0.0 })
}

#[test]
fn a_ledge_above_the_burr_stops_it_where_the_shank_meets_it() {
    let bone = ledge();
    let mut engine = with_shank(&bone, pose(0.0, -4.0, 0.0));
    let mut stopped = None;
    for n in 1..=120 {
        let next = pose(0.0, -4.0 + 0.05 * n as f64, 0.0);
        let before = (engine.pose(), *engine.removed(), engine.lattice().left());
        let step = engine.step(to(engine.pose(), next)).unwrap();
        if let Some(contact) = step.contact {
            assert_eq!((engine.pose(), *engine.removed(), engine.lattice().left()), before);
            assert_eq!(step.force, CutForce::default());
            stopped = Some((next, contact));
            break;
        }
    }
    // the ledge's first cell centres are at y = 1.125, where the neck's side touches them
    let (next, contact) = stopped.unwrap();
    assert!((next.center.y() - (1.125 - NECK_MM)).abs() < 0.06, "{next:?}");
    assert!(contact.depth_mm > 0.0 && contact.depth_mm < 0.06, "{contact:?}");
    assert!((contact.at.y() - 1.125).abs() < 1e-9 && contact.at.z() > 4.0, "{contact:?}");
    assert!((contact.along_mm - contact.at.z()).abs() < 1e-9);
    assert_eq!(contact.kind, Kind::Bone);
    // the burr can still move elsewhere
    let away = engine.step(to(engine.pose(), pose(0.0, -4.0, 0.0))).unwrap();
    assert!(away.contact.is_none());
}

#[test]
fn one_long_step_is_stopped_on_its_way_as_well() {
    let bone = block(8.0, 0.25, |p| if p.y.abs() < 0.3 && p.z > 4.0 { 0.8 } else { 0.0 });
    let mut engine = with_shank(&bone, pose(0.0, -6.0, 0.0));
    let step = engine.step(to(engine.pose(), pose(0.0, 6.0, 0.0))).unwrap();
    assert!(step.contact.is_some());
    assert_eq!(engine.pose(), pose(0.0, -6.0, 0.0));
}

#[test]
fn a_turn_is_stopped_where_it_leads_into_bone() {
    let bone = ledge();
    let mut engine = with_shank(&bone, pose(0.0, -2.0, 0.0));
    let here = engine.pose();
    let leaning = |angle: f64| Pose::new(here.center, Vector3::new(0.0, angle.sin(), angle.cos())).unwrap();
    assert!(engine.step(Move::straight(leaning(0.2), 0.1)).unwrap().contact.is_none());
    let step = engine.step(Move::straight(leaning(0.9), 0.1)).unwrap();
    assert!(step.contact.is_some());
    assert_eq!(engine.pose(), leaning(0.2));
}

/// The shank may be where the burr has cut, whether the lattice is settled or not.
#[test]
fn the_shank_follows_the_burr_into_its_own_hole() {
    let bone = uniform(8.0, 0.25);
    let mut engine = with_shank(&bone, pose(0.0, 0.0, 11.0));
    let down = straight(&mut engine, pose(0.0, 0.0, -2.0), 130);
    assert!(down.iter().all(|s| s.contact.is_none()));
    let aside = straight(&mut engine, pose(2.0, 0.0, -2.0), 20);
    let stopped = aside.iter().position(|s| s.contact.is_some()).unwrap();
    // the hole is 2.5 wide, the neck 1.1: it moves 1.4 to the nearest cell centre
    assert!((12..=15).contains(&stopped), "{stopped}");
}

/// Tests that cannot find a contact are skipped; the result agrees with testing at every step.
#[test]
fn batches_are_stopped_where_single_steps_are() {
    let bone = ledge();
    let moves: Vec<Move> = {
        let mut at = pose(0.0, -4.0, 0.0);
        let way = (1..=200).map(|n| {
            let next = pose(0.0, -4.0 + 0.05 * n as f64, 0.0);
            let step = to(at, next);
            at = next;
            step
        });
        way.collect()
    };
    let mut single = with_shank(&bone, pose(0.0, -4.0, 0.0));
    let one: Vec<bool> = moves.iter().map(|m| single.step(*m).unwrap().contact.is_some()).collect();
    let mut batched = with_shank(&bone, pose(0.0, -4.0, 0.0));
    let many: Vec<bool> =
        moves.chunks(64).flat_map(|b| batched.steps(b).unwrap()).map(|s| s.contact.is_some()).collect();
    assert_eq!(one, many);
    assert!(one.iter().filter(|c| **c).count() > 50);
    assert_eq!(single.pose(), batched.pose());
}
