//! The bone's surface while it is cut: meshes of the bricks that changed, for a viewer.
//!
//! A brick's mesh is its part of one surface: neighbouring bricks use the same samples where they meet, so their meshes fit
//! together. A change reaches one cell into the neighbours, which are meshed again as well. The surface lies where
//! min(D, (ρ − level)/level) changes sign. It is only for display; nothing is measured on it.

use bonemill_geometry::{Mesh, Point, Work};
use fast_surface_nets::ndshape::{ConstShape, ConstShape3u32};
use fast_surface_nets::{SurfaceNetsBuffer, surface_nets};
use nalgebra::Vector3;
use rayon::prelude::*;

use super::lattice::{FAR, Lattice, SIDE};

/// Number of samples along a brick: its cells and one on either side.
pub(super) const SAMPLES: usize = SIDE + 2;
type Shape = ConstShape3u32<{ SAMPLES as u32 }, { SAMPLES as u32 }, { SAMPLES as u32 }>;

/// One brick's part of the surface.
#[derive(Debug, Clone, PartialEq)]
pub struct BrickMesh {
    /// The brick's number; a new mesh replaces the old one of the same number.
    pub brick: usize,
    /// Its part of the surface; empty where there is none.
    pub mesh: Mesh<Work>,
}

impl<T: Copy + Into<f64> + Sync> Lattice<'_, T> {
    /// The surface of every brick; `level_g_cm3` is the density at which bone begins.
    pub fn whole_surface(&self, level_g_cm3: f64) -> Vec<BrickMesh> {
        let bricks: Vec<usize> = (0..self.brick_count()).collect();
        let meshes: Vec<_> = bricks.into_par_iter().map(|brick| self.mesh(brick, level_g_cm3)).collect();
        meshes.into_iter().filter(|part| !part.mesh.triangles.is_empty()).collect()
    }

    /// The surface of the bricks that changed since the last call, and of their neighbours.
    pub fn touched_surface(&mut self, level_g_cm3: f64) -> Vec<BrickMesh> {
        let mut bricks = Vec::new();
        for brick in self.take_touched() {
            let at = self.first_cell(brick as usize).map(|c| c / SIDE);
            let around = |a: usize| at[a].saturating_sub(1)..(at[a] + 2).min(self.bricks[a]);
            for k in around(2) {
                for j in around(1) {
                    bricks.extend(around(0).map(|i| self.brick_index([i, j, k])));
                }
            }
        }
        bricks.sort_unstable();
        bricks.dedup();
        bricks.into_par_iter().map(|brick| self.mesh(brick, level_g_cm3)).collect()
    }

    fn mesh(&self, brick: usize, level_g_cm3: f64) -> BrickMesh {
        let first = self.first_cell(brick);
        let level = level_g_cm3.max(1e-6);
        let sample = |n: u32| {
            let at = Shape::delinearize(n).map(|v| v as usize);
            // starts one before the first cell; beyond the lattice nothing is solid
            let cell: [Option<usize>; 3] =
                std::array::from_fn(|a| (first[a] + at[a]).checked_sub(1).filter(|c| *c < self.cells()[a]));
            let [Some(x), Some(y), Some(z)] = cell else { return 1.0 };
            let depth = self.depth_of([x, y, z]);
            let index = self.bone().index(&self.point(Vector3::new(x as f64, y as f64, z as f64)).coords);
            let bone = ((self.bone().density_at(&index) - level) / level) as f32;
            -depth.min(bone.clamp(-FAR, FAR))
        };
        let mut field = [0f32; SAMPLES * SAMPLES * SAMPLES];
        for (n, value) in field.iter_mut().enumerate() {
            *value = sample(n as u32);
        }
        let place =
            |p: [f32; 3]| self.point(Vector3::from_fn(|a, _| f64::from(p[a]) + first[a] as f64 - 1.0));
        BrickMesh { brick, mesh: mesh_of(&field, place) }
    }
}

/// The surface where samples, negative in bone, change sign; `place` takes their indices to points.
pub(super) fn mesh_of(
    field: &[f32; SAMPLES * SAMPLES * SAMPLES],
    place: impl Fn([f32; 3]) -> Point<Work>,
) -> Mesh<Work> {
    let mut buffer = SurfaceNetsBuffer::default();
    let inside = field.iter().filter(|v| **v < 0.0).count();
    if inside > 0 && inside < field.len() {
        surface_nets(field, &Shape {}, [0; 3], [SAMPLES as u32 - 1; 3], &mut buffer);
    }
    Mesh {
        vertices: buffer.positions.iter().map(|p| place(*p)).collect(),
        triangles: buffer.indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect(),
    }
}
