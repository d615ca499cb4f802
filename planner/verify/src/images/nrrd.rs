//! Reads NRRD again, with 3D Slicer's segments, by code of the verification's own.
//!
//! Read are raw and gzip data behind the header, in one file or in a list of files, without anything to skip; spaces LPS, RAS and LAS.
//! Numbers as text, skips and patterns of files are left to the planner's reader, which is told ([`unread`]). Whatever else a header
//! says about where or how voxels are stored is refused, never guessed.
//! **Source:** teem.sourceforge.net/nrrd/format.html; 3D Slicer's documentation of .seg.nrrd.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

use bonemill_geometry::{Ct, Grid};
use flate2::bufread::MultiGzDecoder;
use nalgebra::{Matrix3, Vector3};

use super::{MOST_VOXELS, PADDING_BYTES, straight_axes};
use crate::error::ReadProblem;

/// A header's fields and keys, in lower case names for fields.
#[derive(Default)]
struct Header {
    fields: BTreeMap<String, String>,
    keys: BTreeMap<String, String>,
    list: Vec<String>,
}

/// Bytes of a number, and what they stand for.
type Number = (usize, fn(&[u8]) -> f64);

/// An image as NRRD has it.
pub(super) struct Nrrd {
    pub grid: Grid<Ct>,
    /// Numbers of each voxel, side by side.
    pub layers: usize,
    pub values: Vec<f64>,
    /// Name, layer and value of each segment.
    pub segments: Vec<(String, usize, u16)>,
}

/// Reads a file from its first byte.
///
/// # Errors
/// [`ReadProblem`] for whatever is not beyond doubt.
pub(super) fn read(path: &Path) -> Result<Nrrd, ReadProblem> {
    let file = BufReader::new(File::open(path)?);
    let mut file = gunzipped(file)?;
    let header = Header::read(&mut file)?;
    let (layers, dims, grid) = header.place()?;
    let (size, number) = header.number()?;
    let count = dims.iter().product::<usize>() * layers;
    let mut bytes = Vec::new();
    let files = header.files(path)?;
    if files.is_empty() {
        bytes = header.data(Box::new(file), count * size)?;
    }
    for file in &files {
        if !file.metadata()?.is_file() {
            return Err(refused("data file", "a plain file"));
        }
        bytes.extend(header.data(Box::new(BufReader::new(File::open(file)?)), count * size / files.len())?);
    }
    let expected = count * size;
    let found = bytes.len();
    if found < expected || found > expected + PADDING_BYTES {
        return Err(ReadProblem::Length { found, expected });
    }
    let values = bytes[..expected].chunks_exact(size).map(number).collect();
    Ok(Nrrd { grid, layers, values, segments: header.segments(layers)? })
}

/// What an NRRD file is that only the planner's reader reads; `None` for others, and for what is no NRRD.
pub(super) fn unread(path: &Path) -> Option<&'static str> {
    let mut file = gunzipped(BufReader::new(File::open(path).ok()?)).ok()?;
    if !file.fill_buf().ok()?.starts_with(b"NRRD") {
        return None;
    }
    let header = Header::read(&mut file).ok()?;
    let get = |field: &str| header.fields.get(field).map(|text| text.to_lowercase());
    let is_skip = |field: &&str| get(field).is_some_and(|text| text != "0");
    if matches!(get("encoding")?.as_str(), "ascii" | "text" | "txt") {
        Some("an NRRD file with numbers as text")
    } else if ["line skip", "lineskip", "byte skip", "byteskip"].iter().any(is_skip) {
        Some("an NRRD file with lines or bytes to skip")
    } else if ["data file", "datafile"].iter().any(|field| get(field).is_some_and(|text| text.contains('%')))
    {
        Some("an NRRD header with a pattern of data files")
    } else {
        None
    }
}

/// A stream without gzip around it.
fn gunzipped(mut from: impl BufRead + 'static) -> Result<BufReader<Box<dyn Read>>, ReadProblem> {
    let is_gzip = from.fill_buf()?.starts_with(&[0x1f, 0x8b]);
    Ok(BufReader::new(if is_gzip { Box::new(MultiGzDecoder::new(from)) } else { Box::new(from) }))
}

fn refused(field: impl Into<String>, expected: &'static str) -> ReadProblem {
    ReadProblem::Header { field: field.into(), expected }
}

