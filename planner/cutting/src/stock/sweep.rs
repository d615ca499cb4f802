//! Finds the voxels inside a ball that moves along a straight line, and inside a straight cylinder. Removal, coverage and
//! access all use this kernel.
//!
//! A capsule is convex, so it meets a row of voxel centres in one interval, which has a closed form. The kernel passes one
//! row after the other to the caller, which accesses contiguous memory and tests no voxel twice. A voxel is inside if its
//! centre is.

mod cylinder;

use std::ops::{ControlFlow, Range};

use bonemill_geometry::{Grid, Point, Work, cancel};
use nalgebra::Vector3;

use self::cylinder::{Cylinder, Outline};

/// A grid of cubic voxels as rows along x.
///
/// Invariant: the grid's axes are the work frame's and its first voxel centre is the origin.
#[derive(Debug, Clone, Copy)]
pub struct Rows {
    dims: [usize; 3],
    spacing_mm: f64,
}

impl Rows {
    /// The rows of `grid`.
    pub fn of(grid: &Grid<Work>) -> Self {
        debug_assert!(
            grid.origin() == Point::new(0.0, 0.0, 0.0),
            "the work frame starts at the first centre"
        );
        Self::new(grid.dims(), grid.spacing_mm().x)
    }

    /// Rows of cubic voxels whose first centre is the origin.
    pub fn new(dims: [usize; 3], spacing_mm: f64) -> Self {
        Self { dims, spacing_mm }
    }

    /// Centres of the voxels of the row that contains voxel `first`, mm.
    pub fn centers_in_row(&self, first: usize) -> impl Fn(usize) -> Vector3<f64> {
        let [nx, ny, _] = self.dims;
        let (row, spacing_mm) = (first - first % nx, self.spacing_mm);
        let [y, z] = [first / nx % ny, first / (nx * ny)].map(|n| n as f64 * spacing_mm);
        move |voxel| Vector3::new((voxel - row) as f64 * spacing_mm, y, z)
    }

    /// Whether a voxel's centre lies within `radius_mm` of the segment a–b. It uses the same arithmetic as
    /// [`Self::within_capsule`], so that both decide alike for a voxel exactly on the surface.
    pub fn is_within(&self, voxel: usize, a: Point<Work>, b: Point<Work>, radius_mm: f64) -> bool {
        let [nx, ny, _] = self.dims;
        let chord = self.capsule(a, b, radius_mm).chord((voxel / nx % ny) as f64, (voxel / (nx * ny)) as f64);
        chord.is_some_and(|(lo, hi)| clip(lo, hi, nx).contains(&(voxel % nx)))
    }

    fn capsule(&self, a: Point<Work>, b: Point<Work>, radius_mm: f64) -> Capsule {
        let scale = 1.0 / self.spacing_mm;
        Capsule::new(a.coords * scale, b.coords * scale, radius_mm * scale)
    }

    /// Calls `visit` with every run of voxels (memory range) whose centres lie within `radius_mm` of the segment a–b.
    ///
    /// Parts outside the grid are left out. [`ControlFlow::Break`] stops it early.
    pub fn within_capsule(
        &self,
        a: Point<Work>,
        b: Point<Work>,
        radius_mm: f64,
        mut visit: impl FnMut(Range<usize>) -> ControlFlow<()>,
    ) -> ControlFlow<()> {
        self.within_capsule_where(a, b, radius_mm, &mut (), |(), _| true, |(), run| visit(run))
    }

    /// [`Self::within_capsule`] without the rows for which `may` returns false. `may` gets a run that contains all voxels of the
    /// row that the capsule can meet. Where most voxels in a ball are already removed, this test is cheaper than computing the
    /// interval.
    #[expect(clippy::too_many_arguments, reason = "the state is lent to both functions in turn")]
    pub fn within_capsule_where<S>(
        &self,
        a: Point<Work>,
        b: Point<Work>,
        radius_mm: f64,
        state: &mut S,
        may: impl Fn(&S, Range<usize>) -> bool,
        mut visit: impl FnMut(&mut S, Range<usize>) -> ControlFlow<()>,
    ) -> ControlFlow<()> {
        cancel::poll();
        if !(a.is_finite() && b.is_finite()) {
            return ControlFlow::Continue(());
        }
        let capsule = self.capsule(a, b, radius_mm);
        for k in capsule.extent(2, capsule.radius, self.dims[2]) {
            let Some(radius) = capsule.radius_at_z(k as f64) else { continue };
            // one voxel more at either end, because of rounding
            let xs = capsule.extent(0, radius, self.dims[0]);
            let xs = xs.start.saturating_sub(1)..(xs.end + 1).min(self.dims[0]);
            for j in capsule.extent(1, radius, self.dims[1]) {
                let row = self.dims[0] * (j + self.dims[1] * k);
                if !may(state, row + xs.start..row + xs.end) {
                    continue;
                }
                let Some((lo, hi)) = capsule.chord(j as f64, k as f64) else { continue };
                let run = clip(lo, hi, self.dims[0]);
                if !run.is_empty() {
                    visit(state, row + run.start..row + run.end)?;
                }
            }
        }
        ControlFlow::Continue(())
    }

