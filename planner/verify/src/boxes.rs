//! Exact distance to a structure: the union of its closed label voxel boxes, on the label map's own grid.
//!
//! Whether a point is inside is looked up in the map. Outside, the nearest point lies on a voxel that has a neighbour (of 26)
//! without the label; a hierarchy of bounding boxes over these voxels finds it in about a microsecond. Coordinates are along
//! the grid's own axes, which are orthonormal, so oblique and mirrored maps need no special treatment.

use bonemill_geometry::{Ct, Grid, Point, Volume};
use nalgebra::Vector3;

/// Largest number of voxel boxes in a leaf.
const LEAF: usize = 8;

/// The voxels of one label.
#[derive(Debug)]
pub struct Boxes<'a> {
    labels: &'a Volume<u16, Ct>,
    label: u16,
    /// Half the size of a voxel, mm.
    half_mm: Vector3<f64>,
    /// Centres of the outer voxels, mm along the grid's axes from its origin; leaves are runs of them.
    centers_mm: Vec<Vector3<f64>>,
    nodes: Vec<Node>,
}

/// A node with a bounding box. Its left child follows it directly; the right one is at `right`.
#[derive(Debug, Clone, Copy)]
struct Node {
    lo_mm: Vector3<f64>,
    hi_mm: Vector3<f64>,
    /// For a leaf, its run of centres.
    run: [u32; 2],
    /// For an inner node, its right child; 0 for a leaf.
    right: u32,
}

impl<'a> Boxes<'a> {
    /// The voxels of `label`; `None` when there are none.
    pub fn new(labels: &'a Volume<u16, Ct>, label: u16) -> Option<Self> {
        let grid = labels.grid();
        let spacing = grid.spacing_mm();
        let mut centers_mm = outer_voxels(labels, label, &spacing);
        if centers_mm.is_empty() {
            return None;
        }
        let half_mm = spacing * 0.5;
        let mut nodes = Vec::with_capacity(2 * centers_mm.len() / LEAF + 1);
        let count = centers_mm.len();
        split(&mut centers_mm, 0..count, &half_mm, &mut nodes);
        Some(Self { labels, label, half_mm, centers_mm, nodes })
    }

    /// Distance from `p`, mm; 0 inside. A point that is not finite has distance 0.
    pub fn distance_mm(&self, p: Point<Ct>) -> f64 {
        self.nearest(p).0
    }

    /// Distance from `p`, mm, and the nearest point of the structure; inside, (0, `p`).
    pub fn nearest(&self, p: Point<Ct>) -> (f64, Point<Ct>) {
        self.nearest_within(p, f64::INFINITY).unwrap_or((f64::INFINITY, p))
    }

    /// [`Boxes::nearest`] if it is nearer than `cut_mm`. With a small bound the search is fast where nothing is near.
    pub fn nearest_within(&self, p: Point<Ct>, cut_mm: f64) -> Option<(f64, Point<Ct>)> {
        let grid = self.labels.grid();
        if !p.is_finite() || holds(self.labels, self.label, p) {
            return Some((0.0, p));
        }
        let at = along(grid, p);
        let mut best = (cut_mm * cut_mm, None);
        // each level leaves at most one child on the stack, and there are fewer levels than bits in a run's length
        let mut stack = [0u32; 64];
        let mut left = 1;
        while left > 0 {
            left -= 1;
            let n = stack[left];
            let Some(node) = self.nodes.get(n as usize) else { continue };
            if node.squared(&at) >= best.0 {
                continue;
            }
            if node.right == 0 {
                for center in &self.centers_mm[node.run[0] as usize..node.run[1] as usize] {
                    let q = at.sup(&(center - self.half_mm)).inf(&(center + self.half_mm));
                    let squared = (q - at).norm_squared();
                    if squared < best.0 {
                        best = (squared, Some(q));
                    }
                }
                continue;
            }
            // the nearer child is pushed last, so it is searched first
            let children = [n + 1, node.right];
            let far = |c: u32| self.nodes.get(c as usize).map_or(f64::INFINITY, |c| c.squared(&at));
            let order = if far(children[0]) < far(children[1]) { [1, 0] } else { [0, 1] };
            for child in order {
                stack[left] = children[child];
                left += 1;
            }
        }
        let (squared, q) = best;
        q.map(|q| (squared.sqrt(), Point::from_coords(grid.origin().coords + grid.axes() * q)))
    }

