//! Channels end to end: a tibia drilled and a glenoid reamed by the command, simulated and verified, and plans that are wrong.

use std::fs;
use std::path::Path;

use crate::support::place::Place;
use bonemill_planner::case::Case;
use bonemill_planner::channel::tool::ChannelTool;
use bonemill_planner::edge::{CoefficientModel, PlungeFitting, PlungeInstant, Regression};

/// A table of numbers by column.
struct Table {
    columns: Vec<String>,
    rows: Vec<Vec<f64>>,
}

impl Table {
    fn read(path: &Path) -> Self {
        let text = fs::read_to_string(path).unwrap();
        let mut lines = text.lines();
        let columns = lines.next().unwrap().split(',').map(str::to_owned).collect();
        let number = |cell: &str| cell.parse().unwrap_or(f64::NAN);
        Self { columns, rows: lines.map(|line| line.split(',').map(number).collect()).collect() }
    }

    fn column(&self, name: &str) -> Vec<f64> {
        let at = self.columns.iter().position(|c| c == name).unwrap_or_else(|| panic!("{name}"));
        self.rows.iter().map(|row| row[at]).collect()
    }
}

#[track_caller]
fn runs(place: &Place, args: &[&str]) -> String {
    let ran = place.run(args);
    assert_eq!(ran.code, 0, "{args:?}: {}{}", ran.out, ran.err);
    ran.out
}

/// A figure of `plan.toml`.
fn number_of(place: &Place, key: &str) -> f64 {
    let text = fs::read_to_string(place.path("plan/plan.toml")).unwrap();
    let line = text.lines().find_map(|l| l.strip_prefix(key)?.strip_prefix(" = "));
    line.unwrap_or_else(|| panic!("{key}")).parse().unwrap()
}

/// The mean of a column over the depths from `from` to `to`.
fn mean(depth: &[f64], value: &[f64], [from, to]: [f64; 2]) -> f64 {
    let found: Vec<f64> =
        depth.iter().zip(value).filter(|(d, _)| (from..to).contains(*d)).map(|(_, v)| *v).collect();
    found.iter().sum::<f64>() / found.len() as f64
}

#[test]
fn a_tibia_is_drilled_through_both_cortices_and_every_file_agrees() {
    let place = Place::empty();
    runs(&place, &["plan", "--phantom", "tibia", "--out", "plan", "--threads", "1"]);
    runs(&place, &["plan", "--phantom", "tibia", "--out", "other", "--threads", "2"]);
    for file in ["plan.toml", "waypoints.csv", "forces.csv", "trajectory.csv", "plunge.csv", "report.html"] {
        let [one, two] = ["plan", "other"].map(|dir| fs::read(place.path(dir).join(file)).unwrap());
        assert!(one == two, "{file} depends on the number of threads");
    }
    // thrust over depth: cortex, cancellous bone, cortex, and nothing once the point is through
    let plunge = Table::read(&place.path("plan/plunge.csv"));
    let (depth, thrust) = (plunge.column("depth_mm"), plunge.column("thrust_n"));
    let going_in = depth.windows(2).take_while(|w| w[1] >= w[0]).count();
    let (depth, thrust) = (&depth[..=going_in], &thrust[..=going_in]);
    let end = depth[going_in];
    let [near, inside, far] =
        [[1.2, 2.8], [0.4 * end, 0.6 * end], [end - 3.6, end - 2.2]].map(|range| mean(depth, thrust, range));
    assert!(near > 4.0 * inside && far > 4.0 * inside, "{near} {inside} {far} N");
    assert!(thrust[going_in] < 0.35 * far, "breakthrough: {} of {far} N", thrust[going_in]);
    let report = fs::read_to_string(place.path("plan/report.html")).unwrap();
    for words in ["Channel plan", "Thrust <span class=\"unit\">[N]", "Across the channel", "vessel"] {
        assert!(report.contains(words), "{words}");
    }
    // the replay feels the same, and the second opinion agrees
    let replayed: serde_json::Value =
        serde_json::from_str(&runs(&place, &["simulate", "plan", "--json"])).unwrap();
    let planned = number_of(&place, "removed_bone_mm3");
    let removed = replayed["figures"]["simulated_removed"]["bone"]["mm3"].as_f64().unwrap();
    assert!(
        (removed - planned).abs() < 2e-3 * planned,
        "{removed} mm³ in the replay, {planned} mm³ in the plan"
    );
    let simulated = Table::read(&place.path("plan/simulation.csv"));
    let peak = |values: &[f64]| values.iter().copied().fold(0.0, f64::max);
    let torque = [peak(&plunge.column("torque_nmm")), peak(&simulated.column("torque_nmm"))];
    assert!((torque[0] - torque[1]).abs() < 0.1 * torque[0], "{torque:?} N mm");
    let said = runs(&place, &["verify", "plan", "--all"]);
    for check in ["clearance of moves (vessel)", "probability of touching (vessel)", "volumes as written"] {
        assert!(said.contains(check), "{check} is missing in {said}");
    }
    // a machine turns the drill as the case says, not as a burr
    runs(&place, &["export", "plan", "--unverified", "--format", "gcode"]);
    let program = fs::read_to_string(place.path("plan.unverified.ngc")).unwrap();
    assert!(program.contains("\nS500 M3\n"), "{}", &program[..200]);
    // a plan whose channel was moved does not pass
    let path = place.path("plan/plan.toml");
    let text = fs::read_to_string(&path).unwrap();
    let line = text.lines().find(|l| l.starts_with("channel = ")).unwrap();
    let moved = line.replacen("depth_mm = ", "depth_mm = 1", 1);
    fs::write(&path, text.replacen(line, &moved, 1)).unwrap();
    let ran = place.run(&["verify", "plan"]);
    assert_eq!(ran.code, 1, "{}{}", ran.out, ran.err);
    assert!(
        ran.out.contains("channel of the case") && ran.out.contains("the deepest is the channel's end"),
        "{}",
        ran.out
    );
}

