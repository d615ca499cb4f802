//! Removal times on a grid: dilated, pooled into blocks, and looked up at points.

use bonemill_cutting::stock::removal::NEVER;
use bonemill_geometry::{Grid, Work, cancel};
use nalgebra::Vector3;
use rayon::prelude::*;

use super::eighth_times::EighthTimes;
use super::solid::ShankObstacles;

/// Removal time of free voxels: before every move.
const FREE: f32 = -1.0;
/// Removal time of voxels that are never removed.
pub(super) const SOLID: f32 = f32::INFINITY;

/// T of each eighth of a voxel, [`FREE`] where it is empty. Single precision is exact, because a path has fewer than 2²⁴
/// waypoints.
pub(super) fn latest_of_eighths(solid: &ShankObstacles, eighths: &EighthTimes, voxel: usize) -> [f32; 8] {
    let (stays, goes) = (solid.stays(voxel), solid.goes(voxel));
    let time = if goes == 0 { [NEVER; 8] } else { eighths.of(solid.grid().voxel(voxel)) };
    std::array::from_fn(|n| match (stays >> n & 1, goes >> n & 1, time[n]) {
        (1, _, _) | (0, 1, NEVER) => SOLID,
        (_, 0, _) => FREE,
        (_, _, time) => time as f32,
    })
}

/// Distance from a voxel's centre to its corner, voxels.
const HALF_DIAGONAL: f64 = 0.866_025_403_784_438_6;
/// An upper bound of the rounding of a sample's position in a march, voxels.
const ROUNDING: f64 = 1e-5;
/// Number of values in one cache line.
const LINE: usize = 16;
/// Number of voxels in a run.
pub(super) const RUN: usize = 8;

/// An axis-aligned box in work, mm.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bounds {
    low_mm: Vector3<f64>,
    high_mm: Vector3<f64>,
}

impl Bounds {
    /// The box of all voxels of a grid along work's axes.
    pub(super) fn of(grid: &Grid<Work>) -> Self {
        let low_mm = grid.origin().coords - 0.5 * grid.spacing_mm();
        let size = Vector3::from(grid.dims().map(|n| n as f64)).component_mul(&grid.spacing_mm());
        Self { low_mm, high_mm: low_mm + size }
    }

    /// Whether it contains a point.
    #[inline]
    pub(super) fn holds(&self, p: &Vector3<f64>) -> bool {
        (0..3).all(|a| self.low_mm[a] <= p[a] && p[a] < self.high_mm[a])
    }

    /// Whether it contains a whole ball.
    pub(super) fn holds_ball(&self, p: &Vector3<f64>, radius_mm: f64) -> bool {
        self.holds(&p.add_scalar(-radius_mm)) && self.holds(&p.add_scalar(radius_mm))
    }

    /// The point of the box nearest to a point, to a millionth of a voxel of a planning grid.
    pub(super) fn nearest(&self, p: &Vector3<f64>) -> Vector3<f64> {
        p.sup(&self.low_mm).inf(&self.high_mm.add_scalar(-1e-7))
    }

    /// Where the ray center + t·axis, t ≥ 0, enters and leaves the box; enter > leave when it misses it.
    pub(super) fn crossing(&self, center: &Vector3<f64>, axis: &Vector3<f64>) -> (f64, f64) {
        let (mut enter, mut leave) = (0f64, f64::INFINITY);
        for a in 0..3 {
            let (low, high) = (self.low_mm[a] - center[a], self.high_mm[a] - center[a]);
            if axis[a].abs() < 1e-12 {
                if low > 0.0 || high < 0.0 {
                    return (f64::INFINITY, 0.0);
                }
            } else {
                let (t0, t1) = (low / axis[a], high / axis[a]);
                enter = enter.max(t0.min(t1));
                leave = leave.min(t0.max(t1));
            }
        }
        (enter, leave)
    }
}

/// A scalar per cubic voxel; free outside.
#[derive(Debug, Clone)]
pub(super) struct TimeField {
    /// Whether memory runs along z first, then y, then x; else along x first.
    is_z_first: bool,
    /// Voxels along the axes in memory's order.
    dims: [usize; 3],
    pub(super) spacing_mm: f64,
    /// Centre of the first voxel, mm in work.
    origin_mm: f64,
    /// Whether a voxel of the field is a block of grid voxels.
    pub(super) is_blocks: bool,
    pub(super) value: Vec<f32>,
}

