//! What a job consists of beside the part: block, tool, process and machine, checked on entry so that inner code need not.

use bonemill_case::prosthesis::{MachineSpec, ProcessSpec};
use nalgebra::Vector3;

use crate::machining::MachiningError;
use crate::machining::moves::Facing;

/// Rounding between degrees and radians, rad.
const SAME_RAD: f64 = 1e-9;

/// The block in its own frame: x along the rotary axis, y across the part's thickness, z the third side.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Block {
    /// Lowest corner, mm.
    pub low_mm: Vector3<f64>,
    /// Highest corner, mm.
    pub high_mm: Vector3<f64>,
    /// Height of the gripped zone above the lowest z, mm: no cutter comes there.
    pub grip_mm: f64,
}

impl Block {
    /// Lowest and highest corner in the machine's axes at A = 0, mm. The grip lies there at the greatest Y.
    pub fn at_a0_mm(&self) -> [Vector3<f64>; 2] {
        let [a, b] = [&self.low_mm, &self.high_mm].map(|corner| Facing::Front.from_block(corner));
        [a.inf(&b), a.sup(&b)]
    }
}

/// A piece of the holder: a cylinder above the pieces before it, the first above the tool's length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HolderSegment {
    /// Length along the axis, mm.
    pub length_mm: f64,
    /// Radius, mm.
    pub radius_mm: f64,
}

/// A cutter: flat (corner radius 0), ball (corner radius = radius) or bull-nose, and what is above it.
#[derive(Debug, Clone, PartialEq)]
pub struct EndMill {
    /// Radius, mm.
    pub radius_mm: f64,
    /// Radius of the corner between end and side, mm.
    pub corner_radius_mm: f64,
    /// Cutting edges.
    pub flutes: u32,
    /// From the tip to the holder, mm.
    pub length_mm: f64,
    /// The holder from below.
    pub holder: Vec<HolderSegment>,
}

/// Block, tool, process and machine.
#[derive(Debug, Clone, PartialEq)]
pub struct MachiningJob {
    /// What is cut.
    pub block: Block,
    /// What cuts.
    pub tool: EndMill,
    /// How.
    pub process: ProcessSpec,
    /// What moves it.
    pub machine: MachineSpec,
}

impl EndMill {
    /// Height of the cutter's surface above its tip at a distance from the axis, mm; `None` beyond the radius.
    pub fn profile_mm(&self, distance_mm: f64) -> Option<f64> {
        if distance_mm > self.radius_mm {
            return None;
        }
        let into_corner = distance_mm - (self.radius_mm - self.corner_radius_mm);
        if into_corner <= 0.0 {
            return Some(0.0);
        }
        let rc = self.corner_radius_mm;
        Some(rc - (rc * rc - into_corner * into_corner).max(0.0).sqrt())
    }

    /// Diameter, mm.
    pub fn diameter_mm(&self) -> f64 {
        2.0 * self.radius_mm
    }
}

impl MachiningJob {
    /// Feed of the process = feed per tooth · teeth · spindle speed, mm/min. **Source:** Castelli et al. 2020, equation 1.
    pub fn teeth_feed_mm_min(&self) -> f64 {
        self.process.feed_per_tooth_mm * f64::from(self.tool.flutes) * self.process.spindle_rpm
    }

    /// Feed of cutting moves, mm/min: the process's, at most the machine's.
    pub fn feed_mm_min(&self) -> f64 {
        self.teeth_feed_mm_min().min(self.machine.max_feed_mm_min)
    }

    /// Angle of the rotary axis for a side: 0 for the front, half a turn either way for the back, as the axis reaches it, rad.
    pub fn a_rad(&self, facing: Facing) -> f64 {
        use std::f64::consts::PI;
        let [low, high] = self.machine.rotary_range_rad;
        let reaches = |a_rad: f64| (low - SAME_RAD..=high + SAME_RAD).contains(&a_rad);
        match facing {
            Facing::Front => 0.0,
            Facing::Back if !reaches(PI) && reaches(-PI) => -PI,
            Facing::Back => PI,
        }
    }

    /// Widest ordinary cut, mm.
    pub fn widest_mm(&self) -> f64 {
        self.process.side_load * self.tool.diameter_mm()
    }

    /// Depth of a roughing level, mm.
    pub fn level_mm(&self) -> f64 {
        self.process.depth_of_cut * self.tool.diameter_mm()
    }

    /// Deepest cut at full width, mm: entries take no larger section of chip than ordinary rows, D · entry = widest · level.
    pub fn entry_mm(&self) -> f64 {
        self.level_mm() * self.process.side_load.min(1.0)
    }

    /// The job, if every number is in range.
    ///
    /// # Errors
    /// [`MachiningError::Value`] that names the first number that is not.
    pub fn checked(&self) -> Result<(), MachiningError> {
        let (t, p, m) = (&self.tool, &self.process, &self.machine);
        let size = self.block.high_mm - self.block.low_mm;
        within("block size along x", size.x, "mm", 0.1..=1000.0)?;
        within("block size along y", size.y, "mm", 0.1..=1000.0)?;
        within("block size along z", size.z, "mm", 0.1..=1000.0)?;
        within("grip", self.block.grip_mm, "mm", 0.0..=size.z)?;
        within("tool radius", t.radius_mm, "mm", 0.05..=50.0)?;
        within("corner radius", t.corner_radius_mm, "mm", 0.0..=t.radius_mm)?;
        within("tool length", t.length_mm, "mm", 0.1..=500.0)?;
        within("flutes", f64::from(t.flutes), "", 1.0..=20.0)?;
        for piece in &t.holder {
            within("holder segment length", piece.length_mm, "mm", 0.0..=1000.0)?;
            within("holder segment radius", piece.radius_mm, "mm", 0.0..=500.0)?;
        }
        within("spindle speed", p.spindle_rpm, "1/min", 1.0..=1e6)?;
        within("feed per tooth", p.feed_per_tooth_mm, "mm", 1e-5..=10.0)?;
        within("side load", p.side_load, "of the diameter", 0.05..=1.0)?;
        within("depth of cut", p.depth_of_cut, "of the diameter", 0.02..=10.0)?;
        within("finishing step", p.finishing_step_mm, "mm", 0.01..=5.0)?;
        within("holding strip", p.strip_mm, "mm", 0.05..=50.0)?;
        within("clearance", p.clearance_mm, "mm", 0.1..=100.0)?;
        for travel in m.travel_mm {
            within("travel", travel, "mm", 1.0..=1e5)?;
        }
        for angle in m.rotary_range_rad {
            within("rotary range", angle, "rad", -100.0..=100.0)?;
        }
        within("fastest feed", m.max_feed_mm_min, "mm/min", 1.0..=1e6)?;
        within("rapid speed", m.rapid_mm_min, "mm/min", 1.0..=1e6)?;
        within("rotary speed", m.rotary_rad_s, "rad/s", 1e-3..=1e3)?;
        within("acceleration", m.acceleration_mm_s2, "mm/s²", 1.0..=1e6)?;
        within("jerk", m.jerk_mm_s3, "mm/s³", 1.0..=1e9)?;
        m.max_time_min.map_or(Ok(()), |t| within("longest time", t, "min", 0.01..=1e5))
    }
}

fn within(
    what: &'static str,
    value: f64,
    unit: &'static str,
    range: std::ops::RangeInclusive<f64>,
) -> Result<(), MachiningError> {
    if range.contains(&value) {
        return Ok(());
    }
    Err(MachiningError::Value { what, value, unit, expected: "a number in the range of the documentation" })
}
