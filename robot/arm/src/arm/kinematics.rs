//! Forward kinematics, Jacobian and compliance of any serial arm.
//!
//! Invariants: everything is a pure function of the joint vector; the pose is the product of the URDF's origins and joint
//! motions, without any fit. Inverse kinematics are elsewhere.

use bonemill_geometry::{Base, Flange, Point, Rigid, Tool};
use nalgebra::{Matrix3, Matrix3xX, Matrix6xX, Rotation3, Unit, Vector3};

use super::{Arm, ArmKind, JointKind, Mount, check_positive};
use crate::error::RobotError;

/// J χ⁻¹ Jᵀ of a burr's Jacobian, 3 × dof, and the joints' stiffness, shape (dof), above 0.
///
/// **Source:** Dillon et al. 2016, eq. (10).
pub fn compliance_mm_per_n(jacobian: &Matrix3xX<f64>, stiffness: &[f64]) -> Matrix3<f64> {
    let columns = jacobian.column_iter().zip(stiffness);
    columns.map(|(column, chi)| column * column.transpose() / *chi).sum()
}

/// The axis of a moving joint at one joint vector, in base.
struct JointAxis {
    kind: JointKind,
    /// Unit axis.
    direction: Unit<Vector3<f64>>,
    /// A point on it, mm.
    point_mm: Vector3<f64>,
}

impl Arm {
    /// Pose of the flange in base.
    ///
    /// base_from_flange = Π O_i M_i(q): O the URDF's origins, M the joint's translation q·a or rotation about a.
    /// `q`: mm or rad by joint, shape (dof).
    ///
    /// # Errors
    /// [`RobotError::Length`] or [`RobotError::Value`] where `q` is not a joint vector of this arm. Limits are not checked.
    pub fn forward(&self, q: &[f64]) -> Result<Rigid<Base, Flange>, RobotError> {
        self.check_q(q)?;
        Ok(self.walk(q, |_| ()))
    }

    /// Pose of the tool in the work frame ([`Mount`]): origin the burr's centre, z along the shaft to the handpiece.
    ///
    /// # Errors
    /// As [`Arm::forward`].
    pub fn burr(&self, q: &[f64]) -> Result<Rigid<Base, Tool>, RobotError> {
        Ok(self.mount().work_from_tool(self.forward(q)?))
    }

    /// The arm as a polyline: a point on the axis of each moving joint, and the flange last, in base, shape (dof + 1).
    ///
    /// # Errors
    /// As [`Arm::forward`].
    pub fn joint_places(&self, q: &[f64]) -> Result<Vec<Point<Base>>, RobotError> {
        self.check_q(q)?;
        let mut places = Vec::with_capacity(self.dof() + 1);
        let flange = self.walk(q, |axis| places.push(Point::from_coords(axis.point_mm)));
        places.push(Point::from_coords(flange.translation_mm));
        Ok(places)
    }

    /// Height of the lowest point of a UR's links above its mounting plane, mm, and where it is: joint 2 and following, or 7
    /// for the flange. Links are lines from joint to joint; the part from the base to the shoulder is left out. `None` for
    /// another arm.
    ///
    /// # Errors
    /// As [`Arm::forward`].
    pub fn lowest_link(&self, q: &[f64]) -> Result<Option<(f64, usize)>, RobotError> {
        if self.kind() != ArmKind::Ur {
            return Ok(None);
        }
        let places = self.joint_places(q)?;
        let heights = places.iter().enumerate().skip(1).map(|(n, place)| (place.z(), n + 1));
        Ok(heights.min_by(|a, b| a.0.total_cmp(&b.0)))
    }

    /// Geometric Jacobian at the flange's origin, in base, shape 6 × dof.
    ///
    /// Rows 0–2: d(position)/dq, mm per mm or mm per rad. Rows 3–5: angular velocity per joint velocity, 1/mm or 1.
    /// Prismatic: (a, 0); revolute: (a × (p − o), a) with a the axis, o a point on it, p the flange's origin.
    ///
    /// # Errors
    /// As [`Arm::forward`].
    pub fn jacobian(&self, q: &[f64]) -> Result<Matrix6xX<f64>, RobotError> {
        self.check_q(q)?;
        Ok(self.jacobian_at(q, &Vector3::zeros()))
    }

