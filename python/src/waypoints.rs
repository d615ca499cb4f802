//! The rows of `waypoints.csv` and `forces.csv` as columns.

use bonemill_planner::path::MoveKind;
use bonemill_planner::plan::{ForceToward, Waypoint};
use numpy::{IntoPyArray, PyArray1};
use pyo3::prelude::*;

/// A column's name and a row's value; `None` is an empty cell.
type Column = (&'static str, fn(&Waypoint) -> Option<f64>);

/// The columns that hold numbers, in the file's order.
const COLUMNS: [Column; 23] = [
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
    ("driven_mm_s", |w| Some(w.driven_mm_s)),
    ("mass_mg", |w| Some(w.mass_mg)),
    ("inertia", |w| w.inertia),
    ("fx_n", |w| Some(w.force_n.x)),
    ("fy_n", |w| Some(w.force_n.y)),
    ("fz_n", |w| Some(w.force_n.z)),
    ("peak_force_n", |w| Some(w.peak_force_n)),
    ("mean_force_n", |w| Some(w.mean_force_n)),
    ("force_toward_n", |w| w.force_toward_n),
    ("distance_mm", |w| w.distance_mm),
    ("alpha1", |w| w.alpha1),
    ("cost", |w| w.cost),
    ("deflection_toward_um", |w| w.deflection_toward_um),
];

/// Numeric columns by name; NaN where a cell is empty, and without −0, as in the file.
pub fn numbers<'py>(py: Python<'py>, rows: &[Waypoint]) -> Vec<(&'static str, Bound<'py, PyArray1<f64>>)> {
    let column = |(name, value): &Column| {
        let values = rows.iter().map(|w| value(w).map_or(f64::NAN, |v| v + 0.0));
        (*name, values.collect::<Vec<_>>().into_pyarray(py))
    };
    COLUMNS.iter().map(column).collect()
}

/// Layer, kind (index in [`kinds`]) and structure (index in the case, −1 for none) of every row.
pub type Codes<'py> = (Bound<'py, PyArray1<u32>>, Bound<'py, PyArray1<u8>>, Bound<'py, PyArray1<i64>>);

/// The columns of words, as numbers.
pub fn codes<'py>(py: Python<'py>, rows: &[Waypoint]) -> Codes<'py> {
    let kind = |w: &Waypoint| MoveKind::ALL.iter().position(|k| *k == w.kind).unwrap_or(0) as u8;
    let structure = |w: &Waypoint| w.structure.map_or(-1, |n| n as i64);
    (
        rows.iter().map(|w| w.layer).collect::<Vec<_>>().into_pyarray(py),
        rows.iter().map(kind).collect::<Vec<_>>().into_pyarray(py),
        rows.iter().map(structure).collect::<Vec<_>>().into_pyarray(py),
    )
}

/// A column of `forces.csv`.
type ForceColumn = (&'static str, fn(&ForceToward) -> Option<f64>);

/// The columns of `forces.csv` that hold quantities, in its order.
const FORCE_COLUMNS: [ForceColumn; 8] = [
    ("distance_mm", |f| Some(f.distance_mm)),
    ("toward_x", |f| Some(f.toward.x)),
    ("toward_y", |f| Some(f.toward.y)),
    ("toward_z", |f| Some(f.toward.z)),
    ("force_toward_n", |f| Some(f.force_toward_n)),
    ("peak_toward_n", |f| Some(f.peak_toward_n)),
    ("mean_toward_n", |f| Some(f.mean_toward_n)),
    ("deflection_toward_um", |f| f.deflection_toward_um),
];

/// Waypoints, structures (indices in the case) and the quantities by name.
pub type Forces<'py> =
    (Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<i64>>, Vec<(&'static str, Bound<'py, PyArray1<f64>>)>);

/// The rows of `forces.csv`; NaN where a cell is empty.
pub fn forces<'py>(py: Python<'py>, rows: &[ForceToward]) -> Forces<'py> {
    let places = |of: fn(&ForceToward) -> usize| {
        rows.iter().map(|f| of(f) as i64).collect::<Vec<_>>().into_pyarray(py)
    };
    let column = |(name, value): &ForceColumn| {
        let values = rows.iter().map(|f| value(f).map_or(f64::NAN, |v| v + 0.0));
        (*name, values.collect::<Vec<_>>().into_pyarray(py))
    };
    (places(|f| f.waypoint), places(|f| f.structure), FORCE_COLUMNS.iter().map(column).collect())
}

/// Words of the kinds of moves, as in the file.
pub fn kinds() -> Vec<&'static str> {
    MoveKind::ALL.iter().map(|k| k.word()).collect()
}
