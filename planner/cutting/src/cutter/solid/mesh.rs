//! The surface of a solid of revolution as triangles.

use std::f64::consts::TAU;

use bonemill_geometry::{Mesh, Point, Tool};

use super::SolidOfRevolution;

impl SolidOfRevolution {
    /// A closed mesh of its surface with this many facets around, 3 to 10 000; counter-clockwise seen from outside.
    pub fn mesh(&self, facets: usize) -> Mesh<Tool> {
        let facets = facets.clamp(3, 10_000);
        let rings: Vec<[f64; 2]> = self.rings();
        let mut vertices = Vec::with_capacity(facets * rings.len());
        let mut starts = Vec::with_capacity(rings.len());
        for [z, r] in &rings {
            starts.push(vertices.len() as u32);
            if *r > 0.0 {
                let at = |n: usize| {
                    let (sin, cos) = (TAU * n as f64 / facets as f64).sin_cos();
                    Point::new(r * cos, r * sin, *z)
                };
                vertices.extend((0..facets).map(at));
            } else {
                vertices.push(Point::new(0.0, 0.0, *z));
            }
        }
        let mut triangles = Vec::new();
        for (pair, start) in rings.windows(2).zip(starts.windows(2)) {
            let at = |ring: usize, n: usize| {
                if pair[ring][1] > 0.0 { start[ring] + (n % facets) as u32 } else { start[ring] }
            };
            for n in 0..facets {
                let quad = [at(0, n), at(0, n + 1), at(1, n + 1), at(1, n)];
                let halves = [[quad[0], quad[1], quad[2]], [quad[0], quad[2], quad[3]]];
                triangles.extend(halves.into_iter().filter(|[a, b, c]| a != b && b != c && a != c));
            }
        }
        Mesh { vertices, triangles }
    }

    /// Radii along the profile, with a point on the axis at either end and no point twice.
    fn rings(&self) -> Vec<[f64; 2]> {
        let profile = self.profile();
        let mut rings = vec![[profile[0][0], 0.0]];
        rings.extend(profile);
        rings.push([profile[profile.len() - 1][0], 0.0]);
        rings.dedup();
        rings
    }
}
