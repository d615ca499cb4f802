//! The limits of a plan's time law, and the law as `trajectory.csv`.

use std::io::{self, Write};

use crate::PlanError;
use bonemill_arm::{Arm, JointKind};
use bonemill_robot::export::write_trajectory_csv;
use bonemill_robot::timelaw::{CornerTolerance, PathLimits, TRAJECTORY_TOLERANCE_MM, TimeLaw};

/// The limits of an arm's time law: the corner tolerance leaves room for the arm's bow between waypoints.
///
/// # Errors
/// As [`PathLimits::of_arm`].
pub fn path_limits(arm: &Arm) -> Result<PathLimits, PlanError> {
    let corner = CornerTolerance { burr_mm: 0.8 * TRAJECTORY_TOLERANCE_MM, ..CornerTolerance::default() };
    Ok(PathLimits::of_arm(arm, corner)?)
}

/// Writes the law sampled at `rate_hz` as `trajectory.csv`; `out` need not be buffered.
///
/// # Errors
/// When the rate is not usable, or the writer fails.
pub fn write_trajectory(
    law: &TimeLaw,
    arm: &Arm,
    rate_hz: f64,
    out: &mut (impl Write + Send),
) -> io::Result<()> {
    let kinds: Vec<JointKind> = arm.joints().iter().map(|joint| joint.kind).collect();
    let rows = law.rows(rate_hz).map_err(io::Error::other)?;
    write_trajectory_csv(out, &rows, &kinds).map(drop).map_err(io::Error::other)
}
