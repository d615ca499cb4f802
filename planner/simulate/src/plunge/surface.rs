//! The surface of the holes while they are cut: samples of the bricks that changed, to be meshed by another thread.
//!
//! Taking them shares the bricks and copies nothing, so that the haptic thread neither samples nor waits for a mesh. A change reaches
//! one cell into the neighbours, which are taken as well. The surface lies where min(distance from the hole, (ρ − level)/level)
//! changes sign, as in [`crate::surface`]; it is only for display.

use std::sync::Arc;

use bonemill_geometry::{Point, Volume, Work};
use nalgebra::{Rotation3, Vector3};

use super::holes::{Brick, FAR, Holes, SIDE, within};
use crate::surface::{BrickMesh, SAMPLES, mesh_of};

/// Distances from the hole at a brick's cells and one beyond on either side, as they were when the brick was taken.
#[derive(Debug, Clone)]
pub struct BrickSamples {
    brick: usize,
    /// Of the first sample, tool axes, mm.
    first_mm: Vector3<f64>,
    cell_mm: f64,
    work_from_tool: Rotation3<f64>,
    /// The brick between its 26 neighbours, x-fastest; `None`: without a hole.
    around: [Option<Arc<Brick>>; 27],
}

impl BrickSamples {
    /// The brick's part of the surface of bone of at least `level_g_cm3`.
    pub fn mesh<T: Copy + Into<f64>>(&self, density_g_cm3: &Volume<T, Work>, level_g_cm3: f64) -> BrickMesh {
        let level = level_g_cm3.max(1e-6);
        let place =
            |at: Vector3<f64>| Point::from_coords(self.work_from_tool * (self.first_mm + at * self.cell_mm));
        let field = |n: usize| {
            let at = [n % SAMPLES, n / SAMPLES % SAMPLES, n / (SAMPLES * SAMPLES)];
            let index = density_g_cm3.grid().continuous_index(place(at.map(|v| v as f64).into()));
            let bone = (density_g_cm3.trilinear_at(index, 0.0) - level) / level;
            -self.distance(at).min(bone as f32)
        };
        let mesh = mesh_of(&std::array::from_fn(field), |p| place(p.map(f64::from).into()));
        BrickMesh { brick: self.brick, mesh }
    }

    /// In cells, at one sample: sample 0 is the last cell of the neighbour before.
    fn distance(&self, sample: [usize; 3]) -> f32 {
        let cell = sample.map(|s| s + SIDE - 1);
        let [i, j, k] = cell.map(|c| c / SIDE);
        self.around[i + 3 * (j + 3 * k)].as_ref().map_or(FAR, |cells| cells[within(cell)])
    }
}

impl Holes {
    /// The bricks that changed since the last call, and their neighbours.
    pub(super) fn take_touched(&mut self, work_from_tool: Rotation3<f64>) -> Vec<BrickSamples> {
        let mut bricks = Vec::new();
        for number in std::mem::take(&mut self.touched) {
            self.is_touched[number] = false;
            let [nx, ny, _] = self.bricks;
            let at = [number % nx, number / nx % ny, number / (nx * ny)];
            let around = |a: usize| at[a].saturating_sub(1)..(at[a] + 2).min(self.bricks[a]);
            for k in around(2) {
                for j in around(1) {
                    bricks.extend(around(0).map(|i| [i, j, k]));
                }
            }
        }
        bricks.sort_unstable();
        bricks.dedup();
        bricks.into_iter().map(|brick| self.samples(brick, work_from_tool)).collect()
    }

    fn samples(&self, brick: [usize; 3], work_from_tool: Rotation3<f64>) -> BrickSamples {
        let neighbour = |n: usize| {
            let beside =
                |a: usize, step: usize| (brick[a] + step).checked_sub(1).filter(|b| *b < self.bricks[a]);
            self.brick([beside(0, n % 3)?, beside(1, n / 3 % 3)?, beside(2, n / 9)?]).cloned()
        };
        let first = Vector3::from(brick.map(|b| (b * SIDE) as f64 - 1.0)) * self.cell_mm;
        BrickSamples {
            brick: brick[0] + self.bricks[0] * (brick[1] + self.bricks[1] * brick[2]),
            first_mm: self.origin_mm + first,
            cell_mm: self.cell_mm,
            work_from_tool,
            around: std::array::from_fn(neighbour),
        }
    }
}
