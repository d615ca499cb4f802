//! From an affine map of voxel indices to a grid whose axes are perpendicular.
//!
//! The planner measures distances along a grid's axes, so they must be perpendicular. They may be off the right angle by
//! [`SHEAR_LIMIT_RAD`]: direction cosines are often stored with only 4 to 6 digits, while a gantry tilt, the usual true shear, is
//! 10⁻² rad or more. Then the nearest orthonormal axes are used, provided that they move no corner by more than
//! [`DISAGREEMENT_LIMIT_VOXELS`].

use bonemill_geometry::{Ct, Grid, GridError};
use nalgebra::{Matrix3, Vector3};
use thiserror::Error;

/// The largest distance between two positions of a corner by two statements about it, and the largest displacement of a corner when
/// axes are made perpendicular, voxels.
pub const DISAGREEMENT_LIMIT_VOXELS: f64 = 0.1;
/// The largest deviation of axes from a right angle, rad.
pub const SHEAR_LIMIT_RAD: f64 = 1e-3;
/// Believable voxel sizes, mm: finer than any micro-CT of a bone to coarser than any planning scan.
pub const SPACING_RANGE_MM: [f64; 2] = [1e-3, 20.0];
/// Axes that span less than this share of a box's volume are singular, not sheared.
const SINGULAR: f64 = 1e-3;
/// Left and posterior of a patient's axes are right and anterior of `ct`'s, with the other sign.
const RAS_FROM_LPS: Vector3<f64> = Vector3::new(-1.0, -1.0, 1.0);

/// Why an affine map gives no grid.
#[derive(Debug, Error)]
pub enum AffineFault {
    /// The axes do not span space.
    #[error("its axes span a volume of {relative_volume:.2e} of a box's, expected 1")]
    Singular {
        /// |det| divided by the product of the axes' lengths.
        relative_volume: f64,
    },
    /// The voxels have an impossible size.
    #[error("voxels of {spacing_mm:?} mm; expected {} to {} mm: wrong unit?", SPACING_RANGE_MM[0], SPACING_RANGE_MM[1])]
    Spacing {
        /// Spacing along i, j, k, mm.
        spacing_mm: [f64; 3],
    },
    /// The axes are not perpendicular.
    #[error(
        "axes off the right angle by {off_rad:.2e} rad (limit {SHEAR_LIMIT_RAD:.0e}), {off_voxels:.2} voxels at the far corner \
         (limit {DISAGREEMENT_LIMIT_VOXELS}). Resample the scan to a straight grid"
    )]
    Shear {
        /// Largest deviation from 90°, rad.
        off_rad: f64,
        /// Displacement of the far corner when the nearest grid with perpendicular axes is used, voxels.
        off_voxels: f64,
    },
    /// The grid itself is impossible.
    #[error(transparent)]
    Grid(#[from] GridError),
}

/// The affine map from voxel index to `ct`, mm.
#[derive(Debug, Clone, Copy)]
pub(super) struct Affine {
    pub linear: Matrix3<f64>,
    pub offset: Vector3<f64>,
}

impl Affine {
    /// From the steps along i, j, k and the first voxel's centre, in a world whose axes are `ct`'s with these signs, mm.
    pub fn with_signs(signs: Vector3<f64>, steps: [Vector3<f64>; 3], origin: Vector3<f64>) -> Self {
        let columns = steps.map(|step| step.component_mul(&signs));
        Self { linear: Matrix3::from_columns(&columns), offset: origin.component_mul(&signs) }
    }

    /// The same in DICOM's world, +x left, +y posterior.
    pub fn from_lps(steps: [Vector3<f64>; 3], origin: Vector3<f64>) -> Self {
        Self::with_signs(RAS_FROM_LPS, steps, origin)
    }

    pub fn at(&self, index: Vector3<f64>) -> Vector3<f64> {
        self.linear * index + self.offset
    }

    pub fn spacing_mm(&self) -> Vector3<f64> {
        Vector3::from_fn(|a, _| self.linear.column(a).norm())
    }

    /// Largest distance between the two positions of a corner of the volume, in units of this map's smallest spacing.
    pub fn corner_distance_voxels(&self, other: &Self, dims: [usize; 3]) -> f64 {
        let corner =
            |n: usize| Vector3::from_fn(|a, _| if n >> a & 1 == 0 { -0.5 } else { dims[a] as f64 - 0.5 });
        let largest_mm =
            (0..8).map(|n| (self.at(corner(n)) - other.at(corner(n))).norm()).fold(0.0, f64::max);
        largest_mm / self.spacing_mm().min()
    }

    /// The grid, with the nearest orthonormal axes, and the shear that was removed, rad.
    ///
    /// # Errors
    /// [`AffineFault`] for each refusal that the module describes.
    pub fn grid(&self, dims: [usize; 3]) -> Result<(Grid<Ct>, f64), AffineFault> {
        let spacing_mm = self.spacing_mm();
        let relative_volume = (self.linear.determinant() / spacing_mm.product()).abs();
        // it is NaN when an axis has length 0
        if relative_volume.is_nan() || relative_volume < SINGULAR {
            return Err(AffineFault::Singular { relative_volume: relative_volume.max(0.0) });
        }
        let [least, most] = SPACING_RANGE_MM;
        if spacing_mm.min() < least || spacing_mm.max() > most {
            return Err(AffineFault::Spacing { spacing_mm: spacing_mm.into() });
        }
        let unit = Matrix3::from_fn(|r, c| self.linear[(r, c)] / spacing_mm[c]);
        let off_rad = [(0, 1), (0, 2), (1, 2)]
            .map(|(a, b)| unit.column(a).dot(&unit.column(b)).abs().min(1.0).asin())
            .into_iter()
            .fold(0.0, f64::max);
        let axes = nearest_orthonormal(unit);
        let straight = Self { linear: axes * Matrix3::from_diagonal(&spacing_mm), offset: self.offset };
        let off_voxels = self.corner_distance_voxels(&straight, dims);
        if off_rad > SHEAR_LIMIT_RAD || off_voxels > DISAGREEMENT_LIMIT_VOXELS {
            return Err(AffineFault::Shear { off_rad, off_voxels });
        }
        Ok((Grid::new(dims, spacing_mm, axes, self.offset)?, off_rad))
    }
}

/// The orthogonal polar factor of a matrix that is nearly orthonormal, by Newton's iteration, which converges
/// quadratically. A mirrored matrix stays mirrored.
fn nearest_orthonormal(matrix: Matrix3<f64>) -> Matrix3<f64> {
    let mut m = matrix;
    for _ in 0..12 {
        let Some(inverse) = m.try_inverse() else { break };
        m = (m + inverse.transpose()) * 0.5;
    }
    m
}
