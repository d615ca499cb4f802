//! NRRD: one file, or a header (.nhdr) with its voxels in other files.
//!
//! The header must name an anatomic space (LPS, RAS or LAS), its directions and its origin; without them left and right are unknown,
//! and the file is refused. A measurement frame turns vectors and tensors, not voxels, and is left out of account. Not read: the
//! encodings hex and bzip2, blocks, and more than one value a voxel, except the layers of a segmentation.
//! **Source:** teem.sourceforge.net/nrrd/format.html.

mod header;
mod segments;

use std::io::{BufReader, Cursor, Read};

use super::problem::FormatProblem;
use super::raster::{Raster, Voxels};
use super::source::ImageSource;
use super::stored::{Faults, Voxel};
use header::Header;
pub(super) use segments::segments;

/// Keys that programs add to a header, with their values.
pub(super) type Keys = Vec<(String, String)>;

/// The voxels, and the header's own keys and values.
///
/// # Errors
/// [`FormatProblem`] when the file cannot be read or trusted, or has more than one value a voxel, unless `has_layers` allows it.
pub(super) fn read<T: Voxel>(
    source: ImageSource,
    has_layers: bool,
    faulty: impl Fn([usize; 3], Faults) -> FormatProblem,
) -> Result<(Voxels<T>, Keys), FormatProblem> {
    let ImageSource { path, head, rest, extent } = source;
    let mut from = Box::new(BufReader::with_capacity(1 << 16, Cursor::new(head).chain(rest)));
    let header = Header::read(from.as_mut())?;
    let raster: Raster = header.raster(&path)?;
    if raster.components > 1 && !has_layers {
        let found = raster.components.to_string();
        return Err(FormatProblem::field("sizes", &found, "one value a voxel (the first axis has several)"));
    }
    let keys = header.keys;
    Ok((raster.read(&path, from, &extent, faulty)?, keys))
}
