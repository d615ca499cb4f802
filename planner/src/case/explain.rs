//! A case's values one by one, each with its meaning and with where it comes from: for reports.

use super::Case;
use super::keys::{self, Entry};

/// One key of a resolved case.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Parameter {
    /// Full path; `structure[2].label` for what comes several times.
    pub key: String,
    /// As in the case file.
    pub value: String,
    /// What it is.
    pub meaning: &'static str,
    /// Where the default comes from, when the value is the default; else the case gave it, or it follows from others.
    pub source: Option<&'static str>,
}

/// Every key of a case in the order of its file.
pub fn explained(case: &Case) -> Vec<Parameter> {
    let entries = keys::entries();
    let text = case.to_toml();
    let (mut table, mut structures, mut found) = (String::new(), 0usize, Vec::new());
    for line in text.lines() {
        if line == "[[structure]]" {
            table = format!("structure[{structures}]");
            structures += 1;
        } else if let Some(name) = line.strip_prefix('[').and_then(|l| l.strip_suffix(']')) {
            name.clone_into(&mut table);
        } else if let Some((name, value)) = line.split_once(" = ") {
            let key = if table.is_empty() { name.to_owned() } else { format!("{table}.{name}") };
            let path = match key.split_once('[') {
                Some((head, rest)) => format!("{head}{}", rest.split_once(']').map_or("", |(_, tail)| tail)),
                None => key.clone(),
            };
            let entry = entries.iter().find(|e| e.path == path);
            found.push(Parameter {
                value: value.to_owned(),
                meaning: entry.map_or("", |e| e.meaning),
                source: entry.filter(|e| is_default(e, value)).map(|e| e.source),
                key,
            });
        }
    }
    found
}

/// Whether a value is what an absent key would mean.
fn is_default(entry: &Entry, value: &str) -> bool {
    let numbers = |text: &str| -> Option<Vec<f64>> {
        text.split(['[', ']', ',', ' ']).filter(|t| !t.is_empty()).map(|t| t.parse().ok()).collect()
    };
    match (numbers(&entry.default), numbers(value)) {
        (Some(default), Some(value)) => default == value,
        _ => entry.default == value,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn defaults_have_their_source_and_given_values_have_none() {
        let text = "[images]\nct = \"c\"\nlabels = \"l\"\n[target]\nlabel = 1\n[burr]\nradius_mm = 2.0\n\
            [[structure]]\nname = \"nerve\"\nlabel = 2\nclearance_mm = 1.25\n[[structure]]\nname = \"sinus\"\nlabel = 3\n";
        let all = explained(&Case::parse(text, Path::new("c.toml")).unwrap());
        let get = |key: &str| all.iter().find(|p| p.key == key).unwrap_or_else(|| panic!("{key}"));
        assert_eq!((get("burr.radius_mm").value.as_str(), get("burr.radius_mm").source), ("2.0", None));
        assert!(get("burr.flutes").source.unwrap().contains("assumed"));
        assert!(get("density.hu").source.unwrap().contains("assumed"));
        assert!(get("speed.mode").source.is_some() && !get("speed.mode").meaning.is_empty());
        assert_eq!(get("structure[0].clearance_mm").source, None);
        assert!(get("structure[1].clearance_mm").source.is_some());
        assert_eq!(get("structure[1].name").value, "\"sinus\"");
        assert!(all.iter().all(|p| !p.meaning.is_empty()), "{all:?}");
    }
}
