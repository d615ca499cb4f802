//! `forces.csv`: the force toward every structure near each waypoint, in ct.
//!
//! `waypoints.csv` names one structure per row, the one with the smallest distance less clearance. In this file every
//! structure has a row at each waypoint where the burr is within its influence: the burr's surface is within the clearance
//! plus 8 mm. The structure that `waypoints.csv` names has a row at any distance.

use std::io::Write;
use std::path::Path;

use bonemill_case::Structure;
use nalgebra::Vector3;

use super::PlanFileError;
use super::cells::{Row, push_number, read_rows, structure_name, write_rows};
use super::columns::{FORCES_ROWS, names};

/// The file's name in a plan's directory.
pub const FORCES: &str = "forces.csv";

/// The columns, in order.
const COLUMNS: [&str; 10] = names(&FORCES_ROWS);

/// One row of `forces.csv`, in ct.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ForceToward {
    /// The waypoint.
    pub waypoint: usize,
    /// The structure's index in the case.
    pub structure: usize,
    /// Distance from the burr's centre to the structure's nearest point, mm.
    pub distance_mm: f64,
    /// Unit direction from the burr's centre to that point.
    pub toward: Vector3<f64>,
    /// The force's component along it, max(0, F·u), N; 0 in air.
    pub force_toward_n: f64,
    /// Largest component along it within the move as the arm drives it, N; at least `force_toward_n`.
    pub peak_toward_n: f64,
    /// Mean of the component max(0, F·u) over the time of the move, N; 0 where it is planned to remove nothing.
    pub mean_toward_n: f64,
    /// The deflection's component along it, not negative, µm; `None` without a stiffness.
    pub deflection_toward_um: Option<f64>,
}

/// Writes `forces.csv` and syncs it to disk.
///
/// # Errors
/// [`PlanFileError`] when a value is not finite, a structure is not in `structures`, or the file cannot be written.
pub fn write_forces(
    path: &Path,
    rows: &[ForceToward],
    structures: &[Structure],
) -> Result<(), PlanFileError> {
    write_rows(path, &COLUMNS, rows, |out, _, row| {
        let index = row.waypoint;
        let name = structure_name(structures, row.structure, index)?;
        // writing to a Vec cannot fail
        let _ = write!(out, "{index},{name}");
        let u = row.toward;
        let forces = [row.force_toward_n, row.peak_toward_n, row.mean_toward_n];
        let numbers = [row.distance_mm, u.x, u.y, u.z].into_iter().chain(forces);
        for (value, column) in numbers.map(Some).chain([row.deflection_toward_um]).zip(&COLUMNS[2..]) {
            out.push(b',');
            push_number(out, value, || format!("`{column}` toward {name} at waypoint {index}"))?;
        }
        Ok(())
    })
}

/// Reads `forces.csv` of a plan with the given number of waypoints.
///
/// # Errors
/// [`PlanFileError`] with line and column: another header, a wrong number of cells, a waypoint that the plan lacks, rows out
/// of order, a cell that is not a finite number, a direction that is not a unit vector, a structure that the case lacks.
pub fn read_forces(
    path: &Path,
    waypoints: usize,
    structures: &[Structure],
) -> Result<Vec<ForceToward>, PlanFileError> {
    read_rows(path, &COLUMNS, |row, before: &[ForceToward]| {
        let found = read_row(row, structures)?;
        if found.waypoint >= waypoints {
            return Err(row.refuse(0, format!("a waypoint, below {waypoints}")));
        }
        let place = |f: &ForceToward| (f.waypoint, f.structure);
        if before.last().is_some_and(|last| place(last) >= place(&found)) {
            return Err(row.refuse(0, "rows by waypoint, then in the case's order of structures, each once"));
        }
        Ok(found)
    })
}

fn read_row(row: &Row<'_>, structures: &[Structure]) -> Result<ForceToward, PlanFileError> {
    let not_negative = |column| {
        let value = row.number(column)?;
        if value >= 0.0 { Ok(value) } else { Err(row.refuse(column, "a number that is not negative")) }
    };
    Ok(ForceToward {
        waypoint: row.whole(0)? as usize,
        structure: row.structure(1, structures)?,
        distance_mm: not_negative(2)?,
        toward: row.unit(3, "direction")?,
        force_toward_n: not_negative(6)?,
        peak_toward_n: not_negative(7)?,
        mean_toward_n: not_negative(8)?,
        deflection_toward_um: row.optional(9)?,
    })
}

#[cfg(test)]
#[path = "forces_tests.rs"]
mod tests;
