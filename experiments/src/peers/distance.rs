//! Compares distance fields with PyPI `edt`.

use bonemill_geometry::{Ct, Grid, Point, Volume};
use bonemill_imaging::{distance_only, distance_transform};

use super::{ask, least_s};
use crate::{ExperimentError, Table};

/// Voxels along a side, and their size.
const N: usize = 256;
const VOXEL_MM: f64 = 0.25;
const RUNS: usize = 5;

/// Masks like those in planning, as is(x, y, z) in voxels: thin structures (a nerve), blocks (a labyrinth), large ones (dura),
/// and, as the worst case, scattered voxels.
pub fn masks() -> Vec<(&'static str, Volume<bool, Ct>)> {
    let ball = |p: [f64; 3], c: [f64; 3], r: f64| (0..3).map(|a| (p[a] - c[a]).powi(2)).sum::<f64>() < r * r;
    vec![
        (
            "tube",
            mask(|[x, y, z]| {
                let (cx, cy) = (90.0 + 20.0 * (z / 40.0).sin(), 110.0 + 25.0 * (z / 55.0).cos());
                (x - cx).hypot(y - cy) < 3.0 && (60.0..200.0).contains(&z)
            }),
        ),
        ("ball", mask(|p| ball(p, [120.0, 140.0, 128.0], 25.0))),
        ("sheet", mask(|[x, y, z]| (x + 0.3 * y - 0.2 * z - 200.0 - 10.0 * (y / 30.0).sin()).abs() < 4.0)),
        ("half", mask(|[x, y, z]| y + 20.0 * (x / 37.0).sin() + 15.0 * (z / 23.0).cos() > 160.0)),
        (
            "scattered",
            mask(|[x, y, z]| {
                ((x * 7919.0 + y * 104_729.0 + z * 1_299_709.0) as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15)
                    >> 54
                    == 0
            }),
        ),
    ]
}

fn mask(is: impl Fn([f64; 3]) -> bool) -> Volume<bool, Ct> {
    let grid = match Grid::aligned([N; 3], VOXEL_MM, Point::new(0.0, 0.0, 0.0)) {
        Ok(grid) => grid,
        Err(e) => unreachable!("{e}"),
    };
    let mut mask = Volume::filled(grid, false);
    for (n, v) in mask.data_mut().iter_mut().enumerate() {
        *v = is([(n % N) as f64, (n / N % N) as f64, (n / (N * N)) as f64]);
    }
    mask
}

pub(super) fn table() -> Result<Table, ExperimentError> {
    let title = format!("Distance fields {N}³ beside edt (PyPI), one thread, the least of {RUNS} runs");
    let columns = [
        "mask",
        "edt [ms]",
        "distance only [ms]",
        "times faster",
        "with nearest voxel [ms]",
        "times faster",
        "largest difference [mm]",
    ];
    let mut table = Table::new("peers-distance", title, &columns);
    for (name, mask) in masks() {
        let (only_s, distance) = least_s(RUNS, || distance_only(&mask));
        let distance = distance.transpose()?.flatten();
        let (nearest_s, _) = least_s(RUNS, || distance_transform(&mask));
        let folder = tempfile::tempdir().map_err(ExperimentError::Folder)?;
        let bytes: Vec<u8> = mask.data().iter().map(|v| u8::from(*v)).collect();
        std::fs::write(folder.path().join("mask"), bytes).map_err(ExperimentError::Folder)?;
        let distance: Vec<u8> =
            distance.iter().flat_map(|d| d.data()).flat_map(|mm| mm.to_le_bytes()).collect();
        std::fs::write(folder.path().join("distance_mm"), distance).map_err(ExperimentError::Folder)?;
        let peer = ask(include_str!("distance.py"), folder.path());
        let (peer_ms, ratios, difference) = match peer.as_deref() {
            Ok([answer]) if answer.len() == 2 => {
                let ratio = |own_s: f64| format!("{:.1}", answer[0] / own_s);
                (
                    format!("{:.0}", answer[0] * 1e3),
                    [ratio(only_s), ratio(nearest_s)],
                    format!("{:.1e}", answer[1]),
                )
            }
            Ok(_) => ("not measured".into(), ["-".into(), "-".into()], "-".into()),
            Err(why) => (why.clone(), ["-".into(), "-".into()], "-".into()),
        };
        let [only, nearest] = ratios;
        let ms = |s: f64| format!("{:.0}", s * 1e3);
        table.push(vec![name.into(), peer_ms, ms(only_s), only, ms(nearest_s), nearest, difference]);
    }
    Ok(table)
}