#[test]
fn a_glenoid_is_reamed_to_its_contact_area() {
    let place = Place::empty();
    runs(&place, &["plan", "--phantom", "glenoid", "--out", "plan"]);
    let plunge = Table::read(&place.path("plan/plunge.csv"));
    let most = plunge.column("contact_mm2").into_iter().fold(0.0, f64::max);
    assert!((600.0..630.0).contains(&most), "{most} mm²");
    assert!(plunge.column("torque_nmm").into_iter().fold(0.0, f64::max) > 10.0);
    runs(&place, &["simulate", "plan"]);
    runs(&place, &["verify", "plan"]);
}

#[test]
fn a_log_of_thrust_and_torque_gives_the_edges_coefficients_or_is_refused() {
    let place = Place::empty();
    runs(&place, &["phantom", "--kind", "tibia", "--out", "bone"]);
    let case = fs::read_to_string(place.path("bone/case.toml")).unwrap();
    let rake = [
        ("constant", "rake"),
        ("k_normal = [150]", "k_normal = [60, 90]"),
        ("k_friction = [60]", "k_friction = [20, 50]"),
    ];
    let case = rake.iter().fold(case, |text, (old, new)| text.replacen(old, new, 1));
    fs::write(place.path("bone/case.toml"), &case).unwrap();
    runs(&place, &["plan", "bone/case.toml", "--out", "plan"]);
    // the log of a drill with other coefficients
    let parsed = Case::parse(&case, Path::new("case.toml")).unwrap();
    let tool = ChannelTool::of_case(&parsed, Path::to_path_buf).unwrap();
    let fitting = PlungeFitting {
        cutter: tool.cutter.as_ref(),
        regression: Regression::Rake,
        with_feed_angle: true,
        with_chisel: true,
    };
    let truth = CoefficientModel::Rake([[70.0, 120.0], [25.0, 40.0]]);
    let log = |depths: [f64; 2]| {
        let mut text = "feed_mm_rev,spindle_rpm,depth_mm,thrust_n,torque_nmm\n".to_owned();
        for n in 0..80 {
            let (feed_mm_rev, spindle_rpm) = ([0.01, 0.02][n % 2], 500.0);
            let depth_mm = depths[0] + (depths[1] - depths[0]) * n as f64 / 79.0;
            let row = PlungeInstant { feed_mm_rev, spindle_rpm, depth_mm, thrust_n: 0.0, torque_nmm: 0.0 };
            let [thrust, torque] = fitting.predict(&truth, &row).unwrap();
            // 1 % of noise, the same in every run
            let noise = 1.0 + 0.01 * (n as f64 * 12.9898).sin();
            text +=
                &format!("{feed_mm_rev},{spindle_rpm},{depth_mm},{},{}\n", thrust * noise, torque * noise);
        }
        text
    };
    fs::write(place.path("log.csv"), log([0.02, 1.0])).unwrap();
    let said = runs(&place, &["simulate", "plan", "--calibrate", "log.csv", "--json"]);
    let found: serde_json::Value = serde_json::from_str(&said).unwrap();
    for (key, expected) in [("k_normal", [70.0, 120.0]), ("k_friction", [25.0, 40.0])] {
        for (n, expected) in expected.into_iter().enumerate() {
            let part = |what: &str| found["figures"]["coefficients"][key][what][n].as_f64().unwrap();
            let (value, half_width) = (part("value"), part("half_width"));
            assert!(
                (value - expected).abs() < 3.0 * half_width,
                "{key}[{n}]: {value} ± {half_width}, {expected}"
            );
            assert!(half_width < 0.1 * expected, "{key}[{n}]: ± {half_width}");
        }
    }
    let refused = |words: &[&str], args: &[&str]| {
        place.run(&[&["simulate", "plan", "--calibrate"], args].concat()).refused(words)
    };
    // all edges in bone all the time, one feed and speed: nothing tells the rake's part from the rest
    let deep: String = log([3.0, 4.0])
        .lines()
        .enumerate()
        .filter(|(n, _)| n % 2 < 1 || *n == 0)
        .map(|(_, l)| format!("{l}\n"))
        .collect();
    fs::write(place.path("deep.csv"), deep).unwrap();
    refused(&["deep.csv", "cannot tell the 4 coefficients apart"], &["deep.csv"]);
    fs::write(place.path("still.csv"), log([0.02, 1.0]).replacen("0.01,500", "0.01,0", 1)).unwrap();
    refused(&["still.csv:2", "spindle speed above 0"], &["still.csv"]);
    fs::write(place.path("air.csv"), log([-3.0, -1.0])).unwrap();
    refused(&["air.csv", "0 rows in which the cutter is in bone"], &["air.csv"]);
    fs::write(place.path("bad.csv"), "t,x\n").unwrap();
    refused(&["bad.csv:1:", "depth_mm"], &["bad.csv"]);
    refused(&["--coefficients", "material.edge_model"], &["log.csv", "--coefficients", "k_t"]);
}

