//! Chooses an arm's joint vectors along a path of points and axes.
//!
//! The burr rotates about the shaft, so the roll about its axis is free, and a UR has eight branches for every pose. Both
//! are chosen over the whole path, because choosing the best roll step by step leads to a joint limit or a singularity.
//!
//! - UR arms (`grid`): dynamic programming over sampled rolls, one pass per branch; then the rolls are smoothed between the
//!   samples. The whole path stays on one branch, because two branches are separated by a singularity, which the burr
//!   cannot avoid on its line. A posture with a link below the mounting plane is taken only where there is no other.
//! - The bone-attached arm has one joint vector for every pose.
//! - Other arms of six turning joints or more (`spare`): the same with solutions by damped least squares; of seven joints the position of one is chosen
//!   together with the roll.
//! - The rest, and what cannot be sampled so (`track`): the path is followed by damped least squares from several starts.
//!
//! The cost is J = Σ g(q) Δs + w Σ Σⱼ (Δqⱼ/q̇ⱼ)²/Δs. g grows near limits and singularities, and with the compliance toward a
//! structure where one is given; the second term is the joints' motion.
//!
//! [`postures`] tells beforehand which poses an arm can take in one posture. [`dense`] then lays joint positions so close
//! together that the arm, moving straight in joint space, follows the path in space.
//!
//! A path out of reach is a value ([`OutOfReach`]) that says where and by how much.

pub mod dense;
mod grid;
pub mod postures;
mod rolls;
mod spare;
mod track;

use nalgebra::{Unit, Vector3};

use crate::room::{Nearest, Room, link_name};
use bonemill_arm::RobotError;
pub use bonemill_arm::arm::inverse::RollFrame;
use bonemill_arm::arm::{Arm, AxisPose, InverseKind, JointExcess, ToolGoal, bone_attached, dls};
use bonemill_arm::ur::Branches;
use bonemill_arm::ur::ik::wrapped;
pub use dense::DensePath;

/// Largest error of a followed pose, mm and rad.
const EXACT: f64 = 1e-8;

/// Joint stiffness and the directions in which compliance adds to the cost.
#[derive(Debug, Clone, Copy)]
pub struct Stiffness<'a> {
    /// Stiffness of each joint, N/mm or N·mm/rad.
    pub joint: &'a [f64],
    /// For each pose, the direction in the work frame in which compliance adds to the cost; `None` where no direction does.
    pub toward: &'a [Option<Unit<Vector3<f64>>>],
}

/// A path that an arm is to follow.
#[derive(Debug, Clone, Copy)]
pub struct PosePath<'a> {
    /// Points and axes, in the arm's work frame ([`bonemill_arm::Mount`]).
    pub poses: &'a [AxisPose],
    /// Length of the move that ends at each, mm; the first is ignored.
    pub length_mm: &'a [f64],
    /// The frame from which rolls are measured; its z is near all axes.
    pub frame: RollFrame,
    /// Stiffness towards structures, where it adds to the cost.
    pub stiffness: Option<Stiffness<'a>>,
    /// The posture that the path must keep.
    pub posture: Posture<'a>,
    /// What the arm's links must keep clear of, where that is known.
    pub room: Option<&'a Room>,
}

/// The posture that an arm must keep along a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Posture<'a> {
    /// Any posture.
    Any,
    /// One of these branches of a UR.
    Of(Branches),
    /// For an arm without closed form: a start near this joint vector, if the path can be followed from there.
    From(&'a [f64]),
}

/// Joint vectors along a path.
#[derive(Debug, Clone, PartialEq)]
pub struct Resolved {
    /// Joint vectors, mm or rad, shape (poses × dof); revolute joints have no jumps by 2π.
    pub q: Vec<f64>,
    /// Roll about the axis at each pose, rad, without jumps; 0 for arms that have no choice.
    pub roll_rad: Vec<f64>,
    /// The branch of the whole path.
    pub branch: u8,
}

/// Why a path cannot be followed.
#[derive(Debug, Clone, PartialEq)]
pub struct OutOfReach {
    /// The pose, from 0.
    pub pose: usize,
    /// Why the pose cannot be taken.
    pub reason: ReachReason,
}

