//! What is taken from a DICOM header: size and kind of pixels, and place and scaling of each frame.

use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};

use dicom_object::{DefaultDicomObject, InMemDicomObject, OpenFileOptions, Tag};
use nalgebra::Vector3;

use super::lengths::{PlainPixels, check_lengths};
use super::name::series_name;
use super::problem::DicomProblem;

/// Where a DICOM file's mark stands, behind its preamble.
const MARK: std::ops::Range<usize> = 128..132;
/// Folders below the one that was named.
const DEPTH: usize = 3;
/// Most files of a folder.
const MOST_FILES: usize = 100_000;
/// Most frames of a file.
const MOST_FRAMES: usize = 1 << 16;

const SOP_CLASS: Tag = Tag(0x0008, 0x0016);
const IMAGE_TYPE: Tag = Tag(0x0008, 0x0008);
const MODALITY: Tag = Tag(0x0008, 0x0060);
const SERIES: Tag = Tag(0x0020, 0x000e);
const POSITION: Tag = Tag(0x0020, 0x0032);
const ORIENTATION: Tag = Tag(0x0020, 0x0037);
const SPACING: Tag = Tag(0x0028, 0x0030);
const SAMPLES: Tag = Tag(0x0028, 0x0002);
const PHOTOMETRIC: Tag = Tag(0x0028, 0x0004);
const FRAMES: Tag = Tag(0x0028, 0x0008);
const ROWS: Tag = Tag(0x0028, 0x0010);
const COLUMNS: Tag = Tag(0x0028, 0x0011);
const ALLOCATED: Tag = Tag(0x0028, 0x0100);
const STORED: Tag = Tag(0x0028, 0x0101);
const HIGH_BIT: Tag = Tag(0x0028, 0x0102);
const SIGNED: Tag = Tag(0x0028, 0x0103);
const PADDING: Tag = Tag(0x0028, 0x0120);
const PADDING_LIMIT: Tag = Tag(0x0028, 0x0121);
const INTERCEPT: Tag = Tag(0x0028, 0x1052);
const SLOPE: Tag = Tag(0x0028, 0x1053);
const SHARED_GROUPS: Tag = Tag(0x5200, 0x9229);
const FRAME_GROUPS: Tag = Tag(0x5200, 0x9230);
const PLANE_POSITION: Tag = Tag(0x0020, 0x9113);
const PLANE_ORIENTATION: Tag = Tag(0x0020, 0x9116);
const MEASURES: Tag = Tag(0x0028, 0x9110);
const TRANSFORMATION: Tag = Tag(0x0028, 0x9145);
const PIXEL_DATA: Tag = Tag(0x7fe0, 0x0010);
/// Segmentation Storage, and Label Map Segmentation Storage.
const SEGMENTATIONS: [&str; 2] = ["1.2.840.10008.5.1.4.1.1.66.4", "1.2.840.10008.5.1.4.1.1.66.7"];

/// How a pixel's number is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct PixelFormat {
    pub allocated: u32,
    pub stored: u32,
    pub high_bit: u32,
    pub signed: bool,
    /// First and last stored value that stand for "no pixel".
    pub padding: Option<[i64; 2]>,
}

/// Where a frame lies and how it is scaled.
#[derive(Debug, Clone, Copy)]
pub(super) struct Frame {
    /// The first pixel's centre, LPS, mm.
    pub position: Vector3<f64>,
    /// Directions of increasing column and of increasing row, LPS.
    pub along: [Vector3<f64>; 2],
    /// Distances of columns and of rows, mm.
    pub spacing_mm: [f64; 2],
    /// Slope and intercept.
    pub rescale: Option<[f64; 2]>,
}

/// A file with an image, and its header or why it cannot be used: a screenshot in another series does no harm.
#[derive(Debug)]
pub(super) struct Found {
    /// The series' name, which is not its UID.
    pub series: String,
    pub modality: String,
    pub is_localizer: bool,
    pub is_segmentation: bool,
    pub header: Result<Header, DicomProblem>,
}

