//! Sets of voxels, one bit per voxel, for queries row by row.
//!
//! Laying a path often tests whether a ball or its sweep would remove anything; a run of voxels in a row is one or two words.

use std::ops::{ControlFlow, Range};

use bonemill_geometry::{Point, Work};

use crate::stock::sweep::Rows;

/// Approximate distance between the positions from which a path is chosen, and size of the cells in which the shank's access
/// is tested, mm.
const APART_MM: f64 = 0.25;

/// Number of voxels between such positions, at least 1. A finer grid gives more exact shapes but no more positions, so the
/// cost of choosing grows only with the number of voxels.
pub fn voxels_apart(spacing_mm: f64) -> usize {
    (APART_MM / spacing_mm + 1e-9).round().max(1.0) as usize
}

/// A set of voxels of a grid, by memory index.
#[derive(Debug, Clone, Default)]
pub struct VoxelSet {
    words: Vec<u64>,
}

impl VoxelSet {
    /// The voxels of `0..len` for which `holds`.
    pub fn of(len: usize, holds: impl Fn(usize) -> bool) -> Self {
        let word = |w: usize| {
            let voxels = 64 * w..(64 * (w + 1)).min(len);
            voxels.filter(|v| holds(*v)).fold(0u64, |word, v| word | 1 << (v % 64))
        };
        Self { words: (0..len.div_ceil(64)).map(word).collect() }
    }

    /// Whether a voxel is in the set.
    pub fn contains(&self, voxel: usize) -> bool {
        self.words[voxel / 64] >> (voxel % 64) & 1 == 1
    }

    /// Adds a voxel; returns whether it was not in the set.
    pub fn insert(&mut self, voxel: usize) -> bool {
        let is_new = !self.contains(voxel);
        self.words[voxel / 64] |= 1 << (voxel % 64);
        is_new
    }

    /// Removes a voxel; returns whether it was in the set.
    pub fn remove(&mut self, voxel: usize) -> bool {
        let was_there = self.contains(voxel);
        self.words[voxel / 64] &= !(1 << (voxel % 64));
        was_there
    }

    /// Removes the voxels of a run, and calls `taken` with each that was in the set.
    pub fn take(&mut self, run: Range<usize>, mut taken: impl FnMut(usize)) {
        for (w, mask) in masks(run) {
            let found = Bits(self.words[w] & mask);
            self.words[w] &= !mask;
            found.for_each(|bit| taken(64 * w + bit));
        }
    }

    /// Number of voxels of a run that are in the set.
    pub fn count(&self, run: Range<usize>) -> usize {
        masks(run).map(|(w, mask)| (self.words[w] & mask).count_ones() as usize).sum()
    }

    /// Becomes equal to another set on the same grid; returns whether voxels were added.
    pub fn replace(&mut self, other: &Self) -> bool {
        let gains = |(own, new): (&mut u64, &u64)| *new & !std::mem::replace(own, *new) != 0;
        self.words.iter_mut().zip(&other.words).map(gains).fold(false, |any, gains| any | gains)
    }

    /// The voxels of a run that are in the set, in order.
    pub fn within(&self, run: Range<usize>) -> impl Iterator<Item = usize> {
        masks(run).flat_map(|(w, mask)| Bits(self.words[w] & mask).map(move |bit| 64 * w + bit))
    }

    /// Removes the voxels of a run for which `taken` returns true. `taken` is called for each voxel of the set in the run, in
    /// order.
    pub fn take_where(&mut self, run: Range<usize>, mut taken: impl FnMut(usize) -> bool) {
        for (w, mask) in masks(run) {
            for bit in Bits(self.words[w] & mask) {
                if taken(64 * w + bit) {
                    self.words[w] &= !(1 << bit);
                }
            }
        }
    }

    /// Whether a voxel of a run may be in the set: also true for a voxel outside the run that shares a word with it.
    pub fn may_hold(&self, run: Range<usize>) -> bool {
        !run.is_empty() && self.words[run.start / 64..run.end.div_ceil(64)].iter().any(|word| *word != 0)
    }