    /// [`Self::within_capsule_where`] for a cylinder with flat ends, of `radius_mm` about `axis` (unit) through `center`, between
    /// two distances from `center`, mm. The run passed to `may` contains all voxels of the row that the cylinder can meet.
    #[expect(clippy::too_many_arguments, reason = "the state is lent to both functions in turn")]
    pub fn within_cylinder_where<S>(
        &self,
        (center, axis): (Point<Work>, &Vector3<f64>),
        ends_mm: [f64; 2],
        radius_mm: f64,
        state: &mut S,
        may: impl Fn(Range<usize>) -> bool,
        mut visit: impl FnMut(&mut S, Range<usize>) -> ControlFlow<()>,
    ) -> ControlFlow<()> {
        let scale = 1.0 / self.spacing_mm;
        let (center, ends, radius) = (center.coords * scale, ends_mm.map(|mm| mm * scale), radius_mm * scale);
        let (cylinder, outline) =
            (Cylinder::new(center, *axis, ends, radius), Outline::new(center, axis, ends, radius));
        for k in outline.layers(self.dims[2]) {
            let [places, rows] = outline.in_layer(k as f64, self.dims);
            if places.is_empty() {
                continue;
            }
            for j in rows {
                let row = self.dims[0] * (j + self.dims[1] * k);
                if !may(row + places.start..row + places.end) {
                    continue;
                }
                let Some((lo, hi)) = cylinder.chord(j as f64, k as f64) else { continue };
                let run = clip(lo, hi, self.dims[0]);
                if !run.is_empty() {
                    visit(state, row + run.start..row + run.end)?;
                }
            }
        }
        ControlFlow::Continue(())
    }
}

/// Whole numbers in [lo, hi] and in 0..n.
///
/// Computed by truncation, because rounding functions are calls on targets without SSE4.1, and this runs once per row.
#[inline]
fn clip(lo: f64, hi: f64, n: usize) -> Range<usize> {
    if !(hi >= 0.0 && lo <= n as f64) {
        return 0..0; // also if a value is NaN
    }
    let truncated = lo.max(0.0) as usize;
    let start = truncated + usize::from((truncated as f64) < lo);
    let end = (hi.min(n as f64) as usize + 1).min(n);
    if start < end { start..end } else { 0..0 }
}

/// A capsule in voxel units.
struct Capsule {
    a: Vector3<f64>,
    b: Vector3<f64>,
    length_squared: f64,
    between: Cylinder,
    radius_squared: f64,
    radius: f64,
}

impl Capsule {
    fn new(a: Vector3<f64>, b: Vector3<f64>, radius: f64) -> Self {
        let along = b - a;
        let length_squared = along.norm_squared();
        let between = Cylinder::new(a, along, [0.0, length_squared], radius);
        Self { a, b, length_squared, between, radius_squared: radius * radius, radius }
    }

    /// Voxels along `axis` within `radius` of the capsule's segment.
    fn extent(&self, axis: usize, radius: f64, n: usize) -> Range<usize> {
        let (lo, hi) = (self.a[axis].min(self.b[axis]), self.a[axis].max(self.b[axis]));
        clip(lo - radius, hi + radius, n)
    }

    /// The largest distance from the capsule's axis that points of the capsule have in the layer at z, with a margin for
    /// rounding.
    fn radius_at_z(&self, z: f64) -> Option<f64> {
        let beyond = (self.a.z.min(self.b.z) - z).max(z - self.a.z.max(self.b.z)).max(0.0);
        let squared = self.radius_squared * (1.0 + 1e-9) - beyond * beyond;
        (squared >= 0.0).then(|| squared.sqrt())
    }

    /// The interval of x in which (x, y, z) lies in the capsule.
    ///
    /// The capsule is the union of the balls at both ends and the cylinder between them. Each gives an interval, and because
    /// the union is convex the result is the hull of the intervals.
    fn chord(&self, y: f64, z: f64) -> Option<(f64, f64)> {
        let (mut lo, mut hi) = (f64::INFINITY, f64::NEG_INFINITY);
        let mut join = |part: Option<(f64, f64)>| {
            if let Some((l, h)) = part {
                (lo, hi) = (lo.min(l), hi.max(h));
            }
        };
        join(self.ball_chord(&self.a, y, z));
        if self.length_squared >= 1e-24 {
            join(self.ball_chord(&self.b, y, z));
            join(self.between.chord(y, z));
        }
        (lo <= hi).then_some((lo, hi))
    }

