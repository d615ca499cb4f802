//! Classifies every point of a separate, finer lattice: target, material, bone that must stay.
//!
//! The lattice has half the planner's spacing, so each of the planner's voxels contains eight points. Gouging, links, masses
//! and the shank are checked on it. Volumes are counted on the planner's voxels and compared with those on the lattice.
//! Obstacle bone is bone outside the target that lies in an obstacle voxel of the planner ([`Voxels::obstacles`]), or that
//! is certainly thicker than the band on the planner's voxels ([`thickest_sheet_mm`]): a ball of that diameter fits into it,
//! or it lies within a band of such a place (so that thick bone keeps its corners). The volume of all other bone is reported.

use bonemill_case::{Density, Sheets};
use bonemill_geometry::{Ct, Grid, Point, Rigid, Work, cancel};
use nalgebra::Vector3;
use rayon::prelude::*;

use super::anatomy::Anatomy;
use super::target::TargetRule;
use super::voxels::{Doubtful, Voxels};
use super::{VerifyError, edt};

/// Belongs to the target.
pub const TARGET: u8 = 1;
/// Target above `air_hu`.
pub const MATERIAL: u8 = 2;
/// Target at or above `bone_hu`.
pub const TARGET_BONE: u8 = 4;
/// Bone outside the target that neither burr nor shank may touch.
pub const OBSTACLE: u8 = 8;
/// Bone outside the target that is no obstacle.
pub const SHEET: u8 = 16;
/// Inside a structure that is to be kept.
pub const STRUCTURE: u8 = 32;
/// In the target's shape, but beyond the scan: it counts neither as target nor as removed.
pub const OUTSIDE: u8 = 64;
/// Bone outside the target in a voxel of the planner whose centre is not bone: too thin for the planner's grid.
pub const SLIVER: u8 = 128;

/// Everything that has mass and gives force.
pub const HAS_MASS: u8 = MATERIAL | OBSTACLE | SHEET;

/// Radius of the closing that decides which air a shape encloses, mm.
const CLOSING_MM: f64 = 4.0;
/// Least spacing of the closing's grid, mm.
const FINEST_CLOSING_MM: f64 = 0.25;
/// Rounding margin of the closing's radius, mm.
const SAME_MM: f64 = 1e-6;

/// The rule that decides which bone is an obstacle.
#[derive(Debug, Clone, Copy)]
pub struct Obstacle {
    /// The largest voxel diagonal, mm.
    pub band_mm: f64,
    /// The case's rule for sheets.
    pub sheets: Sheets,
}

/// Classes on a lattice.
#[derive(Debug)]
pub struct FineLattice {
    /// The grid of the points.
    pub grid: Grid<Work>,
    /// Flags per point, x-fastest.
    pub class: Vec<u8>,
}

impl FineLattice {
    /// Classifies the points of `grid`; the planner's voxels are used only to tell obstacles.
    ///
    /// # Errors
    /// [`VerifyError::Grid`] if the closing's grid cannot be made.
    pub fn new(
        target: &TargetRule<'_>,
        density: &Density,
        grid: Grid<Work>,
        voxels: &Voxels,
        rule: &Obstacle,
    ) -> Result<Self, VerifyError> {
        let ct_from_grid = &voxels.ct_from_grid;
        let anatomy = target.anatomy();
        let target = Inside::new(target, density.bone_hu, ct_from_grid, &grid)?;
        let [nx, ny, _] = grid.dims();
        let mut class = vec![0u8; grid.len()];
        class.par_chunks_mut(nx).enumerate().for_each(|(row, class)| {
            cancel::poll();
            for (i, class) in class.iter_mut().enumerate() {
                let center = grid.center([i, row % ny, row / ny]);
                let p = *ct_from_grid * center;
                let (value, label) = (anatomy.hu(p), anatomy.label(p));
                let mut flags = if anatomy.is_kept(label) { STRUCTURE } else { 0 };
                if target.holds(center, p, label, value) {
                    flags |= TARGET;
                    flags |= if value > density.air_hu { MATERIAL } else { 0 };
                    flags |= if value >= density.bone_hu { TARGET_BONE } else { 0 };
                } else if value >= density.bone_hu {
                    flags |= SHEET;
                }
                *class = flags;
            }
        });
        let mut lattice = Self { grid, class };
        lattice.find_thick(rule.band_mm, voxels.spacing_mm());
        lattice.compare(voxels, rule);
        Ok(lattice)
    }

    /// Spacing, mm.
    pub fn spacing_mm(&self) -> f64 {
        self.grid.spacing_mm().x
    }

