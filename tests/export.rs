//! Every exported format is read back and compared with the plan's own files.

use std::fs;

use crate::support::place::Place;
use bonemill_planner::plan::StoredPlan;

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
    let ran = place.run(&[&["export", "plan", "--out", "out", "--unverified"], args].concat());
    assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
    assert!(ran.out.contains(file), "{}", ran.out);
    fs::read_to_string(place.path("out").join(file)).unwrap()
}

/// Number of the trajectory's row that is exported as row `n` of `count`.
fn row(plan: &StoredPlan, n: usize, stride: usize) -> usize {
    (n * stride).min(plan.trajectory.len() - 1)
}

/// Distance of a point from a segment, mm.
fn from_segment(p: &nalgebra::Vector3<f64>, ends: &[nalgebra::Vector3<f64>]) -> f64 {
    let way = ends[1] - ends[0];
    let share = if way.norm_squared() > 0.0 { (p - ends[0]).dot(&way) / way.norm_squared() } else { 0.0 };
    (p - ends[0] - way * share.clamp(0.0, 1.0)).norm()
}

#[test]
fn ros_and_urscript_hold_the_trajectory() {
    let place = Place::healthy().with_case("rate_hz = 100", UR);
    let plan = planned(&place);
    let json = exported(&place, &["--format", "ros", "--rate", "250"], "plan.unverified.trajectory.json");
    let read: serde_json::Value = serde_json::from_str(&json).unwrap();
    let points = read["points"].as_array().unwrap();
    assert_eq!(points.len(), (plan.trajectory.len() - 1).div_ceil(2) + 1);
    assert_eq!(read["joint_names"][2], "elbow_joint");
    for (n, point) in points.iter().enumerate() {
        let at = row(&plan, n, 2);
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
        fs::read_to_string(place.path("out/plan.unverified.trajectory.yaml"))
            .unwrap()
            .contains("- \"elbow_joint\"")
    );

    let script = exported(&place, &["--format", "urscript"], "plan.unverified.script");
    assert!(script.contains("nominal kinematics"));
    let mut time_s = 0.0;
    let steps: Vec<&str> = script.lines().filter(|line| line.starts_with("  step(")).collect();
    // as few rows as are needed to stay on the trajectory, at least 25 per second
    let mut rows = vec![0];
    for step in &steps {
        let dt_s: f64 = step.trim_end_matches(')').rsplit_once(", ").unwrap().1.parse().unwrap();
        rows.push(rows[rows.len() - 1] + (dt_s * 500.0).round() as usize);
    }
    assert_eq!(rows[rows.len() - 1], plan.trajectory.len() - 1);
    assert!(rows.windows(2).all(|pair| (1..=20).contains(&(pair[1] - pair[0]))));
    let spans: std::collections::BTreeSet<usize> = rows.windows(2).map(|pair| pair[1] - pair[0]).collect();
    assert!(spans.len() > 2, "rows are left out where they may be: {spans:?}");
    // between rows, straight in joint space, the burr deviates from the trajectory by no more than is stated
    let burr = |q: &[f64]| plan.arm.burr(q).unwrap().translation_mm;
    let places: Vec<_> = (0..plan.trajectory.len()).map(|k| burr(plan.trajectory.q_at(k))).collect();
    for n in 0..steps.len() {
        let (from, to) = (rows[n], rows[n + 1]);
        for k in from..=to {
            let u = (k - from) as f64 / (to - from) as f64;
            let (a, b) = (plan.trajectory.q_at(from), plan.trajectory.q_at(to));
            let q: Vec<f64> = a.iter().zip(b).map(|(a, b)| a + u * (b - a)).collect();
            let near = &places[from.saturating_sub(1)..=(to + 1).min(places.len() - 1)];
            let off = near.windows(2).map(|ends| from_segment(&burr(&q), ends)).fold(f64::INFINITY, f64::min);
            assert!(off < 0.0051, "{off} mm at row {k}");
        }
    }
    for rate in ["1", "0.001"] {
        place
            .run(&["export", "plan", "--unverified", "--format", "urscript", "--rate", rate])
            .refused(&["mm aside", "higher rate"]);
    }
    place
        .run(&["export", "plan", "--unverified", "--format", "ros", "--rate", "0.01"])
        .refused(&["mm aside"]);
    place
        .run(&["export", "plan", "--unverified", "--format", "ros", "--rapid"])
        .refused(&["--rapid", "G-code"]);
    for (n, line) in steps.iter().enumerate() {
        let at = rows[n + 1];
        let (list, dt) = line.trim_start_matches("  step([").trim_end_matches(')').split_once("], ").unwrap();
        time_s += dt.parse::<f64>().unwrap();
        assert!((time_s - plan.trajectory.time_s[at]).abs() < 1e-6);
        for (read, value) in list.split(", ").zip(plan.trajectory.q_at(at)) {
            assert!((read.parse::<f64>().unwrap() - value).abs() < 1e-9);
        }
    }
    // at every waypoint the program allows no more than a quarter of the distance to the nearest structure
    let radius_mm = plan.record.case.burr.radius_mm;
    let (mut allowed_mm, mut at) = (f64::NAN, Vec::new());
    for line in script.lines() {
        match line.strip_prefix("  allow(") {
            Some(mm) => allowed_mm = mm.trim_end_matches(')').parse().unwrap(),
            None if line.starts_with("  step([") => at.push(allowed_mm),
            None => {}
        }
    }
    assert!(at.iter().all(|mm| *mm <= 0.5) && at.contains(&0.5));
    for force in &plan.forces {
        let time_s = plan.waypoints[force.waypoint].time_s;
        let step = (0..at.len()).find(|n| plan.trajectory.time_s[rows[n + 1]] >= time_s);
        let room_mm = force.distance_mm - radius_mm;
        assert!(step.is_none_or(|n| at[n] <= 0.25 * room_mm), "waypoint {}: {room_mm} mm", force.waypoint);
    }
    // a refused export leaves no files
    let refused = |args: &[&str], says: &[&str]| {
        let before = place.files();
        place.run(&[&["export", "plan", "--unverified", "--out", "a/b"], args].concat()).refused(says);
        assert!(before == place.files());
    };
    refused(&["--format", "gcode"], &["robot.model = \"ur5e\"", "three linear axes", "urscript"]);
    let ran = place.run(&["export", "plan", "--unverified", "--format", "gcode"]);
    assert!(!ran.err.contains("because"), "{}", ran.err);
    refused(&["--format", "urscript", "--rate", "1"], &["mm aside"]);
    refused(&["--format", "ros", "--rapid"], &["--rapid"]);
    place
        .run(&["export", "plan", "--unverified", "--format", "ros", "--rate", "1000"])
        .refused(&["--rate", "500"]);
    place.run(&["export", "nowhere", "--format", "ros"]).refused(&["plan.toml"]);
}

