//! Reads `trajectory.csv`, the joint trajectory, and checks every row before anything uses it.

use std::path::Path;

use rayon::prelude::*;

use super::PlanFileError;

/// Number of bytes that one task parses.
const PART_BYTES: usize = 1 << 20;

/// The joints over time. Row-major: the value of joint j in row k is `q[k * dof + j]`.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    /// Joints per row, at least 1.
    pub dof: usize,
    /// Time of every row, s, increasing from 0.
    pub time_s: Vec<f64>,
    /// Positions, rows × dof; rad, or mm where prismatic.
    pub q: Vec<f64>,
    /// Velocities, rows × dof; rad/s, or mm/s where prismatic.
    pub qd: Vec<f64>,
}

impl Trajectory {
    /// Number of rows.
    pub fn len(&self) -> usize {
        self.time_s.len()
    }

    /// Whether there is no row; always false for a trajectory that was read.
    pub fn is_empty(&self) -> bool {
        self.time_s.is_empty()
    }

    /// Joint positions of a row, `dof` values.
    pub fn q_at(&self, row: usize) -> &[f64] {
        &self.q[row * self.dof..(row + 1) * self.dof]
    }

    /// Joint velocities of a row, `dof` values.
    pub fn qd_at(&self, row: usize) -> &[f64] {
        &self.qd[row * self.dof..(row + 1) * self.dof]
    }

    /// Reads a trajectory of an arm with `dof` joints.
    ///
    /// # Errors
    /// [`PlanFileError`] with the line: another header, a wrong number of cells, a cell that is not a finite number, a time that
    /// does not start at 0 or does not increase, no row at all.
    pub fn read(path: &Path, dof: usize) -> Result<Self, PlanFileError> {
        let text = std::fs::read_to_string(path).map_err(PlanFileError::io("read", path))?;
        let refuse = |line: usize, found: String, expected: String| PlanFileError::Row {
            path: path.into(),
            line,
            found,
            expected,
        };
        let header = header(dof);
        let first = text.lines().next().unwrap_or("");
        if first != header {
            return Err(refuse(1, format!("the header {first:?}"), format!("{header:?}")));
        }
        let rows = text.split_once('\n').map_or("", |(_, rows)| rows);
        let parts: Vec<Part> = parts(rows).into_par_iter().map(|part| Part::parse(part, dof)).collect();
        let mut read = Self { dof, time_s: Vec::new(), q: Vec::new(), qd: Vec::new() };
        let mut line = 2;
        for part in parts {
            for row in part.rows.chunks_exact(1 + 2 * dof) {
                let expected = match read.time_s.last() {
                    None if row[0] != 0.0 => Some("a clock that starts at 0".to_owned()),
                    Some(last) if row[0] <= *last => Some(format!("later than {last} s")),
                    _ => None,
                };
                if let Some(expected) = expected {
                    return Err(refuse(line, format!("the time {} s", row[0]), expected));
                }
                read.time_s.push(row[0]);
                read.q.extend_from_slice(&row[1..=dof]);
                read.qd.extend_from_slice(&row[1 + dof..]);
                line += 1;
            }
            if let Some((found, expected)) = part.wrong {
                return Err(refuse(line, found, expected));
            }
        }
        if read.is_empty() {
            return Err(refuse(2, "no row".into(), "at least one row".into()));
        }
        Ok(read)
    }
}

/// Splits the text into parts of whole lines of about [`PART_BYTES`].
fn parts(mut text: &str) -> Vec<&str> {
    let mut parts = Vec::with_capacity(text.len() / PART_BYTES + 1);
    while !text.is_empty() {
        let from = PART_BYTES.min(text.len());
        let end =
            text.as_bytes()[from..].iter().position(|b| *b == b'\n').map_or(text.len(), |n| from + n + 1);
        let (part, rest) = text.split_at(end);
        parts.push(part);
        text = rest;
    }
    parts
}

