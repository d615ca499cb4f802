//! Plans for every kind of arm: the burr follows the waypoints, limits hold, and what an arm cannot do is reported.

use std::fs;
use std::ops::Range;

use crate::support::place::Place;
use bonemill_planner::plan::{StoredPlan, Value};
use bonemill_robot::Arm;
use bonemill_robot::ur::UrModel;
use nalgebra::Vector3;

/// A handpiece bent by 30° on the flange.
const MOUNT: &str =
    "flange_from_burr = { translation_mm = [0, -90, 155], rpy_rad = [2.617993877991494, 0, 0] }";

fn with_robot(lines: &str) -> Place {
    Place::healthy().with_case("rate_hz = 100", &format!("rate_hz = 500\n{lines}"))
}

#[track_caller]
fn planned(place: &Place) -> StoredPlan {
    let ran = place.plan();
    assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
    StoredPlan::load(&place.path("plan")).unwrap()
}

/// A pose of the polyline: burr's centre and axis, in base.
type Pose = (Vector3<f64>, Vector3<f64>);

/// Deviation of a pose from the polyline's segment: mm and mrad at the place where `angle_mrad/5 + mm/0.05` is least.
fn to_segment(pose: &Pose, from: &Pose, to: &Pose) -> (f64, f64) {
    let at = |share: f64| {
        let p = from.0 + (to.0 - from.0) * share;
        let a = (from.1 + (to.1 - from.1) * share).normalize();
        ((pose.0 - p).norm(), pose.1.angle(&a) * 1e3)
    };
    let size = |(mm, mrad): (f64, f64)| (mm / 0.05).max(mrad / 5.0);
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..40 {
        let [m1, m2] = [low + (high - low) / 3.0, high - (high - low) / 3.0];
        if size(at(m1)) < size(at(m2)) { high = m2 } else { low = m1 }
    }
    [at(0.0), at(1.0), at(low)].into_iter().min_by(|a, b| size(*a).total_cmp(&size(*b))).unwrap()
}

/// The same of the nearest of some segments, each named by its end; the one looked at first lets most others be left out.
fn to_polyline(pose: &Pose, poses: &[Pose], first: usize, others: Range<usize>) -> (f64, f64) {
    let size = |(mm, mrad): (f64, f64)| mm / 0.05 + mrad / 5.0;
    let mut best = (f64::INFINITY, f64::INFINITY);
    for k in std::iter::once(first).chain(others) {
        let (from, to) = (&poses[k - 1], &poses[k]);
        let way = to.0 - from.0;
        let share = ((pose.0 - from.0).dot(&way) / way.norm_squared().max(1e-12)).clamp(0.0, 1.0);
        if size(((pose.0 - from.0 - way * share).norm(), 0.0)) < size(best) {
            let off = to_segment(pose, from, to);
            best = if size(off) < size(best) { off } else { best };
        }
    }
    best
}

/// Checks that every row of the trajectory follows the waypoints' polyline, at rest at both ends and inside joint limits.
fn follows(plan: &StoredPlan) {
    let base_from_ct = plan.record.frames.base_from_ct;
    let poses: Vec<Pose> = plan
        .waypoints
        .iter()
        .map(|w| ((base_from_ct * w.position).coords, base_from_ct.rotate(&w.axis)))
        .collect();
    let trajectory = &plan.trajectory;
    let (mut worst_mm, mut worst_mrad, mut fastest) = (0f64, 0f64, 0f64);
    let mut before: Option<Vector3<f64>> = None;
    for row in 0..trajectory.len() {
        let (q, time_s) = (trajectory.q_at(row), trajectory.time_s[row]);
        assert_eq!(plan.arm.beyond_limits(q).unwrap(), None);
        for (qd, joint) in trajectory.qd_at(row).iter().zip(plan.arm.joints()) {
            assert!(qd.abs() <= joint.velocity_limit * (1.0 + 1e-6));
        }
        let tool = plan.arm.burr(q).unwrap();
        let pose = (tool.translation_mm, tool.rotation * Vector3::z());
        let on = plan.waypoints.partition_point(|w| w.time_s <= time_s).clamp(1, poses.len() - 1);
        let near = on.saturating_sub(6).max(1)..(on + 7).min(poses.len());
        let (mm, mrad) = to_polyline(&pose, &poses, on, near.clone());
        (worst_mm, worst_mrad) = (worst_mm.max(mm), worst_mrad.max(mrad));
        if let Some(before) = before {
            let speed = (pose.0 - before).norm() * 500.0;
            let cap = near.map(|k| plan.waypoints[k].speed_mm_s).fold(0.0, f64::max);
            fastest = fastest.max(speed / cap);
        }
        before = Some(pose.0);
    }
    assert!(
        worst_mm < 0.05 && worst_mrad < 5.0,
        "{worst_mm} mm, {worst_mrad} mrad off the waypoints' polyline"
    );
    assert!(fastest < 1.0 + 1e-3, "{fastest} of the cap");
    for row in [0, trajectory.len() - 1] {
        assert!(trajectory.qd_at(row).iter().all(|qd| *qd == 0.0));
    }
}

