//! Waypoints are written, read back, and damaged.

use std::path::PathBuf;

use bonemill_case::LabelRef;
use nalgebra::Vector3;
use proptest::prelude::*;

use super::*;

fn structures() -> Vec<Structure> {
    let structure = |name: &str| Structure {
        name: name.into(),
        label: LabelRef::Number(1),
        clearance_mm: 1.0,
        priority: 1,
        shank_clearance_mm: 0.0,
    };
    vec![structure("facial_nerve"), structure("sinus and dura")]
}

fn waypoint() -> impl Strategy<Value = Waypoint> {
    let v = || prop::array::uniform3(-1e3..1e3f64).prop_map(Vector3::from);
    let o = || prop::option::of(prop_oneof![-1e3..1e3f64, 1e-12..1e-9f64, Just(0.0)]);
    let kind = prop::sample::select(vec![MoveKind::Cut, MoveKind::Link, MoveKind::Retract]);
    let place = (0u32..99, kind, v(), v(), prop::array::uniform4(-9.0..9.0f64));
    let rest = (o(), v(), o(), prop::option::of(0usize..2), [o(), o(), o(), o()]);
    (place, rest).prop_map(|((layer, kind, p, a, n), (inertia, force_n, toward, structure, more))| Waypoint {
        layer,
        kind,
        time_s: 0.0,
        position: Point::from_coords(p),
        axis: a.normalize(),
        theta_rad: n[0],
        phi_rad: n[1],
        speed_mm_s: n[2],
        driven_mm_s: n[2],
        mass_mg: n[3],
        inertia,
        force_n,
        peak_force_n: n[2],
        mean_force_n: n[3],
        force_toward_n: toward,
        structure,
        distance_mm: more[0],
        alpha1: more[1],
        cost: more[2],
        deflection_toward_um: more[3],
    })
}

fn some_waypoints(n: usize) -> Vec<Waypoint> {
    (0..n)
        .map(|n| Waypoint {
            layer: 0,
            kind: MoveKind::Cut,
            time_s: n as f64 / 3.0,
            position: Point::new(0.1 * n as f64, -2.0, 1e-7),
            axis: Vector3::z(),
            theta_rad: 0.0,
            phi_rad: -0.0,
            speed_mm_s: 1.5,
            driven_mm_s: 1.25,
            mass_mg: 2.0 / 3.0,
            inertia: Some(0.75),
            force_n: Vector3::new(0.1, 0.2, 0.3),
            peak_force_n: 0.5,
            mean_force_n: 0.25,
            force_toward_n: None,
            structure: Some(1),
            distance_mm: Some(4.5),
            alpha1: None,
            cost: None,
            deflection_toward_um: None,
        })
        .collect()
}

fn file() -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("waypoints.csv");
    (dir, path)
}

proptest! {
    #[test]
    fn what_is_written_reads_back_bit_for_bit(mut points in prop::collection::vec(waypoint(), 0..40), dt in 0.0..1.0f64) {
        for (n, w) in points.iter_mut().enumerate() {
            w.time_s = n as f64 * dt;
        }
        let (_dir, path) = file();
        write_waypoints(&path, &points, &structures()).unwrap();
        prop_assert_eq!(read_waypoints(&path, &structures()).unwrap(), points);
    }

    #[test]
    fn no_file_makes_it_panic(text in "[a-z0-9,.\n-]{0,300}") {
        let (_dir, path) = file();
        std::fs::write(&path, format!("{}\n{text}", COLUMNS.join(","))).unwrap();
        let _ = read_waypoints(&path, &structures()).map_err(|e| e.to_string());
    }
}

