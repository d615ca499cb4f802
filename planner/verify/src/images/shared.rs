//! Images of a format for which this crate has no reader: the planner's reader reads them here too, and the verdict names it, so that
//! nobody takes it for a second opinion on the images. A digest of what was read can be compared with another program's.

use std::fmt;
use std::fs::File;
use std::io::Read;
use std::path::Path;

use bonemill_geometry::{Ct, Volume};
use bonemill_imaging::{AffineChoice, read_ct_series, read_label_map};
use bonemill_planfile::Sha256;

use super::{LabelsRead, nrrd};
use crate::error::{ReadProblem, VerifyError};

/// Parts of a millimetre to which a digest knows where voxels lie.
const PARTS_OF_MM: f64 = 1e4;

/// That an image was read by the planner's reader.
#[derive(Debug, Clone, PartialEq)]
pub struct SharedReader {
    /// The image's key in the case.
    pub key: &'static str,
    /// Its format.
    pub format: &'static str,
    /// Digest of sizes, places and values that were read, as `docs/own-ct.md` says.
    pub digest: Sha256,
}

impl fmt::Display for SharedReader {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} is {}, for which the verification has no reader of its own: the planner's reader was used again, so that an error \
             of that reader would not be found; digest of voxels and their places {}",
            self.key, self.format, self.digest
        )
    }
}

/// The format of an image that this crate does not read.
pub(super) fn format(path: &Path) -> Result<Option<&'static str>, VerifyError> {
    if path.is_dir() {
        return Ok(Some("a folder (a DICOM series, or one mask per structure)"));
    }
    let mut first = Vec::new();
    let read = File::open(path).and_then(|file| file.take(348).read_to_end(&mut first));
    read.map_err(|e| VerifyError::Image { path: path.into(), problem: ReadProblem::from(e) })?;
    Ok(if first.get(128..132) == Some(b"DICM") {
        Some("a DICOM file")
    } else if ["ObjectType", "NDims", "Comment"].iter().any(|key| first.starts_with(key.as_bytes())) {
        Some("a MetaImage file")
    } else if first.get(344..) == Some(b"ni1\0") || first.get(4..8) == Some(b"ni2\0") {
        Some("a NIfTI pair of files")
    } else {
        nrrd::unread(path)
    })
}

/// A CT's grey values.
pub(super) fn ct(
    path: &Path,
    choice: AffineChoice,
    series: Option<&str>,
    format: &'static str,
) -> Result<(Volume<f32, Ct>, SharedReader), VerifyError> {
    let ct = read_ct_series(path, choice, series)?.volume;
    let digest = digest(&ct, |v| v.to_le_bytes());
    Ok((ct, SharedReader { key: "images.ct", format, digest }))
}

/// A label map.
pub(super) fn labels(
    path: &Path,
    choice: AffineChoice,
    format: &'static str,
) -> Result<(LabelsRead, SharedReader), VerifyError> {
    let map = read_label_map(path, choice)?;
    let digest = digest(&map.image.volume, |v| v.to_le_bytes());
    let further = map.further.into_iter().map(|(place, label)| (place as usize, label)).collect();
    let names = map.names.as_ref().map(|names| names.iter().map(|(n, name)| (n, name.to_owned())).collect());
    let is_segmentation = names.is_some();
    let labels =
        LabelsRead { shown: map.image.volume, further, names: names.unwrap_or_default(), is_segmentation };
    Ok((labels, SharedReader { key: "images.labels", format, digest }))
}

/// Digest of an image in `ct`: how many voxels along i, j, k (u32), the matrix and offset from indices to RAS+ by rows in steps of
/// 0.0001 mm (twelve i64), then the values in order, i fastest; all little endian.
fn digest<T: Copy, const N: usize>(image: &Volume<T, Ct>, bytes: impl Fn(T) -> [u8; N]) -> Sha256 {
    let grid = image.grid();
    let step = |a: usize| grid.axes().column(a) * grid.spacing_mm()[a];
    let columns = [step(0), step(1), step(2), grid.origin().coords];
    let places = (0..3).flat_map(|row| columns.map(|column| (column[row] * PARTS_OF_MM).round() as i64));
    let sizes = grid.dims().into_iter().flat_map(|n| (n as u32).to_le_bytes());
    let head: Vec<u8> = sizes.chain(places.flat_map(i64::to_le_bytes)).collect();
    let rows = image.data().chunks(1 << 16).map(|row| row.iter().flat_map(|v| bytes(*v)).collect());
    Sha256::of_pieces([head].into_iter().chain(rows))
}
