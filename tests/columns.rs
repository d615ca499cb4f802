//! Every column and key of a plan's files is described, in the reference and in the report.

use std::collections::BTreeSet;
use std::fs;

use crate::support::place::Place;
use bonemill_planner::plan::columns::DESCRIBED;

/// The names that are described for a file or a table in it.
fn described(title: &str) -> Vec<&'static str> {
    let found =
        DESCRIBED.iter().find(|d| d.title == title).unwrap_or_else(|| panic!("{title} is not described"));
    found.columns.iter().map(|c| c.name).collect()
}

/// Whether a name in a file matches a description, in which a part in capitals or a star stands for any text.
fn matches(name: &str, pattern: &str) -> bool {
    let (mut parts, mut wanted) = (name.split('.'), pattern.split('.'));
    loop {
        match (parts.next(), wanted.next()) {
            (None, None) => return true,
            (Some(_), Some(any)) if any == "*" || any.chars().all(|c| c.is_ascii_uppercase()) => {}
            (Some(part), Some(word)) if part == word => {}
            _ => return false,
        }
    }
}

/// Every key of a table with its path; tables written as rigid motions count as one.
fn keys(before: &str, table: &toml::Table, found: &mut BTreeSet<String>) {
    for (key, value) in table {
        // a path as a key is one name, whatever dots are in it
        let path = format!("{before}{}", key.replace('.', "_"));
        match value {
            toml::Value::Table(below) if !below.contains_key("translation_mm") => {
                keys(&format!("{path}."), below, found)
            }
            toml::Value::Array(items) if items.iter().any(toml::Value::is_table) => {
                items.iter().for_each(|item| keys(&format!("{path}."), item.as_table().unwrap(), found));
            }
            _ => drop(found.insert(path)),
        }
    }
}

#[test]
fn every_column_and_key_that_is_written_is_described() {
    let place = Place::healthy().with_case("[robot]\n", "[orientation]\nmode = \"fixed\"\n\n[robot]\n");
    assert_eq!(place.plan().code, 0);
    for command in ["simulate", "verify"] {
        let ran = place.run(&[command, "plan"]);
        assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
    }
    let mut tables = 0;
    for entry in fs::read_dir(place.path("plan")).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap().to_owned();
        if !name.ends_with(".csv") {
            continue;
        }
        tables += 1;
        let text = fs::read_to_string(&path).unwrap();
        let header: Vec<&str> = text.lines().next().unwrap().split(',').collect();
        if name == "trajectory.csv" {
            assert_eq!((header[0], header[1], header[5]), ("time_s", "q1", "qd1"));
            assert_eq!(described(&name), ["time_s", "q1..n", "qd1..n"]);
        } else {
            assert_eq!(
                header,
                described(&name),
                "{name}: planner/planfile/src/columns/csv.rs describes other columns"
            );
        }
    }
    assert!(tables >= 5, "{tables}");
    let toml = |name: &str| -> toml::Table {
        fs::read_to_string(place.path("plan").join(name)).unwrap().parse().unwrap()
    };
    let mut plan = toml("plan.toml");
    plan.remove("case").unwrap();
    let mut parts = vec![("verification.toml".to_owned(), toml("verification.toml"))];
    for table in ["frames", "metrics", "modelled"] {
        let toml::Value::Table(below) = plan.remove(table).unwrap() else { panic!("{table} is no table") };
        parts.push((format!("plan.toml [{table}]"), below));
    }
    parts.push(("plan.toml".into(), plan));
    for (title, table) in parts {
        let mut found = BTreeSet::new();
        keys("", &table, &mut found);
        let known = described(&title);
        let unknown: Vec<_> = found.iter().filter(|name| !known.iter().any(|k| matches(name, k))).collect();
        assert!(
            unknown.is_empty(),
            "{title}: planner/planfile/src/columns/toml.rs does not describe {unknown:?}"
        );
    }
}

#[test]
fn every_key_of_a_channel_is_described() {
    let place = Place::empty();
    let ran = place.run(&["phantom", "--kind", "tibia", "--out", "bone"]);
    assert_eq!(ran.code, 0, "{}", ran.err);
    let case = fs::read_to_string(place.path("bone/case.toml")).unwrap();
    let entry = case.lines().find(|l| l.starts_with("entry_mm")).unwrap();
    let safest = case.replacen(entry, "direction = \"safest\"", 1);
    fs::write(place.path("bone/safest.toml"), safest).unwrap();
    // the target lies in the far soft tissue, beside which the vessel runs: a channel from the other side keeps more
    let ran = place.run(&["plan", "bone/safest.toml", "--out", "plan"]);
    assert!(ran.code < 2, "{}", ran.err);
    let plan: toml::Table = fs::read_to_string(place.path("plan/plan.toml")).unwrap().parse().unwrap();
    for table in ["metrics", "modelled"] {
        let mut found = BTreeSet::new();
        keys("", plan[table].as_table().unwrap(), &mut found);
        let title = format!("plan.toml [{table}]");
        let known = [described(&title), described(&format!("{title} of a channel"))].concat();
        let unknown: Vec<_> = found.iter().filter(|name| !known.iter().any(|k| matches(name, k))).collect();
        assert!(unknown.is_empty(), "{title} of a channel: {unknown:?} are not described");
    }
}

#[test]
fn the_report_and_the_command_say_what_the_columns_mean() {
    let place = Place::healthy();
    assert_eq!(place.plan().code, 0);
    let report = fs::read_to_string(place.path("plan/report.html")).unwrap();
    let printed = place.run(&["columns"]).out;
    assert!(report.contains("docs/columns.md") && report.contains("bonemill columns"));
    for part in [
        "Distance from the burr's centre to it; 0 inside.",
        "or as near to it as their speeds come",
        "z along the approach",
        "rad; mm for a prismatic joint",
    ] {
        assert!(report.contains(part), "{part} is not in the report");
        assert!(printed.contains(part), "{part} is not printed");
    }
    let described: usize = DESCRIBED.iter().map(|d| d.columns.len()).sum();
    assert!(described > 100 && report.matches("<details>").count() >= DESCRIBED.len());
}
