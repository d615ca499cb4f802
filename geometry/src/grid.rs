//! A regular voxel grid: the only place where a voxel index becomes millimetres and back.

use std::fmt;
use std::marker::PhantomData;

use nalgebra::{Matrix3, Vector3};

use crate::{Frame, Point};

/// Voxel (i, j, k) has its CENTRE at `origin + axes · (spacing ⊙ (i, j, k))`. Memory is x-fastest.
#[derive(PartialEq)]
pub struct Grid<F: Frame> {
    dims: [usize; 3],
    spacing_mm: Vector3<f64>,
    axes: Matrix3<f64>,
    origin_mm: Vector3<f64>,
    frame: PhantomData<F>,
}

/// Why a grid cannot be made.
#[derive(Debug, Clone, PartialEq)]
pub enum GridError {
    /// A dimension is 0, or the number of voxels overflows `usize`.
    Dims([usize; 3]),
    /// A spacing is not finite and positive, mm.
    Spacing([f64; 3]),
    /// The origin is not finite, mm.
    Origin([f64; 3]),
    /// The axes are not orthonormal: max |AᵀA − 1|.
    Axes(f64),
}

impl fmt::Display for GridError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Dims(d) => write!(f, "dims {d:?}: expected 1 to 2^40 voxels in all"),
            Self::Spacing(s) => write!(f, "spacing {s:?} mm: expected finite and positive"),
            Self::Origin(o) => write!(f, "origin {o:?} mm: expected finite"),
            Self::Axes(e) => write!(f, "axes are not orthonormal: |AᵀA − 1| = {e:.3e}, expected below 1e-6"),
        }
    }
}
impl std::error::Error for GridError {}

impl<F: Frame> Grid<F> {
    /// A grid of `dims` voxels; `axes` columns are the unit directions of i, j, k in `F` (det ±1: a mirrored
    /// storage order is no error), `origin_mm` is the centre of voxel (0, 0, 0).
    ///
    /// # Errors
    /// [`GridError`] when a value is not finite, not positive, or the axes are not orthonormal to 1e-6.
    pub fn new(
        dims: [usize; 3],
        spacing_mm: Vector3<f64>,
        axes: Matrix3<f64>,
        origin_mm: Vector3<f64>,
    ) -> Result<Self, GridError> {
        let count = dims.iter().try_fold(1usize, |n, &d| n.checked_mul(d));
        if !count.is_some_and(|n| n > 0 && n <= 1 << 40) {
            return Err(GridError::Dims(dims));
        }
        if !spacing_mm.iter().all(|s| s.is_finite() && *s > 0.0) {
            return Err(GridError::Spacing(spacing_mm.into()));
        }
        if !origin_mm.iter().all(|o| o.is_finite()) {
            return Err(GridError::Origin(origin_mm.into()));
        }
        let error = (axes.transpose() * axes - Matrix3::identity()).amax();
        if error > 1e-6 || error.is_nan() {
            return Err(GridError::Axes(error));
        }
        Ok(Self { dims, spacing_mm, axes, origin_mm, frame: PhantomData })
    }

    /// A grid along `F`'s own axes with cubic voxels.
    ///
    /// # Errors
    /// As [`Grid::new`].
    pub fn aligned(dims: [usize; 3], spacing_mm: f64, origin: Point<F>) -> Result<Self, GridError> {
        Self::new(dims, Vector3::repeat(spacing_mm), Matrix3::identity(), origin.coords)
    }

    /// Voxels along i, j, k.
    pub fn dims(&self) -> [usize; 3] {
        self.dims
    }

    /// Number of all voxels.
    pub fn len(&self) -> usize {
        self.dims.iter().product()
    }

    /// Always false: a grid has at least one voxel.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// Spacing along i, j, k, mm.
    pub fn spacing_mm(&self) -> Vector3<f64> {
        self.spacing_mm
    }

    /// Columns: unit directions of i, j, k in `F`; orthonormal, det ±1.
    pub fn axes(&self) -> &Matrix3<f64> {
        &self.axes
    }

