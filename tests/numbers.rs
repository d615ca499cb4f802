//! A number that is given in several places is the same in all: the command's text, its JSON, plan.toml, the report, verify.

#![allow(clippy::unwrap_used, reason = "a test's helper fails by panicking")]

mod support;

use std::fs;

use bonemill_planner::report::percent;
use serde_json::Value;
use support::place::Place;

/// Whether a value of plan.toml equals that of the JSON object, up to the rounding of reading JSON.
fn is_same(toml: &toml::Value, json: &Value) -> bool {
    match toml {
        toml::Value::Float(v) => json.as_f64().is_some_and(|j| (j - v).abs() <= 1e-12 * v.abs()),
        toml::Value::Integer(v) => json.as_i64() == Some(*v),
        toml::Value::String(v) => json.as_str() == Some(v),
        toml::Value::Boolean(v) => json.as_bool() == Some(*v),
        toml::Value::Array(items) => items.iter().enumerate().all(|(n, v)| is_same(v, &json[n])),
        toml::Value::Table(entries) => entries.iter().all(|(key, v)| is_same(v, &json[key])),
        toml::Value::Datetime(_) => false,
    }
}

#[test]
fn a_number_is_the_same_wherever_it_stands() {
    let place = Place::healthy();
    let told = place.plan().out;
    let ran = place.run(&["plan", "case.toml", "--out", "plan", "--json"]);
    let object: Value = serde_json::from_str(&ran.out).unwrap();
    let record: toml::Table = fs::read_to_string(place.path("plan/plan.toml")).unwrap().parse().unwrap();
    let metrics = record["metrics"].as_table().unwrap();
    assert!(metrics.len() > 15);
    for (name, value) in metrics {
        assert!(is_same(value, &object["metrics"][name]), "{name}");
    }
    let number = |name: &str| object["metrics"][name].as_f64().unwrap();
    let report = fs::read_to_string(place.path("plan/report.html")).unwrap();
    let [reached, removed] = ["reached_share", "removed_share"].map(|name| percent(number(name)));
    let said = format!(
        "removed {:.1} mm³: {reached} of the {:.1} mm³ that the burr can reach, {removed} of the target's {:.1} mm³; {:.0} s",
        number("removed_mm3"),
        number("reachable_mm3"),
        number("target_mm3"),
        number("total_time_s"),
    );
    assert!(told.contains(&said), "{said}\n{told}");
    for share in [reached, removed] {
        assert!(report.contains(&format!("<b>{share}</b>")), "{share}");
    }
    let untargeted = format!(
        "{:.1} mm³ by voxel centres of the planning grid, {:.1} mm³ of it specks and bone thinner",
        number("untargeted_bone_removed_mm3"),
        number("thin_bone_removed_mm3")
    );
    assert!(report.contains(&untargeted), "{untargeted}");
    // the distance of the only structure: in the card, in the table and in plan.toml; its margin beside it
    let nerve = &object["metrics"]["structures"]["nerve"];
    let distance_mm = nerve["least_clearance_mm"].as_f64().unwrap();
    let clearance_mm = record["case"]["structure"][0]["clearance_mm"].as_float().unwrap();
    for (value_mm, label) in [
        (distance_mm, "smallest distance of the burr's surface from a structure"),
        (distance_mm - clearance_mm, "smallest margin (distance less clearance)"),
    ] {
        let card = format!("<b>{value_mm:.2} mm</b><span>{label}</span>");
        assert!(report.contains(&card), "{card}");
    }
    // verify counts the same, and reports where two methods differ
    let ran = place.run(&["verify", "plan", "--json"]);
    let verdict: Value = serde_json::from_str(&ran.out).unwrap();
    let checks = verdict["checks"].as_array().unwrap();
    let check = |name: &str, subject: Option<&str>| {
        let found = checks.iter().find(|c| c["name"] == name && subject.is_none_or(|s| c["subject"] == s));
        let found = found.unwrap_or_else(|| panic!("no check {name}"));
        assert_eq!(found["passed"], true, "{found}");
        found["note"].as_str().unwrap().to_owned()
    };
    for subject in
        ["reached_share", "removed_share", "untargeted_bone_removed_mm3", "removed_mm3", "total_time_s"]
    {
        check("figures", Some(subject));
    }
    let note = check("bone outside the target, by moves", None);
    let both = format!(
        "by voxel centres 0.5 mm apart the plan says {:.2} mm³ of both, {:.3} mm deep",
        number("untargeted_bone_removed_mm3"),
        number("deepest_in_obstacle_mm")
    );
    assert!(note.contains(&both), "{both}\n{note}");
}
