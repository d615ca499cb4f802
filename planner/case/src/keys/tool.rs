//! Keys of the tools that are no burr, and of what their edges feel.

use super::*;
use crate::EdgeModel;
use crate::tool::ToolKind;

table! {
    numbers {
        DRILL_RADIUS = "drill.radius_mm" Mm 0.05..50.0, Value(1.25), "radius (not diameter) of the drill", "Faieghi et al. III-A: 2.5 mm drill";
        POINT = "drill.point_deg" Deg 15.0..90.0, Value(59.0), "ε: half of the angle that the lips enclose", "Faieghi et al. III-A";
        HELIX = "drill.helix_deg" Deg 0.0..60.0, Value(20.0), "θ: helix angle at the periphery", "Faieghi et al. III-A";
        CHISEL = "drill.chisel_deg" Deg 0.1..179.9, Value(116.0), "ψ: angle of the chisel edge", "Faieghi et al. III-A";
        WEB = "drill.web_mm" Mm 0.0..50.0, Value(0.15), "w: half the width of the chisel edge, the lips' distance from the axis", ASSUMED;
        LIPS = "drill.lips" One 1.0..12.0, Value(2.0), "lips", "twist drill";
        FLUTE = "drill.flute_mm" Mm 0.5..500.0, Value(30.0), "length of the fluted body above the lips; the shank follows", ASSUMED;
        DRILL_RPM = "drill.spindle_rpm" Rpm 1.0..100_000.0, Value(1000.0), "spindle speed", "assumed: between the 500 and 3000 rpm of Faieghi et al. III-A";
        DRILL_SPIN = "drill.spin" One -1.0..1.0, Value(-1.0), "-1: clockwise seen from the handpiece, 1: the other way", ASSUMED;
        ARC = "reamer.arc_radius_mm" Mm 0.5..100.0, Value(16.22), "R: radius of the arc of an edge", "Faieghi et al. III-B";
        OFFSET = "reamer.offset_mm" Mm 0.0..100.0, Value(6.43), "w: distance of the arc's centre from the axis; the edges start there", "Faieghi et al. III-B";
        RIM = "reamer.rim_radius_mm" Mm 0.5..200.0, Value(18.25), "R_o: radius of the rim, where the edges end", "Faieghi et al. III-B: 36.5 mm diameter";
        EDGE_ANGLE = "reamer.edge_deg" Deg 0.0..89.9, Value(9.46), "α: angle between edge and radius at the rim", "Faieghi et al. III-B";
        EDGE_COUNT = "reamer.edges" One 1.0..64.0, Value(5.0), "edges", "Faieghi et al. III-B";
        NIPPLE_RADIUS = "reamer.nipple_radius_mm" Mm 0.0..100.0, Value(3.0), "radius of the guide, which fills its pilot hole and does not cut", ASSUMED;
        NIPPLE_LENGTH = "reamer.nipple_length_mm" Mm 0.0..100.0, Value(6.0), "how far the guide stands out below the edges; 0: none", ASSUMED;
        REAMER_RPM = "reamer.spindle_rpm" Rpm 1.0..100_000.0, Value(100.0), "spindle speed", ASSUMED;
        REAMER_SPIN = "reamer.spin" One -1.0..1.0, Value(-1.0), "as drill.spin", ASSUMED;
        SCALE = "mesh.scale_mm" Mm 1e-6..1e6, Words(REQUIRED), "length of one unit of the file: 1 for mm, 1000 for m", "-";
        AXIS = "mesh.axis" One -1e6..1e6, Words(REQUIRED), "direction of the shaft in the file's axes, from the tip to the handpiece", "-";
        AXIS_POINT = "mesh.axis_point_mm" Mm -1e5..1e5, Words("[0, 0, 0]"), "a point of the axis, in the file's axes, after scaling", "-";
        DIHEDRAL = "mesh.dihedral_deg" Deg 5.0..179.0, Value(60.0), "facets that meet at a convex edge and turn by at least this make a cutting edge, unless mesh.edges gives them", ASSUMED;
        MESH_RPM = "mesh.spindle_rpm" Rpm 1.0..500_000.0, Value(1000.0), "spindle speed", ASSUMED;
        MESH_SPIN = "mesh.spin" One -1.0..1.0, Value(-1.0), "as drill.spin", ASSUMED;
        K_NORMAL = "material.k_normal" One -1e6..1e6, Words("[60]"), "coefficients of k_c, N/mm² at rho_ref_g_cm3, of edge_model", "assumed: foam of 0.8 g/cm³ (docs/force-model.md 10)";
        K_FRICTION = "material.k_friction" One -1e6..1e6, Words("[24]"), "coefficients of k_f k_c, N/mm² at rho_ref_g_cm3, of edge_model", "assumed: k_f = 0.4";
    }
    choices {
        KIND: ToolKind = "tool.kind" ["burr" => ToolKind::Burr, "drill" => ToolKind::Drill, "reamer" => ToolKind::Reamer, "mesh" => ToolKind::Mesh],
            "what cuts; its dimensions stand in the table of that name", "-";
        EDGE_MODEL: EdgeModel = "material.edge_model" ["constant" => EdgeModel::Constant, "rake" => EdgeModel::Rake, "chip" => EdgeModel::Chip, "power_law" => EdgeModel::PowerLaw, "reciprocal" => EdgeModel::Reciprocal],
            "how k_c and k_f k_c of a tool that is no burr follow an element's rake, chip area and speed: [c]; [c0, c1] linear in 1 − sin γ_n; [c0, c1, c2] exp(c0) A_u^c1 V^c2; [c0, c1, c2, c3] the same times (1 − sin γ_n)^c3; [c0, c1] linear in 1/V", "docs/force-model.md 9";
    }
    others {
        MESH_STL = "mesh.stl" "a path relative to the case file", REQUIRED, "the cutter's closed surface, STL", "-";
        MESH_EDGES = "mesh.edges" "a path relative to the case file", "found by mesh.dihedral_deg", "its cutting edges: CSV with the columns edge, x, y, z, points in the file's axes and unit", "-";
    }
}
