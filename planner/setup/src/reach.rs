//! Whether the arm can get to the target at all: asked before a path is laid, since laying one takes far longer.
//!
//! It is a bound, not the inverse kinematics: what it refuses is surely out of reach; what it passes may still be.

use bonemill_arm::{Arm, ArmKind};
use bonemill_geometry::{Point, Work};
use bonemill_toolpath::scene::{Class, Scene};

use super::PlanError;
use super::registration::Registered;

/// Half the width of the smallest UR's base, mm: the UR3e's is 128 mm wide (Universal Robots, user manual).
const BASE_MM: f64 = 64.0;

/// Refuses a target in a UR's base, or farther from an arm's base than links and tool are long together.
///
/// # Errors
/// [`PlanError::TooNear`], [`PlanError::TooFar`].
pub fn judge(
    arm: &Arm,
    registered: &Registered,
    scene: &Scene,
    tool_radius_mm: f64,
) -> Result<(), PlanError> {
    let Some(reach_mm) = arm.farthest_mm() else { return Ok(()) };
    let base_from_work = registered.base_from_ct * scene.ct_from_work;
    // what the tool removes lies within its radius of its centre
    let away_mm = |place: Point<Work>| (base_from_work * place).coords.norm() - tool_radius_mm;
    let middle_mm = (base_from_work * scene.target_center).coords.norm();
    if arm.kind() == ArmKind::Ur && middle_mm < BASE_MM {
        return Err(PlanError::TooNear { away_mm: middle_mm, base_mm: BASE_MM });
    }
    if away_mm(scene.target_center) <= reach_mm {
        return Ok(());
    }
    let grid = scene.class.grid();
    let voxels = scene.class.data().iter().enumerate().filter(|(_, class)| class.is(Class::TARGET));
    let nearest_mm = voxels.map(|(n, _)| away_mm(grid.center(grid.voxel(n)))).fold(f64::INFINITY, f64::min);
    if nearest_mm > reach_mm { Err(PlanError::TooFar { nearest_mm, reach_mm }) } else { Ok(()) }
}
