//! A copy of the foam block in turned or mirrored coordinates, with the registration turned too, gets the same plan.

use std::fs;

use crate::support::place::Place;
use bonemill_geometry::{Ct, Grid, Volume};
use bonemill_imaging::phantom::{Phantom, PhantomKind, phantom};
use bonemill_imaging::write_phantom;
use nalgebra::{Matrix3, Rotation3, Unit, Vector3};

/// A voxel of the block's images, mm.
const VOXEL_MM: f64 = 0.5;

/// A waypoint: its kind, the burr's centre and the shaft's axis.
struct Row {
    kind: String,
    mass_mg: f64,
    position: Vector3<f64>,
    axis: Vector3<f64>,
}

fn rows(place: &Place) -> Vec<Row> {
    let text = fs::read_to_string(place.path("plan/waypoints.csv")).unwrap();
    let row = |line: &str| {
        let cells: Vec<&str> = line.split(',').collect();
        let at = |n: usize| Vector3::from([0, 1, 2].map(|a| cells[n + a].parse::<f64>().unwrap()));
        Row { kind: cells[2].into(), mass_mg: cells[13].parse().unwrap(), position: at(4), axis: at(7) }
    };
    text.lines().skip(1).map(row).collect()
}

fn turned<T: Copy>(volume: &Volume<T, Ct>, turn: &Matrix3<f64>) -> Volume<T, Ct> {
    let grid = volume.grid();
    let origin = turn * grid.origin().coords;
    let there = Grid::<Ct>::new(grid.dims(), grid.spacing_mm(), turn * grid.axes(), origin).unwrap();
    Volume::new(there, volume.data().to_vec()).unwrap()
}

/// Plans the block in coordinates turned or mirrored by `turn`, with the same pose of the arm relative to the block.
fn planned(block: &Phantom, turn: &Matrix3<f64>) -> Vec<Row> {
    let place = Place::empty();
    let copy = Phantom {
        ct: turned(&block.ct, turn),
        labels: turned(&block.labels, turn),
        label_names: block.label_names.clone(),
        case_toml: block.case_toml.clone(),
    };
    write_phantom(&place.path("."), &copy).unwrap();
    let approach = turn * Vector3::z();
    let place =
        place.with_case("direction = [0.0, 0.0, 1.0]", &format!("direction = {:?}", approach.as_slice()));
    let place = if turn.determinant() < 0.0 {
        // there is no mirrored arm, but the arm's tilt plane, the y-z plane, is its own mirror image
        place.with_case("spin = -1", "spin = 1")
    } else {
        // base x, y, z are along y, -x, z of the block's own coordinates, with the pocket's middle at the origin
        let base = Matrix3::new(0.0, 1.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 1.0) * turn.transpose();
        let row = |n: usize| format!("{:?}", base.row(n).iter().copied().collect::<Vec<f64>>());
        let rotation = [0, 1, 2].map(row).join(", ");
        let given = format!("base_from_ct = {{ rotation = [{rotation}], translation_mm = [0, 0, 7.5] }}");
        place.with_case("model = \"bone-attached\"", &format!("model = \"bone-attached\"\n{given}"))
    };
    let ran = place.plan();
    assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
    rows(&place)
}

/// Cuts that remove less than this (a fortieth of a full slot's step) are left out, mg: they are links that graze a wall, and of
/// several equally long ways each copy may take another.
const GRAZING_MG: f64 = 0.1;

/// Distance of the cuts of one plan from those of another, mm, and the median angle between the axes there, degrees.
fn off(expected: &[Row], found: &[Row], turn: &Matrix3<f64>) -> (f64, f64) {
    let cuts = |rows: &[Row]| {
        rows.iter()
            .filter(|r| r.kind == "cut" && r.mass_mg > GRAZING_MG)
            .map(|r| (r.position, r.axis))
            .collect::<Vec<_>>()
    };
    let expected: Vec<_> = cuts(expected).into_iter().map(|(p, a)| (turn * p, turn * a)).collect();
    let found = cuts(found);
    assert!(expected.len() > 1000 && found.len() > 1000);
    let mut angles = Vec::new();
    let mut one_way = |from: &[(Vector3<f64>, Vector3<f64>)], to: &[(Vector3<f64>, Vector3<f64>)]| {
        let nearest = |(p, axis): &(Vector3<f64>, Vector3<f64>)| {
            let (mm, there) = to
                .iter()
                .map(|(q, b)| ((p - q).norm_squared(), b))
                .min_by(|a, b| a.0.total_cmp(&b.0))
                .unwrap();
            angles.push(axis.dot(there).clamp(-1.0, 1.0).acos().to_degrees());
            mm.sqrt()
        };
        from.iter().map(nearest).fold(0.0, f64::max)
    };
    let mm = one_way(&expected, &found).max(one_way(&found, &expected));
    angles.sort_by(f64::total_cmp);
    (mm, angles[angles.len() / 2])
}

#[test]
fn copies_of_the_foam_block_are_milled_alike() {
    let block = phantom(PhantomKind::Block, 3);
    let plan = planned(&block, &Matrix3::identity());
    let mirror = |axis: usize| {
        let mut signs = Vector3::repeat(1.0);
        signs[axis] = -1.0;
        Matrix3::from_diagonal(&signs)
    };
    let about = |x, y, z, angle: f64| {
        Rotation3::from_axis_angle(&Unit::new_normalize(Vector3::new(x, y, z)), angle).into_inner()
    };
    let copies = [
        ("mirrored along x", mirror(0)),
        ("mirrored along y", mirror(1)),
        ("turned about z by a right angle", about(0.0, 0.0, 1.0, std::f64::consts::FRAC_PI_2)),
        ("turned obliquely", about(1.0, 2.0, 2.0, 0.7)),
    ];
    for (name, turn) in copies {
        let (mm, degrees) = off(&plan, &planned(&block, &turn), &turn);
        eprintln!("{name}: {mm:.3} mm, axes {degrees:.2} degrees apart in the middle");
        assert!(mm <= VOXEL_MM + 1e-6, "{name}: {mm} mm");
        assert!(degrees <= 2.0, "{name}: {degrees} degrees");
    }
}