#[test]
fn the_bone_attached_arm_follows_its_plan() {
    follows(&planned(&with_robot("")));
}

#[test]
fn every_ur_follows_its_plan() {
    for model in UrModel::ALL {
        let place = with_robot(&format!("model = \"{}\"\n{MOUNT}", model.name()));
        let plan = planned(&place);
        assert!(
            plan.record.warnings.iter().any(|w| w.contains("nominal kinematics")),
            "{:?}",
            plan.record.warnings
        );
        assert!(plan.record.frames.registration_assumed);
        // the plan's URDF describes the arm
        let nominal = Arm::ur(model, None).unwrap();
        let q = plan.trajectory.q_at(0);
        let apart = plan.arm.forward(q).unwrap().translation_mm - nominal.forward(q).unwrap().translation_mm;
        assert!(apart.norm() < 1e-9);
        follows(&plan);
        // the tool stays above the base's plane and away from its axis
        for row in (0..plan.trajectory.len()).step_by(500) {
            let tool = plan.arm.burr(plan.trajectory.q_at(row)).unwrap().translation_mm;
            assert!(tool.x.hypot(tool.y) > 0.3 * model.reach_mm() && tool.z > -0.1 * model.reach_mm());
        }
    }
}

#[test]
fn a_urdf_of_one_s_own_is_followed_by_damped_least_squares() {
    let text = Arm::ur(UrModel::Ur5e, None).unwrap().urdf_text().to_owned();
    let place = with_robot(&format!("model = \"own.urdf\"\n{MOUNT}"));
    fs::write(place.path("own.urdf"), &text).unwrap();
    place.refuses(&[&place.line_of("own.urdf"), "robot.base_from_ct is needed", "translation_mm"]);
    let place = with_robot(&format!(
        "model = \"own.urdf\"\n{MOUNT}\n\
         base_from_ct = {{ rotation = [[1, 0, 0], [0, 1, 0], [0, 0, 1]], translation_mm = [450, 0, 40] }}"
    ));
    fs::write(place.path("own.urdf"), &text).unwrap();
    let plan = planned(&place);
    assert!(plan.record.warnings.iter().any(|w| w.contains("a UR's joints")), "{:?}", plan.record.warnings);
    follows(&plan);
    // the file is one of the plan's inputs
    fs::write(place.path("own.urdf"), text + "\n").unwrap();
    place.run(&["simulate", "plan"]).refused(&["own.urdf has changed since the plan was made"]);
}

/// The lowest place of a UR's links from the shoulder on, along its trajectory, mm.
fn lowest_link_mm(plan: &StoredPlan) -> f64 {
    let lowest = |row: usize| {
        let places = plan.arm.joint_places(plan.trajectory.q_at(row)).unwrap();
        places[1..].iter().map(|place| place.z()).fold(f64::INFINITY, f64::min)
    };
    (0..plan.trajectory.len()).map(lowest).fold(f64::INFINITY, f64::min)
}

fn modelled(plan: &StoredPlan, name: &str) -> Option<Value> {
    plan.record.modelled.iter().find(|(key, _)| key == name).map(|(_, value)| value.clone())
}

