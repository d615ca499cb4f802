//! The values of a case or of a prosthesis' job one by one, each with its meaning and with where it comes from: for reports.

use std::fmt;

use super::keys::{self, Entry, Fallback, PRESET_KEYS};
use super::prosthesis::{self, ProsthesisJob};
use super::{Case, Given};

/// Where a value comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Origin {
    /// The key stands in the file.
    File,
    /// `preset = "paper"`.
    Preset,
    /// The default, with its source; `-` for none.
    Default(&'static str),
    /// It follows from other keys by a rule, with the rule's source.
    Derived(&'static str, &'static str),
    /// It is chosen while planning, by a rule.
    Chosen(&'static str),
}

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File => f.write_str("the file"),
            Self::Preset => f.write_str("preset \"paper\""),
            Self::Default("-") => f.write_str("default"),
            Self::Default(source) => write!(f, "default; {source}"),
            Self::Derived(rule, "-") => write!(f, "derived: {rule}"),
            Self::Derived(rule, source) => write!(f, "derived: {rule}; {source}"),
            Self::Chosen(rule) => write!(f, "chosen: {rule}"),
        }
    }
}

/// One key of a resolved file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Parameter {
    /// Full path; `structure[2].label` for what comes several times.
    pub key: String,
    /// As in the case file.
    pub value: String,
    /// What it is.
    pub meaning: &'static str,
    /// Where the value comes from.
    pub origin: Origin,
}

/// Every key of a case in the order of its file. Values that a plan chose are told as such where the case holds them although
/// its file does not.
pub fn explained(case: &Case) -> Vec<Parameter> {
    values(&case.to_toml(), &keys::case_entries(), &case.given, case.paper)
}

/// Every key of a prosthesis' job in the order of its file.
pub fn explained_job(job: &ProsthesisJob) -> Vec<Parameter> {
    values(&job.to_toml(), &prosthesis::entries(), &job.given, false)
}

/// The values that stand in a resolved file, one on a line; `given`: the keys of the user's own.
fn values(text: &str, entries: &[Entry], given: &Given, paper: bool) -> Vec<Parameter> {
    let (mut table, mut lists, mut found) = (String::new(), Vec::new(), Vec::new());
    for line in text.lines() {
        if let Some(name) = line.strip_prefix("[[").and_then(|l| l.strip_suffix("]]")) {
            table = format!("{name}[{}]", lists.iter().filter(|list| **list == name).count());
            lists.push(name);
        } else if let Some(name) = line.strip_prefix('[').and_then(|l| l.strip_suffix(']')) {
            name.clone_into(&mut table);
        } else if let Some((name, value)) = line.split_once(" = ") {
            let key = if table.is_empty() { name.to_owned() } else { format!("{table}.{name}") };
            let path = match key.split_once('[') {
                Some((head, rest)) => format!("{head}{}", rest.split_once(']').map_or("", |(_, tail)| tail)),
                None => key.clone(),
            };
            let entry = entries.iter().find(|e| e.path == path);
            let origin = match entry {
                _ if given.holds(&key) => Origin::File,
                Some(entry) => origin(entry, paper),
                None => Origin::Default("-"),
            };
            found.push(Parameter {
                value: value.to_owned(),
                meaning: entry.map_or("", |e| e.meaning),
                origin,
                key,
            });
        }
    }
    found
}

