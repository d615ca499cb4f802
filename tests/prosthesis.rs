//! `bonemill prosthesis`, `stock` and `verify` of the folder: from a job and a catalogue to files; and what is refused.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use bonemill_geometry::Point;
use bonemill_planner::part::phantom::Operculum;
use bonemill_planner::plan::columns::prosthesis::DESCRIBED;
use bonemill_prosthesis::phantom;
use bonemill_prosthesis::show::{ShownProsthesis, turn};
use nalgebra::Vector3;

fn bonemill(folder: &Path, arguments: &str) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_bonemill"));
    command.current_dir(folder).args(arguments.split(' ')).output().unwrap()
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr)
}

/// A folder with a small part, coarse steps so that it is quick, and a catalogue with one block.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let mut shape = Operculum::drawn(3);
    for length_mm in shape.outer_length_mm.iter_mut().chain(&mut shape.inner_length_mm) {
        *length_mm *= 0.5;
    }
    shape.thickness_mm = 4.0;
    let job = phantom::write(folder.path(), &shape, 1200).unwrap();
    let text = fs::read_to_string(&job).unwrap();
    let more = "[stock]\ncatalogue = \"stock.toml\"\n[tool]\ndiameter_mm = 4\nkind = \"ball\"\n[process]\nfinishing_step_mm = 0.3\n";
    fs::write(&job, text + more).unwrap();
    let added = bonemill(folder.path(), "stock add B1 --size-mm 40 15 50 --count 1");
    assert!(added.status.success(), "{}", said(&added));
    folder
}

/// The program with every hundredth cut 2 mm deeper.
fn deeper(program: &str) -> String {
    let word = |word: &str| match word.strip_prefix('Z').and_then(|z| z.parse::<f64>().ok()) {
        Some(z) => format!("Z{:.3}", z - 2.0),
        None => word.to_owned(),
    };
    let line = |(n, line): (usize, &str)| match n % 100 {
        0 if line.starts_with("G1") => line.split(' ').map(word).collect::<Vec<_>>().join(" ") + "\n",
        _ => format!("{line}\n"),
    };
    program.lines().enumerate().map(line).collect()
}

