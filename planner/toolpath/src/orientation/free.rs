//! The free directions of each waypoint, one bit per direction.

use bonemill_geometry::cancel;
use rayon::prelude::*;

/// A set of directions per waypoint.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct FreeSets {
    waypoints: usize,
    words: usize,
    bits: Vec<u64>,
}

impl FreeSets {
    /// The sets in which direction n is free at waypoint i if `is_free(i, n)`; waypoints are tested in parallel.
    pub fn fill(waypoints: usize, directions: usize, is_free: impl Fn(usize, usize) -> bool + Sync) -> Self {
        let words = directions.div_ceil(64).max(1);
        let mut bits = vec![0u64; waypoints * words];
        bits.par_chunks_mut(words).enumerate().for_each(|(i, row)| {
            cancel::poll();
            for n in (0..directions).filter(|n| is_free(i, *n)) {
                row[n / 64] |= 1 << (n % 64);
            }
        });
        Self { waypoints, words, bits }
    }

    /// Number of waypoints.
    pub fn len(&self) -> usize {
        self.waypoints
    }

    /// Whether there is no waypoint.
    pub fn is_empty(&self) -> bool {
        self.waypoints == 0
    }

    /// Whether direction n is free at waypoint i.
    #[inline]
    pub fn contains(&self, i: usize, n: usize) -> bool {
        self.row(i)[n / 64] >> (n % 64) & 1 == 1
    }

    /// Number of free directions at waypoint i.
    pub fn count(&self, i: usize) -> usize {
        self.row(i).iter().map(|w| w.count_ones() as usize).sum()
    }

    /// The free directions of waypoint i, ascending.
    pub fn iter(&self, i: usize) -> impl Iterator<Item = usize> + Clone + '_ {
        self.row(i).iter().enumerate().flat_map(|(w, word)| {
            let mut left = *word;
            std::iter::from_fn(move || {
                let n = left.trailing_zeros() as usize;
                (left != 0).then(|| {
                    left &= left - 1;
                    64 * w + n
                })
            })
        })
    }

    /// Sets in which nothing is free.
    pub fn none(waypoints: usize, directions: usize) -> Self {
        let words = directions.div_ceil(64).max(1);
        Self { waypoints, words, bits: vec![0; waypoints * words] }
    }

    /// Makes direction n free at waypoint i.
    pub fn insert(&mut self, i: usize, n: usize) {
        self.bits[i * self.words + n / 64] |= 1 << (n % 64);
    }

    /// Removes the directions of waypoint i for which `keep` is false.
    pub fn retain(&mut self, i: usize, keep: impl Fn(usize) -> bool) {
        let dropped: Vec<usize> = self.iter(i).filter(|n| !keep(*n)).collect();
        for n in dropped {
            self.bits[i * self.words + n / 64] &= !(1 << (n % 64));
        }
    }

    fn row(&self, i: usize) -> &[u64] {
        &self.bits[i * self.words..(i + 1) * self.words]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_goes_in_comes_out() {
        let rule = |i: usize, n: usize| !(i * 7 + n * 3).is_multiple_of(5);
        let mut sets = FreeSets::fill(9, 130, rule);
        for i in 0..9 {
            let expected: Vec<_> = (0..130).filter(|n| rule(i, *n)).collect();
            assert_eq!(sets.iter(i).collect::<Vec<_>>(), expected);
            assert_eq!(sets.count(i), expected.len());
        }
        sets.retain(4, |n| n % 2 == 0);
        assert!(sets.iter(4).all(|n| n % 2 == 0 && rule(4, n)) && sets.count(4) > 20);
        assert!(sets.contains(5, 1) && !sets.contains(5, 0) && !sets.contains(4, 1));
        assert_eq!(FreeSets::fill(0, 5, |_, _| true).len(), 0);
    }
}
