//! Parses a line of `bonemill simulate --stream`: seven numbers. It is a separate file because the fuzz targets use it too.

/// The numbers `time_s x y z axis_x axis_y axis_z`, separated by blanks, tabs or commas.
pub fn numbers(line: &str) -> anyhow::Result<[f64; 7]> {
    let words = line.split([',', ' ', '\t']).filter(|word| !word.is_empty());
    let numbers: Vec<f64> = words
        .map(|word| match word.parse::<f64>() {
            Ok(v) if v.is_finite() => Ok(v),
            _ => Err(anyhow::anyhow!("{word:?}: expected a finite number")),
        })
        .collect::<Result<_, _>>()?;
    let found = numbers.len();
    <[f64; 7]>::try_from(numbers)
        .map_err(|_| anyhow::anyhow!("{found} numbers: expected time_s x y z axis_x axis_y axis_z"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_seven_numbers_between_blanks_or_commas() {
        assert_eq!(numbers("0.5 1 2,3\t0 0,1").unwrap(), [0.5, 1.0, 2.0, 3.0, 0.0, 0.0, 1.0]);
        for bad in ["", "1 2 3", "0 1 2 3 0 0 NaN", "0 1 2 3 0 0 inf", "0 1 2 3 0 0 1 9", "0 a 2 3 0 0 1"] {
            assert!(numbers(bad).is_err(), "{bad}");
        }
    }
}
