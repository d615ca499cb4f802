//! `waypoints.csv`: one row per waypoint.

use std::io::Write;
use std::path::Path;

use bonemill_case::Structure;
use bonemill_cutting::cutter::MoveKind;
use bonemill_geometry::Point;

use super::cells::{Row, push_number, read_rows, structure_name, write_rows};
use super::columns::{WAYPOINTS, names};
use super::{PlanFileError, Waypoint};

/// The columns, in order.
const COLUMNS: [&str; 27] = names(&WAYPOINTS);

/// Writes `waypoints.csv` and syncs it to disk.
///
/// # Errors
/// [`PlanFileError`] when a value is not finite, a structure is not in `structures`, or the file cannot be written.
pub fn write_waypoints(
    path: &Path,
    waypoints: &[Waypoint],
    structures: &[Structure],
) -> Result<(), PlanFileError> {
    write_rows(path, &COLUMNS, waypoints, |row, index, w| push_row(row, index, w, structures))
}

fn push_row(
    row: &mut Vec<u8>,
    index: usize,
    w: &Waypoint,
    structures: &[Structure],
) -> Result<(), PlanFileError> {
    let name = w.structure.map_or(Ok(""), |n| structure_name(structures, n, index))?;
    let p = w.position.coords;
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
        w.driven_mm_s,
        w.mass_mg,
    ];
    let force = [
        w.inertia,
        Some(w.force_n.x),
        Some(w.force_n.y),
        Some(w.force_n.z),
        Some(w.peak_force_n),
        Some(w.mean_force_n),
        w.force_toward_n,
    ];
    let after = [w.distance_mm, w.alpha1, w.cost, w.deflection_toward_um];
    // writing to a Vec cannot fail
    let _ = write!(row, "{index},{},{}", w.layer, w.kind.word());
    let mut columns = COLUMNS.iter().skip(3);
    let mut cell = |row: &mut Vec<u8>, value: Option<f64>| {
        let column = columns.next();
        row.push(b',');
        push_number(row, value, || format!("`{}` of waypoint {index}", column.unwrap_or(&"")))
    };
    before.into_iter().map(Some).chain(force).try_for_each(|v| cell(row, v))?;
    cell(row, None)?;
    row.extend_from_slice(name.as_bytes());
    after.into_iter().try_for_each(|v| cell(row, v))
}

/// Reads `waypoints.csv`.
///
/// # Errors
/// [`PlanFileError`] with line and column: another header, a wrong number of cells, an index out of order, a cell that is
/// not a finite number, a time that decreases, an axis that is not a unit vector, a structure that the case lacks.
pub fn read_waypoints(path: &Path, structures: &[Structure]) -> Result<Vec<Waypoint>, PlanFileError> {
    read_rows(path, &COLUMNS, |row, before: &[Waypoint]| {
        let waypoint = read_row(row, before.len(), structures)?;
        if let Some(last) = before.last().filter(|last| waypoint.time_s < last.time_s) {
            return Err(row.refuse(3, format!("at least {} s, the time of the row before", last.time_s)));
        }
        Ok(waypoint)
    })
}

fn read_row(row: &Row<'_>, index: usize, structures: &[Structure]) -> Result<Waypoint, PlanFileError> {
    if usize::try_from(row.whole(0)?) != Ok(index) {
        return Err(row.refuse(0, format!("{index}, the row's place from 0")));
    }
    Ok(Waypoint {
        layer: row.whole(1)?,
        kind: MoveKind::from_word(row.text(2)).ok_or_else(|| row.refuse(2, "cut, link or retract"))?,
        time_s: row.number(3)?,
        position: Point::from_coords(row.vector(4)?),
        axis: row.unit(7, "axis")?,
        theta_rad: row.number(10)?,
        phi_rad: row.number(11)?,
        speed_mm_s: row.number(12)?,
        driven_mm_s: row.number(13)?,
        mass_mg: row.number(14)?,
        inertia: row.optional(15)?,
        force_n: row.vector(16)?,
        peak_force_n: row.number(19)?,
        mean_force_n: row.number(20)?,
        force_toward_n: row.optional(21)?,
        structure: if row.text(22).is_empty() { None } else { Some(row.structure(22, structures)?) },
        distance_mm: row.optional(23)?,
        alpha1: row.optional(24)?,
        cost: row.optional(25)?,
        deflection_toward_um: row.optional(26)?,
    })
}

#[cfg(test)]
#[path = "csv_tests.rs"]
mod tests;
