//! The hard cases of images and anatomy; those of tools, limits and bad input are in [`super::list_tools`].

use super::list_tools::{input_scenes, tool_scenes};
use super::scene::{AIR, BONE, Expect, NERVE, SOFT, Scene, TARGET, V, block, bowl, dome, nerve, pocket};

/// Every hard case.
pub fn scenes() -> Vec<Scene> {
    [image_scenes(), target_scenes(), structure_scenes(), bone_scenes(), tool_scenes(), input_scenes()]
        .concat()
}

/// Scenes that differ in how the body is stored, which must not matter.
fn image_scenes() -> Vec<Scene> {
    let stored = |name, why| Scene::plain(name, why);
    let turned = |name, why, turn_rad: [f64; 3]| Scene { turn_rad, ..stored(name, why) };
    // stored on grids that are turned against the planner's
    let round =
        |scene: Scene| scene.body(dome, bowl).with("layer_mm = 1.5", "layer_mm = 0.8\nstepover_mm = 0.7");
    let quarter = std::f64::consts::FRAC_PI_2;
    let fine = |scene| {
        round(Scene { spacing_mm: [0.2; 3], ..scene }).with("spacing_mm = 0.25\n", "spacing_mm = 0.2\n")
    };
    vec![
        stored("plain", "nothing: the reference"),
        Scene { mirrored: [true, false, false], ..stored("i backwards", "a left-handed storage order") },
        Scene { mirrored: [true, true, false], ..stored("LPS order", "what DICOM converters write") },
        Scene { mirrored: [true, true, true], ..stored("all backwards", "a left-handed storage order") },
        turned("approach along x", "the grid's z is the scan's x", [0.0, quarter, 0.0]),
        turned("approach along -y", "a basis near a pole of none", [quarter, 0.0, 0.0]),
        turned("approach from below", "the basis at its own pole", [std::f64::consts::PI, 0.0, 0.0]),
        fine(turned("oblique scan", "no axis along any other", [0.4, -0.7, 1.1])),
        fine(Scene {
            mirrored: [false, true, false],
            ..turned("oblique and mirrored", "det -1 and no axis along any other", [-0.9, 0.3, 2.0])
        }),
        round(Scene {
            spacing_mm: [0.25, 0.5, 0.75],
            ..stored("anisotropic voxels", "a diagonal of 0.94 mm")
        }),
        round(Scene {
            spacing_mm: [0.25, 0.25, 1.0],
            ..turned("thick slices", "a band of four grid voxels", [0.3, 0.2, 0.0])
        }),
        fine(Scene {
            label_grid: Some(([0.15, 0.12, 0.17], [0.1, -0.05, 0.15])),
            ..stored("labels on a grid of their own", "no label voxel lies on a CT voxel")
        }),
        round(Scene {
            spacing_mm: [0.25; 3],
            label_grid: Some(([0.75; 3], [0.0; 3])),
            ..stored("coarse labels", "label boxes of 27 CT voxels")
                .with("clearance_mm = 0.8", "clearance_mm = 0.6")
        }),
        stored("finer planning grid", "voxels of 0.2 mm in a scan of 0.5 mm")
            .with("spacing_mm = 0.25\n", "spacing_mm = 0.2\n"),
    ]
}

