//! Where the shaft's axis may go along a path.

use bonemill_toolpath::orientation::directions::angle_between;
use bonemill_toolpath::orientation::sequence::{Forbidden, Problem};
use bonemill_toolpath::orientation::{Directions, TiltFamily, TurnLimits};
use nalgebra::{Unit, Vector3};

use super::arm_axes::ArmAxes;
use super::direction_sets::Finer;
use super::reach::ReachedPath;

/// Axes nearer than this are the same, rad.
const SAME_RAD: f64 = 1e-9;
/// What an axis costs that a waypoint has instead of the one that it keeps, s/mm: more than any cut takes.
const LEAVES_KEPT_S_MM: f64 = 100.0;

/// Where axes may go.
#[derive(Debug, Clone, Copy)]
pub struct FreeAxes<'a> {
    /// The path and its access.
    pub reached: &'a ReachedPath<'a>,
    /// The axis that a waypoint keeps unless it must leave it, where it keeps one.
    pub kept: &'a [Option<Unit<Vector3<f64>>>],
    /// To choose from.
    pub directions: &'a Directions,
    /// A finer cap to choose from near the best of these, with the number in it of each of these.
    pub finer: Option<&'a Finer>,
    /// The plane of an arm with one tilt.
    pub family: Option<&'a TiltFamily>,
    /// How fast axes may turn, and what that costs Dillon's objective.
    pub turns: TurnLimits,
    /// The axes that the arm can take.
    pub arm: &'a ArmAxes,
}

impl FreeAxes<'_> {
    /// Whether waypoint i may have the axis.
    pub fn is_free(&self, i: usize, axis: &Vector3<f64>) -> bool {
        let position = self.reached.path.points[i].position;
        (!self.reached.limited[i] || self.directions.is_within_limit(axis))
            && self.arm.allows(position, axis)
            && self.reached.access.is_free(i as u32, position, axis)
    }

    /// Whether the shank is free all the way while the axis turns during the move that ends at i. Bone that this very move
    /// takes counts as still there.
    pub fn is_turn_free(&self, i: usize, from: &Unit<Vector3<f64>>, to: &Unit<Vector3<f64>>) -> bool {
        self.reached.access.is_turn_free(&self.reached.turn(i, [from, to]))
    }

    /// The choice among the directions of the set.
    pub fn problem<'a>(
        &'a self,
        cost: &'a [f32],
        turns: TurnLimits,
        forbidden: &'a Forbidden,
    ) -> Problem<'a> {
        let (directions, free, length_mm) = (self.directions, &self.reached.free, &self.reached.length_mm);
        Problem { directions, cost, free, length_mm, turns, forbidden }
    }

    /// Whether direction n of the set is free at waypoint i.
    pub fn is_in_set(&self, i: usize, n: usize) -> bool {
        self.reached.free.contains(i, n)
    }

    /// What an axis costs that a waypoint has instead of the one that it keeps, s/mm.
    pub fn leaves_kept(&self, i: usize, axis: &Vector3<f64>) -> f64 {
        let leaves = self.kept[i].is_some_and(|kept| angle_between(&kept, axis) > SAME_RAD);
        if leaves { LEAVES_KEPT_S_MM } else { 0.0 }
    }
}