/// Why a pose cannot be taken.
#[derive(Debug, Clone, PartialEq)]
pub enum ReachReason {
    /// The point is too far away, or too near.
    Beyond {
        /// Distance out of reach, mm.
        short_mm: f64,
    },
    /// The arm cannot tilt so.
    Axis {
        /// Missing angle, rad.
        short_rad: f64,
    },
    /// A joint would leave its range.
    Limit(JointExcess),
    /// The pose can be taken, but not on the requested branch.
    Branch,
    /// Every posture brings a link nearer to something than the clearance.
    Meets(Meeting),
    /// Each pose can be taken, but the joints would have to jump between this one and the one before.
    Jump,
}

/// A link that comes too near to something, in the posture that keeps it away most.
#[derive(Debug, Clone, PartialEq)]
pub struct Meeting {
    /// The link.
    pub link: &'static str,
    /// What it is too near to.
    pub other: String,
    /// A distance that it surely keeps, mm; below 0 where they may overlap.
    pub distance_mm: f64,
    /// The distance that it should keep, mm.
    pub clearance_mm: f64,
}

impl Meeting {
    /// What is nearest in a room.
    pub fn of(room: &Room, nearest: &Nearest) -> Self {
        Self {
            link: link_name(nearest.link),
            other: room.name(nearest.other),
            distance_mm: nearest.distance_mm,
            clearance_mm: room.clearance_mm(),
        }
    }
}

impl std::fmt::Display for Meeting {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { link, other, distance_mm, clearance_mm } = self;
        if *distance_mm < 0.0 {
            write!(f, "the arm's {link} runs into {other} by up to {:.1} mm", -distance_mm)?;
        } else {
            write!(f, "the arm's {link} comes within {distance_mm:.1} mm of {other}")?;
        }
        let more = if distance_mm < clearance_mm { "" } else { "; postures keep a little more" };
        write!(f, " (robot.link_clearance_mm = {clearance_mm}{more})")
    }
}

impl std::fmt::Display for ReachReason {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Beyond { short_mm } => write!(f, "out of reach by {short_mm:.2} mm"),
            Self::Axis { short_rad } => write!(f, "the shaft's axis is {:.2}° beyond what the arm can tilt", short_rad.to_degrees()),
            Self::Limit(excess) => excess.fmt(f),
            Self::Meets(meeting) => meeting.fmt(f),
            Self::Branch => f.write_str("another branch of the arm reaches it, but not what robot.branch asks for"),
            Self::Jump => f.write_str("the joints would have to jump: the path leads through a singularity or from branch to branch"),
        }
    }
}

/// Joint vectors for a path, or the reason why there are none.
///
/// # Errors
/// [`RobotError::Length`] where lists do not match the poses or joints.
pub fn resolve(arm: &Arm, path: &PosePath<'_>) -> Result<Result<Resolved, OutOfReach>, RobotError> {
    let expected = path.poses.len();
    let length = |what, got| Err(RobotError::Length { what, got, expected });
    if path.length_mm.len() != expected {
        return length("path length", path.length_mm.len());
    }
    if let Some(stiffness) = &path.stiffness {
        if stiffness.toward.len() != expected {
            return length("direction of stiffness", stiffness.toward.len());
        }
        bonemill_arm::arm::check_positive("joint_stiffness", stiffness.joint, arm.dof(), "N/mm or N·mm/rad")?;
    }
    if path.poses.is_empty() {
        return Ok(Ok(Resolved { q: vec![], roll_rad: vec![], branch: 0 }));
    }
    let in_range = |mut resolved| into_range(arm, &mut resolved).map(|()| resolved);
    Ok(match arm.inverse_kind() {
        InverseKind::BoneAttached => closed_form(arm, path).and_then(in_range),
        InverseKind::Ur { .. } => grid::resolve(arm, path),
        InverseKind::Numeric => {
            let step_by_step = || track::resolve(arm, path).and_then(in_range);
            if spare::is_for(arm) {
                spare::resolve(arm, path).or_else(|_| step_by_step())
            } else {
                step_by_step()
            }
        }
    })
}

/// ûᵀ C û toward a pose's structure, mm/N, times 100 N/mm; 0 where no direction is given. For an arm of that stiffness this
/// equals the cost of a posture half-way to its limits.
fn yielding(arm: &Arm, path: &PosePath<'_>, pose: usize, q: &[f64]) -> f64 {
    let Some(Stiffness { joint, toward }) = path.stiffness else { return 0.0 };
    let Some(toward) = toward.get(pose).copied().flatten() else { return 0.0 };
    let jacobian = arm.tool_jacobian_at(q);
    let columns = jacobian.column_iter().zip(joint);
    let yields: f64 = columns.map(|(column, chi)| column.fixed_rows::<3>(0).dot(&toward).powi(2) / chi).sum();
    100.0 * yields
}

