//! Tests the verifier with faults that are put into a correct plan: the intended check must find each of them.
//!
//! A fault should be visible to one check only. Where positions change, the trajectory is computed again, so that it follows the
//! wrong path exactly.

use std::collections::BTreeSet;
use std::fs;
use std::sync::OnceLock;

use bonemill_geometry::testkit::pocket;
use bonemill_planner::Progress;
use bonemill_planner::plan::StoredPlan;
use bonemill_planner::verify::{Check, Verification, verify};
use rayon::prelude::*;

use crate::support::body;
use crate::support::faults::{self, Fault};
use crate::support::image::Image;
use crate::support::place::Place;
use crate::support::{figure_faults, force_faults};

struct Quiet;
impl Progress for Quiet {
    fn stage(&self, _: &str) {}
    fn advance(&self, _: usize, _: usize) {}
}

/// A patient whose plan is correct by a wide margin: the shaft stays upright, so the shank stays behind the burr.
fn upright() -> Place {
    Place::healthy().with_case("[robot]\n", "[orientation]\nmode = \"fixed\"\n\n[robot]\n")
}

/// A correct plan, computed once.
fn sound() -> &'static (Place, StoredPlan) {
    static PLAN: OnceLock<(Place, StoredPlan)> = OnceLock::new();
    PLAN.get_or_init(|| {
        let place = upright();
        let ran = place.plan();
        assert_eq!(ran.code, 0, "{}", ran.err);
        let plan = StoredPlan::load(&place.path("plan")).unwrap();
        (place, plan)
    })
}

fn verified(plan: &StoredPlan) -> Verification {
    verify(plan, &Quiet).unwrap()
}

/// Every kind of fault.
fn all_faults() -> impl Iterator<Item = &'static Fault> {
    faults::ALL.iter().chain(figure_faults::ALL).chain(force_faults::ALL)
}

/// The checks that failed: `name` and `name/subject` of each.
fn failed(found: &Verification) -> BTreeSet<String> {
    let subject = |c: &Check| c.subject.as_ref().map(|s| format!("{}/{s}", c.name));
    found.failed().flat_map(|c| subject(c).into_iter().chain([c.name.to_owned()])).collect()
}

#[test]
fn a_sound_plan_passes_every_check() {
    let found = verified(&sound().1);
    let reasons: Vec<String> = found.failed().map(ToString::to_string).collect();
    assert!(found.passed(), "\n{}", reasons.join("\n"));
    assert!(found.checks.len() > 50, "{}", found.checks.len());
}

#[test]
fn every_planted_fault_is_caught_by_the_check_for_it() {
    // made before any thread waits for it
    let sound = &sound().1;
    let missed = |Fault { name, plant, caught_by }: &Fault| {
        let mut plan = sound.clone();
        plant(&mut plan);
        let found = failed(&verified(&plan));
        let by: Vec<_> = caught_by.iter().filter(|c| !found.contains(**c)).collect();
        (!by.is_empty()).then(|| format!("{name}: not by {by:?}, but by {found:?}"))
    };
    let missed: Vec<String> = all_faults().collect::<Vec<_>>().into_par_iter().filter_map(missed).collect();
    assert!(missed.is_empty(), "\n{}", missed.join("\n"));
    assert!(all_faults().count() >= 40, "{}", all_faults().count());
}

#[test]
fn every_check_has_a_fault_that_fails_it() {
    let name = |caught: &'static str| caught.split_once('/').map_or(caught, |(name, _)| name);
    let named: BTreeSet<&str> = all_faults().flat_map(|f| f.caught_by).map(|c| name(c)).collect();
    // checks whose faults cannot be put into a plan in memory have separate tests (the last one in tests/scan_edge.rs)
    let elsewhere =
        ["inputs unchanged", "burr stays where it is checked", "lattice spacing", "target outside the scan"];
    let all: BTreeSet<&str> = verified(&sound().1).checks.iter().map(|c| c.name).collect();
    let without: Vec<_> = all.iter().filter(|c| !named.contains(**c) && !elsewhere.contains(*c)).collect();
    assert!(without.is_empty(), "no fault fails {without:?}");
}

#[test]
fn threads_change_no_byte_of_the_verdict() {
    let text = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| verified(&sound().1).to_toml())
    };
    assert!(text(1) == text(3));
}

/// The command's output without warnings.
fn found_lines(out: &str) -> Vec<&str> {
    out.lines().filter(|line| !line.starts_with("warning: ")).collect()
}

