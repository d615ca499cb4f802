//! Compares the reader of DICOM series with SimpleITK's, on a series of 512 × 512 × 600 voxels that SimpleITK writes; both with two threads.

use bonemill_imaging::{AffineChoice, read_ct};

use super::{ask, least_s};
use crate::{ExperimentError, Table};

const RUNS: usize = 3;
/// Size of the series' pixels, MB.
const PIXELS_MB: f64 = 512.0 * 512.0 * 600.0 * 2.0 / 1e6;

pub(super) fn table() -> Result<Table, ExperimentError> {
    let title = format!(
        "A DICOM series of 512 × 512 × 600 beside SimpleITK (PyPI), two threads, the least of {RUNS} runs, files in memory"
    );
    let columns = ["reader", "time [s]", "memory [times the pixels' size]", "sum of all voxels"];
    let mut table = Table::new("peers-scans", title, &columns);
    let folder = tempfile::tempdir().map_err(ExperimentError::Folder)?;
    let row = |name: &str, time_s: f64, memory_mb: f64, sum: f64| {
        vec![
            name.into(),
            format!("{time_s:.2}"),
            format!("{:.2}", memory_mb / PIXELS_MB),
            format!("{sum:.0}"),
        ]
    };
    match ask(include_str!("scans.py"), folder.path()).as_deref() {
        Ok([peer]) if peer.len() == 3 => table.push(row("SimpleITK", peer[0], peer[1], peer[2])),
        Ok(_) => table.push(vec!["SimpleITK".into(), "not measured".into(), "-".into(), "-".into()]),
        Err(why) => table.push(vec!["SimpleITK".into(), why.clone(), "-".into(), "-".into()]),
    }
    let series = folder.path().join("series");
    if !series.exists() {
        return Ok(table);
    }
    // the peak begins anew; where the system does not allow it, it is that of the whole process
    let _ = std::fs::write("/proc/self/clear_refs", "5");
    let before_mb = peak_mb();
    let two = rayon::ThreadPoolBuilder::new().num_threads(2).build();
    let read = || least_s(RUNS, || read_ct(&series, AffineChoice::Auto));
    let (time_s, image) = two.map_or_else(|_| read(), |two| two.install(read));
    let gained_mb = peak_mb() - before_mb;
    let Some(image) = image.transpose()? else { return Ok(table) };
    let sum: f64 = image.volume.data().iter().map(|hu| f64::from(*hu)).sum();
    table.push(row("bonemill", time_s, gained_mb, sum));
    Ok(table)
}

/// The most memory that this process has held, MB; NaN where the system does not tell.
fn peak_mb() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    line.and_then(|line| line.trim().strip_suffix("kB")?.trim().parse().ok())
        .map_or(f64::NAN, |kb: f64| kb * 1.024e-3)
}