    /// Changes the class of bone that is certainly thicker than a sheet from SHEET to OBSTACLE.
    fn find_thick(&mut self, band_mm: f64, planner_mm: f64) {
        let (dims, h) = (self.grid.dims(), self.spacing_mm());
        let class = &self.class;
        let deep = edt::squared_voxels(dims, |n| class[n] & SHEET == 0);
        // n points across may be a body n - 1 spacings thick; its middle point is (n + 1) / 2 spacings from the first point beyond
        let core = ((0.5 * thickest_sheet_mm(band_mm, planner_mm) / h + 1.0).powi(2) - 1e-6) as f32;
        let from_core = edt::squared_voxels(dims, |n| deep[n] >= core);
        // a face lies half a voxel before the first centre beyond it
        let reach = ((band_mm / h + 0.5).powi(2) + 1e-6) as f32;
        self.class.par_iter_mut().zip(from_core).for_each(|(class, from_core)| {
            if *class & SHEET != 0 && from_core <= reach {
                *class ^= SHEET | OBSTACLE;
            }
        });
    }

    /// Marks obstacles and slivers by the planner's voxels.
    fn compare(&mut self, voxels: &Voxels, rule: &Obstacle) {
        let Doubtful { surely, possibly } = &voxels.class;
        let obstacle = voxels.obstacles(surely, possibly, rule.band_mm, rule.sheets);
        let grid = &self.grid;
        self.class.par_iter_mut().enumerate().with_min_len(1 << 14).for_each(|(n, class)| {
            if *class & (SHEET | OBSTACLE) == 0 {
                return;
            }
            let voxel = voxels.grid.nearest(grid.center(grid.voxel(n))).map(|v| voxels.grid.index(v));
            if voxel.is_some_and(|v| possibly[v] & SHEET == 0) {
                *class |= SLIVER;
            }
            if voxel.is_some_and(|v| obstacle[v]) {
                *class = *class & !SHEET | OBSTACLE;
            }
        });
    }

    /// Whether a point has one of `flags`.
    pub fn is(&self, n: usize, flags: u8) -> bool {
        self.class[n] & flags != 0
    }

    /// The number of points for which `holds` is true.
    pub fn count(&self, holds: &(impl Fn(usize) -> bool + Sync)) -> usize {
        (0..self.class.len()).into_par_iter().with_min_len(1 << 14).filter(|n| holds(*n)).count()
    }

    /// Volume of the points with one of `flags` for which `holds` is true, mm³.
    pub fn volume_mm3(&self, flags: u8, holds: impl Fn(usize) -> bool + Sync) -> f64 {
        let count = self.class.par_iter().enumerate().filter(|(n, c)| **c & flags != 0 && holds(*n)).count();
        count as f64 * self.grid.voxel_mm3()
    }
}

/// The largest thickness, mm, of bone that may count as a sheet on voxels of `planner_mm`.
///
/// Bone is kept where a voxel centre is at least half the band plus half a voxel away from the first centre beyond the bone.
/// The middle of n layers is (n + 1) / 2 voxels away from it if n is odd, but n / 2 if n is even; and n layers of centres may
/// be bone up to n + 1 voxels thick.
fn thickest_sheet_mm(band_mm: f64, planner_mm: f64) -> f64 {
    let band = band_mm / planner_mm;
    // in both cases n.div_ceil(2) voxels
    let layers =
        (1u32..).take_while(|n| f64::from(n.div_ceil(2)) < 0.5 * (band + 1.0) - 1e-6).last().unwrap_or(0);
    f64::from(layers + 1) * planner_mm
}

/// A grid over a box, with points at `phase_mm` + whole multiples of the spacing along every axis.
///
/// # Errors
/// [`VerifyError::Grid`] if it cannot be made.
pub fn grid_over(
    [lo, hi]: [Vector3<f64>; 2],
    spacing_mm: f64,
    phase_mm: f64,
) -> Result<Grid<Work>, VerifyError> {
    let first = lo.map(|v| ((v - phase_mm) / spacing_mm).floor());
    let last = hi.map(|v| ((v - phase_mm) / spacing_mm).ceil());
    let dims = (last - first).map(|n| n as usize + 1);
    let origin = first * spacing_mm + Vector3::repeat(phase_mm);
    Ok(Grid::aligned([dims.x, dims.y, dims.z], spacing_mm, Point::from_coords(origin))?)
}

/// Tells whether a point belongs to the target.
#[derive(Debug)]
pub struct Inside<'a> {
    target: &'a TargetRule<'a>,
    bone_hu: f64,
    /// For a shape, the bone and the air that it encloses.
    enclosed: Option<Closed>,
}

