//! `trajectory.csv` read back: what the arm is told, row by row, checked before anyone moves by it.

use std::path::Path;

use super::PlanFileError;

/// The joints over time. Row-major: the value of joint j in row k is `q[k * dof + j]`.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    /// Joints per row, at least 1.
    pub dof: usize,
    /// Clock of every row, s, rising, from 0.
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

    /// Whether there is no row; never so for one that was read.
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
    /// [`PlanFileError`] naming the line: another header, a wrong number of cells, a number that is none or not
    /// finite, a clock that does not start at 0 or does not rise, no row at all.
    pub fn read(path: &Path, dof: usize) -> Result<Self, PlanFileError> {
        let text = std::fs::read_to_string(path).map_err(PlanFileError::io("read", path))?;
        let refuse = |line: usize, found: String, expected: String| PlanFileError::Row {
            path: path.into(),
            line,
            found,
            expected,
        };
        let mut lines = text.lines().enumerate().map(|(n, line)| (n + 1, line));
        let header = header(dof);
        let first = lines.next().map_or("", |(_, line)| line);
        if first != header {
            return Err(refuse(1, format!("the header {first:?}"), format!("{header:?}")));
        }
        let mut read = Self { dof, time_s: Vec::new(), q: Vec::new(), qd: Vec::new() };
        let mut row = Vec::with_capacity(1 + 2 * dof);
        for (line, text) in lines {
            row.clear();
            for cell in text.split(',') {
                let value = cell.parse().ok().filter(|v: &f64| v.is_finite());
                let finite = || refuse(line, format!("{cell:?}"), "a finite number".into());
                row.push(value.ok_or_else(finite)?);
            }
            if row.len() != 1 + 2 * dof {
                return Err(refuse(line, format!("{} cells", row.len()), (1 + 2 * dof).to_string()));
            }
            match read.time_s.last() {
                None if row[0] != 0.0 => {
                    return Err(refuse(
                        line,
                        format!("the time {} s", row[0]),
                        "a clock that starts at 0".into(),
                    ));
                }
                Some(last) if row[0] <= *last => {
                    return Err(refuse(
                        line,
                        format!("the time {} s", row[0]),
                        format!("later than {last} s"),
                    ));
                }
                _ => {}
            }
            read.time_s.push(row[0]);
            read.q.extend_from_slice(&row[1..=dof]);
            read.qd.extend_from_slice(&row[1 + dof..]);
        }
        if read.is_empty() {
            return Err(refuse(2, "no row".into(), "at least one row".into()));
        }
        Ok(read)
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
