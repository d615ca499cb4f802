//! Pixels of a frame, decoded, and numbers from them; lengths of elements checked before anything is allocated for them.

use std::borrow::Cow;
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use dicom_object::{DefaultDicomObject, Tag};
use dicom_pixeldata::PixelDecoder;

use super::header::{Header, PixelFormat, name_of};
use super::problem::DicomProblem;

const PIXEL_DATA: Tag = Tag(0x7fe0, 0x0010);
/// The most by which a codec makes pixels of one value smaller: wavelets and arithmetic coding reach some thousands.
const MAX_COMPRESSION: u64 = 1 << 14;
/// Explicit VR, big endian, and the syntax whose data set is deflated as a whole.
const BIG_ENDIAN: &str = "1.2.840.10008.1.2.2";
const IMPLICIT: &str = "1.2.840.10008.1.2";
const DEFLATED: &str = "1.2.840.10008.1.2.1.99";
const UNDEFINED: u32 = u32::MAX;

/// Refuses a slice of so many pixels where the file cannot hold its frames.
///
/// # Errors
/// [`DicomProblem::Length`].
pub(super) fn check_size(header: &Header, slice: usize) -> Result<(), DicomProblem> {
    let bytes = std::fs::metadata(&header.path).map_or(0, |m| m.len());
    let bits = slice as u64 * header.frames.len() as u64 * u64::from(header.pixels.allocated);
    if bits / 8 > bytes.saturating_mul(MAX_COMPRESSION) {
        let (file, tag) = (header.name(), "(7FE0,0010)".into());
        return Err(DicomProblem::Length { file, tag, at: 0, length: bits / 8 });
    }
    Ok(())
}

/// The bytes of a frame, numbers little endian. A frame of single bits is a part of one stream over all frames; for it all bytes are given.
///
/// # Errors
/// [`DicomProblem::Pixels`] for a compression that is not known, and for damaged or missing pixels.
pub(super) fn frame_bytes<'a>(
    object: &'a DefaultDicomObject,
    header: &Header,
    frame: usize,
) -> Result<Cow<'a, [u8]>, DicomProblem> {
    let number = u32::try_from(frame).unwrap_or(u32::MAX);
    let failed = |reason: String| DicomProblem::Pixels {
        file: header.name(),
        frame: number.saturating_add(1),
        reason,
    };
    let Some(element) = object.get(PIXEL_DATA) else { return Err(failed("there is no PixelData".into())) };
    let [columns, rows] = header.size;
    let size = columns * rows * (header.pixels.allocated as usize).div_ceil(8);
    if let Some(primitive) = element.value().primitive() {
        let bytes = primitive.to_bytes();
        if header.pixels.allocated == 1 {
            return Ok(bytes);
        }
        let range = size * frame..size * (frame + 1);
        let short = || failed(format!("{} bytes of PixelData, fewer than its frames need", bytes.len()));
        return match &bytes {
            Cow::Borrowed(all) => all.get(range).map(Cow::Borrowed),
            Cow::Owned(all) => all.get(range).map(|frame| Cow::Owned(frame.to_vec())),
        }
        .ok_or_else(short);
    }
    let decoded = object.decode_pixel_data_frame(number).map_err(|e| failed(e.to_string()))?;
    let bytes = decoded.data();
    if bytes.len() < size {
        return Err(failed(format!("{} bytes, expected {size}", bytes.len())));
    }
    Ok(Cow::Owned(bytes.to_vec()))
}

/// The stored numbers, BitsStored bits below HighBit each.
pub(super) fn numbers<'a>(bytes: &'a [u8], format: &PixelFormat) -> impl Iterator<Item = i64> + 'a {
    let PixelFormat { allocated, stored, high_bit, signed, .. } = *format;
    bytes.chunks_exact((allocated / 8).max(1) as usize).map(move |pixel| {
        let all = pixel.iter().rev().fold(0u64, |n, byte| n << 8 | u64::from(*byte));
        // the highest stored bit becomes the number's sign
        let aligned = (all >> (high_bit + 1 - stored)) << (64 - stored);
        if signed { (aligned as i64) >> (64 - stored) } else { (aligned >> (64 - stored)) as i64 }
    })
}

