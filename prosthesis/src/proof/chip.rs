//! The chip of a cut: how deep stock stands before the teeth.
//!
//! A tooth at an angle φ from the feed takes a chip as thick as feed a tooth × cos φ, as deep as the stock before it. The force of a cut is
//! specific force × feed a tooth × Σ over the teeth of depth × cos φ. **Source:** Altintas 2012, Manufacturing Automation, chapter 2.

use std::collections::VecDeque;

/// Places around the cutter at which a tooth may be.
const ANGLES: usize = 72;

/// The thickest chip of a cutting motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Chip {
    /// Line of the program.
    pub line: usize,
    /// Greatest sum over the teeth of depth × cos of the angle between tooth and feed, mm: times feed a tooth the chip's section.
    pub depth_mm: f64,
}

/// What teeth at each angle take, depth × cos, mm.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Teeth([f64; ANGLES]);

impl Default for Teeth {
    fn default() -> Self {
        Self([0.0; ANGLES])
    }
}

impl Teeth {
    /// A tooth at a place from the axis takes so much.
    pub fn take(&mut self, [du, dv]: [f64; 2], depth_mm: f64) {
        let turns = dv.atan2(du) / std::f64::consts::TAU;
        let tooth = &mut self.0[((turns.rem_euclid(1.0) * ANGLES as f64) as usize).min(ANGLES - 1)];
        *tooth = tooth.max(depth_mm);
    }
}

/// The teeth of the last stamps of a motion: one stamp takes cells at some angles only.
#[derive(Debug, Default)]
pub(crate) struct RecentTeeth(VecDeque<Teeth>);

impl RecentTeeth {
    /// With one stamp more of `remembered`: the greatest sum over evenly spaced teeth, mm.
    pub fn add(&mut self, teeth: Teeth, remembered: usize, flutes: u32) -> f64 {
        self.0.push_back(teeth);
        if self.0.len() > remembered {
            self.0.pop_front();
        }
        let by_angle: [f64; ANGLES] =
            std::array::from_fn(|n| self.0.iter().map(|teeth| teeth.0[n]).fold(0.0, f64::max));
        let flutes = flutes as usize;
        let sum =
            |first: usize| (0..flutes).map(|n| by_angle[(first + n * ANGLES / flutes) % ANGLES]).sum::<f64>();
        (0..ANGLES).map(sum).fold(0.0, f64::max)
    }
}