#[test]
fn a_ur_s_elbow_stays_above_its_mounting_plane() {
    let says_below = |plan: &StoredPlan| plan.record.warnings.iter().any(|w| w.contains("mounting plane"));
    for model in UrModel::ALL {
        let plan = planned(&with_robot(&format!("model = \"{}\"\n{MOUNT}", model.name())));
        assert!(lowest_link_mm(&plan) > 0.0 && !says_below(&plan), "{model:?}: {}", lowest_link_mm(&plan));
        let branch = format!("{:?}", modelled(&plan, "branch_name"));
        assert!(model != UrModel::Ur5e || branch.contains("elbow-up"), "{branch}");
    }
    // a requested branch is taken, and the plan states how far below the plane the arm goes
    let place =
        with_robot(&format!("model = \"ur5e\"\n{MOUNT}\nbranch = \"elbow-down\"\nlink_clearance_mm = 4"));
    let plan = planned(&place);
    let lowest_mm = lowest_link_mm(&plan);
    assert!(lowest_mm < -10.0 && says_below(&plan), "{lowest_mm} mm: {:?}", plan.record.warnings);
    assert!(format!("{:?}", modelled(&plan, "branch_name")).contains("elbow-down"));
    let Some(Value::Number(said_mm)) = modelled(&plan, "lowest_link_mm") else { panic!("not said") };
    assert!((said_mm - lowest_mm).abs() < 0.1, "says {said_mm}, is {lowest_mm}");
    assert!(fs::read_to_string(place.path("plan/report.html")).unwrap().contains("elbow down"));
    // verify finds the same, and no plan may go farther below than it states
    let verdict = || -> toml::Table {
        fs::read_to_string(place.path("plan/verification.toml")).unwrap().parse().unwrap()
    };
    assert_eq!(place.run(&["verify", "plan"]).code, 0);
    assert!(verdict().to_string().contains("links over the mounting plane"));
    let text = fs::read_to_string(place.path("plan/plan.toml")).unwrap();
    let line = text.lines().find(|line| line.starts_with("lowest_link_mm = ")).unwrap();
    fs::write(place.path("plan/plan.toml"), text.replace(line, "lowest_link_mm = 12.5")).unwrap();
    let ran = place.run(&["verify", "plan"]);
    assert!(ran.code == 1 && ran.out.contains("links over the mounting plane"), "{}", ran.out);

    for (branch, says) in
        [("\"elbow\"", "elbow-up"), ("8", "0 to 7"), ("\"elbow-up/elbow-down\"", "wrist-positive")]
    {
        let place = with_robot(&format!("model = \"ur5e\"\n{MOUNT}\nbranch = {branch}"));
        place.refuses(&[&place.line_of("branch = "), "robot.branch", says]);
    }
    let place = with_robot("branch = 2");
    place.refuses(&["robot.branch", "ur3e, ur5e, ur10e"]);
}

/// An arm with seven joints whose wrist bends by at most 57°, so it cannot take all directions within 60° of the vertical.
const SEVEN: &str = r#"<robot name="seven">
<link name="base_link"/><link name="l1"/><link name="l2"/><link name="l3"/><link name="l4"/><link name="l5"/><link name="l6"/><link name="tool0"/>
<joint name="a1" type="revolute"><parent link="base_link"/><child link="l1"/><origin xyz="0 0 0.36"/><axis xyz="0 0 1"/>
<limit lower="-2.97" upper="2.97" velocity="1.7" effort="1"/></joint>
<joint name="a2" type="revolute"><parent link="l1"/><child link="l2"/><axis xyz="0 1 0"/>
<limit lower="-2.09" upper="2.09" velocity="1.7" effort="1"/></joint>
<joint name="a3" type="revolute"><parent link="l2"/><child link="l3"/><origin xyz="0 0 0.42"/><axis xyz="0 0 1"/>
<limit lower="-2.97" upper="2.97" velocity="1.7" effort="1"/></joint>
<joint name="a4" type="revolute"><parent link="l3"/><child link="l4"/><axis xyz="0 -1 0"/>
<limit lower="-2.09" upper="2.09" velocity="2.2" effort="1"/></joint>
<joint name="a5" type="revolute"><parent link="l4"/><child link="l5"/><origin xyz="0 0 0.4"/><axis xyz="0 0 1"/>
<limit lower="-2.97" upper="2.97" velocity="2.4" effort="1"/></joint>
<joint name="a6" type="revolute"><parent link="l5"/><child link="l6"/><axis xyz="0 1 0"/>
<limit lower="-1.0" upper="1.0" velocity="3.1" effort="1"/></joint>
<joint name="a7" type="revolute"><parent link="l6"/><child link="tool0"/><origin xyz="0 0 0.126"/><axis xyz="0 0 1"/>
<limit lower="-3.05" upper="3.05" velocity="3.1" effort="1"/></joint>
</robot>"#;

#[test]
fn an_arm_is_asked_only_for_axes_that_it_can_take() {
    let place = with_robot(
        "model = \"seven.urdf\"\n\
         flange_from_burr = { translation_mm = [0, 0, 180], rpy_rad = [3.141592653589793, 0, 0] }\n\
         base_from_ct = { rotation = [[1, 0, 0], [0, 1, 0], [0, 0, 1]], translation_mm = [520, 0, 50] }",
    );
    fs::write(place.path("seven.urdf"), SEVEN).unwrap();
    let plan = planned(&place);
    follows(&plan);
    assert_eq!(place.run(&["verify", "plan"]).code, 0);
    // the limit is reached somewhere on the path
    let most = (0..plan.trajectory.len()).map(|row| plan.trajectory.q_at(row)[5].abs()).fold(0.0, f64::max);
    assert!(most > 0.8 && most <= 1.0, "{most} rad");

    let place = Place::healthy().with_case("rate_hz = 100", "model = \"seven.urdf\"");
    fs::write(place.path("seven.urdf"), SEVEN.replace("xyz=\"0 0 0.", "xyz=\"0 0 9")).unwrap();
    place.refuses(&[&place.line_of("seven.urdf"), "looks like millimetres; URDF lengths are metres"]);
}