#[test]
fn what_cannot_be_drilled_is_said_with_its_key() {
    let place = Place::empty();
    runs(&place, &["phantom", "--kind", "tibia", "--out", "bone"]);
    let case = fs::read_to_string(place.path("bone/case.toml")).unwrap();
    let target = case.lines().find(|l| l.starts_with("target_mm")).unwrap();
    let entry = case.lines().find(|l| l.starts_with("entry_mm")).unwrap();
    let both = format!("{entry}\n{target}");
    for (old, new, code, words) in [
        (target, "target_mm = [0, 0, -18.5]", 1, "the channel runs through vessel"),
        (target, "target_mm = [0, 0, 17]", 2, "the tool would begin in bone"),
        (&both, "entry_mm = [0, 0, 17]\ntarget_mm = [0, 0, 14]", 2, "the tool meets no bone"),
        ("feed_mm_rev = 0.02", "feed_mm_rev = 1.9", 2, "path.feed_mm_rev"),
        ("web_mm = 0.15", "web_mm = 1.2", 2, "the web leaves no lip"),
        ("kind = \"drill\"\n\n[drill]", "kind = \"burr\"\n\n[burr]", 2, "a channel needs"),
        (entry, "entry_label = 9\ndirection = \"safest\"", 1, "no straight channel leads to target_mm"),
    ] {
        let changed = case.replacen(old, new, 1);
        let changed = if new.contains("[burr]") {
            let (head, rest) = changed.split_once("[burr]").unwrap();
            format!("{head}{}", &rest[rest.find("[shank]").unwrap()..])
        } else {
            changed
        };
        fs::write(place.path("bone/other.toml"), changed).unwrap();
        let ran = place.run(&["plan", "bone/other.toml", "--out", "plan"]);
        assert_eq!(ran.code, code, "{new}: {}{}", ran.out, ran.err);
        assert!(ran.err.contains(words), "{new}: {}", ran.err);
        assert!(!place.path("plan").exists());
    }
}

