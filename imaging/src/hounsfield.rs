//! Whether grey values can be Hounsfield units.
//!
//! Density comes from HU, so an 8-bit export or a scan stored as HU + 1024 would turn air into bone, silently. Air tells
//! them apart: a scan used for planning always contains some, because the burr comes from outside, and in HU only air is
//! far below 0. The rule, in this order:
//!
//! 1. If more than 1 % of the voxels are above 10 000, the values are not HU (metal reaches this, but in few voxels).
//! 2. If at least one voxel in 10 000 is between −1500 and −500, and at least one in 10 000 above −300, they are HU. The
//!    first is air, with the partial volume of small cells and the poor calibration of cone-beam scanners; below −1500
//!    is what scanners write outside their field of view, whatever their units. The second is anything but air.
//! 3. Otherwise they are not HU, and the error says what the range looks like.
//!
//! Bone is not required: the planner decides about a foam block or a soft specimen. The rule also refuses a crop of HU
//! values without any air, because its values cannot be told from shifted ones.

use std::fmt;

use bonemill_geometry::{Ct, Volume};

use crate::error::ImageError;

/// Values below this are air.
const AIR_HU: f32 = -500.0;
/// Values below this are padding, not grey values.
const PADDING_HU: f32 = -1500.0;
/// Values above this are not air.
const MATTER_HU: f32 = -300.0;
/// Values above this are metal, if they are few.
const METAL_HU: f32 = 10_000.0;
/// The least share of voxels of air, or of matter, that counts as more than noise.
const SHARE: f64 = 1e-4;
/// The largest share of voxels that can be metal.
const METAL_SHARE: f64 = 1e-2;

/// What grey values that are not HU look like.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum GreyKind {
    /// One value everywhere.
    Constant,
    /// Within 0..1 or −1..1.
    Normalized,
    /// Within 0..255 or −128..127.
    EightBit,
    /// Air near 0, water near 1000: an offset of 1000 or 1024 was not subtracted.
    Shifted,
    /// Values past what metal gives, or unsigned up to 16 bits.
    SixteenBit,
    /// All values are air.
    OnlyAir,
    /// There is no air, and nothing else tells what the values are.
    NoAir,
}

impl fmt::Display for GreyKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Constant => "Every voxel has the same value: the scan is empty",
            Self::Normalized => "It looks normalised to 0..1 or -1..1: export the scan again without rescaling",
            Self::EightBit => "It looks like 8-bit grey values: export the scan again without windowing",
            Self::Shifted => {
                "It looks like HU + 1024 (or + 1000): set scl_inter or subtract the offset; if it truly is in HU, \
                 it shows no air at all, and a larger part of the scan is needed"
            }
            Self::SixteenBit => "It looks like raw 16-bit values: convert them to HU",
            Self::OnlyAir => "It holds air alone",
            Self::NoAir => "It holds no air: an MRI, a density map, or a part of the scan that is too small",
        })
    }
}

/// The distribution of grey values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GreyRange {
    /// Smallest value.
    pub min: f32,
    /// Largest value.
    pub max: f32,
    /// The values that 1 %, 50 % and 99 % of the voxels do not exceed (of an even sample of at most 2¹⁶ voxels).
    pub percentiles: [f32; 3],
}

impl fmt::Display for GreyRange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [p1, p50, p99] = self.percentiles;
        write!(f, "from {} to {}, 1 % below {p1}, half below {p50}, 99 % below {p99}", self.min, self.max)
    }
}

/// Refuses a scan whose grey values cannot be HU, by the module's rule.
///
/// # Errors
/// [`ImageError::NotHounsfield`] says what they look like.
pub fn looks_like_hu(ct: &Volume<f32, Ct>) -> Result<(), ImageError> {
    let values = ct.data();
    let share = |is: fn(f32) -> bool| values.iter().filter(|v| is(**v)).count() as f64 / values.len() as f64;
    let air = share(|v| (PADDING_HU..AIR_HU).contains(&v));
    let matter = share(|v| v > MATTER_HU);
    let metal = share(|v| v > METAL_HU);
    if air >= SHARE && matter >= SHARE && metal <= METAL_SHARE {
        return Ok(());
    }
    let range = range(values);
    let least = values.iter().copied().filter(|v| *v >= PADDING_HU).fold(f32::INFINITY, f32::min);
    Err(ImageError::NotHounsfield { kind: kind(&range, least, air, metal), range })
}

/// Replaces what scanners write outside their field of view, values below −1500, by air; how many voxels.
///
/// It is done after [`looks_like_hu`], which does not take such values for air.
pub fn padding_to_air(ct: &mut Volume<f32, Ct>) -> usize {
    let padding = ct.data_mut().iter_mut().filter(|v| **v < PADDING_HU);
    padding.map(|v| *v = crate::resample::AIR_HU).count()
}