/// Refuses a file with an element that announces more bytes than the file has left: `dicom-object` would allocate them.
/// Sequences are entered; a deflated data set cannot be checked.
///
/// # Errors
/// [`DicomProblem::Length`], and [`DicomProblem::Unreadable`] when the system cannot read it.
pub(super) fn check_lengths(path: &Path) -> Result<(), DicomProblem> {
    let failed = |e: std::io::Error| DicomProblem::Unreadable { file: name_of(path), reason: e.to_string() };
    let file = File::open(path).map_err(failed)?;
    let total = file.metadata().map_err(failed)?.len();
    let mut walk =
        Walk { from: BufReader::with_capacity(1 << 12, file), at: 132, total, syntax: String::new() };
    walk.from.seek(SeekFrom::Start(walk.at)).map_err(failed)?;
    match walk.elements() {
        Ok(()) => Ok(()),
        Err(Fault::Io(e)) => Err(failed(e)),
        Err(Fault::Length(Tag(group, element), length)) => {
            let tag = format!("({group:04X},{element:04X})");
            Err(DicomProblem::Length { file: name_of(path), tag, at: walk.at, length })
        }
    }
}

enum Fault {
    Io(std::io::Error),
    Length(Tag, u64),
}

impl From<std::io::Error> for Fault {
    fn from(error: std::io::Error) -> Self {
        Self::Io(error)
    }
}

/// A walk over the elements of a file, in order, into sequences as into anything else.
struct Walk {
    from: BufReader<File>,
    at: u64,
    total: u64,
    syntax: String,
}

impl Walk {
    fn elements(&mut self) -> Result<(), Fault> {
        let mut is_pixels = false;
        while self.at + 8 <= self.total {
            let first: [u8; 2] = self.bytes()?;
            let is_meta = first == [2, 0];
            if !is_meta && self.syntax == DEFLATED {
                return Ok(());
            }
            let big = !is_meta && self.syntax == BIG_ENDIAN;
            let short = |b: [u8; 2]| if big { u16::from_be_bytes(b) } else { u16::from_le_bytes(b) };
            let long = |b: [u8; 4]| if big { u32::from_be_bytes(b) } else { u32::from_le_bytes(b) };
            let tag = Tag(short(first), short(self.bytes()?));
            let is_item = tag.0 == 0xfffe;
            let is_explicit = !is_item && (is_meta || self.syntax != IMPLICIT);
            let mut vr = [0; 2];
            let length = if is_explicit {
                vr = self.bytes()?;
                match &vr {
                    b"OB" | b"OD" | b"OF" | b"OL" | b"OV" | b"OW" | b"SQ" | b"SV" | b"UC" | b"UN" | b"UR"
                    | b"UT" | b"UV" => {
                        let _: [u8; 2] = self.bytes()?;
                        long(self.bytes()?)
                    }
                    _ => u32::from(short(self.bytes()?)),
                }
            } else {
                long(self.bytes()?)
            };
            is_pixels |= tag == PIXEL_DATA;
            if length == UNDEFINED {
                continue;
            }
            if u64::from(length) > self.total - self.at.min(self.total) {
                return Err(Fault::Length(tag, length.into()));
            }
            let is_entered =
                vr == *b"SQ" || is_item && !is_pixels || vr == [0; 2] && self.begins_with_item(length)?;
            if is_entered {
                continue;
            }
            if tag == Tag(0x0002, 0x0010) {
                let mut text = vec![0; length as usize];
                self.from.read_exact(&mut text)?;
                self.syntax = String::from_utf8_lossy(&text).trim_end_matches(['\0', ' ']).to_owned();
            } else {
                self.from.seek_relative(i64::from(length))?;
            }
            self.at += u64::from(length);
        }
        Ok(())
    }

    /// Whether a value of implicit VR is a sequence.
    fn begins_with_item(&mut self, length: u32) -> Result<bool, Fault> {
        if length < 8 {
            return Ok(false);
        }
        let mut first = [0; 4];
        self.from.read_exact(&mut first)?;
        self.from.seek_relative(-4)?;
        Ok(first == [0xfe, 0xff, 0x00, 0xe0])
    }

    fn bytes<const N: usize>(&mut self) -> Result<[u8; N], Fault> {
        let mut bytes = [0; N];
        self.from.read_exact(&mut bytes)?;
        self.at += N as u64;
        Ok(bytes)
    }
}