    /// Jacobian of the burr's centre, in the work frame, shape 3 × dof, mm per mm or mm per rad.
    ///
    /// # Errors
    /// As [`Arm::forward`].
    pub fn burr_jacobian(&self, q: &[f64]) -> Result<Matrix3xX<f64>, RobotError> {
        self.check_q(q)?;
        Ok(self.tool_jacobian_at(q).fixed_rows::<3>(0).into_owned())
    }

    /// Compliance at the burr's centre, in the work frame, mm/N: deflection = C · force.
    ///
    /// C = J χ⁻¹ Jᵀ, J the burr's 3 × dof Jacobian, χ = diag(stiffness): N/mm for prismatic and N·mm/rad for revolute
    /// joints, shape (dof). Symmetric, positive semidefinite. Links are rigid.
    ///
    /// # Errors
    /// As [`Arm::forward`], and where a stiffness is missing, not finite or not above 0.
    ///
    /// **Source:** Dillon et al. 2016, eq. (10).
    pub fn compliance(&self, q: &[f64], stiffness: &[f64]) -> Result<Matrix3<f64>, RobotError> {
        check_positive("joint_stiffness", stiffness, self.dof(), "N/mm or N·mm/rad")?;
        Ok(compliance_mm_per_n(&self.burr_jacobian(q)?, stiffness))
    }

    /// Jacobian of the tool's pose in the work frame, at the burr's centre, for a joint vector that was checked, shape
    /// 6 × dof, rows as in [`Arm::jacobian`].
    ///
    /// Block on the flange: −Rᵀ J, R the block's rotation in base, J the Jacobian in base of the block's point at the tool's
    /// origin. The tool stands still, so in the block it moves as that point does in the base, the other way.
    pub fn tool_jacobian_at(&self, q: &[f64]) -> Matrix6xX<f64> {
        match self.mount() {
            Mount::Tool(mount) => self.jacobian_at(q, &mount.flange_from_burr.translation_mm),
            Mount::Block(mount) => {
                let base_from_flange = self.walk(q, |_| ());
                let tip_in_flange_mm = (base_from_flange.inverse() * mount.base_from_tool).translation_mm;
                let block_from_base = (base_from_flange * mount.flange_from_block).rotation.inverse();
                let mut jacobian = self.jacobian_at(q, &tip_in_flange_mm);
                for mut column in jacobian.column_iter_mut() {
                    for row in [0, 3] {
                        let turned = -(block_from_base * column.fixed_rows::<3>(row));
                        column.fixed_rows_mut::<3>(row).copy_from(&turned);
                    }
                }
                jacobian
            }
        }
    }

    /// [`Arm::burr`] for a joint vector that was checked.
    pub fn tool_at(&self, q: &[f64]) -> Rigid<Base, Tool> {
        self.mount().work_from_tool(self.walk(q, |_| ()))
    }

    /// The tool's speed in its slowest direction when no joint exceeds its speed limit, mm/s: the smallest singular value of
    /// the task's Jacobian times diag(q̇ max), where one radian of the axis counts as 100 mm.
    ///
    /// The task has five coordinates: the burr's centre and the shaft's axis. For an arm with fewer joints only the motions
    /// that it can make count. The value is 0 at a singularity.
    ///
    /// # Errors
    /// As [`Arm::forward`].
    pub fn slowest_mm_s(&self, q: &[f64]) -> Result<f64, RobotError> {
        const LEVER_MM: f64 = 100.0;
        self.check_q(q)?;
        let axis = self.tool_at(q).rotation * Vector3::z();
        let mut jacobian = self.tool_jacobian_at(q);
        for (mut column, joint) in jacobian.column_iter_mut().zip(self.joints()) {
            let turn = column.fixed_rows::<3>(3).into_owned();
            column.fixed_rows_mut::<3>(3).copy_from(&((turn - axis * axis.dot(&turn)) * LEVER_MM));
            column *= joint.velocity_limit;
        }
        // singular values of J itself, because JᵀJ or JJᵀ would square the condition number
        let mut values: Vec<f64> = jacobian.singular_values().iter().copied().collect();
        values.sort_by(|a, b| b.total_cmp(a));
        Ok(values.get(self.dof().min(5) - 1).copied().unwrap_or(0.0))
    }

