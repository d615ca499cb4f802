//! A DICOM segmentation (SEG): binary, fractional or a label map; its frames lie on a grid of their own.
//!
//! A frame holds one segment in one plane; planes without a voxel of a segment are usually left out. Fractions of at least half of the
//! largest value belong to the segment. The planes' distance is SpacingBetweenSlices, else SliceThickness.

use std::path::Path;

use bonemill_geometry::Volume;
use dicom_object::{InMemDicomObject, Tag};
use nalgebra::Vector3;
use rayon::prelude::*;

use super::super::labels::{Drawing, LabelMap};
use super::super::straight::DISAGREEMENT_LIMIT_VOXELS;
use super::super::{Image, Placement, Provenance, ReadWarning};
use super::header::{Attributes, Found, Frame, Header, dicom_files, frame_groups, open};
use super::pixels::{check_size, frame_bytes, numbers};
use super::problem::DicomProblem;
use super::stack::{difference, grid};
use crate::names::{LabelNames, LabelNamesProblem};

const KIND: Tag = Tag(0x0062, 0x0001);
const SEGMENTS: Tag = Tag(0x0062, 0x0002);
const NUMBER: Tag = Tag(0x0062, 0x0004);
const LABEL: Tag = Tag(0x0062, 0x0005);
const IDENTIFICATION: Tag = Tag(0x0062, 0x000a);
const REFERENCED: Tag = Tag(0x0062, 0x000b);
const MOST_FRACTION: Tag = Tag(0x0062, 0x000e);
const MEASURES: Tag = Tag(0x0028, 0x9110);
const BETWEEN: Tag = Tag(0x0018, 0x0088);
const THICKNESS: Tag = Tag(0x0018, 0x0050);
/// Most voxels, and most planes: a plane that is left out takes memory and no bytes of the file.
const MOST_VOXELS: u64 = 1 << 29;
const MOST_PLANES: f64 = 65535.0;

/// Reads a file, or the only segmentation in a folder.
///
/// # Errors
/// [`DicomProblem`] when there is none, or it cannot be read or trusted.
pub(in super::super) fn read(path: &Path) -> Result<LabelMap, DicomProblem> {
    let paths = if path.is_dir() { dicom_files(path) } else { vec![path.to_owned()] };
    let read: Vec<Option<Found>> =
        paths.par_iter().map(|path| Found::read(path)).collect::<Result<_, _>>()?;
    let segmentations = read.into_iter().flatten().filter(|found| found.is_segmentation);
    let mut found: Vec<Header> = segmentations.map(|found| found.header).collect::<Result<_, _>>()?;
    match (found.pop(), found.is_empty()) {
        (Some(header), true) => read_file(&header),
        (None, _) => Err(DicomProblem::NoSegmentation),
        (Some(last), false) => {
            let files = found.into_iter().chain([last]).map(|h| h.path).collect();
            Err(DicomProblem::SeveralSegmentations { files })
        }
    }
}

fn read_file(header: &Header) -> Result<LabelMap, DicomProblem> {
    let [columns, rows] = header.size;
    let slice = columns * rows;
    check_size(header, slice)?;
    let object = open(&header.path, true)?;
    let a = Attributes { of: &object, file: &header.path };
    let names = names(&a)?;
    let (shared, own) = frame_groups(&a);
    let spacing_mm =
        between_mm(shared.as_ref(), own.first().map(|of| Attributes { of, file: a.file }).as_ref());
    let (planes, step, origin) = planes(header, spacing_mm)?;
    let dims = [columns, rows, planes.iter().max().map_or(0, |last| last + 1)];
    let voxels = dims.iter().fold(1u64, |all, n| all.saturating_mul(*n as u64));
    if voxels > MOST_VOXELS {
        return Err(DicomProblem::Sizes { dims, limit: MOST_VOXELS });
    }
    let first = header.frames.first().ok_or(DicomProblem::NoSeries)?;
    let grid = grid(first, step, origin, dims)?;
    let mut drawing = Drawing::new(grid.len());
    let kind = Kind::of(&a, header.pixels.allocated)?;
    for (frame, plane) in planes.iter().enumerate() {
        let bytes = frame_bytes(&object, header, frame)?;
        let own_label = || {
            let found = own.get(frame).and_then(|of| segment_of(&Attributes { of, file: a.file }));
            found.ok_or_else(|| {
                a.refuse("ReferencedSegmentNumber", "absent", "a segment's number for each frame")
            })
        };
        let mut draw = |pixel: usize, label: u16| drawing.draw(plane * slice + pixel, label);
        match kind {
            Kind::Binary => {
                let (first, label) = (slice * frame, own_label()?);
                if bytes.len() * 8 < first + slice {
                    let found = format!("{} bytes", bytes.len());
                    return Err(a.refuse("PixelData", found, "a bit for each pixel of its frames"));
                }
                let bit = |n: usize| bytes.get(n / 8).is_some_and(|byte| byte >> (n % 8) & 1 == 1);
                (0..slice).filter(|pixel| bit(first + pixel)).for_each(|pixel| draw(pixel, label));
            }
            Kind::Fraction { most } => {
                let label = own_label()?;
                let is_in = |n: i64| 2 * n >= i64::from(most);
                let pixels = numbers(&bytes, &header.pixels).take(slice).enumerate();
                pixels.filter(|(_, n)| is_in(*n)).for_each(|(pixel, _)| draw(pixel, label));
            }
            Kind::Map => {
                let pixels = numbers(&bytes, &header.pixels).take(slice).enumerate();
                pixels.filter(|(_, n)| *n > 0).for_each(|(pixel, n)| draw(pixel, n as u16));
            }
        }
    }
    if drawing.labels.iter().all(|label| *label == 0) {
        return Err(DicomProblem::Empty { file: header.name() });
    }
    let (labels, further) = drawing.finish();
    let volume = Volume::new(grid, labels).map_err(|_| DicomProblem::Sizes { dims, limit: MOST_VOXELS })?;
    let warnings = match kind {
        Kind::Fraction { most } => vec![ReadWarning::Threshold { least: most.div_ceil(2), most }],
        _ => vec![],
    };
    let provenance = Provenance { files: vec![header.path.clone()], placement: Placement::Dicom };
    Ok(LabelMap { image: Image { volume, provenance, warnings }, names: Some(names), further })
}

