//! The air outside the patient in a CT, which a surgeon's way into the bone must begin in.
//!
//! It is the air that is connected, through air, with a corner of the scan: the outside of a head reaches a corner, while air cells and
//! the middle ear that the scan's faces cut do not. Where no corner holds air, the scan ends within the patient's soft tissue and what
//! lies beyond is not known: then every way out counts, and the plan warns. An ear canal is outside air, too: it is kept as a
//! structure, or by the entry's region.

use bonemill_geometry::{Ct, Volume};

use crate::clearance::Line;

/// The air outside the patient.
#[derive(Debug, Clone)]
pub struct OutsideAir {
    /// Per voxel of the CT; `None` where the scan has none.
    voxels: Option<Vec<bool>>,
}

impl OutsideAir {
    /// Of a CT whose air is at or below `air_hu`; neighbours share a face.
    pub fn of(ct: &Volume<f32, Ct>, air_hu: f64) -> Self {
        let grid = ct.grid();
        let dims = grid.dims();
        let mut found = vec![false; grid.len()];
        let mut open = Vec::new();
        let mut visit = |voxel: [usize; 3], open: &mut Vec<[usize; 3]>| {
            let n = grid.index(voxel);
            if !found[n] && f64::from(ct.data()[n]) <= air_hu {
                found[n] = true;
                open.push(voxel);
            }
        };
        for corner in 0..8usize {
            visit(std::array::from_fn(|a| if corner >> a & 1 == 0 { 0 } else { dims[a] - 1 }), &mut open);
        }
        while let Some(voxel) = open.pop() {
            for a in 0..3 {
                let mut next = voxel;
                if voxel[a] > 0 {
                    next[a] = voxel[a] - 1;
                    visit(next, &mut open);
                }
                if voxel[a] + 1 < dims[a] {
                    next[a] = voxel[a] + 1;
                    visit(next, &mut open);
                }
            }
        }
        let has_any = found.contains(&true);
        Self { voxels: has_any.then_some(found) }
    }

    /// Whether the scan has any.
    pub fn is_in_scan(&self) -> bool {
        self.voxels.is_some()
    }

    /// Whether a line comes to outside air before it leaves the scan; true where the scan has none.
    pub fn is_reached(&self, ct: &Volume<f32, Ct>, line: &Line<'_>) -> bool {
        let Some(voxels) = &self.voxels else { return true };
        let grid = ct.grid();
        let step = 0.5 * grid.spacing_mm().min();
        let places = (0..=(line.length_mm / step) as usize)
            .map(|n| line.from + line.along.as_ref() * (n as f64 * step));
        places.map_while(|p| grid.nearest(p)).any(|voxel| voxels[grid.index(voxel)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bonemill_geometry::{Grid, Point};
    use nalgebra::{Unit, Vector3};

    #[test]
    fn a_cell_that_the_scan_cuts_is_not_outside() {
        let grid = Grid::<Ct>::aligned([9, 9, 20], 1.0, Point::new(0.0, 0.0, 0.0)).unwrap();
        let mut ct = Volume::filled(grid, 1000f32);
        for n in 0..ct.data().len() {
            let [i, j, k] = ct.grid().voxel(n);
            // air above, and a cell that is open to the lower face
            if k >= 15 || (k < 4 && (3..6).contains(&i) && (3..6).contains(&j)) {
                ct.data_mut()[n] = -1000.0;
            }
        }
        let outside = OutsideAir::of(&ct, -700.0);
        let reached = |outside: &OutsideAir, z: f64| {
            let along = Unit::new_unchecked(Vector3::new(0.0, 0.0, z));
            outside.is_reached(&ct, &Line { from: Point::new(4.0, 4.0, 9.0), along: &along, length_mm: 99.0 })
        };
        assert!(outside.is_in_scan() && reached(&outside, 1.0) && !reached(&outside, -1.0));
        // without air in a corner the scan does not know
        let nowhere = OutsideAir::of(&ct, -2000.0);
        assert!(!nowhere.is_in_scan() && reached(&nowhere, -1.0));
    }
}
