//! Frames in the order of their positions along the normal, and the grid that they make.

use bonemill_geometry::{Ct, Grid};
use nalgebra::Vector3;

use super::super::stored::MAX_VOXELS;
use super::super::straight::{Affine, DISAGREEMENT_LIMIT_VOXELS, SHEAR_LIMIT_RAD};
use super::header::{Frame, Header};
use super::problem::DicomProblem;

/// Positions nearer than this are one position, mm.
const SAME_MM: f64 = 1e-3;
/// Directions and spacings that differ by less are the same: rounding of decimal strings.
const SAME: f64 = 1e-4;

/// Frames of a scan, sorted.
pub(super) struct Stack {
    pub grid: Grid<Ct>,
    /// File and frame of each slice, by increasing position along the normal.
    pub slices: Vec<(usize, usize)>,
}

/// A frame with its file.
struct Placed<'a> {
    file: usize,
    number: usize,
    header: &'a Header,
    frame: &'a Frame,
    along_mm: f64,
}

impl Stack {
    /// # Errors
    /// [`DicomProblem`] for slices that differ, share a position, are missing, unevenly spaced or sheared.
    pub fn new(headers: &[Header]) -> Result<Self, DicomProblem> {
        let (first_header, first) =
            headers.iter().find_map(|h| Some((h, h.frames.first()?))).ok_or(DicomProblem::NoSeries)?;
        let normal = first.along[0].cross(&first.along[1]).normalize();
        let mut placed = Vec::new();
        for (file, header) in headers.iter().enumerate() {
            if header.frames.is_empty() {
                let [attribute, expected] =
                    ["ImagePositionPatient", "a position for every slice of the series"];
                let found = "absent".into();
                return Err(DicomProblem::Attribute { file: header.name(), attribute, found, expected });
            }
            for (number, frame) in header.frames.iter().enumerate() {
                if let Some(attribute) = difference((first_header, first), (header, frame)) {
                    let (file, first) = (header.name(), first_header.name());
                    return Err(DicomProblem::Unlike { file, attribute, first });
                }
                let along_mm = frame.position.dot(&normal);
                placed.push(Placed { file, number, header, frame, along_mm });
            }
        }
        placed.sort_by(|a, b| a.along_mm.total_cmp(&b.along_mm));
        let step = step(&placed, &normal)?;
        let origin = placed.first().map_or(Vector3::zeros(), |p| p.frame.position);
        let [columns, rows] = first_header.size;
        let dims = [columns, rows, placed.len()];
        let voxels = dims.iter().fold(1u64, |all, n| all.saturating_mul(*n as u64));
        if voxels > MAX_VOXELS {
            return Err(DicomProblem::Sizes { dims, limit: MAX_VOXELS });
        }
        let grid = grid(first, step, origin, dims)?;
        Ok(Self { grid, slices: placed.iter().map(|p| (p.file, p.number)).collect() })
    }
}

/// The grid of frames like `frame` from `origin`, each `step` from the one before, LPS, mm.
///
/// # Errors
/// [`DicomProblem::Affine`].
pub(super) fn grid(
    frame: &Frame,
    step: Vector3<f64>,
    origin: Vector3<f64>,
    dims: [usize; 3],
) -> Result<Grid<Ct>, DicomProblem> {
    let [columns_mm, rows_mm] = frame.spacing_mm;
    let steps = [frame.along[0] * columns_mm, frame.along[1] * rows_mm, step];
    Ok(Affine::from_lps(steps, origin).grid(dims)?.0)
}

/// The first attribute in which a frame differs from another.
pub(super) fn difference(
    (first_header, first): (&Header, &Frame),
    (header, frame): (&Header, &Frame),
) -> Option<&'static str> {
    let far = |a: &Vector3<f64>, b: &Vector3<f64>| (a - b).amax() > SAME;
    if header.size != first_header.size {
        Some("Rows or Columns")
    } else if far(&frame.along[0], &first.along[0]) || far(&frame.along[1], &first.along[1]) {
        Some("ImageOrientationPatient")
    } else if (0..2).any(|a| (frame.spacing_mm[a] - first.spacing_mm[a]).abs() > SAME * first.spacing_mm[a]) {
        Some("PixelSpacing")
    } else {
        None
    }
}

/// The vector from a slice to the next.
fn step(placed: &[Placed<'_>], normal: &Vector3<f64>) -> Result<Vector3<f64>, DicomProblem> {
    let ([first, ..], [.., last]) = (placed, placed) else { return Err(DicomProblem::NoSeries) };
    if placed.len() < 2 {
        return Err(DicomProblem::SingleSlice { file: first.header.name() });
    }
    let pairs = || placed.iter().zip(placed.iter().skip(1));
    let mut gaps: Vec<f64> = pairs().map(|(a, b)| b.along_mm - a.along_mm).collect();
    gaps.sort_by(f64::total_cmp);
    let middle_mm = gaps.get(gaps.len() / 2).copied().unwrap_or(0.0);
    let least_mm = first.frame.spacing_mm[0].min(first.frame.spacing_mm[1]).min(middle_mm);
    let limit_mm = DISAGREEMENT_LIMIT_VOXELS * least_mm;
    for (a, b) in pairs() {
        let gap_mm = b.along_mm - a.along_mm;
        let (before, after) = (a.header.name(), b.header.name());
        let (before_mm, after_mm, spacing_mm) = (a.along_mm, b.along_mm, middle_mm);
        if gap_mm < SAME_MM {
            return Err(DicomProblem::Doubled { first: before, second: after, position_mm: before_mm });
        }
        if (gap_mm - middle_mm).abs() > limit_mm {
            let times = (gap_mm / middle_mm).round();
            if times >= 2.0 && (gap_mm - times * middle_mm).abs() <= limit_mm {
                let missing = times as usize - 1;
                return Err(DicomProblem::Missing {
                    before,
                    before_mm,
                    after,
                    after_mm,
                    missing,
                    spacing_mm,
                });
            }
            return Err(DicomProblem::Uneven { before, before_mm, after, after_mm, spacing_mm });
        }
    }
    let whole = last.frame.position - first.frame.position;
    let step = whole / (placed.len() - 1) as f64;
    let tilt_rad = step.normalize().dot(normal).clamp(-1.0, 1.0).acos();
    let aside_mm = (whole - normal * whole.dot(normal)).norm();
    if tilt_rad > SHEAR_LIMIT_RAD && aside_mm > limit_mm {
        return Err(DicomProblem::Tilted { tilt_deg: tilt_rad.to_degrees() });
    }
    for (n, p) in placed.iter().enumerate() {
        let off_mm = (first.frame.position + step * n as f64 - p.frame.position).norm();
        if off_mm > limit_mm {
            return Err(DicomProblem::Aside { file: p.header.name(), off_mm });
        }
    }
    Ok(step)
}
