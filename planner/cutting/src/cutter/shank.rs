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

impl ShankCylinder {
    /// Cylinders one behind the other from a height on, each given as [length, radius], mm.
    pub fn stacked(mut from_mm: f64, parts: impl IntoIterator<Item = [f64; 2]>) -> Vec<Self> {
        let cylinder = |[length_mm, radius_mm]: [f64; 2]| {
            let cylinder = Self { from_mm, to_mm: from_mm + length_mm, radius_mm };
            from_mm = cylinder.to_mm;
            cylinder
        };
        parts.into_iter().map(cylinder).collect()
    }
}