impl<'a> Inside<'a> {
    /// The target's points in and around a grid.
    ///
    /// # Errors
    /// [`VerifyError::Grid`] if the closing's grid cannot be made.
    pub fn new(
        target: &'a TargetRule<'a>,
        bone_hu: f64,
        ct_from_grid: &Rigid<Ct, Work>,
        around: &Grid<Work>,
    ) -> Result<Self, VerifyError> {
        let closed = || Closed::new(target.anatomy(), bone_hu, ct_from_grid, around);
        let enclosed = if target.has_shape() { Some(closed()?) } else { None };
        Ok(Self { target, bone_hu, enclosed })
    }

    /// Whether a point, given in both frames with its label and HU, belongs to the target.
    pub fn holds(&self, center: Point<Work>, p: Point<Ct>, label: u16, hu: f64) -> bool {
        let filled = hu >= self.bone_hu || self.enclosed.as_ref().is_some_and(|c| c.holds(center));
        let found = self.target.holds(p, &|is| Doubtful::sure(is(label)), &Doubtful::sure(filled));
        found.possibly && self.target.anatomy().is_in_scan(p)
    }
}

/// The morphological closing of bone by a ball: bone and the air that it encloses.
#[derive(Debug)]
pub struct Closed {
    /// Its grid, no finer than [`FINEST_CLOSING_MM`].
    pub grid: Grid<Work>,
    holds: Vec<bool>,
}

impl Closed {
    /// Closes the bone in and around a grid.
    ///
    /// # Errors
    /// [`VerifyError::Grid`] if the closing's grid cannot be made.
    pub fn new(
        anatomy: &Anatomy,
        bone_hu: f64,
        ct_from_grid: &Rigid<Ct, Work>,
        around: &Grid<Work>,
    ) -> Result<Self, VerifyError> {
        // large enough that bone around the lattice is included
        let h = around.spacing_mm().x.max(FINEST_CLOSING_MM);
        let size = Vector3::from(around.dims().map(|d| (d - 1) as f64)) * around.spacing_mm().x;
        let wide = Vector3::repeat(2.0 * CLOSING_MM + 2.0 * h);
        let lo = around.origin().coords;
        let grid = grid_over([lo - wide, lo + size + wide], h, 0.0)?;
        let bone: Vec<bool> = (0..grid.len())
            .into_par_iter()
            .map(|n| {
                cancel::poll();
                anatomy.hu(*ct_from_grid * grid.center(grid.voxel(n))) >= bone_hu
            })
            .collect();
        let reach = ((CLOSING_MM + SAME_MM) / h).powi(2) as f32;
        let outside = edt::squared_voxels(grid.dims(), |n| bone[n]);
        let depth = edt::squared_voxels(grid.dims(), |n| outside[n] > reach);
        let holds = bone.iter().zip(depth).map(|(bone, depth)| *bone || depth > reach).collect();
        Ok(Self { grid, holds })
    }

    /// Whether the voxel of the closing's grid that contains a point is closed.
    fn holds(&self, p: Point<Work>) -> bool {
        self.grid.nearest(p).is_some_and(|v| self.at(v))
    }

    /// Whether a voxel of the closing's grid is closed.
    pub fn at(&self, voxel: [usize; 3]) -> bool {
        self.holds[self.grid.index(voxel)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tests slabs of many thicknesses, for all positions of their faces between the centres of the planner's layers.
    #[test]
    fn no_slab_thicker_than_a_sheet_is_one_on_voxels() {
        for (band_mm, planner_mm) in [(0.433, 0.25), (0.935, 0.25), (0.866, 0.5), (0.5, 0.1), (1.9, 0.4)] {
            let thickest = thickest_sheet_mm(band_mm, planner_mm);
            let mut thickest_dropped: f64 = 0.0;
            for thousandths in 1..6000 {
                let thick_mm = f64::from(thousandths) * 1e-3;
                // the least number of layers of centres in it, and the distance from the middle one to the first centre beyond
                let layers = (thick_mm / planner_mm + 1e-9).floor();
                let depth_mm = (0.5 * layers).ceil() * planner_mm;
                if depth_mm < 0.5 * (band_mm + planner_mm) - 1e-9 {
                    thickest_dropped = thickest_dropped.max(thick_mm);
                }
            }
            assert!(
                (thickest - thickest_dropped - 1e-3).abs() < 1.1e-3,
                "{band_mm} {thickest} {thickest_dropped}"
            );
        }
    }
}
