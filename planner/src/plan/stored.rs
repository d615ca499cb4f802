//! A plan read back from its directory, for everyone who works on a finished plan: simulation, verification, view,
//! export, streaming.

use std::path::{Path, PathBuf};

use bonemill_geometry::Rigid;
use bonemill_robot::{Arm, ToolMount, read_urdf};
use nalgebra::{Rotation3, Vector3};

use super::record::input_path;
use super::{
    FORCES, ForceToward, PlanFileError, PlanRecord, Trajectory, Waypoint, read_forces, read_waypoints,
};

/// A plan's directory in memory. Every file of it was read and checked, and every input is what it was.
#[derive(Debug, Clone)]
pub struct StoredPlan {
    /// Where it was read from.
    pub dir: PathBuf,
    /// `plan.toml`.
    pub record: PlanRecord,
    /// `waypoints.csv`.
    pub waypoints: Vec<Waypoint>,
    /// `forces.csv`.
    pub forces: Vec<ForceToward>,
    /// `trajectory.csv`.
    pub trajectory: Trajectory,
    /// `robot.urdf` with the tool on its flange and the case's limits.
    pub arm: Arm,
}

impl StoredPlan {
    /// Reads the plan in `dir`.
    ///
    /// # Errors
    /// [`PlanFileError`]: a file is missing or not what the planner writes (with line and column), an input has changed
    /// since the plan was made, the arm's URDF describes no arm.
    pub fn load(dir: &Path) -> Result<Self, PlanFileError> {
        let record = PlanRecord::read(dir)?;
        let waypoints = read_waypoints(&dir.join("waypoints.csv"), &record.case.structures)?;
        let forces = read_forces(&dir.join(FORCES), waypoints.len(), &record.case.structures)?;
        let arm = arm(&dir.join("robot.urdf"), &record)?;
        let trajectory = Trajectory::read(&dir.join("trajectory.csv"), arm.dof())?;
        Ok(Self { dir: dir.into(), record, waypoints, forces, trajectory, arm })
    }

    /// The CT's file.
    pub fn ct_path(&self) -> PathBuf {
        input_path(&self.dir, &self.record.case_file, &self.record.case.images.ct)
    }

    /// The label map's file.
    pub fn labels_path(&self) -> PathBuf {
        input_path(&self.dir, &self.record.case_file, &self.record.case.images.labels)
    }

    /// The case's file, to which its paths are relative.
    pub fn case_path(&self) -> PathBuf {
        self.dir.join(&self.record.case_file)
    }
}

fn arm(urdf: &Path, record: &PlanRecord) -> Result<Arm, PlanFileError> {
    let refused = |source| PlanFileError::Arm { path: urdf.into(), source: Box::new(source) };
    let (translation_mm, [roll, pitch, yaw]) = record.flange_from_burr;
    let rotation = Rotation3::from_euler_angles(roll, pitch, yaw);
    let flange_from_burr = Rigid::new(rotation, Vector3::from(translation_mm));
    let robot = &record.case.robot;
    let arm = read_urdf(urdf).map_err(refused)?.with_mount(ToolMount { flange_from_burr });
    let arm = arm.of_model(&robot.model).map_err(refused)?;
    let arm = arm
        .with_limits(robot.velocity_limits.as_deref(), robot.acceleration_limits.as_deref())
        .map_err(refused)?;
    match &robot.jerk_limits {
        Some(jerk) => arm.with_jerk_limits(jerk).map_err(refused),
        None => Ok(arm),
    }
}
