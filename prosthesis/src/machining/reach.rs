//! How deep the cutter reaches into the block, and where a part must lie in it to be reached from both sides.

use bonemill_geometry::{Block as BlockFrame, Mesh};

use crate::machining::{EndMill, MachiningJob};

/// How far contour and rim go below the lowest place, mm.
pub(crate) const THROUGH_MM: f64 = 0.1;
/// Distance that the holder keeps from the block's top, mm.
const HOLDER_MM: f64 = 0.005;
/// A facet faces a side when its normal has at least so much of the side's direction; walls are reached from either.
const FACES: f64 = 0.01;

impl EndMill {
    /// How deep the tip may go below the block's top, mm; ∞ where nothing above the cutter is wider than it.
    pub(crate) fn reach_mm(&self) -> f64 {
        let widest_mm = self.holder.iter().map(|h| h.radius_mm).fold(0.0, f64::max);
        if widest_mm > self.radius_mm { self.length_mm - HOLDER_MM } else { f64::INFINITY }
    }
}

/// How far a part is to be moved along y so that the cutter reaches from each side what faces it, mm; `gap_mm` of the block stays beside the part.
///
/// 0 where it reaches all from where the part is; where no place will do, to where both sides lack the same, as far as the gap lets it. A facet
/// that another one hides counts, a wall does not: whether the place is better is for the proof to say.
pub fn shift_to_reach_mm(part: &Mesh<BlockFrame>, job: &MachiningJob, gap_mm: f64) -> f64 {
    // the depths below the block's tops of the front's lowest and the back's highest place, and the room beside the part
    let (top_mm, bottom_mm) = (job.block.high_mm.y, job.block.low_mm.y);
    let (mut front_mm, mut back_mm) = (0.0f64, 0.0f64);
    let (mut above_mm, mut below_mm) = (f64::INFINITY, f64::INFINITY);
    for triangle in &part.triangles {
        let [a, b, c] = triangle.map(|n| part.vertices[n as usize].coords);
        let normal = (b - a).cross(&(c - a));
        let facing = normal.y / normal.norm().max(f64::MIN_POSITIVE);
        for y in [a.y, b.y, c.y] {
            (above_mm, below_mm) = (above_mm.min(top_mm - y - gap_mm), below_mm.min(y - bottom_mm - gap_mm));
            if facing > FACES {
                front_mm = front_mm.max(top_mm - y);
            } else if facing < -FACES {
                back_mm = back_mm.max(y - bottom_mm);
            }
        }
    }
    let reach_mm = job.tool.reach_mm() - THROUGH_MM - 2.0 * job.tool.corner_radius_mm;
    let (least_mm, most_mm) = (front_mm - reach_mm, reach_mm - back_mm);
    let shift_mm =
        if least_mm <= most_mm { 0f64.clamp(least_mm, most_mm) } else { 0.5 * (front_mm - back_mm) };
    shift_mm.clamp(-below_mm.max(0.0), above_mm.max(0.0))
}
