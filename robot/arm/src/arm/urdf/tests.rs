//! Bad URDFs are refused with the fault's name, and for a good one the result agrees with that of `k`.

use super::*;
use crate::arm::bone_attached::URDF;

const LIMIT: &str = r#"<limit lower="-1" upper="1" velocity="1" effort="1"/>"#;

/// A robot of the given links, with joints (name, type, parent, child, inner XML).
fn robot(links: &[&str], joints: &[(&str, &str, &str, &str, &str)]) -> String {
    let links: String = links.iter().map(|link| format!("<link name=\"{link}\"/>")).collect();
    let joints = joints.iter().map(|(name, kind, parent, child, inner)| {
        format!("<joint name=\"{name}\" type=\"{kind}\"><parent link=\"{parent}\"/><child link=\"{child}\"/>{inner}</joint>")
    });
    format!("<robot name=\"r\">{links}{}</robot>", joints.collect::<String>())
}

/// One revolute joint a -> b with the given inner XML.
fn one(inner: &str) -> String {
    robot(&["a", "b"], &[("j", "revolute", "a", "b", inner)])
}

fn fault(text: &str) -> UrdfFault {
    match parse(text, "test.urdf") {
        Err(RobotError::Urdf { fault, .. }) => fault,
        other => panic!("expected a fault, got {other:?} from {text}"),
    }
}

#[test]
fn a_tree_must_be_one() {
    let hinge = |name, parent, child| (name, "revolute", parent, child, LIMIT);
    let cyclic = robot(
        &["root", "tip", "a", "b"],
        &[hinge("j", "root", "tip"), hinge("k", "a", "b"), hinge("l", "b", "a")],
    );
    assert!(matches!(fault(&cyclic), UrdfFault::Cycle { .. }));
    let ring = robot(&["a", "b"], &[hinge("k", "a", "b"), hinge("l", "b", "a")]);
    assert!(matches!(fault(&ring), UrdfFault::Cycle { .. }));
    let own_parent = robot(&["a"], &[hinge("k", "a", "a")]);
    assert!(matches!(fault(&own_parent), UrdfFault::Cycle { .. }));
    let dangling = robot(&["a", "b", "loose"], &[hinge("j", "a", "b")]);
    assert!(matches!(fault(&dangling), UrdfFault::Roots { roots } if roots == ["a", "loose"]));
    let unknown = robot(&["a", "b"], &[hinge("j", "a", "nowhere")]);
    assert!(matches!(fault(&unknown), UrdfFault::UnknownLink { link, .. } if link == "nowhere"));
    let two_parents =
        robot(&["a", "b", "c"], &[hinge("j", "a", "c"), hinge("k", "b", "c"), hinge("l", "a", "b")]);
    assert!(matches!(fault(&two_parents), UrdfFault::TwoParents { link, .. } if link == "c"));
    let two_tips = robot(&["a", "b", "c"], &[hinge("j", "a", "b"), hinge("k", "a", "c")]);
    assert!(matches!(fault(&two_tips), UrdfFault::Tips { tips } if tips == ["b", "c"]));
    let twice = robot(&["a", "b", "b"], &[hinge("j", "a", "b")]);
    assert!(matches!(fault(&twice), UrdfFault::DuplicateName { kind: "link", .. }));
    let twice = robot(&["a", "b", "c"], &[hinge("j", "a", "b"), hinge("j", "b", "c")]);
    assert!(matches!(fault(&twice), UrdfFault::DuplicateName { kind: "joint", .. }));
    assert!(matches!(fault(&robot(&[], &[])), UrdfFault::Roots { .. }));
}

