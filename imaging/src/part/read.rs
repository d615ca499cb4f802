//! Mesh files to facets: STL (binary and ASCII), OBJ and PLY, each through a library.
//!
//! Sizes are compared with the file's length before anything is allocated from them. STL and OBJ are read in single precision,
//! which is STL's own: 4e-6 mm at 50 mm.

use std::path::Path;

use super::polygon::triangulated_obj;
use super::{Facets, MOST_FACETS, PartError, ply};

/// Bytes of a binary STL before the facets: header and count.
const STL_HEADER_BYTES: usize = 84;
/// Bytes of one facet of a binary STL.
const STL_FACET_BYTES: usize = 50;
/// Most bytes of a file. An ASCII facet takes some 250 bytes.
const MOST_BYTES: usize = 256 * MOST_FACETS;

/// A format of meshes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MeshFormat {
    /// Stereolithography, binary or ASCII.
    Stl,
    /// Wavefront.
    Obj,
    /// Polygon file format (Stanford).
    Ply,
}

impl MeshFormat {
    /// By a file's ending, in either case.
    pub fn of(path: &Path) -> Option<Self> {
        match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "stl" => Some(Self::Stl),
            "obj" => Some(Self::Obj),
            "ply" => Some(Self::Ply),
            _ => None,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Stl => "STL",
            Self::Obj => "OBJ",
            Self::Ply => "PLY",
        }
    }

    /// An error of this format.
    pub(crate) fn error(self, problem: impl ToString) -> PartError {
        PartError::Format { format: self.name(), problem: problem.to_string().replace('\n', " ") }
    }
}

/// The facets of a file.
///
/// # Errors
/// [`PartError::Io`], also for what is no regular file, [`PartError::UnknownFormat`], and those of [`parse_facets`].
pub fn read_facets(path: &Path) -> Result<Facets, PartError> {
    let format = MeshFormat::of(path).ok_or_else(|| PartError::UnknownFormat { path: path.into() })?;
    let failed = |source| PartError::Io { path: path.into(), source };
    let found = std::fs::metadata(path).map_err(failed)?;
    // a pipe may never end, and what is too large is not read first
    if !found.is_file() {
        return Err(failed(std::io::Error::other("it is no regular file")));
    }
    check_size(usize::try_from(found.len()).unwrap_or(usize::MAX))?;
    parse_facets(&std::fs::read(path).map_err(failed)?, format)
}

/// The facets in a file's bytes.
///
/// # Errors
/// [`PartError::Format`] and [`PartError::Count`] for bytes that are not of the format, [`PartError::TooManyFacets`],
/// [`PartError::Empty`], [`PartError::NoSuchVertex`] and [`PartError::Coordinate`] for facets that are none.
pub fn parse_facets(bytes: &[u8], format: MeshFormat) -> Result<Facets, PartError> {
    check_size(bytes.len())?;
    let facets = match format {
        MeshFormat::Stl => {
            let text = stl_text(bytes);
            match &text {
                Some(text) => joined(mesh_loader::stl::from_slice(text.as_bytes()), format)?,
                None => {
                    check_stl_count(bytes)?;
                    // whatever the header says, it is a binary one
                    let mut binary = bytes.to_vec();
                    binary.iter_mut().take(STL_HEADER_BYTES - 4).for_each(|byte| *byte = 0);
                    joined(mesh_loader::stl::from_slice(&binary), format)?
                }
            }
        }
        // materials are of no use, so no other file is opened
        MeshFormat::Obj => joined(
            mesh_loader::obj::from_slice(triangulated_obj(&plain_text(bytes)).as_bytes(), None, |_| {
                Err::<Vec<u8>, _>(std::io::ErrorKind::Unsupported.into())
            }),
            format,
        )?,
        MeshFormat::Ply => ply::parse(bytes)?,
    };
    facets.check()?;
    Ok(facets)
}

