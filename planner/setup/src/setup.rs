//! A case with everything that is built from its files before a path is planned: scene, arm and registration.
//!
//! Every pipeline begins with [`Setup::read`] and records what it planned on by [`Setup::frames`] and [`Setup::recorded_inputs`].

use std::path::{Path, PathBuf};

use bonemill_arm::Arm;
use bonemill_case::{Case, Registration};
use bonemill_geometry::{Base, Ct, Grid, Rigid, Work};
use bonemill_imaging::Placement;
use bonemill_planfile::{Input, PlanFrames, PlanningGrid};
use bonemill_robot::room::Room;
use bonemill_toolpath::scene::Scene;

use super::reach::{self, StandingArm};
use super::registration::{Registered, fiducials_in_scan, registration};
use super::{PlanError, Stopwatch, inputs, room, tools};

/// A case with its scene, arm and registration.
#[derive(Debug)]
pub struct Setup {
    /// The case, resolved.
    pub case: Case,
    /// Every input as named in the case, with its file and digest; the case file first.
    pub inputs: Vec<(Input, PathBuf)>,
    /// What places the voxels of the CT and of the labels.
    pub placements: [Placement; 2],
    /// Voxels of the CT and of the labels.
    pub grids: [Grid<Ct>; 2],
    /// Images as planned on.
    pub scene: Scene,
    /// The arm, with its tool and limits.
    pub arm: Arm,
    /// Where the patient is.
    pub registered: Registered,
    /// What the arm's links must keep clear of; `None` where that is not asked for or their shapes are not known.
    pub room: Option<Room>,
    /// What the user should know of all that.
    pub warnings: Vec<String>,
}

impl Setup {
    /// Reads what `case` names, relative to the folder of `case_path`. The images are dropped as soon as the scene is made.
    ///
    /// # Errors
    /// [`PlanError`] for images that cannot be read or trusted, an arm that cannot be used, a registration that does not fit.
    pub fn read(case: &Case, case_path: &Path, watch: &mut Stopwatch) -> Result<Self, PlanError> {
        let arm = tools::arm(case, case_path.parent().unwrap_or(Path::new("")))?;
        let (images, files) = watch.run("read images", || inputs::read_inputs(case, case_path))?;
        fiducials_in_scan(&case.robot, images.ct.volume.grid())?;
        let standing = StandingArm::of(case, &arm)?;
        let scene = watch.run("scene", || inputs::make_scene(case, &images, standing.as_ref()))?;
        watch.tell_memory_mb(inputs::memory_mb(&scene, &images));
        let registered = registration(&case.robot, &scene)?;
        reach::judge(&arm, &registered, &scene, case.burr.radius_mm)
            .and_then(|()| reach::judge_poses(case, &arm, &registered, &scene))
            .map_err(|error| registered.blame(case, error))?;
        let room = room::room(case, &arm, (&images.ct.volume, &scene.approach), &registered.base_from_ct)?;
        let mut warnings = images.warnings;
        warnings.extend(scene.warnings.iter().cloned());
        warnings.extend(tools::warnings(case, &arm));
        warnings.extend(registered.warnings(case));
        warnings.extend(room::warning(case, room.as_ref()));
        let placements = [images.ct.provenance.placement, images.labels.provenance.placement];
        let grids = [images.ct.volume.grid().clone(), images.labels.volume.grid().clone()];
        let case = case.clone();
        Ok(Self { case, inputs: files, placements, grids, scene, arm, registered, room, warnings })
    }

    /// Where the planning grid is, seen from the arm.
    pub fn base_from_work(&self) -> Rigid<Base, Work> {
        self.registered.base_from_ct * self.scene.ct_from_work
    }

    /// The inputs as `plan.toml` records them.
    pub fn recorded_inputs(&self) -> Vec<Input> {
        self.inputs.iter().map(|(input, _)| input.clone()).collect()
    }

    /// The frames as `plan.toml` records them.
    pub fn frames(&self) -> PlanFrames {
        let (scene, robot) = (&self.scene, &self.case.robot);
        PlanFrames {
            approach_direction: scene.approach,
            ct_from_approach: scene.ct_from_approach(),
            grid: PlanningGrid { dims: scene.class.grid().dims(), turn_rad: scene.turn_rad },
            base_from_ct: self.registered.base_from_ct,
            registration_assumed: robot.base_from_ct == Registration::Assumed,
            // the case's own angles: those of the arm's rotation lose digits at gimbal lock
            flange_from_burr: robot.flange_from_burr.unwrap_or_default(),
        }
    }
}
