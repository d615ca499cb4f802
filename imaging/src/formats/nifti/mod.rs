//! NIfTI-1 and NIfTI-2: one file, plain or gzip, or a header (.hdr) with its voxels beside it (.img).
//!
//! The file is streamed: it is decompressed piece by piece and converted in place, so that little more than the result
//! is ever in memory, and a header that announces more than the file can hold is refused before anything is
//! allocated. The stream is read to its very end: gzip's checksum is compared there, and data beyond
//! what the header announces is found there.

mod affine;
mod fields;
mod header;
mod names;
mod problem;

use std::fs::File;
use std::io::{self, Cursor, Read};
use std::path::Path;

use bonemill_geometry::Volume;

use super::source::{FileExtent, ImageSource, read_full};
use super::stored::{Faults, Voxel, read_values, voxel};
use super::{Image, Placement, Provenance, ReadWarning};

use affine::grid_from_header;
pub use affine::{AffineChoice, AffineReport, AffineSource};
use fields::{Fields, HEADER_BYTES, Version};
use header::{Layout, layout};
pub(super) use names::names;
pub use problem::NiftiProblem;

/// More bytes than this after the last voxel are no padding.
const MAX_PADDING_BYTES: u64 = 4096;

/// Reads a file, and the bytes of its extensions; `faulty` says what is wrong with a voxel that cannot be a value, by its index and
/// what was found.
///
/// # Errors
/// [`NiftiProblem`] when it cannot be read or trusted.
pub(super) fn read<T: Voxel>(
    source: ImageSource,
    choice: AffineChoice,
    faulty: impl Fn([usize; 3], Faults) -> NiftiProblem,
) -> Result<(Image<T>, Vec<u8>), NiftiProblem> {
    let ImageSource { path, mut head, mut rest, mut extent } = source;
    let short = |found_bytes, expected_bytes| NiftiProblem::NoHeader { found_bytes, expected_bytes };
    let first: &[u8; HEADER_BYTES] = head.first_chunk().ok_or(short(head.len(), HEADER_BYTES))?;
    let (version, is_big) = Version::of(first)?;
    let more = version.header_bytes - HEADER_BYTES;
    rest.as_mut().take(more as u64).read_to_end(&mut head)?;
    let header = Fields::of(&head, version, is_big)?;
    let (layout, mut warnings) = layout(&header)?;
    let (grid, affine) = grid_from_header(&header, layout.dims, layout.mm_per_unit, choice)?;
    let mut files = vec![path];
    let mut left = layout.data_offset;
    if layout.is_pair {
        let image = image_beside(&files[0])?;
        files.push(image.path);
        (rest, extent) = (Box::new(Cursor::new(image.head).chain(image.rest)), image.extent);
    } else {
        left -= version.header_bytes as u64;
    }
    check_extent(&extent, &layout)?;

    let extensions = skip(rest.as_mut(), left, &layout)?;
    let is_plausible = extent.is_plausible(layout.data_offset + layout.data_bytes());
    let (values, faults) = read_values(rest.as_mut(), &layout.stored, layout.voxels(), is_plausible)?;
    let padding = read_rest(rest.as_mut())?;
    if padding > 0 {
        warnings.push(ReadWarning::Padding { bytes: padding });
    }
    if let Some(faults) = faults {
        return Err(faulty(voxel(layout.dims, faults.first), faults));
    }
    let found_bytes = values.len() as u64;
    let volume = Volume::new(grid, values)
        .map_err(|_| NiftiProblem::Truncated { expected_bytes: layout.data_bytes(), found_bytes })?;
    let provenance = Provenance { files, placement: Placement::Nifti(affine) };
    Ok((Image { volume, provenance, warnings }, extensions))
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

/// The file with the voxels of a pair: `scan.img` beside `scan.hdr`, compressed or not.
fn image_beside(header: &Path) -> Result<ImageSource, NiftiProblem> {
    let name = header.file_name().unwrap_or_default().to_string_lossy();
    let stem = name.strip_suffix(".gz").unwrap_or(&name);
    let stem = stem.rsplit_once('.').map_or(stem, |(stem, _)| stem);
    let [plain, zipped] = [".img", ".img.gz"].map(|end| header.with_file_name(format!("{stem}{end}")));
    let path = if zipped.is_file() && !plain.is_file() { zipped } else { plain };
    let open = |path: &Path| {
        let file = File::open(path)?;
        ImageSource::new(path, file)
    };
    if !path.is_file() {
        let error = io::Error::from(io::ErrorKind::NotFound);
        return Err(NiftiProblem::Pair { path, error });
    }
    open(&path).map_err(|error| NiftiProblem::Pair { path, error })
}

/// The extension flag, extensions and anything else before the first voxel.
fn skip(source: &mut dyn Read, bytes: u64, layout: &Layout) -> Result<Vec<u8>, NiftiProblem> {
    let mut skipped = Vec::new();
    if source.take(bytes).read_to_end(&mut skipped)? as u64 != bytes {
        return Err(NiftiProblem::Truncated { expected_bytes: layout.data_bytes(), found_bytes: 0 });
    }
    Ok(skipped)
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
