//! Which of a NIfTI header's transforms places the voxels in the `ct` frame, and whether it can.
//!
//! NIfTI's world is RAS+ already, so nothing is flipped here; only a unit other than mm is converted. The sform is used
//! if it is set, else the qform. When both are set and place a corner of the volume more than
//! [`DISAGREEMENT_LIMIT_VOXELS`] apart, one of them is wrong (often mirrored), and the case must say which one is right.
//! A header with voxel sizes alone does not tell left from right and is refused.
//!
//! The lengths of the sform's columns and pixdim state the voxels' size twice. Where the two put a corner of the volume more
//! than that far apart, one of them is wrong, whether or not a qform is set, and the case must choose the sform to keep it.
//!
//! A qform stores b, c, d of its quaternion in single precision (in NIfTI-2 in double, but often made of NIfTI-1's) and leaves out a = √(1 − b² − c² − d²). Close to a half
//! turn the rounding of b, c, d alone changes a by up to 10⁻³, which moves a corner of a large scan by a third of a voxel.
//! A difference from the sform that this rounding can explain is not counted as a disagreement.
//!
//! Axes must be perpendicular, up to rounding: `straight.rs` says how far.

use std::fmt;

use bonemill_geometry::{Ct, Grid};
use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3};

use super::super::straight::{Affine, DISAGREEMENT_LIMIT_VOXELS};
use super::fields::Fields;
use super::problem::NiftiProblem;

/// The most by which rounding b, c, d to single precision changes b² + c² + d², with a margin for writers that also
/// compute in single precision.
const QUATERNION_ROUNDING: f64 = 5e-7;

/// Which transform of an image header to use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AffineChoice {
    /// The sform, else the qform; refused when both are set and disagree.
    Auto,
    /// The sform, whatever the qform says.
    Sform,
    /// The qform, whatever the sform says.
    Qform,
}

/// One of the header's transforms.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AffineSource {
    /// The matrix `srow_x`, `srow_y`, `srow_z`.
    Sform,
    /// The quaternion with `pixdim`.
    Qform,
}

impl fmt::Display for AffineSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Sform => "sform",
            Self::Qform => "qform",
        })
    }
}

/// Which transform placed an image, and how good it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AffineReport {
    /// The transform used.
    pub source: AffineSource,
    /// `sform_code`; 0 is unset.
    pub sform_code: i32,
    /// `qform_code`; 0 is unset.
    pub qform_code: i32,
    /// Largest distance between a corner's positions by sform and by qform, in units of the smallest voxel spacing; `None`
    /// unless both are set and possible.
    pub disagreement_voxels: Option<f64>,
    /// Deviation of the axes from a right angle before they were made perpendicular, rad.
    pub shear_rad: f64,
}

impl fmt::Display for AffineReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} (sform code {}, qform code {})", self.source, self.sform_code, self.qform_code)?;
        match self.disagreement_voxels {
            Some(voxels) => write!(f, ", which differ by {voxels:.3} voxel"),
            None => Ok(()),
        }
    }
}

/// The grid that `header` places in `ct`. `mm_per_unit` converts the header's unit of length.
///
/// # Errors
/// A [`NiftiProblem`] for each refusal that the module describes.
pub(crate) fn grid_from_header(
    header: &Fields,
    dims: [usize; 3],
    mm_per_unit: f64,
    choice: AffineChoice,
) -> Result<(Grid<Ct>, AffineReport), NiftiProblem> {
    let (sform_code, qform_code) = (header.sform_code, header.qform_code);
    let source = chosen(choice, sform_code, qform_code)?;
    let placement = match source {
        AffineSource::Sform => sform(header, mm_per_unit)?,
        AffineSource::Qform => qform(header, mm_per_unit, None)?,
    };
    let (grid, shear_rad) = placement.grid(dims).map_err(|fault| NiftiProblem::from_affine(source, fault))?;

    let other = match source {
        AffineSource::Sform if qform_code > 0 => {
            Some(qform(header, mm_per_unit, Some(real_part(grid.axes()))))
        }
        AffineSource::Qform if sform_code > 0 => Some(sform(header, mm_per_unit)),
        _ => None,
    };
    let other = match choice {
        AffineChoice::Auto => other.transpose()?,
        // the case chose one transform, so an error in the other one does not matter
        _ => other.and_then(Result::ok),
    };
    let disagreement_voxels = other.map(|other| placement.corner_distance_voxels(&other, dims));
    if let (AffineChoice::Auto, Some(voxels)) = (choice, disagreement_voxels)
        && voxels > DISAGREEMENT_LIMIT_VOXELS
    {
        let limit = DISAGREEMENT_LIMIT_VOXELS;
        return Err(NiftiProblem::Disagreement { sform_code, qform_code, voxels, limit });
    }
    if choice == AffineChoice::Auto {
        check_sizes(header, &placement, dims, mm_per_unit)?;
    }
    Ok((grid, AffineReport { source, sform_code, qform_code, disagreement_voxels, shear_rad }))
}

