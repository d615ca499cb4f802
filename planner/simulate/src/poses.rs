//! Converts a plan's joint trajectory to burr poses that are close enough for a simulation.

use bonemill_arm::{Arm, RobotError};
use bonemill_geometry::capsule::segment_distance_squared;
use bonemill_geometry::{Base, Point, Rigid, Tool, Work, cancel};
use bonemill_planfile::Trajectory;
use nalgebra::Vector3;
use rayon::prelude::*;

use super::{EngineError, Move, Pose};

/// Largest turn of the shaft between two poses, rad.
const TURN_RAD: f64 = 0.02;
/// Half the time over which a difference of poses gives the velocity, s.
const SHORT_S: f64 = 1e-4;
/// Less than this between two rows is rounding, mm; it has no direction.
const STILL_MM: f64 = 1e-5;
/// Largest distance of a row from the straight step that replaces it, mm. Where the burr comes again to a place, a skin of this
/// thickness may appear or vanish, and cutting a skin needs the full force.
const ASIDE_MM: f64 = 5e-4;
/// Largest distance of a row from where an even step would have the burr at that time, mm: speeds up to a stop stay those of the rows.
const UNEVEN_MM: f64 = 5e-3;
/// Largest turn of the path within a step, rad. Where the burr rounds a corner, its force rises and falls within a few hundredths of mm.
const BEND_RAD: f64 = 0.3;
/// Largest number of rows that one step replaces; it bounds the time for a burr that stands still.
const MOST_ROWS: usize = 1000;
/// Largest number of poses.
const MOST_POSES: f64 = 2e7;
/// Least rate of poses; with fewer, parts of a path would be left out.
const LEAST_RATE_HZ: f64 = 1.0;
const MOST_STEP_MM: f64 = 5.0;

/// How a trajectory is sampled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Sampling {
    /// The burr moves at most this far between two poses, mm; while it stands still there are none.
    Step {
        /// Longest step, mm.
        step_mm: f64,
    },
    /// A fixed number of poses per second.
    Rate {
        /// Hz.
        rate_hz: f64,
    },
}

impl Default for Sampling {
    /// Steps of 0.1 mm.
    fn default() -> Self {
        Self::Step { step_mm: 0.1 }
    }
}

/// A pose of the trajectory.
#[derive(Debug, Clone, PartialEq)]
pub struct TrajectorySample {
    /// Time in the plan, s.
    pub time_s: f64,
    /// Joint positions, mm or rad.
    pub q: Vec<f64>,
    /// The burr.
    pub pose: Pose,
    /// Velocity of its centre, mm/s.
    pub velocity_mm_s: Vector3<f64>,
}

/// How many poses are too many; nothing for a value that is no number above 0.
fn made(poses: f64) -> String {
    if poses.is_finite() && poses > 0.0 { format!(", not {poses:.3e}") } else { String::new() }
}

/// Why a trajectory cannot be converted to burr poses.
#[derive(Debug, thiserror::Error)]
pub enum PoseError {
    /// The step is too long, or the rate too low.
    #[error("{name} = {value}: too coarse; expected {expected}")]
    Coarse {
        /// Name of the parameter.
        name: &'static str,
        /// What was given.
        value: f64,
        /// What is accepted.
        expected: &'static str,
    },
    /// The step or rate is not a number above 0, or makes too many poses.
    #[error(
        "{name} = {value}: expected a number above 0 that makes at most {most:.0e} poses{}",
        made(*poses)
    )]
    Sampling {
        /// Name of the parameter.
        name: &'static str,
        /// What was given.
        value: f64,
        /// Number of poses that it would make; infinite if the value is invalid.
        poses: f64,
        /// Largest allowed number.
        most: f64,
    },
    /// The trajectory has no rows.
    #[error("the trajectory has no row")]
    Empty,
    /// A row is not a joint vector of the arm.
    #[error("at {time_s:.3} s of the trajectory")]
    Arm {
        /// When.
        time_s: f64,
        /// Why not.
        source: RobotError,
    },
    /// The burr's pose is invalid.
    #[error("at {time_s:.3} s of the trajectory")]
    Pose {
        /// When.
        time_s: f64,
        /// Why.
        source: EngineError,
    },
}

