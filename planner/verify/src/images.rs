//! Reads the plan's images again, NIfTI-1 and -2 in one file and NRRD, with code of its own: one wrong reader cannot fool both. Images of
//! other formats, and of what is rare in NRRD, are read by the planner's reader, and the verdict says so.
//!
//! Fields are taken at the byte offsets of `nifti1.h` and `nifti2.h` (**Source:** NIfTI data format working group), and a file is refused unless
//! header, voxels and transform are beyond doubt: the sform if its code is above 0, else the qform; a slope of 0 (or NaN, as some
//! writers leave it) means no scaling. Not read: several volumes, colours.

use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

use bonemill_geometry::{Ct, Grid, Volume};
use bonemill_imaging::AffineChoice;
use flate2::bufread::MultiGzDecoder;
use nalgebra::{Matrix3, Vector3};

use super::VerifyError;
use super::error::ReadProblem;

mod moved;
mod nrrd;
mod segments;
mod shared;

pub use moved::MaskRule;
pub use segments::LabelsRead;
pub use shared::SharedReader;

/// Where a version of the format has its fields, and how wide they are.
struct Places {
    /// Header and extension flag, bytes: voxels start there or later.
    header: usize,
    mark: (usize, &'static [u8]),
    dim: (usize, usize),
    datatype: usize,
    bitpix: usize,
    /// Bytes of real numbers.
    real: usize,
    pixdim: usize,
    vox_offset: usize,
    scaling: usize,
    /// qform_code, sform_code and their width.
    codes: (usize, usize, usize),
    quaternion: usize,
    rows: usize,
    units: (usize, usize),
}

const FIRST: Places = Places {
    header: 352,
    mark: (344, b"n+1\0"),
    dim: (40, 2),
    datatype: 70,
    bitpix: 72,
    real: 4,
    pixdim: 76,
    vox_offset: 108,
    scaling: 112,
    codes: (252, 254, 2),
    quaternion: 256,
    rows: 280,
    units: (123, 1),
};
const SECOND: Places = Places {
    header: 544,
    mark: (4, b"n+2\0\r\n\x1a\n"),
    dim: (16, 8),
    datatype: 12,
    bitpix: 14,
    real: 8,
    pixdim: 104,
    vox_offset: 168,
    scaling: 176,
    codes: (344, 348, 4),
    quaternion: 352,
    rows: 400,
    units: (500, 4),
};

/// Most bytes after the last voxel that may be padding, and most voxels.
const PADDING_BYTES: usize = 4096;
const MOST_VOXELS: u64 = 1 << 31;
/// Largest difference of two statements about where a corner lies, in smallest voxels; of axes from a right angle, rad; and of
/// b² + c² + d² by single precision.
const SAME_VOXELS: f64 = 0.1;
const SHEAR_RAD: f64 = 1e-3;
const QUATERNION_ROUNDING: f64 = 5e-7;

/// Below it lies what scanners write outside their field of view: it counts as air, HU.
const PADDING_HU: f32 = -1500.0;
/// HU of air.
const AIR_HU: f32 = -1000.0;

/// A CT's grey values; of a folder with several DICOM series that with a name. The second value tells of a format that
/// only the planner's reader knows.
///
/// # Errors
/// [`VerifyError::Image`] for a file that is not beyond doubt, and for values that are not finite.
pub fn ct(
    path: &Path,
    choice: AffineChoice,
    series: Option<&str>,
) -> Result<(Volume<f32, Ct>, Option<SharedReader>), VerifyError> {
    let (mut ct, reader) = match shared::format(path)? {
        Some(format) => {
            let (ct, reader) = shared::ct(path, choice, series, format)?;
            (ct, Some(reader))
        }
        None => (ct_as_stored(path, choice)?, None),
    };
    ct.data_mut().iter_mut().filter(|v| **v < PADDING_HU).for_each(|v| *v = AIR_HU);
    Ok((ct, reader))
}

fn ct_as_stored(path: &Path, choice: AffineChoice) -> Result<Volume<f32, Ct>, VerifyError> {
    image(path, choice, "a finite number", |v| Some(v as f32).filter(|v| v.is_finite())).map(|(ct, _)| ct)
}

/// A label map, with what its own file says about names and shared voxels, and as for a CT its reader.
///
/// # Errors
/// [`VerifyError::Image`] for a file that is not beyond doubt, and for values that are no label.
pub fn labels(path: &Path, choice: AffineChoice) -> Result<(LabelsRead, Option<SharedReader>), VerifyError> {
    if let Some(format) = shared::format(path)? {
        let (labels, reader) = shared::labels(path, choice, format)?;
        return Ok((labels, Some(reader)));
    }
    let label = |v: f64| {
        let is_whole = |n: &f64| (v - n).abs() <= 1e-6 * n.max(1.0);
        Some(v.round()).filter(|n| (0.0..=65535.0).contains(n) && is_whole(n)).map(|n| n as u16)
    };
    let (shown, more) = image(path, choice, "a whole number from 0 to 65535", label)?;
    let labels = segments::labels_read(shown, more);
    labels.map(|labels| (labels, None)).map_err(|problem| VerifyError::Image { path: path.into(), problem })
}

/// What a file says beside the first number of each voxel.
enum More<T> {
    /// Bytes between a NIfTI header and its voxels.
    Extension(Vec<u8>),
    /// All numbers of an NRRD file, those of one voxel side by side, and its segments.
    Layers(Vec<T>, Vec<(String, usize, u16)>),
}

fn image<T: Copy>(
    path: &Path,
    choice: AffineChoice,
    expected: &'static str,
    convert: impl Fn(f64) -> Option<T>,
) -> Result<(Volume<T, Ct>, More<T>), VerifyError> {
    let valid = |(voxel, value)| convert(value).ok_or(ReadProblem::Voxel { voxel, value, expected });
    let read = || -> Result<_, ReadProblem> {
        let mut file = BufReader::new(File::open(path)?);
        let is_gzip = file.fill_buf()?.starts_with(&[0x1f, 0x8b]);
        let mut bytes: Box<dyn BufRead> =
            if is_gzip { Box::new(BufReader::new(MultiGzDecoder::new(file))) } else { Box::new(file) };
        if bytes.fill_buf()?.starts_with(b"NRRD") {
            let nrrd = nrrd::read(path)?;
            let values = nrrd.values.into_iter().enumerate().map(valid).collect::<Result<Vec<T>, _>>()?;
            if nrrd.layers > 1 && nrrd.segments.is_empty() {
                return Err(ReadProblem::Header { field: "sizes".into(), expected: "one value a voxel" });
            }
            let first = values.chunks_exact(nrrd.layers).filter_map(|of_voxel| of_voxel.first().copied());
            return Ok((Volume::new(nrrd.grid, first.collect())?, More::Layers(values, nrrd.segments)));
        }
        let header = Header::read(bytes.as_mut())?;
        let grid = header.grid(choice)?;
        let (values, extension) = header.voxels(bytes.as_mut(), valid)?;
        Ok((Volume::new(grid, values)?, More::Extension(extension)))
    };
    read().map_err(|problem| VerifyError::Image { path: path.into(), problem })
}

/// Voxel sizes, mm, and the nearest perpendicular axes of the steps along i, j, k; `Affine` where these are not perpendicular, up to
/// rounding.
fn straight_axes(
    linear: &Matrix3<f64>,
    dims: [usize; 3],
) -> Result<(Vector3<f64>, Matrix3<f64>), ReadProblem> {
    let spacing = Vector3::from_fn(|a, _| linear.column(a).norm());
    let unit = Matrix3::from_fn(|r, c| linear[(r, c)] / spacing[c]);
    if !spacing.iter().all(|mm| (1e-3..=20.0).contains(mm)) {
        return Err(ReadProblem::Affine("values that are not finite, or voxels not of 0.001 to 20 mm"));
    }
    // the nearest orthonormal axes are U Vᵀ
    let svd = (unit.determinant().abs() >= 1e-3).then(|| unit.svd(true, true));
    let Some((u, v_t)) = svd.and_then(|svd| svd.u.zip(svd.v_t)) else {
        return Err(ReadProblem::Affine("axes that do not span space"));
    };
    let axes = u * v_t;
    let off = [(0, 1), (0, 2), (1, 2)].map(|(a, b)| unit.column(a).dot(&unit.column(b)).abs());
    let far = |n: usize| Vector3::from_fn(|a, _| (n >> a & 1) as f64 * dims[a] as f64 - 0.5);
    let moved = |n: usize| ((linear - axes * Matrix3::from_diagonal(&spacing)) * far(n)).norm();
    if off.iter().any(|c| c.asin() > SHEAR_RAD) || (0..8).any(|n| moved(n) > SAME_VOXELS * spacing.min()) {
        return Err(ReadProblem::Affine("axes that are not perpendicular"));
    }
    Ok((spacing, axes))
}

/// The first bytes of a file, in its own byte order.
struct Header {
    bytes: Vec<u8>,
    of: &'static Places,
    is_big: bool,
    dims: [usize; 3],
    mm: f64,
}

impl Header {
    fn read(from: &mut dyn Read) -> Result<Self, ReadProblem> {
        let mut size = [0; 4];
        from.read_exact(&mut size)?;
        let (of, is_big) = match [i32::from_le_bytes(size), i32::from_be_bytes(size)] {
            [348, _] => (&FIRST, false),
            [_, 348] => (&FIRST, true),
            [540, _] => (&SECOND, false),
            [_, 540] => (&SECOND, true),
            _ => return Err(ReadProblem::NotNifti),
        };
        let mut bytes = size.to_vec();
        bytes.resize(of.header, 0);
        from.read_exact(&mut bytes[4..])?;
        if !bytes[of.mark.0..].starts_with(of.mark.1) {
            return Err(ReadProblem::NotNifti);
        }
        let mut header = Self { bytes, of, is_big, dims: [1; 3], mm: 1.0 };
        let (at, width) = of.dim;
        let dim: [u64; 8] = std::array::from_fn(|n| header.whole(at + n * width, width).max(0) as u64);
        let used = usize::try_from(dim[0]).ok().and_then(|last| dim.get(1..=last)).unwrap_or_default();
        let (space, time) = used.split_at(used.len().min(3));
        let voxels = space.iter().fold(1u64, |all, n| all.saturating_mul(*n));
        if used.is_empty() || !(1..=MOST_VOXELS).contains(&voxels) || time.iter().any(|n| *n != 1) {
            return Err(field("dim", voxels as f64, "one volume of at most 2^31 voxels"));
        }
        header.dims = std::array::from_fn(|a| space.get(a).map_or(1, |n| *n as usize));
        header.mm = match header.whole(of.units.0, of.units.1) & 7 {
            0 | 2 => 1.0,
            1 => 1e3,
            3 => 1e-3,
            code => return Err(field("xyzt_units", code as f64, "0 to 3 for lengths")),
        };
        Ok(header)
    }

