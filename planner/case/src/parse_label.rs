//! Reads labels: a number, or a name.

use toml::de::DeValue;

use super::LabelRef;
use super::error::CaseFault;
use super::keys as k;
use super::keys::Other;
use super::walker::{Walk, as_number};

/// A label by its number or name.
pub(super) fn read_label(t: &Walk<'_, '_>, of: &Other) -> LabelRef {
    let harmless = LabelRef::Number(1);
    match t.raw(of) {
        None => {
            t.refuse_missing(of);
            harmless
        }
        Some(DeValue::String(name)) if !name.trim().is_empty() => LabelRef::Name(name.to_string()),
        Some(value @ DeValue::Integer(_)) => {
            let number = as_number(value).filter(|n| (1.0..=f64::from(u16::MAX)).contains(n));
            number.map_or_else(
                || {
                    t.refuse(of, value);
                    harmless
                },
                |n| LabelRef::Number(n as u16),
            )
        }
        Some(value) => {
            t.refuse(of, value);
            harmless
        }
    }
}

/// A structure's label by number or name, its segment's name, or the file of its mask.
pub(super) fn read_segment(t: &Walk<'_, '_>) -> LabelRef {
    let options = vec!["label", "segment", "file"];
    let found: Vec<_> = options.iter().copied().filter(|o| t.has(o)).collect();
    match found.as_slice() {
        ["segment"] => LabelRef::Name(t.text(&k::STRUCTURE_SEGMENT).unwrap_or_default()),
        ["file"] => LabelRef::File(t.text(&k::STRUCTURE_FILE).unwrap_or_default().into()),
        [] | ["label"] => read_label(t, &k::STRUCTURE_LABEL),
        _ => {
            t.note("", CaseFault::ExactlyOne { table: t.path().into(), found, options });
            t.accept(&["label", "segment", "file"]);
            LabelRef::Number(1)
        }
    }
}
