//! Exact volumes of voxels inside a ball: the partial volumes V_i of Dillon's equations (1) and (2).
//!
//! With B(a, b, c) the volume of {unit ball, x ≥ a, y ≥ b, z ≥ c} for a, b, c ≥ 0, a box in the first octant holds the
//! signed sum of B over its corners; any box is cut at the coordinate planes and mirrored into it. The published form
//!
//! ```text
//! B = (S − a A_a − b A_b − c A_c)/3
//! ```
//!
//! separates into functions of two coordinates at most,
//!
//! ```text
//! 3 B = P(a,b) + P(b,c) + P(c,a) + G(a) + G(b) + G(c) − π − 3abc      where a² + b² + c² < 1, else 0
//! P(a,b) = θ_ab + (a + aρ_a²/2) α_ab + (b + bρ_b²/2) α_ba + ab√(1−a²−b²)
//! G(a)   = −(π/2)(a + aρ_a²/2)
//! α_ab = atan2(b, √(1−a²−b²)),  θ_ab = atan2(√(1−a²−b²), ab),  ρ_a² = 1−a²
//! ```
//!
//! so that a block of voxels needs its transcendental functions once per pair of lattice coordinates, not per voxel, and a
//! voxel wholly inside or outside none at all. Precision: 4e-15 r³ (2.4e-15 r³ was the most between orders of the axes over
//! 150 000 boxes).
//!
//! **Source:** docs/force-model.md 8, by the divergence theorem and Gauss–Bonnet; the separation into pairs is ours.

use std::f64::consts::{FRAC_PI_2, PI};
use std::ops::Range;

use bonemill_geometry::{Frame, Grid, Point};

/// A volume below this part of its voxel is dropped: it is of the size of the rounding.
const DROP: f64 = 1e-13;

/// Volume of the box `lo_mm`..`hi_mm` inside the ball of `radius_mm` about the origin, mm³; 0 for an empty box or ball.
pub fn ball_box_volume(radius_mm: f64, lo_mm: [f64; 3], hi_mm: [f64; 3]) -> f64 {
    let is_box = (0..3).all(|a| hi_mm[a] > lo_mm[a]);
    // false for NaN, too
    let is_there = radius_mm > 0.0 && is_box;
    if !is_there {
        return 0.0;
    }
    // per axis: the parts on either side of 0, mirrored to be positive
    let mut parts = [[[0.0; 2]; 2]; 3];
    for axis in 0..3 {
        let (lo, hi) = (lo_mm[axis] / radius_mm, hi_mm[axis] / radius_mm);
        parts[axis] = [[lo.max(0.0), hi.max(0.0)], [(-hi).max(0.0), (-lo).max(0.0)]];
    }
    let [xs, ys, zs] = parts;
    let mut volume = 0.0;
    for x in xs {
        for y in ys {
            for z in zs {
                volume += octant_box(x, y, z);
            }
        }
    }
    let whole = (0..3).map(|a| hi_mm[a] - lo_mm[a]).product();
    settle(volume * radius_mm.powi(3), whole)
}

/// Clips rounding: to [0, voxel], and nothing below [`DROP`].
#[inline]
fn settle(volume: f64, whole: f64) -> f64 {
    if volume < DROP * whole { 0.0 } else { volume.min(whole) }
}

/// Volume of a box in the first octant of the unit ball.
fn octant_box(x: [f64; 2], y: [f64; 2], z: [f64; 2]) -> f64 {
    let inside = |a: f64, b: f64, c: f64| a * a + b * b + c * c < 1.0;
    if x[1] <= x[0] || y[1] <= y[0] || z[1] <= z[0] || !inside(x[0], y[0], z[0]) {
        return 0.0;
    }
    if inside(x[1], y[1], z[1]) {
        return (x[1] - x[0]) * (y[1] - y[0]) * (z[1] - z[0]);
    }
    let mut volume = 0.0;
    for corner in 0..8usize {
        let (a, b, c) = (x[corner & 1], y[corner >> 1 & 1], z[corner >> 2]);
        if inside(a, b, c) {
            let three_b = pair(a, b) + pair(b, c) + pair(c, a) + single(a) + single(b) + single(c);
            let tail = (three_b - PI) / 3.0 - a * b * c;
            volume += if corner.count_ones() % 2 == 0 { tail } else { -tail };
        }
    }
    volume
}

