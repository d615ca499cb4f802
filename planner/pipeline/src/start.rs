//! What planning starts from: a case with its scene, its arm where it stands, and the space that is free.

use bonemill_arm::Arm;
use bonemill_case::Case;
use bonemill_geometry::{Base, Rigid, Work};
use bonemill_robot::resolve::Posture;
use bonemill_robot::room::Room;
use bonemill_setup::Setup;
use bonemill_setup::armpath::Placed;
use bonemill_toolpath::access::ShankObstacles;
use bonemill_toolpath::scene::Scene;
use bonemill_toolpath::space::BurrSpace;

/// What every attempt at a case starts from.
#[derive(Debug, Clone, Copy)]
pub(super) struct Start<'a> {
    pub case: &'a Case,
    pub arm: &'a Arm,
    pub scene: &'a Scene,
    pub space: &'a BurrSpace<'a>,
    pub solid: &'a ShankObstacles,
    pub base_from_work: Rigid<Base, Work>,
    pub room: Option<&'a Room>,
}

impl<'a> Start<'a> {
    /// A setup, with its free space and what its shank may not touch.
    pub fn new(setup: &'a Setup, space: &'a BurrSpace<'a>, solid: &'a ShankObstacles) -> Self {
        let Setup { case, arm, scene, .. } = setup;
        Self {
            case,
            arm,
            scene,
            space,
            solid,
            base_from_work: setup.base_from_work(),
            room: setup.room.as_ref(),
        }
    }

    /// The arm where it stands, in a posture that the case allows.
    pub fn placed(&self) -> Placed<'_> {
        let posture = self.case.robot.branch.map_or(Posture::Any, Posture::Of);
        Placed { arm: self.arm, base_from_work: &self.base_from_work, posture, room: self.room }
    }
}
