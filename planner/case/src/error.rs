//! What can be wrong with a case file, with the key, the line, what was found and what was expected.
//!
//! All faults of a file are reported together, so that a case is mended in one go. Relations between keys are only
//! judged once every key by itself is right.

use std::fmt;
use std::path::PathBuf;

use bonemill_cutting::cutter::CutterError;
use bonemill_geometry::NotARotation;
use bonemill_imaging::ImageError;
use thiserror::Error;

use super::keys::Unit;

/// The case file is not a case: everything that is wrong with it.
#[derive(Debug, Error)]
pub struct CaseError {
    /// The file as it was named.
    pub file: PathBuf,
    /// At least one, in the order of the file's tables.
    pub faults: Vec<Located>,
}

/// A fault and where it stands.
#[derive(Debug)]
pub struct Located {
    /// Line from 1; `None` when the key does not stand in the file.
    pub line: Option<usize>,
    /// What is wrong.
    pub fault: CaseFault,
}

impl fmt::Display for CaseError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (n, Located { line, fault }) in self.faults.iter().enumerate() {
            if n > 0 {
                writeln!(f)?;
            }
            match line {
                Some(line) => write!(f, "{}:{line}: {fault}", self.file.display())?,
                None => write!(f, "{}: {fault}", self.file.display())?,
            }
        }
        Ok(())
    }
}

