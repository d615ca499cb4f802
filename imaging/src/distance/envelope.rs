//! The lower envelope of shifted costs, for many neighbouring lines at once.
//!
//! One dimension of the separable transform asks, for every place z of a line, which site c minimises
//! f(c) + g(|z − p(c)|): f is the squared distance found so far, p the site's place, g the squared distance along the
//! line. g is convex, so the matrix of these sums is totally monotone: the first best site never moves back as z grows.
//! That allows divide and conquer (Aggarwal et al. 1987): solve the middle place among all sites, then each half only
//! among the sites that the solved neighbours leave.
//!
//! Neighbouring lines have nearly the same best sites. So [`LANES`] lines run in lockstep over the union of their
//! candidate ranges: one pass without branches over contiguous lanes, which the compiler turns into vector code, in
//! place of the divisions and unpredictable branches of a parabola stack (Felzenszwalb and Huttenlocher 2012).
//! On equal sums the first site wins.

use std::ops::Range;

/// Lines solved at once.
pub(super) const LANES: usize = 16;

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
}

/// A value per line.
pub(super) type Lanes = [f32; LANES];

/// Sites of [`LANES`] lines, and room for the solution.
#[derive(Default)]
pub(super) struct Envelope {
    /// Places of the sites, ascending; the same for all lines.
    places: Vec<usize>,
    /// f per site and line.
    costs: Vec<Lanes>,
    /// The smallest sum per place and line.
    pub best: Vec<Lanes>,
    /// The site that gives it.
    pub site: Vec<[u32; LANES]>,
    /// Smallest and largest entry of `site` at each place.
    range: Vec<[u32; 2]>,
}

impl Envelope {
    /// Sites at `places`, ascending and at least one; costs are set with [`Envelope::costs_mut`].
    pub fn set_places(&mut self, places: &[usize]) {
        self.places.clear();
        self.places.extend_from_slice(places);
        self.costs.resize(places.len(), [0.0; LANES]);
    }

    /// f per site and line.
    pub fn costs_mut(&mut self) -> &mut [Lanes] {
        &mut self.costs
    }

    /// Solves `places`; entry n of `best` and `site` is for the n-th of them.
    /// `along[t]` is g(t), for every distance t between a site and a place.
    pub fn solve(&mut self, places: Places, along: &[f32]) {
        let Places { count, .. } = places;
        self.best.resize(count, [0.0; LANES]);
        self.site.resize(count, [0; LANES]);
        self.range.resize(count, [0; 2]);
        let last_site = self.places.len() - 1;
        self.solve_place(0, places.first, [0, last_site], along);
        // halve the stride: each new place lies between two solved ones, or behind the last
        let mut stride = count.next_power_of_two();
        while stride > 1 {
            let half = stride / 2;
            for n in (half..count).step_by(stride) {
                let lo = self.range[n - half][0] as usize;
                let hi = self.range.get(n + half).map_or(last_site, |r| r[1] as usize);
                self.solve_place(n, places.at(n), [lo, hi], along);
            }
            stride = half;
        }
    }

    #[inline]
    fn solve_place(&mut self, n: usize, place: usize, [lo, hi]: [usize; 2], along: &[f32]) {
        let (mut best, mut site) = ([f32::INFINITY; LANES], [lo as u32; LANES]);
        for (c, (costs, p)) in self.costs[lo..=hi].iter().zip(&self.places[lo..=hi]).enumerate() {
            let add = along[place.abs_diff(*p)];
            let c = (lo + c) as u32;
            for l in 0..LANES {
                let sum = costs[l] + add;
                let better = sum < best[l];
                best[l] = if better { sum } else { best[l] };
                site[l] = if better { c } else { site[l] };
            }
        }
        self.best[n] = best;
        self.site[n] = site;
        self.range[n] =
            [site.iter().copied().fold(u32::MAX, u32::min), site.iter().copied().fold(0, u32::max)];
    }
}
