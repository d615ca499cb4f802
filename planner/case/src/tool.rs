//! The tool of a case: a burr, or one of the cutters with edges.

use std::path::{Path, PathBuf};

use bonemill_cutting::cutter::{CutterError, GlenoidReamer, GlenoidReamerSpec, TwistDrill, TwistDrillSpec};
use nalgebra::Vector3;

use crate::keys::tool as k;
use crate::write::{float, text, vector};

/// Which tool, without its dimensions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ToolKind {
    Burr,
    Drill,
    Reamer,
    Mesh,
}

/// How a tool turns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spindle {
    /// Speed, rpm.
    pub rpm: f64,
    /// −1 clockwise seen from the handpiece, +1 the other way.
    pub spin: i8,
}

/// `[tool]`: what cuts.
#[derive(Debug, Clone, PartialEq)]
pub enum ToolSpec {
    /// A spherical burr; its dimensions stand in [`crate::Case::burr`].
    Burr,
    /// `[drill]`.
    Drill(TwistDrillSpec, Spindle),
    /// `[reamer]`.
    Reamer(GlenoidReamerSpec, Spindle),
    /// `[mesh]`.
    Mesh(MeshTool, Spindle),
}

/// `[mesh]`: a cutter from its surface.
#[derive(Debug, Clone, PartialEq)]
pub struct MeshTool {
    /// The STL, relative to the case file.
    pub stl: PathBuf,
    /// Length of a unit of the file, mm.
    pub scale_mm: f64,
    /// Direction of the shaft in the file's axes, unit, from the tip to the handpiece.
    pub axis: Vector3<f64>,
    /// A point of the axis in the file's axes after scaling, mm.
    pub axis_point_mm: Vector3<f64>,
    /// File of the cutting edges; `None`: found by the angle.
    pub edges: Option<PathBuf>,
    /// Least turn of the surface at a cutting edge, rad.
    pub dihedral_rad: f64,
}

impl ToolSpec {
    fn kind(&self) -> ToolKind {
        match self {
            Self::Burr => ToolKind::Burr,
            Self::Drill(..) => ToolKind::Drill,
            Self::Reamer(..) => ToolKind::Reamer,
            Self::Mesh(..) => ToolKind::Mesh,
        }
    }

    /// The word in the case file, and the name of its table.
    pub fn word(&self) -> &'static str {
        k::KIND.word(self.kind())
    }

    /// Keys and paths of the files that describe it, relative to the case file.
    pub fn files(&self) -> impl Iterator<Item = (&'static str, &Path)> {
        let mesh = match self {
            Self::Mesh(mesh, _) => Some(mesh),
            Self::Burr | Self::Drill(..) | Self::Reamer(..) => None,
        };
        mesh.into_iter()
            .flat_map(|mesh| [("mesh.stl", Some(&mesh.stl)), ("mesh.edges", mesh.edges.as_ref())])
            .filter_map(|(key, path)| Some((key, path?.as_path())))
    }

    /// How it turns; a burr's own values stand in its table.
    pub fn spindle(&self) -> Option<Spindle> {
        match self {
            Self::Burr => None,
            Self::Drill(_, spindle) | Self::Reamer(_, spindle) | Self::Mesh(_, spindle) => Some(*spindle),
        }
    }

    /// Largest radius, mm, of a tool that is no burr and no mesh.
    pub fn radius_mm(&self) -> Option<f64> {
        match self {
            Self::Drill(spec, _) => Some(spec.radius_mm),
            Self::Reamer(spec, _) => Some(spec.rim_radius_mm),
            Self::Burr | Self::Mesh(..) => None,
        }
    }

    /// The table whose dimensions make no tool, and why.
    pub(crate) fn build(&self) -> Result<(), (&'static str, CutterError)> {
        match self {
            Self::Drill(spec, _) => TwistDrill::new(*spec).map(drop).map_err(|e| (self.word(), e)),
            Self::Reamer(spec, _) => GlenoidReamer::new(*spec).map(drop).map_err(|e| (self.word(), e)),
            Self::Burr | Self::Mesh(..) => Ok(()),
        }
    }

    /// The lines of its table.
    pub(crate) fn lines(&self) -> Option<(&'static str, Vec<(&'static str, String)>)> {
        let mut lines = match self {
            Self::Burr => return None,
            Self::Drill(s, _) => vec![
                ("radius_mm", float(s.radius_mm)),
                ("point_deg", float(s.point_deg)),
                ("helix_deg", float(s.helix_deg)),
                ("chisel_deg", float(s.chisel_deg)),
                ("web_mm", float(s.web_mm)),
                ("lips", s.lips.to_string()),
                ("flute_mm", float(s.flute_mm)),
            ],
            Self::Reamer(s, _) => vec![
                ("arc_radius_mm", float(s.arc_radius_mm)),
                ("offset_mm", float(s.offset_mm)),
                ("rim_radius_mm", float(s.rim_radius_mm)),
                ("edge_deg", float(s.edge_deg)),
                ("edges", s.edges.to_string()),
                ("nipple_radius_mm", float(s.nipple_radius_mm)),
                ("nipple_length_mm", float(s.nipple_length_mm)),
            ],
            Self::Mesh(m, _) => {
                let mut lines = vec![
                    ("stl", text(&m.stl.to_string_lossy())),
                    ("scale_mm", float(m.scale_mm)),
                    ("axis", vector(&m.axis)),
                    ("axis_point_mm", vector(&m.axis_point_mm)),
                    ("dihedral_deg", float(crate::write::degrees(m.dihedral_rad))),
                ];
                lines.extend(m.edges.iter().map(|edges| ("edges", text(&edges.to_string_lossy()))));
                lines
            }
        };
        let spindle = self.spindle()?;
        lines.extend([("spindle_rpm", float(spindle.rpm)), ("spin", spindle.spin.to_string())]);
        Some((self.word(), lines))
    }
}

/// Which regression gives k_c and k_f k_c of an edge element.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EdgeModel {
    /// The same everywhere.
    Constant,
    /// Linear in 1 − sin γ_n.
    Rake,
    /// A power law of chip area and speed.
    Chip,
    /// A power law of chip area, speed and 1 − sin γ_n.
    PowerLaw,
    /// Linear in the reciprocal of the speed.
    Reciprocal,
}

impl EdgeModel {
    /// The word in the case file.
    pub fn word(self) -> &'static str {
        k::EDGE_MODEL.word(self)
    }

    /// How many coefficients each of k_c and k_f k_c has.
    pub fn coefficients(self) -> usize {
        match self {
            Self::Constant => 1,
            Self::Rake | Self::Reciprocal => 2,
            Self::Chip => 3,
            Self::PowerLaw => 4,
        }
    }
}

/// What the edges of a tool that is no burr feel, at `material.rho_ref_g_cm3`.
#[derive(Debug, Clone, PartialEq)]
pub struct EdgeMaterial {
    /// The regression.
    pub model: EdgeModel,
    /// Its coefficients of k_c.
    pub k_normal: Vec<f64>,
    /// Its coefficients of k_f k_c.
    pub k_friction: Vec<f64>,
}

#[cfg(test)]
mod tests;
