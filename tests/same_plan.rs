//! A plan must not depend on the run, the number of threads, the storage of the images, or the orientation of the patient.

use std::fs;

use crate::support::body;
use crate::support::place::Place;

/// A voxel of the planning grid, mm.
const VOXEL_MM: f64 = 0.5;

/// A cut that removes less than this share of the largest one grazes: where ways between lines graze depends on the voxels.
const GRAZES: f64 = 0.1;

/// The cuts of a plan.
struct Cuts {
    /// Centres of the burr, mm.
    at: Vec<[f64; 3]>,
    /// Directions of the shaft.
    axes: Vec<[f64; 3]>,
    /// Whether each does more than graze.
    is_full: Vec<bool>,
}

impl Cuts {
    fn of(place: &Place) -> Self {
        let text = fs::read_to_string(place.path("plan/waypoints.csv")).unwrap();
        let mut lines = text.lines();
        let columns: Vec<_> = lines.next().unwrap().split(',').collect();
        let column = |name: &str| columns.iter().position(|c| *c == name).unwrap();
        let (kind, x, mass) = (column("kind"), column("x_mm"), column("mass_mg"));
        let axis = column("axis_x");
        assert_eq!([columns[x + 1], columns[x + 2]], ["y_mm", "z_mm"]);
        let rows = lines.map(|line| line.split(',').collect::<Vec<_>>());
        let cuts: Vec<_> = rows.filter(|row| row[kind] == "cut").collect();
        assert!(cuts.len() > 100, "{} cuts", cuts.len());
        let number = |text: &str| text.parse::<f64>().unwrap();
        let most_mg = cuts.iter().map(|row| number(row[mass])).fold(0.0, f64::max);
        Self {
            at: cuts.iter().map(|row| [0, 1, 2].map(|a| number(row[x + a]))).collect(),
            axes: cuts.iter().map(|row| [0, 1, 2].map(|a| number(row[axis + a]))).collect(),
            is_full: cuts.iter().map(|row| number(row[mass]) >= GRAZES * most_mg).collect(),
        }
    }

    /// The same in a turned or mirrored patient.
    fn turned(&self, turn: [[f64; 3]; 3]) -> Self {
        let all = |vectors: &[[f64; 3]]| vectors.iter().map(|v| turned(turn, *v)).collect();
        Self { at: all(&self.at), axes: all(&self.axes), is_full: self.is_full.clone() }
    }

    /// How far a cut of one plan that does more than graze is from the nearest cut of the other, at most, mm.
    fn apart_mm(&self, other: &Self) -> f64 {
        let one_way = |from: &Self, to: &Self| {
            let nearest =
                |p: &[f64; 3]| to.at.iter().map(|q| distance_mm(p, q)).fold(f64::INFINITY, f64::min);
            let full = from.at.iter().zip(&from.is_full).filter(|(_, is_full)| **is_full);
            full.map(|(p, _)| nearest(p)).fold(0.0, f64::max)
        };
        one_way(self, other).max(one_way(other, self))
    }

    /// The median angle between the shaft at a full cut and at the nearest cut of the other plan, the larger of both ways, degrees.
    fn axes_apart_deg(&self, other: &Self) -> f64 {
        self.axes_apart_from_deg(other).max(other.axes_apart_from_deg(self))
    }

    fn axes_apart_from_deg(&self, other: &Self) -> f64 {
        let full = (0..self.at.len()).filter(|n| self.is_full[*n]);
        let angle = |n: usize| {
            let away = |m: &usize| distance_mm(&self.at[n], &other.at[*m]);
            let nearest = (0..other.at.len()).min_by(|a, b| away(a).total_cmp(&away(b))).unwrap();
            let chord = distance_mm(&self.axes[n], &other.axes[nearest]);
            2.0 * (0.5 * chord).min(1.0).asin().to_degrees()
        };
        let mut angles: Vec<_> = full.map(angle).collect();
        angles.sort_by(f64::total_cmp);
        angles[angles.len() / 2]
    }

    /// How much of the way goes along each direction: Σ d dᵀ/|d| over the full cuts' moves, over Σ |d|.
    fn along(&self) -> [[f64; 3]; 3] {
        let (mut sum, mut length_mm) = ([[0.0; 3]; 3], 0.0);
        for n in (1..self.at.len()).filter(|n| self.is_full[*n]) {
            let d = [0, 1, 2].map(|a| self.at[n][a] - self.at[n - 1][a]);
            let mm = distance_mm(&self.at[n], &self.at[n - 1]).max(1e-9);
            (0..9).for_each(|c| sum[c / 3][c % 3] += d[c / 3] * d[c % 3] / mm);
            length_mm += mm;
        }
        sum.map(|row| row.map(|v| v / length_mm))
    }
}

