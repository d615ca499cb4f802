//! Engagement of the burr at a waypoint: the material at its surface that no earlier move has removed.
//!
//! The force is a sum over points of the ball's surface, each with a patch around it. A point is in bone when the density in
//! the images is above 0 there and no earlier part of the path covers the point. This geometry is exact, has no state and
//! does not depend on the step. A patch that the edge of an earlier part crosses counts by its share. The path is merged
//! into straight runs, and only runs near the burr are tested. Where all eight voxels around a point have similar removal
//! times, these decide at once; the exact test is needed only for points near a boundary.
//!
//! An arm rounds corners of its path ([`RoundedCorner`]). The skin that it leaves there, some micrometres thick, gives nearly the full force when a later
//! move cuts it, since a force depends on the area that cuts and not on its depth. So the runs are those of the driven path. A skin lies on the ball
//! around its corner, and only a move that comes back to the corner meets much of it at once: there removal times, which know nothing of skins, decide nothing.

mod driven;
mod masses;
mod times;

pub use self::driven::RoundedCorner;
pub use self::masses::{Increments, mass_increments, mass_increments_by_voxels};

use crate::scene::Scene;
use bonemill_cutting::burr::{BoneAround, Patch, TILE_REACH};
use bonemill_cutting::cutter::Ball;
use bonemill_cutting::stock::removal::RemovalTime;
use bonemill_cutting::stock::runs::{Run, straight_runs};
use bonemill_geometry::Point;
use bonemill_geometry::capsule::segment_distance_squared;
use nalgebra::{Unit, Vector3};

use self::driven::{DrivenPath, comes_back};
use self::times::{CellTimes, LastTimes, cell_times};
use crate::path::PathPoint;

/// Side of a cell of the run index, mm.
const CELL_MM: f64 = 2.0;
/// Half the sum of a patch's sides is at most this share of the burr's radius.
const LARGEST_PATCH: f64 = 0.1;

/// The path as straight runs with an index by position.
#[derive(Debug)]
pub struct SweptPath<'a> {
    scene: &'a Scene,
    times: Vec<CellTimes>,
    last_times: LastTimes,
    path: DrivenPath,
    /// Where the move to each waypoint comes back to an earlier rounded corner, as a share of its way.
    comes_back: Vec<Option<f64>>,
    radius_mm: f64,
    dims: [usize; 3],
    per_mm: f64,
    runs: Vec<Run>,
    cells: [usize; 3],
    runs_in_cell: Vec<Vec<u32>>,
}

impl<'a> SweptPath<'a> {
    /// Indexes the runs of a path through its waypoints.
    pub fn new(scene: &'a Scene, removal: &RemovalTime, points: &[PathPoint], ball: Ball) -> Self {
        Self::driven(scene, removal, points, ball, &[])
    }

    /// Indexes the runs of a path whose `corners`, in the path's order, are rounded.
    pub fn driven(
        scene: &'a Scene,
        removal: &RemovalTime,
        points: &[PathPoint],
        ball: Ball,
        corners: &[RoundedCorner],
    ) -> Self {
        let Ball { radius_mm } = ball;
        let path = DrivenPath::new(points, corners);
        let at = &path.vertices;
        let runs = straight_runs(0..at.len() as u32, |n| Point::from_coords(at[n as usize]));
        let grid = scene.class.grid();
        let cells =
            [0, 1, 2].map(|a| (grid.dims()[a] as f64 * grid.spacing_mm()[a] / CELL_MM).ceil() as usize + 1);
        let times = cell_times(&scene.class, removal.time());
        let mut swept = Self {
            scene,
            last_times: LastTimes::new(&times, grid, TILE_REACH * radius_mm),
            times,
            comes_back: comes_back(points, corners),
            path,
            radius_mm,
            dims: grid.dims(),
            per_mm: 1.0 / grid.spacing_mm().x,
            runs,
            cells,
            runs_in_cell: vec![Vec::new(); cells.iter().product()],
        };
        swept.index_runs();
        swept
    }

