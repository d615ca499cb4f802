//! Forces toward structures are written, read back, and damaged.

use std::fs;

use bonemill_case::LabelRef;

use super::*;

fn structures() -> [Structure; 2] {
    ["facial_nerve", "sinus and dura"].map(|name| Structure {
        name: name.into(),
        label: LabelRef::Number(1),
        clearance_mm: 1.0,
        priority: 1,
        shank_clearance_mm: 0.0,
    })
}

fn rows() -> Vec<ForceToward> {
    let row = |waypoint, structure, force_toward_n, deflection_toward_um| ForceToward {
        waypoint,
        structure,
        distance_mm: 10.0 / 3.0,
        toward: Vector3::new(1.0, 2.0, -3.0).normalize(),
        force_toward_n,
        peak_toward_n: 1.5 * force_toward_n,
        mean_toward_n: 0.75 * force_toward_n,
        deflection_toward_um,
    };
    vec![row(0, 1, 0.0, None), row(2, 0, 1.0 / 7.0, Some(0.25)), row(2, 1, 1e-9, Some(0.0))]
}

#[test]
fn every_digit_comes_back() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(FORCES);
    write_forces(&path, &rows(), &structures()).unwrap();
    let text = fs::read_to_string(&path).unwrap();
    assert_eq!(text.lines().next(), Some(COLUMNS.join(",").as_str()));
    assert!(text.contains("\n2,facial_nerve,3.3333333333333335,0.267261241"), "{text}");
    assert_eq!(read_forces(&path, 3, &structures()).unwrap(), rows());
}

#[test]
fn damage_is_named_by_line_and_column() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(FORCES);
    write_forces(&path, &rows(), &structures()).unwrap();
    let sound = fs::read_to_string(&path).unwrap();
    for (from, to, says) in [
        ("index,structure", "structure,index", "forces.csv:1: found the header"),
        (
            "2,facial_nerve",
            "3,facial_nerve",
            "forces.csv:3: column `index`: found \"3\", expected a waypoint, below 3",
        ),
        ("0,sinus and dura", "0,nobody", "forces.csv:2: column `structure`: found \"nobody\""),
        (
            "2,facial_nerve",
            "2,sinus and dura",
            "forces.csv:4: column `index`: found \"2\", expected rows by waypoint",
        ),
        ("0.1428571428", "-0.1428571428", "forces.csv:3: column `force_toward_n`"),
        ("0.1428571428", "inf", "forces.csv:3: column `force_toward_n`"),
        ("0.267261241", "0.367261241", "forces.csv:2: column `toward_x`"),
        (",0.25\n", "\n", "forces.csv:3: found 9 cells, expected 10"),
    ] {
        assert!(sound.contains(from), "{from}");
        fs::write(&path, sound.replacen(from, to, 1)).unwrap();
        let error = read_forces(&path, 3, &structures()).unwrap_err().to_string();
        assert!(error.contains(says), "{from} -> {to}: {error}");
    }
    let mut wrong = rows();
    wrong[1].structure = 2;
    assert!(write_forces(&path, &wrong, &structures()).is_err());
    wrong[1] = ForceToward { distance_mm: f64::NAN, ..rows()[1] };
    let error = write_forces(&path, &wrong, &structures()).unwrap_err().to_string();
    assert!(error.contains("`distance_mm` toward facial_nerve at waypoint 2"), "{error}");
}