    /// The largest motion of the burr per unit of each joint, mm per mm or mm per rad, shape (dof).
    ///
    /// It is 1 for a prismatic joint. For a revolute joint it is the length of the chain from it to the burr: Σ |O_i| +
    /// greatest |q| of the prismatic joints + |flange_from_burr|. This is an upper bound over the whole workspace. If the arm
    /// holds a block, it is the chain from the joint through the base to the tool.
    pub fn lever_mm(&self) -> Vec<f64> {
        let mut reach_mm = match self.mount() {
            Mount::Tool(mount) => mount.flange_from_burr.translation_mm.norm(),
            Mount::Block(mount) => {
                return self.lever_from_base_mm(mount.base_from_tool.translation_mm.norm());
            }
        };
        let mut levers = Vec::with_capacity(self.dof());
        let mut joints = self.joints().iter().rev();
        for segment in self.segments.iter().rev() {
            let moving = segment.motion.and_then(|(kind, _)| Some((kind, joints.next()?)));
            match moving {
                Some((JointKind::Revolute, _)) => levers.push(reach_mm),
                Some((JointKind::Prismatic, joint)) => {
                    levers.push(1.0);
                    reach_mm += joint.lower.abs().max(joint.upper.abs());
                }
                None => {}
            }
            reach_mm += segment.translation_mm.norm();
        }
        levers.reverse();
        levers
    }

    /// The farthest that the burr's centre can be from the base's origin, mm: Σ |O_i| + greatest |q| of the prismatic joints +
    /// |flange_from_burr|, an upper bound. `None` for an arm that holds a block.
    pub fn farthest_mm(&self) -> Option<f64> {
        let links: f64 = self.segments.iter().map(|segment| segment.translation_mm.norm()).sum();
        let slides = self.joints().iter().filter(|joint| joint.kind == JointKind::Prismatic);
        let slid: f64 = slides.map(|joint| joint.lower.abs().max(joint.upper.abs())).sum();
        Some(links + slid + self.mount().tool()?.flange_from_burr.translation_mm.norm())
    }

    /// [`Arm::lever_mm`] with the chain from each joint through the base to a point at a distance from it, mm.
    fn lever_from_base_mm(&self, mut reach_mm: f64) -> Vec<f64> {
        let mut joints = self.joints().iter();
        let mut levers = Vec::with_capacity(self.dof());
        for segment in &self.segments {
            reach_mm += segment.translation_mm.norm();
            match segment.motion.and_then(|(kind, _)| Some((kind, joints.next()?))) {
                Some((JointKind::Revolute, _)) => levers.push(reach_mm),
                Some((JointKind::Prismatic, joint)) => {
                    levers.push(1.0);
                    reach_mm += joint.lower.abs().max(joint.upper.abs());
                }
                None => {}
            }
        }
        levers
    }

    /// Jacobian of the point `in_flange_mm`, which moves with the flange. `q` was checked.
    fn jacobian_at(&self, q: &[f64], in_flange_mm: &Vector3<f64>) -> Matrix6xX<f64> {
        let mut axes = Vec::with_capacity(self.dof());
        let pose = self.walk(q, |axis| axes.push(axis));
        let point = pose.rotation * in_flange_mm + pose.translation_mm;
        let mut jacobian = Matrix6xX::zeros(axes.len());
        for (mut column, axis) in jacobian.column_iter_mut().zip(&axes) {
            let (linear, angular) = match axis.kind {
                JointKind::Prismatic => (axis.direction.into_inner(), Vector3::zeros()),
                JointKind::Revolute => {
                    (axis.direction.cross(&(point - axis.point_mm)), axis.direction.into_inner())
                }
            };
            column.fixed_rows_mut::<3>(0).copy_from(&linear);
            column.fixed_rows_mut::<3>(3).copy_from(&angular);
        }
        jacobian
    }

    /// Multiplies the transforms from base to flange and calls `show` with every moving joint's axis. `q` was checked.
    fn walk(&self, q: &[f64], mut show: impl FnMut(JointAxis)) -> Rigid<Base, Flange> {
        let mut rotation = Rotation3::identity();
        let mut origin = Vector3::zeros();
        let mut positions = q.iter();
        for segment in &self.segments {
            origin += rotation * segment.translation_mm;
            rotation *= segment.rotation;
            let Some((kind, axis)) = segment.motion else { continue };
            let position = positions.next().copied().unwrap_or(0.0);
            let direction = Unit::new_unchecked(rotation * axis.into_inner());
            show(JointAxis { kind, direction, point_mm: origin });
            match kind {
                JointKind::Prismatic => origin += direction.into_inner() * position,
                JointKind::Revolute => rotation *= Rotation3::from_axis_angle(&axis, position),
            }
        }
        Rigid::new(rotation, origin)
    }
}
