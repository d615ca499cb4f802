//! Distance from every voxel of a cubic grid to the nearest voxel of a mask, between centres.
//!
//! Squared distances in voxels are whole numbers, computed by a scan along x and by the lower envelope of parabolas along y
//! and z. Rows are independent, so the result does not depend on the number of threads.
//!
//! **Source:** Felzenszwalb & Huttenlocher 2012, "Distance transforms of sampled functions", algorithm 1.

use bonemill_geometry::cancel;
use rayon::prelude::*;

/// Squared distance where there is no voxel of the mask, voxels².
pub const NONE: f32 = 1e12;

/// Squared distance in voxels² from each voxel centre to the nearest voxel centre where `is` holds; x-fastest.
pub fn squared_voxels(dims: [usize; 3], is: impl Fn(usize) -> bool + Sync) -> Vec<f32> {
    let [nx, ny, nz] = dims;
    let mut field = vec![NONE; nx * ny * nz];
    field.par_chunks_mut(nx * ny).enumerate().for_each(|(k, slice)| {
        cancel::poll();
        for (j, row) in slice.chunks_mut(nx).enumerate() {
            along_x(row, |i| is(i + nx * (j + ny * k)));
        }
        let mut line = Envelope::new(ny);
        for i in 0..nx {
            line.load((0..ny).map(|j| slice[i + nx * j]));
            line.lowest(|j, v| slice[i + nx * j] = v);
        }
    });
    // z-lines of one y at a time, gathered and scattered by whole rows
    let columns: Vec<Vec<f32>> = (0..ny)
        .into_par_iter()
        .map(|j| {
            cancel::poll();
            // a line without a voxel of the mask is left unchanged
            let mut plane = vec![NONE; nx * nz];
            let mut line = Envelope::new(nz);
            for i in 0..nx {
                line.load((0..nz).map(|k| field[i + nx * (j + ny * k)]));
                line.lowest(|k, v| plane[i + nx * k] = v);
            }
            plane
        })
        .collect();
    field.par_chunks_mut(nx * ny).enumerate().for_each(|(k, slice)| {
        for (row, plane) in slice.chunks_mut(nx).zip(&columns) {
            row.copy_from_slice(&plane[nx * k..nx * (k + 1)]);
        }
    });
    field
}

/// Squared distance along one row.
fn along_x(row: &mut [f32], is: impl Fn(usize) -> bool) {
    let mut last: Option<usize> = None;
    for (i, value) in row.iter_mut().enumerate() {
        if is(i) {
            last = Some(i);
        }
        *value = last.map_or(NONE, |l| ((i - l) * (i - l)) as f32);
    }
    let mut next = None;
    for (i, value) in row.iter_mut().enumerate().rev() {
        if *value == 0.0 {
            next = Some(i);
        }
        *value = next.map_or(*value, |n: usize| value.min(((n - i) * (n - i)) as f32));
    }
}

/// Buffers for one line's lower envelope.
struct Envelope {
    values: Vec<f32>,
    /// Positions of the parabolas on the envelope, and where each begins to be the lowest.
    place: Vec<usize>,
    from: Vec<f32>,
}

impl Envelope {
    fn new(n: usize) -> Self {
        Self { values: Vec::with_capacity(n), place: Vec::with_capacity(n), from: Vec::with_capacity(n) }
    }

    fn load(&mut self, values: impl Iterator<Item = f32>) {
        self.values.clear();
        self.values.extend(values);
    }

    /// min over q of values(q) + (p − q)², for every p.
    fn lowest(&mut self, mut put: impl FnMut(usize, f32)) {
        self.place.clear();
        self.from.clear();
        for (q, &value) in self.values.iter().enumerate().filter(|(_, v)| **v < NONE) {
            let from = loop {
                let (Some(&top), Some(&from)) = (self.place.last(), self.from.last()) else {
                    break f32::NEG_INFINITY;
                };
                // in f64, because squares of positions would lose digits in f32
                let (a, b) = (top as f64, q as f64);
                let cross =
                    (f64::from(value) + b * b - f64::from(self.values[top]) - a * a) / (2.0 * (b - a));
                if cross as f32 > from {
                    break cross as f32;
                }
                self.place.pop();
                self.from.pop();
            };
            self.place.push(q);
            self.from.push(from);
        }
        let mut n = 0;
        for p in 0..self.values.len() {
            while self.from.get(n + 1).is_some_and(|from| *from < p as f32) {
                n += 1;
            }
            if let Some(&q) = self.place.get(n) {
                let step = p.abs_diff(q) as f32;
                put(p, self.values[q] + step * step);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_every_pair_of_voxels() {
        let dims = [9, 7, 8];
        for seed in 0..12usize {
            let is = |n: usize| (n * 7919 + seed * 104_729).is_multiple_of(13 + 40 * seed);
            let found = squared_voxels(dims, is);
            let voxel = |n: usize| [n % 9, n / 9 % 7, n / 63];
            for (n, value) in found.iter().enumerate() {
                let squared = |m: usize| {
                    let (a, b) = (voxel(n), voxel(m));
                    (0..3).map(|c| a[c].abs_diff(b[c]).pow(2)).sum::<usize>() as f32
                };
                let brute = (0..found.len()).filter(|m| is(*m)).map(squared).fold(NONE, f32::min);
                assert_eq!(*value, brute, "voxel {n}, seed {seed}");
            }
        }
    }

    #[test]
    fn an_empty_mask_is_far_from_everywhere() {
        assert_eq!(squared_voxels([4, 3, 2], |_| false), [NONE; 24]);
    }
}