#[test]
fn what_streaming_would_not_move_is_exported_by_request_only_and_says_so() {
    let place = Place::healthy().with_case("rate_hz = 100", UR);
    planned(&place);
    for format in ["ros", "urscript"] {
        place.run(&["export", "plan", "--format", format]).refused(&[
            "the plan is not verified",
            "run `bonemill verify`",
            "--unverified",
        ]);
    }
    let yaml = exported(&place, &["--format", "ros"], "plan.unverified.trajectory.yaml");
    let script = exported(&place, &["--format", "urscript"], "plan.unverified.script");
    for text in [&yaml, &script] {
        assert!(
            text.contains("# NOT TO BE MOVED NEAR A PATIENT: the plan is not verified"),
            "{}",
            &text[..600]
        );
        assert!(
            text.contains("# It begins at rest at shoulder_pan_joint") && text.contains("For the arm ur5e")
        );
    }
    assert!(script.contains("servoj follows late") && script.contains(" mm with 0.2 s"));
    // as few points as will do, and their size
    let ran = place.run(&["export", "plan", "--unverified", "--out", "out", "--format", "ros"]);
    assert!(ran.out.contains("trajectory.json (") && ran.out.contains(" MB)"), "{}", ran.out);
    let points = yaml.matches("time_from_start").count();
    let every = exported(&place, &["--format", "ros", "--rate", "500"], "plan.unverified.trajectory.yaml");
    assert!(3 * points < every.matches("time_from_start").count(), "{points} points");
    // a joint at 100 rad/s, in whichever row
    let path = place.path("plan/trajectory.csv");
    let sound = fs::read_to_string(&path).unwrap();
    for row in [150, 200, 333] {
        let mut lines: Vec<String> = sound.lines().map(str::to_owned).collect();
        let mut cells: Vec<String> = lines[row].split(',').map(str::to_owned).collect();
        cells[3] = format!("{}", cells[3].parse::<f64>().unwrap() + 0.2);
        lines[row] = cells.join(",");
        fs::write(&path, lines.join("\n") + "\n").unwrap();
        for format in ["ros", "urscript"] {
            let ran = place.run(&["export", "plan", "--unverified", "--format", format]);
            ran.refused(&["joint speed in step", "at most the joint's limit"]);
        }
    }
}