/// The burr's poses along a trajectory. The first and the last row are always included.
///
/// Between rows, joints follow the cubic with the rows' positions and velocities.
///
/// # Errors
/// [`PoseError`].
pub fn sample(
    trajectory: &Trajectory,
    arm: &Arm,
    work_from_base: &Rigid<Work, Base>,
    sampling: Sampling,
) -> Result<Vec<TrajectorySample>, PoseError> {
    let duration_s = trajectory.time_s.last().copied().unwrap_or(0.0);
    let pose = |time_s: f64, q: &[f64]| -> Result<Pose, PoseError> {
        let burr = arm.burr(q).map_err(|source| PoseError::Arm { time_s, source })?;
        let burr: Rigid<Work, Tool> = *work_from_base * burr;
        let center = Point::from_coords(burr.translation_mm);
        let pose = Pose::new(center, burr.rotation.matrix().column(2).into_owned());
        pose.map_err(|source| PoseError::Pose { time_s, source })
    };
    let at = |time_s: f64| -> Result<TrajectorySample, PoseError> {
        let (q, qd) = joints(trajectory, time_s);
        let shifted = |seconds: f64| -> Result<Pose, PoseError> {
            pose(time_s, &q.iter().zip(&qd).map(|(q, qd)| q + qd * seconds).collect::<Vec<f64>>())
        };
        let velocity_mm_s = (shifted(SHORT_S)?.center - shifted(-SHORT_S)?.center) / (2.0 * SHORT_S);
        let pose = pose(time_s, &q)?;
        Ok(TrajectorySample { time_s, q, pose, velocity_mm_s })
    };
    match sampling {
        Sampling::Rate { rate_hz } => {
            let count = check("simulation rate, Hz", rate_hz, duration_s * rate_hz)?;
            fine_enough("simulation rate, Hz", rate_hz, rate_hz >= LEAST_RATE_HZ, "at least 1 Hz")?;
            let times = (0..=count as usize).map(|n| n as f64 / rate_hz).chain([duration_s]);
            let mut times: Vec<f64> = times.filter(|t| *t <= duration_s).collect();
            times.dedup_by(|b, a| *b - *a <= 1e-9);
            times.into_par_iter().map(at).collect()
        }
        Sampling::Step { step_mm } => {
            let rows: Vec<Pose> = (0..trajectory.len())
                .into_par_iter()
                .map(|row| {
                    cancel::poll();
                    pose(trajectory.time_s[row], trajectory.q_at(row))
                })
                .collect::<Result<_, _>>()?;
            let way_mm: f64 = rows.windows(2).map(|r| r[0].center.distance_mm(&r[1].center)).sum();
            check("simulation step, mm", step_mm, way_mm / step_mm)?;
            fine_enough("simulation step, mm", step_mm, step_mm <= MOST_STEP_MM, "at most 5 mm")?;
            thin_out(trajectory, &rows, step_mm, at)
        }
    }
}

fn fine_enough(
    name: &'static str,
    value: f64,
    is_fine: bool,
    expected: &'static str,
) -> Result<(), PoseError> {
    if is_fine { Ok(()) } else { Err(PoseError::Coarse { name, value, expected }) }
}

fn check(name: &'static str, value: f64, poses: f64) -> Result<f64, PoseError> {
    let fine = value > 0.0 && value.is_finite() && poses <= MOST_POSES;
    let poses = if poses.is_finite() { poses } else { f64::INFINITY };
    if fine { Ok(poses) } else { Err(PoseError::Sampling { name, value, poses, most: MOST_POSES }) }
}

/// Leaves out rows, such that the straight steps between the others sweep what the rows sweep. Inserts poses between rows that are
/// farther apart than a step.
fn thin_out(
    trajectory: &Trajectory,
    rows: &[Pose],
    step_mm: f64,
    at: impl Fn(f64) -> Result<TrajectorySample, PoseError>,
) -> Result<Vec<TrajectorySample>, PoseError> {
    let mut kept = Vec::new();
    let mut last = 0;
    for n in kept_rows(&trajectory.time_s, rows, step_mm) {
        let between = (rows[n].center.distance_mm(&rows[last].center) / step_mm * (1.0 - 1e-9)).floor();
        let [from_s, to_s] = [last, n].map(|n| trajectory.time_s[n]);
        for part in 1..=between as usize {
            kept.push(at(from_s + (to_s - from_s) * part as f64 / (between + 1.0))?);
        }
        kept.push(at(to_s)?);
        last = n;
    }
    Ok(kept)
}