    /// A lower bound of the distance of the straight line from `a` to `b` from the structure, mm, at most `cut_mm`. It is too
    /// small by at most half a voxel's diagonal, and 0 where the line meets the structure or is not finite.
    pub fn kept_by_line(&self, a: Point<Ct>, b: Point<Ct>, cut_mm: f64) -> f64 {
        // a line that begins outside meets an outer voxel before an inner one
        if !(a.is_finite() && b.is_finite()) || holds(self.labels, self.label, a) {
            return 0.0;
        }
        let line = Line::new(along(self.labels.grid(), a), along(self.labels.grid(), b));
        let half_diagonal_mm = self.half_mm.norm();
        let mut least = cut_mm;
        let mut stack = [0u32; 64];
        let mut left = 1;
        while left > 0 {
            left -= 1;
            let n = stack[left];
            let Some(node) = self.nodes.get(n as usize) else { continue };
            let (middle, reach_mm) = node.ball();
            if line.squared(&middle) >= (least + reach_mm).powi(2) {
                continue;
            }
            if node.right == 0 {
                for center in &self.centers_mm[node.run[0] as usize..node.run[1] as usize] {
                    least = least.min((line.squared(center).sqrt() - half_diagonal_mm).max(0.0));
                }
                continue;
            }
            for child in [n + 1, node.right] {
                stack[left] = child;
                left += 1;
            }
        }
        least
    }
}

/// A straight line between two points, mm along the grid's axes.
struct Line {
    from: Vector3<f64>,
    way: Vector3<f64>,
    /// 1/|way|², 0 for a point.
    per_squared: f64,
}

impl Line {
    fn new(from: Vector3<f64>, to: Vector3<f64>) -> Self {
        let way = to - from;
        let squared = way.norm_squared();
        Self { from, way, per_squared: if squared > 0.0 { squared.recip() } else { 0.0 } }
    }

    /// Squared distance of a point, mm².
    fn squared(&self, p: &Vector3<f64>) -> f64 {
        let d = p - self.from;
        let t = (d.dot(&self.way) * self.per_squared).clamp(0.0, 1.0);
        (d - self.way * t).norm_squared()
    }
}

impl Node {
    /// Centre and radius of the ball around the box, mm.
    fn ball(&self) -> (Vector3<f64>, f64) {
        ((self.lo_mm + self.hi_mm) * 0.5, 0.5 * (self.hi_mm - self.lo_mm).norm())
    }

    /// Squared distance from a point to the box, mm².
    fn squared(&self, at: &Vector3<f64>) -> f64 {
        (at.sup(&self.lo_mm).inf(&self.hi_mm) - at).norm_squared()
    }
}

/// A point's coordinates along the grid's axes from its origin, mm.
fn along(grid: &Grid<Ct>, p: Point<Ct>) -> Vector3<f64> {
    grid.axes().transpose() * (p - grid.origin())
}

fn holds(labels: &Volume<u16, Ct>, label: u16, p: Point<Ct>) -> bool {
    labels.grid().nearest(p).is_some_and(|v| *labels.get(v) == label)
}

/// Centres of the label's voxels that have a neighbour (of 26) without the label, or lie at the map's edge.
fn outer_voxels(labels: &Volume<u16, Ct>, label: u16, spacing_mm: &Vector3<f64>) -> Vec<Vector3<f64>> {
    let [nx, ny, nz] = labels.grid().dims();
    let data = labels.data();
    let is = |i: usize, j: usize, k: usize| data[i + nx * (j + ny * k)] == label;
    let covered = |i: usize, j: usize, k: usize| {
        let inside = i > 0 && j > 0 && k > 0 && i + 1 < nx && j + 1 < ny && k + 1 < nz;
        inside
            && (k - 1..k + 2)
                .all(|k| (j - 1..j + 2).all(|j| is(i - 1, j, k) && is(i, j, k) && is(i + 1, j, k)))
    };
    let mut found = Vec::new();
    for (row, values) in data.chunks_exact(nx).enumerate() {
        let (j, k) = (row % ny, row / ny);
        for (i, _) in values.iter().enumerate().filter(|(_, v)| **v == label) {
            if !covered(i, j, k) {
                found.push(Vector3::new(i as f64, j as f64, k as f64).component_mul(spacing_mm));
            }
        }
    }
    found
}

