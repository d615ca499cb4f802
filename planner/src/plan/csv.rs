//! `waypoints.csv`: a fixed header, one row per waypoint, numbers as the shortest decimal that reads back equal.
//!
//! The reader takes exactly what the writer makes; anything else is an error that names line and column.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use bonemill_geometry::Point;
use nalgebra::Vector3;

use super::{PlanFileError, Waypoint};
use crate::case::Structure;
use crate::path::MoveKind;

/// The columns, in order.
const COLUMNS: [&str; 24] = [
    "index",
    "layer",
    "kind",
    "time_s",
    "x_mm",
    "y_mm",
    "z_mm",
    "axis_x",
    "axis_y",
    "axis_z",
    "theta_rad",
    "phi_rad",
    "speed_mm_s",
    "mass_mg",
    "inertia",
    "fx_n",
    "fy_n",
    "fz_n",
    "force_toward_n",
    "structure",
    "distance_mm",
    "alpha1",
    "cost",
    "deflection_toward_um",
];

/// How far an axis may be from unit length.
const AXIS_TOLERANCE: f64 = 1e-6;

/// Writes `waypoints.csv` and makes it durable.
///
/// # Errors
/// [`PlanFileError`] when a value is not finite, a structure is not in `structures`, or the file cannot be written.
pub fn write_waypoints(
    path: &Path,
    waypoints: &[Waypoint],
    structures: &[Structure],
) -> Result<(), PlanFileError> {
    let file = File::create(path).map_err(PlanFileError::io("create", path))?;
    let mut out = BufWriter::with_capacity(1 << 16, file);
    let mut row = Vec::with_capacity(512);
    row.extend_from_slice(COLUMNS.join(",").as_bytes());
    row.push(b'\n');
    for (index, waypoint) in waypoints.iter().enumerate() {
        push_row(&mut row, index, waypoint, structures)?;
        if row.len() > 1 << 15 {
            out.write_all(&row).map_err(PlanFileError::io("write", path))?;
            row.clear();
        }
    }
    out.write_all(&row).map_err(PlanFileError::io("write", path))?;
    let file = out.into_inner().map_err(|e| PlanFileError::io("write", path)(e.into_error()))?;
    file.sync_all().map_err(PlanFileError::io("write", path))
}

fn push_row(
    row: &mut Vec<u8>,
    index: usize,
    w: &Waypoint,
    structures: &[Structure],
) -> Result<(), PlanFileError> {
    let name = match w.structure {
        None => "",
        Some(n) => match structures.get(n) {
            Some(s) => s.name.as_str(),
            None => {
                return Err(PlanFileError::NoSuchStructure { index, structure: n, count: structures.len() });
            }
        },
    };
    let p = w.position.coords;
    let f = w.force_n;
    let before = [
        w.time_s,
        p.x,
        p.y,
        p.z,
        w.axis.x,
        w.axis.y,
        w.axis.z,
        w.theta_rad,
        w.phi_rad,
        w.speed_mm_s,
        w.mass_mg,
    ];
    let force = [w.inertia, f.map(|f| f.x), f.map(|f| f.y), f.map(|f| f.z), w.force_toward_n];
    let after = [w.distance_mm, w.alpha1, w.cost, w.deflection_toward_um];
    // writing to a Vec cannot fail
    let _ = write!(row, "{index},{},{}", w.layer, w.kind.word());
    let mut columns = COLUMNS.iter().skip(3);
    let mut cell = |row: &mut Vec<u8>, value: Option<f64>| {
        let column = columns.next();
        row.push(b',');
        match value {
            Some(v) if !v.is_finite() => {
                let what = format!("`{}` of waypoint {index}", column.unwrap_or(&""));
                return Err(PlanFileError::NotFinite { what, value: v });
            }
            // + 0.0 makes −0 a plain 0
            Some(v) => drop(write!(row, "{:?}", v + 0.0)),
            None => {}
        }
        Ok(())
    };
    before.into_iter().map(Some).chain(force).try_for_each(|v| cell(row, v))?;
    cell(row, None)?;
    row.extend_from_slice(name.as_bytes());
    after.into_iter().try_for_each(|v| cell(row, v))?;
    row.push(b'\n');
    Ok(())
}

