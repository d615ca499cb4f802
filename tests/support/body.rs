//! The patient: the testkit's pocket in bone, as images and a case file.

#[allow(unused_imports, reason = "every test program uses its own part of it")]
pub use bonemill_geometry::testkit::pocket::{AIR_FROM, AIR_HU, DIMS, ORIGIN_MM, SPACING_MM};
use bonemill_geometry::testkit::pocket::{hu, label};

use super::image::Image;

/// The target's label.
pub const TARGET: f32 = bonemill_geometry::testkit::pocket::TARGET as f32;
/// The nerve's label.
pub const NERVE: f32 = bonemill_geometry::testkit::pocket::ROD as f32;

/// Grey values.
pub fn ct() -> Image {
    Image::new(DIMS, SPACING_MM, ORIGIN_MM, hu)
}

/// Labels.
pub fn labels() -> Image {
    Image::new(DIMS, SPACING_MM, ORIGIN_MM, |voxel| f32::from(label(voxel)))
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
