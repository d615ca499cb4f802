//! A plan read back from its directory, for simulation, verification, viewing, export and streaming.

use std::path::{Path, PathBuf};

use bonemill_arm::{Arm, ToolMount, read_urdf};
use bonemill_geometry::Rigid;
use bonemill_imaging::label_names_path;
use nalgebra::{Rotation3, Vector3};

use super::inputs::recorded_path;
use super::{
    FORCES, ForceToward, FoundInputs, Input, Need, PlanFileError, PlanRecord, Trajectory, Waypoint,
    read_forces, read_waypoints,
};

/// A plan's directory in memory. Every file of it was read and checked.
#[derive(Debug, Clone)]
pub struct StoredPlan {
    /// The directory from which it was read.
    pub dir: PathBuf,
    /// `plan.toml`.
    pub record: PlanRecord,
    /// Where its inputs were found.
    pub inputs: FoundInputs,
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
    /// Reads the plan in `dir` and checks that every input is there and unchanged.
    ///
    /// # Errors
    /// As [`StoredPlan::load_with`].
    pub fn load(dir: &Path) -> Result<Self, PlanFileError> {
        Self::load_with(dir, None, Need::All)
    }

    /// Reads the plan in `dir`; the inputs that are needed are also searched in `inputs_folder`.
    ///
    /// # Errors
    /// [`PlanFileError`]: a file is missing or not in the planner's format (with line and column), an input has changed since
    /// the plan was made or is missing where it is needed, the URDF does not describe an arm.
    pub fn load_with(dir: &Path, inputs_folder: Option<&Path>, need: Need) -> Result<Self, PlanFileError> {
        let record = PlanRecord::read(dir)?;
        let inputs = FoundInputs::search(dir, &record, inputs_folder, need)?;
        let waypoints = read_waypoints(&dir.join("waypoints.csv"), &record.case.structures)?;
        let forces = read_forces(&dir.join(FORCES), waypoints.len(), &record.case.structures)?;
        let arm = arm(&dir.join("robot.urdf"), &record)?;
        let trajectory = Trajectory::read(&dir.join("trajectory.csv"), arm.dof())?;
        Ok(Self { dir: dir.into(), record, inputs, waypoints, forces, trajectory, arm })
    }

    /// The path of the input that the case names `path`: where it was found, else its path when the plan was made.
    pub fn input_path(&self, path: &Path) -> PathBuf {
        let recorded = || recorded_path(&self.dir, &self.record.case_file, path);
        self.inputs.path(path).or_else(|| self.inputs.folder(path)).map_or_else(recorded, Path::to_owned)
    }

    /// Every input, and its path.
    ///
    /// # Errors
    /// [`PlanFileError::InputsMissing`] unless every input was found.
    pub fn all_inputs(&self) -> Result<Vec<(Input, PathBuf)>, PlanFileError> {
        self.inputs.require()?;
        Ok(self.record.inputs.iter().map(|input| (input.clone(), self.input_path(&input.path))).collect())
    }

    /// Whether the CT and all files of labels were found, and also the labels' names if the plan was made with them.
    pub fn images_found(&self) -> bool {
        let images = &self.record.case.images;
        let names = label_names_path(&images.labels);
        let has_names = self.record.inputs.iter().any(|input| input.path == names);
        let needed = [&images.ct, &images.labels].into_iter().chain(has_names.then_some(&names));
        let labels = self.record.case.labels();
        let files = labels.iter().filter_map(|(_, label)| label.file());
        needed
            .map(PathBuf::as_path)
            .chain(files)
            .all(|path| self.inputs.path(path).or_else(|| self.inputs.folder(path)).is_some())
    }

    /// The case's file.
    pub fn case_path(&self) -> PathBuf {
        self.input_path(self.record.case_input().unwrap_or(Path::new("")))
    }
}

fn arm(urdf: &Path, record: &PlanRecord) -> Result<Arm, PlanFileError> {
    let refused = |source| PlanFileError::Arm { path: urdf.into(), source: Box::new(source) };
    let (translation_mm, [roll, pitch, yaw]) = record.frames.flange_from_burr;
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
