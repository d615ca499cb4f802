//! Compares the time law with PyPI `toppra`, for the same joint paths, velocity and acceleration limits.
//!
//! toppra follows a cubic spline through the waypoints and has no jerk limits. This project's law rounds the polyline's corners
//! within a tolerance and also keeps jerk limits, here 20 times the acceleration limit per second. Neither has a speed cap.

use bonemill_robot::timelaw::{CornerTolerance, JointPath, PathLimits, PreparedPath};

use super::{ask, least_s, write_f64};
use crate::{ExperimentError, Table};

/// Limits of the bone-attached arm, three linear joints (mm) and a tilt (rad): velocities, accelerations and jerks.
const VELOCITY: [f64; 4] = [15.0, 15.0, 15.0, 0.6];
const ACCELERATION: [f64; 4] = [150.0, 150.0, 150.0, 6.0];
const JERK: [f64; 4] = [3000.0, 3000.0, 3000.0, 120.0];
const RUNS: usize = 3;

/// Waypoints of three linear joints and a tilt.
fn paths() -> Vec<(&'static str, Vec<[f64; 4]>)> {
    let helix = |count: usize| {
        (0..count)
            .map(|k| {
                let angle = 0.05 * k as f64;
                [5.0 * angle.cos(), 5.0 * angle.sin(), -0.01 * k as f64, 0.3 * angle.sin()]
            })
            .collect()
    };
    let raster = |count: usize| {
        (0..count)
            .map(|k| {
                let (line, along) = (k / 40, k % 40);
                let along = if line % 2 == 0 { along } else { 39 - along };
                let (x, y) = (0.25 * along as f64, line as f64);
                [x, y % 10.0, -1.5 * (line / 10) as f64, 0.2 * (0.6 * x).sin()]
            })
            .collect()
    };
    vec![
        ("helix, 500", helix(500)),
        ("helix, 2000", helix(2000)),
        ("raster, 500", raster(500)),
        ("raster, 2000", raster(2000)),
    ]
}

pub(super) fn table() -> Result<Table, ExperimentError> {
    let title = format!(
        "Time law beside toppra (PyPI), one thread, the least of {RUNS} runs; ratios to the limits at 10 kHz (toppra) and in \
         closed form (ours)"
    );
    let columns = [
        "path, waypoints",
        "toppra [µs a waypoint]",
        "ours [µs a waypoint]",
        "times faster",
        "toppra: velocity, acceleration",
        "ours: velocity, acceleration, jerk",
        "duration, toppra / ours [s]",
    ];
    let mut table = Table::new("peers-timelaw", title, &columns);
    let limits = PathLimits::new(&VELOCITY, &ACCELERATION, &JERK, CornerTolerance::default())?;
    for (name, q) in paths() {
        let way_mm =
            |ends: &[[f64; 4]]| (0..3).map(|j| (ends[1][j] - ends[0][j]).powi(2)).sum::<f64>().sqrt();
        let burr_mm: Vec<f64> = std::iter::once(0.0).chain(q.windows(2).map(way_mm)).collect();
        let pose: Vec<[f64; 6]> =
            q.iter().map(|[x, y, z, tilt]| [*x, *y, *z, -tilt.sin(), 0.0, tilt.cos()]).collect();
        let (flat, caps) = (q.concat(), vec![1e3; q.len()]);
        let path = JointPath { q: &flat, burr_mm: &burr_mm, pose: &pose, stops: &[] };
        let (own_s, law) = least_s(RUNS, || PreparedPath::new(&path, &limits)?.law(&caps));
        let Some(law) = law.transpose()? else { continue };
        let own = law.limit_ratios(&limits);

        let folder = tempfile::tempdir().map_err(ExperimentError::Folder)?;
        write_f64(&folder.path().join("q"), &flat)?;
        write_f64(&folder.path().join("limits"), &[VELOCITY, ACCELERATION].concat())?;
        let per_waypoint = |s: f64| s * 1e6 / q.len() as f64;
        let [peer_us, ratio, peer_worst, peer_s] =
            match ask(include_str!("timelaw.py"), folder.path()).as_deref() {
                Ok([answer]) if answer.len() == 4 => [
                    format!("{:.1}", per_waypoint(answer[0])),
                    format!("{:.0}", answer[0] / own_s),
                    format!("{:.3}, {:.3}", answer[2], answer[3]),
                    format!("{:.2}", answer[1]),
                ],
                Ok(_) => ["not measured", "-", "-", "-"].map(String::from),
                Err(why) => [why.as_str(), "-", "-", "-"].map(String::from),
            };
        table.push(vec![
            name.into(),
            peer_us,
            format!("{:.2}", per_waypoint(own_s)),
            ratio,
            peer_worst,
            format!("{:.3}, {:.3}, {:.3}", own.velocity, own.acceleration, own.jerk),
            format!("{peer_s} / {:.2}", law.duration_s()),
        ]);
    }
    Ok(table)
}