/// The joint vectors of the bone-attached arm.
fn closed_form(arm: &Arm, path: &PosePath<'_>) -> Result<Resolved, OutOfReach> {
    let mut q = vec![0.0; 4];
    let mut all = Vec::with_capacity(path.poses.len() * 4);
    for (i, pose) in path.poses.iter().enumerate() {
        Follower { arm, frame: path.frame, branch: 0 }
            .step(pose, 0.0, &mut q)
            .map_err(|reason| OutOfReach { pose: i, reason })?;
        all.extend_from_slice(&q);
    }
    Ok(Resolved { q: all, roll_rad: vec![0.0; path.poses.len()], branch: 0 })
}

/// Turns revolute joints by multiples of 2π, the same for the whole path, into their ranges, and checks that the whole path
/// is within them.
fn into_range(arm: &Arm, resolved: &mut Resolved) -> Result<(), OutOfReach> {
    const TURN: f64 = std::f64::consts::TAU;
    let dof = arm.dof();
    for (j, joint) in arm.joints().iter().enumerate() {
        let values = || resolved.q.iter().skip(j).step_by(dof);
        let least = values().copied().fold(f64::INFINITY, f64::min);
        let most = values().copied().fold(f64::NEG_INFINITY, f64::max);
        if joint.kind == bonemill_arm::JointKind::Revolute && joint.is_bounded() {
            let turns = ((0.5 * (least + most) - 0.5 * (joint.lower + joint.upper)) / TURN).round();
            if turns != 0.0 {
                resolved.q.iter_mut().skip(j).step_by(dof).for_each(|q| *q -= TURN * turns);
            }
        }
    }
    for (pose, q) in resolved.q.chunks_exact(dof).enumerate() {
        if let Some(excess) = arm.excess_at(q) {
            return Err(OutOfReach { pose, reason: ReachReason::Limit(excess) });
        }
    }
    Ok(())
}

/// Follows a path from pose to pose on one branch.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Follower<'a> {
    pub arm: &'a Arm,
    pub frame: RollFrame,
    pub branch: u8,
}

impl Follower<'_> {
    /// Replaces `q` by the pose's joint vector that is nearest to it.
    pub fn step(&self, pose: &AxisPose, roll_rad: f64, q: &mut [f64]) -> Result<(), ReachReason> {
        match self.arm.inverse_kind() {
            InverseKind::BoneAttached => {
                let tilt = bone_attached::tilt_for_axis(&pose.axis);
                let short_rad = tilt.map_or(std::f64::consts::FRAC_PI_2, |tilt| tilt.error_rad);
                match tilt.filter(|_| short_rad <= EXACT) {
                    None => return Err(ReachReason::Axis { short_rad }),
                    Some(tilt) => q.copy_from_slice(&bone_attached::ik(pose.position, tilt.tilt_rad)),
                }
            }
            InverseKind::Ur { geometry, calibrated } => {
                let tool = pose.spun(&self.frame, roll_rad);
                let flange = self.arm.mount().base_from_flange(&tool);
                let found = geometry.inverse(&flange, q.last().copied().unwrap_or(0.0));
                let Some(mut solution) = found.branches.get(usize::from(self.branch)).copied().flatten()
                else {
                    return Err(ReachReason::Beyond { short_mm: found.short_mm });
                };
                if calibrated {
                    let refined = dls::solve(self.arm, &ToolGoal::Pose(tool), &solution);
                    if !refined.is_within(EXACT) {
                        return Err(ReachReason::Beyond { short_mm: refined.short_mm });
                    }
                    solution.copy_from_slice(&refined.q);
                }
                for (q, solution) in q.iter_mut().zip(solution) {
                    *q += wrapped(solution - *q);
                }
            }
            InverseKind::Numeric => {
                let found = dls::solve(self.arm, &ToolGoal::Axis(*pose), q);
                if found.short_rad > EXACT && found.short_rad * 100.0 > found.short_mm {
                    return Err(ReachReason::Axis { short_rad: found.short_rad });
                }
                if found.short_mm > EXACT {
                    return Err(ReachReason::Beyond { short_mm: found.short_mm });
                }
                q.copy_from_slice(&found.q);
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
