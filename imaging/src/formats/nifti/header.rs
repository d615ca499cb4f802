//! What a NIfTI header says about how the voxels are stored, checked field by field.

use super::super::ReadWarning;
use super::super::stored::{MAX_VOXELS, NumberType, Stored};
use super::fields::Fields;
use super::problem::NiftiProblem;

/// Bytes of the flag behind a header that tells whether extensions follow.
const FLAG_BYTES: usize = 4;
/// The last byte at which voxels may start: single precision holds whole numbers exactly up to it.
const MOST_OFFSET: f64 = (1 << 24) as f64;

/// How the voxels are stored.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Layout {
    /// Voxels along i, j, k.
    pub dims: [usize; 3],
    pub stored: Stored,
    /// Byte at which the voxels start, from the beginning of the decompressed file.
    pub data_offset: u64,
    pub mm_per_unit: f64,
    /// Whether the voxels are in a file beside the header's.
    pub is_pair: bool,
}

impl Layout {
    pub fn voxels(&self) -> u64 {
        self.dims.iter().map(|&d| d as u64).product()
    }

    pub fn data_bytes(&self) -> u64 {
        self.voxels() * self.stored.number.bytes() as u64
    }
}

/// Checks all of the header's fields except the transforms; the warnings are for the user.
///
/// # Errors
/// [`NiftiProblem`] that names the field and its value.
pub(crate) fn layout(header: &Fields) -> Result<(Layout, Vec<ReadWarning>), NiftiProblem> {
    let dims = volume_dims(header.dim)?;
    let mut warnings = Vec::new();
    let behind = header.version.header_bytes + FLAG_BYTES;
    let layout = Layout {
        dims,
        stored: Stored {
            number: number_type(header)?,
            big_endian: header.big_endian,
            scaling: scaling(header.scaling, &mut warnings)?,
        },
        data_offset: data_offset(header.vox_offset, if header.is_pair { 0 } else { behind })?,
        mm_per_unit: mm_per_unit(header, &mut warnings)?,
        is_pair: header.is_pair,
    };
    let voxels = dims.iter().fold(1u64, |all, d| all.saturating_mul(*d as u64));
    if voxels > MAX_VOXELS {
        return Err(NiftiProblem::TooLarge { dims, voxels, limit: MAX_VOXELS });
    }
    Ok((layout, warnings))
}

fn volume_dims(dim: [i64; 8]) -> Result<[usize; 3], NiftiProblem> {
    let bad = NiftiProblem::Dims { dim };
    let count = match usize::try_from(dim[0]) {
        Ok(n @ 1..=7) => n,
        _ => return Err(bad),
    };
    let mut sizes = [1u64; 7];
    for (size, &d) in sizes.iter_mut().zip(&dim[1..=count]) {
        match u64::try_from(d) {
            Ok(d @ 1..) => *size = d,
            _ => return Err(bad),
        }
    }
    let volumes = sizes[3..].iter().fold(1u64, |all, size| all.saturating_mul(*size));
    if volumes != 1 {
        return Err(NiftiProblem::Volumes { dim, volumes });
    }
    Ok([sizes[0] as usize, sizes[1] as usize, sizes[2] as usize])
}

fn number_type(header: &Fields) -> Result<NumberType, NiftiProblem> {
    let code = header.datatype;
    let number = match code {
        2 => NumberType::U8,
        256 => NumberType::I8,
        512 => NumberType::U16,
        4 => NumberType::I16,
        768 => NumberType::U32,
        8 => NumberType::I32,
        1280 => NumberType::U64,
        1024 => NumberType::I64,
        16 => NumberType::F32,
        64 => NumberType::F64,
        _ => {
            let name = match code {
                128 | 2304 => "colour",
                32 | 1792 | 2048 => "complex",
                1536 => "128-bit float",
                _ => "unknown",
            };
            return Err(NiftiProblem::VoxelType { code, name });
        }
    };
    let expected = number.bytes() * 8;
    if usize::try_from(header.bitpix) != Ok(expected) {
        return Err(NiftiProblem::Bits { bitpix: header.bitpix, code, expected });
    }
    Ok(number)
}

fn data_offset(vox_offset: f64, least: usize) -> Result<u64, NiftiProblem> {
    // NaN fails the comparison
    if !(vox_offset >= least as f64 && vox_offset <= MOST_OFFSET && vox_offset.fract() == 0.0) {
        return Err(NiftiProblem::VoxOffset { vox_offset, least });
    }
    Ok(vox_offset as u64)
}

/// Slope and intercept. By the standard, a slope of 0 means that values are stored unscaled. Some writers leave a NaN
/// slope for "not set"; it is treated the same, with a warning.
fn scaling(
    [slope, inter]: [f64; 2],
    warnings: &mut Vec<ReadWarning>,
) -> Result<Option<[f64; 2]>, NiftiProblem> {
    if slope.is_nan() {
        warnings.push(ReadWarning::SlopeNotANumber);
        return Ok(None);
    }
    if slope == 0.0 {
        return Ok(None);
    }
    if !(slope.is_finite() && inter.is_finite()) {
        return Err(NiftiProblem::Scaling { slope, inter });
    }
    let identity = slope == 1.0 && inter == 0.0;
    Ok((!identity).then_some([slope, inter]))
}

fn mm_per_unit(header: &Fields, warnings: &mut Vec<ReadWarning>) -> Result<f64, NiftiProblem> {
    let (mm, unit) = match header.xyzt_units & 0b111 {
        0 => {
            warnings.push(ReadWarning::UnitUnknown);
            return Ok(1.0);
        }
        1 => (1000.0, "m"),
        2 => return Ok(1.0),
        3 => (1e-3, "µm"),
        code => return Err(NiftiProblem::Units { code }),
    };
    warnings.push(ReadWarning::UnitConverted { unit });
    Ok(mm)
}
