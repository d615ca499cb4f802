//! Trilinear density around one point, as the kernels ask for it: thousands of directions from one centre.
//!
//! The same values as [`Volume::trilinear`] to rounding. The map from a unit normal to a voxel index is one matrix for a centre
//! and a radius, and a point with all eight neighbours in the volume needs no checks beyond that.

use bonemill_geometry::{Frame, Point, Volume};
use nalgebra::{Matrix3, Vector3};

/// A density volume seen from a burr's centre.
#[derive(Debug)]
pub struct SphereSampler<'a, T, F: Frame> {
    volume: &'a Volume<T, F>,
    /// Continuous index of the centre, and what a unit normal adds to it.
    center: Vector3<f64>,
    index_from_normal: Matrix3<f64>,
}

impl<'a, T: Copy + Into<f64>, F: Frame> SphereSampler<'a, T, F> {
    /// Looks from `center` at the sphere of `radius_mm` (the burr's radius plus the sampling offset).
    pub fn new(volume: &'a Volume<T, F>, center: Point<F>, radius_mm: f64) -> Self {
        let grid = volume.grid();
        let per_mm = Matrix3::from_diagonal(&grid.spacing_mm().map(|s| radius_mm / s));
        Self {
            volume,
            center: grid.continuous_index(center).into(),
            index_from_normal: per_mm * grid.axes().transpose(),
        }
    }

    /// Density in the direction of a unit normal in `F`; voxels outside the volume count as 0.
    #[inline]
    pub fn at(&self, normal: &Vector3<f64>) -> f64 {
        let index = (self.center + self.index_from_normal * normal).into();
        self.volume.trilinear_inside(index).unwrap_or_else(|| self.volume.trilinear_at(index, 0.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bonemill_geometry::{Grid, Work};
    use nalgebra::Rotation3;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(bonemill_testkit::fixed(256))]

        /// Inside, across the border, outside; rotated, mirrored and anisotropic grids.
        #[test]
        fn it_is_the_volume_s_own_interpolation(
            normal in prop::array::uniform3(-1.0f64..1.0), center in prop::array::uniform3(-4.0f64..4.0),
            turn in prop::array::uniform3(-3.0f64..3.0), mirror: bool, radius in 0.1f64..5.0,
        ) {
            let normal = Vector3::from(normal);
            prop_assume!(normal.norm() > 0.01);
            let mut axes: Matrix3<f64> = Rotation3::new(Vector3::from(turn)).into_inner();
            if mirror {
                axes.set_column(2, &-axes.column(2));
            }
            let spacing = Vector3::new(0.5, 0.7, 1.1);
            let grid = Grid::<Work>::new([7, 6, 5], spacing, axes, -(axes * Vector3::new(1.5, 1.7, 2.2))).unwrap();
            let data = (0..grid.len()).map(|n| ((n * 7919) % 101) as f32 * 0.01).collect();
            let volume = Volume::new(grid, data).unwrap();
            let (center, normal) = (Point::from_coords(Vector3::from(center)), normal.normalize());
            let found = SphereSampler::new(&volume, center, radius).at(&normal);
            let expected = volume.trilinear(center + normal * radius, 0.0);
            prop_assert!((found - expected).abs() < 1e-12);
        }
    }

    #[test]
    fn a_single_layer_and_a_centre_that_is_nowhere_are_outside() {
        let grid = Grid::<Work>::aligned([3, 3, 1], 1.0, Point::new(0.0, 0.0, 0.0)).unwrap();
        let volume = Volume::filled(grid, 2.0);
        let at = |x, z| SphereSampler::new(&volume, Point::new(x, 1.0, z), 0.5).at(&Vector3::z());
        assert!((at(1.0, 0.0) - 1.0).abs() < 1e-15);
        assert_eq!(at(f64::NAN, 0.0), 0.0);
        assert_eq!(at(1e300, 0.0), 0.0);
    }
}
