//! Which shaft axes the arm can take where, known before axes are chosen.
//!
//! The arm's inverse is evaluated on a coarse lattice of places over all that the burr reaches, for a set of directions each, posture by
//! posture ([`bonemill_robot::resolve::postures`]), since a path is followed in one. Between lattice places an axis counts as
//! one that the arm takes where it takes all places and directions around it: at the edge of what the arm can do up to a
//! step is lost, and nothing is promised that the neighbours do not have. The path itself is followed afterwards; where the
//! arm cannot follow it all the same, that axis is refused there ([`ArmAxes::refuse`]) and axes are chosen anew.
//!
//! An arm that takes nothing at all is not judged here: following the path says by how much it is out of reach.

use bonemill_geometry::{Point, Work};
use bonemill_robot::resolve::postures::{Reached, reached};
use bonemill_toolpath::orientation::Directions;
use bonemill_toolpath::orientation::directions::angle_between;
use bonemill_toolpath::space::BurrSpace;
use nalgebra::{Unit, Vector3};

use bonemill_setup::armpath::Placed;

/// Lattice places are this far apart at most, mm.
const STEP_MM: f64 = 10.0;
/// Directions from which an arm without closed form is tried, at the middle of the lattice.
const SEEDS: usize = 12;
/// Around a place where an axis was refused it and the axes within half a spacing of it are refused as far, mm ..
const REFUSED_MM: f64 = 2.0;
/// .. for the first so many; then both distances double every second time, so that few tries exclude all that is near.
const REFUSED_ALIKE: usize = 8;

/// The axes that an arm can take.
#[derive(Debug, Clone)]
pub struct ArmAxes {
    lattice: ReachLattice,
    set: Directions,
    reached: Reached,
    /// Whether every axis is taken everywhere.
    takes_all: bool,
    refused: Vec<Refused>,
}

/// An axis that the arm cannot take at a place, and how far around both it is refused.
#[derive(Debug, Clone, Copy)]
struct Refused {
    at: Point<Work>,
    axis: Unit<Vector3<f64>>,
    within_mm: f64,
    within_rad: f64,
}

/// Places along the axes of work, number x + counts[0]·(y + counts[1]·z).
#[derive(Debug, Clone, Copy, PartialEq)]
struct ReachLattice {
    first: Point<Work>,
    step_mm: [f64; 3],
    counts: [usize; 3],
}

impl ArmAxes {
    /// Asks the arm for the directions of `set` wherever the burr may have to be.
    pub fn new(placed: Placed<'_>, space: &BurrSpace, set: Directions) -> Self {
        let lattice = ReachLattice::over(space);
        let count = set.len();
        let poses: Vec<_> = (0..lattice.len())
            .flat_map(|place| set.axes().iter().map(move |axis| (place, axis)))
            .map(|(place, axis)| placed.pose(lattice.place(place), axis))
            .collect();
        let neighbours = |pose: usize| {
            let (place, n) = (pose / count, pose % count);
            let beside = set.neighbours(n).map(|m| place * count + m);
            beside.chain(lattice.beside(place).map(|other| other * count + n)).collect()
        };
        let by_tilt: Vec<usize> = set.within(set.nearest(&Vector3::z()), std::f64::consts::PI).collect();
        let every = by_tilt.len().div_ceil(SEEDS).max(1);
        let seeds: Vec<usize> = by_tilt.iter().step_by(every).map(|n| lattice.middle() * count + n).collect();
        let reached =
            reached(placed.arm, &poses, (placed.frame(), placed.posture, placed.room), &seeds, neighbours);
        let taken = reached.count();
        let takes_all = taken == poses.len() || taken == 0;
        Self { lattice, set, reached, takes_all, refused: Vec::new() }
    }

    /// Whether every axis is taken everywhere, as far as is known.
    pub fn allows_all(&self) -> bool {
        self.takes_all && self.refused.is_empty()
    }

    /// Whether the arm can take an axis with the burr at a place.
    pub fn allows(&self, at: Point<Work>, axis: &Vector3<f64>) -> bool {
        if self.allows_all() {
            return true;
        }
        let is_near = |refused: &Refused| {
            refused.at.distance_mm(&at) <= refused.within_mm
                && angle_between(&refused.axis, axis) <= refused.within_rad
        };
        if self.refused.iter().any(is_near) {
            return false;
        }
        let takes = |place: usize| self.around(axis).all(|n| self.reached.takes[place * self.set.len() + n]);
        self.takes_all || self.lattice.corners(at).into_iter().all(takes)
    }

    /// The arm cannot take this axis there after all; gives the distance within which places are concerned, mm.
    pub fn refuse(&mut self, at: Point<Work>, axis: Unit<Vector3<f64>>) -> f64 {
        let doubled = (self.refused.len() + 2).saturating_sub(REFUSED_ALIKE) / 2;
        let wider = 2f64.powi(doubled.min(60) as i32);
        let (within_mm, within_rad) = (wider * REFUSED_MM, wider * 0.5 * self.set.spacing_rad());
        self.refused.push(Refused { at, axis, within_mm, within_rad });
        within_mm
    }