/// A flat spade drill of radius 1.25 mm as an ASCII STL in cm: its point at `[0.3, -0.2, 0.1]`, its shaft along y; without its last facets where
/// `open`.
fn spade_stl(open: usize) -> String {
    let (r, half, top) = (1.25, 0.15, 40.0);
    let point = r / 59f64.to_radians().tan();
    let outline = [[0.0, 0.0], [r, point], [r, top], [-r, top], [-r, point]];
    let place = |[x, z]: [f64; 2], y: f64| [0.3 + 0.1 * y, -0.2 + 0.1 * z, 0.1 + 0.1 * x];
    let mut facets = Vec::new();
    let corner = |n: usize, y: f64| place(outline[n % 5], y);
    for n in 1..4 {
        facets.push([corner(0, -half), corner(n, -half), corner(n + 1, -half)]);
        facets.push([corner(0, half), corner(n + 1, half), corner(n, half)]);
    }
    for n in 0..5 {
        facets.push([corner(n, -half), corner(n + 1, half), corner(n + 1, -half)]);
        facets.push([corner(n, -half), corner(n, half), corner(n + 1, half)]);
    }
    facets.truncate(facets.len() - open);
    let vertex = |v: [f64; 3]| format!("vertex {} {} {}\n", v[0], v[1], v[2]);
    let facet = |f: &[[f64; 3]; 3]| {
        format!("facet normal 0 0 0\nouter loop\n{}endloop\nendfacet\n", f.map(vertex).concat())
    };
    format!("solid spade\n{}endsolid spade\n", facets.iter().map(facet).collect::<String>())
}

/// The same STL with its top turned by half a turn, so that its sides cross.
fn twisted(stl: &str) -> String {
    let line = |line: &str| match line.strip_prefix("vertex ") {
        Some(vertex) => {
            let mut v: Vec<f64> = vertex.split(' ').map(|c| c.parse().unwrap()).collect();
            if v[1] > 3.0 {
                (v[0], v[2]) = (0.6 - v[0], 0.2 - v[2]);
            }
            format!("vertex {} {} {}\n", v[0], v[1], v[2])
        }
        None => format!("{line}\n"),
    };
    stl.lines().map(line).collect()
}

