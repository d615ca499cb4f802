//! The data that a viewer draws of a plan, as arrays.

use std::path::PathBuf;

use bonemill_geometry::{Point, Work};
use bonemill_imaging::ImageError;
use bonemill_planner::pipeline::Refused;
use bonemill_planner::plan::Need;
use bonemill_planner::show::{
    self as rust, Moment, PAINTS, PLANES, Plot, Show, ShownBody, ShownFrame, ShownImages, ShownTool, Slice,
    Surface,
};
use bonemill_robot::RobotError;
use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray2};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

use crate::finished::{Finished, NotDone};
use crate::plan::Plan;
use crate::{apart, errors};

/// All data for a viewer.
struct Drawn {
    about: String,
    pixel_mm: Option<f64>,
    structures: Vec<(String, [u8; 3])>,
    bodies: Vec<ShownBody>,
    eye: [[f32; 3]; 2],
    path: Vec<[f32; 3]>,
    paints: Vec<(&'static str, Vec<[u8; 3]>)>,
    moments: Vec<Moment>,
    frames: Vec<ShownFrame>,
    tool: ShownTool,
    corridor: Option<Surface>,
    plots: Vec<Plot>,
}

/// Why a plan cannot be drawn.
enum Failed {
    Plan(NotDone),
    Images(Box<Refused>),
    Robot(RobotError),
}

/// The data for drawing a plan, which was written to `saved` unless it was read from its own folder: about `motion` times of the
/// arm and `frames` of the bone.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "keyword arguments of a Python function")]
pub fn show<'py>(
    py: Python<'py>,
    plan: &Plan,
    saved: Option<PathBuf>,
    motion: usize,
    frames: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let finished = Finished::new(plan, saved)?;
    let drawn = apart::run(py, progress, None, move |progress| {
        let plan = finished.read(Need::Unchanged).map_err(Failed::Plan)?;
        progress.expect(&["read images", "scene", "removal"].map(|name| (name, 1)));
        let show = Show::read(&plan, progress)
            .map_err(|e| Failed::Images(Box::new(Refused::new(e, &plan.record.case, &plan.case_path()))))?;
        draw(&show, motion, frames)
    })?;
    match drawn {
        Ok(drawn) => to_python(py, drawn),
        Err(Failed::Plan(error)) => Err(error.into()),
        Err(Failed::Images(error)) => Err(errors::refused(&error)),
        Err(Failed::Robot(error)) => Err(errors::robot(&error)),
    }
}

fn draw(show: &Show, motion: usize, frames: usize) -> Result<Drawn, Failed> {
    let plan = show.plan();
    let case = &plan.record.case;
    let refuse = |e: ImageError| Refused::new(e.into(), case, &plan.case_path());
    let bodies = show.bodies().map_err(|e| Failed::Images(Box::new(refuse(e))))?;
    let moments = show.moments(motion).map_err(Failed::Robot)?;
    let frames = show.frames(&moments, frames);
    let drawn_paints = PAINTS.iter().filter(|p| p.range(plan).is_some());
    Ok(Drawn {
        about: show.about(),
        pixel_mm: show.images().map(ShownImages::pixel_mm),
        structures: show.structure_colours().map(|(name, tint)| (name.to_owned(), tint)).collect(),
        bodies,
        eye: show.eye(),
        path: show.path().iter().map(single).collect(),
        paints: drawn_paints.map(|p| (p.name, p.colours(plan))).collect(),
        frames,
        tool: show.tool().clone(),
        corridor: show
            .corridor()
            .map_err(|e| Failed::Images(Box::new(Refused::new(e, case, &plan.case_path()))))?,
        plots: show.plots(&moments),
        moments,
    })
}

fn single(p: &Point<Work>) -> [f32; 3] {
    [p.x() as f32, p.y() as f32, p.z() as f32]
}

/// Rows of equal length as an array.
fn table<'py, T: numpy::Element + Copy, const N: usize>(
    py: Python<'py>,
    rows: &[[T; N]],
) -> Bound<'py, PyArray2<T>> {
    Array2::from_shape_fn((rows.len(), N), |(r, c)| rows[r][c]).into_pyarray(py)
}

fn surface<'py>(py: Python<'py>, s: &Surface) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    dict.set_item("vertices", table(py, &s.vertices))?;
    dict.set_item("normals", table(py, &s.normals))?;
    dict.set_item("triangles", table(py, &s.triangles))?;
    Ok(dict)
}

