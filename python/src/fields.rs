//! Distance fields and ball volumes on arrays.

use bonemill_geometry::{Volume, Work};
use bonemill_imaging::DistanceField;
use bonemill_planner::ball;
use numpy::{IntoPyArray, PyArray1, PyArray3, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;
use rayon::prelude::*;

use crate::{apart, arrays, errors};

/// Distance in mm and the index, in C order, of the nearest true voxel; `None` if there is no true voxel.
type Distances<'py> = Option<(Bound<'py, PyArray3<f32>>, Bound<'py, PyArray3<u32>>)>;

/// Exact distance from voxel centres to the nearest true voxel's centre.
#[pyfunction]
pub fn distance_transform<'py>(
    py: Python<'py>,
    mask: PyReadonlyArray3<'py, bool>,
    spacing_mm: [f64; 3],
) -> PyResult<Distances<'py>> {
    let mask: Volume<bool, Work> = arrays::volume(&mask, spacing_mm, [0.0; 3])?;
    let dims = mask.grid().dims();
    let solved = apart::run(py, None, None, move |_| {
        let field = bonemill_imaging::distance_transform(&mask)?;
        Ok(field.map(|DistanceField { distance_mm, mut nearest }| {
            let [nx, ny, nz] = dims.map(|d| d as u32);
            nearest.par_iter_mut().for_each(|n| {
                let (i, j, k) = (*n % nx, *n / nx % ny, *n / (nx * ny));
                *n = k + nz * (j + ny * i);
            });
            (distance_mm.into_parts().1, nearest)
        }))
    })?;
    let Some((distance_mm, nearest)) = solved.map_err(|e| errors::image(&e))? else { return Ok(None) };
    Ok(Some((arrays::to_numpy(py, dims, distance_mm)?, arrays::to_numpy(py, dims, nearest)?)))
}

/// Volume of each box of `spacing_mm` about a centre, shape (n, 3), inside the ball, mm³, shape (n).
#[pyfunction]
pub fn ball_volumes<'py>(
    py: Python<'py>,
    centers_mm: PyReadonlyArray2<'py, f64>,
    ball_center_mm: [f64; 3],
    radius_mm: f64,
    spacing_mm: [f64; 3],
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let centers: Vec<f64> = centers_mm.as_array().iter().copied().collect();
    let volumes = apart::run(py, None, None, move |_| {
        centers
            .par_chunks_exact(3)
            .map(|center| {
                let side = |sign: f64| {
                    std::array::from_fn(|a| center[a] - ball_center_mm[a] + sign * 0.5 * spacing_mm[a])
                };
                ball::ball_box_volume(radius_mm, side(-1.0), side(1.0))
            })
            .collect::<Vec<f64>>()
    })?;
    Ok(volumes.into_pyarray(py))
}
