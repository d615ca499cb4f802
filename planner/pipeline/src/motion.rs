//! Joint positions along the planned path, and how much the arm yields on it.
//!
//! What is planned so far are points and unit axes in work; which joint vectors the arm takes there is decided over the
//! whole sequence (`bonemill_motion::resolve`). Out of reach is told by waypoint.
//!
//! Compliance is computed twice: by tilt, before the angles are chosen, and at every waypoint, when the joints are known.
//! Before that, the bone-attached arm's depends on the tilt alone; another's is taken with the burr at the target's centre,
//! a few mm of an arm's reach away from where it will be.

use bonemill_arm::Arm;
use bonemill_arm::arm::AxisPose;
use bonemill_case::{Case, ForceTerm};
use bonemill_geometry::{Base, Point, Rigid, Work};
use bonemill_motion::resolve::{
    DensePath, OutOfReach, PosePath, Posture, Resolved, RollFrame, Stiffness, resolve,
};
use nalgebra::{Matrix3, Unit, Vector3};
use rayon::prelude::*;

use super::PlanError;

/// The arm where it stands.
#[derive(Debug, Clone, Copy)]
pub struct Placed<'a> {
    /// Its kinematics.
    pub arm: &'a Arm,
    /// Where the patient is.
    pub base_from_work: &'a Rigid<Base, Work>,
    /// Which posture it must be in.
    pub posture: Posture<'a>,
}

/// Joint positions along the path.
#[derive(Debug, Clone)]
pub struct Motion {
    /// At the waypoints.
    pub resolved: Resolved,
    /// With places between them.
    pub dense: DensePath,
}

impl<'a> Placed<'a> {
    /// A point and a shaft axis in work, as the arm sees them.
    pub fn pose(&self, position: Point<Work>, axis: &Unit<Vector3<f64>>) -> AxisPose {
        AxisPose {
            position: *self.base_from_work * position,
            axis: Unit::new_normalize(self.base_from_work.rotate(axis)),
        }
    }

    /// Spins are counted about the approach.
    pub fn frame(&self) -> RollFrame {
        RollFrame::about(&Unit::new_normalize(self.base_from_work.rotate(&Vector3::z())))
    }

    /// Joint positions along points and axes in work.
    ///
    /// `stiffness`: of the joints, and where the arm shall yield little, here in work; `None` leaves that out.
    ///
    /// # Errors
    /// [`PlanError::OutOfReach`] naming the waypoint.
    pub fn motion(
        &self,
        positions: &[Point<Work>],
        axes: &[Unit<Vector3<f64>>],
        length_mm: &[f64],
        stiffness: Option<Stiffness<'_>>,
    ) -> Result<Motion, PlanError> {
        let poses: Vec<AxisPose> = positions.iter().zip(axes).map(|(p, a)| self.pose(*p, a)).collect();
        let in_base: Option<Vec<_>> = stiffness.map(|stiffness| {
            let turned = |u: &Unit<Vector3<f64>>| Unit::new_normalize(self.base_from_work.rotate(u));
            stiffness.toward.iter().map(|u| u.as_ref().map(turned)).collect()
        });
        let stiffness = stiffness
            .zip(in_base.as_deref())
            .map(|(Stiffness { joint, .. }, toward)| Stiffness { joint, toward });
        let path =
            PosePath { poses: &poses, length_mm, frame: self.frame(), stiffness, posture: self.posture };
        let out_of_reach = |failed: OutOfReach| PlanError::OutOfReach {
            waypoint: failed.pose,
            axis: axes[failed.pose],
            excess: failed.reason.to_string(),
        };
        let resolved = resolve(self.arm, &path)?.map_err(out_of_reach)?;
        let dense = DensePath::lay(self.arm, &path, &resolved).map_err(out_of_reach)?;
        Ok(Motion { resolved, dense })
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
pub fn slowest_mm_s(arm: &Arm, q: &[f64]) -> Result<f64, PlanError> {
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

/// The arm's compliance, when its stiffness is known.
pub struct Compliance<'a> {
    placed: Placed<'a>,
    stiffness: Option<&'a [f64]>,
}

impl<'a> Compliance<'a> {
    /// Of a case's arm.
    ///
    /// # Errors
    /// [`PlanError::StiffnessMissing`] where the case's cost asks for the deflection and gives no stiffness.
    pub fn new(case: &'a Case, placed: Placed<'a>) -> Result<Self, PlanError> {
        let stiffness = case.robot.joint_stiffness.as_deref();
        if stiffness.is_none() && case.cost.force == ForceTerm::Deflection {
            return Err(PlanError::StiffnessMissing);
        }
        Ok(Self { placed, stiffness })
    }

    /// What a case's cost turns forces by, mm/N in work for each of neighbouring axes with the burr at `at`; `None` where it looks at
    /// the force itself. An axis that the arm cannot take there has that of the nearest one that it can.
    ///
    /// # Errors
    /// As [`Compliance::at_axes`].
    pub fn of_cost(
        &self,
        case: &Case,
        at: Point<Work>,
        axes: &[Unit<Vector3<f64>>],
        allows: impl Fn(&Vector3<f64>) -> bool,
    ) -> Result<Option<Vec<Matrix3<f64>>>, PlanError> {
        if case.cost.force == ForceTerm::Cutting {
            return Ok(None);
        }
        let taken: Vec<_> = axes.iter().copied().filter(|axis| allows(axis)).collect();
        let taken = if taken.is_empty() { axes.to_vec() } else { taken };
        let Some(found) = self.at_axes(at, &taken)? else { return Ok(None) };
        let nearest = |axis: &Unit<Vector3<f64>>| {
            let cosine = |n: &usize| taken[*n].dot(axis);
            (0..taken.len()).max_by(|a, b| cosine(a).total_cmp(&cosine(b))).unwrap_or(0)
        };
        Ok(Some(axes.iter().map(|axis| found[nearest(axis)]).collect()))
    }

    /// mm/N in work for each of neighbouring axes, the burr at `at`.
    ///
    /// # Errors
    /// [`PlanError::OutOfReach`] where the arm cannot stand there.
    pub fn at_axes(
        &self,
        at: Point<Work>,
        axes: &[Unit<Vector3<f64>>],
    ) -> Result<Option<Vec<Matrix3<f64>>>, PlanError> {
        if self.stiffness.is_none() {
            return Ok(None);
        }
        let motion = self.placed.motion(&vec![at; axes.len()], axes, &vec![0.0; axes.len()], None)?;
        self.along(&motion.resolved.q)
    }

    /// mm/N in work at each of a sequence of joint vectors.
    ///
    /// # Errors
    /// Where the stiffness does not fit the arm.
    pub fn along(&self, q: &[f64]) -> Result<Option<Vec<Matrix3<f64>>>, PlanError> {
        let Some(stiffness) = self.stiffness else { return Ok(None) };
        let turn = self.placed.base_from_work.rotation.into_inner();
        let arm = self.placed.arm;
        let one = |q: &[f64]| -> Result<_, PlanError> {
            Ok(turn.transpose() * arm.compliance(q, stiffness)? * turn)
        };
        q.par_chunks(arm.dof()).map(one).collect::<Result<Vec<_>, _>>().map(Some)
    }
}
