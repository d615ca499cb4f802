//! Where a UR may stand: the place that is found can be planned from, and wrong patches are refused.

use std::fs;

use bonemill_planner::plan::StoredPlan;
use nalgebra::{Matrix3, Vector3};
use serde_json::Value;

use crate::support::place::Place;

const ARM: &str = "rate_hz = 100\nmodel = \"ur5e\"\n\
                   flange_from_burr = { translation_mm = [0, -90, 155], rpy_rad = [2.618, 0, 0] }";
const PATCH: [&str; 12] =
    ["stand", "case.toml", "--up", "0", "0", "1", "--from-mm", "-700", "-300", "-200", "--to-mm", "-300"];

fn stand(place: &Place, more: &[&str]) -> crate::support::place::Ran {
    place.run(&[&PATCH, more].concat())
}

#[test]
fn a_plan_from_the_place_that_is_found_reaches_everything() {
    let place = Place::healthy().with_case("rate_hz = 100", ARM);
    let before = fs::read(place.path("case.toml")).unwrap();
    let ran = stand(&place, &["300", "-200", "--step-mm", "200", "--map", "map.svg", "--json"]);
    assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
    let object: Value = serde_json::from_str(&ran.out).unwrap();
    let figures = &object["figures"];
    // 3 x 4 x 1 places
    assert_eq!(figures["places"], 12);
    let best = &figures["best"];
    let numbers = |value: &Value| -> Vec<f64> {
        value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
    };
    let (at, t) = (numbers(&best["from_target_mm"]), numbers(&best["base_from_ct"]["translation_mm"]));
    let rows: Vec<f64> =
        best["base_from_ct"]["rotation"].as_array().unwrap().iter().flat_map(numbers).collect();
    let (rotation, t) = (Matrix3::from_row_slice(&rows), Vector3::from_vec(t));
    // the base is upright, where it is said, and its x axis points below the target
    assert!((rotation * rotation.transpose() - Matrix3::identity()).norm() < 1e-12);
    assert!((rotation.transpose() * Vector3::z() - Vector3::z()).norm() < 1e-12);
    let target = rotation * (rotation.transpose() * -t + -Vector3::from_vec(at.clone())) + t;
    assert!(target.x > 0.0 && target.y.abs() < 1e-9 && (target.z + at[2]).abs() < 1e-9, "{target}");
    // nothing else than the map was written
    assert_eq!(fs::read(place.path("case.toml")).unwrap(), before);
    let map = fs::read_to_string(place.path("map.svg")).unwrap();
    assert_eq!(map.matches("<title>").count(), 12);
    assert!(map.contains("z = -200 mm") && map.contains("best"));
    // what is printed for people is a line of the case
    let told = stand(&place, &["300", "-200", "--step-mm", "200"]);
    let line = told.out.lines().find(|line| line.starts_with("base_from_ct = ")).unwrap();
    let place = place.with_case("rate_hz = 100", &format!("rate_hz = 100\n{line}"));
    let ran = place.plan();
    assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
    let plan = StoredPlan::load(&place.path("plan")).unwrap();
    assert!(plan.record.metrics.number("removed_share").unwrap() > 0.95);
    assert_eq!(place.run(&["verify", "plan"]).code, 0);
}

#[test]
fn a_place_inside_a_cabinet_is_none() {
    let place = Place::healthy().with_case("rate_hz = 100", ARM);
    let text = fs::read_to_string(place.path("case.toml")).unwrap();
    let cabinet = "[[obstacle]]\nname = \"cabinet\"\nframe = \"ct\"\nbox = { min_mm = [-900, -500, -900], max_mm = [-620, 500, 0] }\n";
    fs::write(place.path("case.toml"), format!("{text}\n{cabinet}")).unwrap();
    let ran = stand(&place, &["300", "-200", "--step-mm", "200", "--json"]);
    let object: Value = serde_json::from_str(&ran.out).unwrap();
    let figures = &object["figures"];
    // the places 700 mm before the target
    assert_eq!(figures["faults"]["the arm's base meets cabinet"], 4, "{figures}");
    assert!(figures["best"]["from_target_mm"][0].as_f64().unwrap() > -620.0, "{figures}");
    // where there is no other place, the figures and what to do are told
    let only = [
        "stand",
        "case.toml",
        "--up",
        "0",
        "0",
        "1",
        "--from-mm",
        "-700",
        "0",
        "-200",
        "--to-mm",
        "-700",
        "0",
        "-200",
    ];
    let ran = place.run(&only);
    let told = [
        "the arm's base meets cabinet (1, ",
        "mm short of robot.link_clearance_mm at best)",
        "robot.flange_from_burr",
    ];
    assert!(ran.code == 1 && told.iter().all(|part| ran.err.contains(part)), "{}", ran.err);
}

#[test]
fn a_patch_out_of_reach_falls_short_and_says_why() {
    let place = Place::healthy().with_case("rate_hz = 100", ARM);
    let far = [
        "stand",
        "case.toml",
        "--up",
        "0",
        "0",
        "1",
        "--from-mm",
        "1500",
        "0",
        "0",
        "--to-mm",
        "1600",
        "0",
        "0",
    ];
    let ran = place.run(&far);
    assert!(
        ran.code == 1 && ran.err.contains("the arm fits at none of 3 places: out of reach (3)"),
        "{}",
        ran.err
    );
}

#[test]
fn wrong_patches_arms_and_maps_are_refused() {
    let place = Place::healthy().with_case("rate_hz = 100", ARM);
    for (more, words) in [
        (&["-400", "-200"][..], "whose ends ascend along x, y and z"),
        (&["300", "-200", "--step-mm", "-5"], "a step above 0 mm"),
        (&["300", "-200", "--step-mm", "0.5"], "widen the step, or narrow the patch"),
        (&["300", "nan"], "--to-mm: expected three numbers, once"),
        (&["300", "-200", "--map", "case.toml"], "expected a file such as stand.svg"),
        (&["300", "-200", "--up", "0", "0", "0"], "--up: expected three numbers, once"),
    ] {
        let ran = stand(&place, more);
        assert!(ran.code == 2 && ran.err.contains(words), "{more:?}: {}", ran.err);
    }
    let ran = stand(&Place::healthy(), &["300", "-200"]);
    assert!(ran.code == 2 && ran.err.contains("expected a UR"), "{}", ran.err);
}
