//! The whole way from a CT to a verified plan, on both phantoms and on real scans.
//!
//! The temporal bones are planned on a coarser grid than their cases say, the real one as a preview, which takes two fifths of the time, by a
//! UR5e that stands where none is said and keeps its links from the tissue in the scan.
//! Real scans are searched in `BONEMILL_DATA`, or beside the workspace in `../shared/data`. If one is missing, the test prints
//! this and uses the others.

use std::fs;
use std::path::{Path, PathBuf};

use crate::support::place::Place;

/// Least removed share of the reachable part.
const ENOUGH: f64 = 0.99;

/// Checks that a plan is complete by its own figures, by the verifier's and by the simulation's.
fn goes_the_whole_way(place: &Place, plan: &[&str]) {
    let ran = place.run(&[&["plan", "--out", "plan", "--json"], plan].concat());
    assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
    let planned: serde_json::Value = serde_json::from_str(&ran.out).unwrap();
    let metric = |key: &str| planned["metrics"][key].as_f64().unwrap();
    let reached = metric("reached_share");
    assert!((ENOUGH..=1.0).contains(&reached), "{reached} of the reachable");
    assert!(metric("reachable_mm3") > 0.9 * metric("target_mm3"));
    let record: toml::Table = fs::read_to_string(place.path("plan/plan.toml")).unwrap().parse().unwrap();
    for structure in record["case"]["structure"].as_array().unwrap() {
        let name = structure["name"].as_str().unwrap();
        // a structure that the label map lacks has no least clearance
        if let Some(least) = planned["metrics"]["structures"][name]["least_surface_distance_mm"].as_f64() {
            let kept = structure["clearance_mm"].as_float().unwrap();
            assert!(least >= kept, "{name}: {least} mm, {kept} mm to be kept");
        }
    }
    let ran = place.run(&["verify", "plan"]);
    assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
    let ran = place.run(&["simulate", "plan", "--json"]);
    assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
    let simulated: serde_json::Value = serde_json::from_str(&ran.out).unwrap();
    let figures = &simulated["figures"];
    assert_eq!(figures["stopped_steps"], 0);
    assert_eq!(figures["simulated_removed"]["structure"]["mm3"].as_f64(), Some(0.0));
    // the planner removes whole voxels, the simulation parts of them
    let removed = figures["simulated_removed"]["bone"]["mm3"].as_f64().unwrap()
        + figures["simulated_removed"]["material"]["mm3"].as_f64().unwrap();
    assert!((removed / metric("removed_material_mm3") - 1.0).abs() < 0.02, "{removed} mm³");
}

/// A folder with a scan's images and this case, or `None` where the scan is absent.
fn scan(name: &str, case: Option<&Path>) -> Option<Place> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let data = std::env::var_os("BONEMILL_DATA").map_or_else(|| root.join("../shared/data"), PathBuf::from);
    let folder = data.join(name);
    if !folder.is_dir() {
        bonemill_geometry::testkit::skipped(format!("{} is absent (set BONEMILL_DATA)", folder.display()));
        return None;
    }
    let place = Place::empty();
    for file in fs::read_dir(&folder).unwrap() {
        let file = file.unwrap();
        fs::copy(file.path(), place.path(&file.file_name().to_string_lossy())).unwrap();
    }
    if let Some(case) = case {
        fs::copy(root.join(case), place.path("case.toml")).unwrap();
    }
    Some(place)
}

#[test]
fn the_foam_block() {
    goes_the_whole_way(&Place::empty(), &["--phantom", "block"]);
}

/// Gives a case's file voxels of 0.4 mm and waypoints 0.5 mm apart.
fn coarser(place: &Place, case: &str) {
    let text = fs::read_to_string(place.path(case)).unwrap();
    assert!(text.contains("\nspacing_mm = 0.25") && text.contains("\nstep_mm = 0.25"), "{text}");
    let coarse =
        text.replace("spacing_mm = 0.25", "spacing_mm = 0.4").replace("step_mm = 0.25", "step_mm = 0.5");
    fs::write(place.path(case), coarse).unwrap();
}

#[test]
fn the_procedural_mastoid() {
    let place = Place::empty();
    let made = place.run(&["phantom", "--kind", "temporal", "--out", "bone"]);
    assert_eq!(made.code, 0, "{}", made.err);
    coarser(&place, "bone/case.toml");
    goes_the_whole_way(&place, &["bone/case.toml"]);
}

#[test]
fn a_segmented_temporal_bone_by_a_ur_whose_place_is_assumed() {
    if let Some(place) = scan("tbone_RT143", None) {
        coarser(&place, "case.toml");
        let text = fs::read_to_string(place.path("case.toml")).unwrap();
        let robot = "model = \"ur5e\"\nflange_from_burr = { translation_mm = [0, -90, 155], rpy_rad = [2.618, 0, 0] }";
        let without_place = text.lines().filter(|line| !line.starts_with("base_from_ct"));
        let text = without_place.collect::<Vec<_>>().join("\n").replace("model = \"bone-attached\"", robot);
        assert!(text.contains(robot), "{text}");
        fs::write(place.path("case.toml"), text + "\n[accuracy]\nlevel = \"coarse\"\n").unwrap();
        goes_the_whole_way(&place, &["case.toml"]);
    }
}

#[test]
fn a_clinical_head() {
    if let Some(place) = scan("head_cranium0051", Some(Path::new("tests/data/head_frustum.toml"))) {
        goes_the_whole_way(&place, &["case.toml"]);
    }
}
