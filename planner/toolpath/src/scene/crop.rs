//! The crop: the planning grid around the target, along the approach and the CT's voxels.

use bonemill_geometry::{Ct, Grid, Point, Rigid, Work, basis};
use nalgebra::{Rotation3, Vector3};

use super::mask::Drawn;
use super::{SceneError, SceneSpec};

/// A voxel axis within this of the basis lies along it, rad.
const ALIGNED_RAD: f64 = 1e-9;
/// Most voxels of a work grid, whatever memory there is: what readers of a plan accept.
const MOST_VOXELS: f64 = 1e8;
/// Suggested spacings are multiples of this, mm.
const SPACING_STEP_MM: f64 = 0.01;

/// The planning grid and where it lies.
#[derive(Debug)]
pub(super) struct Crop {
    /// Cubic voxels.
    pub grid: Grid<Work>,
    /// Its frame in ct.
    pub ct_from_work: Rigid<Ct, Work>,
    /// How far it is turned about the approach from the basis of z, rad.
    pub turn_rad: f64,
}

impl Crop {
    /// The target's box seen along the approach, with room for the burr around and above it.
    ///
    /// # Errors
    /// [`SceneError::TooLarge`] beyond memory.
    pub fn around(spec: &SceneSpec, target: &Drawn, approach: &Vector3<f64>) -> Result<Self, SceneError> {
        let turn_rad = grid_turn(spec.ct.grid(), approach);
        let rotation = basis::from_z(approach) * Rotation3::from_axis_angle(&Vector3::z_axis(), turn_rad);
        // of a label's voxel boxes, seen along the work axes
        let labels = spec.labels.grid();
        let half = (rotation.inverse().matrix() * labels.axes()).abs() * labels.spacing_mm() * 0.5;
        let boxes = target.0.iter().flat_map(|part| {
            let turned = part.points.iter().map(|p| Point::<Ct>::from_coords(rotation.inverse() * p.coords));
            let (lo, hi) = extent(turned);
            let around = part.label_margin_mm.map_or(Vector3::zeros(), |mm| half.add_scalar(mm));
            [Point::<Ct>::from_coords(lo - around), Point::from_coords(hi + around)]
        });
        let (lo, hi) = extent(boxes);
        let h = spec.spacing_mm;
        // Voxels cover the target's extent and are centred on it: where they divide it, their faces are its faces; and a mirrored
        // or turned scan has the mirrored or turned grid. Rounding must not add a voxel in one copy of a scan.
        let cells = |length: f64| (length / h - 1e-4).ceil().max(1.0);
        let inner = (hi - lo).map(cells);
        let around = cells(spec.tool.cutter_radius_mm + spec.margin_mm);
        let above = cells(spec.tool.cutter_radius_mm);
        let dims = inner + Vector3::new(2.0 * around, 2.0 * around, 2.0 * around + above);
        let middle = 0.5 * (lo + hi);
        let low = middle - (inner * 0.5 + Vector3::repeat(around - 0.5)) * h;
        let voxels = dims.product();
        let mb_per_voxel = spec.memory.bytes_per_voxel * 1e-6;
        let available = spec.memory.available_mb.unwrap_or(f64::INFINITY) / mb_per_voxel;
        let most = MOST_VOXELS.min(available);
        if voxels > most || voxels.is_nan() {
            return Err(SceneError::TooLarge {
                voxels,
                needed_mb: voxels * mb_per_voxel,
                most_mb: most * mb_per_voxel,
                is_available: available <= MOST_VOXELS,
                // a step more, since voxels are counted in whole numbers
                fitting_mm: ((h * (voxels / most).cbrt() / SPACING_STEP_MM).ceil() + 1.0) * SPACING_STEP_MM,
                extent: format!("{:.1} × {:.1} × {:.1}", hi.x - lo.x, hi.y - lo.y, hi.z - lo.z),
                spacing_mm: spec.spacing_mm,
            });
        }
        let dims = [dims.x as usize, dims.y as usize, dims.z as usize];
        let grid = Grid::aligned(dims, spec.spacing_mm, Point::new(0.0, 0.0, 0.0))?;
        Ok(Self { grid, ct_from_work: Rigid::new(rotation, rotation * low), turn_rad })
    }
}

/// How far the grid is turned about the approach from the basis of z, so that it lies along the voxels of the CT as far as
/// the approach lets it: a turned scan then has the turned grid, and where the approach is an axis of the scan, nothing is
/// blurred by sampling obliquely. Rad in [−π/4, π/4].
fn grid_turn(ct: &Grid<Ct>, approach: &Vector3<f64>) -> f64 {
    let axes = ct.axes();
    // the axis most nearly across the approach; a later one must be so by more than rounding
    let mut across = axes.column(0).into_owned();
    for axis in axes.column_iter().skip(1) {
        if axis.dot(approach).abs() < across.dot(approach).abs() - ALIGNED_RAD {
            across = axis.into_owned();
        }
    }
    let seen = basis::from_z(approach).inverse() * across;
    let angle = seen.y.atan2(seen.x);
    let quarter = std::f64::consts::FRAC_PI_2;
    let turn = angle - (angle / quarter).round() * quarter;
    // along the axes to rounding: exactly along them
    if turn.abs() < ALIGNED_RAD { 0.0 } else { turn }
}

/// Axis-aligned extent of points in ct.
pub(super) fn extent(points: impl IntoIterator<Item = Point<Ct>>) -> (Vector3<f64>, Vector3<f64>) {
    points
        .into_iter()
        .fold((Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY)), |(lo, hi), p| {
            (lo.inf(&p.coords), hi.sup(&p.coords))
        })
}
