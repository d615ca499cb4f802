//! An NRRD header: fields, keys, and what they say about voxels and their place.

use std::io::BufRead;
use std::path::{Path, PathBuf};

use nalgebra::Vector3;

use super::super::problem::{FormatProblem, beginning};
use super::super::raster::{Encoding, Raster, header_line, number_named, numbered_files};
use super::super::stored::{NumberType, Stored};
use super::super::straight::Affine;

/// Names of the types of numbers.
const TYPES: &[(&[&str], NumberType)] = &[
    (&["signed char", "int8", "int8_t"], NumberType::I8),
    (&["uchar", "unsigned char", "uint8", "uint8_t"], NumberType::U8),
    (&["short", "short int", "signed short", "signed short int", "int16", "int16_t"], NumberType::I16),
    (&["ushort", "unsigned short", "unsigned short int", "uint16", "uint16_t"], NumberType::U16),
    (&["int", "signed int", "int32", "int32_t"], NumberType::I32),
    (&["uint", "unsigned int", "uint32", "uint32_t"], NumberType::U32),
    (
        &[
            "longlong",
            "long long",
            "long long int",
            "signed long long",
            "signed long long int",
            "int64",
            "int64_t",
        ],
        NumberType::I64,
    ),
    (&["ulonglong", "unsigned long long", "unsigned long long int", "uint64", "uint64_t"], NumberType::U64),
    (&["float"], NumberType::F32),
    (&["double"], NumberType::F64),
];
/// Signs of a space's axes in `ct`, which is RAS.
const SPACES: &[(&[&str], [f64; 3])] = &[
    (&["right-anterior-superior", "ras"], [1.0, 1.0, 1.0]),
    (&["left-anterior-superior", "las"], [-1.0, 1.0, 1.0]),
    (&["left-posterior-superior", "lps"], [-1.0, -1.0, 1.0]),
];
/// What a header without a place would need.
const PLACE: &str = "without it left and right are unknown; save the volume from 3D Slicer";

/// Fields and keys of a header.
#[derive(Debug)]
pub(super) struct Header {
    fields: Vec<(String, String)>,
    /// Names of files after `data file: LIST`.
    list: Vec<String>,
    /// Keys that programs add, `key:=value`.
    pub keys: Vec<(String, String)>,
}

impl Header {
    /// Reads up to the empty line before the data, or to the end of a detached header.
    ///
    /// # Errors
    /// [`FormatProblem`] for a line that is neither field, key nor comment, and for a field that stands twice.
    pub fn read(from: &mut dyn BufRead) -> Result<Self, FormatProblem> {
        let mut header = Self { fields: Vec::new(), list: Vec::new(), keys: Vec::new() };
        let (mut bytes, mut number, mut is_list) = (0, 0, false);
        while let Some(line) = header_line(from, &mut bytes)? {
            number += 1;
            if number == 1 || line.starts_with('#') {
                continue;
            }
            if is_list {
                if !line.trim().is_empty() {
                    header.list.push(line.trim().to_owned());
                }
                continue;
            }
            if line.is_empty() {
                break;
            }
            let refused = || FormatProblem::Line { line: number, text: beginning(&line) };
            let (name, value) = line.split_once(':').ok_or_else(refused)?;
            if let Some(value) = value.strip_prefix('=') {
                header.keys.push((name.to_owned(), value.to_owned()));
                continue;
            }
            let name = plain(&name.trim().to_lowercase());
            if header.get(&name).is_some() {
                return Err(FormatProblem::Twice { field: name });
            }
            is_list = name == "data file" && value.trim().to_uppercase().starts_with("LIST");
            header.fields.push((name, value.trim().to_owned()));
        }
        Ok(header)
    }

    fn get(&self, field: &str) -> Option<&str> {
        self.fields.iter().find(|(name, _)| name == field).map(|(_, value)| value.as_str())
    }

    fn need(&self, field: &'static str, expected: &'static str) -> Result<&str, FormatProblem> {
        self.get(field).ok_or(FormatProblem::Missing { field, expected })
    }

    /// What the header says; `path` is its file.
    ///
    /// # Errors
    /// [`FormatProblem`] for a field that is missing, or whose value is none that is read.
    pub fn raster(&self, path: &Path) -> Result<Raster, FormatProblem> {
        let refused = FormatProblem::field;
        let sizes = self.need("sizes", "it gives the voxels' number")?;
        let sizes: Option<Vec<usize>> = sizes.split_whitespace().map(|word| word.parse().ok()).collect();
        let sizes =
            sizes.ok_or_else(|| refused("sizes", self.get("sizes").unwrap_or(""), "whole numbers"))?;
        let (components, dims, affine) = self.place(&sizes)?;
        let name = self.need("type", "it gives the kind of number")?;
        let number = number_named(&name.to_lowercase(), TYPES)
            .ok_or_else(|| refused("type", name, "a number of 8 to 64 bits"))?;
        let name = self.need("encoding", "it says how the voxels are written")?;
        let encoding = match name.to_lowercase().as_str() {
            "raw" => Encoding::Raw,
            "gzip" | "gz" => Encoding::Deflate,
            "ascii" | "text" | "txt" => Encoding::Text,
            _ => return Err(refused("encoding", name, "raw, gzip or ascii")),
        };
        let big_endian = match self.get("endian").map(str::to_lowercase).as_deref() {
            Some("big") => true,
            Some("little") => false,
            None if number.bytes() == 1 || encoding == Encoding::Text => false,
            None => return Err(FormatProblem::Missing { field: "endian", expected: "big or little" }),
            Some(other) => return Err(refused("endian", other, "big or little")),
        };
        let byte_skip = match self.whole("byte skip", -1)? {
            -1 if encoding == Encoding::Raw => None,
            -1 => return Err(refused("byte skip", "-1", "at least 0 where voxels are not raw")),
            skip => Some(skip as u64),
        };
        Ok(Raster {
            dims,
            components,
            affine,
            stored: Stored { number, big_endian, scaling: None },
            encoding,
            files: self.files(path)?,
            line_skip: self.whole("line skip", 0)? as u64,
            byte_skip,
        })
    }

