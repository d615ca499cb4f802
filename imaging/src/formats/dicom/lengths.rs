//! A walk over the lengths that a file's elements announce, before `dicom-object` allocates them.
//!
//! Sequences are entered. The walk also tells where pixels stand that are not compressed, so that they are read straight from the
//! file.

use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use dicom_object::Tag;

use super::header::name_of;
use super::problem::DicomProblem;

const PIXEL_DATA: Tag = Tag(0x7fe0, 0x0010);
const META_LENGTH: Tag = Tag(0x0002, 0x0000);
const SYNTAX: Tag = Tag(0x0002, 0x0010);
const ITEM: Tag = Tag(0xfffe, 0xe000);
const ITEM_END: Tag = Tag(0xfffe, 0xe00d);
const SEQUENCE_END: Tag = Tag(0xfffe, 0xe0dd);
/// Transfer syntaxes: implicit VR and explicit VR, little endian; explicit VR, big endian; deflated as a whole.
const IMPLICIT: &str = "1.2.840.10008.1.2";
const EXPLICIT: &str = "1.2.840.10008.1.2.1";
const BIG_ENDIAN: &str = "1.2.840.10008.1.2.2";
const DEFLATED: &str = "1.2.840.10008.1.2.1.99";
const UNDEFINED: u32 = u32::MAX;
/// Types whose lengths have two bytes. Every other has four, as `dicom-object` reads one that does not exist, too.
const SHORT: [&[u8; 2]; 21] = [
    b"AE", b"AS", b"AT", b"CS", b"DA", b"DS", b"DT", b"FD", b"FL", b"IS", b"LO", b"LT", b"PN", b"SH", b"SL",
    b"SS", b"ST", b"TM", b"UI", b"UL", b"US",
];

/// Pixels that stand in a file as they are, little endian.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct PlainPixels {
    /// Where the first byte stands in the file.
    pub at: u64,
    pub bytes: u64,
}

/// Refuses a file with an element that announces more bytes than the file has left; gives the place of its pixels where they are
/// not compressed. A deflated data set cannot be checked.
///
/// # Errors
/// [`DicomProblem::Length`], and [`DicomProblem::Unreadable`] when the system cannot read it.
pub(super) fn check_lengths(path: &Path) -> Result<Option<PlainPixels>, DicomProblem> {
    let failed = |e: std::io::Error| DicomProblem::Unreadable { file: name_of(path), reason: e.to_string() };
    let file = File::open(path).map_err(failed)?;
    let total = file.metadata().map_err(failed)?.len();
    let mut walk = Walk {
        from: BufReader::with_capacity(1 << 12, file),
        at: 132,
        total,
        syntax: String::new(),
        meta_end: u64::MAX,
        around: Vec::new(),
        plain: Vec::new(),
    };
    walk.from.seek(SeekFrom::Start(walk.at)).map_err(failed)?;
    match walk.elements() {
        // of two no reader knows which counts
        Ok(()) => Ok(walk.plain.pop().filter(|_| walk.plain.is_empty())),
        Err(Fault::Io(e)) => Err(failed(e)),
        Err(Fault::Item) => {
            let reason = format!("a sequence is broken before byte {}", walk.at);
            Err(DicomProblem::Unreadable { file: name_of(path), reason })
        }
        Err(Fault::Part(Tag(group, element), length)) => {
            let reason =
                format!("element ({group:04X},{element:04X}) has {length} bytes, no whole number of values");
            Err(DicomProblem::Unreadable { file: name_of(path), reason })
        }
        Err(Fault::Length(Tag(group, element), length)) => {
            let tag = format!("({group:04X},{element:04X})");
            Err(DicomProblem::Length { file: name_of(path), tag, at: walk.at, length })
        }
    }
}

/// Bytes of one value of a type that is a number; 1 for text and for types that are not known.
fn value_bytes(vr: [u8; 2]) -> u32 {
    match &vr {
        b"US" | b"SS" | b"OW" => 2,
        b"UL" | b"SL" | b"FL" | b"AT" | b"OL" | b"OF" => 4,
        b"FD" | b"OD" | b"OV" | b"SV" | b"UV" => 8,
        _ => 1,
    }
}

enum Fault {
    Io(std::io::Error),
    Length(Tag, u64),
    /// An item outside of a sequence, or something else in one: readers differ in what follows.
    Item,
    /// Bytes that make no whole number of values, of which readers leave some for what follows.
    Part(Tag, u32),
}

/// A sequence or an item.
struct Around {
    /// Where it ends; `u64::MAX`: at its delimiter.
    end: u64,
    is_sequence: bool,
    /// A sequence of compressed pixels: what its items hold are no elements.
    is_fragments: bool,
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
    /// Where the file's meta information ends, as its first element says.
    meta_end: u64,
    /// The sequences and items around, the innermost last.
    around: Vec<Around>,
    /// Pixels of the file itself, not those of an icon in a sequence.
    plain: Vec<PlainPixels>,
}

impl Walk {
    fn elements(&mut self) -> Result<(), Fault> {
        while self.at + 8 <= self.total {
            while self.around.last().is_some_and(|around| around.end <= self.at) {
                self.around.pop();
            }
            let before = self.at;
            let first: [u8; 2] = self.bytes()?;
            let is_meta = before < self.meta_end;
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
                if SHORT.contains(&&vr) {
                    u32::from(short(self.bytes()?))
                } else {
                    let _: [u8; 2] = self.bytes()?;
                    long(self.bytes()?)
                }
            } else {
                long(self.bytes()?)
            };
            let innermost = self.around.last();
            let (in_sequence, is_open) =
                innermost.map_or((false, false), |around| (around.is_sequence, around.end == u64::MAX));
            if is_open && tag == (if in_sequence { SEQUENCE_END } else { ITEM_END }) {
                self.around.pop();
            } else if tag == ITEM && !in_sequence || !is_item && in_sequence {
                return Err(Fault::Item);
            }
            let in_fragments = self.around.last().is_some_and(|around| around.is_fragments);
            let around = |end| Around {
                end,
                is_sequence: tag != ITEM,
                is_fragments: tag == PIXEL_DATA && length == UNDEFINED,
            };
            if length == UNDEFINED {
                self.around.push(around(u64::MAX));
                continue;
            }
            if u64::from(length) > self.total - self.at.min(self.total) {
                return Err(Fault::Length(tag, length.into()));
            }
            if tag != PIXEL_DATA && !length.is_multiple_of(value_bytes(vr)) {
                return Err(Fault::Part(tag, length));
            }
            let is_sequence = vr == *b"SQ" || vr == [0; 2] && !is_item && self.begins_with_item(length)?;
            if tag != PIXEL_DATA && (is_sequence || tag == ITEM && !in_fragments) {
                self.around.push(around(self.at + u64::from(length)));
                continue;
            }
            let is_plain = [IMPLICIT, EXPLICIT].contains(&self.syntax.as_str());
            if tag == PIXEL_DATA && self.around.is_empty() && is_plain {
                self.plain.push(PlainPixels { at: self.at, bytes: length.into() });
            }
            match tag {
                SYNTAX if is_meta => {
                    let mut text = vec![0; length as usize];
                    self.from.read_exact(&mut text)?;
                    self.syntax = String::from_utf8_lossy(&text).trim_end_matches(['\0', ' ']).to_owned();
                }
                META_LENGTH if is_meta && length == 4 => {
                    let mut bytes = [0; 4];
                    self.from.read_exact(&mut bytes)?;
                    self.meta_end = self.at + 4 + u64::from(u32::from_le_bytes(bytes));
                }
                _ => self.from.seek_relative(i64::from(length))?,
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