/// a + a(1 − a²)/2: the weight of α_ab in P.
#[inline]
fn weight(a: f64) -> f64 {
    a * (1.5 - 0.5 * a * a)
}

/// G(a).
#[inline]
fn single(a: f64) -> f64 {
    -FRAC_PI_2 * weight(a)
}

/// P(a, b) for a, b ≥ 0; outside the unit circle its continuation by 0 roots, which no corner uses.
#[inline]
fn pair(a: f64, b: f64) -> f64 {
    let root = (1.0 - a * a - b * b).max(0.0).sqrt();
    atan2_first(root, a * b)
        + weight(a) * atan2_first(b, root)
        + weight(b) * atan2_first(a, root)
        + a * b * root
}

/// atan2(y, x) for y, x ≥ 0, to 1 unit in the last place or two, without branches, so that rows of it vectorise.
///
/// Argument reduction to |z| ≤ tan(π/8) about 0, π/4, π/2, then a rational approximation of degree 4/5 in z².
/// **Source:** Cephes `atan.c` (Moshier), coefficients P, Q; 0 at (0, 0).
#[inline]
fn atan2_first(y: f64, x: f64) -> f64 {
    const TAN_PI_8: f64 = 0.414_213_562_373_095_03;
    const FRAC_PI_4: f64 = std::f64::consts::FRAC_PI_4;
    // what the reduced constants lose to rounding
    const MORE: f64 = 6.123_233_995_736_766e-17;
    let (low, high) = (y <= TAN_PI_8 * x, x <= TAN_PI_8 * y);
    let num = if low {
        y
    } else if high {
        -x
    } else {
        y - x
    };
    let den = if low {
        x
    } else if high {
        y
    } else {
        y + x
    };
    let (offset, more) = if low {
        (0.0, 0.0)
    } else if high {
        (FRAC_PI_2, MORE)
    } else {
        (FRAC_PI_4, 0.5 * MORE)
    };
    let z = num / if den > 0.0 { den } else { 1.0 };
    let s = z * z;
    let p = (((-8.750_608_600_031_904e-1 * s - 1.615_753_718_733_365e1) * s - 7.500_855_792_314_705e1) * s
        - 1.228_866_684_490_136_1e2)
        * s
        - 6.485_021_904_942_025e1;
    let q = ((((s + 2.485_846_490_142_306_3e1) * s + 1.650_270_098_316_988_6e2) * s
        + 4.328_810_604_912_903e2)
        * s
        + 4.853_903_996_359_137e2)
        * s
        + 1.945_506_571_482_614e2;
    offset + (z + (z * s * (p / q) + more))
}

/// One axis of a block of voxels around a ball, in radii.
#[derive(Debug, Default)]
struct Axis {
    /// Distances of the lattice planes from the centre, along the axis, with a plane of its own at 0 where the centre lies
    /// within a voxel: so every cell between two planes is on one side, and mirroring it is taking the magnitude.
    at: Vec<f64>,
    voxels: Vec<Span>,
}

/// One voxel's extent along one axis.
#[derive(Debug, Clone, Copy)]
struct Span {
    voxel: usize,
    /// Its first plane in `at`, and how many cells it has: 1, or 2 around the centre.
    plane: usize,
    cells: usize,
    /// Squares of its least and greatest distance from the centre.
    near2: f64,
    far2: f64,
}

