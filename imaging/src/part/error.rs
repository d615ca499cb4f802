//! Why a file is no part that can be machined, and where it fails.

use std::fmt;
use std::io;
use std::path::PathBuf;

use thiserror::Error;

use super::unit::{LONGEST_MM, LengthUnit, SHORTEST_MM};

/// A facet by its number in the file, from 0, and a point on it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FacetPlace {
    /// Number in the file, from 0.
    pub facet: u32,
    /// The point, mm.
    pub at_mm: [f64; 3],
}

impl fmt::Display for FacetPlace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, z] = self.at_mm;
        write!(f, "facet {} at ({x:.3}, {y:.3}, {z:.3}) mm", self.facet)
    }
}

/// Reading or checking a part failed.
#[derive(Debug, Error)]
pub enum PartError {
    /// The operating system refused.
    #[error("cannot read {}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Why not.
        source: io::Error,
    },
    /// The file's ending names no format that is read.
    #[error("{}: expected a file that ends in .stl, .obj or .ply", path.display())]
    UnknownFormat {
        /// The file.
        path: PathBuf,
    },
    /// The file is not what its format asks for.
    #[error("{format} cannot be read: {problem}")]
    Format {
        /// The format's name.
        format: &'static str,
        /// What is wrong, with the line or byte where the library gives it.
        problem: String,
    },
    /// A binary STL announces another number of facets than it holds.
    #[error("STL announces {announced} facets and holds {found}: the file is cut short or damaged")]
    Count {
        /// In its header.
        announced: u32,
        /// By its size.
        found: usize,
    },
    /// No facets.
    #[error("the mesh has no facets; expected a closed surface")]
    Empty,
    /// More than is read.
    #[error("the mesh has {found} facets; expected at most {most}")]
    TooManyFacets {
        /// Facets.
        found: usize,
        /// The limit.
        most: usize,
    },
    /// A facet names a vertex that does not exist.
    #[error("facet {facet} names vertex {vertex}, of {count}")]
    NoSuchVertex {
        /// Facet from 0.
        facet: usize,
        /// Vertex from 0.
        vertex: u64,
        /// Number of vertices.
        count: usize,
    },
    /// A coordinate that is NaN, infinite, or too large to be computed with.
    #[error("facet {facet}: a vertex is at {at:?}; expected finite coordinates below 1e6 in size")]
    Coordinate {
        /// Facet from 0.
        facet: usize,
        /// The vertex, in the file's unit.
        at: [f64; 3],
    },
    /// The unit is not known and mm is not plausible.
    #[error(
        "the part is {shown} long without a unit, and {shown} mm is not plausible (expected {SHORTEST_MM} to {LONGEST_MM} mm): \
         state the unit, in a job as `part.unit`{}", plausible_text(.plausible), shown = (.length * 1e4).round() / 1e4
    )]
    UnitNeeded {
        /// Longest side of the bounding box in the file's unit.
        length: f64,
        /// Units in which the part would have a plausible size.
        plausible: Vec<LengthUnit>,
    },
    /// With the unit that was stated the size is not plausible.
    #[error(
        "with unit \"{unit}\" the part is {length_mm} mm long; expected {SHORTEST_MM} to {LONGEST_MM} mm{}", plausible_text(.plausible)
    )]
    Implausible {
        /// As stated.
        unit: LengthUnit,
        /// Longest side of the bounding box, mm.
        length_mm: f64,
        /// Units in which the part would have a plausible size.
        plausible: Vec<LengthUnit>,
    },
    /// More than two facets at an edge.
    #[error(
        "{edges} edges have more than two facets, the first at {place}: the surface bounds no solid there"
    )]
    NonManifold {
        /// How many edges.
        edges: usize,
        /// The first.
        place: FacetPlace,
    },
    /// Neighbouring facets cannot be turned alike.
    #[error("the facets cannot be turned alike: the surface has one side only, seen at {place}")]
    OneSided {
        /// Where a contradiction shows.
        place: FacetPlace,
    },
    /// A hole too large to be filled.
    #[error(
        "the surface is open: a hole of {edges} edges and {perimeter_mm:.3} mm around at {place}; holes up to {most_mm} mm and {most_edges} \
         edges are filled"
    )]
    Open {
        /// Edges around the hole.
        edges: usize,
        /// Their length, mm.
        perimeter_mm: f64,
        /// The longest that is filled, mm.
        most_mm: f64,
        /// The most edges that are filled.
        most_edges: usize,
        /// A facet beside it.
        place: FacetPlace,
    },
    /// Several pieces.
    #[error(
        "the mesh has {pieces} separate pieces of some size; the second has {area_mm2:.3} mm² at {place}. Expected one solid without \
         enclosed cavities"
    )]
    Pieces {
        /// How many, debris left out.
        pieces: usize,
        /// Area of the second in size, mm².
        area_mm2: f64,
        /// A facet of it.
        place: FacetPlace,
    },
    /// The surface crosses itself.
    #[error(
        "the surface crosses itself {depth_mm:.4} mm deep: {first} and {second} ({pairs} such pairs found so far)"
    )]
    Crossing {
        /// Pairs in the part of the surface looked at until then.
        pairs: usize,
        /// How deep one facet reaches through the other, mm.
        depth_mm: f64,
        /// One facet.
        first: FacetPlace,
        /// The other.
        second: FacetPlace,
    },
    /// So many facets lie over each other that crossings cannot be looked for.
    #[error(
        "facets lie over each other too densely to look for crossings: {pairs} neighbouring pairs up to {place}"
    )]
    TooDense {
        /// Pairs of facets whose boxes meet.
        pairs: u64,
        /// Where it became too many.
        place: FacetPlace,
    },
    /// No volume.
    #[error("the surface encloses {volume_mm3:.6} mm³; expected a solid")]
    NoVolume {
        /// Enclosed volume, mm³.
        volume_mm3: f64,
    },
}

fn plausible_text(units: &[LengthUnit]) -> String {
    if units.is_empty() {
        return "; no known unit makes it so".into();
    }
    let names: Vec<_> = units.iter().map(|unit| format!("\"{unit}\"")).collect();
    format!("; plausible: {}", names.join(", "))
}
