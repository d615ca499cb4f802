//! A plan that removes too little of its target falls short. It states the causes for the rest in mm³ that add up, and what would
//! help; `verify` counts the share itself.

use std::fs;

use serde_json::Value;

use crate::support::body::{AIR_FROM, NERVE, TARGET};
use crate::support::place::Place;

/// Plans the case, which must fall short; returns its JSON and its shortfalls.
fn short(place: &Place) -> (Value, String) {
    let ran = place.run(&["plan", "case.toml", "--out", "plan", "--json"]);
    assert_eq!(ran.code, 1, "{}{}", ran.out, ran.err);
    let json: Value = serde_json::from_str(ran.out.lines().last().unwrap()).unwrap();
    let said = json["shortfalls"][0].as_str().unwrap().to_owned();
    assert!(
        said.starts_with("only ") && said.contains("% of the target is removed (target.least_share"),
        "{said}"
    );
    (json, said)
}

/// The volume of a cause, mm³.
fn kept(json: &Value, cause: &str) -> f64 {
    json["metrics"]["not_removed_mm3"][cause].as_f64().unwrap_or(0.0)
}

/// Checks that the causes add up to the volume that is not removed, in the order of their size, and that verify finds the share
/// too small.
fn adds_up(place: &Place, json: &Value) {
    let m = &json["metrics"];
    let parts: Vec<f64> =
        m["not_removed_mm3"].as_object().unwrap().values().map(|v| v.as_f64().unwrap()).collect();
    let whole = m["target_mm3"].as_f64().unwrap() + m["target_outside_mm3"].as_f64().unwrap();
    let removed = m["removed_mm3"].as_f64().unwrap();
    assert!((parts.iter().sum::<f64>() - (whole - removed)).abs() < 1e-9, "{parts:?} {whole} {removed}");
    assert!((m["removed_share"].as_f64().unwrap() - removed / whole).abs() < 1e-12);
    let report = fs::read_to_string(place.path("plan/report.html")).unwrap();
    assert!(report.contains("Why the rest of the target stays"));
    let ran = place.run(&["verify", "plan"]);
    assert_eq!(ran.code, 1, "{}{}", ran.out, ran.err);
    assert!(ran.out.contains("FAIL  removed of the target: 0."), "{}", ran.out);
    let known = ["plan meets its case", "removed of the target", "coverage"];
    let others =
        ran.out.lines().filter(|line| line.starts_with("FAIL  ") && !known.iter().any(|k| line.contains(k)));
    assert_eq!(others.count(), 0, "{}", ran.out);
}

#[test]
fn a_clearance_that_keeps_most_of_the_target_is_named_with_what_less_of_it_would_free() {
    let place = Place::healthy().with_case("clearance_mm = 1.0", "clearance_mm = 4.5");
    let (json, said) = short(&place);
    assert!(said.contains("mm³ by the clearance of nerve"), "{said}");
    assert!(said.contains("clearance_mm of nerve 4.5 -> 1 would let the burr reach "), "{said}");
    adds_up(&place, &json);
    // the stated gain equals the additional volume that a plan with that clearance can reach
    let reachable = |json: &Value| json["metrics"]["reachable_mm3"].as_f64().unwrap();
    let ran = Place::healthy().run(&["plan", "case.toml", "--out", "plan", "--json"]);
    let usual: Value = serde_json::from_str(ran.out.lines().last().unwrap()).unwrap();
    let freed = format!("reach {:.1} mm³ more", reachable(&usual) - reachable(&json));
    assert!(said.contains(&freed), "{said} {freed}");
}

#[test]
fn two_structures_that_both_keep_the_same_bone_share_it() {
    const VEIN: f32 = 8.0;
    let vein = "clearance_mm = 4.5\n[[structure]]\nname = \"vein\"\nlabel = 8\nclearance_mm = 4.5";
    let place = Place::healthy().with_labels(|labels| labels.fill([30..32, 8..14, 12..14], VEIN));
    let place = place.with_case("clearance_mm = 1.0", vein);
    let (json, said) = short(&place);
    adds_up(&place, &json);
    let [nerve, vein, both] = ["clearance of nerve", "clearance of vein", "several clearances at once"]
        .map(|cause| kept(&json, cause));
    assert!(nerve > 0.0 && vein > 0.0 && both > 0.0, "{said}");
    // without the vein the burr reaches the volume that only the vein blocked, and the volume that both blocked
    let place = Place::healthy().with_case("clearance_mm = 1.0", "clearance_mm = 4.5");
    let (alone, _) = short(&place);
    let reachable = |json: &Value| json["metrics"]["reachable_mm3"].as_f64().unwrap();
    let freed = reachable(&alone) - reachable(&json);
    assert!(freed >= vein - 1e-9 && freed <= vein + both, "{freed} {vein} {both}");
}

/// The patient with other targets, voxels of the image, in a block of bone.
fn with_targets(targets: &[[std::ops::Range<usize>; 3]]) -> Place {
    Place::healthy().with_labels(|labels| {
        labels.fill([0..40, 0..40, 0..AIR_FROM], 0.0);
        labels.fill([36..38, 24..36, 2..4], NERVE);
        targets.iter().for_each(|target| labels.fill(target.clone(), TARGET));
    })
}

#[test]
fn a_target_walled_in_by_other_bone_blames_that_bone_and_not_the_path() {
    // labels beside the open bone: most of the target is deep inside, and only a corner is open
    let place = with_targets(&[[12..30, 12..30, 4..12], [2..11, 2..11, 16..AIR_FROM]]);
    let (json, said) = short(&place);
    assert!(said.contains("kept are 324.0 mm³ by the bone around it that must stay"), "{said}");
    assert!(said.contains("100 % of the target is bone itself") && said.contains("affines"), "{said}");
    assert!(!said.contains("spacing is too wide"), "{said}");
    adds_up(&place, &json);
}

#[test]
fn a_slit_too_narrow_for_the_burr_blames_its_radius() {
    // 2 mm wide: a burr of 1.5 mm radius does not fit in, one of 0.75 mm does
    let place = with_targets(&[[4..8, 4..36, 16..AIR_FROM], [20..30, 10..20, 16..AIR_FROM]]);
    let (json, said) = short(&place);
    assert!(said.contains("mm³ by the burr's radius (corners, narrow places)"), "{said}");
    assert!(said.contains("burr.radius_mm 1.5 -> 0.75 would let the burr reach"), "{said}");
    assert!(kept(&json, "burr's radius (corners, narrow places)") > 50.0, "{said}");
    adds_up(&place, &json);
}

#[test]
fn a_case_that_asks_for_less_is_met() {
    let wide = || Place::healthy().with_case("clearance_mm = 1.0", "clearance_mm = 4.5");
    let place = wide().with_case("label = 20", "label = 20\nleast_share = 0.3");
    let ran = place.plan();
    assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
    wide()
        .with_case("label = 20", "label = 20\nleast_share = 80")
        .refuses(&["`target.least_share`", "0 to 1"]);
}
