//! What a series is called outside its header.
//!
//! A SeriesInstanceUID leads back to the patient in the hospital's archive, so it stays in the header: a series is named by the first
//! digits of its digest, in every list, key and file.

use std::fmt::Write;

use sha2::{Digest, Sha256};

/// Hexadecimal digits of a name.
const DIGITS: usize = 12;

/// The name of a series: the first 12 hexadecimal digits of its SeriesInstanceUID's SHA-256; such a name stays what it is. No UID
/// looks like one, since it has dots.
pub fn series_name(uid_or_name: &str) -> String {
    let is_digit = |c: char| c.is_ascii_digit() || ('a'..='f').contains(&c);
    if uid_or_name.len() == DIGITS && uid_or_name.chars().all(is_digit) {
        return uid_or_name.to_owned();
    }
    let mut name = String::new();
    for byte in Sha256::digest(uid_or_name.as_bytes()).iter().take(DIGITS / 2) {
        // writing to a string does not fail
        let _ = write!(name, "{byte:02x}");
    }
    name
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_the_beginning_of_the_uids_digest_and_its_own_name() {
        // printf 1.2.3.9 | sha256sum
        assert_eq!(series_name("1.2.3.9"), "902425018327");
        assert_eq!(series_name("902425018327"), "902425018327");
        assert_ne!(series_name("1.2.3.10"), series_name("1.2.3.1"));
    }
}
