//! Shares as text, the same on the terminal and in the report.

/// A share of 0..1 in per cent, rounded down: what is written is never better than what is.
pub fn percent(share: f64) -> String {
    // a share that is a whole tenth of a per cent may have lost a last bit when it was computed
    format!("{:.1} %", (1e3 * share + 1e-9).floor() / 10.0)
}

/// A share in per cent with one decimal, rounded to the nearest: for shares that no limit is compared with.
pub fn rounded_percent(share: f64) -> String {
    format!("{:.1} %", 100.0 * share)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_share_that_no_limit_concerns_is_rounded_to_the_nearest() {
        let told = [0.002_92, 0.000_8, 0.999_6, 0.0].map(rounded_percent);
        assert_eq!(told, ["0.3 %", "0.1 %", "100.0 %", "0.0 %"]);
    }

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