#[test]
fn a_cutter_from_a_mesh_is_planned_simulated_and_verified() {
    let place = Place::empty();
    runs(&place, &["phantom", "--kind", "tibia", "--out", "bone"]);
    let drilled = fs::read_to_string(place.path("bone/case.toml")).unwrap();
    let (head, rest) = drilled.split_once("kind = \"drill\"").unwrap();
    let rest = &rest[rest.find("[shank]").unwrap()..];
    let mesh = "kind = \"mesh\"\n\n[mesh]\nstl = \"spade.stl\"\nscale_mm = 10\naxis = [0, 1, 0]\naxis_point_mm = [3, 0, 1]\n\
                dihedral_deg = 45\nspindle_rpm = 500\n";
    let case = format!("{head}{mesh}\n{rest}").replacen("dwell_s = 0.5", "dwell_s = 0.5\n", 1);
    fs::write(place.path("bone/spade.stl"), spade_stl(0)).unwrap();
    fs::write(place.path("bone/mesh.toml"), &case).unwrap();
    runs(&place, &["plan", "bone/mesh.toml", "--out", "plan"]);
    let radius_mm = 1.25f64.hypot(0.15);
    let record = fs::read_to_string(place.path("plan/plan.toml")).unwrap();
    assert!(record.contains("spade.stl"), "the mesh is no input of the plan");
    let channel: toml::Table = record.parse().unwrap();
    let channel = &channel["metrics"]["channel"];
    let of = |key: &str| channel[key].as_float().unwrap();
    assert!((of("radius_mm") - radius_mm).abs() < 1e-6, "{}", of("radius_mm"));
    let swept = std::f64::consts::PI * radius_mm * radius_mm * (of("depth_mm") - of("contact_depth_mm"));
    assert!((number_of(&place, "removed_mm3") - swept).abs() < 1e-3 * swept);
    let plunge = Table::read(&place.path("plan/plunge.csv"));
    let peak = |plunge: &Table, column: &str| plunge.column(column).into_iter().fold(0.0, f64::max);
    runs(&place, &["plan", "bone/case.toml", "--out", "drilled"]);
    let drilled = Table::read(&place.path("drilled/plunge.csv"));
    let share = |column: &str| peak(&plunge, column) / peak(&drilled, column);
    // lips of the drill's point angle and nearly its radius turn as hard; upright rake faces push harder than those along a helix
    assert!((0.8..1.25).contains(&share("torque_nmm")), "{}", share("torque_nmm"));
    assert!((1.0..3.0).contains(&share("thrust_n")), "{}", share("thrust_n"));
    runs(&place, &["simulate", "plan"]);
    runs(&place, &["verify", "plan"]);
    // the same edges, given as polylines in the file's unit: from the middle of the chisel edge out
    let lip = |side: f64| {
        let (x, y) = (0.3 - 0.015 * side, 0.1 + 0.125 * side);
        format!("{x},-0.2,0.1\n{x},{},{y}\n", -0.2 + 0.125 / 59f64.to_radians().tan())
    };
    let rows =
        |edge: u8, side: f64| lip(side).lines().map(|line| format!("{edge},{line}\n")).collect::<String>();
    let edges = format!("edge,x,y,z\n{}{}", rows(1, 1.0), rows(2, -1.0));
    fs::write(place.path("bone/edges.csv"), &edges).unwrap();
    let by_angle = peak(&plunge, "torque_nmm");
    let given = case.replacen("spindle_rpm = 500", "edges = \"edges.csv\"\nspindle_rpm = 500", 1);
    fs::write(place.path("bone/given.toml"), &given).unwrap();
    runs(&place, &["plan", "bone/given.toml", "--out", "given"]);
    runs(&place, &["verify", "given"]);
    let by_file = peak(&Table::read(&place.path("given/plunge.csv")), "torque_nmm");
    assert!(by_file > 0.9 * by_angle && by_file <= by_angle * (1.0 + 1e-6), "{by_file} {by_angle} N mm");
    // a file that was changed since is no input of this plan
    fs::write(place.path("bone/spade.stl"), spade_stl(0).replacen("solid", "solid other", 1)).unwrap();
    let ran = place.run(&["verify", "plan"]);
    assert!(ran.code != 0 && (ran.out + &ran.err).contains("spade.stl"));
    // what is no cutter is said with its file
    for (stl, edges, words) in [
        (spade_stl(2), edges.clone(), ["spade.stl", "the surface is open"]),
        (twisted(&spade_stl(0)), edges.clone(), ["spade.stl", "the surface crosses itself"]),
        ("solid".into(), edges.clone(), ["spade.stl", "not valid ASCII STL"]),
        (spade_stl(0), edges.replacen("0.1\n", "0.9\n", 1), ["spade.stl", "off the mesh"]),
        (spade_stl(0), edges.replacen("1,", "one,", 1), ["edges.csv:2", "a finite number"]),
    ] {
        fs::write(place.path("bone/spade.stl"), stl).unwrap();
        fs::write(place.path("bone/edges.csv"), edges).unwrap();
        let ran = place.run(&["plan", "bone/given.toml", "--out", "other"]);
        assert_eq!(ran.code, 2, "{}{}", ran.out, ran.err);
        assert!(words.iter().all(|w| ran.err.contains(w)), "{words:?}: {}", ran.err);
    }
}
