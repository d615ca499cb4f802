//! Compares parts of this project with published libraries (peers) that could replace them, on the same inputs, in one run, on
//! one thread, but for the reader of scans.
//!
//! A peer is a Python package. A script beside this file calls it, run by the interpreter in `BONEMILL_PEERS_PYTHON` (else
//! `python3`; `pip install edt toppra pin SimpleITK`). Inputs are passed in files of a temporary folder. Each side measures the time of
//! the compared call alone, without reading, writing or making the input. A peer that is not installed gets a row that says so.
//!
//! | peer | our part | script |
//! |---|---|---|
//! | edt | distance fields | `distance.py` |
//! | toppra | the time law | `timelaw.py` |
//! | SimpleITK | the reader of DICOM series | `scans.py` |
//! | pin | forward kinematics and Jacobians | `kinematics.py` |

mod distance;
mod kinematics;
mod scans;
mod timelaw;

pub use distance::masks;

use std::path::Path;
use std::process::Command;

use bonemill_planner::Progress;

use crate::{ExperimentError, Size, Table, alone};

/// Environment variable with the interpreter that has the peers.
const PYTHON: &str = "BONEMILL_PEERS_PYTHON";

/// Measures every peer. The inputs are fixed, so `_size` is not used.
///
/// # Errors
/// [`ExperimentError`] when a file cannot be written or a peer's output is invalid.
pub fn run(_size: Size, progress: &dyn Progress) -> Result<Vec<Table>, ExperimentError> {
    // first, since it measures the most memory that was ever held
    progress.stage("scans");
    let scans = scans::table()?;
    progress.stage("distance fields");
    let distance = alone(distance::table)?;
    progress.stage("time law");
    let timelaw = alone(timelaw::table)?;
    progress.stage("kinematics");
    let kinematics = alone(kinematics::table)?;
    Ok(vec![scans, distance, timelaw, kinematics])
}

/// The output of a peer for the inputs in `folder`: one line per input with numbers separated by spaces; or the reason why
/// there is none.
fn ask(script: &str, folder: &Path) -> Result<Vec<Vec<f64>>, String> {
    ask_of(&std::env::var(PYTHON).unwrap_or_else(|_| "python3".into()), script, folder)
}

fn ask_of(python: &str, script: &str, folder: &Path) -> Result<Vec<Vec<f64>>, String> {
    let answer = Command::new(python)
        .args(["-c", script])
        .arg(folder)
        .output()
        .map_err(|e| format!("not measured: {python}: {e}"))?;
    let told = String::from_utf8_lossy(&answer.stderr);
    if !answer.status.success() {
        return Err(format!("not measured: {}", told.lines().last().unwrap_or("no answer")));
    }
    let text = String::from_utf8_lossy(&answer.stdout);
    let numbers = |line: &str| line.split_whitespace().map(str::parse).collect::<Result<Vec<f64>, _>>().ok();
    text.lines().map(|line| numbers(line).ok_or_else(|| format!("not measured: says {line:?}"))).collect()
}

/// The shortest duration of several runs, s, and the result of the last one.
fn least_s<T>(runs: usize, mut work: impl FnMut() -> T) -> (f64, Option<T>) {
    let (mut least, mut last) = (f64::INFINITY, None);
    for _ in 0..runs {
        let since = std::time::Instant::now();
        let result = work();
        least = least.min(since.elapsed().as_secs_f64());
        last = Some(result);
    }
    (least, last)
}

/// Writes numbers to a file, little-endian, one after the other.
fn write_f64(path: &Path, values: &[f64]) -> Result<(), ExperimentError> {
    let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    std::fs::write(path, bytes).map_err(ExperimentError::Folder)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_peer_answers_in_numbers_or_says_why_not() {
        let ask = |script| ask_of("python3", script, Path::new("a folder"));
        assert_eq!(
            ask("import sys; print(1, 2.5); print(len(sys.argv[1]))"),
            Ok(vec![vec![1.0, 2.5], vec![8.0]])
        );
        assert!(ask("import no_such_peer").unwrap_err().contains("No module named 'no_such_peer'"));
        assert!(ask("print('fast')").unwrap_err().contains("fast"));
        assert!(ask_of("no-such-python", "", Path::new("")).unwrap_err().contains("no-such-python"));
    }
}
