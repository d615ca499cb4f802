//! `[[hold]]`: a distance to a structure at which a streamed plan waits for the user.
//!
//! The planner lays its path as without it; streaming stops before the burr comes nearer, draws the burr back and goes on
//! when the user says so, as monitoring a nerve needs.

use super::error::CaseFault;
use super::keys::{self as k, Unit};
use super::suggest::nearest;
use super::walker::Walk;
use super::{Case, Structure};

/// A place to hold.
#[derive(Debug, Clone, PartialEq)]
pub struct Hold {
    /// Name of a structure of the case.
    pub structure: String,
    /// Distance of the burr's surface to it, at least its clearance, mm.
    pub distance_mm: f64,
}

pub(super) fn read_holds(root: &Walk<'_, '_>) -> Vec<Hold> {
    let tables = root.has("hold").then(|| root.tables(&k::HOLD)).flatten().unwrap_or_default();
    tables.into_iter().map(read_hold).collect()
}

fn read_hold(t: Walk<'_, '_>) -> Hold {
    if !t.has("distance_mm") {
        let expected = "a distance of the burr's surface in mm".into();
        t.note("distance_mm", CaseFault::Missing { key: t.key("distance_mm"), expected });
    }
    let distance_mm = t.optional(&k::HOLD_DISTANCE).unwrap_or_default();
    let hold = Hold { structure: t.required_text(&k::HOLD_STRUCTURE), distance_mm };
    t.finish();
    hold
}

/// Notes holds at structures that the case lacks, at distances that the clearance rules out, and one place twice.
pub(super) fn judge_holds(case: &Case, note: &dyn Fn(CaseFault, &str)) {
    for (n, hold) in case.holds.iter().enumerate() {
        let key = format!("hold[{n}].structure");
        let names = || case.structures.iter().map(|s: &Structure| s.name.as_str());
        let Some(structure) = case.structures.iter().find(|s| s.name == hold.structure) else {
            let nearest = nearest(&hold.structure, names()).map(str::to_owned);
            let options = names().map(str::to_owned).collect();
            note(
                CaseFault::UnknownStructure {
                    key: key.clone(),
                    found: hold.structure.clone(),
                    options,
                    nearest,
                },
                &key,
            );
            continue;
        };
        if let Some(first) = case.holds.iter().take(n).position(|earlier| earlier == hold) {
            let found = format!("{:?} at {} mm", hold.structure, hold.distance_mm);
            note(CaseFault::Duplicate { key: key.clone(), found, other: format!("hold[{first}]") }, &key);
        }
        if hold.distance_mm < structure.clearance_mm {
            let key = format!("hold[{n}].distance_mm");
            let fault = CaseFault::Relation {
                key: key.clone(),
                found: hold.distance_mm,
                is_default: false,
                relation: "at least",
                limit: structure.clearance_mm,
                of: "the structure's clearance_mm: the burr never comes nearer",
                unit: Unit::Mm,
            };
            note(fault, &key);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    const TEXT: &str = "[images]\nct = \"c\"\nlabels = \"l\"\n[target]\nlabel = 1\n\
        [[structure]]\nname = \"facial_nerve\"\nlabel = 2\nclearance_mm = 1.0\n";

    fn parse(holds: &str) -> Result<Case, String> {
        Case::parse(&format!("{TEXT}{holds}"), Path::new("c.toml")).map_err(|e| e.to_string())
    }

    #[test]
    fn holds_are_read_and_written_back() {
        assert_eq!(parse("").unwrap().holds, []);
        let one = "[[hold]]\nstructure = \"facial_nerve\"\ndistance_mm = 2\n";
        let case = parse(&format!("{one}{}", one.replace("= 2", "= 1.5"))).unwrap();
        let expected = [2.0, 1.5].map(|distance_mm| Hold { structure: "facial_nerve".into(), distance_mm });
        assert_eq!(case.holds, expected);
        assert_eq!(Case::parse(&case.to_toml(), Path::new("again.toml")).unwrap(), case);
        assert!(!parse("").unwrap().to_toml().contains("hold"), "a case without holds is written as before");
    }

    #[test]
    fn what_no_arm_can_hold_at_is_refused_with_key_and_line() {
        let hold = |structure: &str, rest: &str| format!("[[hold]]\nstructure = \"{structure}\"\n{rest}");
        for (text, says) in [
            (
                hold("facial_nervee", "distance_mm = 2"),
                "c.toml:11: `hold[0].structure` = \"facial_nervee\": expected the name of a structure, `facial_nerve`; did you mean",
            ),
            (
                hold("facial_nerve", "distance_mm = 0.5"),
                "c.toml:12: `hold[0].distance_mm` = 0.5 mm: expected at least 1 mm",
            ),
            (hold("facial_nerve", "distance_mm = 9"), "`hold[0].distance_mm` = 9: expected 0 to 8 mm"),
            (hold("facial_nerve", "distance_mm = nan"), "not a finite number"),
            (hold("facial_nerve", ""), "`hold[0].distance_mm` is missing"),
            (hold("facial_nerve", "distance = 2"), "expected `hold[0].distance_mm`, in mm"),
            ("[[hold]]\ndistance_mm = 2".into(), "`hold[0].structure` is missing"),
            ("[hold]\ndistance_mm = 2".into(), "`hold` is a table; expected tables [[hold]]"),
            (hold("facial_nerve", "distance_mm = 2\n").repeat(2), "stands already in `hold[0]`"),
        ] {
            let said = parse(&text).unwrap_err();
            assert!(said.contains(says), "{text}: {said}");
        }
    }
}
