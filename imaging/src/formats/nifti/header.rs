//! The 348 bytes of a NIfTI-1 header: how the voxels are stored.
//!
//! The `nifti` crate parses the fields; this module checks their values, because that crate accepts some impossible
//! headers (a NaN slope, voxels that do not start at byte 352).

use nifti::{Endianness, NiftiHeader, NiftiType};

use super::super::ReadWarning;
use super::super::stored::{MAX_VOXELS, NumberType, Stored};
use super::problem::NiftiProblem;

/// Bytes of a NIfTI-1 header.
pub(crate) const HEADER_BYTES: usize = 348;
/// The first byte at which voxels may start: header and extension flag.
const FIRST_DATA_BYTE: f32 = 352.0;

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

/// Header, layout and warnings for the user.
pub(crate) type Parsed = (NiftiHeader, Layout, Vec<ReadWarning>);

/// Checks all of the header's fields except the transforms.
///
/// # Errors
/// [`NiftiProblem`] that names the field and its value.
pub(crate) fn parse(bytes: &[u8; HEADER_BYTES]) -> Result<Parsed, NiftiProblem> {
    let big_endian = endianness(bytes)?;
    let magic = [bytes[344], bytes[345], bytes[346], bytes[347]];
    let is_pair = match &magic {
        b"n+1\0" => false,
        b"ni1\0" => true,
        _ => return Err(NiftiProblem::Magic { found: magic }),
    };
    // the standard defines them as signed
    let dim: [i16; 8] = std::array::from_fn(|n| {
        let pair = [bytes[40 + 2 * n], bytes[41 + 2 * n]];
        if big_endian { i16::from_be_bytes(pair) } else { i16::from_le_bytes(pair) }
    });
    let dims = volume_dims(dim)?;
    // the crate tells the byte order by dim[0], which was checked above to be 1 to 7
    let header = NiftiHeader::from_reader(&bytes[..]).map_err(|_| NiftiProblem::Magic { found: magic })?;
    if (header.endianness == Endianness::Big) != big_endian {
        return Err(NiftiProblem::Dims { dim });
    }
    let mut warnings = Vec::new();
    let layout = Layout {
        dims,
        stored: Stored {
            number: number_type(&header)?,
            big_endian,
            scaling: scaling(&header, &mut warnings)?,
        },
        data_offset: data_offset(header.vox_offset, if is_pair { 0.0 } else { FIRST_DATA_BYTE })?,
        mm_per_unit: mm_per_unit(&header, &mut warnings)?,
        is_pair,
    };
    if layout.voxels() > MAX_VOXELS {
        return Err(NiftiProblem::TooLarge { dims, voxels: layout.voxels(), limit: MAX_VOXELS });
    }
    Ok((header, layout, warnings))
}

/// Whether the header is big endian, told by its size field.
fn endianness(bytes: &[u8; HEADER_BYTES]) -> Result<bool, NiftiProblem> {
    let size = [bytes[0], bytes[1], bytes[2], bytes[3]];
    match (i32::from_le_bytes(size), i32::from_be_bytes(size)) {
        (348, _) => Ok(false),
        (_, 348) => Ok(true),
        (540, _) | (_, 540) => Err(NiftiProblem::Nifti2),
        (sizeof_hdr, _) => Err(NiftiProblem::NotNifti { sizeof_hdr }),
    }
}

fn volume_dims(dim: [i16; 8]) -> Result<[usize; 3], NiftiProblem> {
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
    // at most 32767⁴: no overflow
    let volumes: u64 = sizes[3..].iter().product();
    if volumes != 1 {
        return Err(NiftiProblem::Volumes { dim, volumes });
    }
    Ok([sizes[0] as usize, sizes[1] as usize, sizes[2] as usize])
}

fn number_type(header: &NiftiHeader) -> Result<NumberType, NiftiProblem> {
    let code = header.datatype;
    let refuse = |name| Err(NiftiProblem::VoxelType { code, name });
    let number = match header.data_type() {
        Ok(NiftiType::Uint8) => NumberType::U8,
        Ok(NiftiType::Int8) => NumberType::I8,
        Ok(NiftiType::Uint16) => NumberType::U16,
        Ok(NiftiType::Int16) => NumberType::I16,
        Ok(NiftiType::Uint32) => NumberType::U32,
        Ok(NiftiType::Int32) => NumberType::I32,
        Ok(NiftiType::Uint64) => NumberType::U64,
        Ok(NiftiType::Int64) => NumberType::I64,
        Ok(NiftiType::Float32) => NumberType::F32,
        Ok(NiftiType::Float64) => NumberType::F64,
        Ok(NiftiType::Rgb24 | NiftiType::Rgba32) => return refuse("colour"),
        Ok(NiftiType::Complex64 | NiftiType::Complex128 | NiftiType::Complex256) => return refuse("complex"),
        Ok(NiftiType::Float128) => return refuse("128-bit float"),
        Err(_) => return refuse("unknown"),
    };
    let expected = number.bytes() * 8;
    if usize::try_from(header.bitpix) != Ok(expected) {
        return Err(NiftiProblem::Bits { bitpix: header.bitpix, code, expected });
    }
    Ok(number)
}

fn data_offset(vox_offset: f32, least: f32) -> Result<u64, NiftiProblem> {
    // single precision holds whole numbers exactly up to 2^24; NaN fails the comparison
    if !(vox_offset >= least && vox_offset <= (1 << 24) as f32 && vox_offset.fract() == 0.0) {
        return Err(NiftiProblem::VoxOffset { vox_offset });
    }
    Ok(vox_offset as u64)
}

/// Slope and intercept. By the standard, a slope of 0 means that values are stored unscaled. Some writers leave a NaN
/// slope for "not set"; it is treated the same, with a warning.
fn scaling(header: &NiftiHeader, warnings: &mut Vec<ReadWarning>) -> Result<Option<[f64; 2]>, NiftiProblem> {
    let (slope, inter) = (header.scl_slope, header.scl_inter);
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
    Ok((!identity).then_some([f64::from(slope), f64::from(inter)]))
}

fn mm_per_unit(header: &NiftiHeader, warnings: &mut Vec<ReadWarning>) -> Result<f64, NiftiProblem> {
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
