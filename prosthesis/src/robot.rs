//! The toolpath by a UR arm: with the spindle on the flange and the block on a table that turns it between the sides, or with the block on the flange and
//! the spindle standing still.
//!
//! Assumed, for a spindle on the flange: the cutter's tip is 150 mm before the flange and the cutter along the flange's z; the program's zero lies before
//! the arm and a little above its base, the cutter upright. For a block on the flange: a gripper of 100 mm holds it at the middle of its lower end in z,
//! the block's x, y and z along the flange's; the spindle stands upright before the arm, the cutter at its upper end. Collisions of the arm's links are not
//! looked at.

use crate::machining::trajectory::{MachiningMotion, block_on_flange, spindle_on_flange};
use crate::machining::{Block, MachiningError, TipMove};
use bonemill_arm::arm::{Arm, BlockMount, ToolMount};
use bonemill_arm::ur::UrModel;
use bonemill_case::prosthesis::OnFlange;
use bonemill_geometry::Rigid;
use bonemill_robot::export::write_trajectory_csv;
use nalgebra::{Isometry3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// Rows of trajectory.csv a second; a controller interpolates between them.
const RATE_HZ: f64 = 50.0;
/// From the flange to the cutter's tip with the spindle on the flange, mm. Assumed.
const TIP_MM: f64 = 150.0;
/// Where the program's zero lies with the spindle on the flange, as shares of the arm's reach: before the base, above it. Assumed.
const PLACE: [f64; 2] = [0.55, 0.05];
/// From the flange to the block's lower end in z with the block on the flange, mm: the gripper. Assumed.
const GRIPPER_MM: f64 = 100.0;
/// Where the cutter's tip stands with the block on the flange, as shares of the arm's reach: before the base, above it. Assumed: in the middle of the places
/// from which all three arms make half a turn with the largest default block.
const TIP_PLACE: [f64; 2] = [0.5, 0.25];

/// An arm's motion along a toolpath.
#[derive(Debug)]
pub struct RobotMotion {
    /// The arm.
    pub model: UrModel,
    /// How long it takes, s.
    pub duration_s: f64,
    /// `trajectory.csv`.
    pub csv: Vec<u8>,
    /// Who holds what, and where things stand, in words.
    pub setup: String,
}

/// The moves by an arm; `Err` of the inside tells why it cannot.
pub(crate) fn motion(
    model: UrModel,
    on_flange: OnFlange,
    block: &Block,
    moves: &[TipMove],
) -> Result<Result<RobotMotion, String>, MachiningError> {
    let arm = Arm::ur(model, None)?;
    let found = match on_flange {
        OnFlange::Spindle => {
            spindle_on_flange(&arm.clone().with_mount(spindle()), &base_from_machine(model), moves)?
        }
        OnFlange::Part => block_on_flange(&arm.clone().with_mount(block_mount(model, block)), moves)?,
    };
    match found {
        Ok(motion) => Ok(Ok(RobotMotion {
            model,
            duration_s: motion.law.duration_s(),
            csv: csv(&arm, &motion)?,
            setup: setup(model, on_flange),
        })),
        Err(out) => Ok(Err(format!("the {} cannot follow move {}: {}", model.name(), out.pose, out.reason))),
    }
}

/// The spindle on the flange, upright where the flange points down.
fn spindle() -> ToolMount {
    let flange_from_burr = Rigid::new(
        Rotation3::from_euler_angles(std::f64::consts::PI, 0.0, 0.0),
        Vector3::new(0.0, 0.0, TIP_MM),
    );
    ToolMount { flange_from_burr }
}

/// Where the machine's axes lie with the spindle on the flange.
fn base_from_machine(model: UrModel) -> Isometry3<f64> {
    let [before, above] = PLACE.map(|share| share * model.reach_mm());
    Isometry3::from_parts(Translation3::new(before, 0.0, above), UnitQuaternion::identity())
}

/// The block on the flange, and the spindle upright below the cutter.
fn block_mount(model: UrModel, block: &Block) -> BlockMount {
    let [before, above] = TIP_PLACE.map(|share| share * model.reach_mm());
    let down = Rotation3::from_euler_angles(std::f64::consts::PI, 0.0, 0.0);
    let middle = 0.5 * (block.low_mm + block.high_mm);
    let grip_mm = Vector3::new(middle.x, middle.y, block.low_mm.z);
    BlockMount {
        flange_from_block: Rigid::new(Rotation3::identity(), Vector3::new(0.0, 0.0, GRIPPER_MM) - grip_mm),
        base_from_tool: Rigid::new(down, Vector3::new(before, 0.0, above)),
    }
}

/// Who holds what, and where things stand that trajectory.csv needs.
fn setup(model: UrModel, on_flange: OnFlange) -> String {
    let name = model.name();
    match on_flange {
        OnFlange::Spindle => {
            let [before, above] = PLACE.map(|share| share * model.reach_mm());
            format!(
                "The {name} holds the spindle, the cutter's tip {TIP_MM} mm before the flange along its z. A table turns the block between the sides \
                 about x; the program's zero lies {before:.1} mm before the arm's base along x and {above:.1} mm above it, with the block's x along the \
                 base's."
            )
        }
        OnFlange::Part => {
            let [before, above] = TIP_PLACE.map(|share| share * model.reach_mm());
            format!(
                "The {name} holds the block at the middle of its lower end in z, {GRIPPER_MM} mm before the flange, with the block's x, y and z along \
                 the flange's, and turns it between the sides itself. The spindle stands still and upright with the cutter at its upper end, the tip \
                 {before:.1} mm before the arm's base along x and {above:.1} mm above it."
            )
        }
    }
}

fn csv(arm: &Arm, motion: &MachiningMotion) -> Result<Vec<u8>, MachiningError> {
    let kinds: Vec<_> = arm.joints().iter().map(|joint| joint.kind).collect();
    let mut csv = Vec::new();
    write_trajectory_csv(&mut csv, &motion.law.rows(RATE_HZ)?, &kinds)?;
    Ok(csv)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machining::{Facing, Kind, Side};

    /// The largest block where a job names none, with the part in its upper half.
    fn block() -> Block {
        Block {
            low_mm: Vector3::new(-45.0, -22.5, -65.0),
            high_mm: Vector3::new(45.0, 22.5, 35.0),
            grip_mm: 10.0,
        }
    }

    /// Over the block's corners above its grip and down to its middle, from the front, the back and the front again.
    fn moves() -> Vec<TipMove> {
        let mut moves = Vec::new();
        for a_rad in [0.0, std::f64::consts::PI, 0.0] {
            let safe_mm = 22.5f64.hypot(65.0) + 3.0;
            let mut go = |x: f64, z: f64, w: f64| {
                let mut tip_mm = Facing::of(a_rad).to_block(&Vector3::new(x, 0.0, w));
                tip_mm.z = z;
                moves.push(TipMove {
                    side: Side::A,
                    kind: Kind::Link,
                    tip_mm,
                    a_rad,
                    feed_mm_min: 1500.0,
                    time_s: 0.0,
                });
            };
            go(0.0, 0.0, safe_mm);
            for (x, z) in [(-50.0, -50.0), (-50.0, 40.0), (50.0, 40.0), (50.0, -50.0)] {
                go(x, z, 25.0);
                go(x, z, -5.0);
                go(x, z, 25.0);
            }
            go(50.0, -50.0, safe_mm);
        }
        moves
    }

    #[test]
    fn every_arm_that_holds_the_block_mills_the_largest_one() {
        for model in UrModel::ALL {
            let motion = motion(model, OnFlange::Part, &block(), &moves()).unwrap().unwrap();
            assert!(
                motion.duration_s > 30.0 && motion.csv.starts_with(b"time_s,q1,"),
                "{}",
                motion.duration_s
            );
            assert!(motion.setup.contains("holds the block"), "{}", motion.setup);
        }
    }

    #[test]
    fn a_block_out_of_reach_is_told_with_its_move() {
        let mut long = block();
        long.low_mm.z = -2000.0;
        let said = motion(UrModel::Ur5e, OnFlange::Part, &long, &moves()).unwrap().unwrap_err();
        assert!(said.starts_with("the ur5e cannot follow move 0: out of reach"), "{said}");
    }
}
