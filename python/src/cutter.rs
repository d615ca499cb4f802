//! Drills, reamers and cutters from meshes: their edge elements, and what these feel.

use std::path::PathBuf;

use bonemill_geometry::{Point, Tool};
use bonemill_planner::cutter::{
    Cutter as RustCutter, CuttingEdges, EdgeElement, EdgeKind, EdgeSource, GlenoidReamer, GlenoidReamerSpec,
    MeshCutter, MeshCutterSpec, TwistDrill, TwistDrillSpec,
};
use bonemill_planner::edge::{CoefficientModel, EdgeLoads};
use bonemill_planner::mesh_tool::cutter_from_file;
use numpy::IntoPyArray;
use numpy::ndarray::Array2;
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyDict};

use crate::errors;

/// Forces do not depend on the speed where coefficients are constant, rpm.
const ANY_SPEED_RPM: f64 = 60.0;

/// R, eps_deg, theta_deg, psi_deg, w, Nc.
type DrillArgs = (f64, f64, f64, f64, f64, u32);
/// R, w, R_outer, alpha_deg, Nc, beta_as_printed.
type ReamerArgs = (f64, f64, f64, f64, u32, bool);
/// f, kc, kf, n_elements.
type CutArgs = (f64, f64, f64, usize);

fn model(error: impl std::fmt::Display) -> PyErr {
    errors::ModelError::new_err(error.to_string())
}

/// Forces of a drill's lips, and of its chisel edge where `chisel`, with the static rake where not `dynamic_rake`.
#[pyfunction]
pub fn drill_force<'py>(
    py: Python<'py>,
    drill: DrillArgs,
    cut: CutArgs,
    chisel: bool,
    dynamic_rake: bool,
) -> PyResult<Bound<'py, PyDict>> {
    let (radius_mm, point_deg, helix_deg, chisel_deg, web_mm, lips) = drill;
    let spec = TwistDrillSpec { radius_mm, point_deg, helix_deg, chisel_deg, web_mm, lips, flute_mm: 1.0 };
    let mut drill = TwistDrill::new(spec).map_err(model)?;
    if !dynamic_rake {
        drill = drill.with_static_chisel_rake();
    }
    let (edges, loads) = loads(&drill, cut)?;
    let of = |kind: EdgeKind| loads.axial(|_, load| f64::from(u8::from(load.kind == kind)));
    let (lips, across) = (of(EdgeKind::Lip), of(EdgeKind::Chisel));
    let dict = PyDict::new(py);
    dict.set_item("lips", sums(py, lips)?)?;
    dict.set_item("Rc", drill.inner_radius_mm())?;
    if chisel {
        dict.set_item("chisel", sums(py, across)?)?;
        let total = [("Fz", lips[0] + across[0]), ("torque", -(lips[1] + across[1]))].into_py_dict(py)?;
        dict.set_item("total", total)?;
    }
    let wanted = |e: &&EdgeElement| chisel || e.kind == EdgeKind::Lip;
    dict.set_item(
        "angles",
        element_dict(py, &edges.elements.iter().filter(wanted).copied().collect::<Vec<_>>())?,
    )?;
    Ok(dict)
}

/// Forces of a reamer's edges.
#[pyfunction]
pub fn reamer_force<'py>(py: Python<'py>, reamer: ReamerArgs, cut: CutArgs) -> PyResult<Bound<'py, PyDict>> {
    let (arc_radius_mm, offset_mm, rim_radius_mm, edge_deg, edges, as_printed) = reamer;
    let spec = GlenoidReamerSpec {
        arc_radius_mm,
        offset_mm,
        rim_radius_mm,
        edge_deg,
        edges,
        nipple_radius_mm: 0.0,
        nipple_length_mm: 0.0,
    };
    let made = if as_printed { GlenoidReamer::with_beta_as_printed(spec) } else { GlenoidReamer::new(spec) };
    let (edges, loads) = loads(&made.map_err(model)?, cut)?;
    let dict = sums(py, loads.axial(|_, _| 1.0))?;
    dict.set_item("angles", element_dict(py, &edges.elements)?)?;
    Ok(dict)
}

fn loads(cutter: &dyn RustCutter, (feed, k_c, k_f, count): CutArgs) -> PyResult<(CuttingEdges, EdgeLoads)> {
    let edges = cutter.edges(feed, count).map_err(model)?;
    let coefficients = CoefficientModel::constant(k_c, k_f).map_err(model)?;
    let loads = EdgeLoads::new(&edges, feed, ANY_SPEED_RPM, &coefficients);
    Ok((edges, loads))
}

