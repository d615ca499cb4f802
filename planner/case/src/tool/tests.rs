//! Tools as people write and mistype them.

use std::path::Path;

use crate::{Case, EdgeModel, ToolSpec};

const LEAST: &str = "structure = []\n[images]\nct = \"c\"\nlabels = \"l\"\n[target]\nlabel = 1\n";

fn parse(more: &str) -> Result<Case, String> {
    Case::parse(&format!("{LEAST}{more}"), Path::new("case.toml")).map_err(|e| e.to_string())
}

#[test]
fn a_burr_needs_no_tool_table() {
    for text in ["", "[burr]\nradius_mm = 2\n", "[tool]\nkind = \"burr\"\n", "[tool]\n"] {
        assert_eq!(parse(text).unwrap().tool, ToolSpec::Burr, "{text}");
    }
}

#[test]
fn every_kind_is_read_and_reads_back() {
    let mesh = "[tool]\nkind = \"mesh\"\n[mesh]\nstl = \"a.stl\"\nscale_mm = 1\naxis = [0, 3, 4]\ndihedral_deg = 50\n";
    for text in [
        "[tool]\nkind = \"drill\"\n",
        "[tool]\nkind = \"drill\"\n[drill]\nradius_mm = 2\nlips = 3\nspindle_rpm = 500\nspin = 1\n",
        "[tool]\nkind = \"reamer\"\n",
        mesh,
        &format!("{mesh}edges = \"edges.csv\"\n"),
        "[tool]\nkind = \"drill\"\n[material]\nedge_model = \"rake\"\nk_normal = [10, 100]\nk_friction = [1, 2]\n",
    ] {
        let case = parse(text).unwrap();
        let again = Case::parse(&case.to_toml(), Path::new("again.toml")).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!((&again.tool, &again.edge_material), (&case.tool, &case.edge_material), "{text}");
    }
    let ToolSpec::Drill(spec, spindle) = parse("[tool]\nkind = \"drill\"\n").unwrap().tool else { panic!() };
    assert_eq!((spec.radius_mm, spec.lips, spindle.rpm, spindle.spin), (1.25, 2, 1000.0, -1));
    let ToolSpec::Mesh(tool, _) = parse(mesh).unwrap().tool else { panic!() };
    assert_eq!(tool.axis, nalgebra::Vector3::new(0.0, 0.6, 0.8));
    assert_eq!(parse("").unwrap().edge_material.model, EdgeModel::Constant);
}

/// A documented default may as well stand in the file.
#[test]
fn the_documented_default_is_the_one_used() {
    let mut checked = 0;
    for entry in crate::keys::tool::entries() {
        let Some((table, name)) = entry.path.split_once('.') else { continue };
        if !["drill", "reamer"].contains(&table) {
            continue;
        }
        let head = format!("[tool]\nkind = \"{table}\"\n");
        let spelled = parse(&format!("{head}[{table}]\n{name} = {}\n", entry.default)).unwrap();
        assert_eq!(spelled.tool, parse(&head).unwrap().tool, "{}", entry.path);
        checked += 1;
    }
    assert!(checked > 15);
}

#[test]
fn tools_that_are_none_are_refused() {
    for (text, words) in [
        (
            "[tool]\nkind = \"saw\"\n",
            &["`tool.kind` = \"saw\"", "`burr` or `drill` or `reamer` or `mesh`"][..],
        ),
        ("[drill]\nradius_mm = 1\n", &["case.toml:7: ", "`drill` cannot hold", "tool.kind"]),
        ("[tool]\nkind = \"drill\"\n[drill]\nweb_mm = 1.2\n", &["case.toml:9: ", "`drill`", "leaves no lip"]),
        (
            "[tool]\nkind = \"drill\"\n[drill]\npoint_deg = 118\n",
            &["`drill.point_deg` = 118: expected 15 to 90"],
        ),
        ("[tool]\nkind = \"drill\"\n[drill]\nradius = 1\n", &["expected `drill.radius_mm`, in mm"]),
        ("[tool]\nkind = \"reamer\"\n[reamer]\nrim_radius_mm = 40\n", &["`reamer`", "not on the arc"]),
        (
            "[tool]\nkind = \"mesh\"\n",
            &["`mesh.stl` is missing", "`mesh.scale_mm` is missing", "`mesh.axis` is missing"],
        ),
        (
            "[tool]\nkind = \"mesh\"\n[mesh]\nstl = \"a.stl\"\nscale_mm = 1\naxis = [0, 0, 0]\n",
            &["`mesh.axis` is the zero vector"],
        ),
        (
            "[material]\nedge_model = \"rake\"\n",
            &["`material.k_normal` has 1 entries; expected 2, as material.edge_model = \"rake\" has"],
        ),
        (
            "[tool]\nkind = \"drill\"\n[shank]\nsegments = [[20, 3]]\n",
            &["expected at most 1.25 mm, the tool's radius"],
        ),
    ] {
        let message = parse(text).map(|c| c.to_toml()).unwrap_err();
        assert!(words.iter().all(|w| message.contains(w)), "{message}");
    }
}