/// A file's header.
#[derive(Debug)]
pub(super) struct Header {
    pub path: PathBuf,
    /// Columns and rows.
    pub size: [usize; 2],
    pub pixels: PixelFormat,
    /// Where its pixels stand if they are not compressed.
    pub plain: Option<PlainPixels>,
    /// One for each frame; none in a file without a place.
    pub frames: Vec<Frame>,
}

/// A file's name without its folder, for messages.
pub(super) fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

/// All files with DICOM's mark in a folder and in those below it, in the order of their names.
pub(super) fn dicom_files(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    collect(folder, DEPTH, &mut |path| {
        found.push(path);
        found.len() < MOST_FILES
    });
    found
}

/// Whether a folder holds a DICOM file.
pub(in super::super) fn holds_dicom(folder: &Path) -> bool {
    let mut is_found = false;
    collect(folder, DEPTH, &mut |_| {
        is_found = true;
        false
    });
    is_found
}

/// Gives every DICOM file to `take`, until it says no.
fn collect(folder: &Path, depth: usize, take: &mut dyn FnMut(PathBuf) -> bool) -> bool {
    let Ok(entries) = fs::read_dir(folder) else { return true };
    let mut paths: Vec<_> = entries.flatten().map(|entry| entry.path()).collect();
    paths.sort();
    paths.into_iter().all(|path| {
        if path.is_dir() {
            depth == 0 || collect(&path, depth - 1, take)
        } else if is_dicom(&path) {
            take(path)
        } else {
            true
        }
    })
}

/// Whether a file has DICOM's mark.
pub fn is_dicom(path: &Path) -> bool {
    let mut bytes = [0; MARK.end];
    // a pipe would be waited for
    let is_read = path.is_file() && File::open(path).and_then(|mut file| file.read_exact(&mut bytes)).is_ok();
    is_read && bytes.get(MARK) == Some(b"DICM")
}

/// Opens a file, with its pixels or without.
///
/// # Errors
/// [`DicomProblem::Unreadable`].
pub(super) fn open(path: &Path, with_pixels: bool) -> Result<DefaultDicomObject, DicomProblem> {
    let options = OpenFileOptions::new();
    let options = if with_pixels { options } else { options.read_until(PIXEL_DATA) };
    // a message without its causes, which may quote values
    options
        .open_file(path)
        .map_err(|e| DicomProblem::Unreadable { file: name_of(path), reason: e.to_string() })
}

/// A dataset of a file, for messages.
pub(super) struct Attributes<'a> {
    pub of: &'a InMemDicomObject,
    pub file: &'a Path,
}

impl<'a> Attributes<'a> {
    pub fn text(&self, tag: Tag) -> Option<String> {
        let text = self.of.get(tag)?.to_str().ok()?;
        Some(text.trim_end_matches(['\0', ' ']).trim().to_owned())
    }

    pub fn numbers(&self, tag: Tag) -> Option<Vec<f64>> {
        self.of.get(tag)?.to_multi_float64().ok()
    }

    pub fn whole(&self, tag: Tag) -> Option<i64> {
        self.of.get(tag)?.to_int().ok()
    }

    pub fn items(&self, tag: Tag) -> &'a [InMemDicomObject] {
        self.of.get(tag).and_then(|element| element.items()).unwrap_or_default()
    }

    /// The first item of a sequence.
    pub fn item(&self, tag: Tag) -> Option<Attributes<'a>> {
        self.items(tag).first().map(|of| Attributes { of, file: self.file })
    }

    pub fn refuse(
        &self,
        attribute: &'static str,
        found: impl ToString,
        expected: &'static str,
    ) -> DicomProblem {
        DicomProblem::Attribute { file: name_of(self.file), attribute, found: found.to_string(), expected }
    }

    /// A whole number within a range.
    pub fn need(
        &self,
        (tag, attribute): (Tag, &'static str),
        range: std::ops::RangeInclusive<i64>,
        expected: &'static str,
    ) -> Result<i64, DicomProblem> {
        match self.whole(tag) {
            Some(number) if range.contains(&number) => Ok(number),
            Some(number) => Err(self.refuse(attribute, number, expected)),
            None => Err(self.refuse(attribute, "absent", expected)),
        }
    }
}