#[test]
fn a_hold_is_in_the_script_and_refused_where_a_format_cannot_wait() {
    let hold = "\n[[hold]]\nstructure = \"nerve\"\ndistance_mm = 3.0\n";
    let place = Place::healthy().with_case("rate_hz = 100", UR);
    let text = fs::read_to_string(place.path("case.toml")).unwrap();
    fs::write(place.path("case.toml"), text + hold).unwrap();
    planned(&place);
    let script = exported(&place, &["--format", "urscript"], "plan.unverified.script");
    assert_eq!(script.matches("\n  hold(\"3 mm from nerve\")\n").count(), 1);
    place
        .run(&["export", "plan", "--unverified", "--format", "ros"])
        .refused(&["3 mm from nerve", "cannot go back and wait"]);
}

/// Joint positions on the straight line between two joint vectors.
fn between(from: &[f64], to: &[f64], share: f64) -> Vec<f64> {
    from.iter().zip(to).map(|(a, b)| a + share * (b - a)).collect()
}

#[test]
fn g_code_keeps_to_the_trajectory_and_to_every_axis_limit() {
    let place = Place::healthy().with_case("rate_hz = 100", "rate_hz = 500");
    let plan = planned(&place);
    let text = exported(&place, &["--format", "gcode"], "plan.unverified.ngc");
    let trajectory = &plan.trajectory;
    let burr = |q: &[f64]| plan.arm.burr(q).unwrap();
    let (mut at, mut path) = ([0.0f64; 4], Vec::new());
    let (mut seconds, mut worst, mut fastest) = (0f64, 0f64, 0f64);
    for line in text.lines().filter(|line| line.starts_with("G0 ") || line.starts_with("G1 ")) {
        let (before, mut span_s) = (at, 0.0);
        for word in line.split(' ').skip(1) {
            let value: f64 = word[1..].parse().unwrap();
            match &word[..1] {
                "X" => at[0] = value,
                "Y" => at[1] = value,
                "Z" => at[2] = value,
                "A" => at[3] = value.to_radians(),
                _ => span_s = 60.0 / value,
            }
        }
        path.push(burr(&at).translation_mm);
        if span_s == 0.0 {
            continue;
        }
        for (joint, (a, b)) in plan.arm.joints().iter().zip(before.iter().zip(at)) {
            fastest = fastest.max((b - a).abs() / span_s / joint.velocity_limit);
        }
        // the controller's interpolated positions, compared with the nearest place of the trajectory around that time
        let row = |s: f64| ((s * 500.0).round() as usize).min(trajectory.len() - 1);
        let near = row((seconds - 0.1_f64).max(0.0)) + 1..=row(seconds + span_s + 0.1);
        for share in [0.25, 0.5, 0.75, 1.0] {
            let q = between(&before, &at, share);
            let driven = burr(&q);
            let off = |place: &[f64]| {
                let there = burr(place);
                let z = nalgebra::Vector3::z();
                let mm = (driven.translation_mm - there.translation_mm).norm();
                (mm / 0.005).max((driven.rotation * z).cross(&(there.rotation * z)).norm() / 5e-4)
            };
            let of_piece = |k: usize| {
                let share = |n: u32| between(trajectory.q_at(k - 1), trajectory.q_at(k), f64::from(n) / 8.0);
                (1..=8).map(|n| off(&share(n))).fold(f64::INFINITY, f64::min)
            };
            worst = near.clone().map(of_piece).fold(f64::INFINITY, f64::min).max(worst);
        }
        seconds += span_s;
    }
    assert!(worst < 1.02, "{worst} of 0.005 mm and 5e-4 rad beside the trajectory");
    assert!(fastest <= 1.0 + 1e-9, "{fastest} of an axis's limit");
    assert!(fastest > 0.5, "the links ask for much of what an axis can do: {fastest}");
    // each waypoint is passed, in order, as near as the trajectory passes it
    let mut next = 0;
    for waypoint in &plan.waypoints {
        let p = (plan.record.frames.base_from_ct * waypoint.position).coords;
        let found = path[next..].iter().position(|q| (q - p).norm() < 0.025);
        next += found.unwrap();
    }
    assert_eq!(next, path.len() - 1);
    let planned_s = plan.waypoints[plan.waypoints.len() - 1].time_s;
    assert!((seconds / planned_s - 1.0).abs() < 1e-3, "{seconds} s of {planned_s}");
    assert!(text.contains(" M3\n") && text.lines().filter(|line| line.starts_with("G0 ")).count() == 1);
    // links as rapids where the machine drives them straight; its blocks end where they did
    let rapid = exported(&place, &["--format", "gcode", "--rapid"], "plan.unverified.ngc");
    assert!(rapid.lines().filter(|line| line.starts_with("G0 ")).count() > 1);
    let ends = |text: &str| -> Vec<String> {
        let blocks = text.lines().filter(|line| line.starts_with("G0 ") || line.starts_with("G1 "));
        blocks.map(|line| line[3..].split(" F").next().unwrap().to_owned()).collect()
    };
    assert_eq!(ends(&text), ends(&rapid));
    place
        .run(&["export", "plan", "--unverified", "--format", "urscript"])
        .refused(&["bone-attached", "ur3e, ur5e, ur10e"]);
    // with the other sense of rotation
    let place = Place::healthy().with_case("spin = -1", "spin = 1");
    planned(&place);
    assert!(exported(&place, &["--format", "gcode"], "plan.unverified.ngc").contains(" M4\n"));
}

