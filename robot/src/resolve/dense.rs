//! Joint positions so close together that an arm, moving straight in joint space between them, follows the path in space.
//!
//! Between two waypoints the burr moves along a line while the axis turns along a great circle. A straight motion in joint
//! space deviates from both; a move is halved until the deviation is below `BOW_MM` and `BOW_RAD`. Where the axis turns
//! fast compared with the burr's motion, even a negligible shift of the burr along its line changes the axis that belongs
//! to its place; there places are so close that their axes differ by at most `FAST_STEP_RAD`.
//!
//! Invariants: every place is exactly on the path; every waypoint is a place; the burr's length of the move to a place is
//! the greatest |J q'| on it, not its chord, so that a speed cap holds at every instant of the move.

use bonemill_arm::arm::inverse::angle_between;
use bonemill_arm::arm::{Arm, AxisPose};
use nalgebra::Vector3;

use super::{Follower, OutOfReach, PosePath, ReachReason, Resolved};

/// Largest distance between the burr and its line at the middle of a move, mm.
const BOW_MM: f64 = 0.002;
/// Largest angle between the axis and the planned axis at the middle of a move, rad.
const BOW_RAD: f64 = 5e-4;
/// Places are laid closer where the axis turns by more than this within [`SHIFT_MM`], rad.
const FAST_STEP_RAD: f64 = 2.5e-3;
/// A shift along the line that is negligible, mm: about the corner tolerance.
const SHIFT_MM: f64 = 0.02;
/// Number of halvings after which a move counts as a jump.
const HALVINGS: u32 = 14;

/// A joint path with places between waypoints.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct DensePath {
    /// Joint positions, mm or rad, shape (places × dof).
    pub q: Vec<f64>,
    /// For the move to each place, the burr's path length if it moved at its greatest speed throughout, mm; 0 for the first.
    pub burr_mm: Vec<f64>,
    /// Burr's centre and axis at each place, in the work frame, shape (places).
    pub pose: Vec<[f64; 6]>,
    /// The place of each waypoint.
    pub waypoints: Vec<usize>,
}

impl DensePath {
    /// Lays places along a path with resolved joint vectors.
    ///
    /// # Errors
    /// [`OutOfReach`] where the arm cannot follow between two waypoints.
    pub fn lay(arm: &Arm, path: &PosePath<'_>, resolved: &Resolved) -> Result<Self, OutOfReach> {
        let dof = arm.dof();
        let follower = Follower { arm, frame: path.frame, branch: resolved.branch };
        let mut dense = Self::default();
        for (i, pose) in path.poses.iter().enumerate() {
            let q = &resolved.q[i * dof..(i + 1) * dof];
            if i > 0 {
                let before = i - 1;
                let segment = Segment {
                    follower: &follower,
                    from: &path.poses[before],
                    to: pose,
                    roll: [resolved.roll_rad[before], resolved.roll_rad[i]],
                };
                let from = resolved.q[before * dof..i * dof].to_vec();
                segment
                    .lay([0.0, 1.0], &from, q, HALVINGS, &mut dense)
                    .map_err(|reason| OutOfReach { pose: i, reason })?;
            }
            dense.push(arm, pose, q);
            dense.waypoints.push(dense.burr_mm.len() - 1);
        }
        Ok(dense)
    }

    /// Number of places.
    pub fn len(&self) -> usize {
        self.burr_mm.len()
    }

    /// Whether there is no place.
    pub fn is_empty(&self) -> bool {
        self.burr_mm.is_empty()
    }

    /// Expands values per waypoint's move to values per place's move.
    pub fn per_place(&self, per_waypoint: &[f64]) -> Vec<f64> {
        let mut values = Vec::with_capacity(self.len());
        for (place, value) in self.waypoints.iter().zip(per_waypoint) {
            values.resize(place + 1, *value);
        }
        values
    }

