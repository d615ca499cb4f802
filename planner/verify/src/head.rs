//! The patient's tissue on a lattice of its own, and the distance of a point from it.
//!
//! A lattice point is tissue if the CT's nearest voxel is above [`TISSUE_HU`]; beyond the scan the nearest voxel of its edge
//! counts, up to a given distance, but not beyond a face whose way out is within 60° of the approach. Pieces smaller than [`SPECK_MM3`] are left out. Distances are between lattice points.

use bonemill_geometry::{Ct, Grid, Volume};
use nalgebra::Vector3;

use super::edt::squared_voxels;

/// Tissue has more than this, HU, as the case file's documentation says.
const TISSUE_HU: f32 = -300.0;
/// Spacing of the lattice, mm.
const LATTICE_MM: f64 = 2.5;
/// Faces whose way out has more than this in common with the approach have nothing beyond them: cos 60°.
const OPEN: f64 = 0.5;
/// Smaller pieces are noise, mm³.
const SPECK_MM3: f64 = 500.0;

/// Distances from the patient.
pub(crate) struct Tissue {
    grid: Grid<Ct>,
    squared: Vec<f32>,
}

impl Tissue {
    /// Of a scan; `None` where it holds none.
    pub fn of(ct: &Volume<f32, Ct>, beyond_mm: f64, approach: &Vector3<f64>) -> Option<Self> {
        let scan = ct.grid();
        let sides = Vector3::from_fn(|k, _| scan.dims()[k] as f64 * scan.spacing_mm()[k]);
        let dims = std::array::from_fn(|k| ((sides[k] + 2.0 * beyond_mm) / LATTICE_MM).ceil() as usize + 1);
        // the lattice has the scan's axes and its middle
        let middle = scan.at(std::array::from_fn(|k| 0.5 * (scan.dims()[k] as f64 - 1.0)));
        let half = Vector3::from_fn(|k, _| 0.5 * (dims[k] as f64 - 1.0) * LATTICE_MM);
        let first = middle.coords - scan.axes() * half;
        let grid = Grid::<Ct>::new(dims, Vector3::repeat(LATTICE_MM), *scan.axes(), first).ok()?;
        let is_tissue = |n: usize| {
            let place = scan.continuous_index(grid.center(grid.voxel(n)));
            let voxel =
                std::array::from_fn(|k| place[k].round().clamp(0.0, scan.dims()[k] as f64 - 1.0) as usize);
            let is_open = (0..3).any(|k| {
                let past = place[k] - voxel[k] as f64;
                past.abs() > 0.5 && past.signum() * scan.axes().column(k).dot(approach) > OPEN
            });
            !is_open && ct.data()[scan.index(voxel)] > TISSUE_HU
        };
        let mut tissue: Vec<bool> = (0..grid.len()).map(is_tissue).collect();
        drop_specks(&grid, &mut tissue);
        tissue.contains(&true).then(|| {
            let squared = squared_voxels(dims, |n| tissue[n]);
            Self { grid, squared }
        })
    }

    /// The most by which a distance is off, mm: half a cell's diagonal at the point and at the tissue.
    pub fn error_mm(&self) -> f64 {
        3f64.sqrt() * LATTICE_MM
    }

    /// Distance of a point in ct, mm.
    pub fn distance_mm(&self, p: &Vector3<f64>) -> f64 {
        let place = self.grid.continuous_index(bonemill_geometry::Point::from_coords(*p));
        let dims = self.grid.dims();
        let held = std::array::from_fn(|k| place[k].round().clamp(0.0, dims[k] as f64 - 1.0));
        let beyond =
            (0..3).map(|k| (place[k] - place[k].clamp(0.0, dims[k] as f64 - 1.0)).powi(2)).sum::<f64>();
        let squared = f64::from(self.squared[self.grid.index(held.map(|x: f64| x as usize))]);
        LATTICE_MM * (squared + beyond).sqrt()
    }
}

/// Clears pieces of tissue, joined by faces, that are smaller than [`SPECK_MM3`].
fn drop_specks(grid: &Grid<Ct>, tissue: &mut [bool]) {
    let least = (SPECK_MM3 / LATTICE_MM.powi(3)).ceil() as usize;
    let dims = grid.dims();
    let steps = [1, dims[0], dims[0] * dims[1]];
    let mut piece_of = vec![0u32; tissue.len()];
    let mut sizes = vec![0usize];
    for from in 0..tissue.len() {
        if !tissue[from] || piece_of[from] > 0 {
            continue;
        }
        let number = sizes.len() as u32;
        let (mut front, mut size) = (vec![from], 0);
        piece_of[from] = number;
        while let Some(n) = front.pop() {
            size += 1;
            let voxel = grid.voxel(n);
            for k in 0..3 {
                let beside =
                    [(voxel[k] > 0).then(|| n - steps[k]), (voxel[k] + 1 < dims[k]).then(|| n + steps[k])];
                for other in beside.into_iter().flatten().filter(|other| tissue[*other]) {
                    if piece_of[other] == 0 {
                        piece_of[other] = number;
                        front.push(other);
                    }
                }
            }
        }
        sizes.push(size);
    }
    for (is, piece) in tissue.iter_mut().zip(&piece_of) {
        *is = *is && sizes[*piece as usize] >= least;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tissue_goes_on_beyond_the_scan_but_for_the_faces_toward_the_approach() {
        let axes = nalgebra::Matrix3::identity();
        let grid = Grid::<Ct>::new([10; 3], Vector3::repeat(2.0), axes, Vector3::zeros()).unwrap();
        let ct = Volume::new(grid.clone(), vec![0.0; grid.len()]).unwrap();
        let middle = Vector3::repeat(9.0);
        let found = |approach: Vector3<f64>, way: Vector3<f64>| {
            Tissue::of(&ct, 40.0, &approach).unwrap().distance_mm(&(middle + way))
        };
        // 20 mm beyond a face
        let way = Vector3::x() * 30.0;
        assert!((found(Vector3::x(), way) - 20.0).abs() < 2.5);
        assert!(found(-Vector3::x(), way) < 2.5);
        assert!(found(Vector3::new(0.8, 0.6, 0.0), way) > 17.0);
        assert!(found(Vector3::new(0.4, 0.9, 0.1).normalize(), way) < 2.5);
        assert!((found(Vector3::new(0.4, 0.9, 0.1).normalize(), Vector3::y() * 30.0) - 20.0).abs() < 2.5);
    }
}
