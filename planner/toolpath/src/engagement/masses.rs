//! The mass that each move removes, from voxels: the exact increment ρ·max(0, V − V already removed) of partial volumes,
//! whose sum over the path is the mass removed (docs/force-model.md 8, row 3). Drafts use whole voxels.

use bonemill_cutting::cutter::Ball;
use bonemill_cutting::cutter::ball::BallVolumes;
use bonemill_cutting::metrics::Moments;
use bonemill_cutting::stock::removal::{NEVER, RemovalTime};
use bonemill_cutting::stock::voxels::VoxelSet;
use bonemill_geometry::{Grid, Point, Volume, Work, cancel};
use nalgebra::Vector3;
use rayon::prelude::*;

use crate::path::PathPoint;

/// Number of slabs of the grid in which masses are summed separately; fixed, so that sums do not depend on the number of
/// threads.
const SLABS: usize = 6;

/// Larger voxels, as a share of the radius, are divided: of two balls that take parts of a voxel the larger part counts, which misses what only the
/// smaller one takes. At a third of the radius that is up to 2 % of the mass.
const LARGEST_VOXEL: f64 = 0.2;

/// Volumes of a voxel of which less is left differ by rounding.
const ROUNDING: f64 = 1e-9;

/// The mass that each move removes.
#[derive(Debug, Clone)]
pub struct Increments {
    /// Mass in each waypoint's ball without the sweep of all earlier moves, and its moments about the ball's centre.
    pub at_end: Vec<Moments>,
    /// Mass that the move to each waypoint removes before it arrives, mg: little where moves are short. It belongs to no waypoint, and is
    /// missing for later ones.
    pub on_the_way_mg: Vec<f64>,
}

/// What each move removes (g/cm³ is mg/mm³).
///
/// The path is swept separately in each slab of the grid; the slabs' sums are added in their order.
pub fn mass_increments(
    density_g_cm3: &Volume<f32, Work>,
    points: &[PathPoint],
    Ball { radius_mm }: Ball,
) -> Increments {
    let coarse = density_g_cm3.grid();
    let parts = (coarse.spacing_mm().x / (LARGEST_VOXEL * radius_mm) - 1e-9).ceil().max(1.0) as usize;
    let grid = coarse.divided(parts);
    let [nx, ny, nz] = grid.dims();
    let thickness = nz.div_ceil(SLABS);
    let mut total = Increments {
        at_end: vec![Moments::new(radius_mm); points.len()],
        on_the_way_mg: vec![0.0; points.len()],
    };
    let slabs: Vec<Vec<Increment>> = (0..nz.div_ceil(thickness))
        .into_par_iter()
        .map(|slab| {
            let k = slab * thickness..((slab + 1) * thickness).min(nz);
            let of_voxel = |n| *density_g_cm3.get(grid.voxel(n).map(|v| v / parts));
            let density: Vec<f32> = (nx * ny * k.start..nx * ny * k.end).map(of_voxel).collect();
            slab_increments(&grid, k, &density, points, radius_mm)
        })
        .collect();
    for Increment { waypoint, at_end, on_the_way_mg } in slabs.into_iter().flatten() {
        total.at_end[waypoint as usize].merge(&at_end);
        total.on_the_way_mg[waypoint as usize] += on_the_way_mg;
    }
    total
}

/// What one move removes in one slab.
struct Increment {
    waypoint: u32,
    at_end: Moments,
    on_the_way_mg: f64,
}

/// The same with whole voxels: each belongs to the move that first covers its centre. Used for drafts: it is ten times as
/// fast, and it includes the mass that a long move removes before its end.
pub fn mass_increments_by_voxels(
    density_g_cm3: &Volume<f32, Work>,
    removal: &RemovalTime,
    points: &[PathPoint],
    Ball { radius_mm }: Ball,
) -> Vec<Moments> {
    let grid = density_g_cm3.grid();
    let mut total = vec![Moments::new(radius_mm); points.len()];
    let voxels = removal.time().iter().zip(density_g_cm3.data()).enumerate();
    for (voxel, (index, density)) in
        voxels.filter(|(_, (index, density))| **index != NEVER && **density > 0.0)
    {
        let from_center = grid.center(grid.voxel(voxel)) - points[*index as usize].position;
        total[*index as usize].add(f64::from(*density) * grid.voxel_mm3(), &from_center);
    }
    total
}