/// What a pixel says.
#[derive(Debug, Clone, Copy)]
enum Kind {
    Binary,
    Fraction { most: u8 },
    Map,
}

impl Kind {
    fn of(a: &Attributes<'_>, allocated: u32) -> Result<Self, DicomProblem> {
        let kind = a.text(KIND).unwrap_or_default();
        match (kind.as_str(), allocated) {
            ("BINARY", 1) => Ok(Self::Binary),
            ("FRACTIONAL", 8) => {
                let most = a.need((MOST_FRACTION, "MaximumFractionalValue"), 1..=255, "1 to 255")?;
                Ok(Self::Fraction { most: most as u8 })
            }
            ("LABELMAP", 8 | 16) => Ok(Self::Map),
            _ => Err(a.refuse(
                "SegmentationType",
                format!("{kind:?} with {allocated} bits a pixel"),
                "BINARY with 1, FRACTIONAL with 8, or LABELMAP with 8 or 16",
            )),
        }
    }
}

/// The number of the segment that a frame belongs to.
fn segment_of(groups: &Attributes<'_>) -> Option<u16> {
    u16::try_from(groups.item(IDENTIFICATION)?.whole(REFERENCED)?).ok().filter(|n| *n > 0)
}

/// Numbers and labels of the segments.
fn names(a: &Attributes<'_>) -> Result<LabelNames, DicomProblem> {
    let entry = |of: &InMemDicomObject| -> Result<(u16, String), DicomProblem> {
        let segment = Attributes { of, file: a.file };
        let number = segment.need((NUMBER, "SegmentNumber"), 1..=65535, "1 to 65535")?;
        Ok((number as u16, segment.text(LABEL).unwrap_or_default()))
    };
    let entries = a.items(SEGMENTS).iter().map(entry).collect::<Result<Vec<_>, _>>()?;
    LabelNames::new(entries).map_err(|problem| match problem {
        LabelNamesProblem::NameTwice { name, .. } => {
            DicomProblem::NameTwice { file: super::header::name_of(a.file), name }
        }
        _ => a.refuse("SegmentNumber", "the same in two segments", "a number of its own for each"),
    })
}

/// The planes' distance that the first of some functional groups states, mm.
fn between_mm(shared: Option<&Attributes<'_>>, own: Option<&Attributes<'_>>) -> Option<f64> {
    let measures: Vec<_> =
        [own, shared].into_iter().flatten().filter_map(|groups| groups.item(MEASURES)).collect();
    let find =
        |tag| measures.iter().find_map(|item| item.numbers(tag)?.first().copied().filter(|mm| *mm > 0.0));
    find(BETWEEN).or_else(|| find(THICKNESS))
}

/// The plane of each frame, counted along the normal from the first, the step between planes and the first plane's origin, LPS, mm.
type Planes = (Vec<usize>, Vector3<f64>, Vector3<f64>);

/// The planes of a file's frames.
///
/// # Errors
/// [`DicomProblem`] for frames that differ, or that lie between planes.
fn planes(header: &Header, spacing_mm: Option<f64>) -> Result<Planes, DicomProblem> {
    let first = header.frames.first().ok_or(DicomProblem::NoSeries)?;
    if let Some(attribute) =
        header.frames.iter().find_map(|frame| difference((header, first), (header, frame)))
    {
        return Err(DicomProblem::Unlike { file: header.name(), attribute, first: "its first frame".into() });
    }
    let normal = first.along[0].cross(&first.along[1]).normalize();
    let along = |frame: &Frame| frame.position.dot(&normal);
    let lowest = header.frames.iter().min_by(|a, b| along(a).total_cmp(&along(b))).unwrap_or(first);
    let refused = |found: f64, expected| DicomProblem::Attribute {
        file: header.name(),
        attribute: "SpacingBetweenSlices",
        found: format!("{found} mm"),
        expected,
    };
    let step_mm = spacing_mm.ok_or_else(|| refused(0.0, "this or SliceThickness, in mm"))?;
    let limit_mm = DISAGREEMENT_LIMIT_VOXELS * step_mm.min(first.spacing_mm[0]).min(first.spacing_mm[1]);
    let plane = |frame: &Frame| {
        let number = ((along(frame) - along(lowest)) / step_mm).round();
        let expected = lowest.position + normal * (number * step_mm);
        if !(number <= MOST_PLANES && (frame.position - expected).norm() <= limit_mm) {
            return Err(refused(
                step_mm,
                "a distance that puts every frame on a plane, to a tenth of a voxel",
            ));
        }
        Ok(number as usize)
    };
    let planes = header.frames.iter().map(plane).collect::<Result<_, _>>()?;
    Ok((planes, normal * step_mm, lowest.position))
}