    /// A whole number, 0 where the field is absent.
    fn whole(&self, field: &'static str, least: i64) -> Result<i64, FormatProblem> {
        let Some(text) = self.get(field) else { return Ok(0) };
        let number = text.parse().ok().filter(|n| *n >= least);
        number.ok_or_else(|| FormatProblem::field(field, text, "a whole number, at least 0 (byte skip: -1)"))
    }

    /// Files with the voxels; none where they follow the header.
    fn files(&self, path: &Path) -> Result<Vec<PathBuf>, FormatProblem> {
        let Some(named) = self.get("data file") else { return Ok(vec![]) };
        let words: Vec<&str> = named.split_whitespace().collect();
        let names = match words.first() {
            Some(word) if word.eq_ignore_ascii_case("LIST") => self.list.clone(),
            Some(word) if word.contains('%') => numbered_files(&words).unwrap_or_default(),
            _ => vec![named.to_owned()],
        };
        if names.is_empty() {
            let expected = "a file, a pattern with first, last and step, or LIST with a file a line";
            return Err(FormatProblem::field("data file", named, expected));
        }
        Ok(names.iter().map(|name| path.with_file_name("").join(name)).collect())
    }

    /// Numbers a voxel, voxels along i, j, k, and where they lie.
    fn place(&self, sizes: &[usize]) -> Result<(usize, [usize; 3], Affine), FormatProblem> {
        let named = self.need("space", PLACE)?;
        let space = SPACES.iter().find(|(names, _)| names.contains(&named.to_lowercase().as_str()));
        let signs = space.ok_or_else(|| {
            FormatProblem::field(
                "space",
                named,
                "left-posterior-superior, right-anterior-superior or left-anterior-superior",
            )
        })?;
        if let Some(units) = self.get("space units")
            && units.split_whitespace().any(|unit| !matches!(unit.trim_matches('"'), "mm" | ""))
        {
            return Err(FormatProblem::field("space units", units, "\"mm\" throughout"));
        }
        let text = self.need("space directions", PLACE)?;
        let refused = || {
            FormatProblem::field(
                "space directions",
                text,
                "a vector (x,y,z) or none for each of sizes, three vectors in all",
            )
        };
        let words = words(text);
        if words.len() != sizes.len() {
            return Err(refused());
        }
        let (mut steps, mut dims, mut components) = (Vec::new(), Vec::new(), 1usize);
        for (place, (word, size)) in words.iter().zip(sizes).enumerate() {
            if word.eq_ignore_ascii_case("none") {
                // several numbers a voxel stand side by side only on the first axis
                if *size != 1 && place != 0 {
                    return Err(FormatProblem::field(
                        "sizes",
                        &size.to_string(),
                        "1 for an axis without direction that is not the first",
                    ));
                }
                components = components.saturating_mul(*size);
            } else {
                steps.push(vector(word).ok_or_else(refused)?);
                dims.push(*size);
            }
        }
        let (Ok(steps), Ok(dims)) = (steps.try_into(), dims.try_into()) else { return Err(refused()) };
        let text = self.need("space origin", PLACE)?;
        let origin = vector(text)
            .ok_or_else(|| FormatProblem::field("space origin", text, "three finite numbers (x,y,z)"))?;
        Ok((components, dims, Affine::with_signs(Vector3::from(signs.1), steps, origin)))
    }
}

/// A field's name in the form with a blank: `datafile` and `data file` are one field.
fn plain(name: &str) -> String {
    match name {
        "datafile" => "data file".into(),
        "lineskip" => "line skip".into(),
        "byteskip" => "byte skip".into(),
        _ => name.into(),
    }
}

/// Vectors and words: blanks in parentheses separate nothing.
fn words(text: &str) -> Vec<String> {
    let (mut all, mut word, mut depth) = (Vec::new(), String::new(), 0i32);
    for c in text.chars() {
        depth += i32::from(c == '(') - i32::from(c == ')');
        if c.is_whitespace() {
            if depth <= 0 && !word.is_empty() {
                all.push(std::mem::take(&mut word));
            }
        } else {
            word.push(c);
        }
    }
    if !word.is_empty() {
        all.push(word);
    }
    all
}

/// Three finite numbers, `(x,y,z)`.
fn vector(text: &str) -> Option<Vector3<f64>> {
    let inner = text.trim().strip_prefix('(')?.strip_suffix(')')?;
    let numbers: Option<Vec<f64>> = inner.split(',').map(|word| word.trim().parse().ok()).collect();
    let numbers: [f64; 3] = numbers?.try_into().ok()?;
    numbers.iter().all(|v| v.is_finite()).then(|| numbers.into())
}
