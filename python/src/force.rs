//! The burr's force and engagement in a density field.

use std::cell::{Cell, RefCell};

use bonemill_geometry::{Point, Volume, Work};
use bonemill_planner::burr::{
    BurrForce, Discretisation, ElementGrid, Material, Measure, ModelError, Motion, Tool,
    burr_force as rust_burr_force,
};
use bonemill_planner::metrics::engagement_metrics as rust_engagement_metrics;
use nalgebra::Vector3;
use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyReadonlyArray1, PyReadonlyArray3};
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyDict};

use crate::{arrays, errors};

/// radius, blades, spin, helix_deg, kappa_min, kappa_max.
type ToolArgs = (f64, u32, i32, f64, f64, f64);
/// K, Ke, rho_ref, p, rho_min, t0.
type MaterialArgs = ([f64; 3], [f64; 3], f64, f64, f64, f64);
/// n_gamma, n_kappa, grid, measure, sample_offset.
type DiscArgs = (usize, usize, String, String, f64);
/// center, axis, velocity, rpm.
type MotionArgs = ([f64; 3], [f64; 3], [f64; 3], f64);

/// The source of the density.
#[derive(FromPyObject)]
pub enum Field<'py> {
    /// Voxels; the density is 0 outside them.
    Voxels(PyReadonlyArray3<'py, f64>),
    /// A function of points, shape (n, 3), that returns densities, shape (n).
    Function(Bound<'py, PyAny>),
}

fn tool((radius, blades, spin, helix_deg, kappa_min, kappa_max): ToolArgs) -> Result<Tool, ModelError> {
    Tool::new(radius, blades, spin)?.with_helix(helix_deg.to_radians())?.with_kappa(kappa_min, kappa_max)
}

fn material((k, k_edge, rho_ref, p, rho_min, t0): MaterialArgs) -> Result<Material, ModelError> {
    Material::new(k, rho_ref)?.with_edge(k_edge, t0)?.with_density_law(p, rho_min)
}

/// The discretisation of these values. The words were checked by the caller; any other word means the first choice.
fn disc((n_gamma, n_kappa, grid, measure, offset): DiscArgs) -> Result<Discretisation, ModelError> {
    let grid = if grid == "z" { ElementGrid::Z } else { ElementGrid::Kappa };
    let measure = if measure == "dz" { Measure::Dz } else { Measure::Db };
    Discretisation::new(n_gamma, n_kappa, grid, measure)?.with_sample_offset(offset)
}

/// The mean force and other results of the same sum, with the names of the reference cases.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "one per part of the model; the package's Python names them")]
pub fn burr_force<'py>(
    py: Python<'py>,
    field: Field<'py>,
    spacing_mm: [f64; 3],
    origin_mm: [f64; 3],
    motion: MotionArgs,
    tool_args: ToolArgs,
    material_args: MaterialArgs,
    disc_args: DiscArgs,
) -> PyResult<Bound<'py, PyDict>> {
    let model = |e: ModelError| errors::model(&e);
    let (center, axis, velocity, rpm) = motion;
    let motion = Motion::<Work>::new(Point::from_coords(center.into()), axis.into(), velocity.into(), rpm)
        .map_err(model)?;
    let (tool, material) = (tool(tool_args).map_err(model)?, material(material_args).map_err(model)?);
    let disc = disc(disc_args).map_err(model)?;
    let force = match field {
        Field::Voxels(array) => {
            let volume: Volume<f64, Work> = arrays::volume(&array, spacing_mm, origin_mm)?;
            py.detach(|| rust_burr_force(|p| volume.trilinear(p, 0.0), &tool, &material, &disc, &motion))
        }
        Field::Function(function) => {
            // the sampled points do not depend on the density, so the function is called once for all of them before the sum
            let asked = RefCell::new(Vec::new());
            let record = |p: Point<Work>| {
                asked.borrow_mut().extend_from_slice(p.coords.as_slice());
                0.0
            };
            rust_burr_force(record, &tool, &material, &disc, &motion);
            let densities = densities_at(&function, asked.into_inner())?;
            let next = Cell::new(0);
            let replay = |_: Point<Work>| densities.get(next.replace(next.get() + 1)).copied().unwrap_or(0.0);
            rust_burr_force(replay, &tool, &material, &disc, &motion)
        }
    };
    force_dict(py, &force)
}

