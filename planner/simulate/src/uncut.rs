//! The lattice's cells before anything is cut, from the images.

use super::lattice::{FAR, Held, Lattice, SIDE};

impl<T: Copy + Into<f64> + Sync> Lattice<'_, T> {
    /// Whether a brick has a solid cell, cut or not, or a solid cell is so near that it matters within [`FAR`] cells of the brick:
    /// the interpolated density of a solid voxel extends over one more voxel, and D is interpolated between neighbouring cells.
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
    }

    /// The contents of a cell before anything was cut.
    pub(super) fn held(&self, cell: [usize; 3]) -> Held {
        let part_mm3 = self.part_mm3();
        let mut held = Held { mass_mg: 0.0, parts: 0, kind: None };
        if (0..3).any(|a| cell[a] >= self.cells()[a]) {
            return held;
        }
        if self.block == 1 {
            if let Some((density, kind)) = self.bone.voxel(cell.map(|c| c / self.split)) {
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
