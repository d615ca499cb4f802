//! A number that is given in several places is the same in all: the command's text, its JSON, plan.toml, the report, verify.

use std::collections::BTreeMap;
use std::fs;

use crate::support::body::NERVE;
use crate::support::place::Place;
use bonemill_planner::plan::columns::DESCRIBED;
use bonemill_planner::report::percent;
use serde_json::Value;

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
        "removed {:.1} mm³ of the target's {:.1} mm³ ({removed}); of the {:.1} mm³ that the burr can reach {:.1} mm³ ({reached}); {:.0} s",
        number("removed_mm3"),
        number("target_mm3"),
        number("reachable_mm3"),
        object["metrics"]["removed_reachable"]["all_mm3"].as_f64().unwrap(),
        number("total_time_s"),
    );
    assert!(told.contains(&said), "{said}\n{told}");
    for share in [reached, removed] {
        assert!(report.contains(&format!("<b>{share}</b>")), "{share}");
    }
    let untargeted = format!(
        "by voxel centres: {:.1} mm³, {:.1} mm³ of it specks and sheets",
        number("untargeted_bone_by_voxels_mm3"),
        number("thin_bone_by_voxels_mm3")
    );
    assert!(report.contains(&untargeted), "{untargeted}");
    // the distance of the only structure: in the card, in the table and in plan.toml; its margin beside it
    let nerve = &object["metrics"]["structures"]["nerve"];
    let distance_mm = nerve["least_surface_distance_mm"].as_f64().unwrap();
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
        ["reached_share", "removed_share", "untargeted_bone_by_voxels_mm3", "removed_mm3", "total_time_s"]
    {
        check("figures", Some(subject));
    }
    let note = check("bone outside the target, by moves", None);
    let both = format!(
        "untargeted_bone_by_voxels_mm3 = {:.2}, counted at voxel centres 0.5 mm apart, {:.3} mm deep",
        number("untargeted_bone_by_voxels_mm3"),
        number("deepest_in_obstacle_mm")
    );
    assert!(note.contains(&both), "{both}\n{note}");
}

/// Every number of a table by its keys, joined by dots.
fn leaves(before: &str, value: &toml::Value, found: &mut BTreeMap<String, f64>) {
    match value {
        toml::Value::Float(v) => drop(found.insert(before.to_owned(), *v)),
        toml::Value::Integer(v) => drop(found.insert(before.to_owned(), *v as f64)),
        toml::Value::Table(entries) => {
            let dot = if before.is_empty() { "" } else { "." };
            entries.iter().for_each(|(key, v)| leaves(&format!("{before}{dot}{key}"), v, found));
        }
        _ => {}
    }
}

/// The same of a JSON object.
fn json_leaves(value: &Value) -> BTreeMap<String, f64> {
    let mut found = BTreeMap::new();
    let table = toml::Value::try_from(value).unwrap();
    leaves("", &table, &mut found);
    found
}