#[test]
fn the_text_is_as_specified() {
    let (_dir, path) = file();
    write_waypoints(&path, &some_waypoints(2), &structures()).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    assert_eq!(
        text,
        "index,layer,kind,time_s,x_mm,y_mm,z_mm,axis_x,axis_y,axis_z,theta_rad,phi_rad,speed_mm_s,driven_mm_s,mass_mg,inertia,\
         fx_n,fy_n,fz_n,peak_force_n,mean_force_n,force_toward_n,structure,distance_mm,alpha1,cost,deflection_toward_um\n\
         0,0,cut,0.0,0.0,-2.0,1e-7,0.0,0.0,1.0,0.0,0.0,1.5,1.25,0.6666666666666666,0.75,0.1,0.2,0.3,0.5,0.25,,sinus and dura,4.5,,,\n\
         1,0,cut,0.3333333333333333,0.1,-2.0,1e-7,0.0,0.0,1.0,0.0,0.0,1.5,1.25,0.6666666666666666,0.75,0.1,0.2,0.3,0.5,0.25,,\
         sinus and dura,4.5,,,\n"
    );
}

#[test]
fn more_than_a_buffer_is_written_whole() {
    let (_dir, path) = file();
    let points = some_waypoints(5000);
    write_waypoints(&path, &points, &structures()).unwrap();
    assert_eq!(read_waypoints(&path, &structures()).unwrap().len(), 5000);
}

#[test]
fn damage_is_named_by_line_and_column() {
    let (_dir, path) = file();
    write_waypoints(&path, &some_waypoints(3), &structures()).unwrap();
    let good = std::fs::read_to_string(&path).unwrap();
    let damage = |from: &str, to: &str, parts: &[&str]| {
        assert!(good.contains(from), "{from}");
        std::fs::write(&path, good.replacen(from, to, 1)).unwrap();
        let message = read_waypoints(&path, &structures()).unwrap_err().to_string();
        for part in parts {
            assert!(message.contains(part), "{from} -> {to}: {message}");
        }
    };
    damage("\n1,0,", "\n2,0,", &["waypoints.csv:3:", "`index`", "found \"2\"", "expected 1"]);
    damage("\n1,0,cut", "\n1,0,drill", &[":3:", "`kind`", "\"drill\"", "cut, link or retract"]);
    damage("\n1,0,cut", "\n1,-1,cut", &[":3:", "`layer`", "whole number"]);
    damage("0.3333333333333333", "nan", &[":3:", "`time_s`", "finite number"]);
    damage("0.3333333333333333", "", &[":3:", "`time_s`", "finite number"]);
    damage("0.3333333333333333", "7.0", &[":4:", "`time_s`", "at least 7 s"]);
    damage("1e-7,0.0,0.0,1.0", "1e-7,0.0,0.0,1.1", &[":2:", "`axis_x`", "unit axis"]);
    damage("sinus and dura", "sinus", &[":2:", "`structure`", "structure of the case"]);
    damage(",4.5,", ",", &[":2:", "26 cells", "27"]);
    damage("0.1,0.2,0.3", "0.1,,0.3", &[":2:", "`fy_n`"]);
    damage("index,layer", "index,level", &[":1:", "header"]);
    std::fs::write(&path, "").unwrap();
    assert!(read_waypoints(&path, &structures()).unwrap_err().to_string().contains(":1:"));
}

#[test]
fn what_no_file_can_hold_is_not_written() {
    let (_dir, path) = file();
    let mut points = some_waypoints(2);
    points[1].cost = Some(f64::NAN);
    let message = write_waypoints(&path, &points, &structures()).unwrap_err().to_string();
    assert!(message.contains("`cost` of waypoint 1"), "{message}");
    points[1].cost = None;
    points[1].force_n = Vector3::new(0.0, f64::INFINITY, 0.0);
    let message = write_waypoints(&path, &points, &structures()).unwrap_err().to_string();
    assert!(message.contains("`fy_n` of waypoint 1"), "{message}");
    points[1].force_n = Vector3::zeros();
    points[1].structure = Some(2);
    let message = write_waypoints(&path, &points, &structures()).unwrap_err().to_string();
    assert!(message.contains("waypoint 1 names structure 2, of 2"), "{message}");
}

#[test]
fn a_full_disk_is_an_error() {
    let full = Path::new("/dev/full");
    if !full.exists() {
        bonemill_geometry::testkit::skipped("there is no /dev/full here");
        return;
    }
    let e = write_waypoints(full, &some_waypoints(10), &structures()).unwrap_err();
    assert!(matches!(e, PlanFileError::Io { doing: "write", .. }), "{e}");
}
