//! Pixels of a frame, decoded, and numbers from them.

use std::borrow::Cow;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};

use dicom_object::{DefaultDicomObject, Tag};
use dicom_pixeldata::PixelDecoder;

use super::header::{Header, PixelFormat};
use super::lengths::PlainPixels;
use super::problem::DicomProblem;
use crate::resample::AIR_HU;

const PIXEL_DATA: Tag = Tag(0x7fe0, 0x0010);
/// The most by which a codec makes pixels of one value smaller: wavelets and arithmetic coding reach some thousands.
const MAX_COMPRESSION: u64 = 1 << 14;
/// Bytes that are read and converted at a time: few enough to stay in the processor's cache.
const PIECE_BYTES: usize = 1 << 16;

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

/// Reads the grey values of a frame that is not compressed, straight from the file, and tells how many were padding.
///
/// # Errors
/// [`DicomProblem::Pixels`] for a file that has fewer bytes, or that the system cannot read.
pub(super) fn read_plain(
    header: &Header,
    plain: PlainPixels,
    frame: usize,
    values: &mut [f32],
) -> Result<u64, DicomProblem> {
    let failed =
        |reason: String| DicomProblem::Pixels { file: header.name(), frame: frame as u32 + 1, reason };
    let bytes_of_pixel = (header.pixels.allocated as usize).div_ceil(8);
    let size = (values.len() * bytes_of_pixel) as u64;
    let before = size * frame as u64;
    if before + size > plain.bytes {
        return Err(failed(format!("{} bytes of PixelData, fewer than its frames need", plain.bytes)));
    }
    let unread = |e: std::io::Error| failed(e.to_string());
    let mut file = File::open(&header.path).map_err(unread)?;
    file.seek(SeekFrom::Start(plain.at + before)).map_err(unread)?;
    let rescale = header.frames.get(frame).and_then(|f| f.rescale);
    let (mut piece, mut padded) = ([0; PIECE_BYTES], 0);
    for values in values.chunks_mut(PIECE_BYTES / bytes_of_pixel) {
        let bytes = &mut piece[..values.len() * bytes_of_pixel];
        file.read_exact(bytes).map_err(unread)?;
        padded += grey_values(bytes, &header.pixels, rescale, values);
    }
    Ok(padded)
}

/// Grey values of stored pixels, little endian: slope · number + intercept, and air for padding; how many were padding.
pub(super) fn grey_values(
    bytes: &[u8],
    format: &PixelFormat,
    rescale: Option<[f64; 2]>,
    values: &mut [f32],
) -> u64 {
    let [slope, intercept] = rescale.unwrap_or([1.0, 0.0]);
    let scaled = |number: f64| (slope * number + intercept) as f32;
    if format.allocated != 16 {
        let mut padded = 0;
        for (value, number) in values.iter_mut().zip(numbers(bytes, format)) {
            let is_padding = format.padding.is_some_and(|[first, last]| (first..=last).contains(&number));
            padded += u64::from(is_padding);
            *value = if is_padding { AIR_HU } else { scaled(number as f64) };
        }
        return padded;
    }
    let (words, _) = bytes.as_chunks::<2>();
    // the highest stored bit becomes the number's sign, as in `numbers`
    let (up, down) = (15 - format.high_bit, 16 - format.stored);
    let number = move |word: &[u8; 2]| {
        let aligned = u16::from_le_bytes(*word) << up;
        if format.signed { i32::from(aligned as i16 >> down) } else { i32::from(aligned >> down) }
    };
    let pixels = values.iter_mut().zip(words);
    // whole numbers below 2^24 are exact in single precision, too
    let is_whole = slope == 1.0 && intercept.fract() == 0.0 && intercept.abs() < f64::from(1 << 23);
    if is_whole {
        pixels.for_each(|(value, word)| *value = (number(word) + intercept as i32) as f32);
    } else {
        pixels.for_each(|(value, word)| *value = scaled(f64::from(number(word))));
    }
    let Some([first, last]) = format.padding else { return 0 };
    let mut padded = 0;
    for (value, word) in values.iter_mut().zip(words) {
        if (first..=last).contains(&i64::from(number(word))) {
            *value = AIR_HU;
            padded += 1;
        }
    }
    padded
}