#[test]
fn the_chain_leads_from_base_link_to_tool0() {
    let hinge = |name, parent, child| (name, "revolute", parent, child, LIMIT);
    let fixed = |name, parent, child| (name, "fixed", parent, child, "");
    let ur_like = robot(
        &["world", "base_link", "a", "camera", "tool0"],
        &[
            fixed("w", "world", "base_link"),
            hinge("j", "base_link", "a"),
            fixed("c", "a", "camera"),
            fixed("t", "a", "tool0"),
        ],
    );
    assert_eq!(parse(&ur_like, "ur").unwrap().segments.len(), 2);
    let moving_camera = ur_like.replace("name=\"c\" type=\"fixed\"", "name=\"c\" type=\"continuous\"");
    let moving_camera = moving_camera
        .replace("<child link=\"camera\"/>", "<child link=\"camera\"/><limit velocity=\"1\" effort=\"1\"/>");
    assert!(matches!(fault(&moving_camera), UrdfFault::MovesOffChain { joint, .. } if joint == "c"));
    let beside =
        robot(&["r", "base_link", "tool0"], &[fixed("x", "r", "base_link"), hinge("j", "r", "tool0")]);
    assert!(matches!(fault(&beside), UrdfFault::TipNotOnBase { .. }));
}

#[test]
fn something_must_move_and_only_in_ways_we_know() {
    assert!(matches!(fault(&robot(&["a"], &[])), UrdfFault::NoMovingJoint { .. }));
    let stiff = robot(&["a", "b"], &[("j", "fixed", "a", "b", "")]);
    assert!(matches!(fault(&stiff), UrdfFault::NoMovingJoint { .. }));
    for kind in ["floating", "planar", "spherical"] {
        let text = robot(&["a", "b"], &[("j", kind, "a", "b", LIMIT)]);
        assert!(matches!(fault(&text), UrdfFault::JointType { joint_type, .. } if joint_type == kind));
    }
    let mimic = robot(
        &["a", "b", "c"],
        &[
            ("j", "revolute", "a", "b", LIMIT),
            ("k", "revolute", "b", "c", &format!("{LIMIT}<mimic joint=\"j\"/>")),
        ],
    );
    assert!(matches!(fault(&mimic), UrdfFault::Mimic { leader, .. } if leader == "j"));
    let mimics_nothing = one(&format!("{LIMIT}<mimic joint=\"nobody\"/>"));
    assert!(matches!(fault(&mimics_nothing), UrdfFault::Mimic { .. }));
}

#[test]
fn lengths_in_mm_are_recognised() {
    let text = crate::Arm::ur(crate::ur::UrModel::Ur5e, None).unwrap().urdf_text().to_owned();
    let in_mm = |text: &str| -> String {
        let thousandfold = |list: &str| -> String {
            let numbers = list.split_whitespace().map(|n| (n.parse::<f64>().unwrap() * 1000.0).to_string());
            numbers.collect::<Vec<_>>().join(" ")
        };
        let mut parts = text.split("xyz=\"");
        let mut out = parts.next().unwrap().to_owned();
        for part in parts {
            let (list, rest) = part.split_once('"').unwrap();
            out += &format!("xyz=\"{}\"{rest}", thousandfold(list));
        }
        out
    };
    assert!(parse(&text, "ur").is_ok());
    for text in [&text, URDF] {
        let error = parse(&in_mm(text), "own.urdf").unwrap_err().to_string();
        assert!(error.contains("own.urdf"), "{error}");
        assert!(error.contains("looks like millimetres; URDF lengths are metres"), "{error}");
    }
    // as in calibrations: two parallel joints far apart along their axes
    let apart = text.replacen("xyz=\"-0.425 0.0 0.0\"", "xyz=\"-0.425 0.0 250.0\"", 1);
    let apart = apart.replacen("xyz=\"-0.3922 0.0 0.0\"", "xyz=\"-0.3922 0.0 -250.0\"", 1);
    assert!(apart.contains(" 250.0") && apart.contains(" -250.0"));
    assert!(parse(&apart, "ur").is_ok());
}

