//! The separable transform: along x by a scan, along y within each slice, along z across slices.
//!
//! A row without sites is skipped after one look, a slice without sites is never stored. Both matter: a nerve fills
//! few of either. Rows and slices are handed to threads whole, and no result depends on who computed it.

use std::ops::Range;

use rayon::prelude::*;

use super::envelope::{Envelope, LANES, Places};

/// The transform's input: which voxels are sites, and what a distance costs.
pub(crate) struct Problem<'a, T, P> {
    /// Values of a whole volume, x-fastest.
    pub values: &'a [T],
    /// Its dimensions.
    pub dims: [usize; 3],
    /// Which values are sites.
    pub is_site: P,
    /// The part of the volume in which sites count.
    pub sites: [Range<usize>; 3],
    /// The voxels for which to answer; at least one along each axis.
    pub out: [Places; 3],
    /// The squared cost of t voxels along each axis, convex in t and smallest at 0; as long as the volume.
    pub along: [Vec<f32>; 3],
}

/// The answer for the voxels of [`Problem::out`], x-fastest.
pub(crate) struct Solution {
    /// Squared cost to the nearest site.
    pub squared: Vec<f32>,
    /// Memory index of the nearest site in the volume; empty when it was not asked for.
    pub nearest: Vec<u32>,
}

/// A slice after x and y: cost and site per voxel of the answer's x and y range.
struct Slice {
    z: usize,
    squared: Vec<f32>,
    nearest: Vec<u32>,
}

/// Room that a thread reuses.
#[derive(Default)]
struct Scratch {
    envelope: Envelope,
    /// Places of the sites of a row.
    row_sites: Vec<u32>,
    /// Rows with sites.
    rows: Vec<usize>,
    squared: Vec<f32>,
    nearest: Vec<u32>,
}

impl<T: Copy + Sync, P: Fn(T) -> bool + Sync> Problem<'_, T, P> {
    /// Cost and, if `with_nearest`, place of the nearest site; `None` when there is no site.
    pub fn solve(&self, with_nearest: bool) -> Option<Solution> {
        let slices: Vec<Slice> = self.sites[2]
            .clone()
            .into_par_iter()
            .map_init(Scratch::default, |scratch, z| self.solve_slice(z, scratch))
            .flatten()
            .collect();
        if slices.is_empty() {
            return None;
        }
        let places: Vec<usize> = slices.iter().map(|s| s.z).collect();
        let [nx, ny, nz] = self.out.map(|places| places.count);
        let mut squared = vec![0.0; nx * ny * nz];
        let mut nearest = vec![0; if with_nearest { squared.len() } else { 0 }];
        let squared_rows = rows_by_y(&mut squared, nx, ny);
        let nearest_rows = rows_by_y(&mut nearest, nx, ny);
        squared_rows.into_par_iter().zip(nearest_rows).enumerate().for_each_init(
            Envelope::default,
            |envelope, (y, (mut squared, mut nearest))| {
                envelope.set_places(&places);
                for x in (0..nx).step_by(LANES) {
                    let width = LANES.min(nx - x);
                    let at = x + nx * y;
                    for (costs, slice) in envelope.costs_mut().iter_mut().zip(&slices) {
                        copy_padded(&slice.squared[at..at + width], costs);
                    }
                    envelope.solve(self.out[2], &self.along[2]);
                    for (row, best) in squared.iter_mut().zip(&envelope.best) {
                        row[x..x + width].copy_from_slice(&best[..width]);
                    }
                    for (row, site) in nearest.iter_mut().zip(&envelope.site) {
                        for (l, out) in row[x..x + width].iter_mut().enumerate() {
                            *out = slices[site[l] as usize].nearest[at + l];
                        }
                    }
                }
            },
        );
        Some(Solution { squared, nearest })
    }

    /// Slice z along x and y; `None` without sites.
    fn solve_slice(&self, z: usize, scratch: &mut Scratch) -> Option<Slice> {
        let Scratch { envelope, row_sites, rows, squared, nearest } = scratch;
        let [nx, ny, _] = self.dims;
        let width = self.out[0].count;
        rows.clear();
        squared.clear();
        nearest.clear();
        for y in self.sites[1].clone() {
            let start = nx * (y + ny * z);
            let row = &self.values[start + self.sites[0].start..start + self.sites[0].end];
            if !row.iter().fold(false, |any, v| any | (self.is_site)(*v)) {
                continue;
            }
            rows.push(y);
            row_sites.clear();
            row_sites.extend(
                (self.sites[0].start as u32..).zip(row).filter(|(_, v)| (self.is_site)(**v)).map(|(x, _)| x),
            );
            self.solve_row(start as u32, row_sites, squared, nearest);
        }
        if rows.is_empty() {
            return None;
        }
        let height = self.out[1].count;
        let mut slice = Slice { z, squared: vec![0.0; width * height], nearest: vec![0; width * height] };
        envelope.set_places(rows);
        for x in (0..width).step_by(LANES) {
            let lanes = LANES.min(width - x);
            for (costs, row) in envelope.costs_mut().iter_mut().zip(squared.chunks_exact(width)) {
                copy_padded(&row[x..x + lanes], costs);
            }
            envelope.solve(self.out[1], &self.along[1]);
            let solved = envelope.best.iter().zip(&envelope.site);
            let out = slice.squared.chunks_exact_mut(width).zip(slice.nearest.chunks_exact_mut(width));
            for ((best, site), (squared_row, nearest_row)) in solved.zip(out) {
                squared_row[x..x + lanes].copy_from_slice(&best[..lanes]);
                for (l, out) in nearest_row[x..x + lanes].iter_mut().enumerate() {
                    *out = nearest[site[l] as usize * width + x + l];
                }
            }
        }
        Some(slice)
    }

    /// Appends a row's cost and nearest site for the answer's x range. On equal distances the first site wins.
    fn solve_row(&self, start: u32, sites: &[u32], squared: &mut Vec<f32>, nearest: &mut Vec<u32>) {
        let (out, along) = (self.out[0], &self.along[0]);
        let mut done = 0;
        for (n, &site) in sites.iter().enumerate() {
            // places nearer to this one than to the next, or as near
            let until = sites.get(n + 1).map_or(out.count, |next| {
                let first_beyond = (site + next) as usize / 2 + 1;
                first_beyond.saturating_sub(out.first).div_ceil(out.step).min(out.count)
            });
            if until <= done {
                continue;
            }
            squared.extend((done..until).map(|n| along[out.at(n).abs_diff(site as usize)]));
            nearest.extend((done..until).map(|_| start + site));
            done = until;
        }
    }
}

/// `values` and, in the lanes behind them, their last one: a lane like its neighbours widens no range of candidates.
fn copy_padded(values: &[f32], lanes: &mut [f32; LANES]) {
    if let Ok(all) = <&[f32; LANES]>::try_from(values) {
        *lanes = *all;
    } else if let Some(last) = values.last() {
        *lanes = [*last; LANES];
        lanes[..values.len()].copy_from_slice(values);
    }
}

/// The rows of a volume, grouped by y, each group ascending in z; groups of nothing for an empty volume.
fn rows_by_y<T>(values: &mut [T], nx: usize, ny: usize) -> Vec<Vec<&mut [T]>> {
    let mut groups: Vec<Vec<&mut [T]>> = (0..ny).map(|_| Vec::new()).collect();
    for (n, row) in values.chunks_exact_mut(nx).enumerate() {
        groups[n % ny].push(row);
    }
    groups
}