/// Reads `waypoints.csv`.
///
/// # Errors
/// [`PlanFileError`] naming line and column: another header, a wrong number of cells, an index out of order, a number
/// that is none or not finite, a time that falls, an axis that is no unit vector, a structure that the case lacks.
pub fn read_waypoints(path: &Path, structures: &[Structure]) -> Result<Vec<Waypoint>, PlanFileError> {
    let text = std::fs::read_to_string(path).map_err(PlanFileError::io("read", path))?;
    let mut lines = text.lines().enumerate().map(|(n, line)| (n + 1, line));
    let header = COLUMNS.join(",");
    match lines.next() {
        Some((_, found)) if found == header => {}
        other => {
            let found = format!("the header {:?}", other.map_or("", |(_, line)| line));
            return Err(PlanFileError::Row {
                path: path.into(),
                line: 1,
                found,
                expected: format!("{header:?}"),
            });
        }
    }
    let mut waypoints: Vec<Waypoint> = Vec::new();
    for (line, text) in lines {
        let row = Row { path, line, cells: cells(path, line, text)? };
        let waypoint = read_row(&row, waypoints.len(), structures)?;
        if let Some(last) = waypoints.last().filter(|last| waypoint.time_s < last.time_s) {
            return Err(row.refuse(3, format!("at least {} s, the time of the row before", last.time_s)));
        }
        waypoints.push(waypoint);
    }
    Ok(waypoints)
}

fn cells<'a>(path: &Path, line: usize, text: &'a str) -> Result<[&'a str; 24], PlanFileError> {
    let cells: Vec<_> = text.split(',').collect();
    let found = cells.len();
    <[&str; 24]>::try_from(cells).map_err(|_| PlanFileError::Row {
        path: path.into(),
        line,
        found: format!("{found} cells"),
        expected: format!("{}", COLUMNS.len()),
    })
}

/// One row and where it stands.
struct Row<'a> {
    path: &'a Path,
    line: usize,
    cells: [&'a str; 24],
}

impl Row<'_> {
    fn refuse(&self, column: usize, expected: impl Into<String>) -> PlanFileError {
        PlanFileError::Cell {
            path: self.path.into(),
            line: self.line,
            column: COLUMNS.get(column).copied().unwrap_or_default(),
            found: self.text(column).into(),
            expected: expected.into(),
        }
    }

    fn text(&self, column: usize) -> &str {
        self.cells.get(column).copied().unwrap_or_default()
    }

    fn whole(&self, column: usize) -> Result<u32, PlanFileError> {
        self.text(column).parse().map_err(|_| self.refuse(column, "a whole number"))
    }

    fn optional(&self, column: usize) -> Result<Option<f64>, PlanFileError> {
        if self.text(column).is_empty() { Ok(None) } else { self.number(column).map(Some) }
    }

    fn number(&self, column: usize) -> Result<f64, PlanFileError> {
        let number = self.text(column).parse().ok().filter(|v: &f64| v.is_finite());
        number.ok_or_else(|| self.refuse(column, "a finite number"))
    }

    fn vector(&self, column: usize) -> Result<Vector3<f64>, PlanFileError> {
        Ok(Vector3::new(self.number(column)?, self.number(column + 1)?, self.number(column + 2)?))
    }
}

fn read_row(row: &Row<'_>, index: usize, structures: &[Structure]) -> Result<Waypoint, PlanFileError> {
    if usize::try_from(row.whole(0)?) != Ok(index) {
        return Err(row.refuse(0, format!("{index}, the row's place from 0")));
    }
    let axis = row.vector(7)?;
    if (axis.norm() - 1.0).abs() > AXIS_TOLERANCE {
        return Err(row.refuse(7, format!("a unit axis, but its length is {}", axis.norm())));
    }
    let force_n =
        if (15..18).all(|column| row.text(column).is_empty()) { None } else { Some(row.vector(15)?) };
    Ok(Waypoint {
        layer: row.whole(1)?,
        kind: MoveKind::from_word(row.text(2)).ok_or_else(|| row.refuse(2, "cut, link or retract"))?,
        time_s: row.number(3)?,
        position: Point::from_coords(row.vector(4)?),
        axis,
        theta_rad: row.number(10)?,
        phi_rad: row.number(11)?,
        speed_mm_s: row.number(12)?,
        mass_mg: row.number(13)?,
        inertia: row.optional(14)?,
        force_n,
        force_toward_n: row.optional(18)?,
        structure: read_structure(row, structures)?,
        distance_mm: row.optional(20)?,
        alpha1: row.optional(21)?,
        cost: row.optional(22)?,
        deflection_toward_um: row.optional(23)?,
    })
}

fn read_structure(row: &Row<'_>, structures: &[Structure]) -> Result<Option<usize>, PlanFileError> {
    let name = row.text(19);
    if name.is_empty() {
        return Ok(None);
    }
    let place = structures.iter().position(|s| s.name == name);
    place.map(Some).ok_or_else(|| row.refuse(19, "a structure of the case"))
}

#[cfg(test)]
#[path = "csv_tests.rs"]
mod tests;
