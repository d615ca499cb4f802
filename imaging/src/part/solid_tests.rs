//! The repair of facets to a closed solid, and the refusal of what cannot be repaired without doubt.

use nalgebra::Vector3;

use super::*;
use crate::part::phantom::Operculum;
use crate::part::{MeshFormat, parse_facets};

/// A box from the origin, each face a grid of `n` × `n` squares of `side` mm, as an unindexed file would give it.
fn cube(n: u32, side: f64, at: [f64; 3]) -> Facets {
    let size = f64::from(n) * side;
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for face in 0..6 {
        let (axis, far) = (face % 3, face >= 3);
        let point = |u: u32, v: u32| {
            let mut p = at;
            p[axis] += if far { size } else { 0.0 };
            p[(axis + 1) % 3] += f64::from(u) * side;
            p[(axis + 2) % 3] += f64::from(v) * side;
            p
        };
        for (u, v) in (0..n).flat_map(|u| (0..n).map(move |v| (u, v))) {
            let corners = [point(u, v), point(u + 1, v), point(u + 1, v + 1), point(u, v + 1)];
            for order in [[0, 1, 2], [0, 2, 3]] {
                let order = if far { order } else { [order[0], order[2], order[1]] };
                let first = vertices.len() as u32;
                vertices.extend(order.map(|k| corners[k]));
                triangles.push([first, first + 1, first + 2]);
            }
        }
    }
    Facets::new(vertices, triangles)
}

fn with(mut a: Facets, b: &Facets) -> Facets {
    let (vertices, facets) = (a.vertices.len() as u32, a.triangles.len() as u32);
    a.vertices.extend(&b.vertices);
    a.triangles.extend(b.triangles.iter().map(|t| t.map(|v| v + vertices)));
    a.numbers.extend(b.numbers.iter().map(|n| n + facets));
    a
}

fn solid(facets: Facets) -> Result<Solid, PartError> {
    Solid::from_facets(facets, None, &RepairLimits::default())
}

fn text(facets: Facets) -> String {
    solid(facets).unwrap_err().to_string()
}

fn assert_is_cube(solid: &Solid) {
    assert!((solid.mesh.volume_mm3() - 1000.0).abs() < 1e-6, "{}", solid.mesh.volume_mm3());
    assert!((solid.mesh.area_mm2() - 600.0).abs() < 1e-6);
    assert_eq!(solid.shallow_crossings, 0);
}

#[test]
fn a_sound_cube_is_not_changed() {
    let cube = solid(cube(4, 2.5, [1.0, -2.0, 3.0])).unwrap();
    assert_is_cube(&cube);
    assert_eq!(cube.changes, []);
    assert_eq!(cube.mesh.vertices.len(), 98);
}

#[test]
fn facets_turned_wrongly_are_turned_back() {
    let mut some = cube(4, 2.5, [0.0; 3]);
    for t in some.triangles.iter_mut().step_by(7) {
        t.swap(0, 1);
    }
    let some = solid(some).unwrap();
    assert_is_cube(&some);
    assert_eq!(some.changes, [Change::Turned { facets: 28, of: 192 }]);
    let mut all = cube(4, 2.5, [0.0; 3]);
    all.triangles.iter_mut().for_each(|t| t.swap(0, 1));
    let all = solid(all).unwrap();
    assert_is_cube(&all);
    assert_eq!(all.changes, [Change::Turned { facets: 192, of: 192 }]);
}

#[test]
fn duplicates_degenerate_facets_and_debris_are_taken_out() {
    let mut facets = cube(4, 2.5, [0.0; 3]);
    let (first, second) = (facets.triangles[0], facets.triangles[1]);
    facets.triangles.extend([first, [second[0], second[0], second[1]]]);
    facets.numbers.extend([192, 193]);
    let facets = with(facets, &cube(1, 0.1, [20.0, 0.0, 0.0]));
    let found = solid(facets).unwrap();
    assert_is_cube(&found);
    let [
        Change::DegenerateDropped { facets: 1 },
        Change::DuplicatesDropped { facets: 1 },
        Change::DebrisDropped { pieces: 1, facets: 12, area_mm2 },
    ] = found.changes.as_slice()
    else {
        panic!("{:?}", found.changes);
    };
    assert!((area_mm2 - 0.06).abs() < 1e-9);
}