#[test]
fn any_angles_of_a_rotation_pass_verify() {
    // angles at gimbal lock, and beyond half a turn; the patient is where a UR5e reaches with this mount
    for (mount_rpy, base_rpy, at) in [
        ("[0, 3.141592653589793, 0]", "[0, 0, 0]", "[450, 0, 40]"),
        ("[0, 2.6, 0]", "[3.141592653589793, 3.141592653589793, 3.141592653589793]", "[450, 0, 40]"),
        ("[3.5, 0, 0]", "[0, 0, 6.5]", "[450, 0, 40]"),
        ("[3.141592653589793, 0.5, 3.9]", "[0, -1.5707963267948966, 0.4]", "[350, 0, 300]"),
    ] {
        let place = with_robot(&format!(
            "model = \"ur5e\"\nflange_from_burr = {{ translation_mm = [0, 0, 180], rpy_rad = {mount_rpy} }}\n\
             base_from_ct = {{ rpy_rad = {base_rpy}, translation_mm = {at} }}"
        ));
        planned(&place);
        let ran = place.run(&["verify", "plan"]);
        assert_eq!(ran.code, 0, "{mount_rpy} {base_rpy}: {}{}", ran.out, ran.err);
    }
}

#[test]
fn a_ur_without_a_tool_is_refused_with_an_example() {
    let place = with_robot("model = \"ur5e\"");
    place.refuses(&[
        &place.line_of("ur5e"),
        "robot.flange_from_burr is needed",
        "translation_mm = [0, 0, 180]",
    ]);
}

#[test]
fn a_calibration_is_used_and_a_wrong_one_refused() {
    let calibration = "mounting:\n  delta_theta: [1e-4, -2e-4, 3e-4, 1e-4, 0, 0]\n  delta_a: [0, 0.0004, -0.0003, 0, 0, 0]\n  \
                       delta_d: [0.0002, 0, 0, 0.0001, 0, 0]\n  delta_alpha: [0.0005, -0.0004, 0.0003, 0.0002, 0, 0]\n";
    let robot = format!("model = \"ur5e\"\n{MOUNT}\ncalibration = \"arm.yaml\"");
    let place = with_robot(&robot);
    fs::write(place.path("arm.yaml"), calibration).unwrap();
    let plan = planned(&place);
    assert!(!plan.record.warnings.iter().any(|w| w.contains("nominal")), "{:?}", plan.record.warnings);
    follows(&plan);
    assert!(plan.record.inputs.iter().any(|input| input.path.ends_with("arm.yaml")));
    let place = with_robot(&robot);
    place.refuses(&[&place.line_of("arm.yaml"), "cannot read the calibration", "arm.yaml"]);
    fs::write(place.path("arm.yaml"), "some: thing\n").unwrap();
    place.refuses(&[&place.line_of("arm.yaml"), "expected delta_theta"]);
    // the calibration of another model, and one in degrees, are refused with the file's name
    for (key, value, why) in [
        ("delta_a", "[0, -0.2, 0, 0, 0, 0]", "another model"),
        ("delta_alpha", "[0, 0, 0, 0, 0, 0.5]", "turned"),
    ] {
        let zeros = "[0, 0, 0, 0, 0, 0]";
        let keys = ["delta_theta", "delta_a", "delta_d", "delta_alpha"];
        let text: String = keys.map(|k| format!("{k}: {}\n", if k == key { value } else { zeros })).concat();
        fs::write(place.path("arm.yaml"), text).unwrap();
        place.refuses(&[&place.line_of("arm.yaml"), "arm.yaml", why]);
    }
    let place = with_robot("calibration = \"arm.yaml\"");
    place.refuses(&["robot.calibration", "ur3e, ur5e, ur10e"]);
}

