//! Spade drills and reamers as meshes: their edges are those of the formulas.

use bonemill_geometry::{Mesh, Point, Work};
use proptest::prelude::*;

use super::*;
use crate::cutter::EdgeKind;

/// A closed prism: a polygon in the x–z plane, counter-clockwise seen from −y, extruded from y = `y[0]` to `y[1]`.
fn prism(outline: &[[f64; 2]], y: [f64; 2]) -> Mesh<Work> {
    let n = outline.len() as u32;
    let vertices = y.iter().flat_map(|y| outline.iter().map(|[x, z]| Point::new(*x, *y, *z))).collect();
    let mut triangles = Vec::new();
    for i in 1..n - 1 {
        triangles.push([0, i, i + 1]);
        triangles.push([n, n + i + 1, n + i]);
    }
    for i in 0..n {
        let j = (i + 1) % n;
        triangles.push([i, n + j, j]);
        triangles.push([i, n + i, n + j]);
    }
    Mesh { vertices, triangles }
}

/// A flat spade drill of radius 2 with a point of 60°, as thin as `thick` mm.
fn spade(thick: f64) -> Mesh<Work> {
    let up = 2.0 / 60f64.to_radians().tan();
    prism(&[[0.0, 0.0], [2.0, up], [2.0, 6.0], [-2.0, 6.0], [-2.0, up]], [-thick / 2.0, thick / 2.0])
}

fn spec(edges: EdgeSource) -> MeshCutterSpec {
    MeshCutterSpec { axis: Vector3::z(), axis_point_mm: Vector3::zeros(), spin: 1, edges }
}

const SHARP: EdgeSource = EdgeSource::Dihedral { least_rad: 0.8 };

#[test]
fn a_spade_s_lips_have_the_angles_of_a_drill_with_that_web() {
    let thick = 0.4;
    let cutter = MeshCutter::new(&spade(thick), &spec(SHARP)).unwrap();
    assert!((cutter.solid().max_radius_mm() - 2f64.hypot(0.2)).abs() < 1e-6);
    let f = 0.05;
    let edges = cutter.edges(f, 64).unwrap();
    let mut seen = 0;
    for e in edges.elements.iter().filter(|e| e.radius_mm > 0.25) {
        // the lip is a straight line at half the thickness from the axis, and the rake face stands upright
        let beta = (thick / 2.0 / e.radius_mm).asin();
        let slope = 60f64.to_radians();
        assert!((e.epsilon_rad - slope).abs() < 1e-9, "{}", e.epsilon_rad.to_degrees());
        // ahead of the centre: β of the other sign than a twist drill's lip that starts behind it
        assert!((e.beta_rad.abs() - beta).abs() < 1e-9, "{} {}", e.beta_rad, beta);
        assert_eq!((e.feed_share, e.kind), (0.5, EdgeKind::Lip));
        let mu = (f / (2.0 * std::f64::consts::PI * e.radius_mm)).atan();
        assert!((e.mu_rad - mu).abs() < 1e-12);
        seen += 1;
    }
    assert!(seen > 80, "{seen}");
    let width = |kind| edges.elements.iter().filter(|e| e.kind == kind).map(|e| e.width_mm).sum::<f64>();
    assert!((width(EdgeKind::Lip) - 2.0 * (2f64.hypot(0.2) - 0.2)).abs() < 1e-9);
    // the ridge between the two flanks, on either side of the axis
    assert!((width(EdgeKind::Chisel) - 0.4).abs() < 1e-9);
}

/// The rake of a face through a lip with a helix tangent (0, −tan θ, 1) is equation (6).
#[test]
fn the_rake_of_a_face_is_that_of_the_drill_s_formula() {
    use crate::cutter::{Cutter, TwistDrill, TwistDrillSpec};
    let drill = TwistDrill::new(TwistDrillSpec::FAIEGHI).unwrap();
    for e in drill.edges(0.02, 16).unwrap().elements.iter().filter(|e| e.kind == EdgeKind::Lip) {
        let ((se, ce), (sb, cb)) = (e.epsilon_rad.sin_cos(), e.beta_rad.sin_cos());
        let edge = Vector3::new(se * cb, -se * sb, ce);
        let helix = Vector3::new(0.0, -(e.radius_mm / 1.25 * 20f64.to_radians().tan()), 1.0);
        let face = helix.cross(&edge).normalize();
        let radial = e.position_mm.coords.xy().normalize();
        let [x, y] = [Vector3::new(radial.x, radial.y, 0.0), Vector3::new(-radial.y, radial.x, 0.0)];
        let global = |v: Vector3<f64>| x * v.x + y * v.y + Vector3::z() * v.z;
        let (p, along) = (e.position_mm.coords, global(edge));
        let piece = CuttingPiece {
            ends: [p - along * 1e-6, p + along * 1e-6],
            rake_normal: global(face),
            kind: EdgeKind::Lip,
        };
        let found = elements::elements(&[vec![piece]], 0.02, 1)[0];
        for (a, b) in [
            (found.gamma_n_rad, e.gamma_n_rad),
            (found.lambda_rad, e.lambda_rad),
            (found.tau_rad, e.tau_rad),
            (found.beta_rad, e.beta_rad),
            (found.epsilon_rad, e.epsilon_rad),
        ] {
            assert!((a - b).abs() < 1e-6, "{a} {b}");
        }
    }
}

