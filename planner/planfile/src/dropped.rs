//! `dropped.csv` read back: the places that the path leaves out for the shank's sake, and what stood in the way.

use std::io::ErrorKind;
use std::path::Path;

use bonemill_geometry::{Ct, Point};

use super::columns::{DROPPED, names};
use super::{NOTES, PlanFileError};

/// The columns, in order.
const COLUMNS: [&str; 4] = names(&DROPPED);

/// The places that the plan in `dir` leaves out, and the reasons; none without the file.
///
/// # Errors
/// [`PlanFileError::Row`] for another header, or a row that is not three finite numbers and a quoted reason; [`PlanFileError::Io`].
pub fn read_dropped(dir: &Path) -> Result<Vec<(Point<Ct>, String)>, PlanFileError> {
    let path = dir.join(NOTES[1]);
    let text = match std::fs::read_to_string(&path) {
        Ok(text) => text,
        Err(e) if e.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
        Err(e) => return Err(PlanFileError::io("read", path)(e)),
    };
    let refuse = |line, found: &str, expected: &str| PlanFileError::Row {
        path: path.clone(),
        line,
        found: format!("{found:?}"),
        expected: expected.into(),
    };
    let mut lines = text.lines().zip(1..);
    let (header, expected) = (lines.next().map_or("", |(line, _)| line), COLUMNS.join(","));
    if header != expected {
        return Err(refuse(1, header, &format!("the header {expected:?}")));
    }
    lines
        .map(|(line, n)| place(line).ok_or_else(|| refuse(n, line, "x, y and z, mm, and a quoted reason")))
        .collect()
}

fn place(line: &str) -> Option<(Point<Ct>, String)> {
    let mut cells = line.splitn(COLUMNS.len(), ',');
    let mut number = || cells.next()?.parse().ok().filter(|mm: &f64| mm.is_finite());
    let at = Point::new(number()?, number()?, number()?);
    let reason = cells.next()?.strip_prefix('"')?.strip_suffix('"')?;
    Some((at, reason.replace("\"\"", "\"")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_and_quoted_reasons_come_back_and_a_damaged_row_is_named() {
        let dir = tempfile::tempdir().unwrap();
        assert_eq!(read_dropped(dir.path()).unwrap(), []);
        let file = dir.path().join("dropped.csv");
        let text = "x_mm,y_mm,z_mm,reason\n1.0,-2.5,3.0,\"near \"\"a, b\"\"\"\n";
        std::fs::write(&file, text).unwrap();
        let found = read_dropped(dir.path()).unwrap();
        assert_eq!(found, [(Point::new(1.0, -2.5, 3.0), "near \"a, b\"".to_owned())]);
        for (damaged, says) in [("1.0,-2.5", "1.0;-2.5"), ("3.0", "inf"), ("z_mm", "w_mm")]
            .map(|(from, to)| (text.replacen(from, to, 1), to))
        {
            std::fs::write(&file, damaged).unwrap();
            let error = read_dropped(dir.path()).unwrap_err().to_string();
            assert!(error.contains("dropped.csv") && error.contains(says), "{error}");
        }
    }
}
