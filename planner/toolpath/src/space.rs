//! Free space of the burr's centre: free of obstacle bone, away from structures, and connected to the outside.
//!
//! A ball of radius r at c is clear when it contains no centre of an obstacle voxel and its surface is at least the
//! clearance away from every structure. Distances to obstacles are interpolated trilinearly from their field on the grid;
//! the field is convex towards each voxel, so the error is below h²·3/(8r), 0.02 mm at the default. Distances to structures
//! are computed exactly wherever bounds do not decide. The trajectory's possible deviation from its waypoints is added.

use crate::scene::{Class, Scene};
use bonemill_cutting::cutter::Ball;
use bonemill_geometry::{Grid, Point, Volume, Work, cancel};
use bonemill_imaging::{ImageError, StructureField, distance_within};
pub use bonemill_robot::timelaw::TRAJECTORY_TOLERANCE_MM;
use nalgebra::Vector3;
use rayon::prelude::*;

use bonemill_cutting::stock::sweep::Rows;

/// A move may pass nearer to obstacle bone than its ends by this much, mm: the field's error between grid nodes, so that a
/// move along a wall is not refused because of interpolation.
const PASSING_BONE_MM: f64 = 0.02;
/// The same for structures, mm: the deviation of a chord. The rest of the tolerance is for the trajectory's corners.
const PASSING_STRUCTURE_MM: f64 = 0.005;

/// Stored margins are limited to this, mm; a larger margin always decides.
const MARGIN_CUT_MM: f64 = 0.15;
/// Side of a block for which nearby structures are searched once, nodes.
const BLOCK: usize = 8;

/// Free space of the burr's centre.
#[derive(Debug)]
pub struct BurrSpace<'a> {
    scene: &'a Scene,
    /// Distance to obstacles, mm; `None` if there are none.
    obstacle_mm: Option<&'a Volume<f32, Work>>,
    radius_mm: f64,
    /// Least distance of the centre from each structure, mm.
    keep_mm: Vec<f64>,
    /// Margin of each node: its distance from all obstacles and structures beyond the required one, mm, limited to
    /// ±[`MARGIN_CUT_MM`].
    margin_mm: Volume<f32, Work>,
    /// Grid nodes that are clear and connected to the outside along the approach.
    connected: Vec<bool>,
    /// Target voxels that the ball covers at some connected node.
    reachable: Vec<bool>,
}

impl<'a> BurrSpace<'a> {
    /// Free space for a ball with one clearance per structure of the scene.
    ///
    /// # Errors
    /// When a distance field cannot be computed.
    pub fn new(scene: &'a Scene, ball: Ball, clearances_mm: &[f64]) -> Result<Self, ImageError> {
        let keep_mm = clearances_mm.iter().map(|c| ball.radius_mm + c + TRAJECTORY_TOLERANCE_MM).collect();
        Self::among(scene, scene.obstacle_mm.as_ref(), ball, keep_mm)
    }

