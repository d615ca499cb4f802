//! Voxels that a header of text describes, behind it or in files of their own: what NRRD and MetaImage have in common.
//!
//! Sizes are checked against the files' lengths before anything is allocated. Every stream is read to its end, where checksums are
//! compared and surplus data are found. Files are opened only if they are plain files, so that no pipe or device is waited for.

use std::fs::File;
use std::io::{BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use bonemill_geometry::{Ct, Grid};
use flate2::bufread::{MultiGzDecoder, ZlibDecoder};

use super::problem::{FormatProblem, beginning};
use super::source::{FileExtent, MAX_EXPANSION, read_full};
use super::stored::{Faults, MAX_VOXELS, NumberType, Stored, Voxel, read_values, voxel};
use super::straight::Affine;

/// More bytes than this after the last voxel are no padding.
const MAX_PADDING_BYTES: u64 = 4096;
/// Most characters of a number in text, with what separates it from the next.
const TEXT_BYTES: u64 = 32;
/// Most bytes of a header.
const HEADER_BYTES: u64 = 1 << 24;

/// How numbers are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Encoding {
    Raw,
    /// gzip or zlib.
    Deflate,
    Text,
}

/// What a header says.
#[derive(Debug)]
pub(super) struct Raster {
    /// Voxels along i, j, k.
    pub dims: [usize; 3],
    /// Numbers of each voxel, which stand side by side.
    pub components: usize,
    pub affine: Affine,
    pub stored: Stored,
    pub encoding: Encoding,
    /// Files with the voxels, in order; none: they follow the header.
    pub files: Vec<PathBuf>,
    /// Lines before the data.
    pub line_skip: u64,
    /// Bytes before the data, decompressed; `None`: the data are the file's last bytes.
    pub byte_skip: Option<u64>,
}

/// The voxels of a raster.
#[derive(Debug)]
pub(super) struct Voxels<T> {
    pub grid: Grid<Ct>,
    /// All numbers, those of one voxel side by side.
    pub values: Vec<T>,
    /// Files that were read beside the header's.
    pub files: Vec<PathBuf>,
    /// Bytes after the last voxel that were left out.
    pub padding_bytes: u64,
}

/// Reads a header's next line without its end; `None` at the end of the file.
///
/// # Errors
/// [`FormatProblem::Endless`] past 16 MiB, counted in `read_bytes`.
pub(super) fn header_line(
    from: &mut dyn BufRead,
    read_bytes: &mut u64,
) -> Result<Option<String>, FormatProblem> {
    let mut line = Vec::new();
    let found = from.take(HEADER_BYTES - *read_bytes).read_until(b'\n', &mut line)? as u64;
    *read_bytes += found;
    if *read_bytes >= HEADER_BYTES {
        return Err(FormatProblem::Endless { limit_bytes: HEADER_BYTES });
    }
    let text = String::from_utf8_lossy(&line);
    Ok((found > 0).then(|| text.trim_end_matches(['\r', '\n']).to_owned()))
}

/// The names of a pattern like `slice%03d.raw 1 20 1`: first, last, step.
pub(super) fn numbered_files(words: &[&str]) -> Option<Vec<String>> {
    let [pattern, first, last, step, ..] = words else { return None };
    let (before, rest) = pattern.split_once('%')?;
    let (width, after) = rest.split_once('d')?;
    let (fill, width) = (width.starts_with('0'), if width.is_empty() { 0 } else { width.parse().ok()? });
    let [first, last, step]: [i64; 3] = [first.parse().ok()?, last.parse().ok()?, step.parse().ok()?];
    let count = last.checked_sub(first)?.checked_div(step).filter(|n| (0..1 << 20).contains(n))?;
    if width > 32 {
        return None;
    }
    let number = |n: i64| if fill { format!("{n:0width$}") } else { format!("{n:width$}") };
    Some((0..=count).map(|n| format!("{before}{}{after}", number(first + n * step))).collect())
}

impl Raster {
    fn numbers(&self) -> Option<u64> {
        let sizes = self.dims.iter().chain([&self.components]).map(|n| *n as u64);
        let all = sizes.reduce(|a, b| a.saturating_mul(b))?;
        (1..=MAX_VOXELS).contains(&all).then_some(all)
    }

    /// Reads the voxels; `rest` follows the header in the file `path`, which can hold `extent`.
    ///
    /// # Errors
    /// [`FormatProblem`] when they cannot be read or trusted; `faulty` says what is wrong with a voxel that is no value.
    pub fn read<T: Voxel>(
        self,
        path: &Path,
        rest: Box<dyn BufRead>,
        extent: &FileExtent,
        faulty: impl Fn([usize; 3], Faults) -> FormatProblem,
    ) -> Result<Voxels<T>, FormatProblem> {
        let (dims, components) = (self.dims, self.components);
        let sizes = || FormatProblem::Sizes { dims, components, limit: MAX_VOXELS };
        let numbers = self.numbers().ok_or_else(sizes)?;
        let (grid, _) = self.affine.grid(dims)?;
        let mut all = Voxels { grid, values: Vec::new(), files: self.files.clone(), padding_bytes: 0 };
        let mut faults = None;
        if self.files.is_empty() && self.byte_skip.is_some() {
            let found = self.read_part(rest, numbers, extent.at_most_bytes(), None)?;
            (all.values, faults, all.padding_bytes) = found;
        } else {
            if self.files.is_empty() && extent.is_gzip() {
                return Err(FormatProblem::field(
                    "byte skip",
                    "-1",
                    "at least 0 in a file that is compressed as a whole",
                ));
            }
            let own = [path.to_owned()];
            let files = if self.files.is_empty() { &own[..] } else { &self.files[..] };
            let share = numbers / files.len() as u64;
            if share * files.len() as u64 != numbers {
                return Err(FormatProblem::field(
                    "data files",
                    &files.len().to_string(),
                    "as many voxels in each",
                ));
            }
            for file in files {
                let failed = |problem: FormatProblem| FormatProblem::Data {
                    path: file.clone(),
                    problem: Box::new(problem),
                };
                let before = all.values.len() as u64;
                let (values, part, padding) = self.read_file(file, share).map_err(failed)?;
                all.padding_bytes += padding;
                if before == 0 {
                    all.values = values
                } else {
                    all.values.extend(values)
                }
                if let Some(Faults { first, value, count }) = part {
                    let total = faults.get_or_insert(Faults { first: before + first, value, count: 0 });
                    total.count += count;
                }
            }
        }
        match faults {
            Some(faults) => Err(faulty(voxel(dims, faults.first / components as u64), faults)),
            None => Ok(all),
        }
    }

