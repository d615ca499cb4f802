//! PLY to facets: ASCII and binary of either byte order; polygons are cut into triangles.

use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{DefaultElement, ElementDef, Header, PropertyAccess, PropertyAccessResult};

use super::read::MeshFormat;
use super::{Facets, MOST_FACETS, PartError, polygon};

#[derive(Debug, Default)]
struct Vertex([f64; 3]);

impl Vertex {
    fn set(&mut self, name: &str, value: f64) -> PropertyAccessResult {
        let Some(axis) = ["x", "y", "z"].iter().position(|axis| *axis == name) else {
            return PropertyAccessResult::Ignored;
        };
        self.0[axis] = value;
        PropertyAccessResult::Set
    }
}

/// Setters for every scalar type.
macro_rules! scalars {
    ($($setter:ident: $t:ty),*) => {$(
        fn $setter(&mut self, name: &str, value: $t) -> PropertyAccessResult {
            self.set(name, f64::from(value))
        }
    )*};
}

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self::default()
    }
    scalars!(set_char: i8, set_uchar: u8, set_short: i16, set_ushort: u16, set_int: i32, set_uint: u32, set_float: f32, set_double: f64);
}

/// A polygon's vertex numbers; negative ones become large, and are refused with the others.
#[derive(Debug, Default)]
struct Polygon(Vec<u64>);

impl Polygon {
    fn set(&mut self, name: &str, values: impl Iterator<Item = u64>) -> PropertyAccessResult {
        if name != "vertex_indices" && name != "vertex_index" {
            return PropertyAccessResult::Ignored;
        }
        self.0 = values.collect();
        PropertyAccessResult::Set
    }
}

/// Setters for lists of every whole type.
macro_rules! lists {
    ($($setter:ident: $t:ty),*) => {$(
        fn $setter(&mut self, name: &str, value: Vec<$t>) -> PropertyAccessResult {
            self.set(name, value.into_iter().map(|v| u64::try_from(v).unwrap_or(u64::MAX)))
        }
    )*};
}

impl PropertyAccess for Polygon {
    fn new() -> Self {
        Self::default()
    }
    lists!(set_list_char: i8, set_list_uchar: u8, set_list_short: i16, set_list_ushort: u16, set_list_int: i32, set_list_uint: u32);
}

/// The facets of a PLY file.
pub(crate) fn parse(bytes: &[u8]) -> Result<Facets, PartError> {
    let error = |e: &dyn ToString| MeshFormat::Ply.error(e.to_string());
    let mut reader = Reader::new(bytes);
    let header = Parser::<DefaultElement>::new().read_header(&mut reader).map_err(|e| error(&e))?;
    check(&header, bytes.len())?;
    let (mut vertices, mut polygons) = (Vec::new(), Vec::new());
    for element in header.elements.values() {
        match element.name.as_str() {
            "vertex" => vertices = read::<Vertex>(&mut reader, element, &header)?,
            "face" => polygons = read::<Polygon>(&mut reader, element, &header)?,
            _ => drop(read::<DefaultElement>(&mut reader, element, &header)?),
        }
    }
    let vertices: Vec<[f64; 3]> = vertices.into_iter().map(|v| v.0).collect();
    let triangles = triangles(&polygons, &vertices)?;
    Ok(Facets::new(vertices, triangles))
}

fn read<E: PropertyAccess>(
    reader: &mut Reader<&[u8]>,
    element: &ElementDef,
    header: &Header,
) -> Result<Vec<E>, PartError> {
    Parser::<E>::new()
        .read_payload_for_element(reader, element, header)
        .map_err(|e| MeshFormat::Ply.error(format!("element {}: {e}", element.name)))
}

/// Refuses counts that the file cannot hold: every element takes a byte at least.
fn check(header: &Header, bytes: usize) -> Result<(), PartError> {
    for name in ["vertex", "face"] {
        if !header.elements.contains_key(name) {
            return Err(MeshFormat::Ply.error(format!("no element \"{name}\"")));
        }
    }
    for element in header.elements.values() {
        if element.properties.is_empty() && element.count > 0 {
            return Err(MeshFormat::Ply.error(format!("element {} has no properties", element.name)));
        }
        if element.count > bytes {
            let (name, count) = (&element.name, element.count);
            return Err(MeshFormat::Ply
                .error(format!("{count} of element {name} announced in a file of {bytes} bytes")));
        }
    }
    Ok(())
}

/// Polygons cut into triangles.
fn triangles(polygons: &[Polygon], vertices: &[[f64; 3]]) -> Result<Vec<[u32; 3]>, PartError> {
    let mut triangles = Vec::with_capacity(polygons.len());
    for (facet, polygon) in polygons.iter().enumerate() {
        if let Some(&vertex) = polygon.0.iter().find(|&&v| v >= vertices.len() as u64) {
            return Err(PartError::NoSuchVertex { facet, vertex, count: vertices.len() });
        }
        let corners: Vec<_> = polygon.0.iter().map(|&v| vertices[v as usize].into()).collect();
        let cut = polygon::triangles(&corners);
        triangles.extend(cut.into_iter().map(|t| t.map(|n| polygon.0[n] as u32)));
        if triangles.len() > MOST_FACETS {
            return Err(PartError::TooManyFacets { found: triangles.len(), most: MOST_FACETS });
        }
    }
    Ok(triangles)
}
