//! Channels end to end: a tibia drilled and a glenoid reamed by the command, simulated and verified, and plans that are wrong.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a test's helper fails by panicking")]

mod support;

use std::fs;
use std::path::Path;

use support::place::Place;

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
    runs(&place, &["simulate", "plan"]);
    let simulated = Table::read(&place.path("plan/simulation.csv"));
    let peak = |values: &[f64]| values.iter().copied().fold(0.0, f64::max);
    let torque = [peak(&plunge.column("torque_nmm")), peak(&simulated.column("torque_nmm"))];
    assert!((torque[0] - torque[1]).abs() < 0.1 * torque[0], "{torque:?} N mm");
    let said = runs(&place, &["verify", "plan", "--all"]);
    for check in ["clearance of moves (vessel)", "probability of touching (vessel)", "volumes as written"] {
        assert!(said.contains(check), "{check} is missing in {said}");
    }
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
fn what_cannot_be_drilled_is_said_with_its_key() {
    let place = Place::empty();
    runs(&place, &["phantom", "--kind", "tibia", "--out", "bone"]);
    let case = fs::read_to_string(place.path("bone/case.toml")).unwrap();
    let target = case.lines().find(|l| l.starts_with("target_mm")).unwrap();
    let entry = case.lines().find(|l| l.starts_with("entry_mm")).unwrap();
    for (old, new, code, words) in [
        (target, "target_mm = [0, 0, -18.5]", 1, "the channel runs through vessel"),
        (target, "target_mm = [0, 0, 17]", 2, "the tool meets no bone"),
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
