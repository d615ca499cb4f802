//! Divides a path into straight runs: consecutive moves on one line, which together sweep one capsule.
//!
//! The first move of a run that covers a point has a closed form: it is the first whose end is at least as far along the
//! line as the point, less half the ball's chord there. So a run is swept once, not move by move.

use std::ops::{ControlFlow, Range};

use crate::cutter::Ball;
use bonemill_geometry::{Point, Work};
use nalgebra::Vector3;

use crate::stock::sweep::Rows;
use crate::stock::voxels::VoxelSet;
use bonemill_geometry::capsule::segment_distance_squared;

/// Consecutive moves that deviate less than this from a straight line are one run, mm.
const STRAIGHT_MM: f64 = 1e-6;

/// Points nearer than this to a ball's surface or to the end of a move are tested against each move. The margin is larger
/// than rounding and than the deviation of a run from its line.
const CERTAIN_MM2: f64 = 1e-2;
const CERTAIN_MM: f64 = 1e-4;

/// A straight part of a path: moves `first..=last`. Move i leads from position i − 1 to position i; move 0 stays at
/// position 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Run {
    /// Its first move.
    pub first: u32,
    /// Its last move.
    pub last: u32,
}

impl Run {
    /// Where it starts.
    pub fn start(&self) -> u32 {
        self.first.saturating_sub(1)
    }
}

/// Maximal straight runs of the moves of a path whose positions are `at`; move 0 is a separate run.
pub fn straight_runs(moves: Range<u32>, at: impl Fn(u32) -> Point<Work>) -> Vec<Run> {
    let mut runs: Vec<Run> = Vec::new();
    let at = |n: u32| at(n).coords;
    for n in moves {
        let extends = runs.last().is_some_and(|run| {
            run.first > 0 && {
                let (a, b, c) = (at(run.first - 1), at(run.last), at(n));
                // forward along the line, not back
                (b - a).dot(&(c - b)) >= 0.0
                    && segment_distance_squared(&b, &a, &c) <= STRAIGHT_MM * STRAIGHT_MM
            }
        });
        match runs.last_mut() {
            Some(run) if extends => run.last = n,
            _ => runs.push(Run { first: n, last: n }),
        }
    }
    runs
}

/// Removes from `standing` the voxels that a ball of `radius_mm` covers along `runs`, and calls `taken` with each voxel and
/// the first move that covers it. The voxels that the ball covers at the start of the runs must be removed already, except
/// at a path's first position.
#[expect(
    clippy::too_many_arguments,
    reason = "several sweeps share runs and positions, each with a ball and voxels of its own"
)]
pub fn take_runs(
    runs: &[Run],
    at: impl Fn(u32) -> Point<Work>,
    rows: &Rows,
    Ball { radius_mm }: Ball,
    standing: &mut VoxelSet,
    mut taken: impl FnMut(usize, u32),
) {
    for run in runs {
        let (a, b) = (at(run.start()), at(run.last));
        let may = VoxelSet::may_hold;
        if run.first == run.last {
            let _ = rows.within_capsule_where(a, b, radius_mm, standing, may, |standing, row| {
                standing.take(row, |voxel| taken(voxel, run.first));
                ControlFlow::Continue(())
            });
            continue;
        }
        let mut places = None;
        let wide_mm = radius_mm + 2.0 * STRAIGHT_MM;
        let _ = rows.within_capsule_where(a, b, wide_mm, standing, may, |standing, row| {
            let places = places.get_or_insert_with(|| Places::new(run, &at, radius_mm));
            let center = rows.centers_in_row(row.start);
            standing.take_where(row, |voxel| {
                let is_in = |[a, b]: [Point<Work>; 2]| rows.is_within(voxel, a, b, radius_mm);
                let first = places.first_that_covers(&center(voxel), is_in);
                first.inspect(|index| taken(voxel, *index)).is_some()
            });
            ControlFlow::Continue(())
        });
    }
}

/// Where the moves of a run start and end.
struct Places {
    first: u32,
    /// Start and end positions; one more than there are moves.
    at: Vec<Point<Work>>,
    along: Vector3<f64>,
    /// Position of each move's end along the line.
    ends_mm: Vec<f64>,
    squared_mm2: f64,
}

impl Places {
    fn new(run: &Run, at: impl Fn(u32) -> Point<Work>, radius_mm: f64) -> Self {
        let at: Vec<_> = (run.start()..=run.last).map(at).collect();
        let along = (at[at.len() - 1] - at[0]).try_normalize(0.0).unwrap_or_else(Vector3::zeros);
        let ends_mm = at[1..].iter().map(|p| (*p - at[0]).dot(&along)).collect();
        Self { first: run.first, at, along, ends_mm, squared_mm2: radius_mm * radius_mm }
    }

