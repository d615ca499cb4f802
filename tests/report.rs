//! The report lists the case's values and the origin of each.

use std::fs;

use crate::support::place::Place;

/// The cells of a key's row in the report's table of parameters: value, meaning, from.
#[track_caller]
fn row(report: &str, key: &str) -> Vec<String> {
    let start = format!("<tr><th><code>{key}</code></th><td>");
    let row = report.split(&start).nth(1).unwrap_or_else(|| panic!("no row for {key}")).split("</tr>").next();
    row.unwrap()
        .split("</td>")
        .map(|cell| cell.replace("<td>", "").replace("<code>", "").replace("</code>", ""))
        .collect()
}

#[test]
fn every_value_says_whether_the_case_gave_it_by_presence() {
    let place = Place::healthy().with_case("[approach]\ndirection = [0.0, 0.0, 1.0]\n", "");
    let ran = place.plan();
    assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
    // a later command adds to the page around the table
    place.run(&["verify", "plan"]);
    let report = fs::read_to_string(place.path("plan/report.html")).unwrap().replace("<wbr>", "");
    let from = |key: &str| row(&report, key)[2].clone();
    // keys given in the case; three of them equal the default
    for key in ["images.ct", "structure[0].clearance_mm", "burr.radius_mm", "burr.spin", "speed.min_mm_s"] {
        assert_eq!(from(key), "the file", "{key}");
    }
    for key in ["cost.alpha_max", "burr.flutes", "path.pattern", "registration.max_fre_mm"] {
        assert!(from(key).starts_with("default; "), "{key}: {}", from(key));
    }
    for key in ["material.k_t", "path.stepover_mm", "robot.jerk_limits"] {
        assert!(from(key).starts_with("derived: "), "{key}: {}", from(key));
    }
    assert_eq!(
        from("approach.direction"),
        "chosen: the direction along which burr and shank reach most of the target"
    );
    assert!(from("path.raster_deg").starts_with("chosen: "), "{}", from("path.raster_deg"));
    assert!(from("robot.base_from_ct").contains("assumed"), "{}", from("robot.base_from_ct"));
    let plan = fs::read_to_string(place.path("plan/plan.toml")).unwrap();
    let given = plan.lines().find(|line| line.starts_with("case_given = ")).unwrap();
    assert!(
        given.contains("\"burr.spin\"") && !given.contains("stepover") && !given.contains("approach"),
        "{given}"
    );
}
