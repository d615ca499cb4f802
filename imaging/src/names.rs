//! Names of labels, from a `labels.json` beside the label map.
//!
//! Both directions are accepted, `{"facial_nerve": 10}` and `{"10": "facial_nerve"}`, but only one of them in a file.
//! Names and numbers must each be unique, so that a name in a case means one label.

use std::fmt;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use serde::de::{Deserialize, Deserializer, MapAccess, Visitor};
use serde_json::Value;
use thiserror::Error;

use crate::error::ImageError;

/// Name of the file, which lies beside the label map.
const FILE_NAME: &str = "labels.json";

/// Names and numbers of a map's labels, one to one.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LabelNames {
    /// Ascending by number.
    entries: Vec<(u16, String)>,
}

/// What is wrong with a list of label names.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum LabelNamesProblem {
    /// The system cannot read it.
    #[error("cannot be read: {0}")]
    Unreadable(io::Error),
    /// It is not a JSON object.
    #[error("expected a JSON object such as {{\"facial_nerve\": 10}}: {0}")]
    Json(serde_json::Error),
    /// An entry is neither name and number nor number and name.
    #[error(
        "{key:?}: {value}: expected a name and a whole number 0 to 65535, as \"facial_nerve\": 10 or \"10\": \"facial_nerve\""
    )]
    Entry {
        /// The entry's key.
        key: String,
        /// The entry's value, as JSON.
        value: String,
    },
    /// Names come first in some entries and numbers in others.
    #[error(
        "{key:?} is the other way round than the entry before; expected names first or numbers first throughout"
    )]
    Mixed {
        /// The first entry that is the other way round.
        key: String,
    },
    /// A name occurs twice.
    #[error("the name {name:?} stands for both {first} and {second}; expected one number")]
    NameTwice {
        /// The name.
        name: String,
        /// One of its numbers.
        first: u16,
        /// The other.
        second: u16,
    },
    /// A number occurs twice.
    #[error("the label {number} is both {first:?} and {second:?}; expected one name")]
    NumberTwice {
        /// The number.
        number: u16,
        /// One of its names.
        first: String,
        /// The other.
        second: String,
    },
}

impl LabelNames {
    /// The number of `name`.
    pub fn number(&self, name: &str) -> Option<u16> {
        self.entries.iter().find(|(_, n)| n == name).map(|(number, _)| *number)
    }

    /// The name of label `number`.
    pub fn name(&self, number: u16) -> Option<&str> {
        let place = self.entries.binary_search_by_key(&number, |(n, _)| *n).ok()?;
        self.entries.get(place).map(|(_, name)| name.as_str())
    }

    /// All labels, ascending by number.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (u16, &str)> {
        self.entries.iter().map(|(number, name)| (*number, name.as_str()))
    }

    fn from_json(text: &str) -> Result<Self, LabelNamesProblem> {
        let Pairs(pairs) = serde_json::from_str(text).map_err(LabelNamesProblem::Json)?;
        let mut entries: Vec<(u16, String)> = Vec::with_capacity(pairs.len());
        let mut names_first = None;
        for (key, value) in pairs {
            let (number, name, name_first) = match (&value, key.parse::<u16>()) {
                (Value::String(name), Ok(number)) if !name.is_empty() => (number, name.clone(), false),
                (Value::Number(n), _) if !key.is_empty() => match n.as_u64().map(u16::try_from) {
                    Some(Ok(number)) => (number, key.clone(), true),
                    _ => return Err(LabelNamesProblem::Entry { key, value: value.to_string() }),
                },
                _ => return Err(LabelNamesProblem::Entry { key, value: value.to_string() }),
            };
            if *names_first.get_or_insert(name_first) != name_first {
                return Err(LabelNamesProblem::Mixed { key });
            }
            entries.push((number, name));
        }
        Self::new(entries)
    }

    /// Of numbers and names, in any order.
    ///
    /// # Errors
    /// [`LabelNamesProblem::NameTwice`] and [`LabelNamesProblem::NumberTwice`] for the first that is not unique.
    pub fn new(given: Vec<(u16, String)>) -> Result<Self, LabelNamesProblem> {
        let mut entries: Vec<(u16, String)> = Vec::with_capacity(given.len());
        for (number, name) in given {
            if let Some((first, _)) = entries.iter().find(|(_, n)| *n == name) {
                return Err(LabelNamesProblem::NameTwice { first: *first, second: number, name });
            }
            if let Some((_, first)) = entries.iter().find(|(n, _)| *n == number) {
                return Err(LabelNamesProblem::NumberTwice { number, first: first.clone(), second: name });
            }
            entries.push((number, name));
        }
        entries.sort_unstable_by_key(|(number, _)| *number);
        Ok(Self { entries })
    }
}