fn turned(turn: [[f64; 3]; 3], p: [f64; 3]) -> [f64; 3] {
    turn.map(|row| (0..3).map(|a| row[a] * p[a]).sum())
}

fn distance_mm(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    (0..3).map(|n| (a[n] - b[n]).powi(2)).sum::<f64>().sqrt()
}

#[track_caller]
fn planned(place: &Place) -> Cuts {
    let ran = place.plan();
    assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
    Cuts::of(place)
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
    for [x, _, z] in Cuts::of(&place).at {
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
        let off_mm = plan.apart_mm(&planned(&place));
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
        let expected = plan.turned(mirror);
        let (off_mm, degrees) = (expected.apart_mm(&found), expected.axes_apart_deg(&found));
        eprintln!(
            "mirrored along axis {axis}: {off_mm:.3} mm, axes {degrees:.2} degrees apart in the middle"
        );
        assert!(
            off_mm <= VOXEL_MM && degrees <= 2.0,
            "mirrored along axis {axis}: {off_mm} mm, {degrees} degrees"
        );
    }
}

/// By 0.7 rad about (1, 2, 2)/3.
fn oblique() -> [[f64; 3]; 3] {
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
}

#[test]
fn a_patient_turned_with_its_registration_has_the_turned_shaft() {
    // base x, y, z are along y, -x, z of the patient, whose pocket has its middle at the base's origin
    let base = [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]];
    let registered = |place: Place, turn: [[f64; 3]; 3]| {
        let row = |base: [f64; 3]| turned(turn, base);
        let given =
            format!("base_from_ct = {{ rotation = {:?}, translation_mm = [-2, -2, -12] }}", base.map(row));
        place.with_case("[robot]\n", &format!("[robot]\n{given}\n"))
    };
    let upright = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let plan = planned(&registered(Place::healthy(), upright));
    let turn = oblique();
    let found = planned(&registered(patient_in(turn, false), turn));
    let expected = plan.turned(turn);
    let (off_mm, degrees) = (expected.apart_mm(&found), expected.axes_apart_deg(&found));
    eprintln!("turned with its registration: {off_mm:.3} mm, axes {degrees:.2} degrees apart in the middle");
    assert!(off_mm <= VOXEL_MM && degrees <= 2.0, "{off_mm} mm, {degrees} degrees");
}

#[test]
fn a_patient_turned_obliquely_is_the_turned_plan() {
    let turn = oblique();
    let place = Place::healthy();
    let (plan, turned_place) = (planned(&place), patient_in(turn, false));
    let (expected, found) = (plan.turned(turn), planned(&turned_place));
    let off_mm = expected.apart_mm(&found);
    eprintln!("turned obliquely: {off_mm:.3} mm, {} and {} cuts", expected.at.len(), found.at.len());
    assert!(off_mm <= VOXEL_MM + 1e-6, "turned obliquely: {off_mm} mm");
    let (along, found) = (expected.along(), found.along());
    let differ = (0..9).map(|c| (along[c / 3][c % 3] - found[c / 3][c % 3]).abs()).fold(0.0, f64::max);
    assert!(differ < 0.05, "lines in other directions: {along:?} and {found:?}");
    let [before, after] = [&place, &turned_place].map(metrics);
    for figure in ["mean_force_n", "peak_force_n", "total_time_s"] {
        let [before, after] = [&before, &after].map(|m| m[figure].as_float().unwrap());
        assert!((after / before - 1.0).abs() < 0.2, "{figure}: {before} and {after}");
    }
    for figure in ["mean_force_toward_n", "peak_force_toward_n"] {
        let [before, after] = [&before, &after].map(|m| m["structures"]["nerve"][figure].as_float().unwrap());
        assert!((after / before - 1.0).abs() < 0.2, "{figure}: {before} and {after}");
    }
}

fn metrics(place: &Place) -> toml::Table {
    let text = fs::read_to_string(place.path("plan/plan.toml")).unwrap();
    text.parse::<toml::Table>().unwrap()["metrics"].as_table().unwrap().clone()
}
