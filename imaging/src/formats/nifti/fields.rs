//! The fields of a NIfTI header that say how voxels are stored and where they lie, of either version and in either byte order.
//!
//! NIfTI-2 has the same fields as NIfTI-1 at other offsets and wider: 64-bit sizes, double precision. Fields are taken as they are;
//! the modules beside this one judge their values.
//! **Source:** `nifti1.h` and `nifti2.h`, NIfTI data format working group.

use super::problem::NiftiProblem;

/// Bytes of a NIfTI-1 header, and of NIfTI-2's, which begins with as many.
pub(crate) const HEADER_BYTES: usize = 348;
const HEADER_2_BYTES: usize = 540;

/// A version of the format: widths in bytes and offsets of its fields.
#[derive(Debug)]
pub(crate) struct Version {
    pub header_bytes: usize,
    /// How a header announces itself and voxels behind it, or voxels in a file beside it.
    magics: [&'static [u8]; 2],
    magic: usize,
    datatype: usize,
    bitpix: usize,
    dim: usize,
    dim_bytes: usize,
    /// Bytes of every real number but vox_offset.
    real_bytes: usize,
    pixdim: usize,
    vox_offset: usize,
    /// Whether vox_offset is a whole number.
    whole_offset: bool,
    slope: usize,
    code_bytes: usize,
    codes: usize,
    quatern: usize,
    srow: usize,
    units: usize,
    units_bytes: usize,
}

/// NIfTI-1.
const ONE: Version = Version {
    header_bytes: HEADER_BYTES,
    magics: [b"n+1\0", b"ni1\0"],
    magic: 344,
    datatype: 70,
    bitpix: 72,
    dim: 40,
    dim_bytes: 2,
    real_bytes: 4,
    pixdim: 76,
    vox_offset: 108,
    whole_offset: false,
    slope: 112,
    code_bytes: 2,
    codes: 252,
    quatern: 256,
    srow: 280,
    units: 123,
    units_bytes: 1,
};

/// NIfTI-2. The line ends in its mark show a file that was transferred as text.
const TWO: Version = Version {
    header_bytes: HEADER_2_BYTES,
    magics: [b"n+2\0\r\n\x1a\n", b"ni2\0\r\n\x1a\n"],
    magic: 4,
    datatype: 12,
    bitpix: 14,
    dim: 16,
    dim_bytes: 8,
    real_bytes: 8,
    pixdim: 104,
    vox_offset: 168,
    whole_offset: true,
    slope: 176,
    code_bytes: 4,
    codes: 344,
    quatern: 352,
    srow: 400,
    units: 500,
    units_bytes: 4,
};

/// What a header holds.
#[derive(Debug, Clone)]
pub(crate) struct Fields {
    pub version: &'static Version,
    pub big_endian: bool,
    /// Whether the voxels are in a file beside the header's.
    pub is_pair: bool,
    /// As the standard says, signed.
    pub dim: [i64; 8],
    pub datatype: i16,
    pub bitpix: i16,
    pub pixdim: [f64; 8],
    pub vox_offset: f64,
    /// Slope and intercept.
    pub scaling: [f64; 2],
    pub xyzt_units: u8,
    pub qform_code: i32,
    pub sform_code: i32,
    /// b, c, d.
    pub quaternion: [f64; 3],
    pub qoffset: [f64; 3],
    pub srow: [[f64; 4]; 3],
}

impl Version {
    /// The version of a header that begins with these bytes, and whether it is big endian: both are told by its size.
    ///
    /// # Errors
    /// [`NiftiProblem::NotNifti`].
    pub fn of(bytes: &[u8; HEADER_BYTES]) -> Result<(&'static Self, bool), NiftiProblem> {
        let size = [bytes[0], bytes[1], bytes[2], bytes[3]];
        let sizes = [i32::from_le_bytes(size), i32::from_be_bytes(size)];
        for (version, header_bytes) in [(&ONE, 348), (&TWO, 540)] {
            if let Some(place) = sizes.iter().position(|size| *size == header_bytes) {
                return Ok((version, place == 1));
            }
        }
        Err(NiftiProblem::NotNifti { sizeof_hdr: sizes[0] })
    }
}

impl Fields {
    /// The fields of a whole header.
    ///
    /// # Errors
    /// [`NiftiProblem`] for a header that is short, or whose mark is not that of its version.
    pub fn of(bytes: &[u8], version: &'static Version, big_endian: bool) -> Result<Self, NiftiProblem> {
        if bytes.len() < version.header_bytes {
            return Err(NiftiProblem::NoHeader {
                found_bytes: bytes.len(),
                expected_bytes: version.header_bytes,
            });
        }
        let numbers = Numbers { bytes, big_endian };
        let whole = |at: usize, width: usize| numbers.whole(at, width);
        let real = |at: usize| numbers.real(at, version.real_bytes);
        let next = |at: usize, n: usize| real(at + n * version.real_bytes);
        let expected = version.magics;
        let found = bytes.get(version.magic..version.magic + expected[0].len()).unwrap_or_default();
        let is_pair = match expected.iter().position(|magic| *magic == found) {
            Some(place) => place == 1,
            None => return Err(NiftiProblem::Magic { found: found.to_vec(), expected: expected[0] }),
        };
        let vox_offset = match version.whole_offset {
            true => whole(version.vox_offset, 8) as f64,
            false => real(version.vox_offset),
        };
        Ok(Self {
            version,
            big_endian,
            is_pair,
            dim: std::array::from_fn(|n| whole(version.dim + n * version.dim_bytes, version.dim_bytes)),
            datatype: whole(version.datatype, 2) as i16,
            bitpix: whole(version.bitpix, 2) as i16,
            pixdim: std::array::from_fn(|n| next(version.pixdim, n)),
            vox_offset,
            scaling: std::array::from_fn(|n| next(version.slope, n)),
            xyzt_units: (whole(version.units, version.units_bytes) & 0xff) as u8,
            qform_code: whole(version.codes, version.code_bytes) as i32,
            sform_code: whole(version.codes + version.code_bytes, version.code_bytes) as i32,
            quaternion: std::array::from_fn(|n| next(version.quatern, n)),
            qoffset: std::array::from_fn(|n| next(version.quatern, 3 + n)),
            srow: std::array::from_fn(|row| std::array::from_fn(|n| next(version.srow, 4 * row + n))),
        })
    }
}

/// Numbers at offsets of a header.
struct Numbers<'a> {
    bytes: &'a [u8],
    big_endian: bool,
}

impl Numbers<'_> {
    /// The lowest `width` of eight bytes, the least significant first.
    fn at(&self, offset: usize, width: usize) -> [u8; 8] {
        let mut eight = [0; 8];
        let stored = self.bytes.get(offset..offset + width).unwrap_or_default();
        eight.iter_mut().zip(stored).for_each(|(byte, stored)| *byte = *stored);
        if self.big_endian {
            eight.iter_mut().zip(stored.iter().rev()).for_each(|(byte, stored)| *byte = *stored);
        }
        eight
    }

    /// A signed number of `width` bytes.
    fn whole(&self, offset: usize, width: usize) -> i64 {
        let unused_bits = 64 - 8 * width as u32;
        i64::from_le_bytes(self.at(offset, width)) << unused_bits >> unused_bits
    }

    /// In single precision, or double where `width` is 8.
    fn real(&self, offset: usize, width: usize) -> f64 {
        let eight = self.at(offset, width);
        match eight {
            [a, b, c, d, ..] if width == 4 => f64::from(f32::from_le_bytes([a, b, c, d])),
            _ => f64::from_le_bytes(eight),
        }
    }
}