#[test]
fn the_command_says_what_it_found_and_writes_it() {
    let place = upright();
    assert_eq!(place.plan().code, 0);
    let ran = place.run(&["verify", "plan"]);
    assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
    // passed checks are counted, and listed with --all
    assert_eq!(found_lines(&ran.out).len(), 1, "{}", ran.out);
    assert!(ran.out.contains(" checks passed (--all lists them); wrote "), "{}", ran.out);
    let line = "pass  clearance of moves (nerve): ";
    let listed = place.run(&["verify", "plan", "--all"]).out;
    assert!(listed.contains(line) && !listed.contains("FAIL"), "{listed}");
    let verdict = || fs::read_to_string(place.path("plan/verification.toml")).unwrap();
    let read: toml::Table = verdict().parse().unwrap();
    assert_eq!(read["passed"].as_bool(), Some(true));
    let digest = read["files"]["waypoints.csv"].as_str().unwrap();
    assert_eq!(digest.len(), 64);
    // the same as a JSON object
    let first = verdict();
    let ran = place.run(&["verify", "plan", "--json", "--threads", "1"]);
    let object: serde_json::Value = serde_json::from_str(&ran.out).unwrap();
    assert_eq!((ran.code, &object["passed"]), (0, &true.into()));
    assert!(verdict() == first);
    // a folder with a verification can be replaced by a new plan
    assert_eq!(place.plan().code, 0);
    assert!(!place.path("plan/verification.toml").exists());
}

#[test]
fn a_plan_that_falls_short_never_passes() {
    let place = upright().with_case("[speed]\n", "[speed]\ntotal_time_s = 1\n");
    let ran = place.plan();
    let reason = "speed.total_time_s = 1 s cannot be met";
    assert!(ran.code == 1 && ran.err.contains(&format!("fell short: {reason}")), "{}{}", ran.out, ran.err);
    let ran = place.run(&["verify", "plan"]);
    assert_eq!(ran.code, 1, "{}{}", ran.out, ran.err);
    assert!(ran.out.contains(&format!("FAIL  plan meets its case: 1 > 0; {reason}")), "{}", ran.out);
    assert!(ran.out.contains("FAIL  time asked for: "), "{}", ran.out);
    // if the plan's shortfalls are deleted, the cause is still found
    let record = fs::read_to_string(place.path("plan/plan.toml")).unwrap();
    let (before, rest) = record.split_once("shortfalls = [").unwrap();
    let (_, after) = rest.split_once(",]\n").unwrap();
    fs::write(place.path("plan/plan.toml"), format!("{before}shortfalls = []\n{after}")).unwrap();
    let ran = place.run(&["verify", "plan"]);
    assert_eq!(ran.code, 1, "{}{}", ran.out, ran.err);
    assert!(!ran.out.contains("plan meets its case: 1 > 0"), "{}", ran.out);
    assert!(ran.out.contains("FAIL  time asked for: "), "{}", ran.out);
}

#[test]
fn what_failed_comes_last_and_drawn_errors_stand_in_the_report() {
    let place = upright();
    assert_eq!(place.plan().code, 0);
    let report = || fs::read_to_string(place.path("plan/report.html")).unwrap();
    let drawn = ["verify", "plan", "--samples", "40", "--registration-mm", "6", "--keep", "0.99"];
    let ran = place.run(&drawn);
    assert_eq!(ran.code, 1, "{}{}", ran.out, ran.err);
    let last = ran.out.lines().last().unwrap();
    assert!(last.starts_with("FAIL  probability of touching nerve: "), "{}", ran.out);
    assert!(report().contains("Under random errors") && report().contains("registration 6 mm along"));
    let place = place.with_bytes("plan/plan.toml", |bytes| {
        let text = String::from_utf8(bytes.clone()).unwrap();
        let metrics = text.replacen("\nremoved_mm3 = ", "\nremoved_mm3 = 1", 1);
        *bytes = metrics.replacen("\ntotal_time_s = ", "\ntotal_time_s = 1", 1).into_bytes();
    });
    let ran = place.run(&["verify", "plan", "--all"]);
    assert_eq!(ran.code, 1, "{}{}", ran.out, ran.err);
    let (lines, end) = ran.out.split_at(ran.out.find(" checks passed; wrote ").unwrap());
    let failed: Vec<&str> = lines.lines().filter(|line| line.starts_with("FAIL  ")).collect();
    assert!(failed.len() >= 2 && lines.contains("pass  "), "{}", ran.out);
    assert_eq!(
        end.lines().skip(1).collect::<Vec<_>>(),
        failed,
        "again at the end, with value, limit and place"
    );
    let short = place.run(&["verify", "plan"]).out;
    assert!(!short.contains("pass  ") && found_lines(&short).len() == 1 + failed.len(), "{short}");
}

