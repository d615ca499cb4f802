//! What an arm holds on its flange, and so the frame in which its tool's poses are given.
//!
//! A tool on the flange moves in the base. If the arm holds the block and the tool stands still, the tool moves in the block: the same chain, seen
//! from its other end. The *work frame* is the base in the first case and the block in the second. Inverse kinematics, paths and time laws need only
//! the tool's pose in the work frame, its Jacobian there, and the flange's pose that belongs to it, so they do not ask which of the two it is.
//! Their types name the base ([`Rigid<Base, Tool>`], [`super::AxisPose`]); for an arm that holds a block, these are poses in the block.

use bonemill_geometry::{Base, Block, Flange, Rigid, Tool};

/// What an arm holds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Mount {
    /// The tool; the work frame is the base.
    Tool(ToolMount),
    /// The block, while the tool stands still; the work frame is the block.
    Block(BlockMount),
}

/// How the tool sits on the flange.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ToolMount {
    /// Pose of the tool (origin: burr's centre, z: along the shaft to the handpiece) in the flange.
    pub flange_from_burr: Rigid<Flange, Tool>,
}

/// How the block sits on the flange, and where the tool stands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BlockMount {
    /// Pose of the block in the flange.
    pub flange_from_block: Rigid<Flange, Block>,
    /// Pose of the tool (origin: the point that follows a path, z: along the shaft away from the cut) in the base.
    pub base_from_tool: Rigid<Base, Tool>,
}

impl Default for ToolMount {
    /// The identity: the URDF ends at the burr.
    fn default() -> Self {
        Self { flange_from_burr: Rigid::identity() }
    }
}

impl From<ToolMount> for Mount {
    fn from(mount: ToolMount) -> Self {
        Self::Tool(mount)
    }
}

impl From<BlockMount> for Mount {
    fn from(mount: BlockMount) -> Self {
        Self::Block(mount)
    }
}

impl Mount {
    /// How the tool sits on the flange; `None` where the arm holds a block.
    pub fn tool(&self) -> Option<ToolMount> {
        match self {
            Self::Tool(mount) => Some(*mount),
            Self::Block(_) => None,
        }
    }

    /// Pose of the tool in the work frame.
    ///
    /// Tool: base_from_flange · flange_from_burr. Block: (base_from_flange · flange_from_block)⁻¹ · base_from_tool.
    pub fn work_from_tool(&self, base_from_flange: Rigid<Base, Flange>) -> Rigid<Base, Tool> {
        match self {
            Self::Tool(mount) => base_from_flange * mount.flange_from_burr,
            Self::Block(mount) => {
                let block_from_base = (base_from_flange * mount.flange_from_block).inverse();
                let block_from_tool = block_from_base * mount.base_from_tool;
                Rigid::new(block_from_tool.rotation, block_from_tool.translation_mm)
            }
        }
    }

