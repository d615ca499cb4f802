//! A CT from the files of one series, or from one file with many frames.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use bonemill_geometry::{Volume, cancel};
use rayon::prelude::*;

use super::super::{Image, Placement, Provenance, ReadWarning};
use super::header::{Found, Header, dicom_files, open};
use super::lengths::PlainPixels;
use super::name::series_name;
use super::pixels::{frame_bytes, grey_values, read_plain};
use super::problem::{DicomProblem, SeriesFound};
use super::stack::Stack;

/// Reads the series in a folder, or the frames of a file; `chosen` is a series' name or its SeriesInstanceUID.
///
/// # Errors
/// [`DicomProblem`] when there is no series, or several without a choice, and when one cannot be read or trusted.
pub(in super::super) fn read(path: &Path, chosen: Option<&str>) -> Result<Image<f32>, DicomProblem> {
    let paths = if path.is_dir() { dicom_files(path) } else { vec![path.to_owned()] };
    let read: Vec<Option<Found>> =
        paths.par_iter().map(|path| Found::read(path)).collect::<Result<_, _>>()?;
    let mut localizers = 0;
    let mut series: BTreeMap<String, Vec<Found>> = BTreeMap::new();
    for found in read.into_iter().flatten().filter(|found| !found.is_segmentation) {
        if found.is_localizer {
            localizers += 1;
        } else {
            series.entry(found.series.clone()).or_default().push(found);
        }
    }
    // a series without any place, such as a screenshot
    let has_place = |found: &Found| found.header.as_ref().is_ok_and(|header| !header.frames.is_empty());
    if chosen.is_none() && series.len() > 1 {
        series.retain(|_, files| files.iter().any(has_place));
    }
    let files = choose(series, chosen)?;
    let headers: Vec<Header> = files.into_iter().map(|found| found.header).collect::<Result<_, _>>()?;
    let stack = Stack::new(&headers)?;
    let mut warnings: Vec<ReadWarning> =
        (localizers > 0).then_some(ReadWarning::Localizers { count: localizers }).into_iter().collect();
    if headers.iter().any(|h| h.frames.iter().any(|f| f.rescale.is_none())) {
        warnings.push(ReadWarning::RescaleAbsent);
    }
    let (values, padded) = pixels(&headers, &stack)?;
    if padded > 0 {
        warnings.push(ReadWarning::PixelPadding { voxels: padded });
    }
    let dims = stack.grid.dims();
    let volume = Volume::new(stack.grid, values)
        .map_err(|_| DicomProblem::Sizes { dims, limit: super::super::stored::MAX_VOXELS })?;
    let mut files: Vec<PathBuf> = headers.into_iter().map(|h| h.path).collect();
    files.sort();
    Ok(Image { volume, provenance: Provenance { files, placement: Placement::Dicom }, warnings })
}

/// The series to read: the one that is there, or that of the case.
fn choose(
    mut series: BTreeMap<String, Vec<Found>>,
    chosen: Option<&str>,
) -> Result<Vec<Found>, DicomProblem> {
    let found = || {
        let entries = series.iter().filter_map(|(name, files)| {
            let headers = || files.iter().filter_map(|found| found.header.as_ref().ok());
            let (first, slices) = (headers().next()?, headers().map(|h| h.frames.len()).sum());
            let modality = files.first()?.modality.clone();
            Some(SeriesFound { name: name.clone(), modality, slices, size: first.size })
        });
        entries.collect::<Vec<_>>()
    };
    match chosen {
        Some(uid_or_name) => {
            let (found, name) = (found(), series_name(uid_or_name));
            series.remove(&name).ok_or(DicomProblem::SeriesAbsent { name, found })
        }
        None if series.len() > 1 => Err(DicomProblem::SeveralSeries { found: found() }),
        None => series.pop_first().map(|(_, files)| files).ok_or(DicomProblem::NoSeries),
    }
}

/// Grey values of all slices, and how many were padding.
fn pixels(headers: &[Header], stack: &Stack) -> Result<(Vec<f32>, u64), DicomProblem> {
    let [columns, rows, slices] = stack.grid.dims();
    let slice = columns * rows;
    // no header alone makes this large
    check_sizes(headers, slice)?;
    let mut values = vec![0f32; slice * slices];
    let mut plain: Vec<(&Header, PlainPixels, usize, &mut [f32])> = Vec::new();
    let mut decoded: Vec<Vec<(usize, &mut [f32])>> = headers.iter().map(|_| Vec::new()).collect();
    for (part, (file, frame)) in values.chunks_exact_mut(slice).zip(&stack.slices) {
        let Some(header) = headers.get(*file) else { continue };
        match (header.plain, decoded.get_mut(*file)) {
            (Some(place), _) => plain.push((header, place, *frame, part)),
            (None, Some(of_file)) => of_file.push((*frame, part)),
            (None, None) => {}
        }
    }
    let read = |(header, place, frame, part): (&Header, PlainPixels, usize, &mut [f32])| {
        cancel::poll();
        read_plain(header, place, frame, part)
    };
    let decode = |(header, frames): (&Header, Vec<(usize, &mut [f32])>)| -> Result<u64, DicomProblem> {
        cancel::poll();
        let object = open(&header.path, true)?;
        let mut padded = 0;
        for (frame, part) in frames {
            let bytes = frame_bytes(&object, header, frame)?;
            let rescale = header.frames.get(frame).and_then(|f| f.rescale);
            padded += grey_values(&bytes, &header.pixels, rescale, part);
        }
        Ok(padded)
    };
    let mut padded = plain.into_par_iter().map(read).collect::<Result<Vec<_>, _>>()?;
    let compressed = headers.par_iter().zip(decoded).filter(|(_, frames)| !frames.is_empty());
    padded.extend(compressed.map(decode).collect::<Result<Vec<_>, _>>()?);
    Ok((values, padded.iter().sum()))
}

/// Refuses slices that a file's length cannot hold, compressed or not, and single bits for grey values.
fn check_sizes(headers: &[Header], slice: usize) -> Result<(), DicomProblem> {
    for header in headers {
        if header.pixels.allocated < 8 {
            let (file, found) = (header.name(), header.pixels.allocated.to_string());
            let [attribute, expected] = ["BitsAllocated", "8, 16 or 32 for grey values"];
            return Err(DicomProblem::Attribute { file, attribute, found, expected });
        }
        super::pixels::check_size(header, slice)?;
    }
    Ok(())
}