    /// The first move that covers `p`; `is_in` tests a single move where the closed form leaves a doubt.
    #[inline]
    fn first_that_covers(&self, p: &Vector3<f64>, is_in: impl Fn([Point<Work>; 2]) -> bool) -> Option<u32> {
        let from = p - self.at[0].coords;
        let along = from.dot(&self.along);
        let left_mm2 = self.squared_mm2 - (from.norm_squared() - along * along);
        let half_chord = left_mm2.max(0.0).sqrt();
        let front = along - half_chord;
        let n = self.ends_mm.partition_point(|end| *end < front);
        let before = n.checked_sub(1).map_or(-2.0 * half_chord, |n| self.ends_mm[n]);
        let is_certain = left_mm2 > CERTAIN_MM2
            && front - before > CERTAIN_MM
            && self.ends_mm.get(n).is_some_and(|end| end - front > CERTAIN_MM);
        if is_certain {
            return Some(self.first + n as u32);
        }
        let near = n.saturating_sub(1)..(n + 2).min(self.ends_mm.len());
        near.into_iter().find(|n| is_in([self.at[*n], self.at[n + 1]])).map(|n| self.first + n as u32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bonemill_geometry::Grid;
    use proptest::prelude::*;

    proptest! {
        /// The runs are compared with sweeping every move alone, in turn.
        #[test]
        fn runs_take_what_their_moves_take_one_by_one(
            corners in prop::collection::vec(prop::array::uniform3(0.0f64..6.0), 1..6),
            pieces in prop::collection::vec(1usize..9, 6), radius in 0.3f64..1.6,
        ) {
            let grid = Grid::<Work>::aligned([25, 24, 23], 0.25, Point::new(0.0, 0.0, 0.0)).unwrap();
            let rows = Rows::of(&grid);
            let mut path = vec![Point::from_coords(corners[0].into())];
            for (corner, pieces) in corners[1..].iter().zip(pieces) {
                let (from, to) = (path[path.len() - 1], Point::from_coords((*corner).into()));
                // steps of different lengths, one of length 0
                path.extend((0..=pieces).map(|n| from + (to - from) * (n as f64 / pieces as f64).powi(2)));
            }
            let at = |n: u32| path[n as usize];
            let runs = straight_runs(0..path.len() as u32, at);
            prop_assert!(runs.len() <= 2 * corners.len());
            let mut found = vec![None; grid.len()];
            let mut standing = VoxelSet::of(grid.len(), |_| true);
            take_runs(&runs, at, &rows, Ball { radius_mm: radius }, &mut standing, |voxel, index| found[voxel] = Some(index));
            for (voxel, found) in found.into_iter().enumerate() {
                let p = grid.center(grid.voxel(voxel)).coords;
                let beyond = |n: usize| {
                    segment_distance_squared(&p, &path[n.saturating_sub(1)].coords, &path[n].coords).sqrt() - radius
                };
                let expected = (0..path.len()).find(|n| beyond(*n) <= 0.0).map(|n| n as u32);
                let doubt = (0..path.len()).any(|n| beyond(n).abs() < 1e-5);
                prop_assert!(found == expected || doubt, "{voxel}: {found:?}, not {expected:?}");
                prop_assert_eq!(standing.contains(voxel), found.is_none());
            }
        }
    }

    /// For voxels exactly on a ball's surface rounding decides; a run must decide as each move alone does.
    #[test]
    fn ties_are_decided_as_by_the_moves_one_by_one() {
        for spacing_mm in [0.2, 0.25, 0.3] {
            let (nodes, radius_mm) = ([37, 35, 34], 10.0 * spacing_mm);
            let grid = Grid::<Work>::aligned(nodes, spacing_mm, Point::new(0.0, 0.0, 0.0)).unwrap();
            let rows = Rows::of(&grid);
            for step in [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [0, 1, 1]] {
                let path: Vec<_> = (0..8).map(|n| grid.center(step.map(|s| 12 + n * s))).collect();
                let at = |n: u32| path[n as usize];
                let sweep = |runs: &[Run]| {
                    let (mut found, mut standing) =
                        (vec![None; grid.len()], VoxelSet::of(grid.len(), |_| true));
                    take_runs(runs, at, &rows, Ball { radius_mm }, &mut standing, |voxel, index| {
                        found[voxel] = Some(index);
                    });
                    found
                };
                let runs = straight_runs(0..8, at);
                assert_eq!(runs.len(), 2);
                let alone: Vec<_> = (0..8).map(|n| Run { first: n, last: n }).collect();
                assert!(sweep(&runs) == sweep(&alone), "{spacing_mm} mm, {step:?}");
            }
        }
    }
}
