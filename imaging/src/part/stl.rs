//! A mesh as a binary STL.

use bonemill_geometry::{Frame, Lps, Mesh};
use nalgebra::Vector3;

/// The mesh as binary STL; coordinates are rounded to single precision, which [`rounded`] does beforehand.
pub fn stl_bytes<F: Frame>(mesh: &Mesh<F>) -> Vec<u8> {
    stl_bytes_titled(mesh, &format!("bonemill part, mm, frame {}", F::NAME))
}

/// The same in LPS, with the words in its header by which 3D Slicer knows that it is.
pub fn stl_bytes_lps(mesh: &Mesh<Lps>) -> Vec<u8> {
    stl_bytes_titled(mesh, "bonemill, mm, SPACE=LPS")
}

fn stl_bytes_titled<F: Frame>(mesh: &Mesh<F>, title: &str) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(84 + 50 * mesh.triangles.len());
    bytes.extend(format!("{title:<80}").as_bytes());
    bytes.extend((mesh.triangles.len() as u32).to_le_bytes());
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|v| mesh.vertices[v as usize].coords);
        let normal = (b - a).cross(&(c - a)).try_normalize(0.0).unwrap_or_default();
        for number in [normal, a, b, c].iter().flat_map(Vector3::iter) {
            bytes.extend((*number as f32).to_le_bytes());
        }
        bytes.extend([0; 2]);
    }
    bytes
}

/// The mesh with the coordinates that its STL will hold.
pub fn rounded<F: Frame>(mesh: &Mesh<F>) -> Mesh<F> {
    let mut mesh = mesh.clone();
    for vertex in &mut mesh.vertices {
        vertex.coords = vertex.coords.map(|c| f64::from(c as f32));
    }
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::part::phantom::Operculum;
    use crate::part::{MeshFormat, RepairLimits, Solid, parse_facets};

    #[test]
    fn an_stl_reads_back_as_the_same_solid() {
        let mesh = rounded(&Operculum::drawn(1).mesh(1000));
        let facets = parse_facets(&stl_bytes(&mesh), MeshFormat::Stl).unwrap();
        let solid = Solid::from_facets(facets, None, &RepairLimits::default()).unwrap();
        assert_eq!(solid.changes, []);
        assert_eq!(solid.mesh.triangles.len(), mesh.triangles.len());
        assert!((solid.mesh.volume_mm3() - mesh.volume_mm3()).abs() < 1e-9 * mesh.volume_mm3());
    }
}
