//! An arm among obstacles and beside a patient: plans keep the links clear or say what is in the way, and the verification finds
//! planted faults.

use std::collections::BTreeSet;
use std::fs;

use crate::support::place::Place;
use bonemill_geometry::Progress;
use bonemill_planner::case::{Obstacle, ObstacleFrame, ObstacleShape};
use bonemill_planner::plan::{StoredPlan, Value};
use bonemill_planner::verify::{Check, verify};
use nalgebra::Vector3;

const ROBOT: &str = "model = \"ur5e\"\n\
    flange_from_burr = { translation_mm = [0, -90, 155], rpy_rad = [2.617993877991494, 0, 0] }";

struct Quiet;

impl Progress for Quiet {
    fn stage(&self, _: &str) {}
    fn advance(&self, _: usize, _: usize) {}
    fn note(&self, _: &str) {}
}

/// The healthy patient before a UR5e, with more lines at the end of the case.
fn beside(lines: &str) -> Place {
    let place = Place::healthy().with_case("rate_hz = 100", &format!("rate_hz = 100\n{ROBOT}"));
    let text = fs::read_to_string(place.path("case.toml")).unwrap();
    fs::write(place.path("case.toml"), text + "\n" + lines).unwrap();
    place
}

#[track_caller]
fn planned(place: &Place) -> StoredPlan {
    let ran = place.plan();
    assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
    StoredPlan::load(&place.path("plan")).unwrap()
}

/// A key of `modelled.link_distance`.
fn link_distance(plan: &StoredPlan, key: &str) -> Value {
    let Some(Value::Table(entries)) = plan.record.modelled("link_distance") else { panic!("not said") };
    entries.iter().find(|(name, _)| name == key).unwrap().1.clone()
}

fn least_mm(plan: &StoredPlan) -> f64 {
    let Value::Number(mm) = link_distance(plan, "least_mm") else { panic!("no number") };
    mm
}

#[track_caller]
fn check_of<'a>(checks: &'a [Check], name: &str) -> &'a Check {
    checks.iter().find(|check| check.name == name).unwrap()
}

#[test]
fn links_go_round_an_obstacle_or_the_plan_says_what_is_in_the_way() {
    let healthy = beside("");
    let free = planned(&healthy);
    assert!(least_mm(&free) >= 10.0);
    let elbow = free.arm.joint_places(free.trajectory.q_at(0)).unwrap()[2];
    let ball = ObstacleShape::Ball { center_mm: elbow.coords, radius_mm: 60.0 };
    let lamp = Obstacle { name: "lamp".into(), frame: ObstacleFrame::Base, shape: ball };

    // what the plan without it would hit
    let mut faulty = StoredPlan::load(&free.dir).unwrap();
    faulty.record.case.obstacles.push(lamp);
    let found = verify(&faulty, &Quiet).unwrap().checks;
    let check = check_of(&found, "links to obstacles and each other");
    assert!(!check.passed() && check.value < 0.0 && check.note.contains("and lamp"), "{check}");
    assert!(check_of(&found, "links to the patient").passed());

    let at = [elbow.x(), elbow.y(), elbow.z()];
    let place =
        beside(&format!("[[obstacle]]\nname = \"lamp\"\nball = {{ center_mm = {at:?}, radius_mm = 60 }}\n"));
    let plan = planned(&place);
    assert!(least_mm(&plan) >= 10.0, "{}", least_mm(&plan));
    let ran = place.run(&["verify", "plan"]);
    assert_eq!(ran.code, 0, "{}", ran.out);
    let verdict = fs::read_to_string(place.path("plan/verification.toml")).unwrap();
    assert!(
        verdict.contains("links to obstacles and each other") && verdict.contains("links to the patient")
    );
    let report = fs::read_to_string(place.path("plan/report.html")).unwrap();
    for said in ["least distance of the arm's links", "Distance of the arm's links from patient, obstacles"] {
        assert!(report.contains(said), "{said}");
    }

    // a shelf where the flange must be
    let flange = free.arm.joint_places(free.trajectory.q_at(0)).unwrap()[6];
    let [low, high] = [-1.0, 1.0].map(|side| {
        let p = flange.coords + Vector3::new(300.0, 300.0, 30.0) * side;
        [p.x, p.y, p.z]
    });
    let place =
        beside(&format!("[[obstacle]]\nname = \"shelf\"\nbox = {{ min_mm = {low:?}, max_mm = {high:?} }}\n"));
    place.falls_short_of_a_plan(&[
        "the arm cannot reach waypoint",
        "runs into shelf by up to",
        "robot.link_clearance_mm = 10",
        "mount the handpiece at another angle (robot.flange_from_burr)",
    ]);
}

