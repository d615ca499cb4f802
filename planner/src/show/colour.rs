//! Colours that people with colour-vision deficiencies can tell apart.

/// Colours of structures, in the case's order, round and round; the report's, too.
pub const STRUCTURE_COLOURS: [[u8; 3]; 10] = [
    [255, 221, 51],
    [255, 127, 39],
    [64, 196, 255],
    [90, 120, 255],
    [236, 96, 220],
    [188, 140, 255],
    [120, 220, 120],
    [255, 90, 90],
    [170, 170, 90],
    [90, 200, 190],
];

/// Nodes of viridis (van der Walt and Smith, matplotlib 1.5), from 0 to 1 in equal steps.
const VIRIDIS: [[f64; 3]; 9] = [
    [68.0, 1.0, 84.0],
    [71.0, 44.0, 122.0],
    [59.0, 81.0, 139.0],
    [44.0, 113.0, 142.0],
    [33.0, 144.0, 141.0],
    [39.0, 173.0, 129.0],
    [92.0, 200.0, 99.0],
    [170.0, 220.0, 50.0],
    [253.0, 231.0, 37.0],
];

/// The colour of a value from 0 (dark violet) to 1 (yellow); grey where there is none.
pub fn scale_colour(share: Option<f64>) -> [u8; 3] {
    let Some(share) = share.filter(|s| s.is_finite()) else { return [110, 110, 110] };
    let at = share.clamp(0.0, 1.0) * (VIRIDIS.len() - 1) as f64;
    let low = (at as usize).min(VIRIDIS.len() - 2);
    let part = at - low as f64;
    std::array::from_fn(|c| (VIRIDIS[low][c] * (1.0 - part) + VIRIDIS[low + 1][c] * part).round() as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scale_runs_from_end_to_end() {
        assert_eq!([scale_colour(Some(0.0)), scale_colour(Some(1.0))], [[68, 1, 84], [253, 231, 37]]);
        assert_eq!([scale_colour(Some(-3.0)), scale_colour(Some(9.0))], [[68, 1, 84], [253, 231, 37]]);
        assert_eq!(scale_colour(Some(0.0625)), [70, 23, 103]);
        assert_eq!([scale_colour(None), scale_colour(Some(f64::NAN))], [[110; 3]; 2]);
    }
}
