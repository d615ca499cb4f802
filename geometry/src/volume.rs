//! A volume: one value per voxel of a grid.

use std::fmt;
use std::ops::{Add, Mul, Sub};

use crate::{Frame, Grid, Point};

/// One `T` per voxel, x-fastest.
#[derive(Debug, Clone)]
pub struct Volume<T, F: Frame> {
    grid: Grid<F>,
    data: Vec<T>,
}

/// The number of values is not the number of voxels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct VolumeError {
    /// Voxels of the grid.
    pub expected: usize,
    /// Values given.
    pub found: usize,
}

impl fmt::Display for VolumeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} values for a grid of {} voxels", self.found, self.expected)
    }
}
impl std::error::Error for VolumeError {}

impl<T, F: Frame> Volume<T, F> {
    /// A volume with the given values, x-fastest.
    ///
    /// # Errors
    /// [`VolumeError`] when there are not as many values as voxels.
    pub fn new(grid: Grid<F>, data: Vec<T>) -> Result<Self, VolumeError> {
        if data.len() != grid.len() {
            return Err(VolumeError { expected: grid.len(), found: data.len() });
        }
        Ok(Self { grid, data })
    }

    /// A volume with the same value in every voxel.
    pub fn filled(grid: Grid<F>, value: T) -> Self
    where
        T: Clone,
    {
        let data = vec![value; grid.len()];
        Self { grid, data }
    }

    /// The grid.
    pub fn grid(&self) -> &Grid<F> {
        &self.grid
    }

    /// The values, x-fastest.
    pub fn data(&self) -> &[T] {
        &self.data
    }

    /// The values, x-fastest, for changing them.
    pub fn data_mut(&mut self) -> &mut [T] {
        &mut self.data
    }

    /// Takes the volume apart into grid and values.
    pub fn into_parts(self) -> (Grid<F>, Vec<T>) {
        (self.grid, self.data)
    }

    /// The value of voxel (i, j, k).
    #[inline]
    pub fn get(&self, voxel: [usize; 3]) -> &T {
        &self.data[self.grid.index(voxel)]
    }

    /// The volume of `f` of each value, on the same grid.
    pub fn map<U>(&self, f: impl FnMut(&T) -> U) -> Volume<U, F> {
        Volume { grid: self.grid.clone(), data: self.data.iter().map(f).collect() }
    }
}

/// Trilinear interpolation between the corner values of a cell, x-fastest, at a place given in fractions of its sides.
#[inline]
pub fn trilinear<T>(corners: &[T; 8], [fx, fy, fz]: [T; 3]) -> T
where
    T: Copy + Add<Output = T> + Sub<Output = T> + Mul<Output = T>,
{
    let between = |a: T, b: T, f: T| a + (b - a) * f;
    let along_x = |n: usize| between(corners[n], corners[n + 1], fx);
    let along_y = |n: usize| between(along_x(n), along_x(n + 2), fy);
    between(along_y(0), along_y(4), fz)
}

impl<T: Copy + Into<f64>, F: Frame> Volume<T, F> {
    /// Trilinear interpolation at a continuous index whose eight neighbours all lie in the grid; `None` elsewhere.
    ///
    /// Gives the value of [`Self::trilinear_at`] up to rounding, but without a check of every neighbour.
    #[inline]
    pub fn trilinear_inside(&self, index: [f64; 3]) -> Option<f64> {
        self.cell_inside(index).map(|(corners, at)| trilinear(&corners, at))
    }

    /// The values at the eight corners of the cell that contains a continuous index, and the place in the cell, as
    /// [`trilinear`] takes them; `None` where not all corners lie in the grid.
    #[inline]
    pub fn cell_inside(&self, index: [f64; 3]) -> Option<([f64; 8], [f64; 3])> {
        let dims = self.grid.dims();
        // also false for NaN
        if !(0..3).all(|a| index[a] >= 0.0 && index[a] < (dims[a] - 1) as f64) {
            return None;
        }
        // for values that are not negative, truncation rounds down
        let [i, j, k] = index.map(|v| v as usize);
        let (sy, sz) = (dims[0], dims[0] * dims[1]);
        let start = i + sy * j + sz * k;
        // one slice that ends with the farthest of the eight, so that one bounds check covers all of them
        let cell = self.data.get(start..start + sz + sy + 2)?;
        let corners = [0, 1, sy, sy + 1, sz, sz + 1, sz + sy, sz + sy + 1].map(|at| cell[at].into());
        Some((corners, [index[0] - i as f64, index[1] - j as f64, index[2] - k as f64]))
    }