fn slice<'py>(py: Python<'py>, (slice, outline): (Slice, Vec<[f32; 2]>)) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    let image = |values: Vec<u8>| -> PyResult<_> {
        let image = Array2::from_shape_vec((slice.height, slice.width), values);
        Ok(image.map_err(|e| errors::ArrayError::new_err(e.to_string()))?.into_pyarray(py))
    };
    dict.set_item("grey", image(slice.grey.clone())?)?;
    dict.set_item("code", image(slice.code.clone())?)?;
    dict.set_item("outline", table(py, &outline))?;
    Ok(dict)
}

fn plot<'py>(py: Python<'py>, plot: Plot) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    dict.set_item("entity", plot.entity)?;
    dict.set_item("title", &plot.title)?;
    dict.set_item("time_s", plot.time_s)?;
    dict.set_item("values", plot.values)?;
    dict.set_item("legend", plot.legend())?;
    let curves = PyList::empty(py);
    for c in plot.curves {
        let (time_s, values) = (c.time_s.into_pyarray(py), c.values.into_pyarray(py));
        curves.append((c.entity, c.name, c.colour, time_s, values))?;
    }
    dict.set_item("curves", curves)?;
    Ok(dict)
}

fn to_python(py: Python<'_>, drawn: Drawn) -> PyResult<Bound<'_, PyDict>> {
    let all = PyDict::new(py);
    all.set_item("about", drawn.about)?;
    all.set_item("pixel_mm", drawn.pixel_mm)?;
    all.set_item("arrow_mm_per_n", rust::ARROW_MM_PER_N)?;
    all.set_item("planes", PLANES.map(|p| p.name))?;
    all.set_item("structures", drawn.structures)?;
    let bodies = PyList::empty(py);
    for b in &drawn.bodies {
        let dict = PyDict::new(py);
        dict.set_item("name", &b.name)?;
        dict.set_item("colour", b.colour)?;
        dict.set_item("name_colour", rust::light(b.colour))?;
        dict.set_item("surface", surface(py, &b.surface)?)?;
        dict.set_item("shell", surface(py, &b.shell)?)?;
        dict.set_item("large", b.large)?;
        dict.set_item("name_at", b.name_at)?;
        dict.set_item("leader", b.leader)?;
        bodies.append(dict)?;
    }
    all.set_item("bodies", bodies)?;
    all.set_item("eye", drawn.eye)?;
    all.set_item("path", table(py, &drawn.path))?;
    let paints = PyList::empty(py);
    for (name, colours) in &drawn.paints {
        paints.append((name, table(py, colours)))?;
    }
    all.set_item("paints", paints)?;
    let frames = PyList::empty(py);
    for frame in drawn.frames {
        let slices = PyList::empty(py);
        for found in frame.slices {
            slices.append(slice(py, found)?)?;
        }
        frames.append((frame.time_s, surface(py, &frame.target)?, slices))?;
    }
    all.set_item("frames", frames)?;
    all.set_item("cutter", surface(py, &drawn.tool.cutter)?)?;
    all.set_item("corridor", drawn.corridor.map(|corridor| surface(py, &corridor)).transpose()?)?;
    all.set_item("corridor_colour", rust::CUT_COLOUR)?;
    let shank = drawn.tool.shank.iter();
    let shank: Vec<_> = shank.map(|(c, is_thick)| (c.from_mm, c.to_mm, c.radius_mm, *is_thick)).collect();
    all.set_item("shank", shank)?;
    let plots = PyList::empty(py);
    for found in drawn.plots {
        plots.append(plot(py, found)?)?;
    }
    all.set_item("plots", plots)?;
    let moments = &drawn.moments;
    let at: Vec<[f32; 3]> =
        moments.iter().map(|m| single(&Point::from_coords(m.tool.translation_mm))).collect();
    let turn = |m: &Moment| {
        let q = nalgebra::UnitQuaternion::from_rotation_matrix(&m.tool.rotation);
        [q.i, q.j, q.k, q.w].map(|c| c as f32)
    };
    let force = |m: &Moment| -> [f32; 3] { m.force_n.unwrap_or_default().map(|f| f as f32).into() };
    all.set_item("time_s", moments.iter().map(|m| m.time_s).collect::<Vec<_>>().into_pyarray(py))?;
    all.set_item("at", table(py, &at))?;
    all.set_item("turn", table(py, &moments.iter().map(turn).collect::<Vec<_>>()))?;
    all.set_item("force", table(py, &moments.iter().map(force).collect::<Vec<_>>()))?;
    let links = PyList::empty(py);
    for m in moments {
        links.append(table(py, &m.links.iter().map(single).collect::<Vec<_>>()))?;
    }
    all.set_item("links", links)?;
    Ok(all)
}