impl TimeField {
    /// For each voxel, T of the eighth that is removed last; [`FREE`] where it is empty.
    pub(super) fn removal_time(solid: &ShankObstacles, eighths: &EighthTimes) -> Self {
        let grid = solid.grid();
        let of = |voxel: usize| {
            if solid.stays(voxel) != 0 {
                SOLID
            } else if solid.goes(voxel) != 0 {
                latest_of_eighths(solid, eighths, voxel).into_iter().fold(FREE, f32::max)
            } else {
                FREE
            }
        };
        Self::of_each(grid, of)
    }

    /// T of whole voxels, for a comparison of paths: a voxel is solid if at least half of its eighths are.
    pub(super) fn of_voxels(solid: &ShankObstacles, removal_time: &[u32]) -> Self {
        let most = |eighths: u8| eighths.count_ones() >= 4;
        let of = |voxel: usize| match (most(solid.stays(voxel)), most(solid.goes(voxel)), removal_time[voxel])
        {
            (true, _, _) | (false, true, NEVER) => SOLID,
            (false, true, time) => time as f32,
            (false, false, _) => FREE,
        };
        Self::of_each(solid.grid(), of)
    }

    fn of_each(grid: &Grid<Work>, of: impl Fn(usize) -> f32 + Sync + Send) -> Self {
        let value = (0..grid.len()).into_par_iter().with_min_len(1 << 14).map(of).collect();
        Self {
            is_z_first: false,
            dims: grid.dims(),
            spacing_mm: grid.spacing_mm().x,
            origin_mm: 0.0,
            is_blocks: false,
            value,
        }
    }

    /// Blocks of `factor`³ voxels, each with its latest time, with a margin of `pad_mm` around, in which the handpiece can still
    /// meet voxels at the border. Memory runs along z first, because marches go mostly along z.
    pub(super) fn pooled(&self, factor: usize, pad_mm: f64) -> Self {
        let spacing_mm = self.spacing_mm * factor as f64;
        let pad = (pad_mm / spacing_mm).ceil() as usize + 2;
        let [nx, ny, nz] = self.dims;
        let [bz, by, bx] = [nz, ny, nx].map(|n| n.div_ceil(factor) + 2 * pad);
        let mut value = vec![FREE; bx * by * bz];
        // several slabs at once, because reading a row of voxels loads its neighbours into the cache
        let portion = LINE.div_ceil(factor).max(1);
        value[pad * by * bz..].par_chunks_mut(portion * by * bz).enumerate().for_each(|(n, slabs)| {
            let voxels = n * portion * factor..((n + 1) * portion * factor).min(nx);
            for j in 0..if voxels.is_empty() { 0 } else { ny } {
                cancel::poll();
                let row = pad + bz * (j / factor + pad);
                for k in 0..nz {
                    let source = nx * (j + ny * k);
                    let at = row + k / factor;
                    for (n, run) in self.value[source..][voxels.clone()].chunks(factor).enumerate() {
                        let block = &mut slabs[n * by * bz + at];
                        *block = run.iter().fold(*block, |latest, v| if *v > latest { *v } else { latest });
                    }
                }
            }
        });
        let first_center = 0.5 * (factor as f64 - 1.0) * self.spacing_mm;
        let origin_mm = first_center - pad as f64 * spacing_mm;
        Self { is_z_first: true, dims: [bz, by, bx], spacing_mm, origin_mm, is_blocks: factor > 1, value }
    }

    /// Latest time around each voxel: the maximum over a ball that covers the part of the cylinder nearest to a step of a march.
    ///
    /// A solid eighth in the cylinder is within √(ρ² + (s/2)²) of the nearest step of the march. The step is within half a
    /// voxel's diagonal of the centre of the voxel that is read. The eighth's centre is within a quarter of a diagonal of its
    /// voxel's centre; in a block, within half the block's diagonal.
    pub(super) fn dilated(self, radius_mm: f64) -> Self {
        let radius = self.ball_voxels(radius_mm);
        Self { value: ball_maximum(&self.value, self.dims, radius), ..self }
    }

    /// For each voxel, the latest time of the voxels whose centres are within `radius_mm` of its centre.
    pub(super) fn within(self, radius_mm: f64) -> Self {
        Self { value: ball_maximum(&self.value, self.dims, radius_mm / self.spacing_mm), ..self }
    }