#[test]
fn a_job_becomes_a_folder_that_verifies_and_takes_its_block() {
    let folder = folder();
    let made = bonemill(folder.path(), "prosthesis job.toml --out out --json");
    let object: serde_json::Value =
        serde_json::from_slice(&made.stdout).unwrap_or_else(|_| panic!("{}", said(&made)));
    assert_eq!(object["block"], "B1", "{object}");
    let out = folder.path().join("out");
    for name in ["job.toml", "part.stl", "toolpath.csv", "program.nc", "report.html"] {
        assert!(out.join(name).exists(), "{name}");
    }
    let header = "index,side,kind,x_mm,y_mm,z_mm,a_rad,feed_mm_min,time_s\n";
    assert!(fs::read_to_string(out.join("toolpath.csv")).unwrap().starts_with(header));
    assert!(object["figures"]["deepest_gouge_mm"].as_f64().unwrap() <= 0.02, "{object}");
    assert!(said(&bonemill(folder.path(), "stock list")).contains("B1: 40 × 15 × 50 mm, 0 left"));
    // the verdict agrees with the plan's own, and fails once the program is another
    let verified = bonemill(folder.path(), "verify out --all");
    assert_eq!(verified.status.code(), made.status.code(), "{}", said(&verified));
    let program = fs::read_to_string(out.join("program.nc")).unwrap();
    fs::write(out.join("program.nc"), deeper(&program)).unwrap();
    assert_eq!(bonemill(folder.path(), "verify out").status.code(), Some(1));
    // so it does once a word of the table or a figure of the record is another
    fs::write(out.join("program.nc"), &program).unwrap();
    for (name, from, to) in [
        ("toolpath.csv", ",rough,", ",rougi,"),
        ("toolpath.csv", ",rough,", ",finish,"),
        ("job.toml", "collisions = 0", "collisions = 1"),
    ] {
        let text = fs::read_to_string(out.join(name)).unwrap();
        fs::write(out.join(name), text.replacen(from, to, 1)).unwrap();
        let verified = bonemill(folder.path(), "verify out");
        assert_eq!(verified.status.code(), Some(1), "{name}");
        assert!(said(&verified).contains(name), "{}", said(&verified));
        fs::write(out.join(name), text).unwrap();
    }
    // and once the program's speeds are others
    for (from, to) in [(" F", " F9"), ("\nS", "\nS1")] {
        assert!(program.contains(from), "{from}");
        fs::write(out.join("program.nc"), program.replacen(from, to, 1)).unwrap();
        let verified = bonemill(folder.path(), "verify out");
        assert!(said(&verified).contains(" instead of "), "{}", said(&verified));
    }
    fs::write(out.join("program.nc"), &program).unwrap();
    // a viewer draws what stands there
    let shown = ShownProsthesis::read(&out, &()).unwrap();
    assert_eq!(shown.colours.len(), shown.part.vertices.len());
    assert_eq!(shown.moves.len() as f64, object["figures"]["moves"].as_f64().unwrap());
    assert!(shown.moves.windows(2).all(|pair| pair[0].time_s <= pair[1].time_s));
    assert!(
        shown.moves.iter().all(|m| (turn(m) * Vector3::z()).y == if m.a_rad == 0.0 { 1.0 } else { -1.0 })
    );
    // seen from the cutter the stock lies below a tip that repositions: out of the block, along its axis
    let (first, block) = (&shown.moves[0], &shown.record.block);
    assert!(first.tip_mm.dot(&(turn(first) * Vector3::z())) > block.high_mm.y);
    assert_eq!(shown.cutter.max_radius_mm(), shown.record.job.tool.diameter_mm / 2.0);
    // every figure is described, every key is told with where it comes from, and what a plan's commands say here is of use
    let described = DESCRIBED.iter().find(|d| d.title == "job.toml [result.metrics]").unwrap().columns;
    for (name, _) in object["figures"].as_object().unwrap() {
        assert!(described.iter().any(|c| c.name == name), "{name} is not described");
    }
    let report = fs::read_to_string(out.join("report.html")).unwrap();
    let (_, choices) = report.split_once("<h2>Choices</h2>").unwrap();
    for (key, origin) in [
        ("tool.kind", "the file"),
        ("process.spindle_rpm", "default; C Table 4"),
        ("stock.gap_mm.x", "default"),
    ] {
        let key = key.replace('.', ".<wbr>").replace('_', "_<wbr>");
        let (_, row) = choices.split_once(&format!("<code>{key}</code>")).unwrap_or_else(|| panic!("{key}"));
        assert!(row.split_once("</tr>").unwrap().0.contains(origin), "{key}");
    }
    for arguments in ["simulate out", "compare out out", "verify out --samples 10"] {
        let refused = bonemill(folder.path(), arguments);
        assert_eq!(refused.status.code(), Some(2), "{arguments}");
        assert!(said(&refused).contains("out holds a prosthesis"), "{arguments}: {}", said(&refused));
    }
    // no block is left, and nothing is written
    let again = bonemill(folder.path(), "prosthesis job.toml --out other");
    assert_eq!(again.status.code(), Some(2));
    assert!(said(&again).contains("no block in stock holds"), "{}", said(&again));
    assert!(!folder.path().join("other").exists());
}

/// A folder with a box of 12 × 4 × 10 mm as an STL file and a job that mills it quickly, with one block in a catalogue.
fn box_folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let corner =
        |n: usize| [(n & 1) * 12, (n >> 1 & 1) * 4, (n >> 2) * 10].map(|mm| mm.to_string()).join(" ");
    let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let facet = |[a, b, c]: [usize; 3]| {
        let corners = [a, b, c].map(|n| format!("vertex {}\n", corner(n))).concat();
        format!("facet normal 0 0 0\nouter loop\n{corners}endloop\nendfacet\n")
    };
    let facets: String =
        faces.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).map(facet).collect();
    fs::write(folder.path().join("box.stl"), format!("solid box\n{facets}endsolid box\n")).unwrap();
    let job = "[part]\nstl = \"box.stl\"\nunit = \"mm\"\n[orient]\nmode = \"none\"\n[stock]\ncatalogue = \"stock.toml\"\n\
        [tool]\ndiameter_mm = 3\n[process]\nfinishing_step_mm = 0.3\n[machine]\nmax_time_min = 60\n";
    fs::write(folder.path().join("job.toml"), job).unwrap();
    let added = bonemill(folder.path(), "stock add B1 --size-mm 24 10 42 --count 1");
    assert!(added.status.success(), "{}", said(&added));
    folder
}