    /// Centre of voxel (0, 0, 0).
    pub fn origin(&self) -> Point<F> {
        Point::from_coords(self.origin_mm)
    }

    /// Volume of a voxel, mm³.
    pub fn voxel_mm3(&self) -> f64 {
        self.spacing_mm.product()
    }

    /// Length of a voxel's space diagonal, mm.
    pub fn diagonal_mm(&self) -> f64 {
        self.spacing_mm.norm()
    }

    /// Memory index of voxel (i, j, k).
    #[inline]
    pub fn index(&self, [i, j, k]: [usize; 3]) -> usize {
        debug_assert!(i < self.dims[0] && j < self.dims[1] && k < self.dims[2]);
        i + self.dims[0] * (j + self.dims[1] * k)
    }

    /// Voxel (i, j, k) at a memory index.
    #[inline]
    pub fn voxel(&self, index: usize) -> [usize; 3] {
        let (nx, ny) = (self.dims[0], self.dims[1]);
        [index % nx, index / nx % ny, index / (nx * ny)]
    }

    /// Centre of voxel (i, j, k).
    #[inline]
    pub fn center(&self, [i, j, k]: [usize; 3]) -> Point<F> {
        self.at([i as f64, j as f64, k as f64])
    }

    /// Point at a continuous index; whole numbers are voxel centres.
    #[inline]
    pub fn at(&self, index: [f64; 3]) -> Point<F> {
        let offset = Vector3::from(index).component_mul(&self.spacing_mm);
        Point::from_coords(self.origin_mm + self.axes * offset)
    }

    /// Continuous index of a point; whole numbers are voxel centres. It may lie outside the grid.
    #[inline]
    pub fn continuous_index(&self, p: Point<F>) -> [f64; 3] {
        (self.axes.transpose() * (p.coords - self.origin_mm)).component_div(&self.spacing_mm).into()
    }

    /// The voxel whose box holds `p`, if any.
    #[inline]
    pub fn nearest(&self, p: Point<F>) -> Option<[usize; 3]> {
        let c = self.continuous_index(p);
        let mut voxel = [0; 3];
        for axis in 0..3 {
            let shifted = c[axis] + 0.5;
            if !(shifted >= 0.0 && shifted < self.dims[axis] as f64) {
                return None;
            }
            voxel[axis] = shifted as usize; // truncation rounds down what is not negative
        }
        Some(voxel)
    }

    /// The grid of the voxels `lo..=hi`, which keep their positions.
    ///
    /// # Errors
    /// [`GridError::Dims`] when `hi` is below `lo` or outside.
    pub fn crop(&self, lo: [usize; 3], hi: [usize; 3]) -> Result<Self, GridError> {
        if (0..3).any(|a| hi[a] < lo[a] || hi[a] >= self.dims[a]) {
            return Err(GridError::Dims(hi));
        }
        let dims = std::array::from_fn(|a| hi[a] - lo[a] + 1);
        Self::new(dims, self.spacing_mm, self.axes, self.center(lo).coords)
    }

    /// The same box in voxels of a `parts`-th of the sides.
    pub fn divided(&self, parts: usize) -> Self {
        let first = 0.5 / parts as f64 - 0.5;
        Self {
            dims: self.dims.map(|n| n * parts),
            spacing_mm: self.spacing_mm / parts as f64,
            axes: self.axes,
            origin_mm: self.at([first; 3]).coords,
            frame: PhantomData,
        }
    }

    /// The eight corners of the box around all voxel boxes (not only around the voxel centres).
    pub fn corners(&self) -> [Point<F>; 8] {
        std::array::from_fn(|c| {
            self.at(std::array::from_fn(|a| if c >> a & 1 == 0 { -0.5 } else { self.dims[a] as f64 - 0.5 }))
        })
    }
}

