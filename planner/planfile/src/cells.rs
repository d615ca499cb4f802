//! Tables of a plan: a fixed header, one row per line, and each number as the shortest decimal that reads back equal.
//!
//! The reader accepts exactly the writer's format; anything else is an error that names line and column.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use bonemill_case::Structure;
use nalgebra::Vector3;

use super::PlanFileError;

/// Largest deviation of a direction from unit length.
const UNIT_TOLERANCE: f64 = 1e-6;

/// Writes a table and syncs it to disk; `push` appends one row, without the line's end.
pub(super) fn write_rows<T>(
    path: &Path,
    columns: &[&str],
    rows: &[T],
    push: impl Fn(&mut Vec<u8>, usize, &T) -> Result<(), PlanFileError>,
) -> Result<(), PlanFileError> {
    let file = File::create(path).map_err(PlanFileError::io("create", path))?;
    let mut out = BufWriter::with_capacity(1 << 16, file);
    let mut text = Vec::with_capacity(1 << 16);
    text.extend_from_slice(columns.join(",").as_bytes());
    text.push(b'\n');
    for (index, row) in rows.iter().enumerate() {
        push(&mut text, index, row)?;
        text.push(b'\n');
        if text.len() > 1 << 15 {
            out.write_all(&text).map_err(PlanFileError::io("write", path))?;
            text.clear();
        }
    }
    out.write_all(&text).map_err(PlanFileError::io("write", path))?;
    let file = out.into_inner().map_err(|e| PlanFileError::io("write", path)(e.into_error()))?;
    file.sync_all().map_err(PlanFileError::io("write", path))
}

/// Appends a number, or nothing for `None`; `what` names it in the error if it is not finite.
pub fn push_number(
    out: &mut Vec<u8>,
    value: Option<f64>,
    what: impl FnOnce() -> String,
) -> Result<(), PlanFileError> {
    match value {
        Some(v) if !v.is_finite() => return Err(PlanFileError::NotFinite { what: what(), value: v }),
        // + 0.0 turns −0 into 0; writing to a Vec cannot fail
        Some(v) => drop(write!(out, "{:?}", v + 0.0)),
        None => {}
    }
    Ok(())
}

/// The name of the case's structure n, to which waypoint `index` refers.
pub fn structure_name(
    structures: &[Structure],
    structure: usize,
    index: usize,
) -> Result<&str, PlanFileError> {
    let missing = || PlanFileError::NoSuchStructure { index, structure, count: structures.len() };
    structures.get(structure).map(|s| s.name.as_str()).ok_or_else(missing)
}

/// Reads a table; `read` makes an entry from a row and the entries before it.
pub(super) fn read_rows<T>(
    path: &Path,
    columns: &'static [&'static str],
    read: impl Fn(&Row<'_>, &[T]) -> Result<T, PlanFileError>,
) -> Result<Vec<T>, PlanFileError> {
    let text = std::fs::read_to_string(path).map_err(PlanFileError::io("read", path))?;
    let refuse = |line, found, expected| PlanFileError::Row { path: path.into(), line, found, expected };
    let mut lines = text.lines().zip(1..);
    let header = columns.join(",");
    let found = lines.next().map_or("", |(line, _)| line);
    if found != header {
        return Err(refuse(1, format!("the header {found:?}"), format!("{header:?}")));
    }
    let mut entries = Vec::new();
    for (text, line) in lines {
        let cells: Vec<&str> = text.split(',').collect();
        if cells.len() != columns.len() {
            return Err(refuse(line, format!("{} cells", cells.len()), columns.len().to_string()));
        }
        let entry = read(&Row { path, line, columns, cells }, &entries)?;
        entries.push(entry);
    }
    Ok(entries)
}

/// One row and its place in the file.
pub(super) struct Row<'a> {
    path: &'a Path,
    line: usize,
    columns: &'static [&'static str],
    cells: Vec<&'a str>,
}

impl Row<'_> {
    pub fn refuse(&self, column: usize, expected: impl Into<String>) -> PlanFileError {
        PlanFileError::Cell {
            path: self.path.into(),
            line: self.line,
            column: self.columns.get(column).copied().unwrap_or_default(),
            found: self.text(column).into(),
            expected: expected.into(),
        }
    }

    pub fn text(&self, column: usize) -> &str {
        self.cells.get(column).copied().unwrap_or_default()
    }

    pub fn whole(&self, column: usize) -> Result<u32, PlanFileError> {
        self.text(column).parse().map_err(|_| self.refuse(column, "a whole number"))
    }

    pub fn optional(&self, column: usize) -> Result<Option<f64>, PlanFileError> {
        if self.text(column).is_empty() { Ok(None) } else { self.number(column).map(Some) }
    }

    pub fn number(&self, column: usize) -> Result<f64, PlanFileError> {
        let number = self.text(column).parse().ok().filter(|v: &f64| v.is_finite());
        number.ok_or_else(|| self.refuse(column, "a finite number"))
    }

    pub fn vector(&self, column: usize) -> Result<Vector3<f64>, PlanFileError> {
        Ok(Vector3::new(self.number(column)?, self.number(column + 1)?, self.number(column + 2)?))
    }

    /// Three cells that hold a unit vector; `what` names it, e.g. `axis`.
    pub fn unit(&self, column: usize, what: &str) -> Result<Vector3<f64>, PlanFileError> {
        let vector = self.vector(column)?;
        if (vector.norm() - 1.0).abs() <= UNIT_TOLERANCE {
            return Ok(vector);
        }
        Err(self.refuse(column, format!("a unit {what}, but its length is {}", vector.norm())))
    }

    /// Index in the case of the structure that the cell names.
    pub fn structure(&self, column: usize, structures: &[Structure]) -> Result<usize, PlanFileError> {
        let place = structures.iter().position(|s| s.name == self.text(column));
        place.ok_or_else(|| self.refuse(column, "a structure of the case"))
    }
}
