//! The report lists the case's values and the origin of each, and holds slices of the CT or none.

use std::fs;

use serde_json::Value;

use crate::support::body;
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

/// What a reader who knows the patient checks first: size, unit and sense of the images, volume and grey values of the bodies.
#[test]
fn the_head_tells_what_the_images_are_and_what_the_bodies_hold() {
    let place = Place::healthy();
    place.put_ct(&body::ct().stored_as([2, 0, 1], [true, false, false]));
    let ran = place.run(&["plan", "case.toml", "--out", "plan", "--json"]);
    assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
    let page = fs::read_to_string(place.path("plan/report.html")).unwrap();
    let row = |name: &str, cells: &[&str]| format!("<tr><th>{name}</th><td>{}</td>", cells.join("</td><td>"));
    let [voxel, pocket_mm3, nerve_mm3] = ["0.5 × 0.5 × 0.5", "217.9", "6.0"];
    for expected in [
        row("CT", &["30 × 40 × 40", voxel, "15.0 × 20.0 × 20.0", "IRA"]),
        row("labels", &["40 × 40 × 30", voxel, "20.0 × 20.0 × 15.0", "RAS"]),
        // of 1743 and 48 voxels
        row("target", &[pocket_mm3]),
        row("nerve", &[nerve_mm3]),
    ] {
        assert!(page.contains(&expected), "{expected}");
    }
    assert!(page.find("<h2>Images</h2>") < page.find("<summary>Terms on this page"), "at the head");
    let images = &serde_json::from_str::<Value>(&ran.out).unwrap()["images"];
    assert_eq!((&images["ct"]["axes"], &images["labels"]["axes"]), (&"IRA".into(), &"RAS".into()));
    for (n, volume_mm3) in [(0, 1743.0 / 8.0), (1, 6.0)] {
        let body = &images["bodies"][n];
        assert!((body["volume_mm3"].as_f64().unwrap() - volume_mm3).abs() < 1e-9, "{images}");
        // the bone's texture lies between
        assert!((1100.0..=1300.0).contains(&body["median_hu"].as_f64().unwrap()), "{images}");
    }
}

/// Without slices no picture is in the page, and only the page differs; a later command puts none in.
#[track_caller]
fn leaves_slices_out(place: &Place, arguments: &[&str]) {
    let plan = |out: &str, more: &[&str]| {
        let ran = place.run(&[&["plan", "--out", out], arguments, more].concat());
        assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
    };
    plan("with", &[]);
    plan("without", &["--no-slices"]);
    for folder in ["with", "without"] {
        for command in ["verify", "simulate"] {
            assert_eq!(place.run(&[command, folder]).code, 0, "{command} {folder}");
        }
    }
    let page = |folder: &str| fs::read_to_string(place.path(folder).join("report.html")).unwrap();
    let [with, without] = ["with", "without"].map(page);
    assert!(with.matches("<image ").count() >= 3 && with.matches("base64").count() >= 3);
    assert!(
        with.contains("grey values of the CT about the target")
            && with.contains("<code>--no-slices</code> leaves them out")
    );
    assert!(
        !without.contains("<image") && !without.contains("base64") && !without.contains("<img"),
        "a picture"
    );
    assert!(without.contains("holds no voxel of the scan"));
    assert!(with.contains("<h2>Images</h2>") && without.contains("<h2>Images</h2>"));
    // the drawn path is there all the same
    assert_eq!(
        with.matches("<figure class=\"slice\">").count(),
        without.matches("<figure class=\"slice\">").count()
    );
    for entry in fs::read_dir(place.path("with")).unwrap() {
        let name = entry.unwrap().file_name();
        // the verdict and its page tell times and digests of the page
        if ["csv", "urdf"].iter().any(|ending| name.to_string_lossy().ends_with(ending)) {
            let [a, b] = ["with", "without"].map(|f| fs::read(place.path(f).join(&name)).unwrap());
            assert!(a == b, "{name:?}");
        }
    }
}

#[test]
fn a_report_without_slices_holds_no_grey_values() {
    leaves_slices_out(&Place::healthy(), &["case.toml"]);
}

#[test]
fn a_channels_report_without_slices_holds_no_grey_values() {
    leaves_slices_out(&Place::empty(), &["--phantom", "tibia"]);
}