/// The densities that `function` returns for points, given as x, y, z of one point after the other.
fn densities_at(function: &Bound<'_, PyAny>, coordinates: Vec<f64>) -> PyResult<Vec<f64>> {
    let count = coordinates.len() / 3;
    let points = Array2::from_shape_vec((count, 3), coordinates)
        .map_err(|e| errors::ArrayError::new_err(e.to_string()))?;
    let found = function.call1((points.into_pyarray(function.py()),))?;
    let found: PyReadonlyArray1<'_, f64> = found.extract()?;
    let found: Vec<f64> = found.as_array().iter().copied().collect();
    if found.len() != count {
        let text = format!("density gave {} values for {count} points: expected one each", found.len());
        return Err(errors::ArrayError::new_err(text));
    }
    match found.iter().position(|v| !v.is_finite()) {
        None => Ok(found),
        Some(n) => {
            let text = format!("density gave {} at point {n}: expected finite g/cm³", found[n]);
            Err(errors::ArrayError::new_err(text))
        }
    }
}

fn force_dict<'py>(py: Python<'py>, force: &BurrForce) -> PyResult<Bound<'py, PyDict>> {
    let dict = [
        ("torque", force.torque_nmm),
        ("power_spindle", force.spindle_power_mw),
        ("power_feed", force.feed_power_mw),
        ("mrr", force.mrr_mm3_s),
        ("mrr_w", force.weighted_mrr_mm3_s),
        ("contact_area", force.contact_area_mm2),
        ("t_max", force.t_max_mm),
        ("F_peak", force.peak_force_n),
    ]
    .into_py_dict(py)?;
    for (name, vector) in [
        ("F", &force.force_n),
        ("M", &force.moment_nmm),
        ("F_tool", &force.force_tool_n),
        ("M_tool", &force.moment_tool_nmm),
    ] {
        dict.set_item(name, vector.as_slice().to_vec().into_pyarray(py))?;
    }
    for (name, rows) in [("basis_cut", &force.basis_cut_mm2), ("basis_edge", &force.basis_edge_mm)] {
        dict.set_item(name, Array2::from_shape_fn((3, 3), |(m, a)| rows[m][a]).into_pyarray(py))?;
    }
    Ok(dict)
}

/// Mass and inertia of the bone in the ball, with the names of the reference cases.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "keyword arguments of a Python function")]
pub fn engagement_metrics<'py>(
    py: Python<'py>,
    density: PyReadonlyArray3<'py, f64>,
    spacing_mm: [f64; 3],
    origin_mm: [f64; 3],
    center_mm: [f64; 3],
    axis: [f64; 3],
    radius_mm: f64,
) -> PyResult<Bound<'py, PyDict>> {
    let volume: Volume<f64, Work> = arrays::volume(&density, spacing_mm, origin_mm)?;
    let at = Motion::<Work>::new(Point::from_coords(center_mm.into()), axis.into(), Vector3::zeros(), 1.0)
        .map_err(|e| errors::model(&e))?;
    let found = py.detach(|| rust_engagement_metrics(&volume, at.center(), &at.axis(), radius_mm));
    let dict = [
        ("V", found.volume_mm3),
        ("m", found.mass_mg),
        ("I", found.inertia_mg_mm2),
        ("In", found.inertia_normalised),
        ("I_true", found.true_inertia_mg_mm2),
        ("In_true", found.true_inertia_normalised),
        ("z2_mean", found.z2_mean_mm2),
    ]
    .into_py_dict(py)?;
    dict.set_item("n_vox", found.voxels)?;
    Ok(dict)
}