/// Refuses voxel sizes that contradict pixdim: a qform's are pixdim itself, a sform's are the lengths of its columns.
fn check_sizes(
    header: &Fields,
    placement: &Affine,
    dims: [usize; 3],
    mm_per_unit: f64,
) -> Result<(), NiftiProblem> {
    let pixdim_mm = Vector3::from_fn(|a, _| header.pixdim[a + 1] * mm_per_unit);
    let affine_mm = placement.spacing_mm();
    let scale = Matrix3::from_diagonal(&pixdim_mm.component_div(&affine_mm));
    let by_pixdim = Affine { linear: placement.linear * scale, offset: placement.offset };
    let voxels = placement.corner_distance_voxels(&by_pixdim, dims);
    // a pixdim that is no size at all contradicts, too
    if pixdim_mm.iter().all(|mm| *mm > 0.0) && voxels <= DISAGREEMENT_LIMIT_VOXELS {
        return Ok(());
    }
    let limit = DISAGREEMENT_LIMIT_VOXELS;
    Err(NiftiProblem::VoxelSizes { affine_mm: affine_mm.into(), pixdim_mm: pixdim_mm.into(), voxels, limit })
}

fn chosen(choice: AffineChoice, sform_code: i32, qform_code: i32) -> Result<AffineSource, NiftiProblem> {
    let set = |wanted, code| match code {
        1.. => Ok(wanted),
        _ => Err(NiftiProblem::TransformUnset { wanted, sform_code, qform_code }),
    };
    match choice {
        AffineChoice::Sform => set(AffineSource::Sform, sform_code),
        AffineChoice::Qform => set(AffineSource::Qform, qform_code),
        AffineChoice::Auto if sform_code > 0 => Ok(AffineSource::Sform),
        AffineChoice::Auto if qform_code > 0 => Ok(AffineSource::Qform),
        AffineChoice::Auto => Err(NiftiProblem::NoTransform),
    }
}

fn sform(header: &Fields, mm_per_unit: f64) -> Result<Affine, NiftiProblem> {
    let rows = header.srow;
    if rows.iter().flatten().any(|v| !v.is_finite()) {
        return Err(NiftiProblem::AffineNotFinite { which: AffineSource::Sform });
    }
    Ok(Affine {
        linear: Matrix3::from_fn(|r, c| rows[r][c] * mm_per_unit),
        offset: Vector3::from_fn(|r, _| rows[r][3] * mm_per_unit),
    })
}

/// The real part a ≥ 0 of the quaternion of a grid's axes; the third axis is reversed first if they are mirrored.
fn real_part(axes: &Matrix3<f64>) -> f64 {
    let mut turn = *axes;
    turn.set_column(2, &(axes.column(2) * axes.determinant().signum()));
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(turn)).w.abs()
}

/// The standard's "method 2": R(quaternion) · diag(pixdim) with the third axis times qfac. b, c and d are rounded, so a
/// is known only within a range; if `real_part` is given, the value of that range nearest to it is taken.
fn qform(header: &Fields, mm_per_unit: f64, real_part: Option<f64>) -> Result<Affine, NiftiProblem> {
    let (vector, offset) = (Vector3::from(header.quaternion), Vector3::from(header.qoffset));
    let pixdim: [f64; 3] = std::array::from_fn(|a| header.pixdim[a + 1]);
    let size = Vector3::from(pixdim);
    if !vector.iter().chain(&offset).chain(&size).all(|v| v.is_finite()) || header.pixdim[0].is_nan() {
        return Err(NiftiProblem::AffineNotFinite { which: AffineSource::Qform });
    }
    let square = vector.norm_squared();
    // b, c, d are rounded to single precision, so the sum may exceed 1 for a half turn
    if square > 1.0 + 1e-5 || size.min() <= 0.0 {
        return Err(NiftiProblem::Qform { quaternion_square: square, pixdim });
    }
    let root = |rounding: f64| (1.0 - square + rounding).max(0.0).sqrt();
    let real =
        real_part.map_or(root(0.0), |a| a.clamp(root(-QUATERNION_ROUNDING), root(QUATERNION_ROUNDING)));
    let quaternion = Quaternion::from_parts(real, vector);
    let rotation = UnitQuaternion::from_quaternion(quaternion).to_rotation_matrix();
    // qfac 0 means +1
    let qfac = if header.pixdim[0] < 0.0 { -1.0 } else { 1.0 };
    let scale = Vector3::new(size.x, size.y, size.z * qfac) * mm_per_unit;
    Ok(Affine {
        linear: rotation.into_inner() * Matrix3::from_diagonal(&scale),
        offset: offset * mm_per_unit,
    })
}
