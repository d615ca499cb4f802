//! The patient: a block of bone under air, a pocket to be milled from above, and a nerve beside it.
//!
//! It has 40 × 40 × 30 voxels of 0.5 mm, so that a plan takes a second without optimisation. It has no symmetry, so that a
//! mirrored plan is not the same plan.

use super::image::Image;

/// Voxels along i, j, k.
pub const DIMS: [usize; 3] = [40, 40, 30];
/// Side of a voxel, mm.
pub const SPACING_MM: f64 = 0.5;
/// Centre of voxel (0, 0, 0), mm.
pub const ORIGIN_MM: [f64; 3] = [-11.0, -8.0, 3.0];
/// First voxel of air along k: the block's upper face lies half a voxel below.
pub const AIR_FROM: usize = 22;
/// HU of air.
pub const AIR_HU: f32 = -1000.0;
/// The target's label.
pub const TARGET: f32 = 20.0;
/// The nerve's label.
pub const NERVE: f32 = 7.0;

/// Grey values: dense bone with some texture, air above.
pub fn ct() -> Image {
    let hu = |[i, j, k]: [usize; 3]| {
        if k >= AIR_FROM { AIR_HU } else { 1100.0 + ((7 * i + 13 * j + 5 * k) % 11) as f32 * 20.0 }
    };
    Image::new(DIMS, SPACING_MM, ORIGIN_MM, hu)
}

/// Labels: an L-shaped pocket that opens upwards, and a rod 1.5 mm beside it.
pub fn labels() -> Image {
    let mut labels = Image::new(DIMS, SPACING_MM, ORIGIN_MM, |_| 0.0);
    labels.fill([11..27, 12..26, 15..AIR_FROM], TARGET);
    labels.fill([11..18, 26..31, 17..AIR_FROM], TARGET);
    labels.fill([30..32, 24..36, 12..14], NERVE);
    labels
}

/// The case file; tests refer to its lines by their text.
pub const CASE: &str = "\
[images]
ct = \"ct.nii\"
labels = \"labels.nii\"

[target]
label = 20

[[structure]]
name = \"nerve\"
label = 7
clearance_mm = 1.0

[approach]
direction = [0.0, 0.0, 1.0]

[burr]
radius_mm = 1.5
neck_radius_mm = 0.6
spin = -1

[shank]
segments = [[25.0, 0.7], [60.0, 6.0]]

[path]
layer_mm = 1.5
step_mm = 0.5

[speed]
min_mm_s = 0.5

[robot]
rate_hz = 100

[grid]
spacing_mm = 0.5
";
