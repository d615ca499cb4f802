//! MetaImage: .mha with its voxels behind the header, or .mhd with other files.
//!
//! `Offset` and `TransformMatrix` place the voxels in DICOM's world, +x left and +y posterior, as ITK, its most common writer, takes
//! them; row n of the matrix is the direction of axis n. `AnatomicalOrientation` says the same in letters, and writers differ in what
//! they mean by it, so it is left out of account. A header without offset or matrix does not tell left from right and is refused.
//! **Source:** itk.org/Wiki/ITK/MetaIO/Documentation.

use std::io::{BufRead, BufReader, Cursor, Read};
use std::path::{Path, PathBuf};

use nalgebra::Vector3;

use super::problem::{FormatProblem, beginning};
use super::raster::{Encoding, Raster, Voxels, header_line, number_named, numbered_files};
use super::source::ImageSource;
use super::stored::{Faults, NumberType, Stored, Voxel};
use super::straight::Affine;

/// Names of the types of numbers; MET_LONG has 4 bytes in files of some systems and 8 in those of others.
const TYPES: &[(&[&str], NumberType)] = &[
    (&["MET_CHAR"], NumberType::I8),
    (&["MET_UCHAR"], NumberType::U8),
    (&["MET_SHORT"], NumberType::I16),
    (&["MET_USHORT"], NumberType::U16),
    (&["MET_INT"], NumberType::I32),
    (&["MET_UINT"], NumberType::U32),
    (&["MET_LONG_LONG"], NumberType::I64),
    (&["MET_ULONG_LONG"], NumberType::U64),
    (&["MET_FLOAT"], NumberType::F32),
    (&["MET_DOUBLE"], NumberType::F64),
];
const PLACE: &str = "without it left and right are unknown; save the volume from 3D Slicer or ITK";

/// The voxels.
///
/// # Errors
/// [`FormatProblem`] when the file cannot be read or trusted.
pub(super) fn read<T: Voxel>(
    source: ImageSource,
    faulty: impl Fn([usize; 3], Faults) -> FormatProblem,
) -> Result<Voxels<T>, FormatProblem> {
    let ImageSource { path, head, rest, extent } = source;
    let mut from = Box::new(BufReader::with_capacity(1 << 16, Cursor::new(head).chain(rest)));
    let raster = Header::read(from.as_mut())?.raster(&path)?;
    raster.read(&path, from, &extent, faulty)
}

/// Keys and values of a header.
struct Header {
    fields: Vec<(String, String)>,
    /// Names of files after `ElementDataFile = LIST`.
    list: Vec<String>,
}

impl Header {
    /// Reads up to `ElementDataFile`, which is the last key.
    fn read(from: &mut dyn BufRead) -> Result<Self, FormatProblem> {
        let mut header = Self { fields: Vec::new(), list: Vec::new() };
        let (mut bytes, mut number) = (0, 0);
        while let Some(line) = header_line(from, &mut bytes)? {
            number += 1;
            if line.trim().is_empty() {
                continue;
            }
            let refused = || FormatProblem::Line { line: number, text: beginning(&line) };
            let (name, value) = line.split_once('=').ok_or_else(refused)?;
            let (name, value) = (name.trim().to_owned(), value.trim().to_owned());
            if header.get(&[&name]).is_some() {
                return Err(FormatProblem::Twice { field: name });
            }
            let is_last = name == "ElementDataFile";
            header.fields.push((name, value.clone()));
            if is_last {
                if value.starts_with("LIST") {
                    while let Some(line) = header_line(from, &mut bytes)? {
                        header.list.extend(Some(line.trim().to_owned()).filter(|name| !name.is_empty()));
                    }
                }
                break;
            }
        }
        Ok(header)
    }

    /// The first of several names that is there.
    fn get(&self, names: &[&str]) -> Option<&str> {
        names
            .iter()
            .find_map(|name| self.fields.iter().find(|(n, _)| n == name))
            .map(|(_, value)| value.as_str())
    }

