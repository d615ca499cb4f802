//! Formats that are recognised by their first bytes and not read, and how to convert them to NIfTI-1.

use std::fmt;
use std::fs::{self, File};
use std::io::Read;
use std::path::Path;

/// Most files of a folder that are looked into.
const MOST_FILES: usize = 64;
/// Folders below the one that was named.
const DEPTH: usize = 3;
/// Where a DICOM file's mark stands, behind its preamble.
const DICOM_MARK: std::ops::Range<usize> = 128..132;
/// Voxel types of FreeSurfer's MGH format: byte, int, float, short, and (since 7.3) unsigned short.
const MGH_TYPES: [i32; 5] = [0, 1, 3, 4, 10];

/// What stands in an image's place and is no NIfTI file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum ForeignFormat {
    /// NRRD, plain or detached header.
    Nrrd,
    /// FreeSurfer's .mgh or .mgz.
    Mgh,
    /// One DICOM file.
    Dicom,
    /// A folder with DICOM files.
    DicomFolder,
    /// Any other folder.
    Folder,
    /// MetaImage, .mha or .mhd.
    MetaImage,
    /// An Analyze 7.5 header.
    Analyze,
}

impl fmt::Display for ForeignFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Nrrd => {
                "is an NRRD file; expected NIfTI-1: in 3D Slicer save the volume as .nii.gz (a segmentation: export it to a label \
                 map first)"
            }
            Self::Mgh => {
                "is a FreeSurfer volume (.mgh, .mgz); expected NIfTI-1: convert it, e.g. `mri_convert scan.mgz scan.nii.gz`"
            }
            Self::Dicom => {
                "is a single DICOM file; expected NIfTI-1 with the whole scan: convert its folder, e.g. `dcm2niix -z y FOLDER`, or \
                 save the scan from 3D Slicer as .nii.gz"
            }
            Self::DicomFolder => {
                "is a folder of DICOM files; expected NIfTI-1: convert it, e.g. `dcm2niix -z y FOLDER`, or save the scan from 3D \
                 Slicer as .nii.gz"
            }
            Self::Folder => "is a folder; expected a NIfTI-1 file, .nii or .nii.gz",
            Self::MetaImage => {
                "is a MetaImage file (.mha, .mhd); expected NIfTI-1: save it from 3D Slicer or ITK-SNAP as .nii.gz"
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
    if bytes.starts_with(b"NRRD000") {
        Some(ForeignFormat::Nrrd)
    } else if bytes.get(DICOM_MARK) == Some(b"DICM") {
        Some(ForeignFormat::Dicom)
    } else if bytes.starts_with(b"ObjectType") || bytes.starts_with(b"NDims") {
        Some(ForeignFormat::MetaImage)
    } else if is_mgh(bytes) {
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

/// What a folder is taken for.
pub(super) fn folder(path: &Path) -> ForeignFormat {
    let mut left = MOST_FILES;
    if holds_dicom(path, DEPTH, &mut left) { ForeignFormat::DicomFolder } else { ForeignFormat::Folder }
}

/// Whether one of the first `left` files in a folder and in those below it is a DICOM file.
fn holds_dicom(folder: &Path, depth: usize, left: &mut usize) -> bool {
    let Ok(entries) = fs::read_dir(folder) else { return false };
    let mut paths: Vec<_> = entries.flatten().map(|entry| entry.path()).collect();
    paths.sort();
    for path in paths {
        if *left == 0 {
            return false;
        }
        let found = if path.is_dir() {
            depth > 0 && holds_dicom(&path, depth - 1, left)
        } else {
            *left -= 1;
            let mut bytes = [0; DICOM_MARK.end];
            let read = File::open(&path).and_then(|mut file| file.read_exact(&mut bytes));
            read.is_ok() && format_of(&bytes) == Some(ForeignFormat::Dicom)
        };
        if found {
            return true;
        }
    }
    false
}
