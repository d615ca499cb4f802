//! The job file of a prosthesis: defaults, writing and reading back, refusal of wrong keys and values, and its reference page.

use std::path::Path;

use super::*;

const LEAST: &str = "[part]\nstl = \"implant.stl\"\n";

fn parse(text: &str) -> Result<ProsthesisJob, crate::CaseError> {
    ProsthesisJob::parse(text, Path::new("job.toml"))
}

fn refusal(text: &str) -> String {
    parse(text).unwrap_err().to_string()
}

#[test]
fn a_part_is_all_that_must_be_given() {
    let job = parse(LEAST).unwrap();
    assert_eq!(job.part.file, Path::new("implant.stl"));
    assert_eq!((job.process.spindle_rpm, job.process.feed_per_tooth_mm), (8500.0, 0.0381));
    assert_eq!((job.tool.diameter_mm, job.tool.corner_radius_mm, job.tool.flutes), (3.175, 0.0, 1));
    assert!((job.process.strip_mm - 0.6 * 0.7 * 3.175).abs() < 1e-12);
    assert_eq!(job.stock.gap_mm, [5.0, 2.0, 8.0]);
    assert!(matches!(&job.stock.source, BlockSource::Blocks(blocks) if blocks.len() == 3));
}

#[test]
fn a_resolved_job_reads_back_equal() {
    let full = "[part]\nstl = \"a/b.ply\"\nunit = \"inch\"\n[orient]\nmode = \"least_time\"\n\
        [stock]\nblocks = [{ id = \"B1\", size_mm = [60, 25, 55], count = 4 }]\ngap_mm = { x = 6, y = 1.5, z = 9 }\ngrip_mm = 12\n\
        [tool]\nkind = \"bull\"\ndiameter_mm = 4\ncorner_radius_mm = 0.5\nholder = [[10, 5], [20, 12]]\n\
        [process]\nstrip_mm = 1.1\nsense = \"conventional\"\n[machine]\nkind = \"ur5e\"\ndialect = \"haas\"\non_flange = \"part\"\nrotary_deg_s = 33.3\nmax_time_min = 45\n";
    let with_catalogue =
        "[part]\nstl = \"a.stl\"\n[stock]\ncatalogue = \"stock.toml\"\n[tool]\nkind = \"ball\"\n";
    for text in [LEAST, full, with_catalogue] {
        let job = parse(text).unwrap();
        let again = parse(&job.to_toml()).unwrap();
        assert_eq!(again, job, "{}", job.to_toml());
        assert_eq!(again.to_toml(), job.to_toml());
    }
}

#[test]
fn every_fault_is_told_with_its_line() {
    let said = refusal(
        "[part]\nstl = \"\"\nunit = \"feet\"\n[stock]\nblocks = [{ id = \"B1\", size_mm = [60, 25] }, { id = \"B1\", size_mm = [1, 2, 3], number = 2 }]\n\
         gap_mm = { x = -1, w = 2 }\n[tool]\ndiameter_m = 0.003\ncorner_radius_mm = 1\n[process]\nspindle_rpm = 0.5\n[machine]\nkind = \"ur5\"\ntravel_mm = 100\n[robot]\n",
    );
    for expected in [
        "job.toml:2: `part.stl`",
        "job.toml:3: `part.unit` = \"feet\": expected `auto` or `mm`",
        "`stock.blocks[0].size_mm` has 2 entries; expected 3",
        "`stock.blocks[1].id` = \"B1\" stands already",
        "unknown key `stock.blocks[1].number`",
        "job.toml:6: `stock.gap_mm.x` = -1",
        "unknown key `stock.gap_mm.w`",
        "job.toml:8: unknown key `tool.diameter_m`: the unit is part of the name; expected `tool.diameter_mm`",
        "job.toml:9: `tool.corner_radius_mm` cannot hold: only a cutter of kind \"bull\"",
        "job.toml:11: `process.spindle_rpm` = 0.5: expected 1 to 500000",
        "job.toml:13: `machine.kind` = \"ur5\": expected `five-axis`",
        "job.toml:14: `machine.travel_mm` is the number 100",
        "job.toml:15: unknown key `robot`",
    ] {
        assert!(said.contains(expected), "{expected}\nin\n{said}");
    }
    assert!(refusal("[orient]\n").contains("`part.stl` is missing"));
    let both = "[part]\nstl = \"a.stl\"\n[stock]\ncatalogue = \"s.toml\"\nblocks = []\n";
    assert!(refusal(both).contains("job.toml:4: `stock.catalogue` cannot hold: stock.blocks is given too"));
    let flange = "[part]\nstl = \"a.stl\"\n[machine]\non_flange = \"part\"\n";
    assert!(
        refusal(flange)
            .contains("job.toml:4: `machine.on_flange` cannot hold: a milling machine has no flange")
    );
    let corner = "[part]\nstl = \"a.stl\"\n[tool]\nkind = \"bull\"\ncorner_radius_mm = 2\n";
    assert!(refusal(corner).contains("`tool.corner_radius_mm` = 2 mm: expected at most 1.5875 mm"));
}

#[test]
fn the_documented_default_is_the_one_used() {
    let job = parse(LEAST).unwrap();
    for entry in keys::entries().iter().filter(|e| e.path.matches('.').count() == 1) {
        let is_value = entry.default.parse::<f64>().is_ok() || entry.default.starts_with(['[', '"']);
        if let (true, Some((table, name))) = (is_value, entry.path.split_once('.')) {
            let line = format!("{name} = {}\n", entry.default);
            let text =
                if table == "part" { format!("{LEAST}{line}") } else { format!("{LEAST}[{table}]\n{line}") };
            assert_eq!(parse(&text).unwrap(), job, "{}", entry.path);
        }
    }
}

#[test]
fn docs_prosthesis_md_is_this_reference() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/prosthesis.md");
    let found = std::fs::read_to_string(&file).unwrap_or_default();
    assert!(
        found == reference(),
        "docs/prosthesis.md is out of date: run `bonemill keys --prosthesis > docs/prosthesis.md`"
    );
}

#[test]
fn every_ur_is_a_machine() {
    let machines = super::keys::MACHINE.words();
    assert_eq!(machines[1..], bonemill_arm::ur::UrModel::ALL.map(bonemill_arm::ur::UrModel::name));
}
