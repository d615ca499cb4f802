//! The body of end-to-end tests: a block of bone under air, an L-shaped pocket to be milled from above, and a rod beside it.
//!
//! 40 × 40 × 30 voxels of 0.5 mm: small enough that a plan takes a second without optimisation. Nothing about it is symmetric, so
//! that a mirrored plan cannot pass for the plan.

/// Voxels along i, j, k.
pub const DIMS: [usize; 3] = [40, 40, 30];
/// Voxel, mm.
pub const SPACING_MM: f64 = 0.5;
/// Centre of voxel (0, 0, 0), mm.
pub const ORIGIN_MM: [f64; 3] = [-11.0, -8.0, 3.0];
/// First voxel of air along k: the block's upper face lies half a voxel below.
pub const AIR_FROM: usize = 22;
/// Air, HU.
pub const AIR_HU: f32 = -1000.0;
/// Label of the pocket.
pub const TARGET: u16 = 20;
/// Label of the rod.
pub const ROD: u16 = 7;
/// The rod's voxels, from and to, along i, j, k: 1.5 mm beside the pocket.
pub const ROD_VOXELS: [[usize; 2]; 3] = [[30, 32], [24, 36], [12, 14]];

/// Grey value of a voxel, HU: dense bone with some texture, air above.
pub fn hu([i, j, k]: [usize; 3]) -> f32 {
    if k >= AIR_FROM { AIR_HU } else { 1100.0 + ((7 * i + 13 * j + 5 * k) % 11) as f32 * 20.0 }
}

/// Label of a voxel: the pocket opens upwards.
pub fn label(voxel: [usize; 3]) -> u16 {
    let pocket = [[[11, 27], [12, 26], [15, AIR_FROM]], [[11, 18], [26, 31], [17, AIR_FROM]]];
    if pocket.iter().any(|part| is_inside(voxel, *part)) {
        TARGET
    } else if is_inside(voxel, ROD_VOXELS) {
        ROD
    } else {
        0
    }
}

/// Whether a voxel lies in a box of voxels, from and to, along i, j, k.
pub fn is_inside(voxel: [usize; 3], ranges: [[usize; 2]; 3]) -> bool {
    voxel.iter().zip(ranges).all(|(v, [from, to])| (from..to).contains(v))
}
