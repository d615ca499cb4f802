//! Both texts are read back by independent parsers and compared with the rows.

use bonemill_arm::{Arm, Joint};
use saphyr::{LoadableYamlNode, Yaml};

use super::*;

/// A motion of the bone-attached arm: mm and rad, at 500 Hz.
fn motion() -> (Vec<Joint>, Vec<f64>, Vec<f64>, Vec<f64>) {
    let joints = Arm::bone_attached().unwrap().joints().to_vec();
    let time_s: Vec<f64> = (0..1003).map(|k| f64::from(k) * 0.002).collect();
    let q = time_s.iter().flat_map(|t| [10.0 * t.sin(), -3.0 + t, 1e-7 * t, 0.1 * t]).collect();
    let qd = time_s.iter().flat_map(|t| [10.0 * t.cos(), 1.0, 1e-7, 0.1]).collect();
    (joints, time_s, q, qd)
}

fn get<'a, 'i>(node: &'a Yaml<'i>, key: &str) -> &'a Yaml<'i> {
    node.as_mapping_get(key).unwrap()
}

fn number(value: &Yaml<'_>) -> f64 {
    value.as_floating_point().or_else(|| value.as_integer().map(|whole| whole as f64)).unwrap()
}

fn check(text: &str, stride: usize) {
    let (joints, time_s, q, qd) = motion();
    let document = Yaml::load_from_str(text).unwrap().remove(0);
    let names: Vec<String> = get(&document, "joint_names")
        .as_sequence()
        .unwrap()
        .iter()
        .map(|name| name.as_str().unwrap().to_owned())
        .collect();
    assert_eq!(names, joints.iter().map(|joint| joint.name.clone()).collect::<Vec<_>>());
    let points = get(&document, "points").as_sequence().unwrap();
    assert_eq!(points.len(), 1002_usize.div_ceil(stride) + 1);
    for (n, point) in points.iter().enumerate() {
        let at = (n * stride).min(1002);
        let stamp = get(point, "time_from_start");
        let read_s = number(get(stamp, "sec")) + 1e-9 * number(get(stamp, "nanosec"));
        assert!((read_s - time_s[at]).abs() < 1e-9);
        for (key, values) in [("positions", &q), ("velocities", &qd)] {
            let read: Vec<f64> = get(point, key).as_sequence().unwrap().iter().map(number).collect();
            assert_eq!(read.len(), 4);
            for j in 0..4 {
                let metres = if j < 3 { 1e-3 } else { 1.0 };
                assert!(
                    (read[j] - values[4 * at + j] * metres).abs() <= 0.5e-9 + 1e-15,
                    "{key}[{j}] of point {n}"
                );
            }
        }
    }
}

#[test]
fn json_and_yaml_read_back_equal() {
    let (joints, time_s, q, qd) = motion();
    for stride in [1, 10, 7] {
        let rows = ExportRows::new(&joints, &time_s, &q, &qd, stride).unwrap();
        let (mut json, mut yaml) = (Vec::new(), Vec::new());
        write_ros_json(&mut json, &rows).unwrap();
        write_ros_yaml(&mut yaml, &rows, &["what must hold: [1] \"a\"".to_owned()]).unwrap();
        // JSON is also YAML; the command's tests check with a JSON parser that it is JSON
        check(std::str::from_utf8(&json).unwrap(), stride);
        check(std::str::from_utf8(&yaml).unwrap(), stride);
    }
}

#[test]
fn whole_numbers_keep_their_point_and_names_their_quotes() {
    assert_eq!(list(&[1.0, -0.0, 2.5, 1e-9, -1e-10]), "[1.0, 0.0, 2.5, 0.000000001, 0.0]");
    assert_eq!(quoted("a\"b\\c\n"), "\"a\\\"b\\\\c\\u000a\"");
}

#[test]
fn lists_that_do_not_match_are_refused() {
    let (joints, time_s, q, qd) = motion();
    assert!(ExportRows::new(&joints, &[], &[], &[], 1).is_err());
    assert!(ExportRows::new(&joints, &time_s, &q[1..], &qd, 1).is_err());
    assert!(ExportRows::new(&joints, &time_s, &q, &qd[4..], 1).is_err());
}