#[test]
fn numbers_must_be_finite_and_limits_a_range() {
    let limit = |lower: &str, upper: &str, velocity: &str| {
        one(&format!("<limit lower=\"{lower}\" upper=\"{upper}\" velocity=\"{velocity}\" effort=\"1\"/>"))
    };
    assert!(matches!(fault(&limit("NaN", "1", "1")), UrdfFault::NotFinite { .. }));
    assert!(matches!(fault(&limit("-1", "inf", "1")), UrdfFault::NotFinite { .. }));
    assert!(matches!(fault(&limit("-1", "1", "NaN")), UrdfFault::NotFinite { .. }));
    assert!(matches!(fault(&limit("1", "-1", "1")), UrdfFault::Range { .. }));
    assert!(matches!(fault(&limit("1", "1", "1")), UrdfFault::Range { .. }));
    assert!(matches!(fault(&limit("-1", "1", "0")), UrdfFault::Velocity { .. }));
    assert!(matches!(fault(&limit("-1", "1", "-2")), UrdfFault::Velocity { .. }));
    assert!(matches!(fault(&one("")), UrdfFault::Range { .. }), "a missing <limit>");
    let endless = robot(&["a", "b"], &[("j", "continuous", "a", "b", "")]);
    assert!(matches!(fault(&endless), UrdfFault::Velocity { .. }), "a missing velocity");
    let origin = one(&format!("<origin xyz=\"0 NaN 0\"/>{LIMIT}"));
    assert!(matches!(fault(&origin), UrdfFault::NotFinite { field: "origin xyz [m]", .. }));
    let turned = one(&format!("<origin rpy=\"0 inf 0\"/>{LIMIT}"));
    assert!(matches!(fault(&turned), UrdfFault::NotFinite { field: "origin rpy [rad]", .. }));
    assert!(matches!(fault(&one(&format!("<axis xyz=\"0 0 0\"/>{LIMIT}"))), UrdfFault::Axis { .. }));
    assert!(matches!(fault(&one(&format!("<axis xyz=\"0 NaN 1\"/>{LIMIT}"))), UrdfFault::NotFinite { .. }));
}

