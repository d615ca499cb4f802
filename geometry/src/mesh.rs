//! Triangle meshes.

use nalgebra::Vector3;

use crate::{Frame, Point, Rigid};

/// Triangles in frame `F`; counter-clockwise seen from outside.
#[derive(Debug, Clone, PartialEq)]
pub struct Mesh<F: Frame> {
    /// Vertices, mm.
    pub vertices: Vec<Point<F>>,
    /// The numbers of each triangle's three vertices.
    pub triangles: Vec<[u32; 3]>,
}

impl<F: Frame> Mesh<F> {
    /// Area, mm².
    pub fn area_mm2(&self) -> f64 {
        self.edges().map(|(u, v, _)| 0.5 * u.cross(&v).norm()).sum()
    }

    /// Enclosed volume, mm³ (divergence theorem); negative when the triangles face inwards.
    pub fn volume_mm3(&self) -> f64 {
        self.edges().map(|(u, v, a)| a.dot(&u.cross(&v)) / 6.0).sum()
    }

    /// The mesh in another frame.
    pub fn transformed<To: Frame>(&self, to_from_f: &Rigid<To, F>) -> Mesh<To> {
        Mesh {
            vertices: self.vertices.iter().map(|&v| *to_from_f * v).collect(),
            triangles: self.triangles.clone(),
        }
    }

    /// Per triangle: edges b − a and c − a, and a itself.
    fn edges(&self) -> impl Iterator<Item = (Vector3<f64>, Vector3<f64>, Vector3<f64>)> + '_ {
        self.triangles.iter().map(|t| {
            let [a, b, c] = t.map(|n| self.vertices[n as usize].coords);
            (b - a, c - a, a)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Work;

    #[test]
    fn a_tetrahedron_has_its_area_and_volume() {
        let vertices = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
            .map(|[x, y, z]| Point::<Work>::new(x, y, z));
        let mesh =
            Mesh { vertices: vertices.to_vec(), triangles: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]] };
        assert!((mesh.volume_mm3() - 1.0 / 6.0).abs() < 1e-15);
        assert!((mesh.area_mm2() - (1.5 + 3f64.sqrt() / 2.0)).abs() < 1e-15);
    }
}
