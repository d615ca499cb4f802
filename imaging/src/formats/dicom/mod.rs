//! DICOM: a CT as a folder with the files of a series, or as one file with many frames; a segmentation as one file.
//!
//! Headers are read first, without pixels, by `dicom-object`; then pixels are converted slice by slice into the result, so that
//! little more is in memory: straight from the file where they are not compressed, else decoded by `dicom-pixeldata`. Slices are ordered by ImagePositionPatient along the normal of ImageOrientationPatient and by nothing else:
//! InstanceNumber and SliceLocation are not trusted. Localizers are left out. Refused are slices that share a position, that are
//! missing or unevenly spaced, that are sheared by a tilted gantry, and a folder with several series, unless the case chooses one.
//! Of a header nothing leaves this module but what places, scales and names voxels and segments, and where one of several series is to
//! be chosen a digest of each one's UID with its modality and size: no name, number or date of a patient, and no UID.
//! **Source:** DICOM PS3.3 C.7.6.2 (plane), C.11.1 (rescale), C.7.6.16 (functional groups), C.8.20 (segmentation).

mod header;
mod lengths;
mod name;
mod pixels;
mod problem;
mod segments;
mod series;
mod stack;

pub(super) use header::holds_dicom;
pub use header::is_dicom;
pub use name::series_name;
pub use problem::{DicomProblem, SeriesFound};
pub(super) use segments::read as read_segments;
pub(super) use series::read as read_series;