/// Where the value of a key comes from that its file does not give.
fn origin(entry: &Entry, paper: bool) -> Origin {
    match entry.fallback {
        _ if paper && PRESET_KEYS.contains(&entry.path) => Origin::Preset,
        Some(Fallback::Derived(rule)) => Origin::Derived(rule, entry.source),
        Some(Fallback::Chosen(rule)) => Origin::Chosen(rule),
        _ => Origin::Default(entry.source),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;
    use std::path::Path;

    const TEXT: &str = "[images]\nct = \"c\"\nlabels = \"l\"\n[target]\nlabel = 1\n[burr]\nradius_mm = 2.0\n\
        [[structure]]\nname = \"nerve\"\nlabel = 2\nclearance_mm = 1.0\n[[structure]]\nname = \"sinus\"\nlabel = 3\n";

    fn parse(text: &str) -> Case {
        Case::parse(text, Path::new("c.toml")).unwrap()
    }

    fn get(all: &[Parameter], key: &str) -> Parameter {
        all.iter().find(|p| p.key == key).unwrap_or_else(|| panic!("{key}")).clone()
    }

    #[test]
    fn values_come_from_the_case_by_presence_and_not_by_value() {
        let all = explained(&parse(TEXT));
        let origin = |key: &str| get(&all, key).origin;
        assert_eq!(
            (get(&all, "burr.radius_mm").value.as_str(), origin("burr.radius_mm")),
            ("2.0", Origin::File)
        );
        // given as what the default is
        assert_eq!(origin("structure[0].clearance_mm"), Origin::File);
        assert!(
            matches!(origin("structure[1].clearance_mm"), Origin::Default(source) if source.contains("assumed"))
        );
        assert_eq!(get(&all, "structure[1].name").value, "\"sinus\"");
        for key in ["burr.flutes", "density.hu", "speed.mode", "cost.alpha_max", "shank.segments"] {
            assert!(matches!(origin(key), Origin::Default(_)), "{key}: {}", origin(key));
        }
        for key in ["path.stepover_mm", "material.k_t", "orientation.angles", "structure[0].priority"] {
            assert!(matches!(origin(key), Origin::Derived(..)), "{key}: {}", origin(key));
        }
        assert!(
            origin("path.stepover_mm").to_string().starts_with("derived: 2/3 of burr.radius_mm; assumed")
        );
        assert!(all.iter().all(|p| !p.meaning.is_empty()), "{all:?}");
    }

    #[test]
    fn what_a_plan_chose_is_told_as_chosen_and_what_the_case_gives_is_not() {
        let fill = |text: &str| {
            let mut case = parse(text);
            (case.approach, case.path.raster_rad) = (Some(nalgebra::Vector3::z()), Some(0.5));
            explained(&case)
        };
        let all = fill(TEXT);
        let said = get(&all, "approach.direction").origin.to_string();
        assert_eq!(said, "chosen: the direction along which burr and shank reach most of the target");
        assert!(matches!(get(&all, "path.raster_deg").origin, Origin::Chosen(_)));
        let all = fill(&format!("{TEXT}[path]\nraster_deg = 1\n[approach]\ndirection = [0, 0, 1]\n"));
        for key in ["approach.direction", "path.raster_deg"] {
            assert_eq!(get(&all, key).origin, Origin::File, "{key}");
        }
    }

    #[test]
    fn the_preset_s_keys_are_those_whose_default_it_changes() {
        let explain = |text: &str| explained(&parse(text));
        let (plain, paper) = (explain(TEXT), explain(&format!("preset = \"paper\"\n{TEXT}")));
        let differ = plain.iter().zip(&paper).filter(|(a, b)| a.value != b.value).map(|(_, b)| b);
        let (preset, others): (Vec<_>, Vec<_>) = differ.partition(|p| p.origin == Origin::Preset);
        let preset: BTreeSet<&str> = preset.iter().map(|p| p.key.as_str()).collect();
        assert_eq!(preset, BTreeSet::from(PRESET_KEYS));
        for other in others {
            assert!(
                matches!(other.origin, Origin::File | Origin::Derived(..)),
                "{}: {}",
                other.key,
                other.origin
            );
        }
        // a key in the file wins
        let own = explain(&format!("preset = \"paper\"\n{TEXT}[cost]\nalpha_max = 0.5\n"));
        assert_eq!(get(&own, "cost.alpha_max").origin, Origin::File);
    }
}