impl Found {
    /// What a file holds; `None` for objects without an image.
    ///
    /// # Errors
    /// [`DicomProblem`] for a file that is damaged.
    pub fn read(path: &Path) -> Result<Option<Self>, DicomProblem> {
        let plain = check_lengths(path)?;
        let object = open(path, false)?;
        let attributes = Attributes { of: &object, file: path };
        if attributes.of.get(ROWS).is_none() {
            return Ok(None);
        }
        let image_type = attributes.text(IMAGE_TYPE).unwrap_or_default();
        Ok(Some(Self {
            series: attributes.text(SERIES).map(|uid| series_name(&uid)).unwrap_or_default(),
            modality: attributes.text(MODALITY).unwrap_or_default(),
            is_localizer: image_type.to_uppercase().contains("LOCALIZER"),
            is_segmentation: SEGMENTATIONS.contains(&attributes.text(SOP_CLASS).unwrap_or_default().as_str()),
            header: Header::of(&attributes, plain),
        }))
    }
}

impl Header {
    fn of(a: &Attributes<'_>, plain: Option<PlainPixels>) -> Result<Self, DicomProblem> {
        let size = [(COLUMNS, "Columns"), (ROWS, "Rows")];
        let [columns, rows] = size.map(|of| a.need(of, 1..=65535, "1 to 65535").map(|n| n as usize));
        let (size, pixels) = ([columns?, rows?], PixelFormat::of(a)?);
        Ok(Self { path: a.file.to_owned(), size, pixels, plain, frames: frames(a)? })
    }

    pub fn name(&self) -> String {
        name_of(&self.path)
    }
}

impl PixelFormat {
    fn of(a: &Attributes<'_>) -> Result<Self, DicomProblem> {
        let allocated = a.need((ALLOCATED, "BitsAllocated"), 1..=32, "1, 8, 16 or 32")?;
        if !matches!(allocated, 1 | 8 | 16 | 32) {
            return Err(a.refuse("BitsAllocated", allocated, "1, 8, 16 or 32"));
        }
        let stored = a.need((STORED, "BitsStored"), 1..=allocated, "at most BitsAllocated")?;
        let high_bit = a.whole(HIGH_BIT).unwrap_or(stored - 1);
        if !(stored - 1..allocated).contains(&high_bit) {
            return Err(a.refuse("HighBit", high_bit, "BitsStored − 1 or more, below BitsAllocated"));
        }
        a.need((SAMPLES, "SamplesPerPixel"), 1..=1, "1")?;
        let photometric = a.text(PHOTOMETRIC).unwrap_or_default();
        if photometric != "MONOCHROME2" {
            return Err(a.refuse("PhotometricInterpretation", photometric, "MONOCHROME2"));
        }
        let signed = a.need((SIGNED, "PixelRepresentation"), 0..=1, "0 or 1")? == 1;
        // writers mix up signed and unsigned in these two
        let wrapped = |n: i64| if signed && n >= 1 << (stored - 1) { n - (1 << allocated) } else { n };
        let padding = a.whole(PADDING).map(|first| {
            let (first, last) = (wrapped(first), wrapped(a.whole(PADDING_LIMIT).unwrap_or(first)));
            [first.min(last), first.max(last)]
        });
        let [allocated, stored, high_bit] = [allocated, stored, high_bit].map(|n| n as u32);
        Ok(Self { allocated, stored, high_bit, signed, padding })
    }
}

