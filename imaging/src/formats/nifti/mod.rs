//! NIfTI-1: one file, plain or gzip.
//!
//! The file is streamed: it is decompressed piece by piece and converted in place, so that little more than the result
//! is ever in memory, and a header that announces more than the file can hold is refused before anything is
//! allocated. The stream is read to its very end: gzip's checksum is compared there, and data beyond
//! what the header announces is found there.

mod affine;
mod decode;
mod header;
mod problem;

use std::io::Read;

use bonemill_geometry::{Volume, cancel};

use super::source::{FileExtent, ImageSource, read_full};
use super::{Image, Placement, Provenance, ReadWarning};

use affine::grid_from_header;
pub use affine::{
    AffineChoice, AffineReport, AffineSource, DISAGREEMENT_LIMIT_VOXELS, SHEAR_LIMIT_RAD, SPACING_RANGE_MM,
};
use decode::decode;
pub(super) use decode::{Faults, Voxel};
use header::{HEADER_BYTES, Layout, parse};
pub use problem::NiftiProblem;

/// Bytes converted at a time; a multiple of every voxel size.
const PIECE_BYTES: usize = 1 << 18;
/// More bytes than this after the last voxel are no padding.
const MAX_PADDING_BYTES: u64 = 4096;

/// Reads a file; `faulty` says what is wrong with a voxel that cannot be a value, by its index and what was found.
///
/// # Errors
/// [`NiftiProblem`] when it cannot be read or trusted.
pub(super) fn read<T: Voxel>(
    source: ImageSource,
    choice: AffineChoice,
    faulty: impl Fn([usize; 3], Faults) -> NiftiProblem,
) -> Result<Image<T>, NiftiProblem> {
    let ImageSource { path, head, mut rest, extent } = source;
    let bytes: &[u8; HEADER_BYTES] =
        head.first_chunk().ok_or(NiftiProblem::NoHeader { found_bytes: head.len() })?;
    let (header, layout, mut warnings) = parse(bytes)?;
    let (grid, affine) = grid_from_header(&header, layout.dims, layout.mm_per_unit, choice)?;
    check_extent(&extent, &layout)?;

    skip(rest.as_mut(), &layout)?;
    let is_plausible = extent.is_plausible(layout.data_offset + layout.data_bytes());
    let (values, faults) = read_voxels(rest.as_mut(), &layout, is_plausible)?;
    let padding = read_rest(rest.as_mut())?;
    if padding > 0 {
        warnings.push(ReadWarning::Padding { bytes: padding });
    }
    if let Some(faults) = faults {
        return Err(faulty(layout.voxel(faults.first), faults));
    }
    let found_bytes = values.len() as u64;
    let volume = Volume::new(grid, values)
        .map_err(|_| NiftiProblem::Truncated { expected_bytes: layout.data_bytes(), found_bytes })?;
    let provenance = Provenance { files: vec![path], placement: Placement::Nifti(affine) };
    Ok(Image { volume, provenance, warnings })
}

/// Refuses a header that announces more than the file can hold.
fn check_extent(extent: &FileExtent, layout: &Layout) -> Result<(), NiftiProblem> {
    let expected_bytes = layout.data_offset + layout.data_bytes();
    let at_most_bytes = extent.at_most_bytes();
    if expected_bytes > at_most_bytes {
        let (dims, file_bytes) = (layout.dims, extent.file_bytes);
        return Err(NiftiProblem::FileTooSmall { dims, expected_bytes, file_bytes, at_most_bytes });
    }
    Ok(())
}

/// Skips the extension flag, extensions and anything else before the first voxel.
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