    /// The free space of the same burr and clearances among other obstacles, given by the distance to them up to twice the
    /// radius, mm; `None` if there are none.
    ///
    /// # Errors
    /// When a distance field cannot be computed.
    pub fn among_others<'b>(
        &self,
        obstacle_mm: Option<&'b Volume<f32, Work>>,
    ) -> Result<BurrSpace<'b>, ImageError>
    where
        'a: 'b,
    {
        BurrSpace::among(self.scene, obstacle_mm, self.ball(), self.keep_mm.clone())
    }

    fn among(
        scene: &'a Scene,
        obstacle_mm: Option<&'a Volume<f32, Work>>,
        Ball { radius_mm }: Ball,
        keep_mm: Vec<f64>,
    ) -> Result<Self, ImageError> {
        let margin_mm = Volume::filled(scene.class.grid().clone(), 0.0);
        let mut space = Self {
            scene,
            obstacle_mm,
            radius_mm,
            keep_mm,
            margin_mm,
            connected: Vec::new(),
            reachable: Vec::new(),
        };
        let margins = space.node_margins();
        space.margin_mm.data_mut().copy_from_slice(&margins);
        let clear = margins.into_iter().map(|m| m >= 0.0).collect();
        space.connected = connected_to_top(space.grid(), clear, radius_mm);
        space.reachable = space.covered_target()?;
        Ok(space)
    }

    /// The planning grid.
    pub fn grid(&self) -> &Grid<Work> {
        self.scene.class.grid()
    }

    /// The scene it belongs to.
    pub fn scene(&self) -> &Scene {
        self.scene
    }

    /// The ball.
    pub fn ball(&self) -> Ball {
        Ball { radius_mm: self.radius_mm }
    }

    /// The ball's radius, mm.
    pub fn radius_mm(&self) -> f64 {
        self.radius_mm
    }

    /// Approximate number of voxels in a ball of the burr's radius.
    pub fn ball_voxels(&self) -> f64 {
        4.19 * self.radius_mm.powi(3) / self.grid().voxel_mm3()
    }

    /// Least distance of the burr's centre from each structure, mm.
    pub fn keep_mm(&self) -> &[f64] {
        &self.keep_mm
    }

    /// The clearance of a structure, mm.
    pub fn clearance_mm(&self, structure: usize) -> f64 {
        self.keep_mm[structure] - self.radius_mm - TRAJECTORY_TOLERANCE_MM
    }

    /// Whether each node is clear and connected to the outside.
    pub fn connected(&self) -> &[bool] {
        &self.connected
    }

    /// A node's distance from all obstacles and structures beyond the required one, mm, limited to ±`MARGIN_CUT_MM`.
    pub fn margin_mm(&self, node: usize) -> f32 {
        self.margin_mm.data()[node]
    }

    /// Target voxels that the ball can reach: the opening of target and free space, connected to the outside.
    pub fn reachable(&self) -> &[bool] {
        &self.reachable
    }

    /// Whether the centre at `p` is too near to a structure, even if `slack_mm` less distance is required.
    fn blocked_by_structure(&self, p: Point<Work>, slack_mm: f64) -> bool {
        let p_ct = self.scene.ct_from_work * p;
        self.scene.structures.iter().zip(&self.keep_mm).any(|(structure, keep)| {
            structure.field.as_ref().is_some_and(|field| field.is_nearer_than(p_ct, *keep - slack_mm))
        })
    }

    /// Whether the centre at `p` is too near to obstacle bone, even if `slack_mm` less distance is required.
    fn blocked_by_bone(&self, p: Point<Work>, slack_mm: f64) -> bool {
        self.obstacle_mm.is_some_and(|distance_mm| distance_mm.trilinear(p, 0.0) < self.radius_mm - slack_mm)
    }

    /// Whether the whole ball at `p` lies in the grid.
    pub fn is_inside(&self, p: Point<Work>) -> bool {
        let [nx, ny, nz] = self.grid().dims();
        let c = self.grid().continuous_index(p);
        let reach = self.radius_mm / self.grid().spacing_mm().x;
        [nx, ny, nz].iter().zip(c).all(|(n, c)| c >= reach && c <= (n - 1) as f64 - reach)
    }

    /// Whether the burr may stop at `p`.
    pub fn is_clear(&self, p: Point<Work>) -> bool {
        self.is_allowed(p, 1e-5, 0.0)
    }

    /// Whether the burr may pass `p` on a move between clear places.
    fn is_passable(&self, p: Point<Work>) -> bool {
        self.is_allowed(p, PASSING_BONE_MM, PASSING_STRUCTURE_MM)
    }

    /// Whether the burr may be at `p` with these slacks. Nearly everywhere the margins of the nodes around `p` decide.
    fn is_allowed(&self, p: Point<Work>, bone_slack_mm: f64, structure_slack_mm: f64) -> bool {
        if !self.is_inside(p) {
            return false;
        }
        let margin = self.margin_mm.trilinear(p, 0.0);
        let h = self.grid().spacing_mm().x;
        // a distance is convex in each direction with a curvature of at most 1/d, so interpolation adds up to 3h²/(8d)
        if margin >= 3.0 * h * h / (8.0 * self.radius_mm) {
            return true;
        }
        margin > -0.9 * MARGIN_CUT_MM
            && !self.blocked_by_bone(p, bone_slack_mm)
            && !self.blocked_by_structure(p, structure_slack_mm)
    }

    /// Whether the burr may be at `p` and the nearest node is connected to the outside.
    pub fn is_open(&self, p: Point<Work>) -> bool {
        self.grid().nearest(p).is_some_and(|v| self.near_connected(v)) && self.is_clear(p)
    }

    /// Whether the straight move a–b between clear places is passable, tested every `step_mm`.
    pub fn is_move_clear(&self, a: Point<Work>, b: Point<Work>, step_mm: f64) -> bool {
        let pieces = (a.distance_mm(&b) / step_mm).ceil().max(1.0) as usize;
        (1..=pieces).all(|n| self.is_passable(a + (b - a) * (n as f64 / pieces as f64)))
    }

    /// Whether a connected node lies within one voxel; a point between nodes need not have a connected nearest node.
    fn near_connected(&self, [i, j, k]: [usize; 3]) -> bool {
        let [nx, ny, nz] = self.grid().dims();
        let around = |v: usize, n: usize| v.saturating_sub(1)..(v + 2).min(n);
        around(k, nz)
            .any(|k| around(j, ny).any(|j| around(i, nx).any(|i| self.connected[i + nx * (j + ny * k)])))
    }

    /// min(distance to obstacles − r, distance to each structure − the required one) per node; negative means not clear.
    fn node_margins(&self) -> Vec<f32> {
        let grid = self.grid();
        let near = self.structures_near_blocks();
        let [bx, by, _] = grid.dims().map(|n| n.div_ceil(BLOCK));
        let margin = |n: usize| -> f64 {
            cancel::poll();
            let p = grid.center(grid.voxel(n));
            if !self.is_inside(p) {
                return -MARGIN_CUT_MM;
            }
            let bone =
                self.obstacle_mm.map_or(MARGIN_CUT_MM, |d| f64::from(d.data()[n]) - self.radius_mm + 1e-5);
            let mut least = bone.min(MARGIN_CUT_MM);
            let p_ct = self.scene.ct_from_work * p;
            let [i, j, k] = grid.voxel(n).map(|i| i / BLOCK);
            for (field, keep) in &near[i + bx * (j + by * k)] {
                if least <= -MARGIN_CUT_MM {
                    break;
                }
                let (lower, upper) = field.bounds(p_ct);
                if upper - keep <= -MARGIN_CUT_MM {
                    least = -MARGIN_CUT_MM;
                } else if lower - keep < least {
                    least = least.min(field.distance(p_ct) - keep);
                }
            }
            least.max(-MARGIN_CUT_MM)
        };
        (0..grid.len()).into_par_iter().with_min_len(4096).map(|n| margin(n) as f32).collect()
    }

    /// For each block of nodes, the structures that may decide its margins, with the required distances.
    fn structures_near_blocks(&self) -> Vec<Vec<(&StructureField, f64)>> {
        let grid = self.grid();
        let dims = grid.dims().map(|n| n.div_ceil(BLOCK));
        let half_mm = 0.5 * (BLOCK - 1) as f64 * grid.spacing_mm().x;
        let near = |block: usize| {
            let block = [block % dims[0], block / dims[0] % dims[1], block / (dims[0] * dims[1])];
            let middle = grid.center(block.map(|b| b * BLOCK)) + Vector3::repeat(half_mm);
            let p_ct = self.scene.ct_from_work * middle;
            let fields = self.scene.structures.iter().map(|structure| structure.field.as_ref());
            let decides = |(field, keep): &(&StructureField, f64)| {
                field.bounds(p_ct).0 - 3f64.sqrt() * half_mm - keep < MARGIN_CUT_MM
            };
            fields.zip(&self.keep_mm).filter_map(|(f, keep)| f.zip(Some(*keep))).filter(decides).collect()
        };
        (0..dims.iter().product()).into_par_iter().map(near).collect()
    }

    fn covered_target(&self) -> Result<Vec<bool>, ImageError> {
        let mut centers = Volume::filled(self.grid().clone(), false);
        centers.data_mut().copy_from_slice(&self.connected);
        let class = self.scene.class.data();
        let limit_mm = self.radius_mm + self.grid().diagonal_mm();
        Ok(match distance_within(&centers, limit_mm)? {
            None => vec![false; class.len()],
            Some(distance_mm) => distance_mm
                .data()
                .iter()
                .zip(class)
                .map(|(d, c)| c.is(Class::TARGET) && f64::from(*d) <= self.radius_mm + 1e-5)
                .collect(),
        })
    }

    /// Rows of the planning grid.
    pub fn rows(&self) -> Rows {
        Rows::of(self.grid())
    }
}

