//! Compares two plans of one patient, also when their inputs are missing.

use std::fs;

use crate::support::place::Place;

#[test]
fn two_plans_are_compared_by_their_own_files_alone() {
    let place = Place::healthy();
    let plan = |place: &Place, out: &str| {
        let ran = place.run(&["plan", "case.toml", "--out", out]);
        assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
    };
    plan(&place, "a");
    let place = place.with_case("clearance_mm = 1.0", "clearance_mm = 2.0");
    plan(&place, "b");
    // all inputs are removed
    for gone in ["case.toml", "ct.nii", "labels.nii"] {
        fs::remove_file(place.path(gone)).unwrap();
    }
    let ran = place.run(&["compare", "a", "b", "--json", "--out", "page.html"]);
    assert_eq!(ran.code, 0, "{}", ran.err);
    let object: serde_json::Value = serde_json::from_str(&ran.out).unwrap();
    assert_eq!(object["case"], serde_json::json!({ "structure.nerve.clearance_mm": ["1.0", "2.0"] }));
    assert_eq!(object["inputs"], serde_json::json!({}));
    let pair = |group: &str, name: &str| {
        let values = &object["figures"][group][name];
        [0, 1].map(|n| values[n].as_f64().unwrap_or_else(|| panic!("{group} {name}: {values}")))
    };
    let record = |dir: &str| -> toml::Table {
        fs::read_to_string(place.path(dir).join("plan.toml")).unwrap().parse().unwrap()
    };
    for (n, dir) in ["a", "b"].into_iter().enumerate() {
        let metrics = &record(dir)["metrics"];
        // reading JSON rounds numbers
        let same =
            |found: f64, stated: &toml::Value| (found / stated.as_float().unwrap() - 1.0).abs() < 1e-14;
        assert!(same(pair("volumes", "removed_mm3")[n], &metrics["removed_mm3"]));
        assert!(same(pair("times", "total_time_s")[n], &metrics["total_time_s"]));
        let nerve = &metrics["structures"]["nerve"];
        assert!(same(
            pair("structure nerve", "least_surface_distance_mm")[n],
            &nerve["least_surface_distance_mm"]
        ));
        assert!(
            pair("structure nerve", "peak_force_toward_n")[n]
                >= pair("structure nerve", "p75_force_toward_n")[n]
        );
    }
    // a larger clearance leaves more bone and a larger distance from the nerve
    let [a, b] = pair("volumes", "removed_mm3");
    assert!(b < a, "{a} {b}");
    let between = |name: &str| object["between"][name].as_f64().unwrap_or_else(|| panic!("{name}"));
    assert!(between("hausdorff_mm") > 0.3 && between("mean_distance_mm") < between("hausdorff_mm"));
    assert!(between("largest_angle_deg") >= between("mean_angle_deg"));
    assert!(
        between("swept_by_first_alone_mm3") > between("swept_by_second_alone_mm3"),
        "{}",
        object["between"]
    );
    assert!(between("swept_by_both_mm3") > 0.5 * b);
    let page = fs::read_to_string(place.path("page.html")).unwrap();
    for part in
        ["<code>structure.nerve.clearance_mm</code></th><td>1.0</td><td>2.0</td>", "<svg", "hausdorff_mm"]
    {
        assert!(page.contains(part), "{part} is not in {page}");
    }
    // the table for people; a plan compared with itself
    let short = place.run(&["compare", "a", "b"]).out;
    let (figures, rest) = short.split_once("keys of the cases that differ").unwrap();
    assert_eq!(figures.lines().count(), 1 + 12, "{short}");
    for row in [
        "target removed, %",
        "bone removed outside the target, by voxel centres, mm³",
        "time, s",
        "peak force, N",
        "least distance of the burr's surface from nerve, mm",
        "peak force toward nerve within 2 mm, N",
        "largest distance between the paths, mm",
    ] {
        assert_eq!(figures.lines().filter(|line| line.starts_with(row)).count(), 1, "{row}: {short}");
    }
    assert!(rest.contains("structure.nerve.clearance_mm") && rest.contains("--all"), "{short}");
    let table = place.run(&["compare", "a", "a", "--all"]).out;
    let hausdorff = table.lines().find(|line| line.contains("hausdorff_mm")).unwrap();
    assert!(hausdorff.ends_with(" 0") && !table.contains("keys of the cases that differ"), "{table}");
    place.run(&["compare", "a", "nowhere"]).refused(&["nowhere"]);
}
