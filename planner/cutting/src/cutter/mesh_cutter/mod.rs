//! A cutter from its surface: any closed mesh, with cutting edges found by the dihedral angle or given as polylines.
//!
//! A facet edge is a candidate where the surface is convex and turns by at least a given angle; candidates that continue each other
//! make one edge. A piece of an edge cuts where one of its two facets, the rake face, faces the turn, and the other, the flank, faces
//! away from the shaft and not the turn. Its angles follow from the geometry: ε and β from its direction, γ_n from the normal n of the
//! rake face, sin γ_n = n·z_e with z_e the third axis of the element's frame (for a drill this is equation (6) of the source).
//!
//! A piece that stands along the shaft takes no chip in a plunge and is left out. Edges that pass the same radius share the feed.
//!
//! Invariants: every facet edge is shared by exactly two facets in opposite senses, and the mesh faces outwards. Not checked here:
//! facets that cross each other (`bonemill-part` refuses them on reading).

mod chains;
mod edges;
mod elements;
mod profile;
#[cfg(test)]
mod tests;
mod topology;

use bonemill_geometry::{Frame, Mesh, Point, Tool, basis};
use nalgebra::{Rotation3, Unit, Vector3};

use self::edges::{CuttingPiece, pieces_of};
use self::topology::Topology;
use crate::cutter::edge::{checked_count, checked_feed};
use crate::cutter::{Cutter, CutterError, CuttingEdges, SolidOfRevolution, checked};

/// Where the cutting edges of a mesh come from.
#[derive(Debug, Clone, PartialEq)]
pub enum EdgeSource {
    /// Convex facet edges at which the surface turns by at least this, rad.
    Dihedral {
        /// The least turn.
        least_rad: f64,
    },
    /// Polylines on the mesh, mm, in its frame.
    Polylines(Vec<Vec<[f64; 3]>>),
}

/// How a mesh is a cutter.
#[derive(Debug, Clone, PartialEq)]
pub struct MeshCutterSpec {
    /// Direction of the shaft in the mesh's frame, from the tip to the handpiece.
    pub axis: Vector3<f64>,
    /// A point of the axis in the mesh's frame, mm.
    pub axis_point_mm: Vector3<f64>,
    /// +1 turns counter-clockwise seen from the handpiece, −1 clockwise: then the cutter is the mesh's mirror image.
    pub spin: i8,
    /// Its edges.
    pub edges: EdgeSource,
}

/// A cutter from a closed mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct MeshCutter {
    mesh: Mesh<Tool>,
    solid: SolidOfRevolution,
    /// Pieces of each edge, from one end to the other.
    edges: Vec<Vec<CuttingPiece>>,
}

/// Facets beyond this are refused: tables of edges stay below 1 GB.
const MOST_FACETS: usize = 5_000_000;
/// Farther from the mesh than this part of its size, an edge given as a polyline is not on it.
const ON_MESH: f64 = 1e-3;

impl MeshCutter {
    /// A cutter from a closed mesh, mm, that faces outwards.
    ///
    /// # Errors
    /// [`CutterError`]: a mesh that is open, not manifold, empty or inside out; an edge that is not on it; no edge that cuts.
    pub fn new<F: Frame>(mesh: &Mesh<F>, spec: &MeshCutterSpec) -> Result<Self, CutterError> {
        checked(
            "facets",
            mesh.triangles.len() as f64,
            |n| (4.0..=MOST_FACETS as f64).contains(&n),
            "4 to 5 million",
        )?;
        if let Some(vertex) = mesh.vertices.iter().position(|v| !v.coords.iter().all(|c| c.abs() <= 1e4)) {
            let value = mesh.vertices[vertex].coords.amax();
            return Err(CutterError::OutOfRange {
                name: "vertex coordinate, mm",
                value,
                expected: "within ±10 000",
            });
        }
        let to_tool = Placement::new(spec)?;
        let mut turned = to_tool.mesh(mesh);
        let topology = Topology::new(&turned.triangles, turned.vertices.len())?;
        let volume_mm3 = turned.volume_mm3();
        if volume_mm3 <= 0.0 {
            return Err(CutterError::InsideOut { volume_mm3 });
        }
        let polylines = match &spec.edges {
            EdgeSource::Dihedral { least_rad } => {
                checked("dihedral angle, rad", *least_rad, |a| a > 0.0 && a < 3.0, "above 0, below 3")?;
                chains::convex_chains(&turned, &topology, *least_rad)
            }
            EdgeSource::Polylines(given) => {
                let lines: Vec<Vec<Vector3<f64>>> = given
                    .iter()
                    .map(|line| line.iter().map(|p| to_tool.point((*p).into())).collect())
                    .collect();
                edges::check_on_mesh(&turned, &lines, ON_MESH)?;
                lines
            }
        };
        let mut edges = pieces_of(&turned, &polylines);
        if edges.is_empty() {
            return Err(CutterError::NoEdge);
        }
        let lowest = turned.vertices.iter().map(|v| v.z()).fold(f64::INFINITY, f64::min);
        turned.vertices.iter_mut().for_each(|v| v.coords.z -= lowest);
        edges.iter_mut().flatten().for_each(|p| p.ends.iter_mut().for_each(|e| e.z -= lowest));
        let solid = profile::solid_of(&turned)?;
        Ok(Self { mesh: turned, solid, edges })
    }

