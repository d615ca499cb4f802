//! The lattice's cells before anything is cut, from the images.

use nalgebra::Vector3;

use super::bone::VoxelKind;
use super::lattice::{CELLS, FAR, Held, Lattice, SIDE};

impl<T: Copy + Into<f64> + Sync> Lattice<'_, T> {
    /// Whether a brick has a solid cell, cut or not, or a solid cell is so near that it matters within [`FAR`] cells of the brick:
    /// the interpolated density of a solid voxel extends over one more voxel, and D is interpolated between neighbouring cells; bone of the images between
    /// voxels' centres counts where a cell's centre meets it.
    pub(super) fn has_solid(&self, brick: usize) -> bool {
        let first = self.first_cell(brick);
        let dims = self.bone.grid().dims();
        let around = 1 + (FAR as usize * self.block).div_ceil(self.split);
        let range = |a: usize| {
            let last = (first[a] + SIDE).min(self.cells()[a]);
            let from = (first[a] * self.block / self.split).saturating_sub(around);
            from..((last * self.block).div_ceil(self.split) + around).min(dims[a])
        };
        range(2).any(|k| range(1).any(|j| self.bone.row(range(0), j, k).next().is_some()))
            || self.bone.has_matter_at((0..CELLS).map(|n| self.index_of(self.cell_in(brick, n))))
    }

    /// Continuous voxel index of a cell's centre.
    fn index_of(&self, cell: [usize; 3]) -> Vector3<f64> {
        let per_voxel = self.split as f64 / self.block as f64;
        cell.map(|c| (c as f64 + 0.5) / per_voxel - 0.5).into()
    }

    /// The kind of the voxel that a cell is a part of; `None` where that is not solid.
    pub(super) fn kind_of_voxel(&self, cell: [usize; 3]) -> Option<VoxelKind> {
        let is_inside = (0..3).all(|a| cell[a] < self.cells()[a]);
        is_inside.then(|| self.bone.voxel(cell.map(|c| c / self.split)))?.map(|(_, kind)| kind)
    }

    /// The contents of a cell before anything was cut.
    pub(super) fn held(&self, cell: [usize; 3]) -> Held {
        let part_mm3 = self.part_mm3();
        let mut held = Held { mass_mg: 0.0, parts: 0, kind: None };
        if (0..3).any(|a| cell[a] >= self.cells()[a]) {
            return held;
        }
        if self.block == 1 {
            if let Some((density, kind)) = self.bone.solid_at(&self.index_of(cell)) {
                held = Held { mass_mg: density * part_mm3, parts: 1, kind: Some(kind) };
            }
            return held;
        }
        let dims = self.bone.grid().dims();
        let range = |a: usize| cell[a] * self.block..((cell[a] + 1) * self.block).min(dims[a]);
        let mut sum = 0.0;
        for k in range(2) {
            for j in range(1) {
                let row = self.bone.row_sum(range(0), j, k);
                sum += row.density_g_cm3;
                held.parts += row.count;
                held.kind = held.kind.max(row.kind);
            }
        }
        held.mass_mg = sum * part_mm3;
        held
    }
}
