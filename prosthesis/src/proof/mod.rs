//! What a G-code program leaves of a block, measured against the part.
//!
//! This is a second opinion: it reads the program's text and knows geometry only; it shares nothing with what laid the moves or wrote the text.
//!
//! 1. [`gcode`] reads the program into straight motions of the machine's axes.
//! 2. [`deviation`] takes points of the part's surface and gives for each the signed distance to what the cutter swept, exactly: above 0
//!    the stock that is left on it, below 0 how deep it was cut into.
//! 3. [`dexels`] replays the motions in their order on columns of stock: rapid moves and the holder against what is still there, and how wide
//!    the cutter engages.
//! 4. [`hold`] follows what stays connected to the grip: nothing but swarf may come loose before the program's end.
//!
//! Machine: X along the rotary axis A, Z along the spindle, zero on the rotary axis. At A = 0 a point (x, y, z) of the block's frame is at (x, −z, y),
//! at A = 180° at (x, z, −y). Not here: other angles, arcs, cutter compensation; they are refused with their line.

pub mod chip;
mod cutter;
pub mod deviation;
pub mod dexels;
mod error;
mod finer;
pub mod gcode;
pub mod hold;

use bonemill_geometry::{Block, Mesh};
use nalgebra::Vector3;

pub use chip::Chip;
pub use deviation::{SurfaceSample, UncutPlace};
pub use dexels::{Collision, Struck, WideCut};
pub use error::ProofError;
pub use gcode::{Program, ProgramMotion};
pub use hold::LoosePiece;

/// What the program is judged with, in plain numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct ProofJob {
    /// Lowest corner of the block, block's frame, mm.
    pub low_mm: Vector3<f64>,
    /// Highest corner, mm.
    pub high_mm: Vector3<f64>,
    /// Height of the gripped zone above the lowest z, mm.
    pub grip_mm: f64,
    /// The cutter's radius, mm.
    pub radius_mm: f64,
    /// Radius of its corner: 0 flat, the cutter's radius for a ball, mm.
    pub corner_radius_mm: f64,
    /// From the tip to the holder, mm.
    pub length_mm: f64,
    /// The holder's pieces from below: length and radius, mm.
    pub holder_mm: Vec<[f64; 2]>,
    /// Widest cut that is allowed, mm.
    pub widest_mm: f64,
    /// Cuts no deeper than this may be as wide as the cutter, mm.
    pub entry_mm: f64,
    /// Height of rapid motions above the stock under the cutter, mm; those straight up need none.
    pub clearance_mm: f64,
    /// Teeth of the cutter.
    pub flutes: u32,
    /// Distance of the points on the part, mm.
    pub sample_mm: f64,
    /// Boxes of the block's frame in which stock shall stay (the tab): lowest and highest corner, mm.
    pub kept: Vec<[Vector3<f64>; 2]>,
}

/// What was found.
#[derive(Debug, Clone)]
pub struct Proof {
    /// Points of the part's surface and their deviation.
    pub samples: Vec<SurfaceSample>,
    /// Deepest cut into the part, mm, 0 if there is none.
    pub deepest_gouge_mm: f64,
    /// Where that is, block's frame, mm.
    pub gouge_at_mm: Vector3<f64>,
    /// Thickest stock left outside the boxes in which it shall stay, mm.
    pub thickest_uncut_mm: f64,
    /// All stock left on the part there, Σ area × thickness, mm³.
    pub uncut_mm3: f64,
    /// Motions in which something met the stock that must not.
    pub collisions: Vec<Collision>,
    /// Widest cut deeper than the entries' depth, mm.
    pub widest_mm: f64,
    /// Motions whose cut is wider than allowed by more than a quarter of a column.
    pub too_wide: Vec<WideCut>,
    /// Pieces larger than swarf that lose their hold, in the program's order.
    pub loose: Vec<LoosePiece>,
    /// The thickest chip of every cutting motion.
    pub chips: Vec<Chip>,
    /// Side of a column of stock in the replay, mm.
    pub column_mm: f64,
    /// Number of motions.
    pub motions: usize,
}

