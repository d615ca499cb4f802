//! What the cutter cannot take: where, how much, and why.
//!
//! Hidden from both sides: the gaps of [`crate::machining::envelope`]. Too narrow: what remains under the lowest surface that the tip can sweep,
//! min over o of tip(p + o) + profile(|o|), above the part. Neighbouring cells make one place.

use nalgebra::Vector3;

use crate::machining::moves::Facing;
use crate::machining::raster::CellRaster;

/// Thinner leftovers are not told, mm, nor smaller ones, mm³.
const LEAST_MM: f64 = 0.05;
const LEAST_MM3: f64 = 0.01;

/// Why stock stays.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reason {
    /// The part covers it on both sides.
    Hidden,
    /// The cutter is too wide for the place.
    Narrow,
    /// An inner corner of an outline is sharper than the cutter is round.
    Corner,
    /// The holder would meet the block.
    Deep,
}

/// Stock that stays beside the part.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Leftover {
    /// Why.
    pub reason: Reason,
    /// Its middle, block's frame, mm.
    pub at_mm: Vector3<f64>,
    /// Volume, mm³.
    pub volume_mm3: f64,
    /// Greatest thickness along the cutter's axis, mm.
    pub deepest_mm: f64,
}

/// Connected cells with `thickness_mm` above the least, the middle at `height_mm`.
pub fn places(
    raster: &CellRaster,
    thickness_mm: &[f64],
    height_mm: &[f64],
    facing: Facing,
    reason: Reason,
) -> Vec<Leftover> {
    let mut seen = vec![false; raster.len()];
    let mut found = Vec::new();
    for start in 0..raster.len() {
        let (mut volume_mm3, mut deepest_mm, mut moment) = (0.0, 0.0_f64, Vector3::zeros());
        for cell in raster.connected(vec![start], &mut seen, |cell| thickness_mm[cell] > LEAST_MM) {
            let volume = thickness_mm[cell] * raster.pitch_mm * raster.pitch_mm;
            let [u, v] = raster.centre_of(cell);
            volume_mm3 += volume;
            deepest_mm = deepest_mm.max(thickness_mm[cell]);
            moment += volume * Vector3::new(u, v, height_mm[cell]);
        }
        if volume_mm3 > LEAST_MM3 {
            let at_mm = facing.to_block(&(moment / volume_mm3));
            found.push(Leftover { reason, at_mm, volume_mm3, deepest_mm });
        }
    }
    found.sort_by(|a, b| b.volume_mm3.total_cmp(&a.volume_mm3));
    found
}
