//! Inverse kinematics of any arm: joint vectors for a pose of the tool.
//!
//! UR arms and the bone-attached arm have closed forms. For a calibrated UR, each nominal branch is corrected by damped
//! least squares. Any other arm is solved by a search from a fixed set of starts, so that the result is repeatable.
//! A pose out of reach is a value ([`Solutions::short_mm`]), not an error.
//!
//! Poses of the tool are in the work frame: the base for a tool on the flange, the block for a block on it ([`super::Mount`]).
//!
//! The burr rotates about the shaft, so a cut only determines the burr's centre and the shaft's axis ([`AxisPose`]). For
//! arms with fewer than six joints only these are solved for.

use bonemill_geometry::{Base, Point, Rigid, Tool};
use nalgebra::{Rotation3, Unit, Vector3};

use super::dls::{self, ToolGoal};
use super::{Arm, bone_attached};
use crate::error::RobotError;
use crate::ur::UrGeometry;
use crate::ur::ik::wrapped;

/// Largest error of a solution's forward kinematics, mm and rad.
const EXACT: f64 = 1e-9;

/// Number of starts of the search for arms without closed form.
const STARTS: u32 = 48;

/// Joint vectors nearer than this in every joint are the same solution, mm or rad.
const SAME: f64 = 1e-6;

/// How an arm's inverse kinematics are computed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum InverseKind {
    /// By the closed form of the bone-attached arm.
    BoneAttached,
    /// By the closed form of a UR.
    Ur {
        /// Its DH table.
        geometry: UrGeometry,
        /// Whether the arm is calibrated, so that the geometry is only approximate.
        calibrated: bool,
    },
    /// By damped least squares.
    Numeric,
}

/// The pose that a cut requires: the burr's centre and the shaft's axis, in the work frame ([`super::Mount`]). The rotation
/// about the axis is free.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisPose {
    /// The burr's centre.
    pub position: Point<Base>,
    /// From burr to handpiece.
    pub axis: Unit<Vector3<f64>>,
}

impl AxisPose {
    /// The full pose at a roll about the axis; roll 0 is the shortest rotation from `reference` to the axis.
    ///
    /// The pose is continuous in axis, reference and roll, except where the axis is opposite to the reference.
    pub fn spun(&self, reference: &RollFrame, roll_rad: f64) -> Rigid<Base, Tool> {
        Rigid::new(self.upright(reference) * about_z(roll_rad), self.position.coords)
    }

    /// The rotation at roll 0.
    pub fn upright(&self, reference: &RollFrame) -> Rotation3<f64> {
        let turn = Rotation3::rotation_between(&reference.direction(), &self.axis)
            .unwrap_or_else(|| Rotation3::from_axis_angle(&reference.across(), std::f64::consts::PI));
        turn * reference.work_from_upright
    }

    /// A pose between two: the point lies on the line, the axis on the great circle; `share` in 0..=1.
    pub fn between(&self, to: &Self, share: f64) -> Self {
        let (angle, across) = angle_between(&self.axis, &to.axis);
        let position = self.position + (to.position - self.position) * share;
        let axis =
            across.map_or(self.axis, |across| Rotation3::from_axis_angle(&across, angle * share) * self.axis);
        Self { position, axis }
    }
}

/// A roll about the shaft, in the tool's frame.
pub fn about_z(roll_rad: f64) -> Rotation3<f64> {
    Rotation3::from_axis_angle(&Vector3::z_axis(), roll_rad)
}

/// Angle between two axes, rad, and the axis of the rotation from the first to the second; `None` where they are (nearly)
/// parallel.
pub fn angle_between(from: &Vector3<f64>, to: &Vector3<f64>) -> (f64, Option<Unit<Vector3<f64>>>) {
    let cross = from.cross(to);
    let sine = cross.norm();
    (sine.atan2(from.dot(to)), Unit::try_new(cross, 1e-15))
}

/// The zero of roll angles: a frame whose z is a direction near all axes of a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RollFrame {
    work_from_upright: Rotation3<f64>,
}

impl RollFrame {
    /// The frame for axes near `direction` (in the work frame); roll 0 is its x, projected perpendicular to `direction`.
    pub fn about(direction: &Unit<Vector3<f64>>) -> Self {
        let across = [Vector3::x(), Vector3::y()]
            .map(|candidate| candidate - direction.into_inner() * direction.dot(&candidate))
            .into_iter()
            .find(|across| across.norm() > 0.5)
            .unwrap_or_else(Vector3::x);
        let x = across.normalize();
        let y = direction.cross(&x);
        let columns = nalgebra::Matrix3::from_columns(&[x, y, direction.into_inner()]);
        Self { work_from_upright: Rotation3::from_matrix_unchecked(columns) }
    }

    fn direction(&self) -> Vector3<f64> {
        self.work_from_upright.matrix().column(2).into_owned()
    }

    fn across(&self) -> Unit<Vector3<f64>> {
        Unit::new_unchecked(self.work_from_upright.matrix().column(0).into_owned())
    }
}

/// Joint vectors for a pose.
#[derive(Debug, Clone, PartialEq)]
pub struct Solutions {
    /// One joint vector per branch that reaches the pose, mm or rad by joint; turned by 2π into the joints' ranges where
    /// that is possible.
    pub q: Vec<Vec<f64>>,
    /// The branch of each joint vector: for a UR 4·shoulder + 2·wrist + elbow, else its number.
    pub branch: Vec<u8>,
    /// By how much the arm falls short, mm; 0 where there is a solution.
    pub short_mm: f64,
    /// By how much the axis falls short, rad; 0 where there is a solution.
    pub short_rad: f64,
}