#[test]
fn a_name_has_one_figure_in_every_program_and_what_is_measured_otherwise_has_another_name() {
    // the nerve's wide part is so near that the burr pushes toward it within 2 mm
    let place = Place::healthy().with_labels(|labels| labels.fill([29..31, 16..24, 15..18], NERVE));
    assert_eq!(place.plan().code, 0);
    let record: toml::Table = fs::read_to_string(place.path("plan/plan.toml")).unwrap().parse().unwrap();
    let mut stated = BTreeMap::new();
    for table in ["modelled", "metrics"] {
        leaves("", &record[table], &mut stated);
    }
    let is_stated = |name: &str, value: f64| {
        stated.get(name).map(|stated| {
            assert!((value - stated).abs() <= 1e-12 * stated.abs(), "{name}: {value}, plan.toml {stated}");
        })
    };
    let json = |args: &[&str]| -> Value {
        let ran = place.run(args);
        assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
        serde_json::from_str(&ran.out).unwrap()
    };

    // a comparison repeats what is stated
    let mut repeated = 0;
    let compared = json(&["compare", "plan", "plan", "--json"]);
    for (group, figures) in compared["figures"].as_object().unwrap() {
        let within = group.strip_prefix("structure ").map_or(String::new(), |s| format!("structures.{s}."));
        for (name, values) in figures.as_object().unwrap() {
            repeated +=
                usize::from(is_stated(&format!("{within}{name}"), values[0].as_f64().unwrap()).is_some());
        }
    }
    assert!(repeated > 60, "{repeated}");

    // a simulation measures anew
    let simulated = json(&["simulate", "plan", "--json"]);
    let simulated = json_leaves(&simulated["figures"]);
    for (name, value) in &simulated {
        is_stated(name, *value);
        let known = DESCRIBED.iter().find(|d| d.title == "simulate --json, figures").unwrap().columns;
        let first = name.split('.').next().unwrap();
        assert!(known.iter().any(|c| c.name.split('.').next() == Some(first)), "{name} is not described");
    }
    let parts = ["sheet", "obstacle"].map(|kind| simulated[&format!("simulated_removed.{kind}.mm3")]);
    assert_eq!(simulated["untargeted_bone_by_parts_mm3"], parts[0] + parts[1]);

    // the verification names what it counts anew, and the planned forces are those of the plan
    let verified = json(&["verify", "plan", "--samples", "10", "--json"]);
    let checks = verified["checks"].as_array().unwrap();
    let noted = |name: &str| checks.iter().find(|c| c["name"] == name).unwrap()["note"].as_str().unwrap();
    assert!(noted("bone outside the target, by moves").starts_with("untargeted_bone_by_points_mm3 = "));
    let mut said = 0;
    for check in checks.iter().filter(|c| c["name"] == "figures") {
        let (subject, note) = (check["subject"].as_str().unwrap(), check["note"].as_str().unwrap());
        let value = note.strip_prefix("says ").and_then(|rest| rest.split(',').next()?.parse::<f64>().ok());
        if let (Some(value), Some(stated)) = (value, stated.get(subject)) {
            assert!((value - stated).abs() <= 5.1e-5, "{subject}: {note}, plan.toml {stated}");
            said += 1;
        }
    }
    assert!(said > 20, "{said}");
    for (force, name) in [
        ("peak", "peak_force_n"),
        ("mean", "mean_force_n"),
        ("peak toward nerve", "structures.nerve.peak_force_toward_n"),
    ] {
        let forces = verified["risk"]["forces"].as_array().unwrap();
        let found = forces.iter().find(|f| f["name"] == force).unwrap_or_else(|| panic!("no {force}"));
        let (planned_n, stated_n) = (found["planned_n"].as_f64().unwrap(), stated[name]);
        assert!((planned_n - stated_n).abs() <= 1e-9 * stated_n, "{force}: {planned_n}, {stated_n}");
    }

    // the report: each structure's figures in its table and beside the references, times, and shares of what stays
    let page = fs::read_to_string(place.path("plan/report.html")).unwrap();
    let nerve = |name: &str| stated[&format!("structures.nerve.{name}")];
    let least = format!("<th>nerve</th><td>1.00</td><td>{:.2}</td>", nerve("least_surface_distance_mm"));
    assert!(page.contains(&least), "{least}");
    let near = |name: &str| nerve(&format!("near.{name}"));
    for (words, name) in [
        ("mean", "mean_force_toward_n"),
        ("mean, with zeros", "mean_force_toward_with_zeros_n"),
        ("75th percentile", "p75_force_toward_n"),
        ("peak", "peak_force_toward_n"),
    ] {
        assert_eq!(near(name), stated[&format!("compared.plan.near.nerve.{name}")], "{name}");
        let row = page.split(&format!("<tr><th>nerve: {words}</th>")).nth(1).unwrap();
        let cells: Vec<&str> = row.split("</tr>").next().unwrap().split("</td>").collect();
        let plan = cells[cells.len() - 3];
        assert_eq!(plan, format!("<td>{:.3}", near(name)), "{words}");
    }
    assert_eq!(stated["mean_force_n"], stated["compared.plan.mean_force_n"]);
    assert_eq!(stated["peak_force_n"], stated["compared.plan.peak_force_n"]);
    assert!(page.contains("simulated force toward it") && page.contains("<th colspan=\"4\">force toward it"));
    let total_s = stated["total_time_s"];
    assert_eq!(total_s, stated["compared.plan.total_time_s"]);
    let whole_s = total_s.round() as u64;
    assert!(page.contains(&format!("<b>{} min {:02} s</b>", whole_s / 60, whole_s % 60)));
    assert!(page.contains(&format!("<th>this plan, {total_s:.0}&nbsp;s</th>")));
    for who in ["control_1", "control_2", "straight"] {
        let head = format!("°, {:.0}&nbsp;s</th>", stated[&format!("compared.{who}.total_time_s")]);
        assert!(page.contains(&head), "{head}");
    }
    let whole_mm3 = stated["target_mm3"] + stated["target_outside_mm3"];
    let stays = stated.iter().filter(|(name, _)| name.starts_with("not_removed_mm3."));
    for (name, mm3) in stays {
        let told = format!("<td>{mm3:.1}</td><td>{:.1} %</td>", 100.0 * mm3 / whole_mm3);
        assert!(page.contains(&told), "{name}: {told}");
    }
}

#[test]
fn references_that_cannot_take_the_plans_time_are_told_with_their_own() {
    let hurried = "[speed]\nmax_mm_s = 3.0\ntotal_time_s = 40\n";
    let place = Place::healthy().with_case("[speed]\n", hurried);
    assert_eq!(place.plan().code, 1);
    let record: toml::Table = fs::read_to_string(place.path("plan/plan.toml")).unwrap().parse().unwrap();
    let page = fs::read_to_string(place.path("plan/report.html")).unwrap();
    let time_s = |who: &str| record["metrics"]["compared"][who]["total_time_s"].as_float().unwrap();
    let plan_s = record["metrics"]["total_time_s"].as_float().unwrap();
    assert_eq!(time_s("plan"), plan_s);
    assert!(plan_s > 50.0 && (time_s("straight") - plan_s).abs() > 0.1, "{plan_s}, {}", time_s("straight"));
    for who in ["control_1", "control_2", "straight"] {
        assert!(page.contains(&format!("°, {:.0}&nbsp;s</th>", time_s(who))), "{who}: {} s", time_s(who));
    }
    assert!(page.contains("driven by the same arm each in the time that stands above it"));
    assert!(!page.contains("driven by the same arm in the plan's time"));
}