#[test]
fn open_edges_nearby_are_welded_and_small_holes_filled() {
    let mut facets = cube(4, 2.5, [0.0; 3]);
    facets.vertices[0][1] += 0.004;
    let found = solid(facets).unwrap();
    let [Change::Welded { vertices: 1, largest_move_mm }] = found.changes.as_slice() else {
        panic!("{:?}", found.changes);
    };
    assert!((largest_move_mm - 0.004).abs() < 1e-12);
    // a square in the middle of a face: four edges of 2.5 mm
    let mut facets = cube(4, 2.5, [0.0; 3]);
    facets.retain(|f| f != 10 && f != 11);
    let found = solid(facets).unwrap();
    assert_is_cube(&found);
    let [Change::HolesFilled { holes: 1, facets: 2, area_mm2, longest_perimeter_mm }] =
        found.changes.as_slice()
    else {
        panic!("{:?}", found.changes);
    };
    assert!((area_mm2 - 6.25).abs() < 1e-9 && (longest_perimeter_mm - 10.0).abs() < 1e-9);
}

#[test]
fn a_large_hole_is_refused_with_its_place() {
    let mut facets = cube(4, 2.5, [0.0; 3]);
    facets.retain(|f| !(10..14).contains(&f));
    let said = text(facets);
    assert!(
        said.starts_with("the surface is open: a hole of 6 edges and 15.000 mm around at facet "),
        "{said}"
    );
}

#[test]
fn what_bounds_no_single_solid_is_refused_with_its_place() {
    // two cubes side by side
    let said = text(with(cube(2, 5.0, [0.0; 3]), &cube(2, 5.0, [20.0, 0.0, 0.0])));
    assert!(said.contains("2 separate pieces") && said.contains("600.000 mm² at facet"), "{said}");
    // two cubes on a common edge
    let said = text(with(cube(1, 10.0, [0.0; 3]), &cube(1, 10.0, [10.0, 10.0, 0.0])));
    assert!(said.contains("1 edges have more than two facets"), "{said}");
    // a strip with a half turn, closed
    let mut band = Facets::new(Vec::new(), Vec::new());
    for k in 0..12_u32 {
        let (a, t) =
            (f64::from(k) * std::f64::consts::TAU / 12.0, f64::from(k) * std::f64::consts::PI / 12.0);
        for s in [-2.0, 2.0] {
            let r = 10.0 + s * t.cos();
            band.vertices.push([r * a.cos(), r * a.sin(), s * t.sin()].into());
        }
        let (p, q) = (2 * k, 2 * k + 1);
        let (r, s) = if k == 11 { (1, 0) } else { (2 * k + 2, 2 * k + 3) };
        band.triangles.extend([[p, r, q], [q, r, s]]);
        band.numbers.extend([2 * k, 2 * k + 1]);
    }
    assert!(text(band).contains("one side only, seen at facet"));
}

#[test]
fn a_surface_that_crosses_itself_is_refused_and_one_that_touches_is_not() {
    // a spike through the far side: the middle vertex of one face pulled 2 mm past the other
    let pulled = |depth_mm: f64| {
        let mut facets = cube(2, 5.0, [0.0; 3]);
        // the far side's own vertex out of the way
        for v in facets.vertices.iter_mut().filter(|v| **v == nalgebra::Vector3::new(5.0, 5.0, 10.0)) {
            *v = nalgebra::Vector3::new(4.0, 4.5, 10.0);
        }
        for v in facets.vertices.iter_mut().filter(|v| **v == nalgebra::Vector3::new(5.0, 5.0, 0.0)) {
            v.z = 10.0 + depth_mm;
        }
        facets
    };
    let said = text(pulled(2.0));
    assert!(said.starts_with("the surface crosses itself") && said.contains("facet"), "{said}");
    let touches = solid(pulled(0.0)).unwrap();
    assert!(touches.shallow_crossings > 0);
    assert_eq!(solid(pulled(-1.0)).unwrap().shallow_crossings, 0);
}