    /// `width` bytes at an offset, the least significant first, above zeros.
    fn at(&self, offset: usize, width: usize) -> [u8; 8] {
        let mut found = [0; 8];
        found[8 - width..].copy_from_slice(&self.bytes[offset..offset + width]);
        if self.is_big {
            found[8 - width..].reverse();
        }
        found
    }

    fn whole(&self, offset: usize, width: usize) -> i64 {
        i64::from_le_bytes(self.at(offset, width)) >> (64 - 8 * width)
    }

    /// The number `n` of real numbers that begin at an offset.
    fn real(&self, offset: usize, n: usize) -> f64 {
        let found = self.at(offset + n * self.of.real, self.of.real);
        let [.., a, b, c, d] = found;
        if self.of.real == 4 {
            f64::from(f32::from_le_bytes([a, b, c, d]))
        } else {
            f64::from_le_bytes(found)
        }
    }

    /// What `valid` makes of every voxel's number and value after scaling, in the file's order, and the bytes before.
    fn voxels<T>(
        &self,
        from: &mut dyn Read,
        valid: impl Fn((usize, f64)) -> Result<T, ReadProblem>,
    ) -> Result<(Vec<T>, Vec<u8>), ReadProblem> {
        let (code, bitpix) = (self.whole(self.of.datatype, 2), self.whole(self.of.bitpix, 2));
        let offset = match self.of.real {
            8 => self.whole(self.of.vox_offset, 8) as f64,
            _ => self.real(self.of.vox_offset, 0),
        };
        let size = match code {
            2 | 256 => 1,
            4 | 512 => 2,
            8 | 16 | 768 => 4,
            64 | 1024 | 1280 => 8,
            _ => return Err(field("datatype", code as f64, "a number of 8 to 64 bits")),
        };
        if usize::try_from(bitpix) != Ok(8 * size) {
            return Err(field("bitpix", bitpix as f64, "that of datatype"));
        }
        let first = self.of.header as f64;
        if !(offset >= first && offset <= f64::from(1 << 24) && offset.fract() == 0.0) {
            return Err(field("vox_offset", offset, "a whole number from the end of the header"));
        }
        let [slope, intercept] = match [0, 1].map(|n| self.real(self.of.scaling, n)) {
            [slope, _] if slope == 0.0 || slope.is_nan() => [1.0, 0.0],
            [slope, intercept] if (slope + intercept).is_finite() => [slope, intercept],
            [slope, _] => return Err(field("scl_slope", slope, "finite, as scl_inter")),
        };
        let (count, before) = (self.dims.iter().product::<usize>(), offset as usize - self.of.header);
        let expected = before + count * size;
        let mut bytes = Vec::new();
        // to the end, where gzip's checksum is compared
        from.take((expected + PADDING_BYTES + 1) as u64).read_to_end(&mut bytes)?;
        if !(expected..=expected + PADDING_BYTES).contains(&bytes.len()) {
            return Err(ReadProblem::Length { found: bytes.len(), expected });
        }
        let number = |voxel: &[u8]| {
            let mut eight = [0; 8];
            eight[..size].copy_from_slice(voxel);
            if self.is_big {
                eight[..size].reverse();
            }
            let [a, b, c, d, ..] = eight;
            let stored = match code {
                2 => f64::from(a),
                256 => f64::from(a as i8),
                4 => f64::from(i16::from_le_bytes([a, b])),
                512 => f64::from(u16::from_le_bytes([a, b])),
                8 => f64::from(i32::from_le_bytes([a, b, c, d])),
                768 => f64::from(u32::from_le_bytes([a, b, c, d])),
                16 => f64::from(f32::from_le_bytes([a, b, c, d])),
                1024 => i64::from_le_bytes(eight) as f64,
                1280 => u64::from_le_bytes(eight) as f64,
                _ => f64::from_le_bytes(eight),
            };
            slope * stored + intercept
        };
        let values = bytes[before..expected].chunks_exact(size).map(number).enumerate().map(valid);
        Ok((values.collect::<Result<_, _>>()?, bytes[..before].to_vec()))
    }

