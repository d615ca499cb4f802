//! Which keys a case's file gave. Every other value is a default, follows from others, or is chosen while planning.

use std::collections::BTreeSet;

/// Paths of the keys that stand in a case's file, e.g. `structure[2].label`.
///
/// They tell where values come from and are no part of what a case says: two cases with equal values are equal, whichever
/// of them spells out a default. So any two of these are equal.
#[derive(Debug, Clone, Default)]
pub struct Given(BTreeSet<String>);

impl PartialEq for Given {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl FromIterator<String> for Given {
    fn from_iter<I: IntoIterator<Item = String>>(keys: I) -> Self {
        Self(keys.into_iter().collect())
    }
}

impl Given {
    /// Whether a key stands in the file.
    pub fn holds(&self, key: &str) -> bool {
        self.0.contains(key)
    }

    /// The keys, sorted.
    pub fn keys(&self) -> impl Iterator<Item = &str> {
        self.0.iter().map(String::as_str)
    }
}