/// Increments of slab k; `density` holds only its voxels.
fn slab_increments(
    grid: &Grid<Work>,
    k: std::ops::Range<usize>,
    density: &[f32],
    points: &[PathPoint],
    radius_mm: f64,
) -> Vec<Increment> {
    let mut slab = Slab {
        grid,
        k,
        density,
        radius_mm,
        removed_mm3: vec![0f64; density.len()],
        left: VoxelSet::of(density.len(), |n| density[n] > 0.0),
        volumes: BallVolumes::new(),
        found: Vec::new(),
    };
    let mut out = Vec::new();
    let mut before: Option<Point<Work>> = None;
    for (waypoint, point) in points.iter().enumerate() {
        cancel::poll();
        let (mut at_end, mut on_the_way_mg) = (Moments::new(radius_mm), 0.0);
        slab.take(point.position, |p, mass_mg| at_end.add(mass_mg, p));
        if let Some(from) = before.replace(point.position) {
            // balls so close that the cusps between two are at most 1/288 of the radius high
            let way = point.position - from;
            let parts = (way.norm() / (radius_mm / 6.0)).ceil().max(1.0) as usize;
            for n in 1..parts {
                slab.take(from + way * (n as f64 / parts as f64), |_, mass_mg| on_the_way_mg += mass_mg);
            }
        }
        if at_end.mass_mg() > 0.0 || on_the_way_mg > 0.0 {
            out.push(Increment { waypoint: waypoint as u32, at_end, on_the_way_mg });
        }
    }
    out
}

/// A slab of the grid, and the removed volume of its voxels.
struct Slab<'a> {
    grid: &'a Grid<Work>,
    k: std::ops::Range<usize>,
    /// Density of the slab's voxels only.
    density: &'a [f32],
    radius_mm: f64,
    removed_mm3: Vec<f64>,
    /// Voxels that have density and are not completely removed.
    left: VoxelSet,
    volumes: BallVolumes,
    /// A buffer that is kept between calls.
    found: Vec<(usize, f64)>,
}

impl Slab<'_> {
    /// Removes a ball and calls `visit(vector from the ball's centre to the voxel, mg)` for each voxel that loses mass.
    fn take(&mut self, center: Point<Work>, mut visit: impl FnMut(&Vector3<f64>, f64)) {
        let [nx, ny, _] = self.grid.dims();
        let c = Vector3::from(self.grid.continuous_index(center));
        let reach = self.radius_mm / self.grid.spacing_mm().x + 0.5;
        if c.z + reach < self.k.start as f64 || c.z - reach > (self.k.end - 1) as f64 {
            return;
        }
        let bounds = |axis: usize, n: usize| {
            let lo = (c[axis] - reach).floor().max(0.0) as usize;
            (lo, ((c[axis] + reach).ceil().max(0.0) as usize).min(n - 1))
        };
        let ((i0, i1), (j0, j1)) = (bounds(0, nx), bounds(1, ny));
        let lo_k = ((c.z - reach).floor().max(self.k.start as f64)) as usize;
        let hi_k = ((c.z + reach).ceil().max(0.0) as usize).min(self.k.end - 1);
        let (first, full) = (nx * ny * self.k.start, self.grid.voxel_mm3());
        let Self { grid, density, removed_mm3, left, found, .. } = self;
        found.clear();
        self.volumes.for_each(
            grid,
            center,
            self.radius_mm,
            [[i0, j0, lo_k], [i1, j1, hi_k]],
            |row| left.within(row.start - first..row.end - first).map(|n| n + first),
            |voxel, volume_mm3| found.push((voxel, volume_mm3)),
        );
        for (voxel, volume_mm3) in found.drain(..) {
            let more = volume_mm3 - removed_mm3[voxel - first];
            if more > ROUNDING * full {
                removed_mm3[voxel - first] = volume_mm3;
                if volume_mm3 >= full * (1.0 - ROUNDING) {
                    left.remove(voxel - first);
                }
                let p = grid.center(grid.voxel(voxel)) - center;
                visit(&p, f64::from(density[voxel - first]) * more);
            }
        }
    }
}
