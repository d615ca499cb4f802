//! Reads a CT or a label map from a NIfTI-1 file, plain or gzip.
//!
//! The file is streamed: it is decompressed piece by piece and converted in place, so that little more than the result
//! is ever in memory, and a header that announces more than the file can hold is refused before anything is
//! allocated. The stream is read to its very end: only there gzip's checksum is compared, and only there one sees that
//! a file holds more than its header says.

pub(crate) mod memory;

use std::fmt;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use bonemill_geometry::{Ct, Volume, cancel};
use flate2::bufread::MultiGzDecoder;

use crate::affine::{AffineChoice, AffineReport, grid_from_header};
use crate::decode::{Faults, Voxel, decode};
use crate::error::ImageError;
use crate::header::{HEADER_BYTES, Layout, parse};
use crate::problem::NiftiProblem;

mod foreign;
pub use foreign::ForeignFormat;

/// Bytes converted at a time; a multiple of every voxel size.
const PIECE_BYTES: usize = 1 << 18;
/// Deflate cannot expand by more (a stored byte gives at most 1032: zlib's technical notes, "Maximum Compression Factor").
const MAX_EXPANSION: u64 = 1032;
/// More bytes than this after the last voxel are no padding.
const MAX_PADDING_BYTES: u64 = 4096;

/// A volume with where its placement came from.
#[derive(Debug, Clone)]
pub struct Image<T> {
    /// The values in `ct`.
    pub volume: Volume<T, Ct>,
    /// Which transform of the header was used.
    pub affine: AffineReport,
    /// What a reader should be told.
    pub warnings: Vec<ReadWarning>,
}

/// Something odd about a file that was read all the same.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum ReadWarning {
    /// `scl_slope` is NaN; values were taken as stored.
    SlopeNotANumber,
    /// The header does not name its unit of length; taken for mm.
    UnitUnknown,
    /// Lengths were converted to mm.
    UnitConverted {
        /// The header's unit.
        unit: &'static str,
    },
    /// Bytes after the last voxel were left out.
    Padding {
        /// How many.
        bytes: u64,
    },
}

impl fmt::Display for ReadWarning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::SlopeNotANumber => write!(f, "scl_slope is NaN: values are taken as stored"),
            Self::UnitUnknown => write!(f, "the unit of length is not given: taken for mm"),
            Self::UnitConverted { unit } => write!(f, "lengths are converted from {unit} to mm"),
            Self::Padding { bytes } => write!(f, "{bytes} bytes after the last voxel are left out"),
        }
    }
}

/// Reads a CT's grey values.
///
/// # Errors
/// [`ImageError::Nifti`] when the file cannot be read or trusted, or a voxel is not a finite number.
pub fn read_ct(path: impl AsRef<Path>, choice: AffineChoice) -> Result<Image<f32>, ImageError> {
    read(path.as_ref(), choice, |first, f| NiftiProblem::VoxelsNotFinite {
        first,
        value: f.value,
        count: f.count,
    })
}

/// Reads a label map; its values must be whole numbers 0 to 65535 after scaling.
///
/// # Errors
/// [`ImageError::Nifti`] when the file cannot be read or trusted, or a voxel is no label.
pub fn read_labels(path: impl AsRef<Path>, choice: AffineChoice) -> Result<Image<u16>, ImageError> {
    read(path.as_ref(), choice, |first, f| NiftiProblem::NotLabels { first, value: f.value, count: f.count })
}

fn read<T: Voxel>(
    path: &Path,
    choice: AffineChoice,
    faulty: impl Fn([usize; 3], Faults) -> NiftiProblem,
) -> Result<Image<T>, ImageError> {
    read_file(path, choice, faulty).map_err(|problem| ImageError::Nifti { path: path.to_path_buf(), problem })
}

fn read_file<T: Voxel>(
    path: &Path,
    choice: AffineChoice,
    faulty: impl Fn([usize; 3], Faults) -> NiftiProblem,
) -> Result<Image<T>, NiftiProblem> {
    let (mut source, extent) = open(path)?;
    let mut bytes = [0; HEADER_BYTES];
    let found_bytes = read_full(&mut source, &mut bytes)?;
    if let Some(format) = foreign::format_of(&bytes[..found_bytes]) {
        return Err(NiftiProblem::Foreign(format));
    }
    if found_bytes < HEADER_BYTES {
        return Err(NiftiProblem::NoHeader { found_bytes });
    }
    let (header, layout, mut warnings) = parse(&bytes)?;
    let (grid, affine) = grid_from_header(&header, layout.dims, layout.mm_per_unit, choice)?;
    extent.check(&layout)?;

    skip(&mut source, &layout)?;
    let (values, faults) = read_voxels(&mut source, &layout, extent.is_plausible(&layout))?;
    let padding = read_rest(&mut source)?;
    if padding > 0 {
        warnings.push(ReadWarning::Padding { bytes: padding });
    }
    if let Some(faults) = faults {
        return Err(faulty(layout.voxel(faults.first), faults));
    }
    let found_bytes = values.len() as u64;
    let volume = Volume::new(grid, values)
        .map_err(|_| NiftiProblem::Truncated { expected_bytes: layout.data_bytes(), found_bytes })?;
    Ok(Image { volume, affine, warnings })
}

/// What the file's size says about what it can hold.
#[derive(Debug, Clone, Copy)]
struct FileExtent {
    file_bytes: u64,
    /// gzip's last four bytes: the decompressed size mod 2³² of its last member.
    gzip_size: Option<u32>,
}

