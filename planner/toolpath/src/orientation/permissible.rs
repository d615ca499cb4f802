//! The free range around a waypoint's chosen axis: an interval in a plane, or a cap on the sphere.
//!
//! Only the directions of a finite set were tested. So an interval ends at its last free direction, and a cap at the largest
//! circle within which every direction of the set is free. Neither guarantees anything between directions.

use nalgebra::Vector3;

use super::corridor::Corridor;
use super::directions::angle_between;
use super::{Directions, FreeSets};

/// Cosines that differ by less than this belong to the same angle.
const SAME_COSINE: f64 = 1e-12;

/// The free directions of one waypoint, relative to its axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Permissible {
    /// Number of free directions of the set; those of a finer cap are not counted.
    pub free: usize,
    /// Number of connected parts: runs in a plane, or parts of the sphere without neighbouring directions in common.
    pub pieces: usize,
    /// The free range around the axis.
    pub around: OpenAround,
}

/// How far the axis may turn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum OpenAround {
    /// In a plane: the interval around the axis' angle without a blocked direction, rad.
    Interval {
        /// The lowest free angle.
        low_rad: f64,
        /// The axis' own angle.
        at_rad: f64,
        /// The highest free angle.
        high_rad: f64,
    },
    /// On the sphere: every direction of the set within this angle of the axis is free, rad; 0 if the nearest one is not.
    Cap {
        /// Half of the cap's opening angle.
        radius_rad: f64,
    },
}

impl Permissible {
    /// The free range of waypoint i for a shaft in a plane, at the free angle `angle_rad`.
    pub fn in_plane(directions: &Directions, free: &FreeSets, i: usize, angle_rad: f64) -> Self {
        let angles = directions.angles_rad().unwrap_or_default();
        let (pieces, around) = runs(angles, free, i, angle_rad);
        Self { free: free.count(i), pieces, around }
    }

    /// The free range of waypoint i on a cap for a shaft along the free `axis` (unit, work); `fine`: the tested directions of a
    /// finer cap.
    pub fn on_cap(
        directions: &Directions,
        free: &FreeSets,
        i: usize,
        axis: &Vector3<f64>,
        fine: Option<(&Directions, &Corridor)>,
    ) -> Self {
        let on_set = (0..directions.len()).map(|n| (directions.axes()[n], free.contains(i, n)));
        let beside = fine.into_iter().flat_map(|(directions, corridor)| {
            corridor.asked.iter(i).map(move |n| (directions.axes()[n], corridor.free.contains(i, n)))
        });
        // cosines are compared, because all directions are tested; one as far away as the nearest blocked one is not within
        let asked: Vec<_> = on_set.chain(beside).map(|(a, is_free)| (a.dot(axis), a, is_free)).collect();
        let blocked = asked.iter().filter(|(.., is_free)| !is_free).map(|(cosine, ..)| *cosine);
        let least = blocked.fold(-2.0, f64::max) + SAME_COSINE;
        let farthest = asked.iter().filter(|(cosine, ..)| *cosine > least).min_by(|a, b| a.0.total_cmp(&b.0));
        let radius_rad = farthest.map_or(0.0, |(_, a, _)| angle_between(axis, a));
        Self {
            free: free.count(i),
            pieces: parts(directions, free, i),
            around: OpenAround::Cap { radius_rad },
        }
    }
}

/// Number of runs of free angles, and the run that contains `at_rad`.
fn runs(angles_rad: &[f64], free: &FreeSets, i: usize, at_rad: f64) -> (usize, OpenAround) {
    // an axis that was moved off the set is free too: it is at most half a spacing beyond a run, and beside no other run
    let (mut best, mut least) = ((at_rad, at_rad), f64::INFINITY);
    let numbers: Vec<usize> = free.iter(i).collect();
    let mut pieces = 0;
    for run in numbers.chunk_by(|a, b| a + 1 == *b) {
        let (low, high) = (angles_rad[run[0]], angles_rad[run[run.len() - 1]]);
        let off = (low - at_rad).max(at_rad - high).max(0.0);
        if off < least {
            (best, least) = ((low.min(at_rad), high.max(at_rad)), off);
        }
        pieces += 1;
    }
    (pieces, OpenAround::Interval { low_rad: best.0, at_rad, high_rad: best.1 })
}