#[test]
fn no_figure_and_no_word_can_be_another() {
    let folder = box_folder();
    let made = bonemill(folder.path(), "prosthesis job.toml --out out");
    assert_eq!(made.status.code(), Some(0), "{}", said(&made));
    let verified = bonemill(folder.path(), "verify out --all");
    assert_eq!(verified.status.code(), Some(0), "{}", said(&verified));
    let out = folder.path().join("out");
    let refused = |name: &str, text: &str, expected: &str| {
        let before = fs::read(out.join(name)).unwrap();
        assert!(before != text.as_bytes(), "{name}: {expected}");
        fs::write(out.join(name), text).unwrap();
        let verified = bonemill(folder.path(), "verify out");
        assert!([Some(1), Some(2)].contains(&verified.status.code()), "{expected}: {}", said(&verified));
        assert!(said(&verified).contains(expected), "{expected}: {}", said(&verified));
        // no verdict of before stands there
        let verdict = fs::read_to_string(out.join("verification.toml")).unwrap_or_default();
        assert!(!verdict.contains("passed = true"), "{expected}: {verdict}");
        fs::write(out.join(name), before).unwrap();
    };
    let job = fs::read_to_string(out.join("job.toml")).unwrap();
    let figure = |name: &str, value: &str| {
        let line = |line: &str| match line.starts_with(&format!("{name} = ")) {
            true => format!("{name} = {value}\n"),
            false => format!("{line}\n"),
        };
        job.lines().map(line).collect::<String>()
    };
    for (name, value, expected) in [
        ("total_time_s", "60.0", "`total_time_s` is 60.0, but"),
        ("tab_strength_over_force", "900.0", "`tab_strength_over_force` is 900.0, but"),
        ("volume_mm3", "1.0", "`volume_mm3` is 1.0, but 480.0 is found"),
        ("uncut_mm3", "0.0", "`uncut_mm3` is 0.0, but"),
        ("tab_boxes_mm", "[[-90.0, -90.0, -90.0, 90.0, 90.0, 90.0]]", "`block.tab_boxes_mm[0]` is"),
        ("side_load", "0.7", "the digest in the last line is another"),
    ] {
        refused("job.toml", &figure(name, value), expected);
    }
    let program = fs::read_to_string(out.join("program.nc")).unwrap();
    let plunges = "G0 Z40\nG0 X0 Y8\nG1 Z-6 F300\nG0 Z40\nM5\nM30\n";
    for (text, expected) in [
        (program.replace("G4 P3\n", "G4 P999999\n"), "\"G4 P999999\" instead of \"G4 P3\""),
        (program.replacen("(side B)", "T2 M6", 1), "T2 would change the cutter"),
        (program.replacen("G53 G0 Z0.000", "G0 Z-30", 1), "a motion before X, Y, Z and A have a place"),
        (program.replace("M5\n", ""), "the program ends with the spindle on"),
        (
            program.replace("G53 G0 Z0.000\nM5\nG0 X0.000 Y0.000\nG0 A0.000\nM30\n", plunges),
            "nothing else: program.nc line",
        ),
        (program.replacen(" F", " F9", 1), " instead of "),
    ] {
        refused("program.nc", &text, expected);
    }
}