impl Header {
    fn read(from: &mut dyn BufRead) -> Result<Self, ReadProblem> {
        let (mut header, mut is_list) = (Self::default(), false);
        let mut from = from.take(1 << 24);
        for number in 0.. {
            let mut line = Vec::new();
            if from.read_until(b'\n', &mut line)? == 0 {
                break;
            }
            let line = String::from_utf8_lossy(&line).trim_end_matches(['\r', '\n']).to_owned();
            if number == 0 || line.starts_with('#') {
                continue;
            }
            if is_list {
                header.list.extend(Some(line).filter(|name| !name.trim().is_empty()));
                continue;
            }
            let Some((name, value)) = line.split_once(':') else { break };
            match value.strip_prefix('=') {
                Some(value) => drop(header.keys.insert(name.to_owned(), value.trim().to_owned())),
                None => {
                    let name = name.trim().to_lowercase();
                    is_list = name.replace(' ', "") == "datafile" && value.trim().starts_with("LIST");
                    if header.fields.insert(name.clone(), value.trim().to_owned()).is_some() {
                        return Err(refused(name, "once"));
                    }
                }
            }
        }
        Ok(header)
    }

    fn get(&self, field: &'static str) -> Result<&str, ReadProblem> {
        self.fields.get(field).map(String::as_str).ok_or_else(|| refused(field, "in the header"))
    }

    /// Numbers a voxel, sizes and grid.
    fn place(&self) -> Result<(usize, [usize; 3], Grid<Ct>), ReadProblem> {
        let [x, y] = match self.get("space")?.to_lowercase().as_str() {
            "left-posterior-superior" | "lps" => [-1.0, -1.0],
            "right-anterior-superior" | "ras" => [1.0, 1.0],
            "left-anterior-superior" | "las" => [-1.0, 1.0],
            _ => return Err(refused("space", "LPS, RAS or LAS")),
        };
        let is_mm = |text: &String| text.split_whitespace().all(|unit| unit == "\"mm\"" || unit == "\"\"");
        if !self.fields.get("space units").is_none_or(is_mm) {
            return Err(refused("space units", "\"mm\" throughout"));
        }
        let ras = |v: Vector3<f64>| Vector3::new(x * v.x, y * v.y, v.z);
        let sizes: Option<Vec<usize>> =
            self.get("sizes")?.split_whitespace().map(|n| n.parse().ok()).collect();
        let sizes = sizes.ok_or_else(|| refused("sizes", "whole numbers"))?;
        // blanks within a vector are left out, so that blanks stand between vectors only
        let packed = self.get("space directions")?.replace(", ", ",").replace("( ", "(").replace(" )", ")");
        let directions: Vec<&str> = packed.split_whitespace().collect();
        let wrong = || refused("space directions", "none or a vector for each size, three vectors in all");
        if directions.len() != sizes.len() {
            return Err(wrong());
        }
        let (mut layers, mut steps, mut dims) = (1, Vec::new(), Vec::new());
        for (place, (direction, size)) in directions.iter().zip(sizes).enumerate() {
            match vector(direction) {
                Some(step) => {
                    steps.push(ras(step));
                    dims.push(size);
                }
                None if *direction == "none" && place == 0 => layers = size,
                None if *direction == "none" && size == 1 => {}
                None => return Err(wrong()),
            }
        }
        let (Ok(steps), Ok(dims)) = (<[_; 3]>::try_from(steps), <[usize; 3]>::try_from(dims)) else {
            return Err(wrong());
        };
        let all = dims.iter().chain([&layers]).try_fold(1u64, |all, n| all.checked_mul(*n as u64));
        if !all.is_some_and(|n| (1..=MOST_VOXELS).contains(&n)) {
            return Err(refused("sizes", "1 to 2^31 numbers"));
        }
        let origin = vector(self.get("space origin")?)
            .ok_or_else(|| refused("space origin", "three finite numbers"))?;
        let (spacing, axes) = straight_axes(&Matrix3::from_columns(&steps), dims)?;
        Ok((layers, dims, Grid::new(dims, spacing, axes, ras(origin))?))
    }

