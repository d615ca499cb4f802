//! The separable transform: along x by a scan, along y within each slice, along z across slices.
//!
//! A row without sites is skipped after one test, and a slice without sites is never stored; this saves much, because a
//! nerve fills few rows and slices. The other slices are solved along x and y into the first slots of the result's
//! memory, and from there along z into the same memory, for one y at a time. Each thread solves whole slices, then whole
//! planes of one y, so no result depends on the number of threads.

use bonemill_geometry::cancel;
use std::ops::Range;

use rayon::prelude::*;

use super::envelope::{Envelope, MAX_LINES, Places};

/// The transform's input: which voxels are sites, and what a distance costs.
pub(crate) struct SeparableProblem<'a, T, P> {
    /// Values of a whole volume, x-fastest.
    pub values: &'a [T],
    /// Its dimensions.
    pub dims: [usize; 3],
    /// Which values are sites.
    pub is_site: P,
    /// The part of the volume in which sites count.
    pub sites: [Range<usize>; 3],
    /// The voxels for which distances are computed; at least one along each axis.
    pub out: [Places; 3],
    /// The squared cost of t voxels along each axis: 0 at 0, convex in t; as long as the volume.
    pub along: [Vec<f32>; 3],
    /// The length that a squared cost of 1 stands for, mm.
    pub unit_mm: f32,
}

/// The distances of the voxels of [`SeparableProblem::out`], x-fastest.
pub(crate) struct Solution {
    /// Root of the cost to the nearest site, mm.
    pub distance_mm: Vec<f32>,
    /// Memory index of the nearest site in the volume; empty when it was not requested.
    pub nearest: Vec<u32>,
}

/// Buffers that a thread reuses.
#[derive(Default)]
struct Scratch {
    envelope: Envelope,
    /// Rows with sites.
    rows: Vec<usize>,
    /// Their costs and nearest sites after x.
    squared: Vec<f32>,
    nearest: Vec<u32>,
}

