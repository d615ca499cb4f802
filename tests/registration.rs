//! Registrations from fiducials: a good one is used, a bad one is refused or makes the plan fall short with advice, and an
//! assumed one gives a warning everywhere.

use std::fs;

use crate::support::place::{Place, Ran};
use bonemill_planner::plan::{StoredPlan, Value};
use nalgebra::Vector3;

/// Fiducials in the patient's scan, ct, mm.
const CT_MM: [[f64; 3]; 5] =
    [[-10.0, -7.0, 4.0], [8.0, -6.0, 6.0], [-9.0, 11.0, 5.0], [2.0, 3.0, 16.0], [7.0, 9.0, 15.0]];

/// The same points measured exactly by an arm: a quarter turn about z, 12 mm below.
fn touched() -> [[f64; 3]; 5] {
    CT_MM.map(|[x, y, z]| [-y, x, z - 12.0])
}

fn with_fiducials(ct_mm: &[[f64; 3]], base_mm: &[[f64; 3]], more: &str) -> Place {
    let fiducials =
        format!("base_from_ct = {{ fiducials = {{ ct_mm = {ct_mm:?}, base_mm = {base_mm:?} }} }}");
    Place::healthy().with_case("rate_hz = 100", &format!("rate_hz = 500\n{fiducials}\n{more}"))
}

fn load(place: &Place) -> StoredPlan {
    StoredPlan::load(&place.path("plan")).unwrap()
}

fn number(plan: &StoredPlan, name: &str) -> f64 {
    match plan.record.metrics.more.iter().find(|(key, _)| key == name) {
        Some((_, Value::Number(number))) => *number,
        other => panic!("{name}: {other:?}"),
    }
}

#[track_caller]
fn short_of(ran: &Ran, parts: &[&str]) {
    assert_eq!(ran.code, 1, "{}{}", ran.out, ran.err);
    for part in parts {
        assert!(ran.err.contains(part), "{part:?} is not in {}", ran.err);
    }
}

#[test]
fn fiducials_give_the_registration_and_say_how_well() {
    let place = with_fiducials(&CT_MM, &touched(), "");
    let ran = place.plan();
    assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
    let plan = load(&place);
    assert!(!plan.record.frames.registration_assumed && plan.record.warnings.is_empty());
    assert!((plan.record.frames.base_from_ct.translation_mm - Vector3::new(0.0, 0.0, -12.0)).norm() < 1e-9);
    assert!(number(&plan, "fre_mm") < 1e-9);
    for name in ["expected_error_mm", "fiducial_residuals_mm"] {
        assert!(plan.record.metrics.more.iter().any(|(key, _)| key == name), "{name}");
    }
    let verified = place.run(&["verify", "plan", "--all"]);
    assert!(verified.out.contains("registration's FRE"), "{}", verified.out);
    assert!(!verified.out.contains("FAIL  registration") && !verified.out.contains("FAIL  fiducials"));
}

#[test]
fn a_fiducial_that_is_off_falls_short_and_is_named() {
    let mut base = touched();
    base[4][0] += 3.6;
    let place = with_fiducials(&CT_MM, &base, "");
    let parts = ["FRE 1.", "at most 1 mm", "registration.max_fre_mm", "fiducial 5 is", "touch it again"];
    short_of(&place.plan(), &parts);
    let plan = load(&place);
    assert!(plan.record.shortfalls.iter().any(|s| s.contains("FRE")), "{:?}", plan.record.shortfalls);
    // a case may allow a larger error, as long as the expected error at the nerve is below its clearance
    let place = with_fiducials(&CT_MM, &base, "[registration]\nmax_fre_mm = 2\n");
    let fre_mm = number(&plan, "fre_mm");
    let place = place.with_case("clearance_mm = 1.0", "clearance_mm = 1.6");
    let ran = place.plan();
    assert_eq!(ran.code, 0, "FRE {fre_mm}: {}{}", ran.out, ran.err);
}

