//! What the engine refuses.

use thiserror::Error;

use bonemill_cutting::burr::ModelError;

/// Why the engine cannot be made, or cannot take a step. A refused step leaves its state as it was.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum EngineError {
    /// The grid is not cubic, or oblique.
    #[error("a grid of spacing {spacing_mm:?} mm: expected cubic voxels along the work frame's axes")]
    Grid {
        /// Its spacing.
        spacing_mm: [f64; 3],
    },
    /// Classes and densities do not belong together.
    #[error("classes on a grid of {found:?} voxels: expected {expected:?}, as the densities")]
    Classes {
        /// Voxels of the densities.
        expected: [usize; 3],
        /// Voxels of the classes.
        found: [usize; 3],
    },
    /// The lattice of what is left would not fit.
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
    /// A pose holds a number that is none, or so far away that arithmetic fails.
    #[error("a pose at ({}, {}, {}) mm: expected finite, within {most_mm:.0e} mm", center_mm[0], center_mm[1], center_mm[2])]
    Pose {
        /// The burr's centre.
        center_mm: [f64; 3],
        /// How far a pose may be.
        most_mm: f64,
    },
    /// A value of burr, motion or model.
    #[error(transparent)]
    Model(#[from] ModelError),
}
