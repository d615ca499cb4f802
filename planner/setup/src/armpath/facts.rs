//! Figures of the arm along a plan: its stiffness, its distance from singularities, and the lowest place of its links.

use crate::PlanError;
use bonemill_arm::Arm;
use bonemill_robot::resolve::DensePath;
use bonemill_robot::room::Room;
use nalgebra::{Matrix3, Unit, Vector3};
use rayon::prelude::*;

use super::{ArmMotion, LinkDistance};

/// The arm along a plan.
#[derive(Debug, Clone, PartialEq)]
pub struct ArmFacts {
    /// The branch of the arm's inverse that the whole path is on.
    pub branch: u8,
    /// Smallest singular value along the path, mm/s: see [`Arm::slowest_mm_s`].
    pub slowest_mm_s: f64,
    /// How stiff the arm is at the burr, where its joints' stiffness is known.
    pub stiffness: Option<Stiffnesses>,
    /// The lowest place of the arm's links over its mounting plane, where that is known.
    pub lowest_link: Option<LowestLink>,
    /// Where its links come nearest to what is around them, where that was checked.
    pub link_distance: Option<LinkDistance>,
}

impl ArmFacts {
    /// Along a motion. `compliances`: mm/N at each waypoint, where known; `toward`: unit direction to the nearest structure there.
    ///
    /// # Errors
    /// Where the motion is not the arm's.
    pub fn along<'a>(
        arm: &Arm,
        room: Option<&Room>,
        motion: &ArmMotion,
        compliances: Option<&[Matrix3<f64>]>,
        toward: impl Iterator<Item = Option<&'a Unit<Vector3<f64>>>>,
    ) -> Result<Self, PlanError> {
        Ok(Self {
            branch: motion.resolved.branch,
            slowest_mm_s: slowest_mm_s(arm, &motion.resolved.q)?,
            stiffness: compliances.and_then(|compliances| Stiffnesses::along(compliances, toward)),
            lowest_link: LowestLink::along(arm, &motion.dense)?,
            link_distance: LinkDistance::along(room, &motion.dense),
        })
    }
}

/// The lowest place of a UR's links over its mounting plane, along a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LowestLink {
    /// Its height, mm.
    pub height_mm: f64,
    /// The joint that is there, from 2 on, or 7 for the flange.
    pub joint: usize,
    /// The waypoint, or the one that the arm is on its way to.
    pub waypoint: usize,
}

impl LowestLink {
    /// Along a motion; `None` for an arm without a mounting plane that is known.
    ///
    /// # Errors
    /// Where the motion is not the arm's.
    pub fn along(arm: &Arm, motion: &DensePath) -> Result<Option<Self>, PlanError> {
        let mut lowest: Option<Self> = None;
        for (place, q) in motion.q.chunks_exact(arm.dof()).enumerate() {
            let Some((height_mm, joint)) = arm.lowest_link(q)? else { return Ok(None) };
            if lowest.is_none_or(|lowest| height_mm < lowest.height_mm) {
                let waypoint = motion.waypoints.partition_point(|at| *at < place);
                lowest = Some(Self { height_mm, joint, waypoint });
            }
        }
        Ok(lowest)
    }

    /// What is wrong where it is below the plane.
    pub fn warning(&self) -> Option<String> {
        let link = match self.joint {
            3 => "the elbow".to_owned(),
            7 => "the flange".into(),
            joint => format!("joint {joint}"),
        };
        (self.height_mm < 0.0).then(|| {
            format!(
                "{link} is {:.0} mm below the arm's mounting plane at waypoint {}, and no branch that it may take stays above it (links taken as \
                 lines between their joints; their radius comes on top): raise the patient (robot.base_from_ct), or make sure that \
                 nothing is there",
                -self.height_mm, self.waypoint
            )
        })
    }
}

/// Smallest singular value along joint vectors, mm/s: see [`Arm::slowest_mm_s`].
///
/// # Errors
/// Where `q` holds no joint vectors of the arm.
fn slowest_mm_s(arm: &Arm, q: &[f64]) -> Result<f64, PlanError> {
    let values: Result<Vec<f64>, _> = q.par_chunks(arm.dof()).map(|q| arm.slowest_mm_s(q)).collect();
    Ok(values?.into_iter().fold(f64::INFINITY, f64::min))
}

/// How stiff the arm is at the burr, N/mm: along a path, the eigenvalues of C(q)⁻¹ (D eq. 10).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stiffnesses {
    /// In the direction in which it yields most, where it yields most.
    pub softest_n_mm: f64,
    /// That waypoint.
    pub softest_waypoint: usize,
    /// In the direction in which it yields most, in the mean over waypoints.
    pub mean_softest_n_mm: f64,
    /// Toward the nearest structure, the least over waypoints that are near one.
    pub least_toward_n_mm: Option<f64>,
}

impl Stiffnesses {
    /// From compliances, mm/N, and directions to the nearest structure; none without a waypoint.
    pub fn along<'a>(
        compliances: &[Matrix3<f64>],
        toward: impl Iterator<Item = Option<&'a Unit<Vector3<f64>>>>,
    ) -> Option<Self> {
        let softest: Vec<f64> = compliances.iter().map(|c| c.symmetric_eigenvalues().max().recip()).collect();
        let (softest_waypoint, softest_n_mm) =
            softest.iter().copied().enumerate().min_by(|a, b| a.1.total_cmp(&b.1))?;
        let to_structure =
            compliances.iter().zip(toward).filter_map(|(c, u)| Some(u?.dot(&(c * u?.as_ref())).recip()));
        Some(Self {
            softest_n_mm,
            softest_waypoint,
            mean_softest_n_mm: softest.iter().sum::<f64>() / softest.len() as f64,
            least_toward_n_mm: to_structure.min_by(f64::total_cmp),
        })
    }
}