#[test]
fn an_expected_error_beyond_a_clearance_falls_short_with_the_structure() {
    let mut base = touched();
    base[4][0] += 1.5;
    let place = with_fiducials(&CT_MM, &base, "").with_case("clearance_mm = 1.0", "clearance_mm = 0.2");
    let ran = place.plan();
    short_of(&ran, &["expected error at nerve is 0.", "more than its clearance of 0.2 mm", "fiducials"]);
    assert!(!ran.err.contains("max_fre_mm"), "{}", ran.err);
    let verified = place.run(&["verify", "plan"]);
    assert_eq!(verified.code, 1, "{}{}", verified.out, verified.err);
    assert!(verified.out.contains("FAIL  registration's expected error (nerve)"), "{}", verified.out);
}

#[test]
fn exchanged_fiducials_fall_short_and_are_named_however_quiet() {
    let mut base = touched();
    base.swap(3, 4);
    base[0][0] += 0.1;
    let place = with_fiducials(&CT_MM, &base, "");
    let quiet = place.run(&["plan", "case.toml", "--out", "plan", "--quiet"]);
    assert_eq!(quiet.out, "");
    short_of(
        &quiet,
        &[
            "fell short: ",
            "exchanging fiducials 4 and 5 would bring the FRE to 0.0",
            "expected error at nerve",
        ],
    );
    let verified = place.run(&["verify", "plan", "--quiet"]);
    short_of(&verified, &["registration's FRE", "registration's expected error"]);
    let report = fs::read_to_string(place.path("plan/report.html")).unwrap();
    assert!(report.contains("exchanging fiducials 4 and 5"), "the report says so too");
}

#[test]
fn where_a_bad_registration_leaves_no_plan_it_is_named() {
    let mut base = touched();
    base.swap(1, 2);
    let place = with_fiducials(&CT_MM, &base, "");
    place.falls_short_of_a_plan(&[
        "the shank can reach no part",
        "exchanging fiducials 2 and 3",
        "robot.base_from_ct",
    ]);
}

#[test]
fn points_in_lps_are_refused_and_recognised() {
    let lps = CT_MM.map(|[x, y, z]| [-x, -y, z]);
    // half a turn about z: the fit itself is exact
    let place = with_fiducials(&lps, &touched(), "");
    place.refuses(&[
        &place.line_of("fiducials"),
        "outside the scan",
        "as LPS they would all lie inside: negate x and y",
    ]);
    let far = CT_MM.map(|[x, y, z]| [x, y, z + 400.0]);
    let place = with_fiducials(&far, &touched(), "");
    place.refuses(&["fiducials 1, 2, 3, 4, 5 of 5 lie outside the scan, by up to 398.2 mm", "RAS+"]);
}

#[test]
fn a_mirrored_set_is_refused_with_what_is_wrong() {
    let mirrored = touched().map(|[x, y, z]| [x, -y, z]);
    let place = with_fiducials(&CT_MM, &mirrored, "");
    place.refuses(&[
        &place.line_of("fiducials"),
        "mirror image (RMS 0.00 mm)",
        "the sign of one axis is wrong",
    ]);
}

#[test]
fn points_on_a_line_are_refused() {
    let line = [[0.0, 0.0, 5.0], [4.0, 0.0, 5.0], [8.0, 0.0, 5.0]];
    let place = with_fiducials(&line, &line, "");
    place.refuses(&[&place.line_of("fiducials"), "of a line"]);
}

#[test]
fn an_assumed_place_is_a_warning_everywhere() {
    let place = Place::healthy();
    let said = "no registration in the case (robot.base_from_ct): the arm's place is assumed";
    let ran = place.plan();
    assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
    assert!(ran.out.contains(&format!("warning: {said}")), "{}", ran.out);
    assert!(load(&place).record.warnings.iter().any(|w| w.starts_with(said)));
    assert!(fs::read_to_string(place.path("plan/report.html")).unwrap().contains(said));
    for command in [&["plan", "case.toml", "--out", "plan", "--json"][..], &["verify", "plan", "--json"]] {
        let ran = place.run(command);
        let object: serde_json::Value = serde_json::from_str(&ran.out).unwrap();
        assert!(object["warnings"][0].as_str().unwrap().starts_with(said), "{object}");
    }
    assert!(place.run(&["verify", "plan"]).out.contains(said));
}
