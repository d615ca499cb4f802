//! The published libraries that parts of this one could be replaced by, on the same inputs, in one run, on one thread.
//!
//! A peer is a Python package; its half is a script beside this file, run by the interpreter that `BONEMILL_PEERS_PYTHON`
//! names (`python3` otherwise; `pip install edt toppra pin`). Inputs go through files of a temporary folder; each side takes
//! its own time around the one call that is compared, without reading, writing or making the input. A peer that is not
//! installed is a row that says so.
//!
//! | peer | our part | script |
//! |---|---|---|
//! | edt | distance fields | `distance.py` |
//! | toppra | the time law | `timelaw.py` |
//! | pin | forward kinematics and Jacobians | `kinematics.py` |

mod distance;
mod kinematics;
mod timelaw;

pub use distance::masks;

use std::path::Path;
use std::process::Command;

use bonemill_planner::Progress;

use crate::{ExperimentError, Size, Table, alone};

/// Names the interpreter that has the peers.
const PYTHON: &str = "BONEMILL_PEERS_PYTHON";

/// Measures every peer. The inputs are given: `_size` changes nothing.
///
/// # Errors
/// [`ExperimentError`] when a file cannot be written or a peer gives an answer that is none.
pub fn run(_size: Size, progress: &dyn Progress) -> Result<Vec<Table>, ExperimentError> {
    progress.stage("distance fields");
    let distance = alone(distance::table)?;
    progress.stage("time law");
    let timelaw = alone(timelaw::table)?;
    progress.stage("kinematics");
    let kinematics = alone(kinematics::table)?;
    Ok(vec![distance, timelaw, kinematics])
}

/// What a peer prints about the inputs in `folder`: a line each, numbers between spaces; or why there is nothing.
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

/// The least of some runs, s, and what the last gave.
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

/// Numbers as a file that any language reads: little-endian, one after the other.
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