#[test]
fn the_burr_s_stiffness_along_the_path_is_told() {
    let joints = [30.0, 40.0, 50.0, 2e4];
    let plan = planned(&with_robot(&format!("joint_stiffness = {joints:?}")));
    let told =
        plan.record.metrics.more.iter().find(|(key, _)| key == "stiffness_n_mm").map(|(_, value)| value);
    let Some(Value::Table(told)) = told else { panic!("{told:?}") };
    let number = |name: &str| match told.iter().find(|(key, _)| key == name) {
        Some((_, Value::Number(number))) => *number,
        other => panic!("{other:?}"),
    };
    let t = &plan.trajectory;
    let softest = (0..t.len()).map(|row| {
        let compliance = plan.arm.compliance(t.q_at(row), &joints).unwrap();
        1.0 / compliance.symmetric_eigenvalues().max()
    });
    // the trajectory passes between the waypoints, too
    let softest = softest.fold(f64::INFINITY, f64::min);
    assert!((number("softest") / softest - 1.0).abs() < 0.02, "{} and {softest} N/mm", number("softest"));
    assert!(
        number("softest") < number("mean_softest") && number("least_toward_structure") >= number("softest")
    );
}

#[test]
fn limits_that_make_a_motion_endless_are_refused() {
    let place =
        with_robot("acceleration_limits = [1e-6, 1e-6, 1e-6, 1e-6]\njerk_limits = [1e-6, 1e-6, 1e-6, 1e-6]");
    place.refuses(&["500 Hz", "rows", "limits"]);
}

#[test]
fn an_arm_that_stands_too_far_away_is_told_by_how_much() {
    let place = with_robot(&format!(
        "model = \"ur3e\"\n{MOUNT}\n\
         base_from_ct = {{ rotation = [[1, 0, 0], [0, 1, 0], [0, 0, 1]], translation_mm = [900, 0, 40] }}"
    ));
    place.falls_short_of_a_plan(&["reaches none of", "would have to be", "mm nearer", "robot.base_from_ct"]);
}

#[test]
fn a_target_beyond_every_posture_is_told_before_a_path_is_laid() {
    for robot in [format!("model = \"ur5e\"\n{MOUNT}"), "model = \"bone-attached\"".into()] {
        let place = with_robot(&format!(
            "{robot}\nbase_from_ct = {{ rotation = [[1, 0, 0], [0, 1, 0], [0, 0, 1]], translation_mm = [3000, 0, 0] }}"
        ));
        let ran = place.run(&["plan", "case.toml", "--out", "plan"]);
        ran.failed(
            1,
            &[
                &place.line_of("base_from_ct"),
                "cannot reach the target",
                "it reaches at most",
                "robot.base_from_ct",
            ],
        );
        // stages are told on stderr
        assert!(
            ran.err.contains("scene") && !ran.err.contains("free space") && !ran.err.contains("path\n"),
            "{}",
            ran.err
        );
    }
}

#[test]
fn a_base_in_metres_is_told_before_a_path_is_laid() {
    let place = with_robot(&format!(
        "model = \"ur5e\"\n{MOUNT}\nbase_from_ct = {{ rotation = [[1, 0, 0], [0, 1, 0], [0, 0, 1]], translation_mm = [0.3, 0.2, 0.1] }}"
    ));
    let ran = place.run(&["plan", "case.toml", "--out", "plan"]);
    ran.failed(
        1,
        &[&place.line_of("base_from_ct"), "within 64 mm of it is the base itself", "given in metres"],
    );
    assert!(ran.err.contains("scene") && !ran.err.contains("free space"), "{}", ran.err);
}

#[test]
fn a_tool_that_no_arm_can_hold_is_refused_and_a_near_one_told() {
    let with_mount = |mount: &str| with_robot(&format!("model = \"ur5e\"\nflange_from_burr = {{ {mount} }}"));
    for (mount, why) in [
        (
            "translation_mm = [0, 0, 180], rpy_rad = [0, 0, 0]",
            "points away from the flange, which lies 180.0 mm in front",
        ),
        (
            "translation_mm = [0, 0, 0.18], rpy_rad = [3.141592653589793, 0, 0]",
            "looks like metres, which would be 180 mm",
        ),
        (
            "translation_mm = [0, 0, -180], rpy_rad = [0, 0, 0]",
            "within the arm, 180.00 mm behind the flange's face",
        ),
    ] {
        let place = with_mount(mount);
        place.refuses(&[&place.line_of("flange_from_burr"), "robot.flange_from_burr", why]);
    }
    // so near, the arm itself is in the patient
    let near = "translation_mm = [0, 0, 19], rpy_rad = [3.141592653589793, 0, 0]";
    let plan =
        planned(&with_robot(&format!("model = \"ur5e\"\nhead = \"none\"\nflange_from_burr = {{ {near} }}")));
    assert!(
        plan.record.warnings.iter().any(|w| w.contains("only 19.00 mm from the flange")),
        "{:?}",
        plan.record.warnings
    );
}
