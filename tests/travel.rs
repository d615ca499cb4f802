//! Plans that were moved: what each command can do without the plan's inputs, and how the inputs are given.

use std::fs;

use crate::support::place::Place;

/// A patient whose plan passes every check, because the shaft stays upright.
fn upright() -> Place {
    Place::healthy().with_case("[robot]\n", "[orientation]\nmode = \"fixed\"\n\n[robot]\n")
}

/// A planned patient whose plan is moved to an otherwise empty folder.
fn moved(plan: &[&str]) -> Place {
    let place = upright();
    let ran = place.run(&[&["plan", "case.toml", "--out", "plan"], plan].concat());
    assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
    fs::create_dir(place.path("sent")).unwrap();
    fs::rename(place.path("plan"), place.path("sent/plan")).unwrap();
    place
}

#[test]
fn a_moved_plan_carries_its_case_is_exported_alone_and_finds_its_images_where_it_is_told() {
    let place = moved(&[]);
    let case = |path: &str| fs::read(place.path(path)).unwrap();
    assert_eq!(case("sent/plan/case.toml"), case("case.toml"));
    let exported = |out: &str, more: &[&str]| {
        let ran = place
            .run(&[&["export", "sent/plan", "--unverified", "--format", "ros", "--out", out], more].concat());
        assert_eq!(ran.code, 0, "{}", ran.err);
        fs::read(place.path(out).join("plan.unverified.trajectory.json")).unwrap()
    };
    let bytes = exported("alone", &[]);
    assert!(bytes == exported("with", &["--inputs", "."]));
    for command in ["verify", "simulate"] {
        let ran = place.run(&[command, "sent/plan"]);
        ran.refused(&[
            "ct.nii",
            "labels.nii",
            "(SHA-256 ",
            "beside the plan's folder",
            "--inputs DIR",
            "--pack",
        ]);
        assert!(!ran.err.contains("case.toml"), "{}", ran.err);
        let ran = place.run(&[command, "sent/plan", "--inputs", "."]);
        assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
    }
    // inputs beside the plan are found without an option
    for image in ["ct.nii", "labels.nii"] {
        fs::rename(place.path(image), place.path("sent").join(image)).unwrap();
    }
    assert_eq!(place.run(&["verify", "sent/plan"]).code, 0);
    // an image that changed there is not accepted
    fs::write(place.path("sent/ct.nii"), "other").unwrap();
    place.run(&["simulate", "sent/plan"]).refused(&["ct.nii has changed"]);
}

#[test]
fn a_packed_plan_needs_nothing_else() {
    let place = moved(&["--pack"]);
    for gone in ["case.toml", "ct.nii", "labels.nii"] {
        fs::remove_file(place.path(gone)).unwrap();
    }
    for command in ["verify", "simulate"] {
        let ran = place.run(&[command, "sent/plan"]);
        assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
    }
    // the copies in the plan must not change either
    fs::write(place.path("sent/plan/inputs/labels.nii"), "other").unwrap();
    let ran = place.run(&["verify", "sent/plan"]);
    assert!(ran.code == 1 && ran.out.contains("inputs unchanged"), "{}{}", ran.out, ran.err);
    place
        .run(&["export", "sent/plan", "--unverified", "--format", "ros"])
        .refused(&["labels.nii has changed"]);
    // the case is planned again in its place
    fs::remove_dir_all(place.path("sent/plan/inputs")).unwrap();
    let place = Place::healthy();
    for _ in 0..2 {
        assert_eq!(place.run(&["plan", "case.toml", "--out", "plan", "--pack"]).code, 0);
    }
}