    /// Lists each run in every cell in which the centre of a ball that the run can meet may lie: within 2r of the run.
    fn index_runs(&mut self) {
        let reach = 2.0 * self.radius_mm + 0.5 * 3f64.sqrt() * CELL_MM;
        for (number, run) in self.runs.iter().enumerate() {
            let (a, b) = (self.start(run), self.path.vertices[run.last as usize]);
            let (lo, hi) = (a.inf(&b) - Vector3::repeat(reach), a.sup(&b) + Vector3::repeat(reach));
            let range = |axis: usize| {
                let cell = |v: f64| ((v / CELL_MM).max(0.0) as usize).min(self.cells[axis] - 1);
                cell(lo[axis])..=cell(hi[axis])
            };
            for k in range(2) {
                for j in range(1) {
                    for i in range(0) {
                        let center = Vector3::new(i as f64 + 0.5, j as f64 + 0.5, k as f64 + 0.5) * CELL_MM;
                        if segment_distance_squared(&center, &a, &b) <= reach * reach {
                            let cell = i + self.cells[0] * (j + self.cells[1] * k);
                            self.runs_in_cell[cell].push(number as u32);
                        }
                    }
                }
            }
        }
    }

    /// The first of the eight voxels around a point; `None` where not all eight lie in the grid, which happens for no clear
    /// position of the burr.
    #[inline]
    fn cell(&self, p: &Vector3<f64>) -> Option<usize> {
        let [nx, ny, nz] = self.dims;
        let (x, y, z) = (p.x * self.per_mm, p.y * self.per_mm, p.z * self.per_mm);
        let inside = |c: f64, n: usize| c >= 0.0 && c < (n - 1) as f64;
        if !(inside(x, nx) && inside(y, ny) && inside(z, nz)) {
            return None;
        }
        Some(x as usize + nx * (y as usize + ny * z as usize))
    }

    fn start(&self, run: &Run) -> Vector3<f64> {
        self.path.vertices[run.start() as usize]
    }

    /// Distance from the axis of an earlier run within which bone is removed, mm. If the burr comes to the same place again,
    /// its surface points lie on the earlier surface; a margin for rounding counts them as inside.
    fn reach_mm(&self) -> f64 {
        self.radius_mm * (1.0 + 1e-12)
    }

    /// Distance from an earlier surface within which it may cross a patch, mm.
    fn patch_mm(&self) -> f64 {
        LARGEST_PATCH * self.radius_mm
    }

    /// Where the move to a waypoint comes back to a corner that the arm rounded before, as a share of its way: there it may cut the skin
    /// that was left.
    pub fn comes_back(&self, index: usize) -> Option<f64> {
        self.comes_back[index]
    }

    /// The bone that the burr meets at waypoint `index`: `weight_of` the density, sampled `sample_radius_mm` from the burr's
    /// centre.
    pub fn bone_at<W: Fn(f64) -> f64>(
        &self,
        index: u32,
        sample_radius_mm: f64,
        weight_of: W,
    ) -> BoneAt<'_, W> {
        let center = self.path.vertices[self.path.end_of[index as usize] as usize];
        let before = index.checked_sub(1).map(|before| self.path.end_of[before as usize]);
        self.bone_around(center, (index, before), sample_radius_mm, weight_of)
    }

    /// Whether the arm rounds the corner where the move to waypoint `index` ends.
    pub fn is_rounded(&self, index: usize) -> bool {
        self.path.rounding[index] > 0
    }

    /// Places in the rounded corners of the move to waypoint `index`, as shares of its way: at each of the `fractions` of the way from one
    /// vertex of a corner to the next.
    pub fn in_corners(&self, index: usize, fractions: &[f64]) -> Vec<f64> {
        self.path.in_corners(index, fractions)
    }

    /// The same at a share, 0 to 1, of the way of the move to waypoint `index`, and the direction in which the burr moves there; `None`
    /// where it does not move. Beyond 1: at the move's end, turned by the rest of the share to the direction of the next move.
    pub fn bone_within<W: Fn(f64) -> f64>(
        &self,
        (index, share): (u32, f64),
        sample_radius_mm: f64,
        weight_of: W,
    ) -> Option<(Unit<Vector3<f64>>, BoneAt<'_, W>)> {
        let place = self.path.place(index as usize, share)?;
        let bone = self.bone_around(place.center, (index, Some(place.before)), sample_radius_mm, weight_of);
        // what lies behind was swept on the way from the vertex before
        Some((place.direction, BoneAt { way: place.along.into_inner(), ..bone }))
    }

    /// The bone around a centre on the move to waypoint `index`, whose earlier path ends at vertex `before`.
    fn bone_around<W: Fn(f64) -> f64>(
        &self,
        center: Vector3<f64>,
        (index, before): (u32, Option<u32>),
        sample_radius_mm: f64,
        weight_of: W,
    ) -> BoneAt<'_, W> {
        let mut capsules = Vec::new();
        let at = |axis: usize| ((center[axis] / CELL_MM).max(0.0) as usize).min(self.cells[axis] - 1);
        let cell = at(0) + self.cells[0] * (at(1) + self.cells[1] * at(2));
        for run in self.runs_in_cell[cell].iter().map(|n| &self.runs[*n as usize]) {
            // runs are listed in the path's order
            let Some(before) = before.filter(|before| run.first <= *before) else { break };
            // the part of the run before; waypoint 0 is a ball
            let (a, b) = (self.start(run), self.path.vertices[run.last.min(before) as usize]);
            if segment_distance_squared(&center, &a, &b) < (2.0 * self.radius_mm).powi(2) {
                capsules.push(RunAxis::new(a, b));
            }
        }
        capsules.reverse();
        let knows_times = self.comes_back[index as usize].is_none();
        BoneAt {
            path: self,
            index,
            knows_times,
            center,
            way: Vector3::zeros(),
            sample_radius_mm,
            weight_of,
            capsules,
            in_reach: Vec::new(),
        }
    }
}

