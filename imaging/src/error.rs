//! What can go wrong between a file and a scene.

use thiserror::Error;

/// Why images, tables or targets cannot be used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ImageError {
    /// The two lists of a density table do not pair up, or hold fewer than two points.
    #[error("density table has {hu} HU and {g_cm3} g/cm³ values; expected as many of each, at least 2")]
    DensityTableLength {
        /// Number of HU values.
        hu: usize,
        /// Number of densities.
        g_cm3: usize,
    },
    /// A point of a density table is not finite, not above the one before it, or negative in density.
    #[error(
        "density table, point {index}: {hu} HU, {g_cm3} g/cm³; expected finite values, HU above the point \
         before, density not negative"
    )]
    DensityTablePoint {
        /// Place in the lists, from 0.
        index: usize,
        /// The HU given.
        hu: f64,
        /// The density given, g/cm³.
        g_cm3: f64,
    },
}