    /// How many edges it has.
    pub fn edge_count(&self) -> usize {
        self.edges.len()
    }

    /// Points of each cutting edge, tool frame, mm.
    pub fn polylines(&self) -> Vec<Vec<Point<Tool>>> {
        let line = |pieces: &Vec<CuttingPiece>| {
            let ends = pieces.iter().flat_map(|p| p.ends).map(Point::from_coords);
            let mut points: Vec<Point<Tool>> = ends.collect();
            points.dedup();
            points
        };
        self.edges.iter().map(line).collect()
    }

    /// Largest height of an edge, mm.
    fn lip_height_mm(&self) -> f64 {
        let ends = |z: fn(f64, f64) -> f64, start: f64| {
            self.edges.iter().flatten().flat_map(|p| [p.ends[0].z, p.ends[1].z]).fold(start, z)
        };
        ends(f64::max, f64::NEG_INFINITY) - ends(f64::min, f64::INFINITY)
    }
}

impl Cutter for MeshCutter {
    fn solid(&self) -> &SolidOfRevolution {
        &self.solid
    }

    /// `elements` along every edge, shared among its straight pieces by their length.
    fn edges(&self, feed_mm_rev: f64, elements: usize) -> Result<CuttingEdges, CutterError> {
        let count = checked_count(elements)?;
        let height_mm = self.lip_height_mm();
        // a flat-ended cutter has no lips to outrun
        let height_mm = if height_mm > 1e-6 { height_mm } else { f64::INFINITY };
        let f = checked_feed(feed_mm_rev, self.edges.len() as u32, height_mm)?;
        Ok(CuttingEdges { elements: elements::elements(&self.edges, f, count), copies: 1 })
    }

    fn mesh(&self) -> Mesh<Tool> {
        self.mesh.clone()
    }
}

/// From the mesh's frame to the tool's, but for the height.
struct Placement {
    tool_from_mesh: Rotation3<f64>,
    axis_point_mm: Vector3<f64>,
    mirror: bool,
}

impl Placement {
    fn new(spec: &MeshCutterSpec) -> Result<Self, CutterError> {
        let axis = Unit::try_new(spec.axis, 1e-9).filter(|a| a.iter().all(|c| c.is_finite()));
        let Some(axis) = axis else {
            return Err(CutterError::OutOfRange {
                name: "length of the axis",
                value: spec.axis.norm(),
                expected: "a direction",
            });
        };
        checked("point of the axis, mm", spec.axis_point_mm.amax(), |v| v <= 1e4, "within ±10 000")?;
        checked("spin", f64::from(spec.spin), |s| s.abs() == 1.0, "-1 or 1")?;
        let tool_from_mesh = basis::from_z(&axis).inverse();
        Ok(Self { tool_from_mesh, axis_point_mm: spec.axis_point_mm, mirror: spec.spin < 0 })
    }

    fn point(&self, p: Vector3<f64>) -> Vector3<f64> {
        let p = self.tool_from_mesh * (p - self.axis_point_mm);
        if self.mirror { Vector3::new(p.x, -p.y, p.z) } else { p }
    }

    fn mesh<F: Frame>(&self, mesh: &Mesh<F>) -> Mesh<Tool> {
        let vertices = mesh.vertices.iter().map(|v| Point::from_coords(self.point(v.coords))).collect();
        let turn = |[a, b, c]: [u32; 3]| if self.mirror { [a, c, b] } else { [a, b, c] };
        Mesh { vertices, triangles: mesh.triangles.iter().map(|t| turn(*t)).collect() }
    }
}
