//! The hard cases of tools, paths, speeds, arms, and of bad input.

use super::scene::{BONE, Expect, Scene, V, block, pocket};

/// Scenes that are hard because of burr, shank, path, orientation, speed or arm.
pub(super) fn tool_scenes() -> Vec<Scene> {
    let plain = Scene::plain;
    let short = Expect::FallsShort;
    vec![
        plain("small burr", "many layers and lines")
            .with("radius_mm = 1.5\nneck_radius_mm = 0.6", "radius_mm = 0.8\nneck_radius_mm = 0.4")
            .with("[25.0, 0.7]", "[25.0, 0.5]")
            .with("layer_mm = 1.5", "layer_mm = 0.8")
            .with("spacing_mm = 0.25\n", "spacing_mm = 0.125\n"),
        plain("burr that just fits", "0.4 mm of play in the pocket")
            .with("radius_mm = 1.5", "radius_mm = 2.8")
            .with("spacing_mm = 0.25\n", "spacing_mm = 0.2\n"),
        plain("burr larger than the pocket", "a cap of it can be reached, less cleanly than a pocket")
            .with("radius_mm = 1.5", "radius_mm = 4.5")
            .must(short("of what the burr can reach is removed")),
        plain("shank hardly thinner than the burr", "every tilt leans on the wall")
            .with("[25.0, 0.7]", "[25.0, 1.37]")
            .must(short("shank would meet untargeted bone")),
        plain("handpiece near the burr", "6 mm of radius 5 mm above the bone").with("[25.0, 0.7]", "[5.0, 0.7]"),
        plain("handpiece in the cavity", "it follows the burr down, hardly thinner")
            .with("[25.0, 0.7], [60.0, 6.0]", "[0.6, 0.7], [60.0, 1.2]"),
        plain("handpiece that cannot follow", "0.5 mm behind the burr and as thick as the pocket is wide")
            .with("[25.0, 0.7], [60.0, 6.0]", "[0.5, 0.7], [60.0, 6.0]")
            .must(short("shank would meet untargeted bone")),
        plain("long steps", "waypoints as far apart as the burr is wide").with("step_mm = 0.25", "step_mm = 1.4"),
        plain("short steps", "thousands of waypoints").with("step_mm = 0.25", "step_mm = 0.12"),
        plain("one deep layer", "as deep as the target and the burr").with("layer_mm = 1.5", "layer_mm = 3"),
        plain("a layer deeper than the burr", "ridges between lines")
            .with("layer_mm = 1.5", "layer_mm = 4")
            .must(Expect::Refused("expected at most 3 mm")),
        plain("lines at an angle", "a raster across the outline").with("step_mm = 0.25", "step_mm = 0.25\nraster_deg = 31"),
        plain("no tilt", "the axis is the approach").with("[speed]", "[orientation]\ntilt_limit_deg = 0.5\n\n[speed]"),
        plain("large tilt", "the handpiece may nearly lie on the bone")
            .with("[speed]", "[orientation]\ntilt_limit_deg = 69\n\n[speed]"),
        plain("greedy", "each waypoint alone, then a low-pass").with("[speed]", "[orientation]\nmode = \"greedy\"\n\n[speed]"),
        plain("fixed", "one axis for all").with("[speed]", "[orientation]\nmode = \"fixed\"\n\n[speed]"),
        plain("one speed", "minimum and maximum are the same").with("min_mm_s = 0.5", "min_mm_s = 2\nmax_mm_s = 2\nnominal_mm_s = 2"),
        plain("constant speed", "no mass law").with("min_mm_s = 0.5", "min_mm_s = 0.5\nmode = \"constant\""),
        plain("a total time", "within the range").with("min_mm_s = 0.5", "min_mm_s = 0.5\ntotal_time_s = 150"),
        plain("a total time that cannot be", "faster than the fastest")
            .with("min_mm_s = 0.5", "min_mm_s = 0.5\ntotal_time_s = 3")
            .must(short("time")),
        plain("a slow controller", "rows every 0.1 s").with("rate_hz = 100", "rate_hz = 10"),
        plain("a fast controller", "rows every 0.5 ms").with("rate_hz = 100", "rate_hz = 2000"),
        plain("weak joints", "a tenth of the acceleration")
            .with("rate_hz = 100", "rate_hz = 100\nacceleration_limits = [15, 15, 15, 0.6]"),
        plain("slow joints", "slower than the burr may go")
            .with("rate_hz = 100", "rate_hz = 100\nvelocity_limits = [1, 1, 1, 0.1]"),
        plain("a patient out of reach", "half a metre from the arm")
            .with("rate_hz = 100", "rate_hz = 100\nbase_from_ct = { rotation = [[1, 0, 0], [0, 1, 0], [0, 0, 1]], translation_mm = [500, 0, 0] }")
            .must(short("cannot reach")),
        plain("a patient turned in the base", "the tilt plane is oblique to the raster").with(
            "rate_hz = 100",
            "rate_hz = 100\nbase_from_ct = { rpy_rad = [0, 0, 0.6], translation_mm = [0, 0, 0] }",
        ),
        plain("the paper's own choices", "preset: greedy, dz, plain average").with("[images]", "preset = \"paper\"\n[images]"),
        plain("edge forces", "a force that does not vanish with the chip")
            .with("[path]", "[material]\nk_te = 10\nk_re = 8\nk_ae = 1\nt0_mm = 0.001\n\n[path]"),
        plain("deflection as cost", "the arm's compliance turns the force")
            .with("rate_hz = 100", "rate_hz = 100\njoint_stiffness = [200, 150, 250, 300000]")
            .with("[path]", "[cost]\nforce = \"deflection\"\n\n[path]"),
    ]
}