    /// Where the voxels lie. With [`AffineChoice::Auto`] all that the header says about it must agree.
    fn grid(&self, choice: AffineChoice) -> Result<Grid<Ct>, ReadProblem> {
        let [has_qform, has_sform] =
            [self.of.codes.0, self.of.codes.1].map(|at| self.whole(at, self.of.codes.2) > 0);
        let is_auto = choice == AffineChoice::Auto;
        let by_sform = choice == AffineChoice::Sform || is_auto && has_sform;
        let (linear, offset) = match by_sform {
            true if has_sform => self.sform(),
            false if has_qform => self.qform()?,
            _ => return Err(ReadProblem::Affine("its code is 0")),
        };
        if !offset.iter().all(|v| v.is_finite()) {
            return Err(ReadProblem::Affine("values that are not finite, or voxels not of 0.001 to 20 mm"));
        }
        let (spacing, axes) = straight_axes(&linear, self.dims)?;
        let unit = Matrix3::from_fn(|r, c| linear[(r, c)] / spacing[c]);
        let sized = |axes: Matrix3<f64>, mm: &Vector3<f64>| (axes * Matrix3::from_diagonal(mm), offset);
        let is_same = |other: &(Matrix3<f64>, Vector3<f64>), more_mm: f64| {
            let far = |n: usize| Vector3::from_fn(|a, _| (n >> a & 1) as f64 * self.dims[a] as f64 - 0.5);
            let off = |n: usize| ((linear - other.0) * far(n) + offset - other.1).norm();
            (0..8).all(|n| off(n) <= SAME_VOXELS * spacing.min() + more_mm)
        };
        if is_auto {
            let size = self.lengths(self.of.pixdim, 1);
            if !(size.iter().all(|mm| *mm > 0.0) && is_same(&sized(unit, &size), 0.0)) {
                return Err(ReadProblem::Affine("columns that contradict pixdim"));
            }
            if by_sform && has_qform {
                // b, c, d are rounded, and a = √(1 − b² − c² − d²) with them; a turn by 2 da moves a corner
                let turn = axes * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, axes.determinant()));
                let real = (0.25 * (1.0 + turn.trace())).max(0.0).sqrt();
                let rounding = 4.0 * ((real * real + QUATERNION_ROUNDING).sqrt() - real);
                let size_mm = Vector3::from(self.dims.map(|d| d as f64)).component_mul(&spacing);
                if !is_same(&self.qform()?, rounding * size_mm.norm()) {
                    return Err(ReadProblem::Affine("sform and qform disagree"));
                }
            }
        }
        Ok(Grid::new(self.dims, spacing, axes, offset)?)
    }

    /// Three lengths, mm, from the number `first` of those at an offset.
    fn lengths(&self, offset: usize, first: usize) -> Vector3<f64> {
        Vector3::from_fn(|a, _| self.real(offset, first + a) * self.mm)
    }

    fn sform(&self) -> (Matrix3<f64>, Vector3<f64>) {
        let entry = |r: usize, c: usize| self.real(self.of.rows, 4 * r + c) * self.mm;
        (Matrix3::from_fn(entry), Vector3::from_fn(|r, _| entry(r, 3)))
    }

    /// The rotation of the quaternion (a, b, c, d), 1 + 2a[v]ₓ + 2[v]ₓ²; the third axis is reversed for qfac below 0.
    fn qform(&self) -> Result<(Matrix3<f64>, Vector3<f64>), ReadProblem> {
        let [b, c, d] = [0, 1, 2].map(|n| self.real(self.of.quaternion, n));
        let square = b * b + c * c + d * d;
        let (size, qfac) = (self.lengths(self.of.pixdim, 1), self.real(self.of.pixdim, 0));
        let is_size = size.iter().all(|mm| *mm > 0.0 && mm.is_finite());
        if !(is_size && square <= 1.0 + 1e-5 && !qfac.is_nan()) {
            return Err(ReadProblem::Affine("an impossible qform"));
        }
        let a = (1.0 - square).max(0.0).sqrt();
        let cross = (Vector3::new(b, c, d) / square.max(1.0).sqrt()).cross_matrix();
        let turn = Matrix3::identity() + cross * (2.0 * a) + cross * cross * 2.0;
        let reversed = Vector3::new(1.0, 1.0, if qfac < 0.0 { -1.0 } else { 1.0 });
        Ok((
            turn * Matrix3::from_diagonal(&size.component_mul(&reversed)),
            self.lengths(self.of.quaternion, 3),
        ))
    }
}

fn field(field: &'static str, value: f64, expected: &'static str) -> ReadProblem {
    ReadProblem::Field { field, value, expected }
}

#[cfg(test)]
mod nrrd_tests;
#[cfg(test)]
mod tests;