fn target_scenes() -> Vec<Scene> {
    fn slab(p: &V) -> u8 {
        let target = p.x.hypot(p.y) < 4.5 && dome(p) > SOFT && dome(&(p + V::z())) < SOFT;
        if target { TARGET } else { nerve(p).into_label() }
    }
    fn two(p: &V) -> u8 {
        let in_one = |x: f64| V::new((p.x - x) / 2.3, p.y / 2.3, p.z / 2.2).norm() < 1.0 && p.z < 0.0;
        if in_one(-4.2) || in_one(1.2) { TARGET } else { 0 }
    }
    fn voxel(p: &V) -> u8 {
        if p.x.abs() < 0.5 && p.y.abs() < 0.5 && (-1.5..-0.8).contains(&p.z) { TARGET } else { 0 }
    }
    fn in_slot(p: &V) -> bool {
        (0.0..0.5).contains(&p.x) && p.y.abs() < 4.0
    }
    fn slot(p: &V) -> u8 {
        if in_slot(p) && (-3.0..-1.5).contains(&p.z) { TARGET } else { 0 }
    }
    fn slotted(p: &V) -> f32 {
        if in_slot(p) && p.z >= -1.5 { AIR } else { block(p) }
    }
    fn well(p: &V) -> u8 {
        if p.x.hypot(p.y) < 2.0 && (-6.0..0.0).contains(&p.z) { TARGET } else { 0 }
    }
    fn undercut(p: &V) -> u8 {
        let (neck, hall) =
            (p.x.hypot(p.y) < 2.2 && p.z >= -3.0, p.x.abs() < 5.0 && p.y.abs() < 2.2 && p.z < -3.0);
        if (neck || hall) && (-6.0..0.0).contains(&p.z) { TARGET } else { 0 }
    }
    fn ball(p: &V) -> u8 {
        if (p - V::new(0.0, 0.0, -1.0)).norm() < 3.5 { TARGET } else { 0 }
    }
    fn oblique_pit(p: &V) -> u8 {
        let axis = V::new(0.5, 0.0, 0.866);
        let along = p.dot(&axis);
        if (p - axis * along).norm() < 2.6 && along > -4.0 && p.z < 0.0 { TARGET } else { 0 }
    }
    fn buried(p: &V) -> u8 {
        if p.x.abs() < 2.0 && p.y.abs() < 2.0 && (-5.0..-2.0).contains(&p.z) { TARGET } else { 0 }
    }
    fn airy(p: &V) -> f32 {
        let cell = (p.x * 1.7).sin() * (p.y * 1.3).sin() * (p.z * 1.9).cos() > 0.35;
        if p.z < 0.0 && !(cell && pocket(p) == TARGET) { BONE } else { AIR }
    }
    fn deep(p: &V) -> u8 {
        if p.x.abs() < 3.0 && p.y.abs() < 3.0 && (-6.0..0.0).contains(&p.z) { TARGET } else { 0 }
    }
    fn storeys(p: &V) -> f32 {
        // a room of air, twice as high as a layer, between two floors of bone
        if deep(p) == TARGET && (-4.5..-1.2).contains(&p.z) { AIR } else { block(p) }
    }
    fn hollow(p: &V) -> f32 {
        // wider than the target, so interpolation makes a thin layer of material at the rim
        let wide = p.x.abs() < 4.0 && p.y.abs() < 4.0 && p.z > -4.0;
        if wide { AIR } else { block(p) }
    }
    fn edge(p: &V) -> u8 {
        if p.x > 4.0 && p.y.abs() < 3.0 && (-2.5..0.0).contains(&p.z) { TARGET } else { 0 }
    }
    let with = |name, why, label: fn(&V) -> u8| Scene::plain(name, why).body(block, label).without_nerve();
    let shape = |name, why, target: &str| {
        Scene::plain(name, why).with("[target]\nlabel = 20", format!("[target]\n{target}"))
    };
    vec![
        Scene {
            spacing_mm: [0.25; 3],
            ..Scene::plain("thin slab", "one layer, a third of the burr's width thick").body(dome, slab)
        }
        .with("spacing_mm = 0.25\n", "spacing_mm = 0.125\n")
        .must(Expect::FallsShort("of what the burr can reach is removed")),
        with("two pieces", "a link between cavities", two)
            .with("layer_mm = 1.5", "layer_mm = 0.8\nstepover_mm = 0.7"),
        with("a few voxels", "a target smaller than the burr, under the surface", voxel)
            .must(Expect::Refused("can reach no voxel of the target")),
        Scene::plain("slot narrower than the burr", "its floor can be seen but not touched")
            .body(slotted, slot)
            .without_nerve()
            .must(Expect::Refused("can reach no voxel of the target")),
        with("narrow deep well", "the burr just fits; corners of the floor stay", well)
            .must(Expect::FallsShort("of what the burr can reach is removed")),
        with("undercut hall", "the shaft has to tilt under a roof, or say so", undercut)
            .must(Expect::FallsShort("")),
        with(
            "undercut hall, two angles",
            "directions 12 degrees apart leave out what finer ones reach",
            undercut,
        )
        .two_angles()
        .must(Expect::FallsShort("")),
        Scene { spacing_mm: [0.2; 3], ..with("ball that leaves the bone", "a target half in air", ball) }
            .with("spacing_mm = 0.25\n", "spacing_mm = 0.2\n"),
        with("oblique pit", "walls that lean over the floor", oblique_pit),
        with("buried target", "no way in but through bone that must stay", buried)
            .must(Expect::Refused("can reach no voxel of the target")),
        Scene {
            spacing_mm: [0.25; 3],
            ..Scene::plain("air cells", "a third of the target is air").body(airy, pocket)
        },
        Scene {
            half_mm: [8.0, 8.0, 9.0],
            ..Scene::plain("layers of air", "a layer with nothing to cut between two with bone")
        }
        .body(storeys, deep)
        .without_nerve(),
        Scene::plain("target of air alone", "nothing to cut")
            .body(hollow, pocket)
            .must(Expect::Refused("empty")),
        with("target at the scan's edge", "what lies beyond is unknown: a warning", edge),
        shape(
            "box",
            "the bone in a box, structures left out",
            "box = { min_mm = [-3, -3, -3], max_mm = [3, 3, 1] }",
        ),
        shape(
            "sphere",
            "the bone in a ball that reaches into air",
            "ball = { center_mm = [0, 0, -0.5], radius_mm = 3.2 }",
        ),
        shape(
            "frustum",
            "a cone that widens towards the surface",
            "frustum = { from_mm = [0, 0, -3], to_mm = [0, 0, 1], from_radius_mm = 2.2, to_radius_mm = 3.6 }",
        ),
        shape("box in thin air", "no bone in it", "box = { min_mm = [-3, -3, 0.6], max_mm = [3, 3, 2] }")
            .must(Expect::Refused("empty")),
        shape(
            "box outside the scan",
            "of another patient",
            "box = { min_mm = [90, 90, 90], max_mm = [99, 99, 99] }",
        )
        .must(Expect::Refused("outside the CT")),
    ]
}

