//! A force log: poses and measured forces, row by row, for a calibration.

use std::path::Path;

use bonemill_geometry::{Ct, Point};
use nalgebra::Vector3;

use super::PlanFileError;

/// The columns, in order; ct frame.
const COLUMNS: [&str; 10] =
    ["time_s", "x_mm", "y_mm", "z_mm", "axis_x", "axis_y", "axis_z", "fx_n", "fy_n", "fz_n"];

/// One row of a force log.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LogRow {
    /// Clock, s.
    pub time_s: f64,
    /// Burr's centre.
    pub position: Point<Ct>,
    /// Shaft axis from the burr to the handpiece, of any length.
    pub axis: Vector3<f64>,
    /// Mean force on the burr, N.
    pub force_n: Vector3<f64>,
}

/// Reads a force log: a header with exactly the columns `time_s,x_mm,y_mm,z_mm,axis_x,axis_y,axis_z,fx_n,fy_n,fz_n`,
/// and rows in order of time.
///
/// # Errors
/// [`PlanFileError`] with the line: another header, a wrong number of cells, a cell that is not a finite number, a time that
/// does not increase.
pub fn read_force_log(path: &Path) -> Result<Vec<LogRow>, PlanFileError> {
    let text = std::fs::read_to_string(path).map_err(PlanFileError::io("read", path))?;
    let refuse =
        |line, found, expected: String| PlanFileError::Row { path: path.into(), line, found, expected };
    let mut lines = text.lines().enumerate().map(|(n, line)| (n + 1, line.trim_end()));
    let header = COLUMNS.join(",");
    let first = lines.next().map_or("", |(_, line)| line);
    if first != header {
        return Err(refuse(1, format!("the header {first:?}"), format!("{header:?}")));
    }
    let mut rows: Vec<LogRow> = Vec::new();
    for (line, text) in lines.filter(|(_, text)| !text.is_empty()) {
        let mut v = [0.0; 10];
        let cells: Vec<&str> = text.split(',').collect();
        if cells.len() != v.len() {
            return Err(refuse(line, format!("{} cells", cells.len()), v.len().to_string()));
        }
        for (value, (cell, column)) in v.iter_mut().zip(cells.iter().zip(COLUMNS)) {
            let number = cell.trim().parse().ok().filter(|v: &f64| v.is_finite());
            *value = number.ok_or_else(|| PlanFileError::Cell {
                path: path.into(),
                line,
                column,
                found: (*cell).into(),
                expected: "a finite number".into(),
            })?;
        }
        if let Some(last) = rows.last().filter(|last| v[0] <= last.time_s) {
            return Err(refuse(
                line,
                format!("the time {} s", v[0]),
                format!("later than {} s", last.time_s),
            ));
        }
        rows.push(LogRow {
            time_s: v[0],
            position: Point::new(v[1], v[2], v[3]),
            axis: Vector3::new(v[4], v[5], v[6]),
            force_n: Vector3::new(v[7], v[8], v[9]),
        });
    }
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_read_and_nonsense_is_refused_with_its_line() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("log.csv");
        let read = |rows: &str| {
            std::fs::write(&path, format!("{}\n{rows}", COLUMNS.join(","))).unwrap();
            read_force_log(&path)
        };
        let rows = read("0,1,2,3,0,0,1,0.5,-1,2\n0.1,1,2,4,0,0,1,0,0,0\n").unwrap();
        assert_eq!(
            (rows.len(), rows[0].force_n, rows[1].position.z()),
            (2, Vector3::new(0.5, -1.0, 2.0), 4.0)
        );
        for (rows, line) in [
            ("0,1,2,3,0,0,1,0.5,-1\n", ":2:"),
            ("0,1,2,3,0,0,1,0.5,-1,NaN\n", ":2: column `fz_n`"),
            ("0,1,2,3,0,0,1,0,0,0\n0,1,2,3,0,0,1,0,0,0\n", ":3:"),
        ] {
            let message = read(rows).unwrap_err().to_string();
            assert!(message.contains(line), "{message}");
        }
        std::fs::write(&path, "t,x\n").unwrap();
        assert!(read_force_log(&path).unwrap_err().to_string().contains(":1:"));
    }
}