#[test]
fn obstacles_are_a_planning_scene_for_ros() {
    let place = Place::healthy().with_case("rate_hz = 100", UR);
    let text = fs::read_to_string(place.path("case.toml")).unwrap();
    let lamp = "[[obstacle]]\nname = \"lamp\"\nframe = \"ct\"\nbox = { min_mm = [-900, -60, 600], max_mm = [-700, 60, 900] }\n";
    fs::write(place.path("case.toml"), format!("{text}\n{lamp}")).unwrap();
    let plan = planned(&place);
    let json = exported(&place, &["--format", "ros"], "plan.unverified.scene.json");
    let read: serde_json::Value = serde_json::from_str(&json).unwrap();
    let object = &read["world"]["collision_objects"][0];
    assert!(read["is_diff"] == true && object["id"] == "lamp" && object["header"]["frame_id"] == "base");
    assert_eq!(object["primitives"][0], serde_json::json!({ "type": 1, "dimensions": [0.2, 0.12, 0.3] }));
    let pose = &object["primitive_poses"][0];
    let at = ["x", "y", "z"].map(|k| pose["position"][k].as_f64().unwrap() * 1e3);
    let turn = ["w", "x", "y", "z"].map(|k| pose["orientation"][k].as_f64().unwrap());
    let turn = nalgebra::UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(
        turn[0], turn[1], turn[2], turn[3],
    ));
    let base_from_ct = plan.record.frames.base_from_ct;
    // a corner of the box, there and here
    let corner = nalgebra::Vector3::from(at) + turn * nalgebra::Vector3::new(100.0, 60.0, 150.0);
    let there = base_from_ct * bonemill_geometry::Point::new(-700.0, 60.0, 900.0);
    assert!((corner - there.coords).norm() < 1e-5, "{corner} {there:?}");
}
