//! The shank and the handpiece behind the cutter.

/// A cylinder of the shank: distances along the axis from the burr's centre, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ShankCylinder {
    /// Where it starts.
    pub from_mm: f64,
    /// Where it ends.
    pub to_mm: f64,
    /// Its radius.
    pub radius_mm: f64,
}