    /// A joint vector near which an arm without closed form can start, for a path that begins there.
    pub fn start(&self, at: Point<Work>, axis: &Vector3<f64>) -> Option<&[f64]> {
        let [place, ..] = self.lattice.corners(at);
        let near = self.set.within(self.set.nearest(axis), std::f64::consts::PI);
        near.map(|n| place * self.set.len() + n).find_map(|pose| self.reached.q(pose))
    }

    /// The directions of the set around an axis: the nearest one, and those next to it on the axis's side.
    fn around(&self, axis: &Vector3<f64>) -> impl Iterator<Item = usize> {
        let nearest = self.set.nearest(axis);
        let middle = self.set.axes()[nearest].into_inner();
        let off = axis - middle;
        let is_beside = move |m: &usize| {
            let way = self.set.axes()[*m].into_inner() - middle;
            // neighbours are about 60° apart: the two within that of the way to the axis
            off.norm() > 1e-6 && off.dot(&way) > 0.49 * off.norm() * way.norm()
        };
        std::iter::once(nearest).chain(self.set.neighbours(nearest).filter(is_beside))
    }
}

impl ReachLattice {
    /// Over all places from which the burr reaches target, up to where it retracts to.
    fn over(space: &BurrSpace) -> Self {
        let grid = space.grid();
        let (mut low, mut high) = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
        for voxel in (0..grid.len()).filter(|n| space.reachable()[*n]) {
            let center = grid.center(grid.voxel(voxel)).coords;
            (low, high) = (low.inf(&center), high.sup(&center));
        }
        let radius_mm = space.radius_mm();
        let top_mm = grid.center(grid.dims().map(|n| n - 1)).z();
        low.z += radius_mm;
        high.z = top_mm - radius_mm;
        let high = high.sup(&(low + Vector3::repeat(1.0)));
        let pieces = (high - low).map(|mm| (mm / STEP_MM).ceil().max(1.0));
        let step = (high - low).component_div(&pieces);
        Self {
            first: Point::from_coords(low),
            step_mm: step.into(),
            counts: [0, 1, 2].map(|a| pieces[a] as usize + 1),
        }
    }

    fn len(&self) -> usize {
        self.counts.iter().product()
    }

    fn number(&self, [i, j, k]: [usize; 3]) -> usize {
        i + self.counts[0] * (j + self.counts[1] * k)
    }

    fn index(&self, place: usize) -> [usize; 3] {
        let [nx, ny, _] = self.counts;
        [place % nx, place / nx % ny, place / (nx * ny)]
    }

    fn place(&self, place: usize) -> Point<Work> {
        let at = self.index(place);
        self.first + Vector3::from([0, 1, 2].map(|a| at[a] as f64 * self.step_mm[a]))
    }

    fn middle(&self) -> usize {
        self.number(self.counts.map(|n| n / 2))
    }

    /// The places next to one.
    fn beside(self, place: usize) -> impl Iterator<Item = usize> {
        let at = self.index(place);
        (0..6).filter_map(move |way| {
            let (axis, mut other) = (way / 2, at);
            other[axis] = if way % 2 == 0 { at[axis].checked_sub(1)? } else { at[axis] + 1 };
            (other[axis] < self.counts[axis]).then(|| self.number(other))
        })
    }

    /// The eight places around a point, the nearest first; beyond the lattice those of its nearest cell.
    fn corners(&self, at: Point<Work>) -> [usize; 8] {
        let share = [0, 1, 2].map(|a| (at - self.first)[a] / self.step_mm[a]);
        let near = [0, 1, 2].map(|a| share[a].round().clamp(0.0, (self.counts[a] - 1) as f64) as usize);
        let far = [0, 1, 2].map(|a| {
            let low = share[a].floor().clamp(0.0, (self.counts[a] - 2) as f64) as usize;
            if near[a] == low { low + 1 } else { low }
        });
        std::array::from_fn(|corner| {
            self.number([0, 1, 2].map(|a| if corner >> a & 1 == 0 { near[a] } else { far[a] }))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_lies_between_its_corners() {
        let lattice =
            ReachLattice { first: Point::new(-5.0, 0.0, 2.0), step_mm: [5.0, 10.0, 4.0], counts: [4, 2, 3] };
        for at in [[-5.0, 0.0, 2.0], [9.9, 9.0, 9.9], [1.0, 4.0, 6.5], [10.0, 10.0, 10.0]] {
            let at = Point::new(at[0], at[1], at[2]);
            let corners = lattice.corners(at).map(|n| lattice.place(n));
            for a in 0..3 {
                let along = corners.map(|c| c.coords[a]);
                let low = along.into_iter().fold(f64::INFINITY, f64::min);
                let high = along.into_iter().fold(f64::NEG_INFINITY, f64::max);
                assert!(
                    low <= at.coords[a] && at.coords[a] <= high && high - low <= lattice.step_mm[a] + 1e-9
                );
            }
            assert!(corners.iter().all(|c| c.distance_mm(&at) >= corners[0].distance_mm(&at) - 1e-9));
        }
        // beyond it, the nearest cell
        let corners = lattice.corners(Point::new(100.0, -50.0, 0.0));
        assert_eq!(corners[0], lattice.number([3, 0, 0]));
        assert_eq!(lattice.beside(lattice.number([0, 0, 1])).count(), 4);
        assert_eq!(lattice.place(lattice.middle()).coords, Vector3::new(5.0, 10.0, 6.0));
    }
}