impl<T: Copy + Sync, P: Fn(T) -> bool + Sync> SeparableProblem<'_, T, P> {
    /// Cost and, if `with_nearest`, place of the nearest site; `None` when there is no site.
    pub fn solve(&self, with_nearest: bool) -> Option<Solution> {
        let slices: Vec<usize> = self.sites[2]
            .clone()
            .into_par_iter()
            .filter(|z| self.sites[1].clone().any(|y| self.has_site(y, *z)))
            .collect();
        if slices.is_empty() {
            return None;
        }
        let [nx, ny, nz] = self.out.map(|places| places.count);
        let slots = nz.max(slices.len());
        let mut squared = vec![0.0; nx * ny * slots];
        let mut nearest = vec![0; if with_nearest { squared.len() } else { 0 }];

        let slabs =
            parts(&mut squared, nx * ny, slots).into_par_iter().zip(parts(&mut nearest, nx * ny, slots));
        slabs.zip(&slices).for_each_init(Scratch::default, |scratch, ((squared, nearest), z)| {
            cancel::poll();
            self.solve_slice(*z, scratch, squared, nearest);
        });
        let rows = by_y(parts(&mut squared, nx, ny * slots), ny).into_par_iter();
        let rows = rows.zip(by_y(parts(&mut nearest, nx, ny * slots), ny));
        rows.for_each_init(Envelope::default, |envelope, (squared, nearest)| {
            cancel::poll();
            self.solve_across(envelope, &slices, squared, nearest);
        });
        squared.truncate(nx * ny * nz);
        nearest.truncate(if with_nearest { nx * ny * nz } else { 0 });
        Some(Solution { distance_mm: squared, nearest })
    }

    fn row(&self, y: usize, z: usize) -> (usize, &[T]) {
        let start = self.dims[0] * (y + self.dims[1] * z);
        (start, &self.values[start..start + self.dims[0]][self.sites[0].clone()])
    }

    fn has_site(&self, y: usize, z: usize) -> bool {
        // tests the whole row: the compiler turns this into vector code, unlike a search that stops early
        self.row(y, z).1.iter().fold(false, |any, v| any | (self.is_site)(*v))
    }

    /// Solves slice z along x and y.
    fn solve_slice(&self, z: usize, scratch: &mut Scratch, squared_out: &mut [f32], nearest_out: &mut [u32]) {
        let Scratch { envelope, rows, squared, nearest } = scratch;
        let width = self.out[0].count;
        rows.clear();
        rows.extend(self.sites[1].clone().filter(|y| self.has_site(*y, z)));
        squared.resize(rows.len() * width, 0.0);
        nearest.resize(rows.len() * width, 0);
        for (n, y) in rows.iter().enumerate() {
            let part = n * width..(n + 1) * width;
            self.solve_row(*y, z, &mut squared[part.clone()], &mut nearest[part]);
        }
        let named = !nearest_out.is_empty();
        for x in (0..width).step_by(MAX_LINES) {
            let lines = x..(x + MAX_LINES).min(width);
            envelope.begin(rows, lines.len(), named);
            for n in 0..rows.len() {
                let part = n * width + lines.start..n * width + lines.end;
                envelope.set_site(n, &squared[part.clone()], if named { &nearest[part] } else { &[] });
            }
            envelope.solve(self.out[1], &self.along[1]);
            for n in 0..self.out[1].count {
                let part = n * width + lines.start..n * width + lines.end;
                let names = if named { &mut nearest_out[part.clone()] } else { &mut [] };
                envelope.row(n, &mut squared_out[part], names);
            }
        }
    }

    /// Computes a row's costs and nearest sites. On equal distances the first site wins.
    fn solve_row(&self, y: usize, z: usize, squared: &mut [f32], nearest: &mut [u32]) {
        let (start, row) = self.row(y, z);
        let (out, along, first) = (self.out[0], &self.along[0], self.sites[0].start);
        let mut assign = |places: Range<usize>, site: usize| {
            for n in places {
                squared[n] = along[out.at(n).abs_diff(site)];
                nearest[n] = (start + site) as u32;
            }
        };
        // number of places done, and the last site before them
        let (mut done, mut last) = (0, None);
        let mut x = 0;
        while let Some(gap) = row[x..].iter().position(|v| (self.is_site)(*v)) {
            let length =
                row[x + gap..].iter().position(|v| !(self.is_site)(*v)).unwrap_or(row.len() - x - gap);
            let run = first + x + gap..first + x + gap + length;
            if let Some(last) = last {
                // up to here the places are at least as near to the previous run as to this one
                let until = out.before((last + run.start) / 2 + 1);
                assign(done..until, last);
                done = until;
            }
            let until = out.before(run.start);
            assign(done..until, run.start);
            done = until.max(done);
            for n in done..out.before(run.end) {
                assign(n..n + 1, out.at(n));
            }
            done = out.before(run.end).max(done);
            last = Some(run.end - 1);
            x += gap + length;
        }
        if let Some(last) = last {
            assign(done..out.count, last);
        }
    }

    /// Solves all slots of one y along z.
    fn solve_across(
        &self,
        envelope: &mut Envelope,
        slices: &[usize],
        mut squared: Vec<&mut [f32]>,
        mut nearest: Vec<&mut [u32]>,
    ) {
        let width = self.out[0].count;
        for x in (0..width).step_by(MAX_LINES) {
            let lines = x..(x + MAX_LINES).min(width);
            let named = |row: &[u32]| if row.is_empty() { 0..0 } else { lines.clone() };
            envelope.begin(slices, lines.len(), nearest.first().is_some_and(|row| !row.is_empty()));
            for (n, (costs, names)) in squared.iter().zip(&nearest).take(slices.len()).enumerate() {
                envelope.set_site(n, &costs[lines.clone()], &names[named(names)]);
            }
            envelope.solve(self.out[2], &self.along[2]);
            for (n, (distance, names)) in
                squared.iter_mut().zip(&mut nearest).take(self.out[2].count).enumerate()
            {
                let part = named(names);
                let distance = &mut distance[lines.clone()];
                envelope.row(n, distance, &mut names[part]);
                distance.iter_mut().for_each(|d| *d = d.sqrt() * self.unit_mm);
            }
        }
    }
}

/// Splits the values into `count` parts of `size` values; the parts are empty when there are no values.
fn parts<T>(values: &mut [T], size: usize, count: usize) -> Vec<&mut [T]> {
    if values.is_empty() {
        return (0..count).map(|_| <&mut [T]>::default()).collect();
    }
    values.chunks_exact_mut(size).collect()
}

/// Rows in memory's order, grouped by y, each group ascending in z.
fn by_y<R>(rows: Vec<R>, ny: usize) -> Vec<Vec<R>> {
    let mut groups: Vec<Vec<R>> = (0..ny).map(|_| Vec::with_capacity(rows.len() / ny)).collect();
    for (n, row) in rows.into_iter().enumerate() {
        groups[n % ny].push(row);
    }
    groups
}
