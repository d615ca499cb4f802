//! Fixed-point decimals by integer arithmetic: exact to the last digit, and several times faster than `{:.9}`.

/// Powers of ten that an i64 holds.
const POWERS: [u64; 19] = {
    let mut powers = [1u64; 19];
    let mut k = 1;
    while k < 19 {
        powers[k] = powers[k - 1] * 10;
        k += 1;
    }
    powers
};

/// Digits 00 to 99, two by two.
const PAIRS: [[u8; 2]; 100] = {
    let mut pairs = [[b'0'; 2]; 100];
    let mut k = 0;
    while k < 100 {
        pairs[k] = [b'0' + (k / 10) as u8, b'0' + (k % 10) as u8];
        k += 1;
    }
    pairs
};

/// Appends `units` · 10^−`decimals` without trailing zeros: "−0.5", "12", never "−0". `decimals` at most 18.
pub(super) fn push_units(out: &mut Vec<u8>, units: i64, decimals: u32) {
    if units < 0 {
        out.push(b'-');
    }
    let one = POWERS[decimals.min(18) as usize];
    let (whole, mut part) = (units.unsigned_abs() / one, units.unsigned_abs() % one);
    push_integer(out, whole);
    if part == 0 {
        return;
    }
    let mut digits = decimals as usize;
    while part.is_multiple_of(10) {
        part /= 10;
        digits -= 1;
    }
    let end = out.len() + 1 + digits;
    out.push(b'.');
    out.resize(end, b'0');
    fill_backwards(&mut out[end - digits..], part);
}

/// Appends a value to the nearest 10^−`decimals`; |value| below 9e18 · 10^−`decimals`, else the nearest such number.
pub(super) fn push_fixed(out: &mut Vec<u8>, value: f64, decimals: u32) {
    let scale = POWERS[decimals.min(18) as usize] as f64;
    push_units(out, (value * scale).round_ties_even() as i64, decimals);
}

fn push_integer(out: &mut Vec<u8>, value: u64) {
    let digits = value.checked_ilog10().map_or(1, |log| log as usize + 1);
    let start = out.len();
    out.resize(start + digits, b'0');
    fill_backwards(&mut out[start..], value);
}

/// Writes the digits of `value` to the end of `into`, which holds enough zeros.
fn fill_backwards(into: &mut [u8], mut value: u64) {
    let mut pairs = into.rchunks_exact_mut(2);
    for pair in &mut pairs {
        pair.copy_from_slice(&PAIRS[(value % 100) as usize]);
        value /= 100;
    }
    if let [digit] = pairs.into_remainder() {
        *digit = b'0' + (value % 10) as u8;
    }
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
