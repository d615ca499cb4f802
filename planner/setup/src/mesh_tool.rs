//! A cutter from the files that a case's `[mesh]` names.

use std::path::{Path, PathBuf};

use bonemill_case::MeshTool;
use bonemill_cutting::cutter::{CutterError, EdgeSource, MeshCutter, MeshCutterSpec};
use bonemill_geometry::{Mesh, Part};
use bonemill_imaging::part::{LengthUnit, PartError, RepairLimits, Solid, read_facets};
use bonemill_planfile::read_cutting_edges;
use thiserror::Error;

use super::PlanError;

/// Why a mesh is no cutter.
#[derive(Debug, Error)]
pub enum MeshToolError {
    /// It cannot be read, or bounds no solid.
    #[error(transparent)]
    Mesh(#[from] PartError),
    /// It has no edge that cuts, or not those that were given.
    #[error(transparent)]
    Cutter(#[from] CutterError),
}

/// The surface of a cutter in a file (STL, OBJ or PLY) whose unit of length is `scale_mm`. Nothing is repaired but vertices that are equal:
/// a hole or a loose piece may be where it cuts.
///
/// # Errors
/// [`PartError`] with the place of what is wrong.
pub fn cutter_mesh(path: &Path, scale_mm: f64) -> Result<Mesh<Part>, PartError> {
    let mut facets = read_facets(path)?;
    facets.vertices.iter_mut().for_each(|v| *v *= scale_mm);
    let limits = RepairLimits { weld_mm: 1e-6, hole_perimeter_mm: 0.0, debris_share: 0.0 };
    Ok(Solid::from_facets(facets, Some(LengthUnit::Mm), &limits)?.mesh)
}

/// The cutter of a file.
///
/// # Errors
/// [`MeshToolError`].
pub fn cutter_from_file(
    path: &Path,
    scale_mm: f64,
    spec: &MeshCutterSpec,
) -> Result<MeshCutter, MeshToolError> {
    Ok(MeshCutter::new(&cutter_mesh(path, scale_mm)?, spec)?)
}

/// The cutter of a case; `place` says where the file is that the case names so.
///
/// # Errors
/// [`PlanError::MeshTool`], [`PlanError::File`] for a file of edges.
pub fn mesh_cutter(
    tool: &MeshTool,
    spin: i8,
    place: impl Fn(&Path) -> PathBuf,
) -> Result<MeshCutter, PlanError> {
    let edges = match &tool.edges {
        None => EdgeSource::Dihedral { least_rad: tool.dihedral_rad },
        Some(file) => {
            let mut lines = read_cutting_edges(&place(file))?;
            lines.iter_mut().flatten().flatten().for_each(|value| *value *= tool.scale_mm);
            EdgeSource::Polylines(lines)
        }
    };
    let spec = MeshCutterSpec { axis: tool.axis, axis_point_mm: tool.axis_point_mm, spin, edges };
    let path = place(&tool.stl);
    cutter_from_file(&path, tool.scale_mm, &spec)
        .map_err(|source| PlanError::MeshTool { path, source: Box::new(source) })
}
