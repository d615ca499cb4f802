//! The same moves by an arm: joint positions and their time law for a spindle on the flange.
//!
//! The block sits on a table that turns it about x between the sides, as on the machine; the arm holds the spindle and stands still meanwhile. So the arm
//! follows one path in the machine's axes, the cutter always along their Z. The spin about the cutter's axis is free and is chosen over the whole path
//! ([`bonemill_motion::resolve`]); joints keep velocity, acceleration and jerk limits at every instant ([`bonemill_motion::timelaw`]).
//!
//! Not here: the part on the flange, collisions of the arm's links.

use bonemill_arm::arm::{Arm, AxisPose};
use bonemill_geometry::{Base, Point};
use bonemill_motion::resolve::dense::DensePath;
use bonemill_motion::resolve::{OutOfReach, PosePath, Posture, RollFrame, resolve};
use bonemill_motion::timelaw::{CornerTolerance, JointPath, PathLimits, PreparedPath, TimeLaw};
use nalgebra::{Isometry3, Unit, Vector3};

use crate::MachiningError;
use crate::moves::{Facing, Move};
use crate::time::CORNER_MM;

/// Longest move that is resolved as one, mm: rapid moves are far longer than the arm is straight.
const LONGEST_MM: f64 = 5.0;

/// How an arm drives the moves.
#[derive(Debug, Clone)]
pub struct ArmMotion {
    /// Joint positions over time.
    pub law: TimeLaw,
    /// The arm's branch.
    pub branch: u8,
}

/// Joint motion along the moves; `base_from_machine` places the machine's axes (mm) in the arm's base.
///
/// The arm's tool has its origin at the cutter's tip and z along the cutter to the spindle. Out of reach is a result: the number of the move and by how much.
///
/// # Errors
/// [`MachiningError::Motion`] where the arm's limits or the path are no numbers that it takes.
pub fn by_arm(
    arm: &Arm,
    base_from_machine: &Isometry3<f64>,
    moves: &[Move],
) -> Result<Result<ArmMotion, OutOfReach>, MachiningError> {
    let axis = Unit::new_normalize(base_from_machine.rotation * Vector3::z());
    let way = Way::of(base_from_machine, axis, moves);
    let path = PosePath {
        poses: &way.poses,
        length_mm: &way.length_mm,
        frame: RollFrame::about(&axis),
        stiffness: None,
        posture: Posture::Any,
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
    Ok(Ok(ArmMotion { law, branch: resolved.branch }))
}

/// The tip's way in the arm's base.
#[derive(Default)]
struct Way {
    poses: Vec<AxisPose>,
    length_mm: Vec<f64>,
    cap_mm_s: Vec<f64>,
    /// The move that each pose belongs to.
    move_of: Vec<usize>,
    /// Poses at which the block is turned.
    stops: Vec<usize>,
}

impl Way {
    fn of(base_from_machine: &Isometry3<f64>, axis: Unit<Vector3<f64>>, moves: &[Move]) -> Self {
        let mut way = Self::default();
        let mut before: Option<(Vector3<f64>, f64)> = None;
        for (n, step) in moves.iter().enumerate() {
            let to = Facing::of(step.a_rad).from_block(&step.tip_mm);
            let (from, a_rad) = before.unwrap_or((to, step.a_rad));
            let length = (to - from).norm();
            let pieces = (length / LONGEST_MM).ceil().max(1.0) as usize;
            if a_rad != step.a_rad {
                way.stops.push(way.poses.len().saturating_sub(1));
            }
            for piece in 1..=pieces {
                let at = base_from_machine.rotation * (from + (to - from) * (piece as f64 / pieces as f64))
                    + base_from_machine.translation.vector;
                way.poses.push(AxisPose { position: Point::<Base>::from_coords(at), axis });
                way.length_mm.push(length / pieces as f64);
                way.cap_mm_s.push(step.feed_mm_min / 60.0);
                way.move_of.push(n);
            }
            before = Some((to, step.a_rad));
        }
        way
    }
}