/// Reads a program and judges what it leaves.
///
/// # Errors
/// [`ProofError`] where the text is no program that the machine here would run, a number of the job is out of range or the part has no facet.
pub fn prove(program: &str, part: &Mesh<Block>, job: &ProofJob) -> Result<Proof, ProofError> {
    job.checked()?;
    let program = gcode::read(program)?;
    let mut samples = deviation::samples(part, job.sample_mm)?;
    deviation::measure(&mut samples, &program.motions, job);
    let replay = dexels::replay(&program.motions, job)?;
    let deepest = samples.iter().min_by(|a, b| a.deviation_mm.total_cmp(&b.deviation_mm));
    let outside = || samples.iter().filter(|s| !job.keeps(&s.at_mm));
    Ok(Proof {
        deepest_gouge_mm: deepest.map_or(0.0, |s| (-s.deviation_mm).max(0.0)),
        gouge_at_mm: deepest.map_or_else(Vector3::zeros, |s| s.at_mm),
        thickest_uncut_mm: outside().map(|s| s.deviation_mm).fold(0.0, f64::max),
        uncut_mm3: outside().map(|s| s.area_mm2 * s.deviation_mm.max(0.0)).sum(),
        collisions: replay.collisions,
        widest_mm: replay.widest_mm,
        too_wide: replay.too_wide,
        loose: replay.loose,
        chips: replay.chips,
        column_mm: replay.column_mm,
        motions: program.motions.len(),
        samples,
    })
}

impl Proof {
    /// The deepest chip of the cuts after a line, see [`Chip`], mm.
    pub fn chip_mm(&self, after_line: usize) -> f64 {
        let after = self.chips.iter().filter(|chip| chip.line > after_line);
        after.fold(0.0, |most, chip| most.max(chip.depth_mm))
    }

    /// Volume of all pieces larger than swarf that lose their hold, mm³.
    pub fn loose_mm3(&self) -> f64 {
        self.loose.iter().fold(0.0, |sum, piece| sum + piece.volume_mm3)
    }

    /// Places where more than `above_mm` of stock is left on the part, outside the boxes in which it shall stay.
    pub fn uncut(&self, above_mm: f64, job: &ProofJob) -> Vec<UncutPlace> {
        let outside: Vec<&SurfaceSample> = self.samples.iter().filter(|s| !job.keeps(&s.at_mm)).collect();
        deviation::places(&outside, above_mm, 4.0 * job.sample_mm)
    }

    /// Area of the part by deviation: bins of `width_mm` from `-bins·width` to `bins·width`, the last ones open, mm².
    pub fn histogram(&self, width_mm: f64, bins: usize) -> Vec<f64> {
        let mut areas = vec![0.0; 2 * bins];
        for sample in &self.samples {
            let bin = (sample.deviation_mm / width_mm).floor() + bins as f64;
            areas[bin.clamp(0.0, (2 * bins - 1) as f64) as usize] += sample.area_mm2;
        }
        areas
    }
}

impl ProofJob {
    fn keeps(&self, at_mm: &Vector3<f64>) -> bool {
        self.kept.iter().any(|[low, high]| (0..3).all(|n| (low[n]..=high[n]).contains(&at_mm[n])))
    }

    fn checked(&self) -> Result<(), ProofError> {
        let size = self.high_mm - self.low_mm;
        let numbers = [
            ("block size along x", size.x, 0.1, 1000.0),
            ("block size along y", size.y, 0.1, 1000.0),
            ("block size along z", size.z, 0.1, 1000.0),
            ("grip", self.grip_mm, 0.0, size.z),
            ("cutter radius", self.radius_mm, 0.05, 50.0),
            ("corner radius", self.corner_radius_mm, 0.0, self.radius_mm),
            ("tool length", self.length_mm, 0.1, 500.0),
            ("entry depth", self.entry_mm, 0.0, 1000.0),
            ("clearance", self.clearance_mm, 0.0, 1000.0),
            ("flutes", f64::from(self.flutes), 1.0, 20.0),
            ("distance of points", self.sample_mm, 0.02, 10.0),
        ];
        let bad = numbers.into_iter().find(|(_, value, low, high)| !(low..=high).contains(&value));
        bad.map_or(Ok(()), |(what, value, low, high)| Err(ProofError::Value { what, value, low, high }))
    }
}

#[cfg(test)]
mod tests;
