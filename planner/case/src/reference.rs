//! The case file's reference: every key with unit, range, default and source, as Markdown.

use super::keys::{self, Entry};

const INTRODUCTION: &str = "\
# The case file

One TOML file describes one patient, one tool and one robot; paths are relative to it. The images, the target and the
structures must be given; every other key has the default below. A key that is not listed is an error, and so are
numbers that are not finite or outside the range, which is meant to catch slips of unit. `D` is Dillon et al. 2016;
`assumed` marks what no source gives.

This page is generated from the table that the parser uses: `bonemill keys` prints it.

## What the target is

- `target.label` is every voxel of the label, as drawn; where it touches a structure the case is refused.
- A box, a ball or a frustum is the bone in it and the air that bone encloses, less every structure and what lies nearer to
  one than its `clearance_mm`. The same holds for what `target.also` adds; labels there count whatever their grey value.
- `target.less` is taken away from all of that, from `target.label` too:
  `less = [{ label = \"chorda\", margin_mm = 0.5 }, { ball = { center_mm = [1, 2, 3], radius_mm = 4 } }]`.
- Volumes of the target are counted on the planning grid, where each voxel stands for the same volume: such that all voxels
  of the label have their volume on the label map's own grid, and all in the shape its volume as a solid.

## What lies beyond the scan

The scan is the union of the CT's voxel boxes. Beyond it nothing is known, and HU count as air's: bone that goes on there is
not kept, and burr and shank may pass there, as they may in the air outside the patient.

- A part of the target beyond the scan is neither target nor removed, in `plan`, `verify` and `simulate` alike. It is
  `target_outside_mm3`: of a label its voxels there, of a box, a ball or a frustum all that the shape holds there, since which
  of that is bone cannot be known. Air that a shape holds inside the scan is no part of the target and counts nowhere.
- The share outside is outside / (inside + outside). Up to 0.5 % it is a warning; beyond that the plan falls short (exit code
  1); more than 5 % is refused as bad input (exit code 2). The sides on which the scan ends too early are named.
- `scan_edge_bone_mm2` is the area of the CT's outer voxel faces with HU at or above `density.bone_hu` whose middles lie
  within the burr's diameter of the target's voxels (and in the planning grid, which ends `burr.radius_mm` and
  `grid.margin_mm` beside the target): there bone probably goes on unseen. It is a warning.
- For `approach.direction` the voxels of the scan's edge are taken to go on beyond it: a way out does not lead through bone there.
";

/// The reference as Markdown.
pub fn reference() -> String {
    markdown(INTRODUCTION, &keys::case_entries())
}

/// An introduction, and the keys of every table of a file.
pub(super) fn markdown(introduction: &str, entries: &[Entry]) -> String {
    let mut out = String::from(introduction);
    for table in tables(entries) {
        let title = if table.is_empty() { "Above the tables".into() } else { format!("`{table}`") };
        out += &format!(
            "\n## {title}\n\n| key | expects | default | meaning | source of the default |\n|---|---|---|---|---|\n"
        );
        for e in entries.iter().filter(|e| table_of(e.path) == table) {
            let name = keys::name_of(e.path);
            let cells =
                [e.expects.as_str(), e.default.as_str(), e.meaning, e.source].map(|c| c.replace('|', "\\|"));
            out += &format!("| `{name}` | {} |\n", cells.join(" | "));
        }
    }
    out
}

