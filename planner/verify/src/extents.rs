//! The boxes that verification looks at: the fine lattice over target and sweep, and the planner's own grid.

use bonemill_geometry::{Ct, Grid, Point, Rigid, Work};
use bonemill_planfile::StoredPlan;
use nalgebra::Vector3;

use super::VerifyError;
use super::anatomy::{Anatomy, BoxExtent};
use super::lattice::grid_over;
use super::moves::Moves;
use super::target::TargetRule;
use super::voxels::Voxels;

/// Largest number of points of the fine lattice: about 1.5 GB.
const MOST_POINTS: f64 = 8e7;
/// Rounding by which a planning grid may be smaller than the target, voxels.
const GRID_ROUNDING: f64 = 1e-3;

/// The fine lattice over target and sweep, inside the scan, and the number of waypoints outside it.
pub fn fine_grid(
    plan: &StoredPlan,
    anatomy: &Anatomy,
    aim: &[Vector3<f64>; 2],
    moves: &Moves,
    band_mm: f64,
) -> Result<(Grid<Work>, usize), VerifyError> {
    let case = &plan.record.case;
    let reach_mm = case.burr.radius_mm + band_mm + case.grid.spacing_mm;
    let room = LatticeBounds {
        aim,
        scan: &scan_box(anatomy, &plan.record.frames.ct_from_grid().inverse()),
        reach_mm,
        around_mm: reach_mm + case.grid.margin_mm + 2.0 * case.burr.radius_mm,
        most_points: MOST_POINTS,
    };
    let (corners, h, missed) = room.fine_box(&moves.points, 0.5 * case.grid.spacing_mm);
    Ok((grid_over(corners, h, 0.5 * h)?, missed))
}

/// The limits of the fine lattice. Boxes are given by smallest and largest corner, mm in work.
struct LatticeBounds<'a> {
    /// The target.
    aim: &'a [Vector3<f64>; 2],
    /// The images, beyond which there is air.
    scan: &'a [Vector3<f64>; 2],
    /// Margin around the sweep, mm.
    reach_mm: f64,
    /// Margin around the target if the sweep is too wide, mm.
    around_mm: f64,
    /// Largest number of points that fits into memory.
    most_points: f64,
}

impl LatticeBounds<'_> {
    /// The box, its spacing (`finest_mm`, or as fine as memory allows), and the number of waypoints in the scan outside it.
    fn fine_box(&self, points: &[Vector3<f64>], finest_mm: f64) -> ([Vector3<f64>; 2], f64, usize) {
        let clip = |[lo, hi]: [Vector3<f64>; 2]| {
            [lo.sup(&self.scan[0]).inf(&self.aim[0]), hi.inf(&self.scan[1]).sup(&self.aim[1])]
        };
        let count = |[lo, hi]: [Vector3<f64>; 2], h: f64| (hi - lo).map(|l| l / h + 2.0).product();
        let around = Vector3::repeat(self.around_mm);
        let near = clip([self.aim[0] - around, self.aim[1] + around]);
        let mut h = finest_mm;
        while count(near, h) > self.most_points {
            h *= 1.25;
        }
        let mut extent = BoxExtent::default();
        points.iter().chain(self.aim).for_each(|p| extent.hold(*p));
        let whole = clip(extent.grown(&Vector3::repeat(self.reach_mm)).unwrap_or(*self.aim));
        if count(whole, h) <= self.most_points {
            return (whole, h, 0);
        }
        let is_in =
            |p: &Vector3<f64>, [lo, hi]: &[Vector3<f64>; 2]| (0..3).all(|a| p[a] >= lo[a] && p[a] <= hi[a]);
        (near, h, points.iter().filter(|p| is_in(p, self.scan) && !is_in(p, &near)).count())
    }
}

/// The planner's voxels, and how far the target with the burr around it extends beyond them, mm.
pub fn planned_voxels(plan: &StoredPlan, target: &TargetRule<'_>) -> Result<(Voxels, f64), VerifyError> {
    let case = &plan.record.case;
    let (dims, h) = (plan.record.frames.grid.dims, case.grid.spacing_mm);
    let ct_from_grid = plan.record.frames.ct_from_grid();
    let [lo, hi] = target.anatomy().aim_box(&ct_from_grid.inverse()).ok_or(VerifyError::NoTarget)?;
    let size = Vector3::from(dims.map(|d| d as f64)) * h;
    // voxels extend half a spacing beyond their centres
    let below = Vector3::repeat(case.burr.radius_mm - 0.5 * h) - lo;
    let above = hi + Vector3::repeat(case.burr.radius_mm + 0.5 * h) - size;
    // because of rounding, the planner's grid may be smaller by this part of a voxel
    let beyond_mm = below.sup(&above).max() - GRID_ROUNDING * h;
    let grid = Grid::aligned(dims, h, Point::new(0.0, 0.0, 0.0))?;
    Ok((Voxels::new(target, &case.density, ct_from_grid, grid)?, beyond_mm.max(0.0)))
}

/// The box of CT and label map along work's axes.
pub fn scan_box(anatomy: &Anatomy, grid_from_ct: &Rigid<Work, Ct>) -> [Vector3<f64>; 2] {
    let mut extent = BoxExtent::default();
    for corner in anatomy.ct.grid().corners().into_iter().chain(anatomy.labels.grid().corners()) {
        extent.hold((*grid_from_ct * corner).coords);
    }
    extent.grown(&Vector3::zeros()).unwrap_or([Vector3::zeros(); 2])
}

#[cfg(test)]
mod tests {
    use super::super::check::Check;
    use super::*;

    #[test]
    fn the_fine_lattice_follows_the_sweep_as_far_as_memory_goes() {
        let cube = |r: f64| [Vector3::repeat(-r), Vector3::repeat(r)];
        let (aim, scan) = (cube(5.0), cube(100.0));
        let room = |most_points| LatticeBounds {
            aim: &aim,
            scan: &scan,
            reach_mm: 3.0,
            around_mm: 8.0,
            most_points,
        };
        let near = [Vector3::new(0.0, 0.0, 9.0)];
        let ([lo, hi], h, missed) = room(2e6).fine_box(&near, 0.25);
        assert_eq!((lo.z, hi.z, h, missed), (-8.0, 12.0, 0.25, 0));
        // a waypoint far away in the scan is outside the lattice; one beyond the scan is in air
        let far = [Vector3::new(0.0, 90.0, 0.0), Vector3::new(0.0, 0.0, 5000.0)];
        let ([lo, hi], h, missed) = room(2e6).fine_box(&far, 0.25);
        assert_eq!((lo.y, hi.y, h, missed), (-13.0, 13.0, 0.25, 1));
        // a target too large for memory gets a coarser lattice, and a check reports it
        let (_, h, _) = room(1e4).fine_box(&near, 0.25);
        assert!(h > 1.0, "{h}");
        assert!(!Check::at_most("lattice spacing", h, 0.5, "mm").passed());
    }
}