fn structure_scenes() -> Vec<Scene> {
    fn bridge(p: &V) -> u8 {
        // a nerve across the pocket, 1 mm below its floor
        let across = p.y.abs() < 0.5 && p.x.abs() < 6.0 && (-4.6..-3.9).contains(&p.z);
        if across { NERVE } else { only_pocket(p) }
    }
    fn over(p: &V) -> u8 {
        // a nerve across the way in, above the surface
        let across = p.y.abs() < 0.5 && (1.0..1.8).contains(&p.z);
        if across { NERVE } else { only_pocket(p) }
    }
    fn rim(p: &V) -> u8 {
        // the same above an edge of the pocket: half of it has to be reached from the other side
        let across = (2.4..3.4).contains(&p.y) && (1.0..1.8).contains(&p.z);
        if across { NERVE } else { only_pocket(p) }
    }
    fn lid(p: &V) -> u8 {
        if (1.0..1.6).contains(&p.z) { NERVE } else { only_pocket(p) }
    }
    fn touching(p: &V) -> u8 {
        if (3.0..4.0).contains(&p.x) && p.y.abs() < 3.0 && (-3.0..-1.0).contains(&p.z) {
            NERVE
        } else {
            only_pocket(p)
        }
    }
    fn speck(p: &V) -> u8 {
        if (p.x - 4.8).abs() < 0.26 && p.y.abs() < 0.26 && (p.z + 1.0).abs() < 0.26 {
            NERVE
        } else {
            only_pocket(p)
        }
    }
    fn cup(p: &V) -> u8 {
        // all around and below, 1.5 mm away
        let far = (p.x.abs() - 3.0).max(p.y.abs() - 3.0).max(-3.0 - p.z);
        if p.z < -1.0 && (1.5..2.2).contains(&far) { NERVE } else { only_pocket(p) }
    }
    fn both(p: &V) -> u8 {
        // the nerve, and another below the pocket, nearer in places
        let below = p.x.abs() < 6.0 && (p.y + 1.0).abs() < 0.5 && (-5.4..-4.6).contains(&p.z);
        if below { NERVE + 1 } else { pocket(p) }
    }
    fn between(p: &V) -> u8 {
        // a slot with a structure 1 mm beside either wall
        let aside = (2.8..3.4).contains(&p.x.abs()) && p.y.abs() < 5.0 && (-3.0..-1.0).contains(&p.z);
        if aside {
            if p.x < 0.0 { NERVE } else { NERVE + 1 }
        } else if p.x.abs() < 1.8 && p.y.abs() < 3.0 && (-3.0..0.0).contains(&p.z) {
            TARGET
        } else {
            0
        }
    }
    let with = |name, why, label: fn(&V) -> u8| Scene::plain(name, why).body(block, label);
    let sides = |name, why| {
        let second = "clearance_mm = 0.8\npriority = 2\n[[structure]]\nname = \"vein\"\nlabel = 8\nclearance_mm = 0.5\npriority = 1";
        with(name, why, between)
            .with("clearance_mm = 0.8", second)
            .with("[speed]", "[cost]\nstructures = \"sum\"\n[speed]")
    };
    let two = |name, why, rule: &str| {
        let second = "clearance_mm = 0.8\npriority = 2\n[[structure]]\nname = \"vein\"\nlabel = 8\nclearance_mm = 0.5\npriority = 1";
        with(name, why, both)
            .with("clearance_mm = 0.8", second)
            .with("[speed]", format!("[cost]\nstructures = \"{rule}\"\n[speed]"))
    };
    let clearance = |mm: &str| format!("clearance_mm = {mm}");
    vec![
        Scene::plain("no clearance", "the label box itself is the limit")
            .with("clearance_mm = 0.8", clearance("0")),
        Scene::plain("clearance into the target", "a corner of the pocket is forbidden")
            .with("clearance_mm = 0.8", clearance("2.4")),
        Scene::plain("clearance over all of the target", "nothing is left to reach")
            .with("clearance_mm = 0.8", clearance("12"))
            .must(Expect::Refused("clearances of the structures leave no room")),
        with("nerve under the floor", "the clearance lifts the floor along a line", bridge),
        with("nerve over the way in", "the burr fits past it on neither side", over)
            .must(Expect::FallsShort("can reach no part of the target")),
        // the burr passes under bone and removes a thin layer of it
        with("nerve over the rim", "what lies below it cannot be reached from above", rim),
        with("structure as a lid", "no way in", lid).must(Expect::Refused("can reach no voxel")),
        with("structure that touches the target", "the target gives way by the clearance", touching),
        with("structure of one voxel", "a box tree with one leaf", speck),
        with("structure all around", "every wall is a clearance", cup),
        Scene::plain("clearance of the shank", "the shaft keeps 2 mm from the nerve")
            .with("clearance_mm = 0.8", "clearance_mm = 0.8\nshank_clearance_mm = 2"),
        two("two structures, nearest", "which one changes along the path", "nearest"),
        two("two structures, by priority", "the cost looks at the farther one", "priority"),
        two("two structures, summed", "the cost looks at both", "sum"),
        sides("structures on both sides", "every push goes toward one of them"),
        sides("structures on both sides, two angles", "a UR5e tilts away from both").two_angles(),
        Scene::plain("no structure at all", "no distance, no force toward anything").without_nerve(),
    ]
}

