//! The surface made in parts equals the surface made at once.

use std::collections::BTreeMap;

use bonemill_geometry::Mesh;

use super::*;
use crate::surface::BrickMesh;

/// All parts as one mesh, vertices at the same place joined.
fn joined<'a>(parts: impl Iterator<Item = &'a BrickMesh>) -> Mesh<Work> {
    let mut place = BTreeMap::new();
    let mut mesh = Mesh { vertices: Vec::new(), triangles: Vec::new() };
    for part in parts {
        let numbers: Vec<u32> = part
            .mesh
            .vertices
            .iter()
            .map(|v| {
                let key: [i64; 3] = v.coords.map(|c| (c * 1e4).round() as i64).into();
                *place.entry(key).or_insert_with(|| {
                    mesh.vertices.push(*v);
                    mesh.vertices.len() as u32 - 1
                })
            })
            .collect();
        mesh.triangles.extend(part.mesh.triangles.iter().map(|t| t.map(|n| numbers[n as usize])));
    }
    mesh
}

#[test]
fn touched_bricks_keep_a_closed_surface_up_to_date() {
    // bone that ends well inside the block
    let bone = block(8.0, 0.25, |p| if p.amax() < 6.0 { 0.8 } else { 0.0 });
    let mut engine = engine(&bone, pose(0.0, 0.0, 9.0));
    engine.settle();
    engine.lattice_mut().touched_surface(0.4);
    let mut parts: BTreeMap<usize, BrickMesh> =
        engine.lattice().whole_surface(0.4).into_iter().map(|part| (part.brick, part)).collect();
    let before = joined(parts.values()).volume_mm3();
    assert!((before - 12f64.powi(3)).abs() < 0.01 * before, "{before}");
    let mut made = Vec::new();
    for n in 0..20 {
        straight(&mut engine, pose(0.0, 0.0, 9.0 - 0.4 * n as f64), 4);
        let touched = engine.lattice_mut().touched_surface(0.4);
        made.push(touched.len());
        parts.extend(touched.into_iter().map(|part| (part.brick, part)));
    }
    engine.settle();
    parts.extend(engine.lattice_mut().touched_surface(0.4).into_iter().map(|part| (part.brick, part)));
    let followed = joined(parts.values().filter(|p| !p.mesh.triangles.is_empty()));
    let whole = engine.lattice().whole_surface(0.4);
    assert_eq!(followed, joined(whole.iter()));
    // closed: every directed edge has its reverse
    let mut edges = BTreeMap::new();
    for [a, b, c] in &followed.triangles {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            *edges.entry((from, to)).or_insert(0) += 1;
        }
    }
    assert!(edges.iter().all(|((from, to), n)| edges.get(&(*to, *from)) == Some(n)));
    let gone = before - followed.volume_mm3();
    assert!(
        (gone - engine.removed().total_mm3()).abs() < 0.03 * gone,
        "{gone} {}",
        engine.removed().total_mm3()
    );
    assert!(made.iter().all(|n| *n < whole.len()), "{made:?} of {}", whole.len());
}