impl FileExtent {
    fn at_most_bytes(&self) -> u64 {
        match self.gzip_size {
            None => self.file_bytes,
            Some(_) => self.file_bytes.saturating_mul(MAX_EXPANSION),
        }
    }

    /// Refuses a header that announces more than the file can hold.
    fn check(&self, layout: &Layout) -> Result<(), NiftiProblem> {
        let expected_bytes = layout.data_offset + layout.data_bytes();
        let at_most_bytes = self.at_most_bytes();
        if expected_bytes > at_most_bytes {
            let (dims, file_bytes) = (layout.dims, self.file_bytes);
            return Err(NiftiProblem::FileTooSmall { dims, expected_bytes, file_bytes, at_most_bytes });
        }
        Ok(())
    }

    /// Whether the file also says itself that it holds as much, so that memory may be taken at once.
    fn is_plausible(&self, layout: &Layout) -> bool {
        let expected = layout.data_offset + layout.data_bytes();
        self.gzip_size.is_none_or(|size| u64::from(size) == expected & u64::from(u32::MAX))
    }
}

/// Opens a file; gzip is told by its content, not by its name.
fn open(path: &Path) -> Result<(Box<dyn Read>, FileExtent), NiftiProblem> {
    let mut file = File::open(path).map_err(NiftiProblem::Unreadable)?;
    let metadata = file.metadata().map_err(NiftiProblem::Unreadable)?;
    if metadata.is_dir() {
        return Err(NiftiProblem::Foreign(foreign::folder(path)));
    }
    let file_bytes = metadata.len();
    let mut size = [0; 4];
    if file_bytes >= 18 {
        file.seek(SeekFrom::End(-4)).map_err(NiftiProblem::Unreadable)?;
        file.read_exact(&mut size).map_err(NiftiProblem::Unreadable)?;
        file.rewind().map_err(NiftiProblem::Unreadable)?;
    }
    let mut file = BufReader::with_capacity(1 << 16, file);
    let is_gzip = file.fill_buf().map_err(NiftiProblem::Unreadable)?.starts_with(&[0x1f, 0x8b]);
    let extent = FileExtent { file_bytes, gzip_size: is_gzip.then_some(u32::from_le_bytes(size)) };
    let source: Box<dyn Read> = if is_gzip { Box::new(MultiGzDecoder::new(file)) } else { Box::new(file) };
    Ok((source, extent))
}

/// Fills `buffer` as far as the source goes; the number of bytes.
fn read_full(source: &mut dyn Read, buffer: &mut [u8]) -> Result<usize, NiftiProblem> {
    let mut filled = 0;
    while filled < buffer.len() {
        match source.read(&mut buffer[filled..]) {
            Ok(0) => break,
            Ok(n) => filled += n,
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            // what a decoder finds wrong with its input; a disk has other words
            Err(e)
                if matches!(
                    e.kind(),
                    io::ErrorKind::InvalidInput | io::ErrorKind::InvalidData | io::ErrorKind::UnexpectedEof
                ) =>
            {
                return Err(NiftiProblem::Corrupt(e));
            }
            Err(e) => return Err(NiftiProblem::Unreadable(e)),
        }
    }
    Ok(filled)
}

/// Goes to the first voxel, over the extension flag, extensions and whatever else is there.
fn skip(source: &mut dyn Read, layout: &Layout) -> Result<(), NiftiProblem> {
    let mut left = layout.data_offset - HEADER_BYTES as u64;
    let mut buffer = [0; 4096];
    while left > 0 {
        let wanted = left.min(buffer.len() as u64) as usize;
        if read_full(source, &mut buffer[..wanted])? < wanted {
            return Err(NiftiProblem::Truncated { expected_bytes: layout.data_bytes(), found_bytes: 0 });
        }
        left -= wanted as u64;
    }
    Ok(())
}

fn read_voxels<T: Voxel>(
    source: &mut dyn Read,
    layout: &Layout,
    reserve: bool,
) -> Result<(Vec<T>, Option<Faults>), NiftiProblem> {
    let mut values = Vec::new();
    if reserve {
        let bytes = layout.voxels() * size_of::<T>() as u64;
        values.try_reserve_exact(layout.voxels() as usize).map_err(|_| NiftiProblem::Memory { bytes })?;
    }
    let (expected_bytes, mut done) = (layout.data_bytes(), 0u64);
    let mut piece = vec![0; PIECE_BYTES];
    let mut faults = None;
    while done < expected_bytes {
        cancel::poll();
        let wanted = (expected_bytes - done).min(PIECE_BYTES as u64) as usize;
        let found = read_full(source, &mut piece[..wanted])?;
        if found < wanted {
            return Err(NiftiProblem::Truncated { expected_bytes, found_bytes: done + found as u64 });
        }
        decode(layout, &piece[..wanted], &mut values, &mut faults);
        done += wanted as u64;
    }
    Ok((values, faults))
}

/// Reads to the end, for gzip's checksum; the number of bytes.
fn read_rest(source: &mut dyn Read) -> Result<u64, NiftiProblem> {
    let mut buffer = vec![0; 2 * MAX_PADDING_BYTES as usize];
    let found = read_full(source, &mut buffer)? as u64;
    if found > MAX_PADDING_BYTES {
        return Err(NiftiProblem::Surplus { surplus_bytes: found });
    }
    Ok(found)
}

#[cfg(test)]
mod tests;