    fn need(&self, names: &[&'static str], expected: &'static str) -> Result<&str, FormatProblem> {
        let missing = FormatProblem::Missing { field: names.first().copied().unwrap_or(""), expected };
        self.get(names).ok_or(missing)
    }

    fn flag(&self, names: &[&'static str], default: bool) -> Result<bool, FormatProblem> {
        match self.get(names).map(str::to_lowercase).as_deref() {
            None => Ok(default),
            Some("true" | "1") => Ok(true),
            Some("false" | "0") => Ok(false),
            Some(other) => {
                Err(FormatProblem::field(names.first().copied().unwrap_or(""), other, "True or False"))
            }
        }
    }

    /// `N` finite numbers.
    fn numbers<const N: usize>(
        &self,
        names: &[&'static str],
        expected: &'static str,
    ) -> Result<[f64; N], FormatProblem> {
        let text = self.need(names, expected)?;
        let numbers: Option<Vec<f64>> = text.split_whitespace().map(|word| word.parse().ok()).collect();
        let numbers = numbers.and_then(|all| <[f64; N]>::try_from(all).ok());
        let finite = numbers.filter(|all| all.iter().all(|v| v.is_finite()));
        finite.ok_or_else(|| {
            FormatProblem::field(
                names.first().copied().unwrap_or(""),
                text,
                "finite numbers, 3 (of a matrix 9)",
            )
        })
    }

    fn raster(&self, path: &Path) -> Result<Raster, FormatProblem> {
        let refused = FormatProblem::field;
        let count = self.need(&["NDims"], "3")?;
        if count != "3" {
            return Err(refused("NDims", count, "3"));
        }
        let sizes = self.numbers::<3>(&["DimSize"], "it gives the voxels' number")?;
        if sizes.iter().any(|n| n.fract() != 0.0 || !(1.0..=1e9).contains(n)) {
            return Err(refused("DimSize", &format!("{sizes:?}"), "whole numbers"));
        }
        if let Some(channels) = self.get(&["ElementNumberOfChannels"])
            && channels != "1"
        {
            return Err(refused("ElementNumberOfChannels", channels, "1"));
        }
        let name = self.need(&["ElementType"], "it gives the kind of number")?;
        let number = number_named(name, TYPES).ok_or_else(|| {
            refused("ElementType", name, "MET_CHAR to MET_DOUBLE, and not MET_LONG, whose size is uncertain")
        })?;
        let is_compressed = self.flag(&["CompressedData"], false)?;
        let is_binary = self.flag(&["BinaryData"], true)?;
        let encoding = match (is_binary, is_compressed) {
            (true, false) => Encoding::Raw,
            (true, true) => Encoding::Deflate,
            (false, false) => Encoding::Text,
            (false, true) => {
                return Err(refused("CompressedData", "True", "False where BinaryData is False"));
            }
        };
        let byte_skip =
            match self.get(&["HeaderSize"]) {
                None => Some(0),
                Some("-1") if encoding == Encoding::Raw => None,
                Some(text) => Some(text.parse().map_err(|_| {
                    refused("HeaderSize", text, "a number of bytes, or -1 where data are raw")
                })?),
            };
        Ok(Raster {
            dims: sizes.map(|n| n as usize),
            components: 1,
            affine: self.affine()?,
            stored: Stored {
                number,
                big_endian: self.flag(&["BinaryDataByteOrderMSB", "ElementByteOrderMSB"], false)?,
                scaling: None,
            },
            encoding,
            files: self.files(path)?,
            line_skip: 0,
            byte_skip,
        })
    }

    fn affine(&self) -> Result<Affine, FormatProblem> {
        let spacing = self.numbers::<3>(&["ElementSpacing", "ElementSize"], "it gives the voxels' size")?;
        let origin = self.numbers::<3>(&["Offset", "Position", "Origin"], PLACE)?;
        let matrix = self.numbers::<9>(&["TransformMatrix", "Rotation", "Orientation"], PLACE)?;
        let (rows, _) = matrix.as_chunks::<3>();
        let mut steps = [Vector3::zeros(); 3];
        for (step, (row, mm)) in steps.iter_mut().zip(rows.iter().zip(spacing)) {
            *step = Vector3::from(*row) * mm;
        }
        Ok(Affine::from_lps(steps, origin.into()))
    }

    fn files(&self, path: &Path) -> Result<Vec<PathBuf>, FormatProblem> {
        let named = self.need(&["ElementDataFile"], "it says where the voxels are")?;
        let words: Vec<&str> = named.split_whitespace().collect();
        let names = match words.first() {
            Some(&"LOCAL" | &"Local" | &"local") => return Ok(vec![]),
            Some(&"LIST") => self.list.clone(),
            Some(word) if word.contains('%') => numbered_files(&words).unwrap_or_default(),
            Some(_) => vec![named.to_owned()],
            None => vec![],
        };
        if names.is_empty() {
            let expected = "LOCAL, a file, a pattern with first, last and step, or LIST with a file a line";
            return Err(FormatProblem::field("ElementDataFile", named, expected));
        }
        Ok(names.iter().map(|name| path.with_file_name("").join(name)).collect())
    }
}