/// The clear nodes that are 6-connected to the highest slab in which the ball fits into the grid.
///
/// Above that slab the ball leaves the grid. A closed hollow deep in the bone is not connected.
fn connected_to_top(grid: &Grid<Work>, clear: Vec<bool>, radius_mm: f64) -> Vec<bool> {
    let [nx, ny, nz] = grid.dims();
    let slab = nx * ny;
    let mut reached = vec![false; clear.len()];
    let below = (radius_mm / grid.spacing_mm().z).ceil() as usize;
    let Some(top) = (nz - 1).checked_sub(below) else { return reached };
    let mut open: Vec<usize> = (top * slab..(top + 1) * slab).filter(|n| clear[*n]).collect();
    open.iter().for_each(|n| reached[*n] = true);
    while let Some(n) = open.pop() {
        let [i, j, k] = grid.voxel(n);
        let neighbours = [
            (i > 0).then(|| n - 1),
            (i + 1 < nx).then(|| n + 1),
            (j > 0).then(|| n - nx),
            (j + 1 < ny).then(|| n + nx),
            (k > 0).then(|| n - slab),
            (k + 1 < nz).then(|| n + slab),
        ];
        for next in neighbours.into_iter().flatten() {
            if clear[next] && !reached[next] {
                reached[next] = true;
                open.push(next);
            }
        }
    }
    reached
}
