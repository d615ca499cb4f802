//! The rows of voxels inside a ball around a voxel's centre.

use std::ops::Range;

/// Rows of a ball around a voxel's centre.
#[derive(Debug)]
pub(super) struct BallRows {
    dims: [usize; 3],
    /// Offset of each row along y and z, and the ball's extent along x to either side.
    rows: Vec<([i64; 2], i64)>,
}

impl BallRows {
    /// The rows of a ball.
    pub(super) fn new(dims: [usize; 3], radius_voxels: f64) -> Self {
        let held = |[j, k]: [i64; 2]| Some(([j, k], half(radius_voxels, [j, k])?));
        Self { dims, rows: around(radius_voxels).filter_map(held).collect() }
    }

    /// Number of rows.
    pub(super) fn len(&self) -> usize {
        self.rows.len()
    }

    /// The runs around `voxel`, limited to the grid.
    pub(super) fn around(&self, voxel: usize) -> impl Iterator<Item = Range<usize>> + use<'_> {
        let [nx, ny, nz] = self.dims;
        let (i, j, k) = ((voxel % nx) as i64, (voxel / nx % ny) as i64, (voxel / (nx * ny)) as i64);
        self.rows.iter().filter_map(move |([dj, dk], half)| {
            let (j, k) = (j + dj, k + dk);
            let is_in = (0..ny as i64).contains(&j) && (0..nz as i64).contains(&k);
            let (first, end) = ((i - half).max(0), (i + half + 1).min(nx as i64));
            let row = (is_in && first < end).then(|| nx * (j as usize + ny * k as usize))?;
            Some(row + first as usize..row + end as usize)
        })
    }

    /// For every voxel of the grid, the number of `voxels` in the ball around it; the shape must be symmetric. Each voxel adds one
    /// along its rows: only the ends of rows are marked, and a running sum makes counts of them.
    pub(super) fn counts(&self, voxels: impl Iterator<Item = usize>) -> Vec<u32> {
        let mut change = vec![0i32; self.dims.iter().product::<usize>() + 1];
        for run in voxels.flat_map(|voxel| self.around(voxel)) {
            change[run.start] += 1;
            change[run.end] -= 1;
        }
        let mut here = 0;
        let sum = |change: i32| {
            here += change;
            here as u32
        };
        change.into_iter().map(sum).collect()
    }
}

/// Offsets of the rows that a ball may reach.
fn around(radius_voxels: f64) -> impl Iterator<Item = [i64; 2]> {
    let reach = radius_voxels.floor() as i64;
    (-reach..=reach).flat_map(move |k| (-reach..=reach).map(move |j| [j, k]))
}

/// Number of voxels to either side in a row of the ball.
fn half(radius_voxels: f64, [j, k]: [i64; 2]) -> Option<i64> {
    let squared = radius_voxels * radius_voxels - (j * j + k * k) as f64;
    (squared >= 0.0).then(|| squared.sqrt() as i64)
}

#[cfg(test)]
mod tests {
    use super::*;

    const DIMS: [usize; 3] = [9, 8, 7];

    fn squared(n: usize, center: [i64; 3]) -> f64 {
        let at = [n % 9, n / 9 % 8, n / 72];
        (0..3).map(|a| (at[a] as i64 - center[a]).pow(2) as f64).sum()
    }

    #[test]
    fn the_rows_of_a_ball_are_the_voxels_within_its_radius() {
        for (radius, center) in [(2.7f64, [4, 4, 3]), (3.0, [0, 7, 2]), (0.4, [8, 0, 6])] {
            let index = (center[0] + 9 * (center[1] + 8 * center[2])) as usize;
            let found: Vec<usize> = BallRows::new(DIMS, radius).around(index).flatten().collect();
            let expected: Vec<usize> = (0..504).filter(|n| squared(*n, center) <= radius * radius).collect();
            assert_eq!(found, expected);
        }
    }

    #[test]
    fn counts_of_all_balls_are_the_counts_of_each() {
        let voxels: Vec<usize> = (0..504).filter(|n| n * n % 7 < 3).collect();
        for radius in [0.4, 2.7, 3.0, 9.0] {
            let ball = BallRows::new(DIMS, radius);
            let counts = ball.counts(voxels.iter().copied());
            for (n, count) in counts.iter().enumerate().take(504) {
                let held = ball.around(n).flatten().filter(|voxel| voxels.contains(voxel)).count();
                assert_eq!(*count as usize, held, "{radius} at {n}");
            }
        }
    }
}