#[test]
fn a_block_belongs_to_one_folder_and_comes_back_from_a_plan_that_was_stopped() {
    let folder = box_folder();
    let left = |expected: &str| {
        let listed = said(&bonemill(folder.path(), "stock list"));
        assert!(listed.contains(expected), "{listed}");
    };
    // replanned into the same folder, the plan has its own block again
    for _ in 0..2 {
        let made = bonemill(folder.path(), "prosthesis job.toml --out out");
        assert_eq!(made.status.code(), Some(0), "{}", said(&made));
        left("B1: 24 × 10 × 42 mm, 0 left");
    }
    bonemill(folder.path(), "stock return B1");
    #[cfg(unix)]
    for (signal, code) in [("INT", Some(130)), ("TERM", Some(130)), ("HUP", Some(130)), ("KILL", None)] {
        let mut command = Command::new(env!("CARGO_BIN_EXE_bonemill"));
        let arguments = ["prosthesis", "job.toml", "--out", "other"];
        let stderr = std::process::Stdio::piped();
        let mut running = command.current_dir(folder.path()).args(arguments).stderr(stderr).spawn().unwrap();
        let mut told = std::io::BufReader::new(running.stderr.take().unwrap());
        let mut line = String::new();
        while !line.contains("plan toolpath") {
            line.clear();
            assert!(std::io::BufRead::read_line(&mut told, &mut line).unwrap() > 0, "{signal}: it ended");
        }
        left("0 left");
        let id = running.id().to_string();
        assert!(Command::new("kill").args([&format!("-{signal}"), &id]).status().unwrap().success());
        std::io::copy(&mut told, &mut std::io::sink()).unwrap();
        assert_eq!(running.wait().unwrap().code(), code, "{signal}");
        assert!(!folder.path().join("other").exists());
        // what a killed program held is put back by the next change
        let taken = bonemill(folder.path(), "stock take B1");
        assert_eq!(taken.status.code(), Some(0), "{signal}: {}", said(&taken));
        bonemill(folder.path(), "stock return B1");
        left("1 left");
    }
}

#[test]
fn a_part_is_moved_in_a_thick_block_where_the_cutter_reaches_more_from_there() {
    let folder = tempfile::tempdir().unwrap();
    // much higher outside than inside: from the middle of the block the outside's rim lies deeper than the inside's crest
    let shape = Operculum {
        outer_radius_mm: [12.0; 2],
        inner_radius_mm: [100.0; 2],
        outer_length_mm: [16.0; 2],
        inner_length_mm: [17.0; 2],
        thickness_mm: 4.0,
        ..Operculum::drawn(3)
    };
    let job = phantom::write(folder.path(), &shape, 1200).unwrap();
    let text = fs::read_to_string(&job).unwrap();
    let offset_mm = |length_mm: f64, code: i32| -> f64 {
        let more = format!(
            "[stock]\nblocks = [{{ id = \"T\", size_mm = [40, 30, 50], count = 1 }}]\n[tool]\ndiameter_mm = 4\nkind = \"flat\"\nlength_mm = {length_mm}\n\
             [process]\nfinishing_step_mm = 0.3\n"
        );
        fs::write(&job, format!("{text}{more}")).unwrap();
        let made = bonemill(folder.path(), "prosthesis job.toml --out out");
        assert_eq!(made.status.code(), Some(code), "{length_mm} mm: {}", said(&made));
        assert_eq!(bonemill(folder.path(), "verify out").status.code(), Some(code), "{length_mm} mm");
        let shown = ShownProsthesis::read(&folder.path().join("out"), &()).unwrap();
        let y =
            |least: f64, of: fn(f64, f64) -> f64| shown.part.vertices.iter().map(Point::y).fold(least, of);
        0.5 * (y(f64::INFINITY, f64::min) + y(f64::NEG_INFINITY, f64::max))
    };
    // a long cutter reaches from the middle, a shorter one from elsewhere, one that is too short from nowhere
    assert!(offset_mm(20.0, 0).abs() < 1e-3);
    let moved_mm = offset_mm(15.6, 0).abs();
    assert!((1.0..2.5).contains(&moved_mm), "moved by {moved_mm} mm");
    offset_mm(12.0, 1);
}

#[test]
fn a_rotary_axis_that_does_not_reach_a_side_is_told() {
    let folder = folder();
    let job = folder.path().join("job.toml");
    let text = fs::read_to_string(&job).unwrap();
    fs::write(&job, format!("{text}[machine]\nrotary_range_deg = [-90, 90]\n")).unwrap();
    let made = bonemill(folder.path(), "prosthesis job.toml --out out");
    assert_eq!(made.status.code(), Some(1), "{}", said(&made));
    assert!(said(&made).contains("A turns to 180°, the machine reaches -90° to 90°"), "{}", said(&made));
    let verified = bonemill(folder.path(), "verify out");
    assert_eq!(verified.status.code(), Some(1));
    assert!(said(&verified).contains("A180 where the machine reaches -90° to 90°"), "{}", said(&verified));
    fs::write(&job, format!("{text}[machine]\nrotary_range_deg = [90, -90]\n")).unwrap();
    let refused = bonemill(folder.path(), "prosthesis job.toml --out other");
    assert_eq!(refused.status.code(), Some(2));
    assert!(said(&refused).contains("the lowest angle comes first"), "{}", said(&refused));
}