/// The rows that are kept: the first, the last, and each after which the step could not go on.
fn kept_rows(time_s: &[f64], rows: &[Pose], step_mm: f64) -> Vec<usize> {
    let mut kept = vec![0];
    let mut last = 0;
    for n in 1..rows.len() {
        let goes_on = n + 1 < rows.len()
            && n + 1 - last <= MOST_ROWS
            && is_one_step(&time_s[last..=n + 1], &rows[last..=n + 1], step_mm);
        if !goes_on {
            kept.push(n);
            last = n;
        }
    }
    kept
}

/// Whether one straight, even step may replace these rows: it is short enough, the shaft and the path turn little, and the burr's centre
/// is within the tolerances of it in every row.
fn is_one_step(time_s: &[f64], rows: &[Pose], step_mm: f64) -> bool {
    let ([from, second, ..], [.., before, to]) = (rows, rows) else { return true };
    let ([from_s, ..], [.., to_s]) = (time_s, time_s) else { return true };
    let (start, way) = (from.center.coords, to.center - from.center);
    let (first, latest) = (second.center - from.center, to.center - before.center);
    let moves = first.norm() > STILL_MM && latest.norm() > STILL_MM;
    let is_short = way.norm() <= step_mm && from.axis.angle(&to.axis) <= TURN_RAD;
    let is_near = |(pose, row_s): (&Pose, &f64)| {
        let p = pose.center.coords;
        let even = start + way * ((row_s - from_s) / (to_s - from_s));
        segment_distance_squared(&p, &start, &to.center.coords) <= ASIDE_MM.powi(2)
            && (p - even).norm_squared() <= UNEVEN_MM.powi(2)
    };
    is_short && !(moves && first.angle(&latest) > BEND_RAD) && rows.iter().zip(time_s).all(is_near)
}

/// Joint positions and velocities at a time, by the cubic with the positions and velocities of the rows around it.
fn joints(trajectory: &Trajectory, time_s: f64) -> (Vec<f64>, Vec<f64>) {
    let last = trajectory.len() - 1;
    let next = trajectory.time_s.partition_point(|t| *t <= time_s).clamp(1, last.max(1)).min(last);
    let before = next.saturating_sub(1);
    let span = trajectory.time_s[next] - trajectory.time_s[before];
    if span <= 0.0 {
        return (trajectory.q_at(next).to_vec(), trajectory.qd_at(next).to_vec());
    }
    let u = ((time_s - trajectory.time_s[before]) / span).clamp(0.0, 1.0);
    let (h01, h10, h11) = (u * u * (3.0 - 2.0 * u), u * (1.0 - u).powi(2) * span, u * u * (u - 1.0) * span);
    let (d01, d10, d11) = (6.0 * u * (1.0 - u) / span, (1.0 - u) * (1.0 - 3.0 * u), u * (3.0 * u - 2.0));
    (0..trajectory.dof)
        .map(|j| {
            let (a, b) = (trajectory.q_at(before)[j], trajectory.q_at(next)[j]);
            let (va, vb) = (trajectory.qd_at(before)[j], trajectory.qd_at(next)[j]);
            (a + (b - a) * h01 + va * h10 + vb * h11, (b - a) * d01 + va * d10 + vb * d11)
        })
        .unzip()
}

/// The steps between samples.
pub fn moves(samples: &[TrajectorySample]) -> Vec<Move> {
    samples
        .windows(2)
        .map(|pair| Move {
            to: pair[1].pose,
            seconds: pair[1].time_s - pair[0].time_s,
            end_velocity_mm_s: Some(pair[1].velocity_mm_s),
        })
        .collect()
}

#[cfg(test)]
mod tests;
