//! Force logs, row by row, for a calibration: a burr's poses and forces, or a drill's depth, thrust and torque.

use std::path::Path;

use bonemill_geometry::{Ct, Point};
use nalgebra::Vector3;

use super::PlanFileError;

/// The columns, in order; ct frame.
const COLUMNS: [&str; 10] =
    ["time_s", "x_mm", "y_mm", "z_mm", "axis_x", "axis_y", "axis_z", "fx_n", "fy_n", "fz_n"];

/// One row of a force log.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ForceLogRow {
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
pub fn read_force_log(path: &Path) -> Result<Vec<ForceLogRow>, PlanFileError> {
    let table = read_numbers(path, &[&COLUMNS])?.1;
    let mut rows: Vec<ForceLogRow> = Vec::new();
    for (line, v) in table {
        if let Some(last) = rows.last().filter(|last| v[0] <= last.time_s) {
            let (found, expected) = (format!("the time {} s", v[0]), format!("later than {} s", last.time_s));
            return Err(PlanFileError::Row { path: path.into(), line, found, expected });
        }
        rows.push(ForceLogRow {
            time_s: v[0],
            position: Point::new(v[1], v[2], v[3]),
            axis: Vector3::new(v[4], v[5], v[6]),
            force_n: Vector3::new(v[7], v[8], v[9]),
        });
    }
    Ok(rows)
}

/// The columns of a drill's log: depth below the face, or the time since the lowest edge met it.
const DRILL_COLUMNS: [[&str; 5]; 2] = [
    ["feed_mm_rev", "spindle_rpm", "depth_mm", "thrust_n", "torque_nmm"],
    ["feed_mm_rev", "spindle_rpm", "time_s", "thrust_n", "torque_nmm"],
];

/// One row of a drill's log.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DrillLogRow {
    /// Line of the file, from 1.
    pub line: usize,
    /// Feed, mm a revolution.
    pub feed_mm_rev: f64,
    /// Spindle speed, rpm.
    pub spindle_rpm: f64,
    /// Depth of the lowest edge below the face, mm.
    pub depth_mm: f64,
    /// Thrust, N.
    pub thrust_n: f64,
    /// Torque, N mm.
    pub torque_nmm: f64,
}

/// Reads a log of plunges through a flat face: a header with exactly the columns `feed_mm_rev,spindle_rpm,depth_mm,thrust_n,torque_nmm`,
/// or with `time_s` in the place of `depth_mm`; then the depth is the feed times the turns since time 0. Several plunges may follow each
/// other, in any order.
///
/// # Errors
/// [`PlanFileError`] with the line: another header, a wrong number of cells, a cell that is not a finite number.
pub fn read_drill_log(path: &Path) -> Result<Vec<DrillLogRow>, PlanFileError> {
    let (which, table) = read_numbers(path, &[&DRILL_COLUMNS[0], &DRILL_COLUMNS[1]])?;
    let row = |(line, v): (usize, [f64; 5])| {
        let [feed_mm_rev, spindle_rpm, place, thrust_n, torque_nmm] = v;
        let depth_mm = if which == 0 { place } else { feed_mm_rev * spindle_rpm / 60.0 * place };
        DrillLogRow { line, feed_mm_rev, spindle_rpm, depth_mm, thrust_n, torque_nmm }
    };
    Ok(table.into_iter().map(row).collect())
}

/// Lines, from 1, with their numbers.
type NumberedRows<const N: usize> = Vec<(usize, [f64; N])>;

/// A table of finite numbers under one of the given headers: which header, and each line's numbers.
pub(crate) fn read_numbers<const N: usize>(
    path: &Path,
    headers: &[&[&'static str; N]],
) -> Result<(usize, NumberedRows<N>), PlanFileError> {
    let text = std::fs::read_to_string(path).map_err(PlanFileError::io("read", path))?;
    let refuse =
        |line, found, expected: String| PlanFileError::Row { path: path.into(), line, found, expected };
    let mut lines = text.lines().enumerate().map(|(n, line)| (n + 1, line.trim_end()));
    let first = lines.next().map_or("", |(_, line)| line);
    let Some((which, columns)) = headers.iter().enumerate().find(|(_, columns)| columns.join(",") == first)
    else {
        let expected: Vec<String> =
            headers.iter().map(|columns| format!("{:?}", columns.join(","))).collect();
        return Err(refuse(1, format!("the header {first:?}"), expected.join(" or ")));
    };
    let mut rows = Vec::new();
    for (line, text) in lines.filter(|(_, text)| !text.is_empty()) {
        let cells: Vec<&str> = text.split(',').collect();
        if cells.len() != N {
            return Err(refuse(line, format!("{} cells", cells.len()), N.to_string()));
        }
        let mut v = [0.0; N];
        for (value, (cell, column)) in v.iter_mut().zip(cells.iter().zip(*columns)) {
            let number = cell.trim().parse().ok().filter(|v: &f64| v.is_finite());
            *value = number.ok_or_else(|| PlanFileError::Cell {
                path: path.into(),
                line,
                column,
                found: (*cell).into(),
                expected: "a finite number".into(),
            })?;
        }
        rows.push((line, v));
    }
    Ok((which, rows))
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
        assert!(read_drill_log(&path).unwrap_err().to_string().contains("time_s"));
        std::fs::write(&path, format!("{}\n0.02,500,6,9,3\n", DRILL_COLUMNS[1].join(","))).unwrap();
        let rows = read_drill_log(&path).unwrap();
        assert!(rows[0].line == 2 && (rows[0].depth_mm - 1.0).abs() < 1e-12, "{rows:?}");
        std::fs::write(&path, "t,x\n").unwrap();
        assert!(read_force_log(&path).unwrap_err().to_string().contains(":1:"));
    }
}
