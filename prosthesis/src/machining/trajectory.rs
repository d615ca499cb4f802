//! The same moves by an arm: joint positions and their time law, with the spindle on the flange or with the block on it.
//!
//! - Spindle on the flange: the block sits on a table that turns it about x between the sides, as on the machine; the arm stands still meanwhile. The path
//!   is one in the machine's axes, the cutter always along their Z.
//! - Block on the flange: the spindle stands still, and the arm turns the block. The path is the tip's in the block. Between the sides the tip goes around
//!   the block about x, past its upper end in z, so that the grip and the flange turn away from the spindle.
//!
//! The spin about the cutter's axis is free and is chosen over the whole path ([`bonemill_robot::resolve`]); joints keep velocity, acceleration and jerk
//! limits at every instant ([`bonemill_robot::timelaw`]), and the tip's speed against the block is at most the move's.
//!
//! Not here: collisions of the arm's links.

use bonemill_arm::arm::{Arm, AxisPose};
use bonemill_geometry::{Base, Point};
use bonemill_robot::resolve::dense::DensePath;
use bonemill_robot::resolve::{OutOfReach, PosePath, Posture, RollFrame, resolve};
use bonemill_robot::timelaw::{CornerTolerance, JointPath, PathLimits, PreparedPath, TimeLaw};
use nalgebra::{Isometry3, Rotation3, Unit, Vector3};

use crate::machining::MachiningError;
use crate::machining::moves::{Facing, TipMove};
use crate::machining::time::CORNER_MM;

/// Longest move that is resolved as one, mm: rapid moves are far longer than the arm is straight.
const LONGEST_MM: f64 = 5.0;
/// Most that the block is turned between two poses, rad: the chord of the tip's arc is then less than 0.05 mm below it, at a safe height.
const TURN_RAD: f64 = 0.05;

/// How an arm drives the moves.
#[derive(Debug, Clone)]
pub struct MachiningMotion {
    /// Joint positions over time.
    pub law: TimeLaw,
    /// The arm's branch.
    pub branch: u8,
}

/// Joint motion along the moves with the spindle on the flange; `base_from_machine` places the machine's axes (mm) in the arm's base.
///
/// The arm's mount is a tool that has its origin at the cutter's tip and z along the cutter to the spindle. Out of reach is a result: the number of the move
/// and by how much.
///
/// # Errors
/// [`MachiningError::Motion`] where the arm's limits or the path are no numbers that it takes.
pub fn spindle_on_flange(
    arm: &Arm,
    base_from_machine: &Isometry3<f64>,
    moves: &[TipMove],
) -> Result<Result<MachiningMotion, OutOfReach>, MachiningError> {
    let axis = Unit::new_normalize(base_from_machine.rotation * Vector3::z());
    motion(arm, &Way::in_base(base_from_machine, axis, moves), RollFrame::about(&axis))
}

/// Joint motion along the moves with the block on the flange.
///
/// The arm's mount is a block (the moves' frame) and a spindle that has its origin at the cutter's tip and z along the cutter to the spindle. Out of reach
/// is a result: the number of the move and by how much.
///
/// # Errors
/// As [`spindle_on_flange`].
pub fn block_on_flange(
    arm: &Arm,
    moves: &[TipMove],
) -> Result<Result<MachiningMotion, OutOfReach>, MachiningError> {
    // across all directions of the cutter's axis, which turns about x
    motion(arm, &Way::in_block(moves), RollFrame::about(&Vector3::x_axis()))
}

fn motion(
    arm: &Arm,
    way: &Way,
    frame: RollFrame,
) -> Result<Result<MachiningMotion, OutOfReach>, MachiningError> {
    let path = PosePath {
        poses: &way.poses,
        length_mm: &way.length_mm,
        frame,
        stiffness: None,
        posture: Posture::Any,
        room: None,
    };
    let in_moves =
        |out: OutOfReach| OutOfReach { pose: way.move_of.get(out.pose).copied().unwrap_or(0), ..out };
    let resolved = match resolve(arm, &path)? {
        Ok(resolved) => resolved,
        Err(out) => return Ok(Err(in_moves(out))),
    };
    let dense = match DensePath::lay(arm, &path, &resolved) {
        Ok(dense) => dense,
        Err(out) => return Ok(Err(in_moves(out))),
    };
    let limits = PathLimits::of_arm(arm, CornerTolerance { burr_mm: CORNER_MM, axis_rad: 1e-3 })?;
    let stops: Vec<usize> = way.stops.iter().filter_map(|n| dense.waypoints.get(*n).copied()).collect();
    let joint_path = JointPath { q: &dense.q, burr_mm: &dense.burr_mm, pose: &dense.pose, stops: &stops };
    let law = PreparedPath::new(&joint_path, &limits)?.law(&dense.per_place(&way.cap_mm_s))?;
    Ok(Ok(MachiningMotion { law, branch: resolved.branch }))
}