#[test]
fn given_polylines_give_what_is_found() {
    let mesh = spade(0.4);
    let found = MeshCutter::new(&mesh, &spec(SHARP)).unwrap();
    let up = 2.0 / 60f64.to_radians().tan();
    // the lips as a person would give them: from the tip to the corners
    let lines = vec![vec![[0.0, -0.2, 0.0], [2.0, -0.2, up]], vec![[0.0, 0.2, 0.0], [-2.0, 0.2, up]]];
    for lines in [
        lines.clone(),
        lines.iter().map(|l| l.iter().copied().map(|[x, y, z]| [x, -y, z]).collect()).collect(),
    ] {
        // one of the two sides faces the turn
        let Ok(given) = MeshCutter::new(&mesh, &spec(EdgeSource::Polylines(lines))) else { continue };
        let sum = |c: &MeshCutter| {
            c.edges(0.0, 64)
                .unwrap()
                .elements
                .iter()
                .filter(|e| e.kind == EdgeKind::Lip)
                .map(|e| e.width_mm)
                .sum::<f64>()
        };
        assert!((sum(&given) - sum(&found)).abs() < 1e-9);
        return;
    }
    panic!("neither side cuts");
}

#[test]
fn the_other_sense_of_turning_is_the_mirror_image() {
    let mesh = spade(0.4);
    let one = MeshCutter::new(&mesh, &spec(SHARP)).unwrap();
    let other = MeshCutter::new(&mesh, &MeshCutterSpec { spin: -1, ..spec(SHARP) }).unwrap();
    let sorted = |c: &MeshCutter| {
        let mut all: Vec<[f64; 3]> = c
            .edges(0.02, 32)
            .unwrap()
            .elements
            .iter()
            .map(|e| [e.radius_mm, e.lambda_rad, e.gamma_n_rad])
            .collect();
        all.sort_by(|a, b| a[0].total_cmp(&b[0]));
        all
    };
    // a spade is symmetric: both senses cut alike
    for (a, b) in sorted(&one).iter().zip(sorted(&other)) {
        assert!((0..3).all(|n| (a[n] - b[n]).abs() < 1e-9), "{a:?} {b:?}");
    }
}

#[test]
fn meshes_that_are_no_cutter_are_refused() {
    let whole = spade(0.4);
    let refusal =
        |mesh: &Mesh<Work>, spec: &MeshCutterSpec| MeshCutter::new(mesh, spec).unwrap_err().to_string();
    let mut open = whole.clone();
    open.triangles.pop();
    assert!(refusal(&open, &spec(SHARP)).contains("shared by 1 facets"));
    let mut twice = whole.clone();
    twice.triangles.push(twice.triangles[0]);
    assert!(refusal(&twice, &spec(SHARP)).contains("not a closed surface"));
    let mut inside_out = whole.clone();
    inside_out.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    assert!(refusal(&inside_out, &spec(SHARP)).contains("inside out"));
    let mut wild = whole.clone();
    wild.vertices[0] = Point::new(f64::NAN, 0.0, 0.0);
    assert!(refusal(&wild, &spec(SHARP)).contains("vertex coordinate"));
    let off = EdgeSource::Polylines(vec![vec![[0.0, 0.0, 0.0], [0.0, 0.5, -1.0]]]);
    let words = refusal(&whole, &spec(off));
    assert!(words.contains("edge 0, point 1") && words.contains("off the mesh"), "{words}");
    assert!(refusal(&whole, &spec(EdgeSource::Polylines(vec![vec![]]))).contains("0 points"));
    assert!(refusal(&whole, &MeshCutterSpec { axis: Vector3::zeros(), ..spec(SHARP) }).contains("axis"));
    // a cylinder's end has no edge with a rake face
    let round = SolidOfRevolution::new(&[[0.0, 1.0], [2.0, 1.0]]).unwrap().mesh(64);
    assert!(matches!(MeshCutter::new(&round, &spec(SHARP)), Err(CutterError::NoEdge)));
    let cutter = MeshCutter::new(&whole, &spec(SHARP)).unwrap();
    assert!(matches!(cutter.edges(5.0, 8), Err(CutterError::FeedOutrunsLip { .. })));
}

proptest! {
    /// Where a mesh lies does not matter once axis and point say so.
    #[test]
    fn a_moved_mesh_is_the_same_cutter(turn in prop::array::uniform3(-3.0f64..3.0), shift in prop::array::uniform3(-50.0f64..50.0)) {
        let (turn, shift) = (Rotation3::new(Vector3::from(turn)), Vector3::from(shift));
        let mesh = spade(0.4);
        let moved = Mesh::<Work> {
            vertices: mesh.vertices.iter().map(|v| Point::from_coords(turn * v.coords + shift)).collect(),
            triangles: mesh.triangles.clone(),
        };
        let moved_spec = MeshCutterSpec { axis: turn * Vector3::z(), axis_point_mm: shift, ..spec(SHARP) };
        let (a, b) = (MeshCutter::new(&mesh, &spec(SHARP)).unwrap(), MeshCutter::new(&moved, &moved_spec).unwrap());
        let sum = |c: &MeshCutter| c.edges(0.02, 16).unwrap().elements.iter().map(|e| [e.width_mm, e.lambda_rad]).fold([0.0; 2], |s, v| [s[0] + v[0], s[1] + v[1]]);
        let (a, b) = (sum(&a), sum(&b));
        prop_assert!((a[0] - b[0]).abs() < 1e-6 && (a[1] - b[1]).abs() < 1e-5, "{a:?} {b:?}");
    }
}