fn bone_scenes() -> Vec<Scene> {
    fn sheet(p: &V) -> f32 {
        // a thin layer of bone over the pocket, as from partial volume
        if (0.0..0.5).contains(&p.z) && p.x.abs() < 3.5 { 400.0 } else { block(p) }
    }
    fn overhang(p: &V) -> f32 {
        // thick bone over half of the pocket
        if (0.0..2.0).contains(&p.z) && p.x > 1.0 { BONE } else { block(p) }
    }
    fn wall(p: &V) -> f32 {
        // a ridge beside the pocket that the shank must not lean on
        if (0.0..2.8).contains(&p.z) && (3.0..6.0).contains(&p.x.abs()) { BONE } else { block(p) }
    }
    fn soft(p: &V) -> f32 {
        if p.z < 0.0 {
            BONE
        } else if p.z < 1.5 {
            SOFT
        } else {
            AIR
        }
    }
    fn texture(p: &V) -> f32 {
        if p.z < 0.0 {
            900.0 + 700.0 * ((7.3 * p.x).sin() + (5.1 * p.y).cos() + (6.7 * p.z).sin()) as f32 / 3.0
        } else {
            AIR
        }
    }
    fn specks(p: &V) -> f32 {
        let speck = (p.x * 2.0).floor() as i64 % 5 == 0
            && (p.y * 2.0).floor() as i64 % 5 == 0
            && (0.5..1.0).contains(&p.z);
        if speck { 600.0 } else { block(p) }
    }
    fn cave(p: &V) -> f32 {
        // air under the floor: the burr breaks through
        if p.z < -3.0 && p.x.hypot(p.y) < 2.5 && p.z > -5.5 { AIR } else { block(p) }
    }
    fn threshold(p: &V) -> f32 {
        // just above the threshold of bone
        if p.z < 0.0 { 205.0 } else { AIR }
    }
    let with = |name, why, hu: fn(&V) -> f32| Scene::plain(name, why).body(hu, pocket);
    vec![
        with("partial-volume film over the way in", "a sheet thinner than the band is no wall", sheet),
        with("overhang over half the pocket", "half of it cannot be reached from above", overhang)
            .must(Expect::FallsShort("shank would meet untargeted bone")),
        with("ridges beside the pocket", "tilting is limited by bone that stays", wall),
        with("soft tissue over the bone", "retracted: no obstacle", soft),
        with("textured bone", "forces differ from voxel to voxel", texture),
        with("specks over the way in", "noise is no bone", specks),
        with("cave under the floor", "air beyond the target", cave),
        with("bone at the threshold", "every voxel is barely bone", threshold),
    ]
}

/// The pocket without a nerve.
fn only_pocket(p: &V) -> u8 {
    match pocket(p) {
        TARGET => TARGET,
        _ => 0,
    }
}

/// A flag as the nerve's label.
trait IntoLabel {
    fn into_label(self) -> u8;
}

impl IntoLabel for bool {
    fn into_label(self) -> u8 {
        if self { NERVE } else { 0 }
    }
}