/// Number of frames.
fn frame_count(a: &Attributes<'_>) -> Result<usize, DicomProblem> {
    match a.whole(FRAMES) {
        None => Ok(1),
        Some(n) if (1..=MOST_FRAMES as i64).contains(&n) => Ok(n as usize),
        Some(n) => Err(a.refuse("NumberOfFrames", n, "1 to 65536")),
    }
}

/// Attributes of a frame, which stand in the file itself, in the groups of all frames or in those of the frame.
pub(super) fn frame_groups<'a>(a: &Attributes<'a>) -> (Option<Attributes<'a>>, &'a [InMemDicomObject]) {
    (a.item(SHARED_GROUPS), a.items(FRAME_GROUPS))
}

/// Places of all frames; none in a file that states no position.
fn frames(a: &Attributes<'_>) -> Result<Vec<Frame>, DicomProblem> {
    let count = frame_count(a)?;
    let (shared, own) = frame_groups(a);
    if own.is_empty() {
        if a.of.get(POSITION).is_none() || count > 1 {
            return Ok(vec![]);
        }
        return Ok(vec![frame(a, &[a])?]);
    }
    if own.len() != count {
        return Err(a.refuse(
            "PerFrameFunctionalGroupsSequence",
            own.len(),
            "as many items as NumberOfFrames",
        ));
    }
    let of_frame = |of| {
        let own = Attributes { of, file: a.file };
        let mut places = vec![&own];
        places.extend(shared.as_ref());
        frame(a, &places)
    };
    own.iter().map(of_frame).collect()
}

/// A frame whose attributes stand in one of `places`, or in one of their functional groups.
fn frame(a: &Attributes<'_>, places: &[&Attributes<'_>]) -> Result<Frame, DicomProblem> {
    let found = |group: Tag, tag: Tag| {
        places.iter().find_map(|place| {
            place.item(group).and_then(|item| item.numbers(tag)).or_else(|| place.numbers(tag))
        })
    };
    let finite = |numbers: &Vec<f64>| numbers.iter().all(|v| v.is_finite());
    let position = found(PLANE_POSITION, POSITION).filter(finite).and_then(|n| <[f64; 3]>::try_from(n).ok());
    let position = position
        .ok_or_else(|| a.refuse("ImagePositionPatient", "absent or no place", "three finite numbers"))?;
    let orientation =
        found(PLANE_ORIENTATION, ORIENTATION).filter(finite).and_then(|n| <[f64; 6]>::try_from(n).ok());
    let refused =
        || a.refuse("ImageOrientationPatient", "absent or no direction", "two perpendicular unit vectors");
    let [ax, ay, az, bx, by, bz] = orientation.ok_or_else(refused)?;
    let along = [Vector3::new(ax, ay, az), Vector3::new(bx, by, bz)];
    let is_unit = along.iter().all(|v| (v.norm() - 1.0).abs() < 1e-3);
    if !is_unit || along[0].dot(&along[1]).abs() > 1e-3 {
        return Err(refused());
    }
    let spacing = found(MEASURES, SPACING).filter(finite).and_then(|n| <[f64; 2]>::try_from(n).ok());
    let [rows_mm, columns_mm] =
        spacing.ok_or_else(|| a.refuse("PixelSpacing", "absent or no size", "two numbers in mm"))?;
    let number = |tag| found(TRANSFORMATION, tag).and_then(|n| n.first().copied());
    let rescale = match [number(SLOPE), number(INTERCEPT)] {
        [None, None] => None,
        [Some(slope), Some(intercept)] if (slope + intercept).is_finite() && slope != 0.0 => {
            Some([slope, intercept])
        }
        [slope, intercept] => {
            let found = format!("{slope:?} with RescaleIntercept {intercept:?}");
            return Err(a.refuse("RescaleSlope", found, "both, finite, the slope not 0"));
        }
    };
    Ok(Frame { position: position.into(), along, spacing_mm: [columns_mm, rows_mm], rescale })
}
