//! The command with bad case files: exit code 2, the line, the key and what was expected, and nothing written.

use std::fs;

use crate::support::place::Place;

#[test]
fn a_case_that_is_no_text_is_refused() {
    let place = Place::healthy().with_bytes("case.toml", |b| *b = vec![0xff, 0xfe, 0x00, 0x80]);
    place.refuses(&["cannot read the case case.toml", "UTF-8"]);
    let place = Place::healthy().with_bytes("case.toml", |b| b.extend([0x1f, 0x8b, 0x08, 0x00]));
    place.refuses(&["cannot read the case case.toml", "UTF-8"]);
    let place = Place::healthy().with_bytes("case.toml", Vec::clear);
    let ran = place.plan();
    assert_eq!(ran.code, 2, "{}", ran.err);
    for key in [
        "`images.ct` is missing; expected",
        "`images.labels` is missing",
        "`structure` is missing",
        "`target` has none",
    ] {
        assert!(ran.err.contains(key), "{key}: {}", ran.err);
    }
    let place = Place::healthy();
    fs::remove_file(place.path("case.toml")).unwrap();
    place.refuses(&["cannot read the case case.toml", "No such file"]);
    fs::create_dir(place.path("case.toml")).unwrap();
    place.refuses(&["cannot read the case case.toml", "Is a directory"]);
}

#[test]
fn unknown_and_mistyped_keys_are_refused_by_line() {
    for (old, new, message) in [
        (
            "radius_mm = 1.5\nneck",
            "raduis_mm = 1.5\nneck",
            "unknown key `burr.raduis_mm`; did you mean `burr.radius_mm`?",
        ),
        (
            "radius_mm = 1.5\nneck",
            "radius = 1.5\nneck",
            "the unit is part of the name; expected `burr.radius_mm`, in mm",
        ),
        ("radius_mm = 1.5\nneck", "radius_m = 0.0015\nneck", "expected `burr.radius_mm`, in mm"),
        ("[path]", "[paht]", "unknown key `paht`; did you mean `path`?"),
        ("spin = -1", "spin = -1\ncolour = 3", "unknown key `burr.colour`"),
        ("label = 20", "labell = 20\nlabel = 20", "unknown key `target.labell`"),
        (
            "name = \"nerve\"",
            "name = \"nerve\"\nclearence_mm = 1",
            "did you mean `structure[0].clearance_mm`?",
        ),
        (
            "clearance_mm = 1.0",
            "clearance_mm = \"1 mm\"",
            "`structure[0].clearance_mm` is the text \"1 mm\"; expected a number in mm",
        ),
        ("layer_mm = 1.5", "layer_mm = [1.5]", "`path.layer_mm` is a list of 1; expected a number in mm"),
        ("spin = -1", "spin = 0", "`burr.spin` is the number 0; expected -1 or 1"),
        ("spacing_mm = 0.5", "spacing_mm = 0,5", "not valid TOML"),
    ] {
        let place = Place::healthy().with_case(old, new);
        let wrong = new.lines().find(|line| !old.contains(line)).unwrap();
        place.refuses(&[&place.line_of(wrong), message]);
    }
}