    /// The greatest of the values per place's move within each waypoint's move.
    pub fn greatest_per_waypoint(&self, per_place: &[f64]) -> Vec<f64> {
        let mut first = 0;
        let of_move = |place: &usize| {
            let moves = per_place.get(first..=*place).unwrap_or_default();
            first = place + 1;
            moves.iter().copied().fold(0.0, f64::max)
        };
        self.waypoints.iter().map(of_move).collect()
    }

    fn push(&mut self, arm: &Arm, pose: &AxisPose, q: &[f64]) {
        let burr_mm = match self.len() {
            0 => 0.0,
            places => fastest_mm(arm, &self.q[(places - 1) * q.len()..], q),
        };
        self.burr_mm.push(burr_mm);
        self.q.extend_from_slice(q);
        let (p, a) = (pose.position.coords, pose.axis);
        self.pose.push([p.x, p.y, p.z, a.x, a.y, a.z]);
    }
}

/// The greatest |J Δq| from one joint vector to another: the burr's greatest speed times the move's duration.
///
/// |J(q) Δq|² is smooth along the move. The parabola through its values at both ends and at the middle gives its greatest
/// value to third order, which suffices because moves are short.
fn fastest_mm(arm: &Arm, from: &[f64], to: &[f64]) -> f64 {
    let step: Vec<f64> = from.iter().zip(to).map(|(a, b)| b - a).collect();
    let speed = |share: f64| {
        let q: Vec<f64> = from.iter().zip(&step).map(|(a, d)| a + share * d).collect();
        let jacobian = arm.tool_jacobian_at(&q);
        let columns = jacobian.column_iter().zip(&step);
        columns.map(|(column, d)| column.fixed_rows::<3>(0) * *d).sum::<Vector3<f64>>().norm()
    };
    let [a, b, c] = [0.0, 0.5, 1.0].map(speed);
    let bend = (a - 2.0 * b + c).abs();
    a.max(b).max(c) + 0.25 * bend
}

/// A move between two waypoints.
struct Segment<'a> {
    follower: &'a Follower<'a>,
    from: &'a AxisPose,
    to: &'a AxisPose,
    roll: [f64; 2],
}

impl Segment<'_> {
    /// Lays places strictly between two points of the move, given as shares of it.
    #[expect(clippy::too_many_arguments, reason = "a recursion over both ends of a part of the move")]
    fn lay(
        &self,
        shares: [f64; 2],
        from: &[f64],
        to: &[f64],
        halvings: u32,
        dense: &mut DensePath,
    ) -> Result<(), ReachReason> {
        let share = 0.5 * (shares[0] + shares[1]);
        let pose = self.from.between(self.to, share);
        let mut q: Vec<f64> = from.iter().zip(to).map(|(a, b)| 0.5 * (a + b)).collect();
        let driven = self.follower.arm.tool_at(&q);
        let off_mm = (driven.translation_mm - pose.position.coords).norm();
        let (off_rad, _) = angle_between(&(driven.rotation * Vector3::z()), &pose.axis);
        if off_mm <= BOW_MM && off_rad <= BOW_RAD && self.turns_slowly(shares[1] - shares[0]) {
            return Ok(());
        }
        if halvings == 0 {
            return Err(ReachReason::Jump);
        }
        self.follower.step(&pose, self.roll[0] + share * (self.roll[1] - self.roll[0]), &mut q)?;
        self.lay([shares[0], share], from, &q, halvings - 1, dense)?;
        dense.push(self.follower.arm, &pose, &q);
        self.lay([share, shares[1]], &q, to, halvings - 1, dense)
    }

    /// Whether a part of the move turns the axis little, in total or compared with the distance moved.
    fn turns_slowly(&self, part: f64) -> bool {
        let (turn_rad, _) = angle_between(&self.from.axis, &self.to.axis);
        let length_mm = self.from.position.distance_mm(&self.to.position);
        turn_rad * part <= FAST_STEP_RAD || turn_rad * SHIFT_MM <= FAST_STEP_RAD * length_mm
    }
}