    /// Pose of the flange in the base that brings the tool to a pose in the work frame: the inverse of [`Mount::work_from_tool`].
    ///
    /// Tool: work_from_tool · flange_from_burr⁻¹. Block: base_from_tool · work_from_tool⁻¹ · flange_from_block⁻¹.
    pub fn base_from_flange(&self, work_from_tool: &Rigid<Base, Tool>) -> Rigid<Base, Flange> {
        match self {
            Self::Tool(mount) => *work_from_tool * mount.flange_from_burr.inverse(),
            Self::Block(mount) => {
                let block_from_tool: Rigid<Block, Tool> =
                    Rigid::new(work_from_tool.rotation, work_from_tool.translation_mm);
                mount.base_from_tool * block_from_tool.inverse() * mount.flange_from_block.inverse()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arm::Arm;
    use crate::arm::tests::derivative;
    use crate::ur::{Calibration, UrModel};
    use nalgebra::{Matrix3, Rotation3, Vector3};
    use proptest::prelude::*;

    fn mount() -> BlockMount {
        BlockMount {
            flange_from_block: Rigid::new(
                Rotation3::from_euler_angles(0.3, -0.4, 1.1),
                Vector3::new(5.0, -20.0, 150.0),
            ),
            base_from_tool: Rigid::new(
                Rotation3::from_euler_angles(-2.1, 0.2, 0.7),
                Vector3::new(420.0, 90.0, 210.0),
            ),
        }
    }

    /// A UR5e that holds a block, nominal and calibrated.
    fn arms() -> [Arm; 2] {
        let deltas = "delta_theta: [1e-5, 0.03, -0.04, 0.01, 2e-5, -3e-5]\ndelta_a: [1e-5, -4e-4, 3e-4, 2e-5, -3e-5, 0]\n\
                      delta_d: [1e-4, 0.002, 0.001, -0.003, -1e-5, 2e-5]\ndelta_alpha: [1e-4, -1e-3, 2e-3, 3e-4, -5e-4, 0]\n";
        let calibration = Calibration::parse(deltas).unwrap();
        [None, Some(&calibration)].map(|of| Arm::ur(UrModel::Ur5e, of).unwrap().with_mount(mount()))
    }

    fn any_q() -> impl Strategy<Value = [f64; 6]> {
        prop::array::uniform6(-3.0f64..3.0)
    }

    fn apart(a: &Rigid<Base, Tool>, b: &Rigid<Base, Tool>) -> [f64; 2] {
        let turned: Matrix3<f64> = a.rotation.into_inner() - b.rotation.into_inner();
        [(a.translation_mm - b.translation_mm).amax(), turned.amax()]
    }

    proptest! {
        #[test]
        fn the_tool_in_the_block_is_the_pose_written_by_hand(q in any_q()) {
            for arm in arms() {
                let base_from_flange = arm.forward(&q).unwrap();
                // a point of the tool: into the base, and from there into flange and block
                for point in [Vector3::zeros(), Vector3::new(3.0, -2.0, 40.0)] {
                    let in_base = mount().base_from_tool.rotation * point + mount().base_from_tool.translation_mm;
                    let in_flange =
                        base_from_flange.rotation.transpose() * (in_base - base_from_flange.translation_mm);
                    let turn = mount().flange_from_block.rotation.transpose();
                    let in_block = turn * (in_flange - mount().flange_from_block.translation_mm);
                    let tool = arm.burr(&q).unwrap();
                    prop_assert!((tool.rotation * point + tool.translation_mm - in_block).amax() < 1e-10);
                }
            }
        }

        #[test]
        fn the_tool_s_jacobian_in_the_block_is_the_derivative(q in any_q()) {
            for arm in arms() {
                let jacobian = arm.tool_jacobian_at(&q);
                for j in 0..6 {
                    let [linear, angular] = derivative(|q| arm.tool_at(q), &q, j);
                    prop_assert!((jacobian.fixed_view::<3, 1>(0, j) - linear).amax() < 1e-5, "joint {}", j);
                    prop_assert!((jacobian.fixed_view::<3, 1>(3, j) - angular).amax() < 1e-9, "joint {}", j);
                    prop_assert!(linear.norm() <= arm.lever_mm()[j] + 1e-5, "joint {}", j);
                }
            }
        }

        #[test]
        fn every_branch_brings_the_block_under_the_tool(mut q in any_q()) {
            // the wrist before the arm and bent: away from singular postures, where a branch of the calibrated arm may end
            (q[1], q[2], q[4]) = (-0.8 + 0.1 * q[1], 0.9 + 0.1 * q[2], 1.1f64.copysign(q[4]));
            for arm in arms() {
                let wanted = arm.tool_at(&q);
                let base_from_flange = arm.mount().base_from_flange(&wanted);
                prop_assert!((base_from_flange.translation_mm - arm.forward(&q).unwrap().translation_mm).amax() < 1e-9);
                let found = arm.inverse(&wanted).unwrap();
                prop_assert!(!found.q.is_empty());
                for q in &found.q {
                    let [mm, rad] = apart(&arm.tool_at(q), &wanted);
                    prop_assert!(mm < 1e-7 && rad < 1e-9, "{mm} mm, {rad} rad");
                }
            }
        }
    }
}
