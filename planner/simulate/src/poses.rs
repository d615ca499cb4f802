//! Converts a plan's joint trajectory to burr poses that are close enough for a simulation.

use bonemill_arm::{Arm, RobotError};
use bonemill_geometry::{Base, Point, Rigid, Tool, Work, cancel};
use bonemill_planfile::Trajectory;
use nalgebra::Vector3;
use rayon::prelude::*;

use super::{EngineError, Move, Pose};

/// Largest turn of the shaft between two poses, rad.
const TURN_RAD: f64 = 0.02;
/// Less than this between two rows is rounding, mm.
const STILL_MM: f64 = 1e-6;
/// A turn back this near to the last pose needs none of its own, mm.
const LEAST_TURN_MM: f64 = 1e-3;
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
        "{name} = {value}: expected a number above 0 that makes at most {most:.0e} poses, not {poses:.3e}"
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
        let q = joints(trajectory, time_s);
        let pose = pose(time_s, &q)?;
        Ok(TrajectorySample { time_s, q, pose })
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

/// Leaves out rows while the tool stays within a step, but for those where it turns back: a drill is deepest there. Inserts poses between
/// rows that are farther apart.
fn thin_out(
    trajectory: &Trajectory,
    rows: &[Pose],
    step_mm: f64,
    at: impl Fn(f64) -> Result<TrajectorySample, PoseError>,
) -> Result<Vec<TrajectorySample>, PoseError> {
    let row = |n: usize| TrajectorySample {
        time_s: trajectory.time_s[n],
        q: trajectory.q_at(n).to_vec(),
        pose: rows[n],
    };
    let mut kept = Vec::new();
    let mut last = 0;
    let mut heading = Vector3::zeros();
    for n in 0..rows.len() {
        let way = rows.get(n + 1).map_or_else(Vector3::zeros, |next| next.center - rows[n].center);
        let turns_back = way.norm() > STILL_MM && way.dot(&heading) < 0.0;
        if way.norm() > STILL_MM {
            heading = way;
        }
        let has_moved = rows[n].center.distance_mm(&rows[last].center) > LEAST_TURN_MM;
        let is_end = n == 0 || n + 1 == rows.len();
        let leaves = |next: &Pose| {
            next.center.distance_mm(&rows[last].center) > step_mm
                || next.axis.angle(&rows[last].axis) > TURN_RAD
        };
        // a row that is far from both neighbours may be the tip of a sharp turn
        let is_kept = is_end || leaves(&rows[n]) || leaves(&rows[n + 1]) || turns_back && has_moved;
        if !is_kept {
            continue;
        }
        let between = (rows[n].center.distance_mm(&rows[last].center) / step_mm * (1.0 - 1e-9)).floor();
        let [from_s, to_s] = [last, n].map(|n| trajectory.time_s[n]);
        for part in 1..=between as usize {
            kept.push(at(from_s + (to_s - from_s) * part as f64 / (between + 1.0))?);
        }
        kept.push(row(n));
        last = n;
    }
    Ok(kept)
}

/// Joint positions at a time, by the cubic with the positions and velocities of the rows around it.
fn joints(trajectory: &Trajectory, time_s: f64) -> Vec<f64> {
    let last = trajectory.len() - 1;
    let next = trajectory.time_s.partition_point(|t| *t <= time_s).clamp(1, last.max(1)).min(last);
    let before = next.saturating_sub(1);
    let span = trajectory.time_s[next] - trajectory.time_s[before];
    if span <= 0.0 {
        return trajectory.q_at(next).to_vec();
    }
    let u = ((time_s - trajectory.time_s[before]) / span).clamp(0.0, 1.0);
    let (h01, h10, h11) = (u * u * (3.0 - 2.0 * u), u * (1.0 - u).powi(2) * span, u * u * (u - 1.0) * span);
    (0..trajectory.dof)
        .map(|j| {
            let (a, b) = (trajectory.q_at(before)[j], trajectory.q_at(next)[j]);
            let (va, vb) = (trajectory.qd_at(before)[j], trajectory.qd_at(next)[j]);
            a + (b - a) * h01 + va * h10 + vb * h11
        })
        .collect()
}

/// The steps between samples.
pub fn moves(samples: &[TrajectorySample]) -> Vec<Move> {
    samples
        .windows(2)
        .map(|pair| Move { to: pair[1].pose, seconds: pair[1].time_s - pair[0].time_s })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A circle of 10 mm radius at constant speed, 100 rows.
    fn circle() -> Trajectory {
        let (mut q, mut qd, mut time_s) = (vec![], vec![], vec![]);
        for n in 0..100 {
            let t = n as f64 * 0.02;
            time_s.push(t);
            q.extend([10.0 * t.cos(), 10.0 * t.sin(), 0.0, 0.1 * t]);
            qd.extend([-10.0 * t.sin(), 10.0 * t.cos(), 0.0, 0.1]);
        }
        Trajectory { dof: 4, time_s, q, qd }
    }

    #[test]
    fn steps_are_no_longer_than_asked_and_the_ends_are_kept() {
        let arm = Arm::bone_attached().unwrap();
        let frame = Rigid::<Work, Base>::identity();
        for step_mm in [0.05, 0.15, 0.5, 3.0] {
            let samples = sample(&circle(), &arm, &frame, Sampling::Step { step_mm }).unwrap();
            for pair in samples.windows(2) {
                assert!(pair[0].pose.center.distance_mm(&pair[1].pose.center) <= step_mm * 1.000_001);
                assert!(pair[1].time_s > pair[0].time_s);
            }
            assert_eq!((samples[0].time_s, samples[samples.len() - 1].time_s), (0.0, 99.0 * 0.02));
        }
    }

    #[test]
    fn between_rows_joints_follow_the_cubic() {
        let arm = Arm::bone_attached().unwrap();
        let rate = Sampling::Rate { rate_hz: 777.0 };
        let samples = sample(&circle(), &arm, &Rigid::identity(), rate).unwrap();
        assert!(samples.len() > 1500);
        for s in &samples {
            let radius = s.q[0].hypot(s.q[1]);
            assert!((radius - 10.0).abs() < 1e-6, "{radius}");
        }
    }

    /// One row is far away between two that are near each other.
    #[test]
    fn the_tip_of_a_sharp_turn_is_kept() {
        let arm = Arm::bone_attached().unwrap();
        let mut path = circle();
        path.q[4 * 50] += 40.0;
        let samples = sample(&path, &arm, &Rigid::identity(), Sampling::Step { step_mm: 0.3 }).unwrap();
        let is_tip = |s: &TrajectorySample| s.q[0] == path.q[4 * 50];
        assert!(samples.iter().any(is_tip));
    }

    #[test]
    fn what_cannot_be_sampled_is_refused() {
        let arm = Arm::bone_attached().unwrap();
        for sampling in [
            Sampling::Step { step_mm: 0.0 },
            Sampling::Step { step_mm: f64::NAN },
            Sampling::Step { step_mm: 1e-9 },
            Sampling::Rate { rate_hz: -1.0 },
            Sampling::Rate { rate_hz: 1e12 },
            Sampling::Rate { rate_hz: 1e-300 },
            Sampling::Rate { rate_hz: 0.5 },
            Sampling::Step { step_mm: 1000.0 },
        ] {
            assert!(sample(&circle(), &arm, &Rigid::identity(), sampling).is_err(), "{sampling:?}");
        }
    }
}