/// Scenes with input that must be refused with a reason.
pub(super) fn input_scenes() -> Vec<Scene> {
    fn shifted(p: &V) -> f32 {
        block(p) + 1024.0
    }
    fn flat(_: &V) -> f32 {
        BONE
    }
    fn windowed(p: &V) -> f32 {
        if p.z < 0.0 { 255.0 } else { 0.0 }
    }
    fn nothing(_: &V) -> u8 {
        0
    }
    let refused = |name, why, words| Scene::plain(name, why).must(Expect::Refused(words));
    vec![
        refused("HU with an offset", "air at 24 HU would be tissue", "not Hounsfield units")
            .body(shifted, pocket),
        refused("an empty scan", "one value everywhere", "not Hounsfield units").body(flat, pocket),
        refused("a windowed scan", "8-bit grey values", "not Hounsfield units").body(windowed, pocket),
        refused("no labels", "the target is in no voxel", "label 20").body(block, nothing),
        refused("a structure that is not there", "a wrong number", "label 9").with("label = 7", "label = 9"),
        refused("a name without labels.json", "names need a list", "labels.json: give the label's number")
            .with("label = 7", "label = \"nerve\""),
        refused("metres", "1.5 mm as 0.0015", "looks like metres")
            .with("radius_mm = 1.5", "radius_mm = 0.0015"),
        refused("a misspelt key", "silently a default otherwise", "did you mean")
            .with("layer_mm", "leyer_mm"),
        refused("a clearance below 0", "a nerve to be cut", "clearance_mm")
            .with("clearance_mm = 0.8", "clearance_mm = -1"),
        refused("a shank thicker than the burr", "it could not follow", "thicker than the burr")
            .with("[25.0, 0.7]", "[25.0, 3.0]"),
        refused(
            "a shank as thick as the burr",
            "every tilt leans on the wall",
            "less half of grid.spacing_mm",
        )
        .with("[25.0, 0.7]", "[25.0, 1.45]"),
        refused("an axis of length 0", "no approach", "direction")
            .with("direction = ", "direction = [0, 0, 0] #"),
        refused("a missing image", "named, but not there", "No such file").with("ct.nii", "other.nii"),
        refused("a grid beyond memory", "0.02 mm voxels", "")
            .with("spacing_mm = 0.25\n", "spacing_mm = 0.02\n"),
    ]
}