    fn read_file<T: Voxel>(&self, path: &Path, numbers: u64) -> Result<Part<T>, FormatProblem> {
        if !path.metadata()?.is_file() {
            return Err(FormatProblem::field("data file", &path.to_string_lossy(), "a plain file"));
        }
        let mut file = File::open(path)?;
        let file_bytes = file.metadata()?.len();
        let mut last = None;
        if self.byte_skip.is_none() {
            let expected_bytes = numbers * self.stored.number.bytes() as u64;
            let too_small = FormatProblem::FileTooSmall { expected_bytes, at_most_bytes: file_bytes };
            let start = file_bytes.checked_sub(expected_bytes).ok_or(too_small)?;
            last = Some(file.seek(SeekFrom::Start(start))?);
        }
        self.read_part(Box::new(BufReader::with_capacity(1 << 16, file)), numbers, file_bytes, last)
    }

    /// Reads numbers from a stream that can hold `at_most_bytes`; `last`: it stands at the first one already.
    fn read_part<T: Voxel>(
        &self,
        mut from: Box<dyn BufRead>,
        numbers: u64,
        at_most_bytes: u64,
        last: Option<u64>,
    ) -> Result<Part<T>, FormatProblem> {
        let (expected_bytes, at_most_bytes) = match self.encoding {
            Encoding::Raw => (numbers * self.stored.number.bytes() as u64, at_most_bytes),
            Encoding::Deflate => {
                (numbers * self.stored.number.bytes() as u64, at_most_bytes.saturating_mul(MAX_EXPANSION))
            }
            // a digit and what separates it from the next
            Encoding::Text => (2 * numbers - 1, at_most_bytes),
        };
        if expected_bytes > at_most_bytes {
            return Err(FormatProblem::FileTooSmall { expected_bytes, at_most_bytes });
        }
        if last.is_none() {
            for _ in 0..self.line_skip {
                if from.skip_until(b'\n')? == 0 {
                    break;
                }
            }
        }
        let mut from: Box<dyn Read> = match self.encoding {
            Encoding::Deflate if from.fill_buf()?.starts_with(&[0x1f, 0x8b]) => {
                Box::new(MultiGzDecoder::new(from))
            }
            Encoding::Deflate => Box::new(ZlibDecoder::new(from)),
            _ => Box::new(from),
        };
        if last.is_none() {
            std::io::copy(&mut from.as_mut().take(self.byte_skip.unwrap_or(0)), &mut std::io::sink())?;
        }
        if self.encoding == Encoding::Text {
            return text_values(from.as_mut(), numbers).map(|(values, faults)| (values, faults, 0));
        }
        let reserve = self.encoding == Encoding::Raw;
        let (values, faults) = read_values(from.as_mut(), &self.stored, numbers, reserve)?;
        let mut beyond = vec![0; 2 * MAX_PADDING_BYTES as usize];
        let padding = read_full(from.as_mut(), &mut beyond)? as u64;
        if padding > MAX_PADDING_BYTES {
            return Err(FormatProblem::Surplus { surplus_bytes: padding });
        }
        Ok((values, faults, padding))
    }
}

/// Values, those that are none, and bytes after the last one.
type Part<T> = (Vec<T>, Option<Faults>, u64);

/// Numbers of text, with blanks, line ends or commas between them.
fn text_values<T: Voxel>(
    from: &mut dyn Read,
    expected: u64,
) -> Result<(Vec<T>, Option<Faults>), FormatProblem> {
    let mut text = Vec::new();
    from.take(expected * TEXT_BYTES + MAX_PADDING_BYTES).read_to_end(&mut text)?;
    let text = String::from_utf8_lossy(&text);
    let words = text.split(|c: char| c.is_whitespace() || c == ',').filter(|word| !word.is_empty());
    let (mut values, mut faults) = (Vec::new(), None);
    for word in words {
        let found = values.len() as u64;
        let value: f64 = match word.parse() {
            Ok(value) if found < expected => value,
            _ => return Err(FormatProblem::Text { found, text: beginning(word), expected }),
        };
        if !T::accepts(value) {
            faults.get_or_insert(Faults { first: found, value, count: 0 }).count += 1;
        }
        values.push(T::from_value(value));
    }
    let found = values.len() as u64;
    if found < expected {
        return Err(FormatProblem::Text { found, text: String::new(), expected });
    }
    Ok((values, faults))
}

/// Numbers of a type by the names that headers use for it.
pub(super) fn number_named(name: &str, table: &[(&[&str], NumberType)]) -> Option<NumberType> {
    table.iter().find(|(names, _)| names.contains(&name)).map(|(_, number)| *number)
}
