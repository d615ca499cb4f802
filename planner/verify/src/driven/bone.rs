//! The density of what the burr meets, at any point: from the images, by the definitions of the case file.

use bonemill_case::Density;
use bonemill_geometry::{Ct, Grid, Point, Rigid, Work, trilinear};

use super::super::VerifyError;
use super::super::anatomy::{Anatomy, OUTSIDE_HU};
use super::super::lattice::Inside;
use super::super::target::TargetRule;

/// What has mass: in the target all that is above `air_hu`, elsewhere bone. Soft tissue outside the target is retracted.
#[derive(Debug)]
pub struct MassRule<'a> {
    anatomy: &'a Anatomy,
    density: &'a Density,
    inside: Inside<'a>,
    ct_from_grid: Rigid<Ct, Work>,
}

impl<'a> MassRule<'a> {
    /// The rule of a case. `around`: a grid around the target.
    ///
    /// # Errors
    /// [`VerifyError::Grid`] if the grid of the enclosed air cannot be made.
    pub fn new(
        target: &'a TargetRule<'a>,
        density: &'a Density,
        ct_from_grid: Rigid<Ct, Work>,
        around: &Grid<Work>,
    ) -> Result<Self, VerifyError> {
        let inside = Inside::new(target, density.bone_hu, &ct_from_grid, around)?;
        Ok(Self { anatomy: target.anatomy(), density, inside, ct_from_grid })
    }

    /// Density, g/cm³: HU are converted at the CT's voxels first, then interpolated. Beyond the scan is air.
    pub fn density_g_cm3(&self, p: Point<Work>) -> f64 {
        let p_ct = self.ct_from_grid * p;
        let index = self.anatomy.ct.grid().continuous_index(p_ct);
        let Some((corners, at)) = self.anatomy.ct.cell_inside(index).or_else(|| self.edge_cell(index)) else {
            return 0.0;
        };
        let hu = trilinear(&corners, at);
        let is_free =
            || hu <= self.density.air_hu || !self.inside.holds(p, p_ct, self.anatomy.label(p_ct), hu);
        if hu < self.density.bone_hu && is_free() {
            return 0.0;
        }
        trilinear(&corners.map(|hu| self.density.table.density_g_cm3(hu)), at)
    }

    /// The cell at the scan's edge, with air beyond it; `None` where all is air.
    fn edge_cell(&self, index: [f64; 3]) -> Option<([f64; 8], [f64; 3])> {
        let dims = self.anatomy.ct.grid().dims();
        if !(0..3).all(|a| index[a] > -1.0 && index[a] < dims[a] as f64) {
            return None;
        }
        let base = index.map(f64::floor);
        let corner = |n: usize| {
            let at: [f64; 3] = std::array::from_fn(|a| base[a] + (n >> a & 1) as f64);
            let is_in = (0..3).all(|a| at[a] >= 0.0 && at[a] < dims[a] as f64);
            if is_in { f64::from(*self.anatomy.ct.get(at.map(|v| v as usize))) } else { OUTSIDE_HU }
        };
        Some((std::array::from_fn(corner), std::array::from_fn(|a| index[a] - base[a])))
    }
}