#[test]
fn absurd_numbers_are_refused_by_line_with_what_was_expected() {
    for (old, new, message) in [
        ("radius_mm = 1.5\nneck", "radius_mm = 0\nneck", "`burr.radius_mm` = 0: expected 0.2 to 10 mm"),
        ("radius_mm = 1.5\nneck", "radius_mm = -1.5\nneck", "`burr.radius_mm` = -1.5: expected 0.2 to 10 mm"),
        ("radius_mm = 1.5\nneck", "radius_mm = 0.0015\nneck", "looks like metres, which would be 1.5 here"),
        ("radius_mm = 1.5\nneck", "radius_mm = 1500\nneck", "looks like µm, which would be 1.5 here"),
        ("radius_mm = 1.5\nneck", "radius_mm = 25\nneck", "`burr.radius_mm` = 25: expected 0.2 to 10 mm"),
        ("radius_mm = 1.5\nneck", "radius_mm = nan\nneck", "`burr.radius_mm` = NaN is not a finite number"),
        ("radius_mm = 1.5\nneck", "radius_mm = inf\nneck", "`burr.radius_mm` = inf is not a finite number"),
        ("layer_mm = 1.5", "layer_mm = 0", "`path.layer_mm` = 0: expected 0.05 to 20 mm"),
        ("layer_mm = 1.5", "layer_mm = -1", "`path.layer_mm` = -1: expected 0.05 to 20 mm"),
        (
            "layer_mm = 1.5",
            "layer_mm = 4",
            "`path.layer_mm` = 4 mm: expected at most 3 mm, twice burr.radius_mm",
        ),
        ("layer_mm = 1.5", "layer_mm = 1500", "looks like µm"),
        ("step_mm = 0.5", "step_mm = 0", "`path.step_mm` = 0: expected 0.01 to 5 mm"),
        ("step_mm = 0.5", "stepover_mm = 0", "`path.stepover_mm` = 0: expected 0.05 to 20 mm"),
        ("min_mm_s = 0.5", "min_mm_s = 0", "`speed.min_mm_s` = 0: expected 0.01 to 1000 mm/s"),
        ("min_mm_s = 0.5", "max_mm_s = -4", "`speed.max_mm_s` = -4: expected 0.01 to 1000 mm/s"),
        ("min_mm_s = 0.5", "max_mm_s = 1e6", "`speed.max_mm_s` = 1000000: expected 0.01 to 1000 mm/s"),
        (
            "min_mm_s = 0.5",
            "min_mm_s = 5",
            "`speed.min_mm_s` = 5 mm/s: expected at most 4 mm/s, speed.max_mm_s",
        ),
        ("min_mm_s = 0.5", "total_time_s = 0", "`speed.total_time_s` = 0: expected 0.1 to 1000000 s"),
        ("spacing_mm = 0.5", "spacing_mm = 0", "`grid.spacing_mm` = 0: expected 0.02 to 2 mm"),
        (
            "spacing_mm = 0.5",
            "spacing_mm = 1.0",
            "`grid.spacing_mm` = 1 mm: expected at most 0.75 mm, half of burr.radius_mm",
        ),
        ("direction = [0.0, 0.0, 1.0]", "direction = [0, 0, 0]", "`approach.direction` is the zero vector"),
        (
            "direction = [0.0, 0.0, 1.0]",
            "direction = [0, 1]",
            "`approach.direction` has 2 entries; expected 3",
        ),
        (
            "clearance_mm = 1.0",
            "clearance_mm = -1.0",
            "`structure[0].clearance_mm` = -1: expected 0 to 50 mm",
        ),
        (
            "segments = [[25.0, 0.7]",
            "segments = [[25.0, 1.6]",
            "`shank.segments` = 1.6 mm: expected at most 1.5 mm",
        ),
        ("neck_radius_mm = 0.6", "neck_radius_mm = 2", "`burr.neck_radius_mm` = 2 mm: expected below 1.5 mm"),
        ("label = 20", "label = 0", "`target.label` is the number 0; expected a number from 1 to 65535"),
        ("label = 7", "label = 20 # too", "`structure[0].label` = 20 stands already in `target.label`"),
    ] {
        let place = Place::healthy().with_case(old, new);
        place.refuses(&[&place.line_of(new.lines().next().unwrap()), message]);
    }
}

#[test]
fn a_shank_thicker_than_the_burr_is_refused() {
    let place =
        Place::healthy().with_case("segments = [[25.0, 0.7], [60.0, 6.0]]", "segments = [[25.0, 3.0]]");
    place.refuses(&[&place.line_of("segments"), "`shank.segments` = 3 mm", "thicker than the burr"]);
}

#[test]
fn what_this_version_does_not_have_is_refused_by_line() {
    let place = Place::healthy().with_case("rate_hz = 100", "rate_hz = 100\nmodel = \"puma\"");
    let arms = "expected `bone-attached` or `ur3e` or `ur5e` or `ur10e` or `ur16e` or `ur20` or `ur30`, or the path of a .urdf file";
    place.refuses(&[&place.line_of("puma"), "`robot.model` = \"puma\"", arms]);
    let place = Place::healthy().with_case("rate_hz = 100", "rate_hz = 100\nmodel = \"UR5\"");
    place.refuses(&[&place.line_of("UR5"), "`robot.model` = \"UR5\"", arms, "did you mean `ur5e`?"]);
    let place = Place::healthy().with_case("rate_hz = 100", "rate_hz = 100\nmodel = \"puma.urdf\"");
    place.refuses(&[&place.line_of("puma"), "robot.model", "cannot read the URDF", "puma.urdf"]);
    let place =
        Place::healthy().with_case("min_mm_s = 0.5", "min_mm_s = 0.5\nmode = \"mass\"\nforce_n = 1.5");
    place.refuses(&[&place.line_of("force_n"), "speed.force_n", "speed.mode = \"force_limited\""]);
    let place = Place::healthy().with_case("[grid]", "[orientation]\nangles = 2\n\n[grid]");
    place.refuses(&[&place.line_of("angles = 2"), "orientation.angles", "one tilt"]);
    let place = Place::healthy().with_case("[grid]", "[cost]\nforce = \"deflection\"\n\n[grid]");
    place.refuses(&[
        &place.line_of("deflection"),
        "cost.force",
        "robot.joint_stiffness",
        "one value per joint",
    ]);
}

#[test]
fn a_grid_beyond_memory_is_refused_with_one_that_fits() {
    let place = Place::healthy().with_case("spacing_mm = 0.5\n", "spacing_mm = 0.02\n");
    place.refuses(&[
        &place.line_of("spacing_mm"),
        "grid.spacing_mm",
        "voxels",
        "planning would take about",
        "mm would fit",
    ]);
}