/// One thing that is wrong with a case file. Keys are full paths such as `burr.radius_mm` or `structure[2].label`.
#[derive(Debug, Error)]
pub enum CaseFault {
    /// Not TOML.
    #[error("not valid TOML: {message}")]
    Syntax {
        /// The TOML parser's words.
        message: String,
    },
    /// A key that no case has.
    #[error("unknown key `{key}`{}", nearest_text(.nearest))]
    UnknownKey {
        /// The key.
        key: String,
        /// The known key that it resembles.
        nearest: Option<String>,
    },
    /// A known quantity under a name that ends in another unit, or in none.
    #[error("unknown key `{key}`: the unit is part of the name; expected `{expected}`, in {unit}")]
    WrongUnit {
        /// The key.
        key: String,
        /// The key with our unit.
        expected: String,
        /// Our unit.
        unit: Unit,
    },
    /// A key without default is absent.
    #[error("`{key}` is missing; expected {expected}")]
    Missing {
        /// The key.
        key: String,
        /// What it should hold.
        expected: String,
    },
    /// The value's type is wrong.
    #[error("`{key}` is {found}; expected {expected}")]
    WrongType {
        /// The key.
        key: String,
        /// The value as it stands in the file.
        found: String,
        /// What was expected.
        expected: String,
    },
    /// NaN or infinite.
    #[error("`{key}` = {found} is not a finite number")]
    NotFinite {
        /// The key.
        key: String,
        /// The value.
        found: f64,
    },
    /// A number outside of what is plausible.
    #[error("`{key}` = {found}: expected {min} to {max}{}{}", unit_text(.unit), looks_like_text(.looks_like))]
    OutOfRange {
        /// The key.
        key: String,
        /// The value.
        found: f64,
        /// Least plausible value.
        min: f64,
        /// Largest plausible value.
        max: f64,
        /// Unit of the three.
        unit: Unit,
        /// The unit in which the value would be plausible, and the value in ours.
        looks_like: Option<(&'static str, f64)>,
    },
    /// A word that is none of the choices.
    #[error("`{key}` = \"{found}\": expected {}{}", options_text(.options), nearest_text(.nearest))]
    NotOneOf {
        /// The key.
        key: String,
        /// The word.
        found: String,
        /// The choices.
        options: Vec<&'static str>,
        /// The choice that it resembles.
        nearest: Option<String>,
    },
    /// A name that no structure of the case has.
    #[error("`{key}` = {found:?}: expected the name of a structure, {}{}",
        options_text(&.options.iter().map(String::as_str).collect::<Vec<_>>()), nearest_text(.nearest))]
    UnknownStructure {
        /// The key.
        key: String,
        /// The name.
        found: String,
        /// The structures.
        options: Vec<String>,
        /// The one that it resembles.
        nearest: Option<String>,
    },
    /// Two numbers contradict each other.
    #[error("`{key}` = {found}{unit}{}: expected {relation} {limit}{unit}, {of}",
        if *.is_default { " (the default)" } else { "" }, unit = unit_text(.unit))]
    Relation {
        /// The key.
        key: String,
        /// Its value.
        found: f64,
        /// Whether the value is the default because the key is absent.
        is_default: bool,
        /// `at most`, `below`, `above`, …
        relation: &'static str,
        /// The limit.
        limit: f64,
        /// What the limit is.
        of: &'static str,
        /// Unit of both.
        unit: Unit,
    },
    /// A list has the wrong number of entries.
    #[error("`{key}` has {found} entries; expected {expected}")]
    Length {
        /// The key.
        key: String,
        /// Entries found.
        found: usize,
        /// Entries expected, in words.
        expected: String,
    },
    /// None or several of keys of which exactly one is needed.
    #[error("`{table}` has {}; expected exactly one of {}", found_text(.found), options_text(.options))]
    ExactlyOne {
        /// The table.
        table: String,
        /// Those that are there.
        found: Vec<&'static str>,
        /// The alternatives.
        options: Vec<&'static str>,
    },
    /// A direction of length zero.
    #[error("`{key}` is the zero vector; expected a direction in ct, pointing out of the bone")]
    ZeroDirection {
        /// The key.
        key: String,
    },
    /// A matrix that is no rotation.
    #[error("`{key}`: {problem}")]
    NotARotation {
        /// The key.
        key: String,
        /// How far from a rotation.
        problem: NotARotation,
    },
    /// A quaternion that is not of unit length.
    #[error("`{key}` has length {norm}; expected a unit quaternion [w, x, y, z], length 1 within 0.001")]
    NotAUnitQuaternion {
        /// The key.
        key: String,
        /// Its length.
        norm: f64,
    },
    /// Dimensions that no cutter has.
    #[error("`{table}`: {problem}")]
    Cutter {
        /// The tool's table.
        table: &'static str,
        /// What is wrong with it.
        problem: CutterError,
    },
    /// The density table is none.
    #[error("`density.hu` and `density.g_cm3`: {problem}")]
    DensityTable {
        /// What is wrong with it.
        problem: ImageError,
    },
    /// Two structures, or a structure and the target, are the same.
    #[error("`{key}` = {found} stands already in `{other}`")]
    Duplicate {
        /// The key.
        key: String,
        /// The value, as in the file.
        found: String,
        /// The key that holds it first.
        other: String,
    },
    /// Two structures have one label.
    #[error(
        "`{key}` = {label}: the structures {first:?} and {second:?} are the same label; give each a label of its own"
    )]
    SharedLabel {
        /// The key of the second.
        key: String,
        /// The label, as in the file.
        label: String,
        /// The structure that has it first.
        first: String,
        /// The other.
        second: String,
    },
    /// A robot that is neither an arm that is known nor a URDF's path.
    #[error("`{key}` = {found:?}: expected {}, or the path of a .urdf file{}", options_text(.options), nearest_text(.nearest))]
    UnknownArm {
        /// The key.
        key: String,
        /// The name.
        found: String,
        /// The arms that are known.
        options: Vec<&'static str>,
        /// The one that it resembles.
        nearest: Option<String>,
    },
    /// A name that a table of results cannot carry.
    #[error("`{key}` = {found:?}: expected a name without commas, quotes and control characters")]
    Name {
        /// The key.
        key: String,
        /// The name.
        found: String,
    },
    /// One choice rules out another.
    #[error("`{key}` cannot hold: {why}")]
    Contradiction {
        /// The key.
        key: String,
        /// What it contradicts, and what to do.
        why: &'static str,
    },
    /// Known, but not built yet.
    #[error("`{key}` is not supported yet; {instead}")]
    NotSupported {
        /// The key.
        key: String,
        /// What to do instead.
        instead: &'static str,
    },
}

fn nearest_text(nearest: &Option<String>) -> String {
    nearest.as_ref().map_or(String::new(), |n| format!("; did you mean `{n}`?"))
}

fn unit_text(unit: &Unit) -> String {
    if unit.is_none() { String::new() } else { format!(" {unit}") }
}

fn looks_like_text(looks_like: &Option<(&'static str, f64)>) -> String {
    looks_like
        .map_or(String::new(), |(name, ours)| format!("; it looks like {name}, which would be {ours} here"))
}

fn options_text(options: &[&str]) -> String {
    let quoted: Vec<_> = options.iter().map(|o| format!("`{o}`")).collect();
    quoted.join(" or ")
}

fn found_text(found: &[&str]) -> String {
    if found.is_empty() {
        return "none".into();
    }
    let quoted: Vec<_> = found.iter().map(|o| format!("`{o}`")).collect();
    quoted.join(" and ")
}
