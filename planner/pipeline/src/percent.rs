//! Shares as text, the same on the terminal and in the report.

/// A share of 0..1 in per cent, rounded down: what is written is never better than what is.
pub fn percent(share: f64) -> String {
    // a share that is a whole tenth of a per cent may have lost a last bit when it was computed
    format!("{:.1} %", (1e3 * share + 1e-9).floor() / 10.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_share_is_never_rounded_up() {
        for (share, text) in [
            (0.997_03, "99.7 %"),
            (0.998_99, "99.8 %"),
            (0.999_999, "99.9 %"),
            (0.29, "29.0 %"),
            (1.0, "100.0 %"),
            (0.0, "0.0 %"),
        ] {
            assert_eq!(percent(share), text);
        }
        assert!(
            (0..=1000).all(|n| percent(f64::from(n) / 1000.0) == format!("{:.1} %", f64::from(n) / 10.0))
        );
    }
}
