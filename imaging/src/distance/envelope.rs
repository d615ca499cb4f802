//! The lower envelope of shifted costs, for many neighbouring lines at once.
//!
//! One dimension of the separable transform finds, for every place z of a line, the site c that minimises
//! f(c) + g(|z − p(c)|): f is the squared distance found so far, p the site's place, g the squared distance along the
//! line. g is convex, so the matrix of these sums is totally monotone: the first best site never moves back as z grows.
//! That allows divide and conquer (Aggarwal et al. 1987): the middle place is solved among all sites, then each half only
//! among the sites between the best sites of its solved neighbours.
//!
//! Neighbouring lines have nearly the same best sites. So [`LANES`] lines are solved together over the union of their
//! candidate ranges: one pass without branches over contiguous lanes, which the compiler turns into vector code. A
//! parabola stack (Felzenszwalb and Huttenlocher 2012) would need divisions and unpredictable branches instead.
//! On equal sums the first site wins.
//!
//! Lines cross rows: line x consists of the x-th values of all rows. Rows are read and written whole, so that memory is
//! accessed in long stretches, and intermediate values stay in the processor's cache.

use std::ops::Range;

/// Lines solved at once.
const LANES: usize = 16;
/// The most lines of an [`Envelope`]; with 512 sites and places they hold a mebibyte of values.
pub(super) const MAX_LINES: usize = 8 * LANES;

/// Equally spaced places along an axis, in voxels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Places {
    pub first: usize,
    pub step: usize,
    pub count: usize,
}

impl Places {
    /// Every place of a range.
    pub fn all(range: Range<usize>) -> Self {
        Self { first: range.start, step: 1, count: range.len() }
    }

    #[inline]
    pub fn at(&self, n: usize) -> usize {
        self.first + n * self.step
    }

    /// How many places lie before voxel `end`.
    #[inline]
    pub fn before(&self, end: usize) -> usize {
        end.saturating_sub(self.first).div_ceil(self.step).min(self.count)
    }
}

/// Up to [`MAX_LINES`] lines: their sites and, once solved, the best of them at each place.
///
/// Lines are kept in blocks of [`LANES`]; an entry of a block is one site, or place, of all its lines.
#[derive(Default)]
pub(super) struct Envelope {
    /// Places of the sites, ascending; the same for all lines.
    sites: Vec<usize>,
    /// f by block and site.
    costs: Vec<[f32; LANES]>,
    /// The identifier of each site, by block and site; empty when identifiers are not needed.
    names: Vec<[u32; LANES]>,
    /// The smallest sum by block and place.
    best: Vec<[f32; LANES]>,
    /// The site that gives it.
    site: Vec<[u32; LANES]>,
    /// Smallest and largest site at each place of the block being solved.
    range: Vec<[u32; 2]>,
    /// Places solved.
    count: usize,
}

impl Envelope {
    /// Starts on `lines` lines with sites at `sites` (ascending, at least one); [`Envelope::set_site`] then gives their costs.
    pub fn begin(&mut self, sites: &[usize], lines: usize, named: bool) {
        let blocks = lines.div_ceil(LANES);
        self.sites.clear();
        self.sites.extend_from_slice(sites);
        self.costs.resize(blocks * sites.len(), [0.0; LANES]);
        self.names.resize(if named { blocks * sites.len() } else { 0 }, [0; LANES]);
    }

    /// Sets f of the n-th site in every line, and the site's identifiers (an empty row when they are not needed).
    pub fn set_site(&mut self, n: usize, costs: &[f32], names: &[u32]) {
        let sites = self.sites.len();
        for (block, values) in costs.chunks(LANES).enumerate() {
            copy_padded(values, &mut self.costs[block * sites + n]);
        }
        for (block, values) in names.chunks(LANES).enumerate() {
            copy_padded(values, &mut self.names[block * sites + n]);
        }
    }

    /// Finds the best site at each of `places`; `along[t]` is g(t), for every distance t between a site and a place.
    pub fn solve(&mut self, places: Places, along: &[f32]) {
        let blocks = self.costs.len() / self.sites.len();
        self.count = places.count;
        self.best.resize(blocks * places.count, [0.0; LANES]);
        self.site.resize(blocks * places.count, [0; LANES]);
        self.range.resize(places.count, [0; 2]);
        for block in 0..blocks {
            self.solve_block(block, places, along);
        }
    }

    /// The smallest sum of every line at the n-th place, and the identifier of the site that gives it.
    pub fn row(&self, n: usize, best: &mut [f32], names: &mut [u32]) {
        for (block, out) in best.chunks_mut(LANES).enumerate() {
            out.copy_from_slice(&self.best[block * self.count + n][..out.len()]);
        }
        let sites = self.sites.len();
        for (block, out) in names.chunks_mut(LANES).enumerate() {
            let names = &self.names[block * sites..(block + 1) * sites];
            let site = &self.site[block * self.count + n];
            for ((l, out), site) in out.iter_mut().enumerate().zip(site) {
                *out = names[*site as usize][l];
            }
        }
    }

    fn solve_block(&mut self, block: usize, places: Places, along: &[f32]) {
        let last_site = self.sites.len() - 1;
        self.solve_place(block, 0, places, [0, last_site], along);
        // the stride is halved: each new place lies between two solved ones, or behind the last
        let mut stride = places.count.next_power_of_two();
        while stride > 1 {
            let half = stride / 2;
            for n in (half..places.count).step_by(stride) {
                let lo = self.range[n - half][0] as usize;
                let hi = self.range.get(n + half).map_or(last_site, |r| r[1] as usize);
                self.solve_place(block, n, places, [lo, hi], along);
            }
            stride = half;
        }
    }

    #[inline]
    #[expect(clippy::too_many_arguments, reason = "the innermost step, inlined into the loop over places")]
    fn solve_place(&mut self, block: usize, n: usize, places: Places, [lo, hi]: [usize; 2], along: &[f32]) {
        let place = places.at(n);
        let costs = &self.costs[block * self.sites.len()..][lo..=hi];
        let (mut best, mut site) = ([f32::INFINITY; LANES], [lo as u32; LANES]);
        for (c, (costs, p)) in (lo as u32..).zip(costs.iter().zip(&self.sites[lo..=hi])) {
            let add = along[place.abs_diff(*p)];
            for l in 0..LANES {
                let sum = costs[l] + add;
                let better = sum < best[l];
                best[l] = if better { sum } else { best[l] };
                site[l] = if better { c } else { site[l] };
            }
        }
        self.best[block * self.count + n] = best;
        self.site[block * self.count + n] = site;
        // odd places are solved last, so no other place needs their range
        if n.is_multiple_of(2) {
            let min = site.iter().copied().fold(u32::MAX, u32::min);
            self.range[n] = [min, site.iter().copied().fold(0, u32::max)];
        }
    }
}

/// Copies `values` and fills the lanes behind them with the last value. Lanes that repeat a line do not widen the range of
/// candidates.
#[inline]
fn copy_padded<T: Copy>(values: &[T], lanes: &mut [T; LANES]) {
    if let Ok(all) = <&[T; LANES]>::try_from(values) {
        *lanes = *all;
    } else if let Some(last) = values.last() {
        *lanes = [*last; LANES];
        lanes[..values.len()].copy_from_slice(values);
    }
}
