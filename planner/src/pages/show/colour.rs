//! Colours that can be told apart, also with a colour-vision deficiency.
//!
//! Structures, target, cuts, links and greys of the CT are drawn together. The distance of each pair in CIELAB is at least 45,
//! and at least 20 as seen without the red, green or blue cones (Machado et al. 2009); a difference of 2 is just visible. A
//! test computes these distances.

/// Colours of structures, in the case's order, repeated if there are more; the report uses them too.
pub const STRUCTURE_COLOURS: [[u8; 3]; 10] = [
    [210, 120, 0],
    [0, 165, 165],
    [240, 15, 255],
    [60, 15, 255],
    [210, 210, 105],
    [255, 180, 255],
    [120, 45, 165],
    [0, 240, 165],
    [150, 45, 90],
    [75, 90, 30],
];
/// The target in slices.
pub const TARGET_COLOUR: [u8; 3] = [165, 255, 0];
/// Moves that cut, in slices.
pub const CUT_COLOUR: [u8; 3] = [255, 30, 90];
/// Links and retracts in slices; drawn on a black line, so that they are visible on bright bone.
pub const LINK_COLOUR: [u8; 3] = [255, 255, 255];

/// A colour half-way to white, for text on a dark ground.
pub fn light(colour: [u8; 3]) -> [u8; 3] {
    colour.map(|c| c / 2 + 128)
}

/// A colour for style sheets.
pub fn css([r, g, b]: [u8; 3]) -> String {
    format!("rgb({r},{g},{b})")
}

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

    type Rgb = [f64; 3];

    fn times(m: &[Rgb; 3], v: Rgb) -> Rgb {
        std::array::from_fn(|row| (0..3).map(|n| m[row][n] * v[n]).sum())
    }

    /// Linear sRGB of a colour.
    fn linear(colour: [u8; 3]) -> Rgb {
        colour
            .map(|c| f64::from(c) / 255.0)
            .map(|c| if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) })
    }

    /// CIELAB under D65 of linear sRGB.
    fn lab(linear: Rgb) -> Rgb {
        const XYZ: [Rgb; 3] = [
            [0.4124564, 0.3575761, 0.1804375],
            [0.2126729, 0.7151522, 0.0721750],
            [0.0193339, 0.1191920, 0.9503041],
        ];
        const WHITE: Rgb = [0.95047, 1.0, 1.08883];
        let xyz = times(&XYZ, linear.map(|c| c.clamp(0.0, 1.0)));
        let [x, y, z] = std::array::from_fn(|n| {
            let share = xyz[n] / WHITE[n];
            if share > 216.0 / 24389.0 { share.cbrt() } else { (24389.0 / 27.0 * share + 16.0) / 116.0 }
        });
        [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
    }

    /// Maps of linear sRGB for normal vision, and without the red, green or blue cones (Machado, Oliveira and Fernandes 2009,
    /// table 1 at severity 1).
    const EYES: [[Rgb; 3]; 4] = [
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
        [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
    ];

    /// Distance in CIELAB for one of [`EYES`].
    fn apart(eyes: &[Rgb; 3], a: [u8; 3], b: [u8; 3]) -> f64 {
        let [a, b] = [a, b].map(|colour| lab(times(eyes, linear(colour))));
        (0..3).map(|n| (a[n] - b[n]).powi(2)).sum::<f64>().sqrt()
    }

    #[test]
    fn whatever_is_drawn_together_can_be_told_apart() {
        // checks the arithmetic: sRGB's blue in CIELAB, and the distance of black from white
        let blue = lab(linear([0, 0, 255]));
        assert!(
            (blue[0] - 32.30).abs() < 0.02
                && (blue[1] - 79.19).abs() < 0.02
                && (blue[2] + 107.86).abs() < 0.02
        );
        assert!((apart(&EYES[0], [0; 3], [255; 3]) - 100.0).abs() < 1e-3);
        let drawn = [&STRUCTURE_COLOURS[..], &[TARGET_COLOUR, CUT_COLOUR, LINK_COLOUR]].concat();
        for (n, a) in drawn.iter().enumerate() {
            for b in &drawn[..n] {
                for (eyes, least) in EYES.iter().zip([45.0, 20.0, 20.0, 20.0]) {
                    let found = apart(eyes, *a, *b);
                    assert!(found >= least, "{a:?} and {b:?} are {found:.1} apart, {least} expected");
                }
            }
            // the colours differ from the CT's greys; links have a black edge
            for grey in [60, 110, 160, 210].map(|v| [v; 3]) {
                let found = apart(&EYES[0], *a, grey);
                assert!(found >= 30.0 || *a == LINK_COLOUR, "{a:?} and {grey:?} are {found:.1} apart");
            }
        }
    }

    #[test]
    fn the_scale_runs_from_end_to_end() {
        assert_eq!([scale_colour(Some(0.0)), scale_colour(Some(1.0))], [[68, 1, 84], [253, 231, 37]]);
        assert_eq!([scale_colour(Some(-3.0)), scale_colour(Some(9.0))], [[68, 1, 84], [253, 231, 37]]);
        assert_eq!(scale_colour(Some(0.0625)), [70, 23, 103]);
        assert_eq!([scale_colour(None), scale_colour(Some(f64::NAN))], [[110; 3]; 2]);
    }
}