impl Arm {
    /// Every joint vector that brings the tool to a pose in the work frame; of an arm without closed form those that searches from several
    /// starts find, which for more than six joints are some of infinitely many. For arms of fewer than six joints only the pose's origin and
    /// z axis are used.
    ///
    /// Joint limits are not checked: see [`Arm::beyond_limits`].
    ///
    /// # Errors
    /// [`RobotError::Value`] where the pose is not finite.
    pub fn inverse(&self, work_from_tool: &Rigid<Base, Tool>) -> Result<Solutions, RobotError> {
        let numbers = work_from_tool.translation_mm.iter().chain(work_from_tool.rotation.matrix().iter());
        if let Some((index, &value)) = numbers.enumerate().find(|(_, value)| !value.is_finite()) {
            let (what, unit, expected) = ("pose", "mm or 1", "a finite number");
            return Err(RobotError::Value { what, index, value, unit, expected });
        }
        let z = Unit::new_normalize(work_from_tool.rotation * Vector3::z());
        let pose = AxisPose { position: Point::from_coords(work_from_tool.translation_mm), axis: z };
        Ok(match self.inverse {
            InverseKind::BoneAttached => self.inverse_bone_attached(&pose),
            InverseKind::Ur { .. } => self.inverse_ur(work_from_tool),
            InverseKind::Numeric if self.dof() >= 6 => self.search(&ToolGoal::Pose(*work_from_tool)),
            InverseKind::Numeric => self.search(&ToolGoal::Axis(pose)),
        })
    }

    fn inverse_bone_attached(&self, pose: &AxisPose) -> Solutions {
        match bone_attached::tilt_for_axis(&pose.axis) {
            Some(tilt) if tilt.error_rad <= EXACT => Solutions {
                q: vec![bone_attached::ik(pose.position, tilt.tilt_rad).to_vec()],
                branch: vec![0],
                short_mm: 0.0,
                short_rad: 0.0,
            },
            tilt => {
                let short_rad = tilt.map_or(std::f64::consts::FRAC_PI_2, |tilt| tilt.error_rad);
                Solutions { q: vec![], branch: vec![], short_mm: 0.0, short_rad }
            }
        }
    }

    fn inverse_ur(&self, work_from_tool: &Rigid<Base, Tool>) -> Solutions {
        let mut solutions = Solutions { q: vec![], branch: vec![], short_mm: 0.0, short_rad: 0.0 };
        let InverseKind::Ur { geometry, calibrated } = self.inverse else { return solutions };
        let flange = self.mount().base_from_flange(work_from_tool);
        let found = geometry.inverse(&flange, 0.0);
        solutions.short_mm = found.short_mm;
        for (branch, nominal) in found.iter() {
            let mut q = nominal.to_vec();
            if calibrated {
                let refined = dls::solve(self, &ToolGoal::Pose(*work_from_tool), nominal);
                if !refined.is_within(EXACT) {
                    solutions.short_mm = solutions.short_mm.max(refined.short_mm);
                    continue;
                }
                q = refined.q;
            }
            self.bring_into_range(&mut q);
            solutions.q.push(q);
            solutions.branch.push(branch as u8);
        }
        if !solutions.q.is_empty() {
            solutions.short_mm = 0.0;
        }
        solutions
    }

    /// Damped least squares from starts spread over the joints' ranges.
    fn search(&self, goal: &ToolGoal) -> Solutions {
        let mut solutions = Solutions { q: vec![], branch: vec![], short_mm: f64::INFINITY, short_rad: 0.0 };
        for k in 0..STARTS {
            let found = dls::solve(self, goal, &self.start(k));
            if found.is_within(EXACT) {
                let mut q = found.q;
                self.bring_into_range(&mut q);
                let same = |other: &Vec<f64>| other.iter().zip(&q).all(|(a, b)| wrapped(a - b).abs() < SAME);
                if !solutions.q.iter().any(same) {
                    solutions.branch.push(solutions.q.len() as u8);
                    solutions.q.push(q);
                }
            } else if found.short_mm < solutions.short_mm {
                (solutions.short_mm, solutions.short_rad) = (found.short_mm, found.short_rad);
            }
        }
        if !solutions.q.is_empty() {
            (solutions.short_mm, solutions.short_rad) = (0.0, 0.0);
        }
        solutions
    }

    /// The k-th start of a search: first the middle of the ranges, then a low-discrepancy sequence by a generalised golden
    /// ratio.
    pub fn start(&self, k: u32) -> Vec<f64> {
        let dof = self.dof() as f64;
        // the root of x^(n+1) = x + 1 gives the most even spread in n dimensions
        let ratio = (0..32).fold(1.5f64, |x, _| (1.0 + x).powf(1.0 / (dof + 1.0)));
        let place = |(j, joint): (usize, &super::Joint)| {
            let (lower, upper) =
                (joint.lower.max(-std::f64::consts::PI), joint.upper.min(std::f64::consts::PI));
            let (lower, upper) = match joint.kind {
                super::JointKind::Revolute if lower < upper => (lower, upper),
                _ => (joint.lower, joint.upper),
            };
            let share = (0.5 + f64::from(k) * ratio.powi(-(j as i32 + 1))).fract();
            lower + share * (upper - lower)
        };
        self.joints().iter().enumerate().map(place).collect()
    }

    /// Turns revolute joints by multiples of 2π into their ranges where possible, as near to the middle as possible.
    pub fn bring_into_range(&self, q: &mut [f64]) {
        const TURN: f64 = std::f64::consts::TAU;
        for (joint, q) in self.joints().iter().zip(q) {
            if joint.kind == super::JointKind::Prismatic || !joint.is_bounded() {
                continue;
            }
            let off = *q - 0.5 * (joint.lower + joint.upper);
            if off.abs() > 0.5 * TURN {
                *q -= TURN * (off / TURN).round();
            }
        }
    }
}
