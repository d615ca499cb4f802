//! Where a line leaves the bone of a CT for good.

use bonemill_geometry::{Ct, Point, Volume};
use bonemill_imaging::AIR_HU;

use crate::clearance::Line;

/// Samples for each voxel that a line crosses.
const PER_VOXEL: f64 = 4.0;

/// How far along a line the bone ends, mm: beyond it no interpolated HU is at or above `bone_hu`. `None` where the line meets no
/// bone, or leaves the scan in bone.
///
/// Found between two samples a quarter of a voxel apart, by linear interpolation of the HU.
pub fn leaves_bone_mm(ct: &Volume<f32, Ct>, bone_hu: f64, line: &Line<'_>) -> Option<f64> {
    let step = ct.grid().spacing_mm().min() / PER_VOXEL;
    let count = (line.length_mm / step).ceil() as usize;
    let hu = |n: usize| ct.trilinear(line.from + line.along.as_ref() * (n as f64 * step), f64::from(AIR_HU));
    let is_in_scan = |p: Point<Ct>| ct.grid().nearest(p).is_some();
    let mut last_bone = None;
    for n in 0..=count {
        let p = line.from + line.along.as_ref() * (n as f64 * step);
        if !is_in_scan(p) {
            // the last place in the scan is bone: what comes then is not known
            let ends_in_bone = n > 0 && last_bone == Some(n - 1);
            return if ends_in_bone { None } else { last_bone.map(|n| crossing(n, &hu, bone_hu, step)) };
        }
        if hu(n) >= bone_hu {
            last_bone = Some(n);
        }
    }
    last_bone.map(|n| crossing(n, &hu, bone_hu, step))
}

/// Where between sample `n`, which is bone, and the next the HU falls to `bone_hu`, mm.
fn crossing(n: usize, hu: &impl Fn(usize) -> f64, bone_hu: f64, step: f64) -> f64 {
    let (here, next) = (hu(n), hu(n + 1));
    let share = if here > next { ((here - bone_hu) / (here - next)).clamp(0.0, 1.0) } else { 1.0 };
    (n as f64 + share) * step
}

#[cfg(test)]
mod tests {
    use super::*;
    use bonemill_geometry::Grid;
    use nalgebra::{Unit, Vector3};

    #[test]
    fn bone_ends_at_its_last_face_and_not_at_the_scan_s() {
        let grid = Grid::<Ct>::aligned([8, 8, 40], 0.5, Point::new(0.0, 0.0, 0.0)).unwrap();
        let mut ct = Volume::filled(grid, -1000f32);
        for n in 0..ct.data().len() {
            let [.., k] = ct.grid().voxel(n);
            // two slabs with air between
            if (4..10).contains(&k) || (20..30).contains(&k) {
                ct.data_mut()[n] = 1000.0;
            }
        }
        let up = Unit::new_unchecked(Vector3::z());
        let line = |z: f64| Line { from: Point::new(2.0, 2.0, z), along: &up, length_mm: 50.0 };
        let found = leaves_bone_mm(&ct, 0.0, &line(1.0)).unwrap();
        assert!((found + 1.0 - 14.75).abs() < 1e-9, "{found}");
        assert_eq!(leaves_bone_mm(&ct, 0.0, &line(16.0)), None);
        let down = Unit::new_unchecked(-Vector3::z());
        let line = Line { from: Point::new(2.0, 2.0, 8.0), along: &down, length_mm: 50.0 };
        assert!((leaves_bone_mm(&ct, 0.0, &line).unwrap() - (8.0 - 1.75)).abs() < 1e-9);
        ct.data_mut().iter_mut().for_each(|hu| *hu = 1000.0);
        assert_eq!(leaves_bone_mm(&ct, 0.0, &line), None);
    }
}
