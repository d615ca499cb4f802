//! Partial-volume sheets.

/// Where bone thinner than the band, outside the target, is no obstacle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sheets {
    /// Within the band of the target only.
    Keep,
    /// Anywhere.
    Cut,
}
