//! Fixed-point decimals by integer arithmetic: exact to the last digit.

use itoa::Buffer;

/// Appends `units` · 10^−`decimals` without trailing zeros: "−0.5", "12", never "−0". `decimals` at most 18.
pub(super) fn push_units(out: &mut Vec<u8>, units: i64, decimals: u32) {
    let one = 10u64.pow(decimals.min(18));
    let (whole, part) = (units.unsigned_abs() / one, units.unsigned_abs() % one);
    let mut digits = Buffer::new();
    if units < 0 {
        out.push(b'-');
    }
    out.extend_from_slice(digits.format(whole).as_bytes());
    if part > 0 {
        // one is added and its digit left out, which keeps the zeros before the part's digits
        let part = digits.format(one + part)[1..].trim_end_matches('0');
        out.push(b'.');
        out.extend_from_slice(part.as_bytes());
    }
}

/// Appends a value rounded to 10^−`decimals`. A |value| of 9e18 · 10^−`decimals` or more is clamped to that range.
pub(super) fn push_fixed(out: &mut Vec<u8>, value: f64, decimals: u32) {
    let scale = 10u64.pow(decimals.min(18)) as f64;
    push_units(out, (value * scale).round_ties_even() as i64, decimals);
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn text(value: f64, decimals: u32) -> String {
        let mut out = Vec::new();
        push_fixed(&mut out, value, decimals);
        String::from_utf8(out).unwrap()
    }

    #[test]
    fn trailing_zeros_and_a_negative_zero_are_left_out() {
        let cases = [
            (0.0, "0"),
            (-0.0, "0"),
            (-4e-10, "0"),
            (-0.5, "-0.5"),
            (12.0, "12"),
            (100.0, "100"),
            (-85.000000001, "-85.000000001"),
            (0.05, "0.05"),
            (1e-9, "0.000000001"),
            (0.999_999_999_9, "1"),
        ];
        for (value, expected) in cases {
            assert_eq!(text(value, 9), expected);
        }
        assert_eq!(text(3.7, 0), "4");
    }

    proptest! {
        #[test]
        fn reads_back_to_half_a_unit(value in -1e6f64..1e6, decimals in 0u32..10) {
            let read: f64 = text(value, decimals).parse().unwrap();
            prop_assert!((read - value).abs() <= 0.5 * 10f64.powi(-(decimals as i32)) * (1.0 + 1e-6) + 2e-10);
        }

        #[test]
        fn every_integer_is_exact(units in any::<i64>(), decimals in 0u32..19) {
            let mut out = Vec::new();
            push_units(&mut out, units, decimals);
            let text = String::from_utf8(out).unwrap();
            let (whole, part) = text.split_once('.').unwrap_or((&text, ""));
            let padded = format!("{whole}{part:0<width$}", width = decimals as usize);
            prop_assert_eq!(padded.parse::<i128>().unwrap(), i128::from(units));
        }
    }
}
