//! Which directions are sampled: about 2° apart in a plane, 6° over a cap.
//!
//! The best sequence over a cap is computed on directions 12° apart, then near it on directions 4° apart
//! ([`bonemill_toolpath::orientation::corridor`]). Where the shank's freedom is too narrow for the coarse ones, and where the path is very long,
//! one cap of 6° is used.

use bonemill_toolpath::orientation::{Directions, TiltFamily};

/// Steps over a cap, and of the coarse one, in steps in a plane.
const CAP_STEPS: f64 = 3.0;
const COARSE_CAP_STEPS: f64 = 2.0 * CAP_STEPS;
/// The finer cap's spacing is so many times smaller than the coarse one's.
const FINER: usize = 3;
/// Waypoints times directions of a finer cap, at most; five bytes each.
const MOST_FINER: usize = 1 << 26;

/// A finer cap, and the number in it of each direction of the coarser one.
pub type Finer = (Directions, Vec<u16>);

/// One set, by the steps in a plane.
pub fn one(family: Option<&TiltFamily>, limit_rad: f64, step_rad: f64) -> Directions {
    match family {
        Some(family) => Directions::in_plane(family, step_rad, limit_rad),
        None => Directions::cap(CAP_STEPS * step_rad, limit_rad),
    }
}

/// A coarse cap and a finer one, by the steps in a plane; `None` where the path has too many waypoints for it, or the cap is too small to divide.
pub fn coarse_and_finer(limit_rad: f64, step_rad: f64, waypoints: usize) -> Option<(Directions, Finer)> {
    let coarse = Directions::cap(COARSE_CAP_STEPS * step_rad, limit_rad);
    let finer = coarse.finer(FINER)?;
    (waypoints * finer.0.len() <= MOST_FINER).then_some((coarse, finer))
}