#[test]
fn a_surface_that_touches_itself_in_a_point_gets_two_vertices() {
    // the middle of one face pulled to the middle of the opposite one
    let mut facets = cube(2, 5.0, [0.0; 3]);
    for v in facets.vertices.iter_mut().filter(|v| **v == nalgebra::Vector3::new(5.0, 5.0, 0.0)) {
        v.z = 10.0;
    }
    let found = solid(facets).unwrap();
    assert_eq!(found.changes, [Change::PinchesOpened { vertices: 1 }]);
}

#[test]
fn every_file_order_gives_the_same_vertices() {
    let (a, mut b) = (cube(3, 3.0, [0.0; 3]), cube(3, 3.0, [0.0; 3]));
    b.triangles.reverse();
    assert_eq!(solid(a).unwrap().mesh.vertices, solid(b).unwrap().mesh.vertices);
}

#[test]
fn facets_that_lie_over_each_other_everywhere_end_soon() {
    // 4000 long slivers around one axis: every box meets every other
    let mut facets = Facets::new(Vec::new(), Vec::new());
    for k in 0..4000_u32 {
        let a = f64::from(k) * 0.001;
        let (x, y) = (10.0 * a.cos(), 10.0 * a.sin());
        let first = 3 * k;
        facets.vertices.extend([[-x, -y, a], [x, y, a], [x + 0.1, y, a + 0.5]].map(nalgebra::Vector3::from));
        facets.triangles.push([first, first + 1, first + 2]);
        facets.numbers.push(k);
    }
    assert!(solid(facets).is_err());
}

#[test]
fn debris_leaves_no_vertex_and_no_size_behind() {
    let mut mesh = Operculum::drawn(1).mesh(2000);
    let (size_mm, count) = (mesh_size_mm(&mesh.vertices), mesh.vertices.len());
    // a speck of 0.01 mm, 50 mm away
    let first = count as u32;
    mesh.vertices.extend(
        [[50.0, 0.0, 0.0], [50.01, 0.0, 0.0], [50.0, 0.01, 0.0], [50.0, 0.0, 0.01]]
            .map(|[x, y, z]| Point::new(x, y, z)),
    );
    mesh.triangles
        .extend([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]].map(|t: [u32; 3]| t.map(|n| first + n)));
    let facets = parse_facets(&crate::part::stl_bytes(&mesh), MeshFormat::Stl).unwrap();
    let solid = Solid::from_facets(facets, Some(LengthUnit::Mm), &RepairLimits::default()).unwrap();
    assert!(
        matches!(solid.changes[..], [Change::DebrisDropped { pieces: 1, facets: 4, .. }]),
        "{:?}",
        solid.changes
    );
    assert_eq!(solid.mesh.vertices.len(), count);
    assert!((mesh_size_mm(&solid.mesh.vertices) - size_mm).amax() < 1e-4);
}

fn mesh_size_mm(vertices: &[Point<Part>]) -> Vector3<f64> {
    let (low, high) = vertices.iter().fold((vertices[0].coords, vertices[0].coords), |(low, high), v| {
        (low.inf(&v.coords), high.sup(&v.coords))
    });
    high - low
}

#[test]
fn holes_that_meet_at_a_vertex_are_each_filled() {
    let whole = Operculum::drawn(1).mesh(2000);
    // two facets at one vertex that share no edge
    let vertex = whole.triangles[500][0];
    let around: Vec<usize> =
        (0..whole.triangles.len()).filter(|f| whole.triangles[*f].contains(&vertex)).collect();
    let shares_edge =
        |a: usize, b: usize| whole.triangles[a].iter().filter(|v| whole.triangles[b].contains(v)).count() > 1;
    let other = around.iter().find(|f| **f != around[0] && !shares_edge(around[0], **f)).unwrap();
    let mut torn = whole.clone();
    let mut number = 0..;
    torn.triangles.retain(|_| {
        let n = number.next().unwrap();
        n != around[0] && n != *other
    });
    let facets = parse_facets(&crate::part::stl_bytes(&torn), MeshFormat::Stl).unwrap();
    let solid = Solid::from_facets(facets, Some(LengthUnit::Mm), &RepairLimits::default()).unwrap();
    assert!(
        matches!(solid.changes[..], [Change::HolesFilled { holes: 2, facets: 2, .. }]),
        "{:?}",
        solid.changes
    );
    assert!((solid.mesh.volume_mm3() - whole.volume_mm3()).abs() < 1e-3);
}
