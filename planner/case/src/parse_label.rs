//! Reads labels: a number or a name, of the label map or of a file of its own.

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

/// The keys that name a label.
pub(super) const LABEL_KEYS: [&str; 3] = ["label", "segment", "file"];

/// A label by number or name or its segment's name, of the label map or of a file; a file alone is a mask.
pub(super) fn read_segment(t: &Walk<'_, '_>, of: &Other) -> LabelRef {
    t.accept(&LABEL_KEYS);
    let named = match (t.has("label"), t.has("segment")) {
        (true, true) => {
            let options = vec!["label", "segment"];
            t.note("", CaseFault::ExactlyOne { table: t.path().into(), found: options.clone(), options });
            return LabelRef::Number(1);
        }
        (true, false) => Some(read_label(t, of)),
        (false, true) => Some(LabelRef::Name(t.text(&k::STRUCTURE_SEGMENT).unwrap_or_default())),
        (false, false) => None,
    };
    if !t.has("file") {
        return named.unwrap_or_else(|| read_label(t, of));
    }
    let path = t.text(&k::STRUCTURE_FILE).unwrap_or_default().into();
    LabelRef::File { path, label: named.map(Box::new) }
}
