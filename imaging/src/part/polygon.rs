//! Polygons of a file cut into triangles by their ears, concave ones too.
//!
//! **Source:** Meisters 1975, "Polygons have ears"; the plane is Newell's.

use nalgebra::{Vector2, Vector3};

/// The triangles of a polygon, as numbers of its corners; as many as there are corners less two.
///
/// A polygon that crosses itself has no such cut: what is left of it is a fan, and the checks of the solid tell where it does not close.
pub(crate) fn triangles(corners: &[Vector3<f64>]) -> Vec<[usize; 3]> {
    let count = corners.len();
    let next = |n: usize| corners[(n + 1) % count.max(1)];
    let normal = (0..count).map(|n| corners[n].cross(&next(n))).sum::<Vector3<f64>>();
    // seen along the axis that the normal is nearest to, counter-clockwise
    let axis = normal.iamax();
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    let turn = normal[axis].signum();
    let flat: Vec<Vector2<f64>> = corners.iter().map(|p| Vector2::new(p[u], turn * p[v])).collect();
    let mut left: Vec<usize> = (0..count).collect();
    let mut found = Vec::new();
    while left.len() > 3 {
        let size = left.len();
        let corner = |n: usize| [left[(n + size - 1) % size], left[n], left[(n + 1) % size]];
        let ear = (0..size).find(|n| is_ear(&flat, &left, corner(*n))).unwrap_or(1);
        found.push(corner(ear));
        left.remove(ear);
    }
    if let [a, b, c] = left[..] {
        found.push([a, b, c]);
    }
    found
}

/// Whether a corner turns left and holds no other one.
fn is_ear(flat: &[Vector2<f64>], left: &[usize], [a, b, c]: [usize; 3]) -> bool {
    let side = |p: usize, q: usize, r: usize| (flat[q] - flat[p]).perp(&(flat[r] - flat[p]));
    let holds = |p: usize| side(a, b, p) >= 0.0 && side(b, c, p) >= 0.0 && side(c, a, p) >= 0.0;
    side(a, b, c) > 0.0 && !left.iter().any(|&p| ![a, b, c].contains(&p) && holds(p))
}

/// An OBJ file's text with every face of more than three corners cut into triangles.
pub(crate) fn triangulated_obj(text: &str) -> String {
    let mut vertices: Vec<Vector3<f64>> = Vec::new();
    let mut out = String::with_capacity(text.len());
    for line in text.lines() {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => {
                let numbers: Vec<f64> = words.take(3).filter_map(|word| word.parse().ok()).collect();
                // what is no vertex is told by the reader
                vertices.push(<[f64; 3]>::try_from(numbers).map_or_else(|_| Vector3::zeros(), Vector3::from));
            }
            Some("f") => {
                let corners: Vec<&str> = words.take_while(|word| !word.starts_with('#')).collect();
                let at = |word: &&str| {
                    let number: i64 = word.split('/').next()?.parse().ok()?;
                    let n = if number < 0 { number + vertices.len() as i64 } else { number - 1 };
                    vertices.get(usize::try_from(n).ok()?).copied()
                };
                let places: Option<Vec<Vector3<f64>>> = corners.iter().map(at).collect();
                if let Some(places) = places.filter(|places| places.len() > 3) {
                    for [a, b, c] in triangles(&places) {
                        out += &format!("f {} {} {}\n", corners[a], corners[b], corners[c]);
                    }
                    continue;
                }
            }
            _ => {}
        }
        out.push_str(line);
        out.push('\n');
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::part::{MeshFormat, RepairLimits, Solid, parse_facets};

    /// An L drawn along z, 40 × 40 and arms of 10, in polygons of 6 corners; every first corner is one from which a fan leaves the L.
    const OUTLINE: [[f64; 2]; 6] =
        [[40.0, 0.0], [40.0, 10.0], [10.0, 10.0], [10.0, 40.0], [0.0, 40.0], [0.0, 0.0]];

    fn area(corners: &[Vector3<f64>], triangles: &[[usize; 3]]) -> f64 {
        let one = |[a, b, c]: &[usize; 3]| (corners[*b] - corners[*a]).cross(&(corners[*c] - corners[*a]));
        triangles.iter().map(one).map(|normal| 0.5 * normal.norm()).sum()
    }

    #[test]
    fn a_concave_polygon_keeps_its_area_from_any_first_corner_and_in_any_plane() {
        for first in 0..6 {
            for turn in 0..3 {
                for reversed in [false, true] {
                    let mut corners: Vec<Vector3<f64>> = (0..6)
                        .map(|n| OUTLINE[(n + first) % 6])
                        .map(|[x, y]| {
                            let p = [x, y, 0.1 * x + 0.2 * y];
                            Vector3::new(p[turn], p[(turn + 1) % 3], p[(turn + 2) % 3])
                        })
                        .collect();
                    if reversed {
                        corners.reverse();
                    }
                    let cut = triangles(&corners);
                    let expected = 700.0 * (1.0f64 + 0.01 + 0.04).sqrt();
                    assert_eq!(cut.len(), 4);
                    assert!(
                        (area(&corners, &cut) - expected).abs() < 1e-9,
                        "{first} {turn} {reversed}: {cut:?}"
                    );
                }
            }
        }
    }

    #[test]
    fn an_obj_and_a_ply_of_concave_polygons_are_the_part_that_they_say() {
        for first in 0..6 {
            let at = |z: f64| OUTLINE.iter().map(move |[x, y]| format!("{x} {y} {z}\n"));
            let around = |n: usize| (n + first) % 6;
            let mut faces: Vec<Vec<usize>> =
                vec![(0..6).rev().map(around).collect(), (0..6).map(|n| 6 + around(n)).collect()];
            faces.extend((0..6).map(|n| vec![n, (n + 1) % 6, 6 + (n + 1) % 6, 6 + n]));
            let vertices: Vec<String> = at(0.0).chain(at(8.0)).collect();
            let obj: String = vertices.iter().map(|v| format!("v {v}")).collect::<String>()
                + &faces
                    .iter()
                    .map(|f| format!("f{}\n", f.iter().map(|n| format!(" {}", n + 1)).collect::<String>()))
                    .collect::<String>();
            let ply = format!(
                "ply\nformat ascii 1.0\nelement vertex 12\nproperty float x\nproperty float y\nproperty float z\nelement face 8\nproperty list uchar int vertex_indices\nend_header\n{}{}",
                vertices.concat(),
                faces
                    .iter()
                    .map(|f| format!(
                        "{}{}\n",
                        f.len(),
                        f.iter().map(|n| format!(" {n}")).collect::<String>()
                    ))
                    .collect::<String>()
            );
            for (text, format) in [(obj, MeshFormat::Obj), (ply, MeshFormat::Ply)] {
                let facets = parse_facets(text.as_bytes(), format).unwrap();
                let solid = Solid::from_facets(facets, None, &RepairLimits::default()).unwrap();
                assert!(
                    (solid.mesh.volume_mm3() - 5600.0).abs() < 1e-3,
                    "{first}: {}",
                    solid.mesh.volume_mm3()
                );
                assert_eq!((solid.changes.len(), solid.shallow_crossings), (0, 0), "{first}");
            }
        }
    }
}