impl Axis {
    /// The voxels of `lo..=hi` that reach into the ball. `center` is a continuous index.
    fn fill(&mut self, center: f64, spacing: f64, lo: usize, hi: usize) {
        self.at.clear();
        self.voxels.clear();
        let first = (center - 1.0 / spacing + 0.5).floor().max(lo as f64);
        let last = (center + 1.0 / spacing + 0.5).floor().min(hi as f64);
        // also nothing where the ball lies beyond either end
        if first > last {
            return;
        }
        // voxel v reaches from v − ½ to v + ½
        let plane = |voxel: usize| (voxel as f64 - 0.5 - center) * spacing;
        let (first, last) = (first as usize, last as usize);
        self.at.push(plane(first).abs());
        for voxel in first..=last {
            let (below, above) = (plane(voxel), plane(voxel + 1));
            let start = self.at.len() - 1;
            let astride = below < 0.0 && above > 0.0;
            if astride {
                self.at.push(0.0);
            }
            self.at.push(above.abs());
            let (near, far) = (below.abs().min(above.abs()), below.abs().max(above.abs()));
            let near2 = if astride { 0.0 } else { near * near };
            let cells = 1 + usize::from(astride);
            self.voxels.push(Span { voxel, plane: start, cells, near2, far2: far * far });
        }
    }
}

/// Reusable tables for the volumes of one ball after the other; once they have grown, nothing is allocated.
#[derive(Debug, Default)]
pub struct BallVolumes {
    axes: [Axis; 3],
    /// Of the two axes in its name, row after row of the second: P, to which xy adds G(x) + G(y) − π, and yz adds G(z).
    xy: Vec<f64>,
    xz: Vec<f64>,
    yz: Vec<f64>,
    /// The voxels that are wanted, in memory order.
    wanted: Vec<Wanted>,
}

/// A voxel that the ball reaches into: its index, its spans' places, and whether the ball holds all of it.
#[derive(Debug, Clone, Copy)]
struct Wanted {
    index: usize,
    spans: [usize; 3],
    is_whole: bool,
}

impl BallVolumes {
    /// Empty tables.
    pub fn new() -> Self {
        Self::default()
    }