/// What the values look like; `least` is the smallest value that is not padding.
fn kind(range: &GreyRange, least: f32, air: f64, metal: f64) -> GreyKind {
    let within = |lo, hi| range.min >= lo && range.max <= hi;
    let [_, _, p99] = range.percentiles;
    if range.min == range.max {
        GreyKind::Constant
    } else if within(-1.0, 1.0) {
        GreyKind::Normalized
    } else if within(0.0, 255.0) || within(-128.0, 127.0) {
        GreyKind::EightBit
    } else if metal > METAL_SHARE {
        GreyKind::SixteenBit
    } else if air >= SHARE {
        GreyKind::OnlyAir
    // noise about air at 0 stays well above -500; water lies at 1000 or 1024
    } else if least > AIR_HU && least <= 400.0 && p99 >= 900.0 {
        GreyKind::Shifted
    } else {
        GreyKind::NoAir
    }
}

fn range(values: &[f32]) -> GreyRange {
    let min = values.iter().copied().fold(f32::INFINITY, f32::min);
    let max = values.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let mut sample: Vec<f32> =
        values.iter().copied().step_by(values.len().div_ceil(1 << 16).max(1)).collect();
    sample.sort_unstable_by(f32::total_cmp);
    let at = |share: f64| sample.get((share * (sample.len() as f64 - 1.0)) as usize).copied().unwrap_or(min);
    GreyRange { min, max, percentiles: [at(0.01), at(0.5), at(0.99)] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bonemill_geometry::{Grid, Point};

    fn volume(values: impl Fn(usize) -> f32) -> Volume<f32, Ct> {
        let grid = Grid::aligned([40, 40, 40], 0.5, Point::new(0.0, 0.0, 0.0)).unwrap();
        let data = (0..grid.len()).map(values).collect();
        Volume::new(grid, data).unwrap()
    }

    /// Air, soft tissue and bone with some noise.
    fn head(n: usize) -> f32 {
        let noise = (n * 7919 % 101) as f32 - 50.0;
        noise + [-1000.0, 40.0, 60.0, 1200.0][n / 16_000]
    }

    fn kind_of(values: impl Fn(usize) -> f32) -> GreyKind {
        match looks_like_hu(&volume(values)) {
            Err(ImageError::NotHounsfield { kind, .. }) => kind,
            other => panic!("expected a refusal, not {other:?}"),
        }
    }

    #[test]
    fn scans_with_air_are_taken() {
        assert!(looks_like_hu(&volume(head)).is_ok());
        // padding outside the field of view, metal in a few voxels
        assert!(looks_like_hu(&volume(|n| if n % 5 == 0 { -3024.0 } else { head(n) })).is_ok());
        assert!(looks_like_hu(&volume(|n| if n % 200 == 0 { 30_000.0 } else { head(n) })).is_ok());
        // a foam block without bone, with a few air cells; a cone-beam scan's air
        assert!(looks_like_hu(&volume(|n| if n % 1000 == 0 { -950.0 } else { -246.0 })).is_ok());
        assert!(looks_like_hu(&volume(|n| 0.7 * head(n))).is_ok());
    }

    #[test]
    fn padding_becomes_air() {
        let mut ct = volume(|n| [-3024.0, -2000.0, -1500.0, 40.0][n % 4]);
        assert_eq!(padding_to_air(&mut ct), 32_000);
        assert_eq!(ct.data()[..4], [-1000.0, -1000.0, -1500.0, 40.0]);
    }

    #[test]
    fn others_are_refused_by_what_they_are() {
        assert_eq!(kind_of(|_| 0.0), GreyKind::Constant);
        assert_eq!(kind_of(|n| (head(n) + 1050.0) / 2300.0), GreyKind::Normalized);
        assert_eq!(kind_of(|n| ((head(n) + 1050.0) / 2300.0 * 255.0).floor()), GreyKind::EightBit);
        assert_eq!(kind_of(|n| head(n) + 1024.0), GreyKind::Shifted);
        assert_eq!(kind_of(|n| (head(n) + 1024.0).max(0.0)), GreyKind::Shifted);
        // padding does not count as air
        assert_eq!(kind_of(|n| if n % 5 == 0 { -2000.0 } else { head(n) + 1024.0 }), GreyKind::Shifted);
        assert_eq!(kind_of(|n| (head(n) + 1050.0) * 28.0), GreyKind::SixteenBit);
        assert_eq!(kind_of(|n| 10.0 * head(n)), GreyKind::SixteenBit);
        assert_eq!(kind_of(|n| -1000.0 + (n % 7) as f32), GreyKind::OnlyAir);
        assert_eq!(kind_of(|n| (n % 700) as f32), GreyKind::NoAir);
    }

    #[test]
    fn the_refusal_says_what_it_looks_like() {
        let message = looks_like_hu(&volume(|n| (n % 256) as f32)).unwrap_err().to_string();
        assert!(message.contains("8-bit") && message.contains("from 0 to 255"), "{message}");
    }
}