fn table_of(path: &'static str) -> &'static str {
    path.rsplit_once('.').map_or("", |(table, _)| table)
}

/// The tables in the order of a case file.
fn tables(entries: &[Entry]) -> Vec<&'static str> {
    let order = [
        "",
        "images",
        "density",
        "target",
        "structure",
        "hold",
        "approach",
        "tool",
        "burr",
        "drill",
        "reamer",
        "mesh",
        "shank",
        "material",
        "path",
        "cost",
        "orientation",
        "speed",
        "robot",
        "obstacle",
        "registration",
        "grid",
        "accuracy",
        // of a prosthesis' job
        "part",
        "orient",
        "stock",
        "process",
        "machine",
    ];
    let mut tables: Vec<_> = entries.iter().map(|e| table_of(e.path)).collect();
    // a table inside a table comes after it, in the order of the keys
    let place = |table: &str| order.iter().position(|o| *o == table.split('.').next().unwrap_or(table));
    tables.sort_by_key(|table| (place(table), table.len(), *table));
    tables.dedup();
    tables
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Case;
    use std::path::Path;

    /// A case with every key that can stand together.
    const FULL: &str = "preset = \"none\"\n[images]\nct = \"c\"\nct_series = \"1.2.3\"\nlabels = \"l\"\n[target]\nlabel = 1\nalso = [{ label = 3 }]\nless = [{ label = 4 }]\n[[structure]]\nname = \"s\"\nlabel = 2\n[[obstacle]]\nname = \"o\"\nball = { center_mm = [0, 0, 0], radius_mm = 5 }\n[[hold]]\nstructure = \"s\"\ndistance_mm = 2\n\
        [approach]\ndirection = [0, 0, 1]\n[path]\nraster_deg = 10\n[speed]\ntotal_time_s = 100\nmode = \"force_limited\"\ndeflection_um = 20\npower_w = 5\n[robot]\ncalibration = \"arm.yaml\"\nbranch = \"elbow-up\"\nlink_clearance_mm = 12\n\
        joint_stiffness = [1, 1, 1, 1]\nvelocity_limits = [1, 1, 1, 1]\nacceleration_limits = [1, 1, 1, 1]\njerk_limits = [1, 1, 1, 1]\n\
        base_from_ct = { rotation = [[1, 0, 0], [0, 1, 0], [0, 0, 1]], translation_mm = [0, 0, 0] }\n\
        flange_from_burr = { translation_mm = [0, 0, 0], rpy_rad = [0, 0, 0] }\n[accuracy]\nforce = 0.02\nremoved = 0.01\ndistance_mm = 0.02\n";

    /// A channel with every key that can stand together.
    const CHANNEL: &str = "structure = []\n[images]\nct = \"c\"\nlabels = \"l\"\n[tool]\nkind = \"drill\"\n[path]\npattern = \"plunge\"\n\
        target_mm = [1, 2, 3]\ndirection = \"safest\"\npeck_mm = 3\n";

    #[test]
    fn every_key_that_is_written_is_documented_and_the_other_way_round() {
        let case = Case::parse(FULL, Path::new("full.toml")).unwrap();
        let channel = Case::parse(CHANNEL, Path::new("channel.toml")).unwrap();
        let mut keys = vec!["structure".to_owned(), "hold".to_owned(), "obstacle".to_owned()];
        for written in [case.to_toml(), channel.to_toml()] {
            let mut table = String::new();
            for line in written.lines().filter(|l| !l.is_empty()) {
                match line.strip_prefix('[') {
                    Some(name) => table = name.trim_matches(['[', ']']).to_owned() + ".",
                    None => keys.push(table.clone() + line.split(' ').next().unwrap()),
                }
            }
        }
        let documented: Vec<_> = keys::case_entries().iter().map(|e| e.path).collect();
        for key in &keys {
            assert!(documented.contains(&key.as_str()), "`{key}` is written but not documented");
        }
        // the other shapes of target and registration, and what is inside inline tables
        let inside = [
            "target.b",
            "target.f",
            "target.segment",
            "target.less.",
            "obstacle.b",
            "obstacle.c",
            "structure.segment",
            "structure.file",
            "robot.base_from_ct.",
            "robot.flange_from_burr.",
        ];
        // the other ways to say where a channel begins and ends and how fast it is, see parse_channel::tests
        let ways = ["path.entry_", "path.depth_mm", "path.contact_area_mm2", "path.feed_mm_s"];
        // and the tools that are no burr, see tool::tests
        let tools = [&["drill.", "reamer.", "mesh."][..], &ways[..]].concat();
        let inside = [&inside[..], &tools[..]].concat();
        for path in documented {
            let elsewhere = inside.iter().any(|p| path.starts_with(p));
            assert!(elsewhere || keys.iter().any(|k| k == path), "`{path}` is documented but not written");
        }
    }

    #[test]
    fn the_documented_default_is_the_one_used() {
        let least = "structure = []\n[images]\nct = \"c\"\nlabels = \"l\"\n[target]\nlabel = 1\n";
        let case = Case::parse(least, Path::new("least.toml")).unwrap();
        for e in keys::case_entries() {
            // a default that is a value, not a description, may as well stand in the file
            let is_value =
                e.default.parse::<f64>().is_ok() || e.default.starts_with('[') || e.default.starts_with('"');
            let is_apart = |t: &str| ["structure", "obstacle", "drill", "reamer", "mesh"].contains(&t);
            if let Some((table, name)) =
                e.path.split_once('.').filter(|(t, n)| is_value && !is_apart(t) && !n.contains('.'))
            {
                let line = format!("{name} = {}\n", e.default);
                let text = match table {
                    "images" | "target" => {
                        least.replace(&format!("[{table}]\n"), &format!("[{table}]\n{line}"))
                    }
                    // one list is no table without the other
                    "density" if name == "hu" => {
                        format!("{least}[density]\n{line}g_cm3 = {:?}\n", case.density.table.g_cm3())
                    }
                    "density" if name == "g_cm3" => {
                        format!("{least}[density]\n{line}hu = {:?}\n", case.density.table.hu())
                    }
                    _ => format!("{least}[{table}]\n{line}"),
                };
                let spelled = Case::parse(&text, Path::new(e.path)).unwrap_or_else(|err| panic!("{err}"));
                assert_eq!(spelled, case, "{}", e.path);
            }
        }
    }

    #[test]
    fn docs_case_md_is_this_reference() {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/case.md");
        let found = std::fs::read_to_string(&file).unwrap_or_default();
        assert!(found == reference(), "docs/case.md is out of date: run `bonemill keys > docs/case.md`");
    }
}