/// Number of parts that are connected by neighbours.
fn parts(directions: &Directions, free: &FreeSets, i: usize) -> usize {
    let mut seen = vec![false; directions.len()];
    let (mut stack, mut parts) = (Vec::new(), 0);
    for first in free.iter(i) {
        if std::mem::replace(&mut seen[first], true) {
            continue;
        }
        parts += 1;
        stack.push(first);
        while let Some(n) = stack.pop() {
            for m in directions.neighbours(n).filter(|m| free.contains(i, *m)) {
                if !std::mem::replace(&mut seen[m], true) {
                    stack.push(m);
                }
            }
        }
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::orientation::TiltFamily;

    fn plane() -> Directions {
        let family =
            TiltFamily { hinge: Vector3::x_axis(), zero: Vector3::z_axis(), lower_rad: -1.0, upper_rad: 1.0 };
        Directions::in_plane(&family, 0.1, 1.0)
    }

    #[test]
    fn an_interval_is_the_run_that_holds_the_axis() {
        let set = plane();
        let angles = set.angles_rad().unwrap().to_vec();
        let last = angles.len() - 1;
        let free = FreeSets::fill(1, set.len(), |_, n| n <= 4 || (9..=12).contains(&n) || n == last);
        let at = |angle| Permissible::in_plane(&set, &free, 0, angle);
        let interval = |low_rad, at_rad, high_rad| OpenAround::Interval { low_rad, at_rad, high_rad };
        assert_eq!((at(angles[10]).free, at(angles[10]).pieces), (10, 3));
        assert_eq!(at(angles[10]).around, interval(angles[9], angles[10], angles[12]));
        assert_eq!(at(angles[0]).around, interval(angles[0], angles[0], angles[4]));
        assert_eq!(at(angles[last]).around, interval(angles[last], angles[last], angles[last]));
        // an axis refined beyond the run's end, where it was found free
        let beyond = angles[12] + 0.04;
        assert_eq!(at(beyond).around, interval(angles[9], beyond, beyond));
    }

    #[test]
    fn a_cap_reaches_to_the_nearest_blocked_direction() {
        let set = Directions::cap(0.1, 0.5);
        let axis = set.axes()[3];
        let angle = |n: usize| angle_between(&axis, &set.axes()[n]);
        let radius_of = |p: Permissible| match p.around {
            OpenAround::Cap { radius_rad } => radius_rad,
            other => panic!("{other:?}"),
        };
        for hole in [10, 40, 70] {
            let free = FreeSets::fill(1, set.len(), |_, n| n != hole);
            let found = Permissible::on_cap(&set, &free, 0, &axis, None);
            let radius_rad = radius_of(found);
            assert_eq!((found.free, found.pieces), (set.len() - 1, 1));
            assert!(radius_rad < angle(hole) && radius_rad > angle(hole) - 1.1 * set.spacing_rad());
            // up to rounding as far away as the hole
            let is_beyond = |n: usize| angle(n) >= angle(hole) - 1e-9;
            assert!((0..set.len()).all(|n| angle(n) <= radius_rad + 1e-9 || is_beyond(n)));
            assert!(!is_beyond((0..set.len()).find(|n| angle(*n) == radius_rad).unwrap()));
        }
        let all = FreeSets::fill(1, set.len(), |_, _| true);
        let farthest = (0..set.len()).map(angle).fold(0.0, f64::max);
        assert_eq!(radius_of(Permissible::on_cap(&set, &all, 0, &axis, None)), farthest);
        // a hexagon about the middle and one direction far away
        let [middle, far] = [0, set.len() - 1];
        let free = FreeSets::fill(1, set.len(), |_, n| n <= 6 || n == far);
        let found = Permissible::on_cap(&set, &free, 0, &set.axes()[middle], None);
        assert_eq!((found.free, found.pieces), (8, 2));
        assert!((radius_of(found) - set.spacing_rad()).abs() < 1e-9);
    }
}