    /// Bytes of a number, and what they stand for.
    fn number(&self) -> Result<Number, ReadProblem> {
        let kind = self.get("type")?.to_lowercase();
        let kind = kind.replace("unsigned ", "u").replace("signed ", "").replace("_t", "");
        let kind = kind.trim_end_matches(" int").replace("long long", "longlong");
        let big = match self.fields.get("endian").map(|text| text.to_lowercase()).as_deref() {
            Some("big") => true,
            Some("little") => false,
            _ if kind.ends_with("char") || kind.ends_with("int8") => false,
            _ => return Err(refused("endian", "big or little")),
        };
        macro_rules! number {
            ($number:ty) => {
                if big {
                    (size_of::<$number>(), |b: &[u8]| {
                        b.try_into().map_or(f64::NAN, |b| <$number>::from_be_bytes(b) as f64)
                    })
                } else {
                    (size_of::<$number>(), |b: &[u8]| {
                        b.try_into().map_or(f64::NAN, |b| <$number>::from_le_bytes(b) as f64)
                    })
                }
            };
        }
        Ok(match kind.as_str() {
            "char" | "int8" => number!(i8),
            "uchar" | "uint8" => number!(u8),
            "short" | "int16" => number!(i16),
            "ushort" | "uint16" => number!(u16),
            "int" | "int32" => number!(i32),
            "uint" | "uint32" => number!(u32),
            "longlong" | "int64" => number!(i64),
            "ulonglong" | "uint64" => number!(u64),
            "float" => number!(f32),
            "double" => number!(f64),
            _ => return Err(refused("type", "a number of 8 to 64 bits")),
        })
    }

    /// Decoded bytes, to the end of the stream or a few more than expected.
    fn data(&self, from: Box<dyn BufRead>, expected: usize) -> Result<Vec<u8>, ReadProblem> {
        let mut from: Box<dyn Read> = match self.get("encoding")?.to_lowercase().as_str() {
            "raw" => Box::new(from),
            "gzip" | "gz" => Box::new(MultiGzDecoder::new(from)),
            _ => return Err(refused("encoding", "raw, gzip or ascii")),
        };
        let mut bytes = Vec::new();
        from.as_mut().take((expected + PADDING_BYTES + 1) as u64).read_to_end(&mut bytes)?;
        Ok(bytes)
    }

    /// Files with the voxels; none where they follow the header.
    fn files(&self, path: &Path) -> Result<Vec<PathBuf>, ReadProblem> {
        let Some(named) = self.fields.get("data file").or(self.fields.get("datafile")) else {
            return Ok(vec![]);
        };
        let names = if named.starts_with("LIST") { self.list.clone() } else { vec![named.clone()] };
        if names.is_empty() {
            return Err(refused("data file", "a file, a pattern or LIST"));
        }
        Ok(names.iter().map(|name| path.with_file_name("").join(name.trim())).collect())
    }

    /// Name, layer and value of each segment, in the order of their numbers. Before layers held several segments, each had its own
    /// with the value 1, and no keys for either.
    fn segments(&self, layers: usize) -> Result<Vec<(String, usize, u16)>, ReadProblem> {
        let ids = self.keys.keys().filter_map(|key| key.strip_prefix("Segment")?.strip_suffix("_ID"));
        let mut numbers: Vec<usize> = ids.filter_map(|n| n.parse().ok()).collect();
        numbers.sort_unstable();
        let is_one_each = numbers.len() == layers;
        let segment = |n: &usize| {
            let key = |name: &str| self.keys.get(&format!("Segment{n}_{name}"));
            let whole = |name: &str, absent: u16| {
                key(name).map_or(Ok(absent), |text| {
                    text.parse::<u16>().map_err(|_| refused(format!("Segment{n}_{name}"), "a whole number"))
                })
            };
            let name = key("Name").filter(|name| !name.is_empty()).or_else(|| key("ID"));
            let own_layer = if is_one_each { (*n).min(layers - 1) as u16 } else { 0 };
            let layer = usize::from(whole("Layer", own_layer)?);
            Ok((name.cloned().unwrap_or_default(), layer, whole("LabelValue", 1)?))
        };
        numbers.iter().map(segment).collect()
    }
}

/// Three finite numbers, `(x,y,z)`.
fn vector(text: &str) -> Option<Vector3<f64>> {
    let numbers = text.trim().strip_prefix('(')?.strip_suffix(')')?.split(',').map(|n| n.trim().parse().ok());
    let numbers: [f64; 3] = numbers.collect::<Option<Vec<f64>>>()?.try_into().ok()?;
    numbers.iter().all(|n| n.is_finite()).then(|| numbers.into())
}
