//! From `[tool]` and the table of its kind to a [`ToolSpec`]; the edges' coefficients of `[material]`.

use std::path::PathBuf;

use bonemill_cutting::cutter::{GlenoidReamerSpec, TwistDrillSpec};
use nalgebra::Vector3;

use super::error::CaseFault;
use super::keys::{Number, tool as k};
use super::parse::whole_default;
use super::tool::{EdgeMaterial, EdgeModel, MeshTool, Spindle, ToolKind, ToolSpec};
use super::walker::Walk;

/// k_c and k_f k_c without keys, N/mm².
const DEFAULT_K: [f64; 2] = [60.0, 24.0];

/// The tool; a table of dimensions that no kind asks for is a fault.
pub(super) fn read_tool(root: &Walk<'_, '_>) -> ToolSpec {
    let t = root.table("tool");
    let kind = t.choice(&k::KIND, ToolKind::Burr);
    t.finish();
    let tables = [("drill", ToolKind::Drill), ("reamer", ToolKind::Reamer), ("mesh", ToolKind::Mesh)];
    for (name, _) in tables.into_iter().filter(|(name, of)| *of != kind && root.has(name)) {
        let why = "its tool is not the one that tool.kind names: leave the table out, or name it there";
        root.note(name, CaseFault::Contradiction { key: name.into(), why });
    }
    root.accept(&["drill", "reamer", "mesh"]);
    match kind {
        ToolKind::Burr => ToolSpec::Burr,
        ToolKind::Drill => read_drill(root.table("drill")),
        ToolKind::Reamer => read_reamer(root.table("reamer")),
        ToolKind::Mesh => read_mesh(root.table("mesh")),
    }
}

fn count(t: &Walk<'_, '_>, of: &Number) -> u32 {
    t.whole(of, whole_default(of))
}

fn read_spindle(t: &Walk<'_, '_>, rpm: &Number, spin: &Number) -> Spindle {
    let spin = t.number(spin);
    if spin.abs() != 1.0 {
        let found = format!("the number {spin}");
        t.note("spin", CaseFault::WrongType { key: t.key("spin"), found, expected: "-1 or 1".into() });
    }
    Spindle { rpm: t.number(rpm), spin: if spin > 0.0 { 1 } else { -1 } }
}

fn read_drill(t: Walk<'_, '_>) -> ToolSpec {
    let spec = TwistDrillSpec {
        radius_mm: t.number(&k::DRILL_RADIUS),
        point_deg: t.number(&k::POINT),
        helix_deg: t.number(&k::HELIX),
        chisel_deg: t.number(&k::CHISEL),
        web_mm: t.number(&k::WEB),
        lips: count(&t, &k::LIPS),
        flute_mm: t.number(&k::FLUTE),
    };
    let spindle = read_spindle(&t, &k::DRILL_RPM, &k::DRILL_SPIN);
    t.finish();
    ToolSpec::Drill(spec, spindle)
}

fn read_reamer(t: Walk<'_, '_>) -> ToolSpec {
    let spec = GlenoidReamerSpec {
        arc_radius_mm: t.number(&k::ARC),
        offset_mm: t.number(&k::OFFSET),
        rim_radius_mm: t.number(&k::RIM),
        edge_deg: t.number(&k::EDGE_ANGLE),
        edges: count(&t, &k::EDGE_COUNT),
        nipple_radius_mm: t.number(&k::NIPPLE_RADIUS),
        nipple_length_mm: t.number(&k::NIPPLE_LENGTH),
    };
    let spindle = read_spindle(&t, &k::REAMER_RPM, &k::REAMER_SPIN);
    t.finish();
    ToolSpec::Reamer(spec, spindle)
}

fn read_mesh(t: Walk<'_, '_>) -> ToolSpec {
    let axis = t.required_vector(&k::AXIS);
    let length = axis.norm();
    if t.has("axis") && (length.is_nan() || length <= 1e-9) {
        t.note("axis", CaseFault::ZeroDirection { key: t.key("axis") });
    }
    let mesh = MeshTool {
        stl: PathBuf::from(t.required_text(&k::MESH_STL)),
        scale_mm: t.number(&k::SCALE),
        // a unit vector stays as it is, so that a written case reads back bit for bit
        axis: if (length - 1.0).abs() < 1e-14 || length <= 1e-9 { axis } else { axis / length },
        axis_point_mm: t.vector(&k::AXIS_POINT).unwrap_or_else(Vector3::zeros),
        edges: t.text(&k::MESH_EDGES).map(PathBuf::from),
        dihedral_rad: t.number(&k::DIHEDRAL).to_radians(),
    };
    let spindle = read_spindle(&t, &k::MESH_RPM, &k::MESH_SPIN);
    t.finish();
    ToolSpec::Mesh(mesh, spindle)
}

/// The keys of `[material]` that are the edges'.
pub(super) fn read_edge_material(t: &Walk<'_, '_>) -> EdgeMaterial {
    EdgeMaterial {
        model: t.choice(&k::EDGE_MODEL, EdgeModel::Constant),
        k_normal: t.list(&k::K_NORMAL).unwrap_or_else(|| vec![DEFAULT_K[0]]),
        k_friction: t.list(&k::K_FRICTION).unwrap_or_else(|| vec![DEFAULT_K[1]]),
    }
}