    /// The voxel of the set within `radius_mm` of the segment a–b that is first in memory.
    pub fn first_within(&self, rows: &Rows, [a, b]: [Point<Work>; 2], radius_mm: f64) -> Option<usize> {
        let mut found = None;
        let may = |_: &Option<usize>, run| self.may_hold(run);
        let _ = rows.within_capsule_where(a, b, radius_mm, &mut found, may, |found, run| {
            *found = self.within(run).next();
            if found.is_some() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        found
    }

    /// Number of voxels of the set within `radius_mm` of the segment a–b; counting stops at about `enough`.
    pub fn count_within(
        &self,
        rows: &Rows,
        [a, b]: [Point<Work>; 2],
        radius_mm: f64,
        enough: usize,
    ) -> usize {
        let mut found = 0;
        let may = |_: &usize, run| self.may_hold(run);
        let _ = rows.within_capsule_where(a, b, radius_mm, &mut found, may, |found, run| {
            *found += self.count(run);
            if *found >= enough { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        found
    }
}

/// Iterates over the positions of a word's set bits, from the lowest.
struct Bits(u64);

impl Iterator for Bits {
    type Item = usize;

    #[inline]
    fn next(&mut self) -> Option<usize> {
        let bit = self.0.trailing_zeros() as usize;
        self.0 &= self.0.wrapping_sub(1);
        (bit < 64).then_some(bit)
    }
}

/// The words that contain a run, each with a mask of the run's bits.
fn masks(run: Range<usize>) -> impl Iterator<Item = (usize, u64)> {
    let words = run.start / 64..run.end.div_ceil(64);
    words.map(move |w| {
        let from = run.start.saturating_sub(64 * w);
        let beyond = (64 * (w + 1)).saturating_sub(run.end);
        (w, u64::MAX << from & u64::MAX >> beyond)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use bonemill_geometry::Grid;
    use proptest::prelude::*;

    proptest! {
        /// The set is compared with a list of flags.
        #[test]
        fn runs_take_out_what_is_there(
            flags in prop::collection::vec(any::<bool>(), 1..300), ends in prop::array::uniform2(0usize..300),
        ) {
            let mut set = VoxelSet::of(flags.len(), |v| flags[v]);
            let run = ends[0].min(ends[1]).min(flags.len())..ends[0].max(ends[1]).min(flags.len());
            let expected: Vec<_> = run.clone().filter(|v| flags[*v]).collect();
            prop_assert_eq!(set.within(run.clone()).collect::<Vec<_>>(), &expected[..]);
            let mut some = set.clone();
            some.take_where(run.clone(), |v| v % 3 == 0);
            prop_assert!((0..flags.len()).all(|v| some.contains(v) == (flags[v] && !(run.contains(&v) && v % 3 == 0))));
            let mut taken = Vec::new();
            set.take(run.clone(), |v| taken.push(v));
            prop_assert_eq!(taken, expected);
            for (v, flag) in flags.iter().enumerate() {
                prop_assert_eq!(set.contains(v), *flag && !run.contains(&v));
            }
        }
    }

    #[test]
    fn counts_are_those_of_the_runs() {
        let grid = Grid::<Work>::aligned([37, 21, 19], 0.3, Point::new(0.0, 0.0, 0.0)).unwrap();
        let rows = Rows::of(&grid);
        let mut set = VoxelSet::of(grid.len(), |v| v % 3 == 0);
        let ends = [Point::new(2.0, 2.5, 3.0), Point::new(8.0, 3.0, 2.0)];
        let mut expected = 0;
        let _ = rows.within_capsule(ends[0], ends[1], 1.2, |run| {
            expected += run.filter(|v| v % 3 == 0).count();
            ControlFlow::Continue(())
        });
        assert!(expected > 100);
        assert_eq!(set.count_within(&rows, ends, 1.2, usize::MAX), expected);
        assert!((5..40).contains(&set.count_within(&rows, ends, 1.2, 5)));
        assert!(set.remove(3) && !set.remove(3) && set.insert(3) && !set.insert(3));
    }
}