    /// For each voxel, the latest time within a ball so small that all its eighths are within `radius_mm` of every point of the
    /// voxel; `None` if there is no such ball. An eighth's centre is within a quarter of a diagonal of its voxel's centre; in a
    /// block, within half a diagonal.
    pub(super) fn surely_within(&self, radius_mm: f64) -> Option<Self> {
        let eighth = if self.is_blocks { HALF_DIAGONAL } else { 0.5 * HALF_DIAGONAL };
        let radius = radius_mm / self.spacing_mm - HALF_DIAGONAL - eighth - ROUNDING;
        let value = (radius >= 0.0).then(|| ball_maximum(&self.value, self.dims, radius))?;
        Some(Self { value, ..*self })
    }

    /// The latest time of the voxels that have points within `reach_mm` of a block of `side`³ voxels.
    pub(super) fn latest_around(&self, side: usize, reach_mm: f64) -> Self {
        let spacing_mm = self.spacing_mm * side as f64;
        // from the centre of one block to that of another, each half a diagonal from its farthest point
        let radius = reach_mm / spacing_mm + 2.0 * HALF_DIAGONAL + ROUNDING;
        let pad = radius.ceil() as usize;
        let (blocks, latest) = self.blocks(side);
        let dims = blocks.map(|n| n + 2 * pad);
        let mut value = vec![FREE; dims.iter().product()];
        for (row, latest) in latest.chunks_exact(blocks[0]).enumerate() {
            let [j, k] = [row % blocks[1] + pad, row / blocks[1] + pad];
            value[pad + dims[0] * (j + dims[1] * k)..][..blocks[0]].copy_from_slice(latest);
        }
        let first_center = self.origin_mm + 0.5 * (side as f64 - 1.0) * self.spacing_mm;
        Self {
            is_z_first: self.is_z_first,
            dims,
            spacing_mm,
            origin_mm: first_center - pad as f64 * spacing_mm,
            is_blocks: true,
            value: ball_maximum(&value, dims, radius),
        }
    }

    /// The radius of the ball of [`Self::dilated`], voxels.
    pub(super) fn ball_voxels(&self, radius_mm: f64) -> f64 {
        let radius = (radius_mm / self.spacing_mm).hypot(0.5) + HALF_DIAGONAL + ROUNDING;
        radius + if self.is_blocks { HALF_DIAGONAL } else { 0.5 * HALF_DIAGONAL }
    }

    /// The box of all voxels.
    pub(super) fn bounds(&self) -> Bounds {
        let low = self.origin_mm - 0.5 * self.spacing_mm;
        let size = Vector3::from(self.turned(self.dims.map(|n| n as f64 * self.spacing_mm)));
        Bounds { low_mm: Vector3::repeat(low), high_mm: Vector3::repeat(low) + size }
    }

    /// [`Bounds::crossing`] of the box of all voxels.
    pub(super) fn crossing(&self, center: &Vector3<f64>, axis: &Vector3<f64>) -> (f64, f64) {
        self.bounds().crossing(center, axis)
    }

    /// The value of the voxel that contains `p`; [`FREE`] outside.
    #[inline]
    pub(super) fn at(&self, p: &Vector3<f64>) -> f32 {
        self.voxel(p).map_or(FREE, |[i, j, k]| self.value[i + self.dims[0] * (j + self.dims[1] * k)])
    }

    /// Voxels along the axes in memory's order.
    #[inline]
    pub(super) fn dims(&self) -> [usize; 3] {
        self.dims
    }

    /// A point's coordinates along the axes in memory's order, in voxels; whole numbers are faces between voxels.
    #[inline]
    pub(super) fn place(&self, p: &Vector3<f64>) -> [f64; 3] {
        let scale = 1.0 / self.spacing_mm;
        self.turned([p.x, p.y, p.z]).map(|c| (c - self.origin_mm) * scale + 0.5)
    }

    /// Reorders coordinates from work's axes to memory's order, or back.
    #[inline]
    pub(super) fn turned(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        if self.is_z_first { [z, y, x] } else { [x, y, z] }
    }

    /// The voxel that contains `p`, along the axes in memory's order.
    #[inline]
    fn voxel(&self, p: &Vector3<f64>) -> Option<[usize; 3]> {
        // truncation rounds down values that are not negative
        let at = |v: f64, n: usize| (v >= 0.0 && v < n as f64).then_some(v as usize);
        let ([x, y, z], [nx, ny, nz]) = (self.place(p), self.dims);
        Some([at(x, nx)?, at(y, ny)?, at(z, nz)?])
    }

    /// The latest time in each run of [`RUN`] voxels in memory.
    pub(super) fn runs(&self) -> Vec<f32> {
        self.value.chunks(RUN).map(|run| run.iter().copied().fold(FREE, f32::max)).collect()
    }