    /// Trilinear interpolation at `p`; voxels outside the grid count as `outside`.
    pub fn trilinear(&self, p: Point<F>, outside: f64) -> f64 {
        self.trilinear_at(self.grid.continuous_index(p), outside)
    }

    /// Trilinear interpolation at a continuous index; voxels outside the grid count as `outside`.
    #[inline]
    pub fn trilinear_at(&self, index: [f64; 3], outside: f64) -> f64 {
        let dims = self.grid.dims();
        let (mut base, mut frac) = ([0i64; 3], [0.0; 3]);
        for a in 0..3 {
            // also false for NaN: such a point is outside
            if !(index[a] >= -1.0 && index[a] < dims[a] as f64) {
                return outside;
            }
            // rounding down by truncation: `floor` is a call on targets without SSE4.1
            base[a] = (index[a] + 1.0) as i64 - 1;
            frac[a] = index[a] - base[a] as f64;
        }
        let value = |i: i64, j: i64, k: i64| -> f64 {
            let inside = |v: i64, a: usize| v >= 0 && (v as usize) < dims[a];
            if inside(i, 0) && inside(j, 1) && inside(k, 2) {
                self.data[i as usize + dims[0] * (j as usize + dims[1] * k as usize)].into()
            } else {
                outside
            }
        };
        let [i, j, k] = base;
        let [fx, fy, fz] = frac;
        let along_x = |j, k| value(i, j, k) * (1.0 - fx) + value(i + 1, j, k) * fx;
        let along_y = |k| along_x(j, k) * (1.0 - fy) + along_x(j + 1, k) * fy;
        along_y(k) * (1.0 - fz) + along_y(k + 1) * fz
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Work;

    #[test]
    fn trilinear_reproduces_a_linear_field_inside_and_fades_outside() {
        let grid = Grid::<Work>::aligned([5, 4, 3], 0.5, Point::new(-1.0, 0.0, 2.0)).unwrap();
        let field = |p: Point<Work>| 2.0 * p.x() - 3.0 * p.y() + 0.5 * p.z() + 7.0;
        let data = (0..grid.len()).map(|n| field(grid.center(grid.voxel(n)))).collect();
        let v = Volume::new(grid, data).unwrap();
        for p in [Point::new(-0.3, 0.77, 2.61), Point::new(0.99, 1.49, 2.0), Point::new(-1.0, 0.0, 2.0)] {
            assert!((v.trilinear(p, 0.0) - field(p)).abs() < 1e-12);
        }
        let inside = v.grid().continuous_index(Point::new(-0.3, 0.77, 2.61));
        assert!((v.trilinear_inside(inside).unwrap() - field(Point::new(-0.3, 0.77, 2.61))).abs() < 1e-12);
        for outside in [[-0.1, 1.0, 1.0], [1.0, 3.0, 1.0], [1.0, 1.0, f64::NAN]] {
            assert_eq!(v.trilinear_inside(outside), None);
        }
        let half = v.trilinear(Point::new(-1.25, 0.0, 2.0), 0.0);
        assert!((half - 0.5 * field(Point::new(-1.0, 0.0, 2.0))).abs() < 1e-12);
        assert_eq!(v.trilinear(Point::new(99.0, 0.0, 0.0), -5.0), -5.0);
        assert_eq!(v.trilinear(Point::new(f64::NAN, 0.0, 0.0), -5.0), -5.0);
    }

    #[test]
    fn a_wrong_count_is_refused() {
        let grid = Grid::<Work>::aligned([2, 2, 2], 1.0, Point::new(0.0, 0.0, 0.0)).unwrap();
        assert_eq!(Volume::new(grid, vec![0.0; 7]).unwrap_err(), VolumeError { expected: 8, found: 7 });
    }
}