/// The tip's way in the arm's work frame.
#[derive(Default)]
struct Way {
    poses: Vec<AxisPose>,
    length_mm: Vec<f64>,
    cap_mm_s: Vec<f64>,
    /// The move that each pose belongs to.
    move_of: Vec<usize>,
    /// Poses at which the arm stands still while a table turns the block.
    stops: Vec<usize>,
}

impl Way {
    /// With the spindle on the flange: in the arm's base.
    fn in_base(base_from_machine: &Isometry3<f64>, axis: Unit<Vector3<f64>>, moves: &[TipMove]) -> Self {
        let mut way = Self::default();
        let mut before: Option<(Vector3<f64>, f64)> = None;
        for (n, step) in moves.iter().enumerate() {
            let to = Facing::of(step.a_rad).from_block(&step.tip_mm);
            let (from, a_rad) = before.unwrap_or((to, step.a_rad));
            if a_rad != step.a_rad {
                way.stops.push(way.poses.len().saturating_sub(1));
            }
            way.straight(n, step, [from, to], |tip| {
                let at = base_from_machine.rotation * tip + base_from_machine.translation.vector;
                AxisPose { position: Point::<Base>::from_coords(at), axis }
            });
            before = Some((to, step.a_rad));
        }
        way
    }

    /// With the block on the flange: in the block.
    fn in_block(moves: &[TipMove]) -> Self {
        let mut way = Self::default();
        let mut before: Option<&TipMove> = None;
        for (n, step) in moves.iter().enumerate() {
            let mut from = before.map_or(step.tip_mm, |before| before.tip_mm);
            if let Some(before) = before.filter(|before| before.a_rad != step.a_rad) {
                from = way.turn(n, step, before);
            }
            let axis = Unit::new_normalize(Facing::of(step.a_rad).to_block(&Vector3::z()));
            way.straight(n, step, [from, step.tip_mm], |tip| AxisPose {
                position: Point::from_coords(tip),
                axis,
            });
            before = Some(step);
        }
        way
    }

    /// A straight move in pieces.
    fn straight(
        &mut self,
        n: usize,
        step: &TipMove,
        [from, to]: [Vector3<f64>; 2],
        pose: impl Fn(Vector3<f64>) -> AxisPose,
    ) {
        let length = (to - from).norm();
        let pieces = (length / LONGEST_MM).ceil().max(1.0) as usize;
        for piece in 1..=pieces {
            let at = pose(from + (to - from) * (piece as f64 / pieces as f64));
            self.push(n, step, length / pieces as f64, at);
        }
    }

    /// Turns the block under the tip of the move before, about x: from A = 0 to π the cutter's axis goes from +y over +z to −y, and back the same way.
    /// Returns the tip's place in the block after that.
    fn turn(&mut self, n: usize, step: &TipMove, before: &TipMove) -> Vector3<f64> {
        let (from, axis) = (before.tip_mm, Facing::of(before.a_rad).to_block(&Vector3::z()));
        let angle_rad = step.a_rad - before.a_rad;
        let pieces = (angle_rad.abs() / TURN_RAD).ceil() as usize;
        let arc_mm = from.yz().norm() * angle_rad.abs() / pieces as f64;
        let about_x = |share: f64| Rotation3::from_axis_angle(&Vector3::x_axis(), angle_rad * share);
        for piece in 1..=pieces {
            let turned = about_x(piece as f64 / pieces as f64);
            let pose = AxisPose {
                position: Point::from_coords(turned * from),
                axis: Unit::new_normalize(turned * axis),
            };
            self.push(n, step, arc_mm, pose);
        }
        about_x(1.0) * from
    }

    fn push(&mut self, n: usize, step: &TipMove, length_mm: f64, pose: AxisPose) {
        self.poses.push(pose);
        self.length_mm.push(length_mm);
        self.cap_mm_s.push(step.feed_mm_min / 60.0);
        self.move_of.push(n);
    }
}
