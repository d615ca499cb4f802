//! What a pipeline hands over to be written: the files of a plan but for its report.
//!
//! No stage that makes plans is known here, so that every pipeline writes the same files. The trajectory is written by the
//! pipeline's own function, since it is sampled from the motion row by row and would not fit in memory twice.

use std::fs::File;
use std::path::Path;

use bonemill_arm::Arm;

use super::{
    CASE_COPY, FILES, ForceToward, PlanFileError, PlanRecord, StagedDirectory, Waypoint, copy_input,
    write_forces, write_waypoints,
};

/// The contents of a plan's files.
#[derive(Debug, Clone, Copy)]
pub struct PlanContents<'a> {
    /// `plan.toml`.
    pub record: &'a PlanRecord,
    /// `waypoints.csv`.
    pub waypoints: &'a [Waypoint],
    /// `forces.csv`: by waypoint, then in the case's order of structures.
    pub forces: &'a [ForceToward],
    /// `robot.urdf`.
    pub arm: &'a Arm,
    /// Files for a reader alone: name, one of [`super::NOTES`], and text.
    pub notes: &'a [(&'static str, String)],
}

impl PlanContents<'_> {
    /// Writes the files into the staged directory, with a copy of the case that was read from `case_path`; `trajectory` writes
    /// `trajectory.csv`, unbuffered.
    ///
    /// # Errors
    /// [`PlanFileError`] when a file cannot be written or a figure is not finite; the caller drops the staged directory.
    pub fn write(
        &self,
        case_path: &Path,
        staged: &StagedDirectory,
        trajectory: impl FnOnce(&mut File) -> std::io::Result<()> + Send,
    ) -> Result<(), PlanFileError> {
        let [_, _, trajectory_name, ..] = FILES;
        let path = staged.path().join(trajectory_name);
        let (motion, rest) = rayon::join(
            || File::create(&path).and_then(|mut file| trajectory(&mut file)),
            || self.write_rest(case_path, staged),
        );
        motion.map_err(PlanFileError::io("write", &path))?;
        rest?;
        self.record.write(staged.path())
    }

    fn write_rest(&self, case_path: &Path, staged: &StagedDirectory) -> Result<(), PlanFileError> {
        let dir = staged.path();
        let [waypoints, forces, _, urdf, _] = FILES;
        let structures = &self.record.case.structures;
        let is_case = |path: &Path| self.record.case_input() == Some(path);
        if let Some(case) = self.record.inputs.iter().find(|input| is_case(&input.path)) {
            copy_input(case_path, &dir.join(CASE_COPY), case)?;
        }
        write_waypoints(&dir.join(waypoints), self.waypoints, structures)?;
        write_forces(&dir.join(forces), self.forces, structures)?;
        staged.write(urdf, self.arm.urdf_text())?;
        self.notes.iter().try_for_each(|(name, text)| staged.write(name, text))
    }
}
