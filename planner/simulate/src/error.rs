//! Errors of the engine.

use thiserror::Error;

use bonemill_cutting::burr::ModelError;

/// Why the engine cannot be made, or cannot make a step. A refused step does not change its state.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum EngineError {
    /// The grid is not cubic, or oblique.
    #[error("a grid of spacing {spacing_mm:?} mm: expected cubic voxels along the work frame's axes")]
    Grid {
        /// Its spacing.
        spacing_mm: [f64; 3],
    },
    /// Classes and densities are on different grids.
    #[error("classes on a grid of {found:?} voxels: expected {expected:?}, as the densities")]
    Classes {
        /// Voxels of the densities.
        expected: [usize; 3],
        /// Voxels of the classes.
        found: [usize; 3],
    },
    /// The lattice would be too large.
    #[error(
        "{bricks:.3e} bricks of {spacing_mm:.4} mm cells over the grid: expected at most {most:.0e}; use fewer cells per radius"
    )]
    TooFine {
        /// Bricks needed.
        bricks: f64,
        /// Side of a cell.
        spacing_mm: f64,
        /// Bricks allowed.
        most: f64,
    },
    /// A pose holds a number that is not finite, or is too far away for exact arithmetic.
    #[error("a pose at ({}, {}, {}) mm: expected finite, within {most_mm:.0e} mm", center_mm[0], center_mm[1], center_mm[2])]
    Pose {
        /// The burr's centre.
        center_mm: [f64; 3],
        /// Largest accepted distance.
        most_mm: f64,
    },
    /// A value of burr, motion or model is invalid.
    #[error(transparent)]
    Model(#[from] ModelError),
}