#[test]
fn errors_that_make_no_sense_are_refused_and_no_verdict_is_written() {
    let place = upright();
    assert_eq!(place.plan().code, 0);
    for (samples, key, value, says) in [
        ("0", "--keep", "0.9", "invalid value '0' for '--samples <N>': 0 is not in 1..=1000000"),
        ("1000001", "--keep", "0.9", "1000001 is not in 1..=1000000"),
        (
            "10",
            "--keep",
            "1",
            "keep = 1: expected 0.5 to below 1, the probability with which every structure must stay untouched",
        ),
        ("-5", "--keep", "0.9", "invalid value '-5' for '--samples <N>': -5 is not in 1..=1000000"),
        ("10", "--keep", "-0.5", "keep = -0.5: expected 0.5 to below 1"),
        (
            "10",
            "--boundary-mm=-1",
            "--quiet",
            "invalid value '-1' for '--boundary-mm <MM>': expected a number of at least 0",
        ),
        (
            "10",
            "--registration-mm=-1",
            "--quiet",
            "'--registration-mm <MM>': expected a number of at least 0",
        ),
    ] {
        place.run(&["verify", "plan", "--samples", samples, key, value]).refused(&[says]);
    }
    assert!(!place.path("plan/verification.toml").exists());
}

#[test]
fn another_ct_is_caught_and_the_verdict_says_so() {
    let place = upright();
    assert_eq!(place.plan().code, 0);
    let place = place.with_bytes("ct.nii", |bytes| *bytes.last_mut().unwrap() ^= 1);
    let ran = place.run(&["verify", "plan"]);
    assert_eq!(ran.code, 1, "{}{}", ran.out, ran.err);
    assert!(ran.out.contains("FAIL  inputs unchanged: 1 > 0") && ran.out.contains("ct.nii"), "{}", ran.out);
    let verdict = fs::read_to_string(place.path("plan/verification.toml")).unwrap();
    assert!(verdict.contains("passed = false"));
}

#[test]
fn what_is_no_plan_is_bad_input() {
    let place = upright();
    place.run(&["verify", "nowhere"]).refused(&["nowhere", "cannot be read"]);
    assert_eq!(place.plan().code, 0);
    let edited = |name: &str, from: &str, to: &str| {
        let path = place.path(name);
        let text = fs::read_to_string(&path).unwrap();
        assert!(text.contains(from), "{from}");
        fs::write(&path, text.replacen(from, to, 1)).unwrap();
        let ran = place.run(&["verify", "plan"]);
        fs::write(&path, text).unwrap();
        ran
    };
    edited("plan/waypoints.csv", "index,layer", "layer,index").refused(&["waypoints.csv:1:", "header"]);
    edited("plan/trajectory.csv", "\n0.01,", "\nNaN,").refused(&["trajectory.csv:3:", "finite"]);
    edited("plan/plan.toml", "removed_mm3 = ", "removed_mm3 = \"much\" #").refused(&["metrics.removed_mm3"]);
    edited("plan/robot.urdf", "<robot", "<rabbit").refused(&["robot.urdf"]);
    // wrong numbers that are readable are found by the verifier
    let ran = edited("plan/plan.toml", "\ntarget_mm3 = ", "\ntarget_mm3 = 9");
    assert_eq!(ran.code, 1, "{}{}", ran.out, ran.err);
}

/// The figures of a structure that is far from the burr may be left out: the planner measures no distance there.
#[test]
fn a_structure_far_from_the_burr_needs_no_figures() {
    let wide = [body::DIMS[0] + 24, body::DIMS[1], body::DIMS[2]];
    let image = |value: fn([usize; 3]) -> f32| Image::new(wide, body::SPACING_MM, body::ORIGIN_MM, value);
    // from the burr's centre it may be 2 · 1.5 + 1 + 12 = 16 mm: here it is some 19, 16.5 and 15 mm
    for (from, is_said) in [(62, false), (57, false), (54, true)] {
        let place = upright().with_case(
            "[approach]\n",
            "[[structure]]\nname = \"far\"\nlabel = 9\nclearance_mm = 1.0\n\n[approach]\n",
        );
        place.put_ct(&image(pocket::hu));
        let mut labels = image(|voxel| f32::from(pocket::label(voxel)));
        labels.fill([from..from + 2, 10..20, 4..10], 9.0);
        place.put_labels(&labels);
        let ran = place.plan();
        assert_eq!(ran.code, 0, "{}", ran.err);
        let plan = StoredPlan::load(&place.path("plan")).unwrap();
        assert_eq!(failed(&verified(&plan)), BTreeSet::new());
        let record: toml::Table = fs::read_to_string(place.path("plan/plan.toml")).unwrap().parse().unwrap();
        let far = &record["metrics"]["structures"]["far"];
        assert_eq!(far.get("least_surface_distance_mm").is_some(), is_said, "{far}");
    }
}
