//! The density of what the burr meets, at any point: as the images have it, not as the planning grid samples it.
//!
//! A force sums what the burr's surface meets at thousands of points. Septa of air cells are as thin as a voxel of the
//! planning grid, and the edge of the target lies somewhere between two of its nodes; interpolating what the grid holds
//! would blur both. So the part of the images under the grid is kept.

use bonemill_geometry::{Ct, Frame, Grid, Point, Rigid, Volume, Work, trilinear};
use bonemill_imaging::AIR_HU;
use bonemill_imaging::DensityTable;

use super::inside::Inside;
use super::{SceneError, SceneSpec};

/// What has mass: in the target whatever is above `air_hu`, outside it bone, at or above `bone_hu`.
#[derive(Debug)]
pub struct Matter {
    ct: Volume<f32, Ct>,
    labels: Volume<u16, Ct>,
    inside: Inside,
    table: DensityTable,
    air_hu: f64,
    bone_hu: f64,
    ct_from_work: Rigid<Ct, Work>,
}

impl Matter {
    /// Of the images under `grid`.
    ///
    /// # Errors
    /// [`SceneError`] when the parts cannot be held.
    pub(super) fn new(
        spec: &SceneSpec,
        grid: &Grid<Work>,
        ct_from_work: Rigid<Ct, Work>,
        inside: Inside,
    ) -> Result<Self, SceneError> {
        Ok(Self {
            ct: part_under(spec.ct, grid, &ct_from_work, AIR_HU)?,
            labels: part_under(spec.labels, grid, &ct_from_work, 0)?,
            inside,
            table: spec.table.clone(),
            air_hu: spec.air_hu,
            bone_hu: spec.bone_hu,
            ct_from_work,
        })
    }

    /// Density at a point of the work grid, g/cm³; 0 where nothing resists: air, and soft tissue outside the target, which
    /// is retracted.
    ///
    /// HU are calibrated per CT voxel, then the density is interpolated; what a point is follows from its interpolated HU
    /// and from the label voxel that holds it.
    #[inline]
    pub fn density_g_cm3(&self, p: Point<Work>) -> f64 {
        let p_ct = self.ct_from_work * p;
        let Some((corners, at)) = self.ct.cell_inside(self.ct.grid().continuous_index(p_ct)) else {
            return 0.0;
        };
        let hu = trilinear(&corners, at);
        // bone has mass wherever it is
        if hu < self.bone_hu && !(hu > self.air_hu && self.inside.holds(p, p_ct, hu, self.label(p_ct))) {
            return 0.0;
        }
        trilinear(&corners.map(|hu| self.table.density_g_cm3(hu)), at)
    }

    fn label(&self, p: Point<Ct>) -> u16 {
        self.labels.grid().nearest(p).map_or(0, |v| *self.labels.get(v))
    }
}

/// The voxels of an image around a grid's box; `outside` beyond the image.
fn part_under<T: Copy>(
    image: &Volume<T, Ct>,
    grid: &Grid<Work>,
    ct_from_work: &Rigid<Ct, Work>,
    outside: T,
) -> Result<Volume<T, Ct>, SceneError> {
    let (mut lo, mut hi) = ([i64::MAX; 3], [i64::MIN; 3]);
    for corner in grid.corners() {
        let index = image.grid().continuous_index(*ct_from_work * corner);
        for a in 0..3 {
            lo[a] = lo[a].min(index[a].floor() as i64 - 1);
            hi[a] = hi[a].max(index[a].ceil() as i64 + 1);
        }
    }
    let part = shifted(image.grid(), lo, [0, 1, 2].map(|a| (hi[a] - lo[a] + 1) as usize))?;
    let dims = image.grid().dims();
    let mut data = Vec::with_capacity(part.len());
    for n in 0..part.len() {
        let voxel = part.voxel(n);
        let at: [i64; 3] = std::array::from_fn(|a| lo[a] + voxel[a] as i64);
        let is_in = (0..3).all(|a| at[a] >= 0 && at[a] < dims[a] as i64);
        data.push(if is_in { *image.get(at.map(|v| v as usize)) } else { outside });
    }
    Volume::new(part, data).map_err(SceneError::Values)
}

/// A grid of the same voxels that begins at voxel `first`.
fn shifted<F: Frame>(grid: &Grid<F>, first: [i64; 3], dims: [usize; 3]) -> Result<Grid<F>, SceneError> {
    let origin = grid.at(first.map(|v| v as f64));
    Ok(Grid::new(dims, grid.spacing_mm(), *grid.axes(), origin.coords)?)
}