/// The bone before one move, around the position where the move ends.
#[derive(Debug)]
pub struct BoneAt<'a, W> {
    path: &'a SweptPath<'a>,
    index: u32,
    /// Whether removal times decide where they are alike.
    knows_times: bool,
    center: Vector3<f64>,
    /// Unit direction from the last vertex of the earlier path, if the burr turns on the way; else 0.
    way: Vector3<f64>,
    sample_radius_mm: f64,
    weight_of: W,
    /// The earlier runs within reach of the ball, the latest first, because it is the most likely one to contain a point.
    capsules: Vec<RunAxis>,
    /// Those within reach of the last queried neighbourhood.
    in_reach: Vec<RunAxis>,
}

impl<W> BoneAt<'_, W> {
    /// Share of a patch around `p` that no earlier part of the path has swept.
    fn share_left(&self, p: &Vector3<f64>, sides_mm: impl Fn(&Vector3<f64>) -> [f64; 2]) -> f64 {
        let certain = (self.path.reach_mm() - self.path.patch_mm()).max(0.0).powi(2);
        let mut nearest = (f64::INFINITY, Vector3::zeros());
        for capsule in &self.in_reach {
            let away = capsule.to(p);
            let squared = away.norm_squared();
            if squared <= certain {
                return 0.0;
            }
            if squared < nearest.0 {
                nearest = (squared, away);
            }
        }
        let distance = nearest.0.sqrt();
        let beyond = distance - self.path.reach_mm();
        if beyond >= self.path.patch_mm() {
            return 1.0;
        }
        share_beyond(beyond, sides_mm(&(nearest.1 / distance)))
    }
}