    /// Calls `visit(index, volume_mm3)` in memory order for every voxel of the block `lo..=hi` (clipped to the grid) that the
    /// ball covers at least in part and that is wanted: `wanted` says which of a run of a row are, in order. The tables are
    /// filled around those.
    ///
    /// Nothing is visited for a radius that is not positive, or a centre or radius that is not finite.
    #[expect(
        clippy::too_many_arguments,
        reason = "where the ball is, and what is asked of it by two functions"
    )]
    pub fn for_each<F: Frame, W: IntoIterator<Item = usize>>(
        &mut self,
        grid: &Grid<F>,
        center: Point<F>,
        radius_mm: f64,
        [lo, hi]: [[usize; 3]; 2],
        wanted: impl Fn(Range<usize>) -> W,
        mut visit: impl FnMut(usize, f64),
    ) {
        if !(radius_mm > 0.0 && radius_mm.is_finite() && center.is_finite()) {
            return;
        }
        let (index, dims) = (grid.continuous_index(center), grid.dims());
        let spacing = grid.spacing_mm() / radius_mm;
        for a in 0..3 {
            self.axes[a].fill(index[a], spacing[a], lo[a], hi[a].min(dims[a] - 1));
        }
        if self.axes.iter().any(|axis| axis.voxels.is_empty()) {
            return;
        }
        let [xs, ys, zs] = &self.axes;
        self.wanted.clear();
        // of the planes of voxels on the ball's surface
        let mut planes = [[usize::MAX, 0]; 3];
        for (k, z) in (0..).zip(&zs.voxels) {
            for (j, y) in (0..).zip(&ys.voxels) {
                let (near2, far2) = (y.near2 + z.near2, y.far2 + z.far2);
                if near2 >= 1.0 {
                    continue;
                }
                let row = dims[0] * (y.voxel + dims[1] * z.voxel) + xs.voxels[0].voxel;
                for index in wanted(row..row + xs.voxels.len()) {
                    let i = index - row;
                    let x = &xs.voxels[i];
                    if x.near2 + near2 >= 1.0 {
                        continue;
                    }
                    let is_whole = x.far2 + far2 <= 1.0;
                    if !is_whole {
                        for ([first, last], span) in planes.iter_mut().zip([x, y, z]) {
                            *first = span.plane.min(*first);
                            *last = (span.plane + span.cells).max(*last);
                        }
                    }
                    self.wanted.push(Wanted { index, spans: [i, j, k], is_whole });
                }
            }
        }
        self.fill_pairs(planes.map(|[first, last]| first..last + 1));
        let (whole, scale) = (grid.voxel_mm3(), radius_mm.powi(3));
        for &Wanted { index, spans, is_whole } in &self.wanted {
            let [x, y, z] = [0, 1, 2].map(|a| &self.axes[a].voxels[spans[a]]);
            let volume = if is_whole { whole } else { settle(self.partial(x, y, z) * scale, whole) };
            if volume > 0.0 {
                visit(index, volume);
            }
        }
    }

    /// Volume of a voxel on the boundary of the unit ball.
    fn partial(&self, x: &Span, y: &Span, z: &Span) -> f64 {
        let mut volume = 0.0;
        for k in z.plane..z.plane + z.cells {
            for j in y.plane..y.plane + y.cells {
                for i in x.plane..x.plane + x.cells {
                    volume += self.cell(i, j, k);
                }
            }
        }
        volume
    }

    /// Volume of the cell between planes (i, j, k) and their successors. Its sign would be that of the octant.
    fn cell(&self, i: usize, j: usize, k: usize) -> f64 {
        let [x, y, z] = &self.axes;
        let (nx, ny) = (x.at.len(), y.at.len());
        let mut volume = 0.0;
        for corner in 0..8 {
            let (i, j, k) = (i + (corner & 1), j + (corner >> 1 & 1), k + (corner >> 2));
            let (a, b, c) = (x.at[i], y.at[j], z.at[k]);
            if a * a + b * b + c * c < 1.0 {
                let three_b = self.xy[i + nx * j] + self.xz[i + nx * k] + self.yz[j + ny * k];
                let tail = three_b / 3.0 - a * b * c;
                volume += if corner.count_ones() % 2 == 0 { tail } else { -tail };
            }
        }
        volume.abs()
    }

    /// Fills the tables between the given planes; beyond them they hold what an earlier ball left.
    fn fill_pairs(&mut self, [i, j, k]: [Range<usize>; 3]) {
        let [x, y, z] = &self.axes;
        let fill = |table: &mut Vec<f64>,
                    rows: (&Axis, &Range<usize>),
                    columns: (&Axis, &Range<usize>),
                    extra: fn(f64) -> f64| {
            let width = columns.0.at.len();
            table.resize(width * rows.0.at.len(), 0.0);
            for n in rows.1.clone() {
                let (b, row) = (rows.0.at[n], &mut table[width * n..width * (n + 1)]);
                let extra = extra(b);
                for (value, &a) in row[columns.1.clone()].iter_mut().zip(&columns.0.at[columns.1.clone()]) {
                    *value = pair(a, b) + extra;
                }
            }
        };
        fill(&mut self.xy, (y, &j), (x, &i), |b| single(b) - PI);
        fill(&mut self.xz, (z, &k), (x, &i), |_| 0.0);
        fill(&mut self.yz, (z, &k), (y, &j), single);
        // G(x), column by column
        let width = x.at.len();
        for n in j {
            let row = &mut self.xy[width * n..width * (n + 1)];
            for (value, &a) in row[i.clone()].iter_mut().zip(&x.at[i.clone()]) {
                *value += single(a);
            }
        }
    }
}

#[cfg(test)]
mod tests;