impl<F: Frame> Clone for Grid<F> {
    fn clone(&self) -> Self {
        Self { frame: PhantomData, ..*self }
    }
}
impl<F: Frame> fmt::Debug for Grid<F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Grid")
            .field("frame", &F::NAME)
            .field("dims", &self.dims)
            .field("spacing_mm", &self.spacing_mm.as_slice())
            .field("origin_mm", &self.origin_mm.as_slice())
            .finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Ct;
    use nalgebra::Rotation3;
    use proptest::prelude::*;

    fn grid(mirror: bool) -> Grid<Ct> {
        let mut axes = Rotation3::new(Vector3::new(0.2, -0.4, 0.7)).into_inner();
        if mirror {
            axes.set_column(0, &-axes.column(0));
        }
        Grid::new([7, 5, 3], Vector3::new(0.3, 0.5, 1.2), axes, Vector3::new(-9.0, 4.0, 2.5)).unwrap()
    }

    proptest! {
        #[test]
        fn index_and_mm_are_inverse(mirror: bool, c in prop::array::uniform3(-20.0f64..20.0)) {
            let g = grid(mirror);
            let back = g.continuous_index(g.at(c));
            prop_assert!((0..3).all(|a| (back[a] - c[a]).abs() < 1e-12 * 40.0));
        }
    }

    #[test]
    fn memory_is_x_fastest() {
        let g = grid(false);
        assert_eq!(g.index([1, 0, 0]), 1);
        assert_eq!(g.index([0, 1, 0]), 7);
        assert_eq!(g.index([0, 0, 1]), 35);
        for n in 0..g.len() {
            assert_eq!(g.index(g.voxel(n)), n);
        }
    }

    #[test]
    fn the_nearest_voxel_of_a_centre_is_itself_and_outside_is_none() {
        let g = grid(true);
        assert_eq!(g.nearest(g.center([6, 4, 2])), Some([6, 4, 2]));
        assert_eq!(g.nearest(g.at([6.6, 0.0, 0.0])), None);
        assert_eq!(g.nearest(Point::new(f64::NAN, 0.0, 0.0)), None);
    }

    #[test]
    fn a_crop_keeps_every_centre() {
        let g = grid(true);
        let c = g.crop([2, 1, 1], [5, 4, 2]).unwrap();
        assert_eq!(c.dims(), [4, 4, 2]);
        assert!(c.center([3, 0, 1]).distance_mm(&g.center([5, 1, 2])) < 1e-12);
        assert!(g.crop([0, 0, 0], [7, 0, 0]).is_err());
    }

    #[test]
    fn parts_of_a_voxel_lie_in_it() {
        let g = grid(true);
        let fine = g.divided(3);
        for n in 0..fine.len() {
            let voxel = fine.voxel(n);
            assert_eq!(g.nearest(fine.center(voxel)), Some(voxel.map(|v| v / 3)));
        }
        for (a, b) in g.corners().iter().zip(fine.corners()) {
            assert!(a.distance_mm(&b) < 1e-12);
        }
        assert_eq!(g.divided(1).origin().coords, g.origin().coords);
    }

    #[test]
    fn bad_grids_are_refused() {
        let ok = (Vector3::repeat(1.0), Matrix3::identity(), Vector3::zeros());
        assert!(Grid::<Ct>::new([0, 1, 1], ok.0, ok.1, ok.2).is_err());
        assert!(Grid::<Ct>::new([usize::MAX, 2, 2], ok.0, ok.1, ok.2).is_err());
        assert!(Grid::<Ct>::new([1 << 20, 1 << 20, 2], ok.0, ok.1, ok.2).is_err());
        assert!(Grid::<Ct>::new([1, 1, 1], Vector3::new(1.0, 0.0, 1.0), ok.1, ok.2).is_err());
        assert!(Grid::<Ct>::new([1, 1, 1], ok.0, Matrix3::from_element(f64::NAN), ok.2).is_err());
        assert!(Grid::<Ct>::new([1, 1, 1], ok.0, ok.1, Vector3::new(f64::INFINITY, 0.0, 0.0)).is_err());
    }
}
