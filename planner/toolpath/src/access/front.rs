//! The flat front of a thick cylinder, covered by small balls.
//!
//! The balls' centres form a lattice, one per cube that fits into a ball. Groups of 3×3×3 balls are tested first by one
//! lookup, which clears most groups, because most of a front is far from everything.

use std::collections::BTreeMap;
use std::ops::Range;

use nalgebra::Vector3;

use super::ShankCylinder;

/// Side of a group, cubes.
const GROUP: i64 = 3;

/// Balls of one size whose union covers a cylinder's front.
#[derive(Debug)]
pub(super) struct Front {
    /// Their centres, two coordinates across the axis and one along it, mm; group by group.
    balls: Vec<Vector3<f64>>,
    groups: Vec<BallGroup>,
    /// Largest distance of a ball's centre from its group's middle, mm.
    reach_mm: f64,
}

#[derive(Debug)]
struct BallGroup {
    middle: Vector3<f64>,
    balls: Range<usize>,
}

impl Front {
    /// Balls of radius `ball_mm` that cover the cylinder's first `length_mm`.
    pub(super) fn new(cylinder: &ShankCylinder, length_mm: f64, ball_mm: f64) -> Self {
        let side = 2.0 * ball_mm / 3f64.sqrt();
        let across = (cylinder.radius_mm / side).ceil() as i64;
        let along = (length_mm / side).ceil() as i64;
        let mut cubes: BTreeMap<[i64; 3], Vec<Vector3<f64>>> = BTreeMap::new();
        for k in 0..along {
            for j in -across..across {
                for i in -across..across {
                    let nearest = |n: i64| if n >= 0 { n as f64 * side } else { (n + 1) as f64 * side };
                    if nearest(i).hypot(nearest(j)) < cylinder.radius_mm {
                        let middle = |n: i64| (n as f64 + 0.5) * side;
                        let center = Vector3::new(middle(i), middle(j), cylinder.from_mm + middle(k));
                        // the groups nearest to the burr come first
                        cubes.entry([k, j, i].map(|n| n.div_euclid(GROUP))).or_default().push(center);
                    }
                }
            }
        }
        let mut front = Self { balls: Vec::new(), groups: Vec::new(), reach_mm: 0.0 };
        for balls in cubes.into_values() {
            let [low, high] = [Vector3::inf, Vector3::sup]
                .map(|pick| balls.iter().skip(1).fold(balls[0], |found, ball| pick(&found, ball)));
            let middle = 0.5 * (low + high);
            front.reach_mm = balls.iter().map(|ball| (ball - middle).norm()).fold(front.reach_mm, f64::max);
            let start = front.balls.len();
            front.balls.extend(balls);
            front.groups.push(BallGroup { middle, balls: start..front.balls.len() });
        }
        front
    }

    /// Largest distance of a group's balls from the place that is tested for all of them, mm, with a margin for rounding.
    pub(super) fn reach_mm(&self) -> f64 {
        self.reach_mm + 1e-6
    }

    /// The first result of `met` at a ball, if there is one. A group is skipped if `is_free` says that no ball within
    /// [`Self::reach_mm`] of the group's middle meets anything.
    pub(super) fn find<R>(
        &self,
        is_free: impl Fn(&Vector3<f64>) -> bool,
        met: impl Fn(&Vector3<f64>) -> Option<R>,
    ) -> Option<R> {
        let doubtful = self.groups.iter().filter(|group| !is_free(&group.middle));
        doubtful.flat_map(|group| &self.balls[group.balls.clone()]).find_map(met)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(bonemill_geometry::fixed!(60))]
        #[test]
        fn its_balls_hold_it_and_groups_hold_their_balls(
            radius_mm in 0.9f64..9.0, from_mm in 0.0f64..40.0, length_mm in 0.1f64..10.0, ball_mm in 0.3f64..2.0,
            places in prop::collection::vec(prop::array::uniform3(0.0f64..1.0), 40),
        ) {
            let cylinder = ShankCylinder { from_mm, to_mm: from_mm + 50.0, radius_mm };
            let front = Front::new(&cylinder, length_mm, ball_mm);
            for [across, turn, along] in places {
                let (across, turn) = (radius_mm * across.sqrt(), std::f64::consts::TAU * turn);
                let place = Vector3::new(across * turn.cos(), across * turn.sin(), from_mm + length_mm * along);
                let is_in = |ball: &&Vector3<f64>| (*ball - place).norm() <= ball_mm * (1.0 + 1e-12);
                prop_assert!(front.balls.iter().any(|ball| is_in(&ball)));
            }
            let found = std::cell::RefCell::new(Vec::new());
            let none = front.find(|_| false, |ball| { found.borrow_mut().push(*ball); None::<()> });
            prop_assert!(none.is_none() && found.into_inner() == front.balls);
            for group in &front.groups {
                for ball in &front.balls[group.balls.clone()] {
                    prop_assert!((ball - group.middle).norm() <= front.reach_mm());
                }
            }
        }
    }

    /// For a single obstacle anywhere, testing by groups finds it whenever testing every ball does.
    #[test]
    fn groups_pass_over_nothing() {
        let cylinder = ShankCylinder { from_mm: 20.0, to_mm: 60.0, radius_mm: 7.0 };
        let front = Front::new(&cylinder, 6.0, 1.1);
        for n in 0..2000u32 {
            let part = |k: u32| f64::from(n * k % 997) / 997.0 - 0.5;
            let thing = Vector3::new(20.0 * part(31), 20.0 * part(89), 23.0 + 14.0 * part(211));
            let is_met = |place: &Vector3<f64>, room_mm: f64| (place - thing).norm() <= room_mm;
            let by_groups = front
                .find(|place| !is_met(place, 0.8 + front.reach_mm()), |ball| is_met(ball, 0.8).then_some(()));
            assert_eq!(by_groups.is_some(), front.balls.iter().any(|ball| is_met(ball, 0.8)));
        }
    }
}
