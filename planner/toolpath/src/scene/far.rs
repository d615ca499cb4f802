//! What the handpiece could meet beyond the work grid.
//!
//! The shank is tens of millimetres long, the work grid only covers the target. Bone and structures further away are
//! kept as distances on a coarse grid. A coarse voxel counts as full when any CT voxel centre in it is bone, so the
//! map errs by at most a voxel diagonal, towards "too near".

use bonemill_geometry::{Grid, Point, Volume, Work};
use nalgebra::Vector3;

use bonemill_imaging::{ImageError, distance_within};

/// Distances are kept this far beyond the reach that is needed, mm, so that a long march needs few steps.
const AHEAD_MM: f64 = 12.0;

/// Distances to bone and structures on a coarse grid around the work grid.
#[derive(Debug)]
pub struct FarObstacles {
    distance_mm: Option<Volume<f32, Work>>,
    slack_mm: f64,
    spacing_mm: f64,
    per_mm: f64,
}

impl FarObstacles {
    /// From the coarse voxels that hold something; answers are known up to `reach_mm` at least.
    ///
    /// # Errors
    /// When the distance field cannot be made.
    pub fn new(full: &Volume<bool, Work>, reach_mm: f64) -> Result<Self, ImageError> {
        // obstacle and query point may lie anywhere in their voxels
        let slack_mm = full.grid().diagonal_mm();
        // cut off where an answer is certainly more than `reach_mm`, however it is asked for
        let distance_mm = distance_within(full, reach_mm + 2.0 * slack_mm + AHEAD_MM)?;
        let spacing_mm = full.grid().spacing_mm().x;
        Ok(Self { distance_mm, slack_mm, spacing_mm, per_mm: 1.0 / spacing_mm })
    }

    /// A lower bound of the distance from `p` to anything solid, mm; `None` where nothing is known to be near.
    #[inline]
    pub fn at_least_mm(&self, p: Point<Work>) -> Option<f64> {
        let distance_mm = self.distance_mm.as_ref()?;
        let (grid, dims) = (distance_mm.grid(), distance_mm.grid().dims());
        // the grid lies along work's axes: no need of its general pose, in the innermost loop of access
        let shifted = (p - grid.origin()) * self.per_mm;
        let at = |a: usize| {
            let v = shifted[a] + 0.5;
            (v >= 0.0 && v < dims[a] as f64).then_some(v as usize)
        };
        let (i, j, k) = (at(0)?, at(1)?, at(2)?);
        Some(f64::from(distance_mm.data()[i + dims[0] * (j + dims[1] * k)]) - self.slack_mm)
    }

    /// How far from a place with the answer `here_mm` every answer is `least_mm` or more, mm: distances between voxels change
    /// no faster than their centres move, and either place may lie half a diagonal from its own.
    #[inline]
    pub fn certain_within_mm(&self, here_mm: f64, least_mm: f64) -> f64 {
        here_mm - least_mm - self.slack_mm
    }

    /// The coarse grid, where there is anything to be near.
    pub fn grid(&self) -> Option<&Grid<Work>> {
        self.distance_mm.as_ref().map(Volume::grid)
    }

    /// Centres of the coarse voxels between two corners that hold something solid, which lies somewhere in the voxel.
    pub fn full_between(
        &self,
        low: &Vector3<f64>,
        high: &Vector3<f64>,
    ) -> impl Iterator<Item = Point<Work>> + '_ {
        let voxels = self.distance_mm.as_ref().map(|distance_mm| {
            let (grid, dims) = (distance_mm.grid(), distance_mm.grid().dims());
            let index = |p: &Vector3<f64>| (p - grid.origin().coords) * self.per_mm;
            let (low, high) = (index(low), index(high));
            let along = |a: usize| {
                let last = high[a].floor().min(dims[a] as f64 - 1.0);
                low[a].ceil().max(0.0) as usize..(last + 1.0).max(0.0) as usize
            };
            let [x, y, z] = [0, 1, 2].map(along);
            let rows = z.flat_map(move |k| y.clone().map(move |j| [j, k]));
            rows.flat_map(move |[j, k]| x.clone().map(move |i| [i, j, k]))
                .filter(|voxel| *distance_mm.get(*voxel) == 0.0)
                .map(|voxel| grid.center(voxel))
        });
        voxels.into_iter().flatten()
    }

    /// Half a coarse voxel's diagonal, mm: the farthest that the solid thing lies from its voxel's centre.
    pub fn half_diagonal_mm(&self) -> f64 {
        0.5 * self.slack_mm
    }

    /// The coarse grid's spacing, mm.
    pub fn spacing_mm(&self) -> f64 {
        self.spacing_mm
    }
}