fn sums(py: Python<'_>, [fz, mz, fx]: [f64; 3]) -> PyResult<Bound<'_, PyDict>> {
    // + 0.0: no minus zero without feed
    [("Fz", fz), ("Mz", mz), ("torque", -mz + 0.0), ("Fx_per_lip", fx)].into_py_dict(py)
}

/// A number of an edge element.
type ElementNumber = fn(&EdgeElement) -> f64;

/// The elements as arrays, by the names of the reference.
fn element_dict<'py>(py: Python<'py>, elements: &[EdgeElement]) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    let columns: [(&str, ElementNumber); 9] = [
        ("r", |e| e.radius_mm),
        ("width", |e| e.width_mm),
        ("feed_share", |e| e.feed_share),
        ("epsilon", |e| e.epsilon_rad),
        ("beta", |e| e.beta_rad),
        ("mu", |e| e.mu_rad),
        ("lambda", |e| e.lambda_rad),
        ("tau", |e| e.tau_rad),
        ("gamma_n", |e| e.gamma_n_rad),
    ];
    for (name, column) in columns {
        dict.set_item(name, elements.iter().map(column).collect::<Vec<f64>>().into_pyarray(py))?;
    }
    dict.set_item("kind", elements.iter().map(|e| e.kind.word()).collect::<Vec<_>>())?;
    let points: Vec<Point<Tool>> = elements.iter().map(|e| e.position_mm).collect();
    dict.set_item("position", points_array(py, &points))?;
    Ok(dict)
}

fn points_array<'py>(py: Python<'py>, points: &[Point<Tool>]) -> Bound<'py, numpy::PyArray2<f64>> {
    Array2::from_shape_fn((points.len(), 3), |(n, a)| points[n].coords[a]).into_pyarray(py)
}

/// A cutter from a mesh.
#[pyclass(frozen)]
pub struct Cutter {
    cutter: MeshCutter,
}

/// Axis, a point of it (mm), spin, least dihedral angle (rad).
type MeshArgs = ([f64; 3], [f64; 3], i8, f64);

#[pymethods]
impl Cutter {
    /// Reads an STL, OBJ or PLY; `edges` are polylines in mm.
    #[new]
    fn new(
        path: PathBuf,
        scale_mm: f64,
        args: MeshArgs,
        edges: Option<Vec<Vec<[f64; 3]>>>,
    ) -> PyResult<Self> {
        let named = |e: &dyn std::error::Error| model(format!("{}: {}", path.display(), errors::words(e)));
        let (axis, axis_point_mm, spin, least_rad) = args;
        let edges = edges.map_or(EdgeSource::Dihedral { least_rad }, EdgeSource::Polylines);
        let spec = MeshCutterSpec { axis: axis.into(), axis_point_mm: axis_point_mm.into(), spin, edges };
        let cutter = cutter_from_file(&path, scale_mm, &spec).map_err(|e| named(&e))?;
        Ok(Self { cutter })
    }

    /// Its elements at a feed, mm a revolution.
    fn elements<'py>(&self, py: Python<'py>, feed: f64, count: usize) -> PyResult<Bound<'py, PyDict>> {
        element_dict(py, &self.cutter.edges(feed, count).map_err(model)?.elements)
    }

    /// Force and moment with every element in bone.
    fn force<'py>(&self, py: Python<'py>, cut: CutArgs) -> PyResult<Bound<'py, PyDict>> {
        let force = loads(&self.cutter, cut)?.1.all_engaged();
        let dict = [("Fz", force.thrust_n()), ("torque", force.torque_nmm())].into_py_dict(py)?;
        for (name, vector) in [("F", force.force_n), ("M", force.moment_nmm)] {
            dict.set_item(name, vector.as_slice().to_vec().into_pyarray(py))?;
        }
        Ok(dict)
    }

    /// Points (z, r) of the solid that it sweeps when it turns, mm, shape (n, 2).
    fn profile<'py>(&self, py: Python<'py>) -> Bound<'py, numpy::PyArray2<f64>> {
        let profile = self.cutter.solid().profile();
        Array2::from_shape_fn((profile.len(), 2), |(n, a)| profile[n][a]).into_pyarray(py)
    }

    /// Points of each cutting edge, mm.
    fn edges<'py>(&self, py: Python<'py>) -> Vec<Bound<'py, numpy::PyArray2<f64>>> {
        self.cutter.polylines().iter().map(|line| points_array(py, line)).collect()
    }
}
