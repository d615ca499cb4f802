//! Converts arrays. Python indexes [i, j, k]; this project's memory is x-fastest, which numpy calls Fortran order.

use bonemill_geometry::{Frame, Grid, Volume};
use nalgebra::{Matrix3, Vector3};
use numpy::ndarray::{Array3, ShapeBuilder};
use numpy::{Element, IntoPyArray, PyArray3, PyReadonlyArray3};
use pyo3::prelude::*;

use crate::errors;

/// The values of an array of any strides, x-fastest.
pub fn x_fastest<T: Element + Copy>(array: &PyReadonlyArray3<'_, T>) -> Vec<T> {
    let turned = array.as_array().reversed_axes();
    match turned.as_slice() {
        Some(values) => values.to_vec(),
        None => turned.iter().copied().collect(),
    }
}

/// An array as a volume along the axes; `origin_mm` is the centre of voxel (0, 0, 0).
pub fn volume<T: Element + Copy, F: Frame>(
    array: &PyReadonlyArray3<'_, T>,
    spacing_mm: [f64; 3],
    origin_mm: [f64; 3],
) -> PyResult<Volume<T, F>> {
    let (nx, ny, nz) = array.as_array().dim();
    let (spacing, origin) = (Vector3::from(spacing_mm), Vector3::from(origin_mm));
    let grid = Grid::new([nx, ny, nz], spacing, Matrix3::identity(), origin).map_err(|e| errors::grid(&e))?;
    Volume::new(grid, x_fastest(array)).map_err(|e| errors::volume(&e))
}

/// Values, x-fastest, as an array [i, j, k] that owns them.
pub fn to_numpy<T: Element>(
    py: Python<'_>,
    dims: [usize; 3],
    values: Vec<T>,
) -> PyResult<Bound<'_, PyArray3<T>>> {
    let shape = (dims[0], dims[1], dims[2]).f();
    let array =
        Array3::from_shape_vec(shape, values).map_err(|e| errors::ArrayError::new_err(e.to_string()))?;
    Ok(array.into_pyarray(py))
}
