//! The result of a verification: all checks, the files for which they are valid, and the text of `verification.toml`.

use std::fmt::Write;

use bonemill_case::write::text;
use bonemill_planfile::Sha256;

use super::check::{Check, LimitSide};
use super::images::SharedReader;
use super::requirements::SHORT;

/// The result of a verification.
#[derive(Debug, Clone, PartialEq)]
pub struct Verification {
    /// Every check, in the order in which they were made.
    pub checks: Vec<Check>,
    /// The files of the plan for which the result is valid, with their digests.
    pub files: Vec<(String, Sha256)>,
    /// Images that only the planner's reader can read: of these there is no second opinion.
    pub shared_readers: Vec<SharedReader>,
}

impl Verification {
    /// Whether every check passed.
    pub fn passed(&self) -> bool {
        self.checks.iter().all(Check::passed)
    }

    /// The checks that failed.
    pub fn failed(&self) -> impl Iterator<Item = &Check> {
        self.checks.iter().filter(|c| !c.passed())
    }

    /// The failed checks that show that something is wrong, not only that the plan falls short of its case.
    pub fn wrong(&self) -> impl Iterator<Item = &Check> {
        self.failed().filter(|c| !SHORT.contains(&c.name))
    }

    /// The contents of `verification.toml`. Nothing in it depends on the time or the place.
    pub fn to_toml(&self) -> String {
        let failed = self.failed().count();
        let mut out = format!(
            "# A second opinion on this plan, by bonemill. It holds for the files below and no others.\n\
             version = {}\npassed = {}\nchecks = {}\nfailed = {failed}\nshared_readers = [{}]\n\n[files]\n",
            text(env!("CARGO_PKG_VERSION")),
            failed == 0,
            self.checks.len(),
            self.shared_readers.iter().map(|r| text(&r.to_string())).collect::<Vec<_>>().join(", "),
        );
        for (name, digest) in &self.files {
            // writing to a String cannot fail
            let _ = writeln!(out, "{} = \"{digest}\"", text(name));
        }
        self.checks.iter().for_each(|check| push(&mut out, check));
        out
    }
}

fn push(out: &mut String, check: &Check) {
    let sense = match check.sense {
        LimitSide::AtMost => "at_most",
        LimitSide::AtLeast => "at_least",
    };
    let mut line = |key: &str, value: String| {
        let _ = writeln!(out, "{key} = {value}");
    };
    line("\n[[check]]\nname", text(check.name));
    if let Some(subject) = &check.subject {
        line("subject", text(subject));
    }
    line("passed", check.passed().to_string());
    line("value", number(check.value));
    line(sense, number(check.limit));
    line("margin", number(check.margin()));
    if !check.unit.is_empty() {
        line("unit", text(check.unit));
    }
    if let Some(place) = &check.place {
        line("place", text(&place.to_string()));
    }
    if !check.note.is_empty() {
        line("note", text(&check.note));
    }
}

/// A float in TOML; `inf` and `nan` are TOML's own words.
fn number(value: f64) -> String {
    if value.is_nan() { "nan".into() } else { format!("{:?}", value + 0.0) }
}

#[cfg(test)]
mod tests {
    use super::super::Place;
    use super::*;

    #[test]
    fn the_text_is_toml_and_says_it_all() {
        let checks = vec![
            Check::at_least("clearance of moves", 1.02, 1.0, "mm").of("a \"nerve\"").at(Place::Waypoint(3)),
            Check::at_most("joint jerk", f64::INFINITY, 2.0, "mm/s³").noting("why"),
            Check::at_most("joint range", f64::NAN, 0.0, "mm"),
        ];
        let digest = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad".parse().unwrap();
        let found =
            Verification { checks, files: vec![("plan.toml".into(), digest)], shared_readers: vec![] };
        assert!(!found.passed() && found.failed().count() == 2);
        let read: toml::Table = found.to_toml().parse().unwrap();
        assert_eq!(read["passed"].as_bool(), Some(false));
        assert_eq!(read["files"]["plan.toml"].as_str(), Some(digest.to_string().as_str()));
        let check = read["check"].as_array().unwrap();
        assert_eq!(check[0]["subject"].as_str(), Some("a \"nerve\""));
        assert_eq!(check[0]["place"].as_str(), Some("waypoint 3"));
        assert!((check[0]["margin"].as_float().unwrap() - 0.02).abs() < 1e-12);
        assert_eq!(check[1]["value"].as_float(), Some(f64::INFINITY));
        assert!(check[2]["value"].as_float().unwrap().is_nan());
    }
}