    /// The latest time in each block of `side`³ voxels, and how many blocks there are along each axis.
    pub(super) fn blocks(&self, side: usize) -> ([usize; 3], Vec<f32>) {
        let dims = self.dims.map(|n| n.div_ceil(side));
        let mut value = vec![FREE; dims.iter().product()];
        for (row, voxels) in self.value.chunks_exact(self.dims[0]).enumerate() {
            let (j, k) = (row % self.dims[1] / side, row / self.dims[1] / side);
            let first = dims[0] * (j + dims[1] * k);
            for (block, voxels) in value[first..first + dims[0]].iter_mut().zip(voxels.chunks(side)) {
                *block = voxels.iter().fold(*block, |latest, v| latest.max(*v));
            }
        }
        (dims, value)
    }
}

/// Number of rows and of layers that are dilated together; with their surroundings they fit a core's cache.
const TILE: [usize; 2] = [32, 8];

/// Maximum over the ball of `radius` voxels around each voxel.
///
/// The ball is a stack of rows. Rows of equal half-width share one running maximum along memory; then each voxel needs one
/// comparison per row of the ball, in memory order. Tiles are processed one by one, so that memory is read once.
fn ball_maximum(value: &[f32], dims: [usize; 3], radius: f64) -> Vec<f32> {
    let [nx, ny, nz] = dims;
    let reach = radius.floor() as i64;
    let mut by_width: Vec<Vec<[i64; 2]>> = vec![Vec::new(); reach as usize + 1];
    for dk in -reach..=reach {
        for dj in -reach..=reach {
            let left = radius * radius - (dj * dj + dk * dk) as f64;
            if left >= 0.0 {
                by_width[left.sqrt().floor() as usize].push([dj, dk]);
            }
        }
    }
    let reach = reach as usize;
    let around = |from: usize, to: usize, n: usize| from.saturating_sub(reach)..(to + reach).min(n);
    let [tile_j, tile_k] = TILE;
    let mut out = value.to_vec();
    out.par_chunks_mut(nx * ny * tile_k).enumerate().for_each_init(Vec::new, |windows, (tile, slabs)| {
        let (first_k, count_k) = (tile * tile_k, slabs.len() / (nx * ny));
        let ks = around(first_k, first_k + count_k, nz);
        for first_j in (0..ny).step_by(tile_j) {
            cancel::poll();
            let end_j = (first_j + tile_j).min(ny);
            let js = around(first_j, end_j, ny);
            // each row has a margin at both ends, so that windows may extend beyond it
            let length = nx + 2 * reach;
            windows.clear();
            for k in ks.clone() {
                for j in js.clone() {
                    windows.resize(windows.len() + reach, FREE);
                    windows.extend_from_slice(&value[nx * (j + ny * k)..][..nx]);
                    windows.resize(windows.len() + reach, FREE);
                }
            }
            for (width, offsets) in by_width.iter().enumerate() {
                if width > 0 {
                    windows.chunks_exact_mut(length).for_each(widen);
                }
                for (k, slab) in (first_k..).zip(slabs.chunks_exact_mut(nx * ny)) {
                    for (j, target) in (first_j..end_j).zip(slab[nx * first_j..].chunks_exact_mut(nx)) {
                        for [dj, dk] in offsets {
                            let from =
                                [j.checked_add_signed(*dj as isize), k.checked_add_signed(*dk as isize)];
                            let [Some(j), Some(k)] = from else { continue };
                            if js.contains(&j) && ks.contains(&k) {
                                let row = length * (j - js.start + js.len() * (k - ks.start));
                                greatest(target, &windows[row + reach - width..][..nx]);
                            }
                        }
                    }
                }
            }
        }
    });
    out
}

/// Turns the maxima over `row[i..=i + 2w]` into those over `row[i..=i + 2w + 2]`, in place; the last two values become
/// invalid.
fn widen(row: &mut [f32]) {
    for i in 2..row.len() {
        let [a, b, c] = [row[i - 2], row[i - 1], row[i]];
        let ab = if a > b { a } else { b };
        row[i - 2] = if ab > c { ab } else { c };
    }
}

/// Replaces each value of `target` by the greater of it and its counterpart.
fn greatest(target: &mut [f32], source: &[f32]) {
    for (t, s) in target.iter_mut().zip(source) {
        *t = if *s > *t { *s } else { *t };
    }
}