#[test]
fn limits_in_other_units_are_refused() {
    let limit = |inner: &str| one(&format!("<limit effort=\"1\" {inner}/>"));
    for (inner, at) in [
        (r#"lower="-360" upper="360" velocity="3""#, "lower"),
        (r#"lower="0" upper="180" velocity="3""#, "upper"),
        (r#"lower="-3" upper="3" velocity="180""#, "velocity"),
        (r#"lower="-3" upper="3" velocity="1e300""#, "velocity"),
        (r#"lower="-3" upper="3" velocity="1e-300""#, "velocity"),
        (r#"lower="-3" upper="3" velocity="3" acceleration="0""#, "acceleration"),
        (r#"lower="-3" upper="3" velocity="3" acceleration="NaN""#, "acceleration"),
        (r#"lower="-3" upper="3" velocity="3" jerk="-1""#, "jerk"),
    ] {
        assert!(matches!(fault(&limit(inner)), UrdfFault::Limit { field, .. } if field == at), "{inner}");
    }
    let text = limit(r#"lower="-3" upper="3" velocity="3" jerk="fast""#);
    assert!(matches!(fault(&text), UrdfFault::LimitText { field: "jerk", text, .. } if text == "fast"));
    // a continuous joint's range is not read
    let endless = r#"<limit lower="-1e9" upper="1e9" velocity="1" effort="1"/>"#;
    assert!(parse(&robot(&["a", "b"], &[("j", "continuous", "a", "b", endless)]), "test.urdf").is_ok());
}

#[test]
fn accelerations_and_jerks_of_a_limit_are_read() {
    let limit = |inner: &str| format!("<limit lower='-1' upper='1' velocity='1' effort='1' {inner}/>");
    let joints = |kind, inner: &str| {
        let text = robot(&["a", "b"], &[("j", kind, "a", "b", &limit(inner))]);
        parse(&text, "test.urdf").unwrap().joints.remove(0)
    };
    let own = joints("revolute", "acceleration='2.5' jerk='40'");
    assert_eq!((own.acceleration_limit, own.jerk_limit), (2.5, 40.0));
    let own = joints("prismatic", "acceleration='2.5'");
    assert_eq!((own.acceleration_limit, own.jerk_limit), (2500.0, assumed_jerk(2500.0)));
    assert_eq!(joints("revolute", "").acceleration_limit, assumed_acceleration(1.0));
}

/// `urdf-rs` panicked on some of these, found by fuzzing.
#[test]
fn names_in_namespaces_that_nothing_declares_are_refused() {
    let limit = "lower='-1' upper='1' velocity='1' effort='1'";
    for inner in [
        format!("<limit xmlns='x' {limit} :extra='0.6'/>"),
        format!("<limit {limit} :extra='0.6'/>"),
        format!("<limit {limit} a:extra='0.6'/>"),
        format!("<limit {limit} xmlns:a='u' a:extra='0.6'/>"),
        format!("<limit xmlns='' {limit}/>"),
        format!("<:limit {limit}/>"),
        format!("<a:limit {limit}/>"),
        format!("<limit {limit} xml:='1'/>"),
        format!("<limit {limit} xml:a:b='1'/>"),
    ] {
        let found = fault(&one(&inner));
        assert!(matches!(found, UrdfFault::Namespace { .. }), "{inner}: {found}");
    }
    for inner in [format!("<limit {limit} lower='0'/>"), format!("<limit {limit}></limits>"), "<limit".into()]
    {
        let found = fault(&one(&inner));
        assert!(matches!(found, UrdfFault::Xml { .. }), "{inner}: {found}");
    }
    // names as xacro and Gazebo write them
    let text = one(&format!("{LIMIT}<g:sensor xml:lang='en' g:rate='3'/>"));
    let text =
        text.replace("name=\"r\"", "name=\"r\" xmlns:xacro=\"http://www.ros.org/wiki/xacro\" xmlns:g='u'");
    assert_eq!(parse(&text, "test.urdf").unwrap().joints.len(), 1);
}

#[test]
fn what_is_no_urdf_is_said_to_be_none() {
    for text in ["", "not xml", "<robot", "<robot name=\"r\"><joint/></robot>", "<html></html>"] {
        let error = parse(text, "some.urdf").unwrap_err().to_string();
        assert!(error.contains("some.urdf"), "{text:?}: {error}");
    }
}

#[test]
fn metres_become_millimetres_and_speeds_come_along() {
    let text = robot(
        &["a", "b"],
        &[(
            "j",
            "prismatic",
            "a",
            "b",
            r#"<origin xyz="0 0 0.5"/><limit lower="-0.1" upper="0.2" velocity="0.03" effort="1"/>"#,
        )],
    );
    let Description { segments, joints, .. } = parse(&text, "test").unwrap();
    assert_eq!(segments[0].translation_mm.z, 500.0);
    let joint = &joints[0];
    assert_eq!((joint.lower, joint.upper, joint.velocity_limit), (-100.0, 200.0, 30.0));
    assert_eq!(joint.acceleration_limit, 300.0);
}

#[test]
fn the_pose_is_k_s_own() {
    // k's own forward kinematics, in metres, on its own nalgebra
    let robot = urdf_rs::read_from_string(URDF).unwrap();
    let chain = k::Chain::<f64>::from(&robot);
    let arm = crate::Arm::bone_attached().unwrap();
    for q_mm in [[0.0; 4], [12.0, -7.5, 33.0, 0.4], [-80.0, 39.0, -70.0, -1.2]] {
        let q_m = [q_mm[0] / 1000.0, q_mm[1] / 1000.0, q_mm[2] / 1000.0, q_mm[3]];
        chain.set_joint_positions(&q_m).unwrap();
        chain.update_transforms();
        let theirs = chain.find("burr_mount").unwrap().world_transform().unwrap();
        let ours = arm.forward(&q_mm).unwrap();
        for row in 0..3 {
            let off_mm = theirs.translation.vector[row] * 1000.0 - ours.translation_mm[row];
            assert!(off_mm.abs() < 1e-12 * 100.0, "row {row} off by {off_mm} mm");
        }
    }
}