/// Appends the hierarchy over a run of centres, halved along its longest side; its depth is the logarithm of the run's length.
fn split(
    centers: &mut [Vector3<f64>],
    run: std::ops::Range<usize>,
    half_mm: &Vector3<f64>,
    nodes: &mut Vec<Node>,
) {
    let part = &mut centers[run.clone()];
    let inf = Vector3::repeat(f64::INFINITY);
    let (lo, hi) = part.iter().fold((inf, -inf), |(lo, hi), c| (lo.inf(c), hi.sup(c)));
    let here = nodes.len();
    let ends = [run.start as u32, run.end as u32];
    nodes.push(Node { lo_mm: lo - half_mm, hi_mm: hi + half_mm, run: ends, right: 0 });
    if part.len() <= LEAF {
        return;
    }
    let axis = (hi - lo).imax();
    let middle = part.len() / 2;
    part.select_nth_unstable_by(middle, |a, b| a[axis].total_cmp(&b[axis]));
    split(centers, run.start..run.start + middle, half_mm, nodes);
    nodes[here].right = nodes.len() as u32;
    split(centers, run.start + middle..run.end, half_mm, nodes);
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;

    /// Two lumps and a speck on an oblique, anisotropic map, mirrored or not.
    fn labels(mirrored: bool) -> Volume<u16, Ct> {
        let mut axes = Rotation3::new(Vector3::new(0.4, -0.2, 1.1)).into_inner();
        if mirrored {
            axes.set_column(1, &-axes.column(1));
        }
        let origin = Vector3::new(3.0, -7.0, 1.0);
        let grid = Grid::<Ct>::new([15, 13, 11], Vector3::new(0.4, 0.5, 0.9), axes, origin).unwrap();
        let data = (0..grid.len())
            .map(|n| {
                let [i, j, k] = grid.voxel(n);
                let lump = i < 6 && j > 3 && j < 11 && k < 7;
                let other = i > 9 && j > 8 && k > 6;
                u16::from(lump || other || [i, j, k] == [12, 1, 2]) * 5
            })
            .collect();
        Volume::new(grid, data).unwrap()
    }

    #[test]
    fn agrees_with_every_box_asked_one_by_one() {
        for mirrored in [false, true] {
            let labels = labels(mirrored);
            let grid = labels.grid();
            let boxes = Boxes::new(&labels, 5).unwrap();
            let half = grid.spacing_mm() * 0.5;
            for n in 0..3000 {
                let at = |m: usize, span: f64| ((n * m) % 1009) as f64 / 1009.0 * span - 3.0;
                let p = grid.at([at(7, 21.0), at(13, 19.0), at(29, 17.0)]);
                let x = along(grid, p);
                let brute = (0..grid.len())
                    .filter(|n| labels.data()[*n] == 5)
                    .map(|n| {
                        let [i, j, k] = grid.voxel(n).map(|v| v as f64);
                        let c = Vector3::new(i, j, k).component_mul(&grid.spacing_mm());
                        (x.sup(&(c - half)).inf(&(c + half)) - x).norm()
                    })
                    .fold(f64::INFINITY, f64::min);
                let (found, nearest) = boxes.nearest(p);
                assert!((found - brute).abs() < 1e-9, "{p:?}: {found} against {brute}");
                assert!((p.distance_mm(&nearest) - found).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn a_line_keeps_no_more_than_its_nearest_place_and_little_less() {
        let labels = labels(true);
        let grid = labels.grid();
        let boxes = Boxes::new(&labels, 5).unwrap();
        let (mut met, mut kept) = (0, 0);
        for n in 0..600 {
            let at = |m: usize, span: f64| ((n * m) % 1009) as f64 / 1009.0 * span - 4.0;
            let a = grid.at([at(7, 23.0), at(13, 21.0), at(29, 19.0)]);
            let b = if n % 9 == 0 { a } else { grid.at([at(83, 23.0), at(5, 21.0), at(131, 19.0)]) };
            let places = (0..=400).map(|i| Point::from_coords(a.coords.lerp(&b.coords, i as f64 / 400.0)));
            let true_mm = places.map(|p| boxes.distance_mm(p)).fold(f64::INFINITY, f64::min);
            let step_mm = a.distance_mm(&b) / 800.0;
            let said_mm = boxes.kept_by_line(a, b, 2.5);
            assert!(said_mm <= true_mm + 1e-9, "{a:?} {b:?}: {said_mm} above {true_mm}");
            let least_mm = (true_mm - step_mm - boxes.half_mm.norm()).min(2.5);
            assert!(said_mm >= least_mm - 1e-9, "{a:?} {b:?}: {said_mm} of {true_mm}");
            met += usize::from(true_mm == 0.0);
            kept += usize::from(said_mm > 0.5);
        }
        assert!(met > 50 && kept > 50, "{met} {kept}");
        // a line that lies deep inside
        let inner = grid.center([2, 6, 2]);
        assert_eq!(boxes.kept_by_line(inner, inner, 2.5), 0.0);
        assert_eq!(boxes.kept_by_line(Point::new(f64::NAN, 0.0, 0.0), inner, 2.5), 0.0);
    }

    #[test]
    fn inside_is_0_and_an_absent_label_is_none() {
        let labels = labels(false);
        let boxes = Boxes::new(&labels, 5).unwrap();
        assert_eq!(boxes.distance_mm(labels.grid().center([3, 6, 3])), 0.0);
        assert_eq!(boxes.distance_mm(Point::new(f64::NAN, 0.0, 0.0)), 0.0);
        assert!(Boxes::new(&labels, 6).is_none());
    }
}
