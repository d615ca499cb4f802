//! A straight channel: where the tool's tip ends, and the line on which it gets there.

use bonemill_geometry::{Ct, Point};
use nalgebra::{Unit, Vector3};

/// A straight channel in ct.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChannelAxis {
    /// Where the tool's tip is at depth 0.
    pub entry: Point<Ct>,
    /// Out of the bone: from the tip to the handpiece.
    pub out: Unit<Vector3<f64>>,
    /// From the entry to where the tip ends, mm.
    pub depth_mm: f64,
}

impl ChannelAxis {
    /// Where the tip is at a depth, mm; negative before the entry.
    pub fn at(&self, depth_mm: f64) -> Point<Ct> {
        self.entry + self.out.as_ref() * -depth_mm
    }

    /// Where the tip ends.
    pub fn end(&self) -> Point<Ct> {
        self.at(self.depth_mm)
    }
}