#[cfg(test)]
impl TimeField {
    /// A field that is free except for some voxels.
    pub(super) fn of_test(
        dims: [usize; 3],
        spacing_mm: f64,
        is_z_first: bool,
        solid: &[(usize, f32)],
    ) -> Self {
        let mut value = vec![FREE; dims.iter().product()];
        solid.iter().for_each(|(voxel, latest)| value[*voxel] = *latest);
        Self { is_z_first, dims, spacing_mm, origin_mm: 0.0, is_blocks: false, value }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(bonemill_geometry::fixed!(40))]
        /// Tested on grids of one tile and of several.
        #[test]
        fn the_ball_maximum_is_the_maximum_over_the_ball(
            value in prop::collection::vec(-1.0f32..9.0, 5 * 37 * 11), radius in 0.0f64..4.5, is_small in any::<bool>(),
        ) {
            let dims: [usize; 3] = if is_small { [7, 6, 5] } else { [5, 37, 11] };
            let value = &value[..dims.iter().product()];
            let fast = ball_maximum(value, dims, radius);
            let at = |n: usize| [n % dims[0], n / dims[0] % dims[1], n / (dims[0] * dims[1])].map(|c| c as f64);
            for (n, found) in fast.iter().enumerate() {
                let near = |m: &usize| {
                    (0..3).map(|a| (at(n)[a] - at(*m)[a]).powi(2)).sum::<f64>() <= radius * radius
                };
                let slow = (0..value.len()).filter(near).map(|m| value[m]).fold(FREE, f32::max);
                prop_assert_eq!(*found, slow);
            }
        }
    }

    /// Compared with all possible eighths, for voxels and for blocks.
    #[test]
    fn what_is_surely_within_is_within_of_every_point_of_the_voxel() {
        for factor in [1, 2, 3] {
            let solid = [(3 + 14 * (5 + 14 * 9), 1.0)];
            let field = TimeField::of_test([14, 14, 14], 0.2, false, &solid);
            for radius_mm in [0.7, 0.9, 1.3, 1.345, 1.9] {
                let pooled = field.pooled(factor, 0.0);
                let Some(within) = pooled.surely_within(radius_mm) else { continue };
                // the farthest eighth of the one solid voxel, from the corners of each voxel in whose ball it lies
                let center = Vector3::new(3.0, 5.0, 9.0) * 0.2;
                let [bz, by, _] = within.dims;
                for n in (0..within.value.len()).filter(|n| within.value[*n] > FREE) {
                    let at = Vector3::from([n / (bz * by), n / bz % by, n % bz].map(|v| v as f64));
                    let middle = at * within.spacing_mm + Vector3::repeat(within.origin_mm);
                    let reach = (middle - center).map(|d| d.abs() + 0.5 * within.spacing_mm + 0.25 * 0.2);
                    assert!(reach.norm() <= radius_mm, "{factor}: {} beyond {radius_mm}", reach.norm());
                }
            }
        }
    }

    /// Compared with all places around, in the field and beyond it.
    #[test]
    fn what_is_latest_around_a_place_is_no_earlier_than_what_any_place_around_has() {
        let times: Vec<(usize, f32)> = (0..40).map(|n| (n * 7919 % (11 * 9 * 13), n as f32)).collect();
        for is_z_first in [true, false] {
            let field = TimeField::of_test([11, 9, 13], 0.3, is_z_first, &times);
            for (side, reach_mm) in [(1, 0.4), (2, 0.7), (3, 0.0), (2, 1.5)] {
                let around = field.latest_around(side, reach_mm);
                for n in 0..4000u32 {
                    let part = |k: u32| f64::from(n * k % 3989) / 3989.0 - 0.5;
                    let p = Vector3::new(part(17), part(101), part(977)).add_scalar(0.5) * 8.0
                        - Vector3::repeat(2.0);
                    let off = Vector3::new(part(211), part(31), part(503)).normalize() * reach_mm;
                    assert!(field.at(&(p + off)) <= around.at(&p), "{p}");
                }
            }
        }
    }

    #[test]
    fn pooling_keeps_the_latest_time_of_every_block() {
        let times: Vec<(usize, f32)> = (0..60).map(|n| (n, n as f32)).collect();
        let field = TimeField::of_test([5, 4, 3], 0.5, false, &times);
        let coarse = field.pooled(2, 1.0);
        for n in 0..60usize {
            let p = Vector3::new((n % 5) as f64, (n / 5 % 4) as f64, (n / 20) as f64) * 0.5;
            assert!(coarse.at(&p) >= n as f32);
        }
        assert_eq!(coarse.at(&Vector3::repeat(-1.3)), FREE);
        assert_eq!(coarse.value.iter().copied().fold(FREE, f32::max), 59.0);
    }
}