/// Some lines: the rows up to the first invalid one, and its fault: found, expected.
struct Part {
    rows: Vec<f64>,
    wrong: Option<(String, String)>,
}

impl Part {
    fn parse(text: &str, dof: usize) -> Self {
        let width = 1 + 2 * dof;
        let mut part = Self { rows: Vec::new(), wrong: None };
        for line in text.lines() {
            let before = part.rows.len();
            for cell in line.split(',') {
                let Some(value) = cell.parse().ok().filter(|v: &f64| v.is_finite()) else {
                    part.rows.truncate(before);
                    part.wrong = Some((format!("{cell:?}"), "a finite number".into()));
                    return part;
                };
                part.rows.push(value);
            }
            let cells = part.rows.len() - before;
            if cells != width {
                part.rows.truncate(before);
                part.wrong = Some((format!("{cells} cells"), width.to_string()));
                return part;
            }
        }
        part
    }
}

fn header(dof: usize) -> String {
    let names = |name: &'static str| (1..=dof).map(move |joint| format!(",{name}{joint}"));
    std::iter::once("time_s".to_owned()).chain(names("q")).chain(names("qd")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Trajectory, PlanFileError> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("trajectory.csv");
        std::fs::write(&path, text).unwrap();
        Trajectory::read(&path, 2)
    }

    #[test]
    fn rows_come_back_in_place() {
        let t = read("time_s,q1,q2,qd1,qd2\n0,1,2,3,4\n0.002,5,6,7,-8e-1\n").unwrap();
        assert_eq!((t.len(), t.q_at(1), t.qd_at(1)), (2, &[5.0, 6.0][..], &[7.0, -0.8][..]));
        assert_eq!(t.time_s, [0.0, 0.002]);
    }

    #[test]
    fn parts_are_joined_in_order_and_the_first_wrong_line_is_named() {
        let row = |n: usize| format!("{},{n},-{n}.5,0.25,1e-3\n", n as f64 * 0.002);
        let text: String =
            std::iter::once("time_s,q1,q2,qd1,qd2\n".to_owned()).chain((0..120_000).map(row)).collect();
        assert!(text.len() > 2 * PART_BYTES);
        let t = read(&text).unwrap();
        assert_eq!(t.len(), 120_000);
        assert!(
            (0..t.len()).all(|n| t.q_at(n) == [n as f64, -(n as f64) - 0.5] && t.qd_at(n) == [0.25, 1e-3])
        );
        for wrong in [[70_000, 110_000], [40, 119_999]] {
            let lines: Vec<&str> = text.lines().collect();
            let with = |n: usize| if wrong.contains(&n) { "0,1,2,three,4" } else { lines[n] };
            let text: Vec<&str> = (0..lines.len()).map(with).collect();
            let message = read(&text.join("\r\n")).unwrap_err().to_string();
            assert!(
                message.contains(&format!(":{}: ", wrong[0] + 1)) && message.contains("three"),
                "{message}"
            );
        }
    }

    #[test]
    fn what_is_no_trajectory_is_refused_with_its_line() {
        let head = "time_s,q1,q2,qd1,qd2\n";
        for (text, line, says) in [
            (String::new(), 1, "header"),
            ("time_s,q1,qd1\n0,1,2\n".into(), 1, "header"),
            (head.into(), 2, "no row"),
            (format!("{head}0,1,2,3\n"), 2, "4 cells"),
            (format!("{head}0,1,2,3,4\n0.002,1,NaN,3,4\n"), 3, "NaN"),
            (format!("{head}0,1,2,3,4\n0,1,2,3,4\n"), 3, "later"),
            (format!("{head}0.002,1,2,3,4\n"), 2, "starts at 0"),
            (format!("{head}0,1,2,3,four\n"), 2, "four"),
        ] {
            let message = read(&text).unwrap_err().to_string();
            assert!(message.contains(&format!(":{line}: ")) && message.contains(says), "{message}");
        }
    }
}
