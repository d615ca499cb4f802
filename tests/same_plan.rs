//! A plan must not depend on the run, the number of threads, the storage of the images, or the orientation of the patient.

#![allow(clippy::unwrap_used, reason = "a test's helper fails by panicking")]

mod support;

use std::fs;

use support::body;
use support::place::Place;

/// A voxel of the planning grid, mm.
const VOXEL_MM: f64 = 0.5;

/// Centres of the burr at the cuts of the plan in `place`, mm.
fn cuts(place: &Place) -> Vec<[f64; 3]> {
    let text = fs::read_to_string(place.path("plan/waypoints.csv")).unwrap();
    let mut lines = text.lines();
    let columns: Vec<_> = lines.next().unwrap().split(',').collect();
    let at = |name: &str| columns.iter().position(|c| *c == name).unwrap();
    let (kind, x) = (at("kind"), at("x_mm"));
    assert_eq!([columns[x + 1], columns[x + 2]], ["y_mm", "z_mm"]);
    let rows = lines.map(|line| line.split(',').collect::<Vec<_>>());
    let cuts: Vec<_> = rows
        .filter(|row| row[kind] == "cut")
        .map(|row| [0, 1, 2].map(|a| row[x + a].parse::<f64>().unwrap()))
        .collect();
    assert!(cuts.len() > 100, "{} cuts", cuts.len());
    cuts
}

fn turned(turn: [[f64; 3]; 3], p: [f64; 3]) -> [f64; 3] {
    turn.map(|row| (0..3).map(|a| row[a] * p[a]).sum())
}

fn distance_mm(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    (0..3).map(|n| (a[n] - b[n]).powi(2)).sum::<f64>().sqrt()
}

/// Hausdorff distance of two sets of points, mm.
fn hausdorff_mm(a: &[[f64; 3]], b: &[[f64; 3]]) -> f64 {
    let one_way = |from: &[[f64; 3]], to: &[[f64; 3]]| {
        let nearest = |p: &[f64; 3]| to.iter().map(|q| distance_mm(p, q)).fold(f64::INFINITY, f64::min);
        from.iter().map(nearest).fold(0.0, f64::max)
    };
    one_way(a, b).max(one_way(b, a))
}

#[track_caller]
fn planned(place: &Place) -> Vec<[f64; 3]> {
    let ran = place.plan();
    assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
    cuts(place)
}

/// The healthy patient in coordinates turned or mirrored by `turn`, with matching approach and sense of rotation.
fn patient_in(turn: [[f64; 3]; 3], is_mirror: bool) -> Place {
    let place = Place::healthy();
    place.put_ct(&body::ct().turned(turn));
    place.put_labels(&body::labels().turned(turn));
    let approach = turned(turn, [0.0, 0.0, 1.0]);
    let place = place.with_case("direction = [0.0, 0.0, 1.0]", &format!("direction = {approach:?}"));
    if is_mirror { place.with_case("spin = -1", "spin = 1") } else { place }
}

/// Names of the files in a plan's folder.
const FILES: [&str; 9] = [
    "access.csv",
    "case.toml",
    "dropped.csv",
    "forces.csv",
    "plan.toml",
    "report.html",
    "robot.urdf",
    "trajectory.csv",
    "waypoints.csv",
];

#[test]
fn the_healthy_patient_is_planned_and_every_file_is_there() {
    let place = Place::healthy();
    let ran = place.plan();
    assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
    assert!(ran.out.starts_with("wrote ") && !ran.err.contains("fell short"), "{}{}", ran.out, ran.err);
    let mut files: Vec<_> = fs::read_dir(place.path("plan"))
        .unwrap()
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .collect();
    files.sort();
    assert_eq!(files, FILES);
    // every cut keeps the clearance from the rod, whose nearest face is at x = -11 + 29.5 · 0.5
    let face = body::ORIGIN_MM[0] + 29.5 * body::SPACING_MM;
    let [least, most] =
        [body::ORIGIN_MM[2] + 11.5 * body::SPACING_MM, body::ORIGIN_MM[2] + 13.5 * body::SPACING_MM];
    for [x, _, z] in cuts(&place) {
        let away = (face - x).max(0.0).hypot((least - z).max(z - most).max(0.0));
        assert!(away >= 2.5 - 1e-6, "({x}, {z}): {away} mm");
    }
}

#[test]
fn runs_and_numbers_of_threads_give_the_same_bytes() {
    let place = Place::healthy();
    let outs = [("a", "1"), ("b", "2"), ("c", "2")];
    for (out, threads) in outs {
        let ran = place.run(&["plan", "case.toml", "--out", out, "--threads", threads]);
        assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
    }
    for file in FILES {
        let [a, b, c] = outs.map(|(out, _)| fs::read(place.path(out).join(file)).unwrap());
        assert!(!a.is_empty() && a == b, "{file} depends on the number of threads");
        assert!(b == c, "{file} differs from run to run");
    }
}

#[test]
fn another_order_of_voxels_in_the_same_world_is_the_same_plan() {
    let place = Place::healthy();
    let plan = planned(&place);
    for (order, flipped) in [([0, 1, 2], [true, true, false]), ([2, 0, 1], [false, true, true])] {
        let place = Place::healthy();
        place.put_ct(&body::ct().stored_as(order, flipped));
        place.put_labels(&body::labels().stored_as(order, flipped));
        let off_mm = hausdorff_mm(&plan, &planned(&place));
        eprintln!("axes {order:?}, flipped {flipped:?}: {off_mm:.3} mm");
        assert!(off_mm <= VOXEL_MM, "axes {order:?}, flipped {flipped:?}: {off_mm} mm");
    }
}

#[test]
fn a_mirrored_patient_is_the_mirrored_plan() {
    let plan = planned(&Place::healthy());
    for axis in 0..2 {
        let mut mirror = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        mirror[axis][axis] = -1.0;
        let found = planned(&patient_in(mirror, true));
        let expected: Vec<_> = plan.iter().map(|p| turned(mirror, *p)).collect();
        let off_mm = hausdorff_mm(&expected, &found);
        eprintln!("mirrored along axis {axis}: {off_mm:.3} mm");
        assert!(off_mm <= VOXEL_MM, "mirrored along axis {axis}: {off_mm} mm");
    }
}

#[test]
fn a_patient_turned_obliquely_is_the_turned_plan() {
    let plan = planned(&Place::healthy());
    // by 0.7 rad about (1, 2, 2)/3
    let turn = {
        let (s, c) = 0.7f64.sin_cos();
        let u = [1.0 / 3.0, 2.0 / 3.0, 2.0 / 3.0];
        let cross = [[0.0, -u[2], u[1]], [u[2], 0.0, -u[0]], [-u[1], u[0], 0.0]];
        let mut turn = [[0.0; 3]; 3];
        for a in 0..3 {
            for b in 0..3 {
                turn[a][b] = if a == b { c } else { 0.0 } + s * cross[a][b] + (1.0 - c) * u[a] * u[b];
            }
        }
        turn
    };
    let found = planned(&patient_in(turn, false));
    let expected: Vec<_> = plan.iter().map(|p| turned(turn, *p)).collect();
    let off_mm = hausdorff_mm(&expected, &found);
    eprintln!("turned obliquely: {off_mm:.3} mm, {} and {} cuts", expected.len(), found.len());
    assert!(off_mm <= VOXEL_MM + 1e-6, "turned obliquely: {off_mm} mm");
}