#[test]
fn the_report_for_an_arm_tells_how_the_arm_is_mounted() {
    let folder = folder();
    let job = folder.path().join("job.toml");
    let text = fs::read_to_string(&job).unwrap();
    for (on_flange, told) in [("part", "The ur5e holds the block"), ("spindle", "The ur5e holds the spindle")]
    {
        fs::write(&job, format!("{text}[machine]\nkind = \"ur5e\"\non_flange = \"{on_flange}\"\n")).unwrap();
        let made = bonemill(folder.path(), "prosthesis job.toml --out out");
        let report = fs::read_to_string(folder.path().join("out/report.html"))
            .unwrap_or_else(|_| panic!("{}", said(&made)));
        let (_, steps) = report.split_once("What to do").unwrap();
        let (steps, _) = steps.split_once("</ol>").unwrap();
        assert!(
            steps.contains(told) && steps.contains("Run <code>trajectory.csv</code> by the arm"),
            "{steps}"
        );
        // how a machine is mounted holds for no arm
        assert!(!steps.contains("toward the spindle"), "{steps}");
        assert_eq!(bonemill(folder.path(), "verify out").status.code(), made.status.code());
        let trajectory = folder.path().join("out/trajectory.csv");
        let text = fs::read_to_string(&trajectory).unwrap();
        fs::write(&trajectory, text.replacen("0.1", "0.2", 1)).unwrap();
        let verified = bonemill(folder.path(), "verify out");
        assert_eq!(verified.status.code(), Some(1));
        assert!(said(&verified).contains("trajectory.csv"), "{}", said(&verified));
        bonemill(folder.path(), "stock return B1");
    }
}

#[test]
fn what_cannot_be_made_is_refused_and_the_block_goes_back() {
    let folder = folder();
    let refused = |arguments: &str, expected: &str| {
        let output = bonemill(folder.path(), arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments}: {}", said(&output));
        assert!(said(&output).contains(expected), "{arguments}: {}", said(&output));
    };
    refused("prosthesis none.toml --out out", "cannot read the job none.toml");
    let job = fs::read_to_string(folder.path().join("job.toml")).unwrap();
    fs::write(folder.path().join("wrong.toml"), job.replace("diameter_mm", "diameter")).unwrap();
    refused("prosthesis wrong.toml --out out", "wrong.toml:8: unknown key `tool.diameter`");
    fs::write(folder.path().join("metres.toml"), job.replace("unit = \"mm\"", "unit = \"m\"")).unwrap();
    refused("prosthesis metres.toml --out out", "plausible: \"mm\"");
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink("/dev/zero", folder.path().join("zero.stl")).unwrap();
        fs::write(folder.path().join("device.toml"), job.replace("implant.stl", "zero.stl")).unwrap();
        refused("prosthesis device.toml --out out", "it is no regular file");
    }
    // a cutter that does not fit between the part and the block's grip
    fs::write(folder.path().join("thick.toml"), job.replace("diameter_mm = 4", "diameter_mm = 20")).unwrap();
    refused("prosthesis thick.toml --out out", "cannot be milled from block B1");
    assert!(said(&bonemill(folder.path(), "stock list")).contains("1 left"));
    // a plan that falls short is written, but its block goes back too
    fs::write(folder.path().join("short.toml"), format!("{job}[machine]\nmax_time_min = 0.1\n")).unwrap();
    let short = bonemill(folder.path(), "prosthesis short.toml --out short");
    assert_eq!(short.status.code(), Some(1), "{}", said(&short));
    assert_eq!(bonemill(folder.path(), "verify short").status.code(), Some(1));
    assert!(said(&bonemill(folder.path(), "stock list")).contains("1 left"));
    fs::write(folder.path().join("implant.stl"), "solid x\nendsolid x\n").unwrap();
    refused("prosthesis job.toml --out out", "the mesh has no facets");
    fs::create_dir(folder.path().join("mine")).unwrap();
    fs::write(folder.path().join("mine/notes.txt"), "mine").unwrap();
    refused("prosthesis job.toml --out mine", "is not the folder of a prosthesis");
    assert!(!folder.path().join("out").exists());
}
