//! Cells of the lattice as the images have them, before anything is cut.

use super::bone::Kind;
use super::lattice::{Brick, CELLS, FAR, Lattice, SIDE};

impl<T: Copy + Into<f64> + Sync> Lattice<'_, T> {
    /// Whether a brick has a solid cell, cut or not, or one is so near that something of it is felt within [`FAR`] cells of the
    /// brick: the density of a solid voxel fades over one more, and D is read between neighbouring cells.
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

    /// A cell's mass, its solid parts and the gravest kind among them.
    pub(super) fn content(&self, cell: [usize; 3]) -> (f64, u16, Option<Kind>) {
        let part_mm3 = self.part_mm3();
        if (0..3).any(|a| cell[a] >= self.cells()[a]) {
            return (0.0, 0, None);
        }
        if self.block == 1 {
            let found = self.bone.voxel(cell.map(|c| c / self.split));
            return found.map_or((0.0, 0, None), |(density, kind)| (density * part_mm3, 1, Some(kind)));
        }
        let dims = self.bone.grid().dims();
        let range = |a: usize| cell[a] * self.block..((cell[a] + 1) * self.block).min(dims[a]);
        let (mut sum, mut parts, mut worst) = (0.0, 0, None);
        for k in range(2) {
            for j in range(1) {
                for (density, kind) in self.bone.row(range(0), j, k) {
                    sum += density;
                    parts += 1;
                    if worst.is_none_or(|w| kind as u8 > w as u8) {
                        worst = Some(kind);
                    }
                }
            }
        }
        (sum * part_mm3, parts, worst)
    }

    /// A brick as the images have it.
    pub(super) fn fresh(&self, brick: usize) -> Box<Brick> {
        let first = self.first_cell(brick);
        let mut fresh = Box::new(Brick {
            depth: [FAR; CELLS],
            mass_mg: [0.0; CELLS],
            parts: [0; CELLS],
            kind: [None; CELLS],
        });
        for n in 0..CELLS {
            let local = [n % SIDE, n / SIDE % SIDE, n / (SIDE * SIDE)];
            let cell = std::array::from_fn(|a| first[a] + local[a]);
            (fresh.mass_mg[n], fresh.parts[n], fresh.kind[n]) = self.content(cell);
        }
        fresh
    }
}