impl<W: Fn(f64) -> f64> BoneAround for BoneAt<'_, W> {
    /// Whether the neighbourhood may contain bone: not if all of it is removed before this move, or if one earlier run covers
    /// all of it. Also keeps only the runs that can cross a patch in the neighbourhood.
    fn is_near(&mut self, normal: &Vector3<f64>, reach: f64) -> bool {
        let p = self.center + normal * self.sample_radius_mm;
        let around_mm = reach * self.sample_radius_mm;
        if self.knows_times
            && self.path.last_times.around(&p, around_mm).is_some_and(|last| last < self.index)
        {
            return false;
        }
        let rounding_mm = 1e-9 * self.path.radius_mm;
        let slack_mm = self.path.patch_mm() + around_mm;
        let holds_all_mm = self.path.reach_mm() - slack_mm - rounding_mm;
        let touches_mm = self.path.reach_mm() + slack_mm + rounding_mm;
        let squares = |mm: f64| if mm > 0.0 { mm * mm } else { -1.0 };
        let (holds_all, touches) = (squares(holds_all_mm), squares(touches_mm));
        self.in_reach.clear();
        for capsule in &self.capsules {
            let squared = capsule.to(&p).norm_squared();
            if squared <= holds_all {
                return false;
            }
            if squared <= touches {
                self.in_reach.push(*capsule);
            }
        }
        true
    }

    /// `weight` of the density at a point of the burr's surface, times the share of the patch around it that no earlier part of
    /// the path covers.
    ///
    /// At the edges of earlier passes a sum over points has errors of whole patches; the share makes the sum smooth. On the
    /// scale of a patch the edge is straight, so the share depends only on its distance. The patch's sides, projected onto any
    /// unit direction, sum to at most a fifth of the burr's radius.
    #[inline]
    fn weight(&mut self, normal: &Vector3<f64>, patch: &Patch) -> f64 {
        if normal.dot(&self.way) < 0.0 {
            return 0.0;
        }
        let p = self.center + normal * self.sample_radius_mm;
        let Some(cell) = self.path.cell(&p) else { return 0.0 };
        let CellTimes { first, last } = self.path.times[cell];
        if self.knows_times && last < self.index {
            return 0.0;
        }
        let share = if first >= self.index { 1.0 } else { self.share_left(&p, |g| patch.sides_mm(g)) };
        if share > 0.0 {
            share * (self.weight_of)(self.path.scene.matter.density_g_cm3(Point::from_coords(p)))
        } else {
            0.0
        }
    }
}

/// The axis of a straight run of the path.
#[derive(Debug, Clone, Copy)]
struct RunAxis {
    from: Vector3<f64>,
    along: Vector3<f64>,
    /// 1/length²; 0 for a point.
    per_squared: f64,
}

impl RunAxis {
    fn new(from: Vector3<f64>, to: Vector3<f64>) -> Self {
        let along = to - from;
        let squared = along.norm_squared();
        Self { from, along, per_squared: if squared > 0.0 { 1.0 / squared } else { 0.0 } }
    }

    /// The vector from the nearest point of the axis to `p`.
    #[inline]
    fn to(&self, p: &Vector3<f64>) -> Vector3<f64> {
        let from = p - self.from;
        let t = (from.dot(&self.along) * self.per_squared).clamp(0.0, 1.0);
        from - self.along * t
    }
}

/// Share, 0..1, of a rectangle that lies beyond a straight edge. The rectangle's centre is at distance `beyond` beyond the
/// edge (negative: before it); `sides` are its sides projected onto the edge's normal, in the same unit. The share is the
/// distribution function of a sum of two uniform variables.
pub fn share_beyond(beyond: f64, [a, b]: [f64; 2]) -> f64 {
    let (wide, narrow) = (0.5 * a.max(b), 0.5 * a.min(b));
    if wide <= 0.0 {
        return if beyond > 0.0 { 1.0 } else { 0.0 };
    }
    // for a very narrow rectangle the corners change the result by less than rounding
    let narrow = narrow.max(1e-6 * wide);
    let ramp = |t: f64| 0.5 * t.max(0.0).powi(2);
    let sum = ramp(beyond + wide + narrow) - ramp(beyond + wide - narrow) - ramp(beyond - wide + narrow)
        + ramp(beyond - wide - narrow);
    (sum / (4.0 * wide * narrow)).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// The share is compared with counting points of a turned rectangle whose centre is before or beyond a straight edge.
        #[test]
        fn the_share_beyond_an_edge_is_the_share_of_points_beyond_it(
            beyond in -1.2f64..1.2, a in 0.05f64..1.0, b in 0.05f64..1.0, angle in 0.0f64..1.5,
        ) {
            let (s, c) = angle.sin_cos();
            const N: usize = 400;
            let at = |n: usize| (n as f64 + 0.5) / N as f64 - 0.5;
            let inside = (0..N * N).filter(|n| beyond + at(n % N) * a * c + at(n / N) * b * s > 0.0).count();
            let counted = inside as f64 / (N * N) as f64;
            prop_assert!((share_beyond(beyond, [a * c, b * s]) - counted).abs() < 5e-3);
        }
    }

    #[test]
    fn a_point_is_there_or_not() {
        assert_eq!([-0.1, 0.0, 0.1].map(|d| share_beyond(d, [0.0, 0.0])), [0.0, 0.0, 1.0]);
    }
}
