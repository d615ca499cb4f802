//! Forces toward several structures: each has its own direction, distance and figures.

use std::fs;

use crate::support::figures::figure;
use crate::support::{body, place::Place};
use bonemill_planner::plan::StoredPlan;
use nalgebra::Vector3;

/// A structure under the whole pocket, so near and with such a clearance that it has the least margin nearly everywhere.
const PLATE: &str =
    "[[structure]]\nname = \"plate\"\nlabel = 8\nclearance_mm = 1.0\n\n[[structure]]\nname = \"nerve\"\n";

fn with_plate() -> Place {
    let place = Place::healthy()
        .with_labels(|labels| labels.fill([8..30, 8..34, 10..12], 8.0))
        .with_case("clearance_mm = 1.0", "clearance_mm = 0.2")
        .with_case("[[structure]]\nname = \"nerve\"\n", PLATE);
    let ran = place.plan();
    assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
    place
}

/// Vector from a point to the nearest point of a box of labels, mm.
fn to_box(p: Vector3<f64>, voxels: [[usize; 2]; 3]) -> Vector3<f64> {
    Vector3::from_fn(|a, _| {
        let at = |voxel: usize| body::ORIGIN_MM[a] + (voxel as f64 - 0.5) * body::SPACING_MM;
        p[a].clamp(at(voxels[a][0]), at(voxels[a][1])) - p[a]
    })
}

#[test]
fn each_structure_has_its_own_forces_whichever_matters_most() {
    let place = with_plate();
    let plan = StoredPlan::load(&place.path("plan")).unwrap();
    let boxes = [[[8, 30], [8, 34], [10, 12]], [[30, 32], [24, 36], [12, 14]]];
    for (n, name) in ["plate", "nerve"].into_iter().enumerate() {
        let rows: Vec<_> = plan.forces.iter().filter(|f| f.structure == n).collect();
        assert!(rows.len() > plan.waypoints.len() / 2, "{name}: {} rows", rows.len());
        for f in &rows {
            let waypoint = &plan.waypoints[f.waypoint];
            let way = to_box(waypoint.position.coords, boxes[n]);
            assert!((way.norm() - f.distance_mm).abs() < 1e-9, "{name} at {}", f.waypoint);
            assert!((way.normalize() - f.toward).norm() < 1e-9, "{name} at {}", f.waypoint);
            assert!((waypoint.force_n.dot(&f.toward).max(0.0) - f.force_toward_n).abs() < 1e-12);
        }
        assert!(rows.iter().all(|f| f.peak_toward_n >= f.force_toward_n));
        let peak = rows.iter().map(|f| f.peak_toward_n).fold(0.0, f64::max);
        let said = |key| figure(&plan.record, &["structures", name, key]);
        assert_eq!(said("peak_force_toward_n"), peak);
        let there = rows.iter().find(|f| f.waypoint as f64 == said("peak_force_toward_waypoint")).unwrap();
        assert_eq!(there.peak_toward_n, peak);
        let least = plan.waypoints.iter().map(|w| to_box(w.position.coords, boxes[n]).norm());
        let least_mm = least.fold(f64::INFINITY, f64::min) - plan.record.case.burr.radius_mm;
        assert!((said("least_surface_distance_mm") - least_mm).abs() < 1e-9);
    }
    // where another structure has less margin, the force toward the nerve is no smaller
    let named = plan.waypoints.iter().filter(|w| w.structure == Some(1));
    let named = named.filter_map(|w| w.force_toward_n).fold(0.0, f64::max);
    let peak = figure(&plan.record, &["structures", "nerve", "peak_force_toward_n"]);
    assert!(peak > 2.0 * named.max(0.01), "{peak} N, {named} N where the nerve has the least margin");

    // report, verification under random errors and simulation have the same figures
    let page = fs::read_to_string(place.path("plan/report.html")).unwrap();
    assert!(page.contains(&format!("<td>{peak:.3}</td>")), "{peak}");
    let ran = place.run(&["verify", "plan", "--samples", "10", "--json"]);
    assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
    let found: serde_json::Value = serde_json::from_str(&ran.out).unwrap();
    let forces = found["risk"]["forces"].as_array().unwrap();
    let toward = forces.iter().find(|f| f["name"] == "peak toward nerve").unwrap();
    // reading JSON rounds numbers
    assert!((toward["planned_n"].as_f64().unwrap() - peak).abs() < 1e-12);
    let ran = place.run(&["simulate", "plan", "--json"]);
    let found: serde_json::Value = serde_json::from_str(&ran.out).unwrap();
    let simulated =
        found["figures"]["simulated_structures"]["nerve"]["peak_force_toward_n"].as_f64().unwrap();
    assert!(simulated > 0.5 * peak, "{simulated} N simulated, {peak} N planned");
}

#[test]
fn air_gives_no_force_and_no_empty_cell() {
    let place = Place::healthy();
    assert_eq!(place.plan().code, 0);
    let text = fs::read_to_string(place.path("plan/waypoints.csv")).unwrap();
    let mut in_air = 0;
    for line in text.lines().skip(1) {
        let cells: Vec<&str> = line.split(',').collect();
        let forces = cells[16..19].iter().chain(&cells[20..21]);
        let numbers: Vec<f64> = forces.map(|cell| cell.parse().unwrap()).collect();
        if cells[14] == "0.0" {
            in_air += 1;
            assert_eq!(numbers, [0.0; 4], "{line}");
        }
    }
    assert!(in_air > 5);
}

#[test]
fn the_plans_figures_are_those_compared_with_edge_forces_or_without() {
    for edges in ["", "[material]\nk_te = 0.5\nk_re = 0.2\n"] {
        let place = with_plate().with_case("[approach]\n", &format!("{edges}\n[approach]\n"));
        let ran = place.plan();
        assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
        let record = StoredPlan::load(&place.path("plan")).unwrap().record;
        let whole = ["mean_force_n", "peak_force_n"].map(|key| (vec![key], vec!["compared", "plan", key]));
        let near =
            ["mean_force_toward_n", "mean_force_toward_with_zeros_n", "peak_force_toward_n"].map(|key| {
                (vec!["structures", "plate", "near", key], vec!["compared", "plan", "near", "plate", key])
            });
        for (path, compared) in whole.into_iter().chain(near) {
            let [said, compared] = [path, compared].map(|path| figure(&record, &path));
            assert!((said - compared).abs() < 1e-9 && said > 0.0, "{edges}: {said} and {compared}");
        }
        // verify finds the same figures in the rows
        let verified = place.run(&["verify", "plan", "--all"]);
        let rows =
            verified.out.lines().filter(|line| line.contains("mean_force") && !line.contains("driven"));
        let failed: Vec<_> = rows.filter(|line| line.starts_with("FAIL")).collect();
        assert!(verified.out.contains("mean_force_n") && failed.is_empty(), "{failed:?}{}", verified.err);
    }
}
