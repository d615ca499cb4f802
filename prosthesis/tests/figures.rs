//! A figure of `job.toml` that is changed by somebody who also writes the file's digest anew is found by what the other files tell.

#![allow(clippy::unwrap_used, reason = "a test's helper fails by panicking")]

use std::path::Path;

use bonemill_case::prosthesis::ProsthesisJob;
use bonemill_planfile::{Replace, StagedDirectory};
use bonemill_prosthesis::{plan, save, sealed, verify};

/// A box of 12 × 3 × 9 mm as STL.
fn box_stl() -> String {
    let corner = |n: usize| [[0.0, 12.0][n & 1], [0.0, 3.0][n >> 1 & 1], [0.0, 9.0][n >> 2]];
    let sides = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let facet = |corners: [usize; 3]| {
        let vertices = corners.map(corner).map(|[x, y, z]| format!("vertex {x} {y} {z}\n")).concat();
        format!("facet normal 0 0 0\nouter loop\n{vertices}endloop\nendfacet\n")
    };
    let facets = sides.map(|[a, b, c, d]| facet([a, b, c]) + &facet([a, c, d])).concat();
    format!("solid box\n{facets}endsolid box\n")
}

const JOB: &str = "[part]\nstl = \"part.stl\"\nunit = \"mm\"\n[orient]\nmode = \"none\"\n\
    [stock]\nblocks = [{ id = \"B7\", size_mm = [24, 8, 40], count = 2 }]\n[stock.gap_mm]\nz = 6\n\
    [process]\nfinishing_step_mm = 0.3\n[machine]\nmax_time_min = 100\n";

fn faults(dir: &Path) -> Vec<String> {
    match verify::verify(dir, &()) {
        Ok(verdict) => verdict.checks.into_iter().flat_map(|check| check.faults).collect(),
        Err(error) => vec![error.to_string()],
    }
}

#[test]
fn a_changed_figure_is_found_though_the_digest_is_written_anew() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("part.stl"), box_stl()).unwrap();
    let job_path = folder.path().join("job.toml");
    std::fs::write(&job_path, JOB).unwrap();
    let job = ProsthesisJob::parse(JOB, &job_path).unwrap();
    let planned = plan(&job, &job_path, None, &()).unwrap();
    let out = folder.path().join("out");
    let staged = StagedDirectory::create(&out, Replace::Prosthesis).unwrap();
    save(&planned, &job_path, &staged).unwrap();
    staged.commit().unwrap();
    assert_eq!(faults(&out), Vec::<String>::new());
    let file = out.join("job.toml");
    let text = std::fs::read_to_string(&file).unwrap();
    assert_eq!(sealed(&text), text);
    // what is asked for stands in the program's head, what was found follows from the files
    let asked = "was made for another job, block or tool path";
    for (from, to, expected) in [
        ("side_load = 0.6", "side_load = 0.66", asked),
        ("finishing_step_mm = 0.3", "finishing_step_mm = 0.33", asked),
        ("clearance_mm = 3.0", "clearance_mm = 2.7", asked),
        ("max_time_min = 100.0", "max_time_min = 110.0", asked),
        ("count = 2", "count = 3", asked),
        ("id = \"B7\"\nlow_mm", "id = \"B8\"\nlow_mm", asked),
        ("version = \"", "version = \"9", "bonemill 9"),
        ("grip_mm = 10.0\ntab", "grip_mm = 9.0\ntab", "`block.grip_mm` is 9"),
        ("thickest_uncut_mm = 0.", "thickest_uncut_mm = 1.", "`thickest_uncut_mm` is 1."),
    ] {
        let changed = text.replacen(from, to, 1);
        assert_ne!(changed, text, "{from}");
        std::fs::write(&file, sealed(&changed)).unwrap();
        let found = faults(&out);
        assert!(found.iter().any(|fault| fault.contains(expected)), "{to}: {found:?}");
        assert!(found.iter().all(|fault| !fault.contains("digest in the last line")), "{to}: {found:?}");
    }
}
