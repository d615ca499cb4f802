//! A scan that ends too early: the part of the target beyond it counts neither as target nor as removed, and bone at the scan's
//! edge beside the target is reported.

use std::fs;
use std::ops::Range;

use serde_json::Value;

use crate::support::body::{self, DIMS, NERVE, TARGET};
use crate::support::image::Stored;
use crate::support::place::{Place, Ran};

/// The healthy patient in a scan of only these voxels along i and j, with complete labels.
fn scanned(is: Range<usize>, js: Range<usize>) -> Place {
    let place = Place::healthy();
    place.put_ct(&body::ct().cropped([is, js, 0..DIMS[2]]));
    place
}

/// The same with a bump of three target voxels at the first row beyond the scan: 3 of 1746.
fn with_a_bump() -> Place {
    let place = scanned(0..DIMS[0], 0..31);
    let mut labels = body::labels();
    labels.fill([12..15, 31..32, 19..20], TARGET);
    fs::write(place.path("labels.nii"), labels.bytes(Stored::Unsigned16)).unwrap();
    place
}

fn planned(place: &Place) -> (Ran, Value) {
    let ran = place.run(&["plan", "case.toml", "--out", "plan", "--json"]);
    let json = serde_json::from_str(ran.out.lines().last().unwrap_or("")).unwrap_or(Value::Null);
    (ran, json)
}

/// Texts of a list in a command's JSON.
fn texts(json: &Value, list: &str) -> String {
    json[list].as_array().unwrap().iter().map(|v| v.as_str().unwrap()).collect::<Vec<_>>().join("\n")
}

#[test]
fn a_target_of_which_two_thirds_lie_outside_is_refused_with_share_and_side() {
    // 1128 of 1743 voxels of the target lie at i > 15; a part of the nerve lies in the scan
    let place = scanned(0..16, 0..DIMS[1]).with_labels(|labels| labels.fill([2..4, 24..36, 12..14], NERVE));
    place.refuses(&[
        "`target`: 64.72 % of the target (141.0 mm³) lies outside the CT, beyond its right (R) side",
        "expected at most 5 %",
        "give a scan that holds the target, crop the target to the scan, or check both images' affines",
    ]);
}

#[test]
fn a_target_with_4_percent_outside_falls_short_and_a_plan_that_denies_it_is_caught() {
    // two rows of 5 × 7 voxels at j > 28: 70 of 1743 voxels
    let place = scanned(0..DIMS[0], 0..29);
    let (ran, json) = planned(&place);
    assert_eq!(ran.code, 1, "{}{}", ran.out, ran.err);
    let said = "4.02 % of the target (8.8 mm³) lies outside the CT, beyond its anterior (A) side";
    assert!(texts(&json, "shortfalls").contains(said), "{json}");
    let metric = |key: &str| json["metrics"][key].as_f64().unwrap();
    assert!((metric("target_outside_mm3") - 70.0 / 8.0).abs() < 1e-9);
    assert!((metric("target_mm3") - 1673.0 / 8.0).abs() < 1e-9);
    assert!(metric("removed_mm3") <= metric("target_mm3"));
    let report = fs::read_to_string(place.path("plan/report.html")).unwrap();
    assert!(report.contains(said) && report.contains("end of the scan"));

    // verify's own count agrees with the plan, and finds the target outside
    let checks = verified(&place);
    assert!(checks.contains("FAIL  target outside the scan: 0.04"), "{checks}");
    assert!(checks.contains("FAIL  plan meets its case: 1 > 0"), "{checks}");
    assert_eq!(checks.matches("FAIL").count(), 2, "{checks}");
    // and disagrees with a plan that states that there is none
    let plan = fs::read_to_string(place.path("plan/plan.toml")).unwrap();
    let denied = plan.replace("target_outside_mm3 = 8.75", "target_outside_mm3 = 0.0");
    assert_ne!(plan, denied);
    fs::write(place.path("plan/plan.toml"), denied).unwrap();
    let checks = verified(&place);
    assert!(checks.contains("FAIL  figures (target_outside_mm3)"), "{checks}");
}

#[test]
fn a_few_voxels_outside_are_a_warning() {
    let place = with_a_bump();
    let (ran, json) = planned(&place);
    assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
    let said =
        "0.17 % of the target (0.4 mm³) lies outside the CT, beyond its anterior (A) side: it counts neither";
    assert!(texts(&json, "warnings").contains(said), "{json}");
    let said = verified(&place);
    assert!(!said.contains("FAIL"), "{said}");
}

#[test]
fn bone_on_the_scans_edge_is_told_by_area_and_side() {
    // the target ends where the scan does: 7 × 5 of its voxels are at the face, with bone beside and below
    let (ran, json) = planned(&scanned(0..DIMS[0], 0..31));
    assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
    let mm2 = json["metrics"]["scan_edge_bone_mm2"].as_f64().unwrap();
    // within the burr's diameter of 3 mm, halfway between the planning grid's centres on either side of the face
    let target =
        || (11..27usize).flat_map(|i| (12..31usize).flat_map(move |j| (15..22usize).map(move |k| [i, j, k])));
    let target: Vec<_> = target().filter(|[i, j, k]| *j < 26 || (*i < 18 && *k > 16)).collect();
    let distance_mm = |i: usize, j: usize, k: usize| {
        let squared =
            |t: &[usize; 3]| t[0].abs_diff(i).pow(2) + t[1].abs_diff(j).pow(2) + t[2].abs_diff(k).pow(2);
        0.5 * (target.iter().map(squared).min().unwrap() as f64).sqrt()
    };
    let faces = (0..DIMS[0]).flat_map(|i| (0..body::AIR_FROM).map(move |k| (i, k)));
    let near = faces.filter(|(i, k)| 0.5 * (distance_mm(*i, 30, *k) + distance_mm(*i, 31, *k)) <= 3.0);
    assert_eq!(mm2, 0.25 * near.count() as f64);
    // a scan that ends farther away has no such bone
    let (ran, json) = planned(&Place::healthy());
    assert_eq!((ran.code, json["metrics"]["scan_edge_bone_mm2"].as_f64()), (0, Some(0.0)));
    assert!(!texts(&json, "warnings").contains("edge"), "{json}");
}

#[test]
fn a_chosen_approach_does_not_leave_the_scan_through_the_target() {
    // the scan ends beside the pocket, where the target itself would be the shortest way out
    let place = scanned(0..DIMS[0], 0..20).with_labels(|labels| {
        labels.fill([0..28, 20..40, 0..30], 0.0);
        labels.fill([30..32, 6..14, 12..14], NERVE);
    });
    let place = place.with_case("[approach]\ndirection = [0.0, 0.0, 1.0]\n", "");
    let (ran, _) = planned(&place);
    assert!(ran.code < 2, "{}{}", ran.out, ran.err);
    let plan = fs::read_to_string(place.path("plan/plan.toml")).unwrap();
    let line = plan.lines().find(|l| l.starts_with("approach_direction")).unwrap();
    let [x, y, z]: [f64; 3] = serde_json::from_str(line.split_once(" = ").unwrap().1).unwrap();
    assert!(z > 0.9 && y < 0.2, "{x} {y} {z}");
}

fn verified(place: &Place) -> String {
    let ran = place.run(&["verify", "plan"]);
    assert!(ran.code < 2, "{}{}", ran.out, ran.err);
    ran.out
}