fn check_size(bytes: usize) -> Result<(), PartError> {
    if bytes > MOST_BYTES {
        return Err(PartError::TooManyFacets { found: bytes / STL_FACET_BYTES, most: MOST_FACETS });
    }
    Ok(())
}

/// The meshes of a scene as one.
fn joined(scene: std::io::Result<mesh_loader::Scene>, format: MeshFormat) -> Result<Facets, PartError> {
    let scene = scene.map_err(|e| format.error(e))?;
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for mesh in scene.meshes {
        let first = u32::try_from(vertices.len()).map_err(|_| format.error("too many vertices"))?;
        let shifted = |v: u32| v.checked_add(first);
        for (facet, face) in mesh.faces.iter().enumerate() {
            let [Some(a), Some(b), Some(c)] = face.map(shifted) else {
                return Err(PartError::NoSuchVertex {
                    facet,
                    vertex: face[0].into(),
                    count: mesh.vertices.len(),
                });
            };
            triangles.push([a, b, c]);
        }
        vertices.extend(mesh.vertices.iter().map(|v| v.map(f64::from)));
    }
    Ok(Facets::new(vertices, triangles))
}

/// Refuses a binary STL that was cut short between two facets, which its size alone does not show.
fn check_stl_count(bytes: &[u8]) -> Result<(), PartError> {
    let count =
        bytes.get(80..STL_HEADER_BYTES).and_then(|b| <[u8; 4]>::try_from(b).ok()).map(u32::from_le_bytes);
    let Some(announced) = count else { return Ok(()) };
    let found = (bytes.len() - STL_HEADER_BYTES) / STL_FACET_BYTES;
    if found == announced as usize { Ok(()) } else { Err(PartError::Count { announced, found }) }
}

/// An ASCII STL as its reader takes it: in UTF-8 and small letters, with a name; `None` for a binary one.
///
/// What is as long as its count of facets says is binary, whatever its header says.
fn stl_text(bytes: &[u8]) -> Option<String> {
    let count =
        bytes.get(80..STL_HEADER_BYTES).and_then(|b| <[u8; 4]>::try_from(b).ok()).map(u32::from_le_bytes);
    let is_binary =
        count.is_some_and(|count| bytes.len() == STL_HEADER_BYTES + STL_FACET_BYTES * count as usize);
    if is_binary {
        return None;
    }
    let text = plain_text(bytes).to_ascii_lowercase();
    let rest = text.trim_start().strip_prefix("solid")?;
    // the name, which may be missing or be any words, ends where the first facet begins or the solid ends
    let start = rest.find("facet").into_iter().chain(rest.find("endsolid")).min()?;
    let named = &rest[..start];
    let start = if named.contains('\n') { start } else { rest.find('\n').map_or(start, |n| n + 1) };
    Some(format!("solid part\n{}", &rest[start..]))
}

/// Text in UTF-8 or, behind its mark or with the letters of `solid`, in UTF-16; without the mark.
fn plain_text(bytes: &[u8]) -> String {
    let wide = |pairs: &[u8], unit: fn([u8; 2]) -> u16| {
        let units: Vec<u16> = pairs.chunks_exact(2).map(|pair| unit([pair[0], pair[1]])).collect();
        String::from_utf16_lossy(&units)
    };
    match bytes {
        [0xEF, 0xBB, 0xBF, text @ ..] => String::from_utf8_lossy(text).into_owned(),
        [0xFF, 0xFE, pairs @ ..] => wide(pairs, u16::from_le_bytes),
        [0xFE, 0xFF, pairs @ ..] => wide(pairs, u16::from_be_bytes),
        [b's' | b'S', 0, b'o' | b'O', 0, ..] => wide(bytes, u16::from_le_bytes),
        [0, b's' | b'S', 0, b'o' | b'O', ..] => wide(bytes, u16::from_be_bytes),
        text => String::from_utf8_lossy(text).into_owned(),
    }
}

#[cfg(test)]
#[path = "read_tests.rs"]
mod tests;