#[test]
fn a_patient_where_the_arm_is_fails_the_verification() {
    let healthy = beside("");
    let free = planned(&healthy);
    let mut faulty = StoredPlan::load(&free.dir).unwrap();
    // the patient is where the forearm is
    let places = free.arm.joint_places(free.trajectory.q_at(0)).unwrap();
    let forearm = 0.5 * (places[2].coords + places[3].coords);
    let there = free.record.frames.base_from_ct * free.waypoints[0].position;
    faulty.record.frames.base_from_ct.translation_mm += forearm - there.coords;
    let found = verify(&faulty, &Quiet).unwrap().checks;
    let check = check_of(&found, "links to the patient");
    assert!(!check.passed() && check.value < 0.0, "{check}");
}

#[test]
fn a_base_may_stand_on_a_table_but_not_in_one_or_in_the_patient() {
    let table = |top_mm: f64| {
        format!(
            "[[obstacle]]\nname = \"table\"\nbox = {{ min_mm = [-200, -200, -80], max_mm = [200, 200, {top_mm:?}] }}\n"
        )
    };
    let place = beside(&table(0.0));
    let plan = planned(&place);
    assert!(least_mm(&plan) >= 10.0);
    let found = verify(&plan, &Quiet).unwrap().checks;
    assert!(check_of(&found, "links to obstacles and each other").passed());
    // the same plan, had the table been higher
    let mut faulty = StoredPlan::load(&plan.dir).unwrap();
    let ObstacleShape::Box { max_mm, .. } = &mut faulty.record.case.obstacles[0].shape else { panic!() };
    max_mm.z = 30.0;
    let found = verify(&faulty, &Quiet).unwrap().checks;
    let check = check_of(&found, "links to obstacles and each other");
    assert!(!check.passed() && check.note.starts_with("base and table"), "{check}");

    beside(&table(30.0)).falls_short_of_a_plan(&[
        "the arm's base runs into table by up to",
        "move the base or the patient (robot.base_from_ct)",
    ]);
    let place =
        Place::healthy().with_case("rate_hz = 100", &format!("rate_hz = 100\nhead_beyond_mm = 500\n{ROBOT}"));
    place.falls_short_of_a_plan(&["the arm's base runs into the patient"]);
}

#[test]
fn what_an_arm_among_obstacles_does_not_reach_is_told_with_link_and_distance() {
    let healthy = beside("");
    let free = planned(&healthy);
    let target = free.record.frames.base_from_ct * free.waypoints[0].position;
    let block = |low: [f64; 3], high: [f64; 3]| {
        let at = |by: [f64; 3]| (target.coords + Vector3::from(by)).data.0[0];
        format!(
            "[orientation]\nmode = \"fixed\"\n[[obstacle]]\nname = \"post\"\nbox = {{ min_mm = {:?}, max_mm = {:?} }}\n",
            at(low),
            at(high)
        )
    };
    // a post beside the handpiece: it may not come down on that side
    let place = beside(&block([20.0, -300.0, 20.0], [60.0, 300.0, 40.0]));
    let ran = place.plan();
    let why = "the arm cannot take an axis along which the shank is free: the arm's handpiece comes within";
    assert!(ran.code == 1 && ran.err.contains(why), "{}", ran.err);
    let dropped = fs::read_to_string(place.path("plan/dropped.csv")).unwrap();
    let reasons: BTreeSet<_> = dropped.lines().skip(1).map(|line| &line[line.find('"').unwrap()..]).collect();
    assert!(
        reasons.iter().any(|reason| reason.contains(why) && reason.contains(" mm of post")),
        "{reasons:?}"
    );
    assert!(reasons.len() <= 3, "one reason for all places of a kind: {reasons:?}");
    // a post that lets it come down nowhere
    let place = beside(&block([2.0, -300.0, -12.0], [60.0, 300.0, 8.0]));
    place.falls_short_of_a_plan(&[
        "the shank can reach no part of the target",
        "the arm's handpiece comes within",
        "how it holds the handpiece (robot.flange_from_burr)",
    ]);
}

#[test]
fn an_arm_whose_links_are_not_known_is_told_of() {
    let place = Place::healthy();
    let text = fs::read_to_string(place.path("case.toml")).unwrap();
    let ball = "[[obstacle]]\nname = \"lamp\"\nball = { center_mm = [0, 0, 0], radius_mm = 60 }\n";
    fs::write(place.path("case.toml"), format!("{text}\n{ball}")).unwrap();
    let plan = planned(&place);
    assert!(plan.record.modelled("link_distance").is_none());
    let told = |w: &String| w.contains("the shapes of the arm's links are not known");
    assert!(plan.record.warnings.iter().any(told), "{:?}", plan.record.warnings);
}
