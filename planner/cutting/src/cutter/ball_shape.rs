//! The ball as a cutter. Code that takes a [`Ball`] uses what holds for a ball alone: its sweep is a capsule, which does not depend on
//! the shaft's direction, and its free space is a distance.

/// A ball that removes; its centre is the tool frame's origin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ball {
    /// Radius, mm.
    pub radius_mm: f64,
}
