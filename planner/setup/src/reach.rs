//! Whether the arm can get to the target at all: asked before a path is laid, since laying one takes far longer.
//!
//! [`judge`] is a bound, not the inverse kinematics: what it refuses is surely out of reach; what it passes may still be. [`judge_poses`]
//! then tries the inverse kinematics at places all over the target.

use bonemill_arm::arm::{AxisPose, InverseKind};
use bonemill_arm::{Arm, ArmKind};
use bonemill_case::Case;
use bonemill_geometry::{Base, Ct, Point, Rigid, Work};
use bonemill_robot::resolve::postures::reached;
use bonemill_robot::resolve::{Posture, RollFrame};
use bonemill_toolpath::orientation::Directions;
use bonemill_toolpath::scene::{Class, Scene, Tilts};
use nalgebra::{Unit, Vector3};

use super::PlanError;
use super::registration::{self, Registered};

/// Half the width of the smallest UR's base, mm: the UR3e's is 128 mm wide (Universal Robots, user manual).
const BASE_MM: f64 = 64.0;
/// Places of the target at which an arm is tried, about, and the steps of the shaft's directions from the approach to the tilt limit.
const PLACES: usize = 100;
const TILT_STEPS: f64 = 3.0;
/// How exactly it is told how much nearer the target would have to be, mm.
const NEARER_MM: f64 = 10.0;

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

/// Refuses a target of which a UR reaches no place, in any posture and along any direction of the shaft within the tilt limit. It is asked at
/// places all over the target; the bone-attached arm, whose shaft has a plane of its own, is judged by [`judge`] alone.
///
/// # Errors
/// [`PlanError::NoneReached`].
pub fn judge_poses(case: &Case, arm: &Arm, registered: &Registered, scene: &Scene) -> Result<(), PlanError> {
    if !matches!(arm.inverse_kind(), InverseKind::Ur { .. }) {
        return Ok(());
    }
    let base_from_work = registered.base_from_ct * scene.ct_from_work;
    let (grid, limit_rad) = (scene.class.grid(), case.orientation.tilt_limit_rad);
    let voxels = scene.class.data().iter().enumerate().filter(|(_, class)| class.is(Class::TARGET));
    let voxels: Vec<_> = voxels.map(|(n, _)| base_from_work * grid.center(grid.voxel(n))).collect();
    let nearest = voxels.iter().min_by(|a, b| a.coords.norm().total_cmp(&b.coords.norm()));
    let spread = (0..PLACES.min(voxels.len())).map(|n| &voxels[n * voxels.len() / PLACES.min(voxels.len())]);
    let places: Vec<&Point<Base>> = spread.chain(nearest).collect();
    let axes = Directions::cap(limit_rad / TILT_STEPS, limit_rad);
    let axes: Vec<_> = axes.axes().iter().map(|axis| base_from_work.rotation * *axis).collect();
    let frame = RollFrame::about(&(base_from_work.rotation * Vector3::z_axis()));
    // whether any of some places is reached, shifted
    let reaches_any = |places: &[&Point<Base>], shift: Vector3<f64>| {
        let pose = |p: &Point<Base>, axis| AxisPose { position: Point::from_coords(p.coords - shift), axis };
        let poses = places.iter().flat_map(|p| axes.iter().map(move |axis| pose(p, *axis)));
        let poses: Vec<AxisPose> = poses.collect();
        reached(arm, &poses, (frame, Posture::Any, None), &[], |_| Vec::new()).count() > 0
    };
    let Some(nearest) = nearest.filter(|_| !reaches_any(&places, Vector3::zeros())) else { return Ok(()) };
    let nearest_mm = nearest.coords.norm();
    let by = |n: i32| f64::from(n) * NEARER_MM;
    let mut shifts = (1..).map(by).take_while(|mm| *mm < nearest_mm);
    let nearer_mm = shifts.find(|mm| reaches_any(&[nearest], nearest.coords * (*mm / nearest_mm)));
    Err(PlanError::NoneReached {
        places: places.len(),
        nearest_mm,
        nearer_mm,
        axes: axes.len(),
        tilt_limit_deg: limit_rad.to_degrees(),
    })
}

/// An arm whose place is known before there is a scene.
#[derive(Debug, Clone, Copy)]
pub struct StandingArm<'a> {
    arm: &'a Arm,
    posture: Posture<'a>,
    base_from_ct: Rigid<Base, Ct>,
}

impl<'a> StandingArm<'a> {
    /// The arm of a case; `None` where its place is assumed from the scene.
    ///
    /// # Errors
    /// [`PlanError::Registration`].
    pub fn of(case: &Case, arm: &'a Arm) -> Result<Option<Self>, PlanError> {
        let posture = case.robot.branch.map_or(Posture::Any, Posture::Of);
        let standing = |base_from_ct| Self { arm, posture, base_from_ct };
        Ok(registration::given(&case.robot)?.map(standing))
    }

    /// How it tilts a shaft with so many angles: the bone-attached arm about its base's y, any other with one angle about the x of the approach's basis.
    pub fn tilts(&self, angles: u32) -> Tilts {
        let in_ct = |v: Vector3<f64>| self.base_from_ct.inverse().rotate(&v);
        match self.arm.inverse_kind() {
            InverseKind::BoneAttached => {
                Tilts::About { hinge: in_ct(Vector3::y()), zero: in_ct(Vector3::z()) }
            }
            _ => assumed_tilts(angles),
        }
    }

    /// Whether it has a joint vector at each place with the shaft along a direction, unit in ct, all in one posture. Without a closed form it is taken to
    /// have them: to search for thousands of poses takes minutes.
    pub fn holds(&self, places: &[Point<Ct>], shaft: &Vector3<f64>) -> bool {
        if self.arm.inverse_kind() == InverseKind::Numeric {
            return true;
        }
        let axis = Unit::new_normalize(self.base_from_ct.rotate(shaft));
        let pose = |place: &Point<Ct>| AxisPose { position: self.base_from_ct * *place, axis };
        let poses: Vec<_> = places.iter().map(pose).collect();
        let whole = (RollFrame::about(&axis), self.posture, None);
        reached(self.arm, &poses, whole, &[], |_| Vec::new()).count() == poses.len()
    }
}

/// How an arm whose place is assumed tilts a shaft with so many angles.
pub fn assumed_tilts(angles: u32) -> Tilts {
    if angles == 1 { Tilts::AboutBasisX } else { Tilts::Freely }
}
