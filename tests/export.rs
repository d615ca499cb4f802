//! What is exported is the plan: every format read back and compared with the plan's own files.

#![allow(clippy::unwrap_used, reason = "a test's helper fails by panicking")]

mod support;

use std::fs;

use bonemill_planner::plan::StoredPlan;
use support::place::Place;

const UR: &str = "rate_hz = 500\nmodel = \"ur5e\"\n\
                  flange_from_burr = { translation_mm = [0, 0, 180], rpy_rad = [3.141592653589793, 0, 0] }";

#[track_caller]
fn planned(place: &Place) -> StoredPlan {
    let ran = place.plan();
    assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
    StoredPlan::load(&place.path("plan")).unwrap()
}

#[track_caller]
fn exported(place: &Place, args: &[&str], file: &str) -> String {
    let ran = place.run(&[&["export", "plan", "--out", "out"], args].concat());
    assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
    assert!(ran.out.contains(file), "{}", ran.out);
    fs::read_to_string(place.path("out").join(file)).unwrap()
}

/// Row of the trajectory that exported row `n` of `count` is.
fn row(plan: &StoredPlan, n: usize, stride: usize) -> usize {
    (n * stride).min(plan.trajectory.len() - 1)
}

#[test]
fn ros_and_urscript_hold_the_trajectory() {
    let place = Place::healthy().with_case("rate_hz = 100", UR);
    let plan = planned(&place);
    let json = exported(&place, &["--format", "ros", "--rate", "100"], "plan.trajectory.json");
    let read: serde_json::Value = serde_json::from_str(&json).unwrap();
    let points = read["points"].as_array().unwrap();
    assert_eq!(points.len(), (plan.trajectory.len() - 1).div_ceil(5) + 1);
    assert_eq!(read["joint_names"][2], "elbow_joint");
    for (n, point) in points.iter().enumerate() {
        let at = row(&plan, n, 5);
        let stamp = &point["time_from_start"];
        let time_s = stamp["sec"].as_f64().unwrap() + 1e-9 * stamp["nanosec"].as_f64().unwrap();
        assert!((time_s - plan.trajectory.time_s[at]).abs() < 2e-9);
        for (key, values) in
            [("positions", plan.trajectory.q_at(at)), ("velocities", plan.trajectory.qd_at(at))]
        {
            for (read, value) in point[key].as_array().unwrap().iter().zip(values) {
                assert!((read.as_f64().unwrap() - value).abs() < 1e-9);
            }
        }
    }
    assert!(
        fs::read_to_string(place.path("out/plan.trajectory.yaml")).unwrap().contains("- \"elbow_joint\"")
    );

    let script = exported(&place, &["--format", "urscript"], "plan.script");
    let mut time_s = 0.0;
    let steps: Vec<&str> = script.lines().filter(|line| line.starts_with("  step(")).collect();
    assert_eq!(steps.len(), (plan.trajectory.len() - 1).div_ceil(20));
    for (n, line) in steps.iter().enumerate() {
        let at = row(&plan, n + 1, 20);
        let (list, dt) = line.trim_start_matches("  step([").trim_end_matches(')').split_once("], ").unwrap();
        time_s += dt.parse::<f64>().unwrap();
        assert!((time_s - plan.trajectory.time_s[at]).abs() < 1e-6);
        for (read, value) in list.split(", ").zip(plan.trajectory.q_at(at)) {
            assert!((read.parse::<f64>().unwrap() - value).abs() < 1e-9);
        }
    }
    place.run(&["export", "plan", "--format", "gcode"]).refused(&["Cartesian machines"]);
    place.run(&["export", "plan", "--format", "ros", "--rate", "1000"]).refused(&["--rate", "500"]);
    place.run(&["export", "nowhere", "--format", "ros"]).refused(&["plan.toml"]);
}

#[test]
fn g_code_drives_the_bone_attached_arm_through_every_waypoint() {
    let place = Place::healthy();
    let plan = planned(&place);
    let text = exported(&place, &["--format", "gcode"], "plan.ngc");
    let mut at = [0.0f64; 4];
    let mut path = Vec::new();
    let mut minutes = 0.0;
    for line in text.lines().filter(|line| line.starts_with("G0 ") || line.starts_with("G1 ")) {
        for word in line.split(' ').skip(1) {
            let value: f64 = word[1..].parse().unwrap();
            match &word[..1] {
                "X" => at[0] = value,
                "Y" => at[1] = value,
                "Z" => at[2] = value,
                "A" => at[3] = value.to_radians(),
                _ => minutes += 1.0 / value,
            }
        }
        let tool = plan.arm.burr(&at).unwrap();
        path.push((tool.translation_mm, tool.rotation * nalgebra::Vector3::z()));
    }
    // in order, each waypoint is driven through
    let mut next = 0;
    for waypoint in &plan.waypoints {
        let p = (plan.record.base_from_ct * waypoint.position).coords;
        let axis = plan.record.base_from_ct.rotate(&waypoint.axis);
        let found = path[next..].iter().position(|(q, a)| (q - p).norm() < 1e-3 && a.angle(&axis) < 1e-5);
        next += found.unwrap();
    }
    assert_eq!(next, path.len() - 1);
    let planned_s = plan.waypoints[plan.waypoints.len() - 1].time_s;
    assert!((minutes * 60.0 / planned_s - 1.0).abs() < 1e-3, "{} s of {planned_s}", minutes * 60.0);
    place
        .run(&["export", "plan", "--format", "urscript"])
        .refused(&["bone-attached", "ur3e, ur5e and ur10e"]);
}
