//! The rows of `waypoints.csv` as columns.

use bonemill_planner::path::MoveKind;
use bonemill_planner::plan::Waypoint;
use numpy::{IntoPyArray, PyArray1};
use pyo3::prelude::*;

/// A column's name and a row's value; `None` is an empty cell.
type Column = (&'static str, fn(&Waypoint) -> Option<f64>);

/// The columns that hold numbers, in the file's order.
const COLUMNS: [Column; 20] = [
    ("time_s", |w| Some(w.time_s)),
    ("x_mm", |w| Some(w.position.x())),
    ("y_mm", |w| Some(w.position.y())),
    ("z_mm", |w| Some(w.position.z())),
    ("axis_x", |w| Some(w.axis.x)),
    ("axis_y", |w| Some(w.axis.y)),
    ("axis_z", |w| Some(w.axis.z)),
    ("theta_rad", |w| Some(w.theta_rad)),
    ("phi_rad", |w| Some(w.phi_rad)),
    ("speed_mm_s", |w| Some(w.speed_mm_s)),
    ("mass_mg", |w| Some(w.mass_mg)),
    ("inertia", |w| w.inertia),
    ("fx_n", |w| w.force_n.map(|f| f.x)),
    ("fy_n", |w| w.force_n.map(|f| f.y)),
    ("fz_n", |w| w.force_n.map(|f| f.z)),
    ("force_toward_n", |w| w.force_toward_n),
    ("distance_mm", |w| w.distance_mm),
    ("alpha1", |w| w.alpha1),
    ("cost", |w| w.cost),
    ("deflection_toward_um", |w| w.deflection_toward_um),
];

/// Numeric columns by name; NaN, numpy's way, where a cell is empty, and like the file without −0.
pub fn numbers<'py>(py: Python<'py>, rows: &[Waypoint]) -> Vec<(&'static str, Bound<'py, PyArray1<f64>>)> {
    let column = |(name, value): &Column| {
        let values = rows.iter().map(|w| value(w).map_or(f64::NAN, |v| v + 0.0));
        (*name, values.collect::<Vec<_>>().into_pyarray(py))
    };
    COLUMNS.iter().map(column).collect()
}

/// Layer, kind (place in [`kinds`]) and structure (place in the case, −1: none) of every row.
pub type Codes<'py> = (Bound<'py, PyArray1<u32>>, Bound<'py, PyArray1<u8>>, Bound<'py, PyArray1<i64>>);

/// The columns that hold no numbers, as numbers.
pub fn codes<'py>(py: Python<'py>, rows: &[Waypoint]) -> Codes<'py> {
    let kind = |w: &Waypoint| MoveKind::ALL.iter().position(|k| *k == w.kind).unwrap_or(0) as u8;
    let structure = |w: &Waypoint| w.structure.map_or(-1, |n| n as i64);
    (
        rows.iter().map(|w| w.layer).collect::<Vec<_>>().into_pyarray(py),
        rows.iter().map(kind).collect::<Vec<_>>().into_pyarray(py),
        rows.iter().map(structure).collect::<Vec<_>>().into_pyarray(py),
    )
}

/// Words of the kinds of moves, as in the file.
pub fn kinds() -> Vec<&'static str> {
    MoveKind::ALL.iter().map(|k| k.word()).collect()
}
