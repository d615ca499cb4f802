//! Formats that are recognised by their first bytes and not read, and how to convert them to NIfTI-1.

use std::fmt;

/// Voxel types of FreeSurfer's MGH format: byte, int, float, short, and (since 7.3) unsigned short.
const MGH_TYPES: [i32; 5] = [0, 1, 3, 4, 10];

/// What stands in an image's place and is no NIfTI file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum ForeignFormat {
    /// FreeSurfer's .mgh or .mgz.
    Mgh,
    /// A folder without any image.
    Folder,
    /// An Analyze 7.5 header.
    Analyze,
}

impl fmt::Display for ForeignFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Mgh => {
                "is a FreeSurfer volume (.mgh, .mgz); expected NIfTI-1: convert it, e.g. `mri_convert scan.mgz scan.nii.gz`"
            }
            Self::Folder => {
                "is a folder without images; expected an image file, a folder with a DICOM series, or, for labels, one with a mask per structure"
            }
            Self::Analyze => {
                "is an Analyze 7.5 header, which does not tell left from right; expected NIfTI-1: convert the original scan, e.g. \
                 DICOM with dcm2niix"
            }
        })
    }
}

/// The format that begins with these bytes, decompressed; `None` for NIfTI and whatever is not known.
pub(super) fn format_of(bytes: &[u8]) -> Option<ForeignFormat> {
    if is_mgh(bytes) {
        Some(ForeignFormat::Mgh)
    } else if is_analyze(bytes) {
        Some(ForeignFormat::Analyze)
    } else {
        None
    }
}

/// A header of NIfTI's size, in either byte order, without NIfTI's mark: Analyze has another field there, mostly unused.
fn is_analyze(bytes: &[u8]) -> bool {
    let size = bytes.first_chunk().map(|size| [i32::from_le_bytes(*size), i32::from_be_bytes(*size)]);
    size.is_some_and(|size| size.contains(&348)) && bytes.get(344..348) == Some(&[0; 4])
}

/// Version 1, four sizes of at least 1, and a known voxel type; all big endian.
fn is_mgh(bytes: &[u8]) -> bool {
    let (numbers, _) = bytes.as_chunks::<4>();
    let Some(&[version, sizes @ .., voxel_type]) = numbers.first_chunk::<6>() else { return false };
    let number = i32::from_be_bytes;
    number(version) == 1
        && sizes.iter().all(|size| number(*size) >= 1)
        && MGH_TYPES.contains(&number(voxel_type))
}