/// The file that holds the names of the label map `labels_path`, if it has names.
pub fn label_names_path(labels_path: impl AsRef<Path>) -> PathBuf {
    labels_path.as_ref().with_file_name(FILE_NAME)
}

/// The names in the file `path` ([`label_names_path`]), or none when there is no such file.
///
/// # Errors
/// [`ImageError::LabelNames`] when the file is there but cannot be used.
pub fn read_label_names(path: impl AsRef<Path>) -> Result<Option<LabelNames>, ImageError> {
    let path = path.as_ref();
    let failed = |problem| ImageError::LabelNames { path: path.to_owned(), problem };
    let text = match fs::read_to_string(path) {
        Ok(text) => text,
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err(failed(LabelNamesProblem::Unreadable(e))),
    };
    LabelNames::from_json(&text).map(Some).map_err(failed)
}

/// An object's entries in the file's order. A map would drop the first of two equal keys.
struct Pairs(Vec<(String, Value)>);

impl<'de> Deserialize<'de> for Pairs {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Collect;
        impl<'de> Visitor<'de> for Collect {
            type Value = Pairs;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("an object of names and numbers")
            }
            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Pairs, A::Error> {
                let mut pairs = Vec::new();
                while let Some(pair) = map.next_entry()? {
                    pairs.push(pair);
                }
                Ok(Pairs(pairs))
            }
        }
        deserializer.deserialize_map(Collect)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_directions_are_the_same_names() {
        let forth = LabelNames::from_json(r#"{"target": 20, "facial_nerve": 10}"#).unwrap();
        let back = LabelNames::from_json(r#"{"10": "facial_nerve", "20": "target"}"#).unwrap();
        assert_eq!(forth, back);
        assert_eq!((forth.number("target"), forth.name(10)), (Some(20), Some("facial_nerve")));
        assert_eq!((forth.number("dura"), forth.name(11)), (None, None));
        assert_eq!(forth.iter().collect::<Vec<_>>(), [(10, "facial_nerve"), (20, "target")]);
    }

    #[test]
    fn ambiguous_or_odd_lists_are_refused() {
        use LabelNamesProblem as P;
        let bad = |text: &str| LabelNames::from_json(text).unwrap_err();
        assert!(matches!(bad(r#"{"a": 1, "a": 2}"#), P::NameTwice { first: 1, second: 2, .. }));
        assert!(matches!(bad(r#"{"a": 1, "b": 1}"#), P::NumberTwice { number: 1, .. }));
        assert!(matches!(bad(r#"{"1": "a", "2": "a"}"#), P::NameTwice { .. }));
        assert!(matches!(bad(r#"{"a": 1, "2": "b"}"#), P::Mixed { .. }));
        for odd in [
            r#"{"a": 1.5}"#,
            r#"{"a": -1}"#,
            r#"{"a": 65536}"#,
            r#"{"a": "b"}"#,
            r#"{"a": [1]}"#,
            r#"{"": 1}"#,
            r#"{"1": ""}"#,
        ] {
            assert!(matches!(bad(odd), P::Entry { .. }), "{odd}");
        }
        for no_json in ["", "[1]", "{\"a\": 1", "7"] {
            assert!(matches!(bad(no_json), P::Json(_)), "{no_json}");
        }
    }

    #[test]
    fn the_file_lies_beside_the_map_and_may_be_missing() {
        let dir = tempfile::tempdir().unwrap();
        let map = dir.path().join("seg.nii.gz");
        let read = || read_label_names(label_names_path(&map));
        assert_eq!(read().unwrap(), None);
        fs::write(dir.path().join("labels.json"), r#"{"bone": 1}"#).unwrap();
        assert_eq!(read().unwrap().unwrap().number("bone"), Some(1));
        fs::write(dir.path().join("labels.json"), "{").unwrap();
        let message = read().unwrap_err().to_string();
        assert!(message.contains("labels.json"), "{message}");
    }
}