    #[inline]
    fn ball_chord(&self, c: &Vector3<f64>, y: f64, z: f64) -> Option<(f64, f64)> {
        let half_squared = self.radius_squared - (y - c.y).powi(2) - (z - c.z).powi(2);
        (half_squared >= 0.0).then(|| {
            let half = half_squared.sqrt();
            (c.x - half, c.x + half)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bonemill_geometry::capsule::segment_distance_squared;
    use proptest::prelude::*;

    const H: f64 = 0.3;

    fn grid() -> Grid<Work> {
        Grid::aligned([23, 19, 21], H, Point::new(0.0, 0.0, 0.0)).unwrap()
    }

    fn swept(a: [f64; 3], b: [f64; 3], r: f64) -> Vec<bool> {
        let mut inside = vec![false; grid().len()];
        let _ = Rows::of(&grid()).within_capsule(
            Point::from_coords(a.into()),
            Point::from_coords(b.into()),
            r,
            |run| {
                for n in run {
                    assert!(!inside[n], "voxel {n} visited twice");
                    inside[n] = true;
                }
                ControlFlow::Continue(())
            },
        );
        inside
    }

    fn brute(a: [f64; 3], b: [f64; 3], r: f64) -> impl Iterator<Item = f64> {
        let g = grid();
        (0..g.len()).map(move |n| {
            segment_distance_squared(&g.center(g.voxel(n)).coords, &a.into(), &b.into()).sqrt() - r
        })
    }

    proptest! {
        #[test]
        fn equals_the_distance_to_the_segment(
            a in prop::array::uniform3(-1.0f64..7.0),
            b in prop::array::uniform3(-1.0f64..7.0),
            axis in 0usize..5,
            r in 0.05f64..3.0,
        ) {
            // moves along an axis and moves of length 0 are common and have separate branches in the code
            let b = std::array::from_fn(|n| if axis < 3 && n != axis || axis == 4 { a[n] } else { b[n] });
            for (inside, beyond) in swept(a, b, r).into_iter().zip(brute(a, b, r)) {
                prop_assert!(inside == (beyond <= 0.0) || beyond.abs() < 1e-9, "{beyond}");
            }
        }
    }

    proptest! {
        #[test]
        fn a_flat_cylinder_holds_what_lies_beside_its_axis_between_its_ends(
            center in prop::array::uniform3(-1.0f64..7.0),
            axis in prop::array::uniform3(-1.0f64..1.0),
            along in 0usize..6,
            ends in prop::array::uniform2(-4.0f64..4.0),
            r in 0.05f64..2.0,
        ) {
            // axes along the grid's axes and in its planes have separate branches in the code
            let axis = std::array::from_fn(|n| if along < 3 && n != along || along == n + 3 { 0.0 } else { axis[n] });
            let Some(axis) = Vector3::from(axis).try_normalize(1e-3) else { return Ok(()) };
            let (center, ends) = (Point::from_coords(center.into()), [ends[0].min(ends[1]), ends[0].max(ends[1])]);
            let mut inside = vec![false; grid().len()];
            let asked = std::cell::RefCell::new(Vec::new());
            let may = |run: Range<usize>| { asked.borrow_mut().push(run); true };
            let _ = Rows::of(&grid()).within_cylinder_where((center, &axis), ends, r, &mut inside, may, |inside, run| {
                let asked = asked.borrow().last().cloned().unwrap();
                assert!(asked.start <= run.start && run.end <= asked.end, "{run:?} in {asked:?}");
                inside[run].fill(true);
                ControlFlow::Continue(())
            });
            let g = grid();
            for (n, inside) in inside.into_iter().enumerate() {
                let off = g.center(g.voxel(n)) - center;
                let at = off.dot(&axis);
                let beyond = ((off - axis * at).norm() - r).max(ends[0] - at).max(at - ends[1]);
                prop_assert!(inside == (beyond <= 0.0) || beyond.abs() < 1e-9, "{beyond}");
            }
        }
    }

    #[test]
    fn far_away_and_not_finite_touch_nothing() {
        assert!(!swept([99.0; 3], [120.0; 3], 2.0).contains(&true));
        assert!(!swept([f64::NAN; 3], [1.0; 3], 2.0).contains(&true));
    }
}
