//! Sets of voxels, a bit each: what is still there, asked for row by row.
//!
//! Laying a path needs to know many times whether a ball or its sweep would take anything; a run of voxels in a row is a word or two.

use std::ops::{ControlFlow, Range};

use bonemill_geometry::{Point, Work};

use crate::sweep::Rows;

/// How far apart places are that a path is chosen from, and cells of what a shank is marched through, about, mm.
const APART_MM: f64 = 0.25;

/// How many voxels of a spacing lie between such places, at least one: finer grids sharpen shapes, not choices, so that
/// choosing costs no more than there are voxels.
pub fn voxels_apart(spacing_mm: f64) -> usize {
    (APART_MM / spacing_mm + 1e-9).round().max(1.0) as usize
}

/// Voxels of a grid by their place in memory.
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

    /// Puts a voxel in; whether it was not there.
    pub fn insert(&mut self, voxel: usize) -> bool {
        let is_new = !self.contains(voxel);
        self.words[voxel / 64] |= 1 << (voxel % 64);
        is_new
    }

    /// Takes a voxel out; whether it was there.
    pub fn remove(&mut self, voxel: usize) -> bool {
        let was_there = self.contains(voxel);
        self.words[voxel / 64] &= !(1 << (voxel % 64));
        was_there
    }

    /// Takes the voxels of a run out, and hands each that was there to `taken`.
    pub fn take(&mut self, run: Range<usize>, mut taken: impl FnMut(usize)) {
        for (w, mask) in masks(run) {
            let found = Bits(self.words[w] & mask);
            self.words[w] &= !mask;
            found.for_each(|bit| taken(64 * w + bit));
        }
    }

    /// How many voxels of a run are in the set.
    pub fn count(&self, run: Range<usize>) -> usize {
        masks(run).map(|(w, mask)| (self.words[w] & mask).count_ones() as usize).sum()
    }

    /// Becomes the same as another set of the same grid; whether voxels came in.
    pub fn replace(&mut self, other: &Self) -> bool {
        let gains = |(own, new): (&mut u64, &u64)| *new & !std::mem::replace(own, *new) != 0;
        self.words.iter_mut().zip(&other.words).map(gains).fold(false, |any, gains| any | gains)
    }

    /// The voxels of a run that are in the set, in order.
    pub fn within(&self, run: Range<usize>) -> impl Iterator<Item = usize> {
        masks(run).flat_map(|(w, mask)| Bits(self.words[w] & mask).map(move |bit| 64 * w + bit))
    }

    /// Takes those voxels of a run out for which `taken` is true; it is called for each that is there, in order.
    pub fn take_where(&mut self, run: Range<usize>, mut taken: impl FnMut(usize) -> bool) {
        for (w, mask) in masks(run) {
            for bit in Bits(self.words[w] & mask) {
                if taken(64 * w + bit) {
                    self.words[w] &= !(1 << bit);
                }
            }
        }
    }

    /// Whether a voxel of a run, or one that shares a word with it, is in the set.
    pub fn may_hold(&self, run: Range<usize>) -> bool {
        !run.is_empty() && self.words[run.start / 64..run.end.div_ceil(64)].iter().any(|word| *word != 0)
    }

    /// A voxel of the set within `radius_mm` of the segment a–b: the first in memory.
    pub fn first_within(&self, rows: &Rows, [a, b]: [Point<Work>; 2], radius_mm: f64) -> Option<usize> {
        let mut found = None;
        let may = |_: &Option<usize>, run| self.may_hold(run);
        let _ = rows.within_capsule_where(a, b, radius_mm, &mut found, may, |found, run| {
            *found = self.within(run).next();
            if found.is_some() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        found
    }

    /// How many voxels of the set lie within `radius_mm` of the segment a–b, counted up to about `enough`.
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

/// The places of a word's ones, from the lowest.
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

/// The words that a run lies in, each with the bits that are the run's.
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
        /// Against a list of flags.
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
