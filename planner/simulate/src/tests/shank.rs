//! Contact of the shank: its place and depth, and that the step is then not made.

use super::super::shank::ShankContact;
use super::*;
use bonemill_toolpath::scene::FarObstacles;

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
    assert_eq!(contact.kind, VoxelKind::Bone);
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

/// Solid coarse voxels beyond the grid, of 1 mm, where `holds` says so.
fn far(holds: impl Fn(Vector3<f64>) -> bool) -> FarObstacles {
    let grid = Grid::<Work>::aligned([17, 17, 61], 1.0, Point::new(-8.0, -8.0, 0.0)).unwrap();
    let full = (0..grid.len()).map(|n| holds(grid.center(grid.voxel(n)).coords)).collect();
    FarObstacles::new(&Volume::new(grid, full).unwrap(), 5.0).unwrap()
}

/// The contact of a shank whose handpiece, of radius 5, begins at z = 20, with a thing beyond the grid.
fn met_far(holds: impl Fn(Vector3<f64>) -> bool) -> Option<ShankContact> {
    let (bone, far) = (block(8.0, 0.5, |_| 0.0), far(holds));
    let neck = ShankCylinder { from_mm: RADIUS_MM, to_mm: 20.0, radius_mm: NECK_MM };
    let handpiece = ShankCylinder { from_mm: 20.0, to_mm: 50.0, radius_mm: 5.0 };
    let spec = EngineSpec { shank: vec![neck, handpiece], ..spec() };
    let model = burr(&spec);
    let bone = Bone::new(&bone).unwrap().with_far(&far);
    let mut engine = Engine::new(bone, spec, model, pose(0.0, 0.0, 0.0)).unwrap();
    engine.step(to(engine.pose(), pose(0.0, 0.05, 0.0))).unwrap().contact
}

/// Bone in front of the handpiece is nearer to its axis' first point than its radius, but not in the cylinder.
#[test]
fn beyond_the_grid_the_handpieces_flat_front_is_no_ball() {
    for z in [13.0, 16.0, 17.0, 19.0] {
        let met = met_far(|p| p.z <= z && p.z > 11.0 && p.y > 2.0);
        assert_eq!(met, None, "bone up to {z}");
    }
    // a voxel lies half a diagonal, 0.87, about its centre
    assert_eq!(met_far(|p| p.z <= 20.0 && p.z > 11.0 && p.y > 2.0), None);
    let met = met_far(|p| p.z <= 21.0 && p.z > 11.0 && p.y > 2.0).unwrap();
    assert!((met.along_mm - 21.0).abs() < 1e-9 && met.at.y() >= 3.0, "{met:?}");
}

/// The shank is tested in pieces, and the map has gaps nowhere: every place inside is found, and none outside.
#[test]
fn a_single_full_voxel_beyond_the_grid_is_met_exactly_where_it_lies_in_the_shank() {
    let inside_mm = 0.5 * 3f64.sqrt();
    for along in 12..=55 {
        for aside in 0..=7 {
            let thing = Vector3::new(0.0, f64::from(aside), f64::from(along));
            let radius_mm = if along < 20 { NECK_MM } else { 5.0 };
            let from_end_mm = (thing.z - 20.0).abs().min((thing.z - 50.0).abs());
            let is_inside =
                thing.z < 50.0 && (thing.y - 0.05).abs() + inside_mm < radius_mm && from_end_mm >= inside_mm;
            assert_eq!(met_far(|p| p == thing).is_some(), is_inside, "{thing:?}");
        }
    }
}
