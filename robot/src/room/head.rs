//! The patient as a distance field on coarse cells.

use std::sync::Arc;

use bonemill_geometry::{Base, Ct, Point, Rigid, Volume};

/// Distance from what was scanned, on a grid that holds all of it.
///
/// The field has the distance between the centres of cells; a cell that holds any of the patient has 0. The bound of a point is
/// the value of its cell, less half the cell's diagonal (the patient may be anywhere in the nearest cell) and the point's
/// distance from its own cell's centre. Nothing of the patient lies outside the grid, so a point beyond it is at least as far as
/// √(a² + b²) from the patient, a its distance from the grid and b the bound at the grid's nearest point.
#[derive(Debug, Clone)]
pub struct Head {
    distance_mm: Arc<Volume<f32, Ct>>,
    ct_from_base: Rigid<Ct, Base>,
    half_diagonal_mm: f64,
}

impl Head {
    /// From the distance between centres of cells, mm.
    pub fn new(distance_mm: Volume<f32, Ct>, base_from_ct: &Rigid<Base, Ct>) -> Self {
        let half_diagonal_mm = 0.5 * distance_mm.grid().diagonal_mm();
        Self { distance_mm: Arc::new(distance_mm), ct_from_base: base_from_ct.inverse(), half_diagonal_mm }
    }

    /// The same patient, seen from a base elsewhere.
    pub fn seen_from(&self, base_from_ct: &Rigid<Base, Ct>) -> Self {
        Self { ct_from_base: base_from_ct.inverse(), ..self.clone() }
    }

    /// A bound, or any that is at least `enough_mm`.
    pub(super) fn at_least_mm(&self, p: &Point<Base>, enough_mm: f64) -> f64 {
        let grid = self.distance_mm.grid();
        let (dims, spacing) = (grid.dims(), grid.spacing_mm());
        let place = grid.continuous_index(self.ct_from_base * *p);
        let (mut cell, mut beyond, mut within) = ([0usize; 3], 0.0, 0.0);
        for k in 0..3 {
            let most = dims[k] as f64 - 0.5;
            let held = place[k].clamp(-0.5, most);
            let nearest = held.round().clamp(0.0, dims[k] as f64 - 1.0);
            cell[k] = nearest as usize;
            let (out_mm, in_mm) = ((place[k] - held) * spacing[k], (held - nearest) * spacing[k]);
            beyond += out_mm * out_mm;
            within += in_mm * in_mm;
        }
        if enough_mm > 0.0 && beyond >= enough_mm * enough_mm {
            return beyond.sqrt();
        }
        let value = f64::from(self.distance_mm.data()[grid.index(cell)]);
        let bound_mm = value - self.half_diagonal_mm - within.sqrt();
        if beyond > 0.0 { (beyond + bound_mm.max(0.0) * bound_mm.max(0.0)).sqrt() } else { bound_mm }
    }

    /// The most by which a bound falls short of the distance from the marked cells, mm.
    pub(super) fn error_mm(&self) -> f64 {
        4.0 * self.half_diagonal_mm
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bonemill_geometry::Grid;
    use nalgebra::{Matrix3, Rotation3, Vector3};

    #[test]
    fn bounds_hold_inside_and_beyond_the_grid() {
        let spacing = Vector3::new(2.0, 3.0, 2.5);
        let dims = [12, 10, 11];
        let grid = Grid::<Ct>::new(dims, spacing, Matrix3::identity(), Vector3::new(5.0, -3.0, 1.0)).unwrap();
        let marked = [[3, 4, 5], [9, 1, 10], [0, 9, 0]];
        let centres = marked.map(|cell| grid.center(cell));
        let values = (0..grid.len()).map(|n| {
            let at = grid.center(grid.voxel(n));
            centres.iter().map(|c| c.distance_mm(&at)).fold(f64::INFINITY, f64::min) as f32
        });
        let field = Volume::new(grid.clone(), values.collect()).unwrap();
        let base_from_ct =
            Rigid::new(Rotation3::from_euler_angles(0.4, 1.0, -2.0), Vector3::new(9.0, 8.0, -70.0));
        let head = Head::new(field, &base_from_ct);
        for n in 0..5000 {
            let share = |k: i32| f64::from((n * k) % 5003) / 2501.5 - 1.0;
            let in_ct = Point::<Ct>::new(
                15.0 + 60.0 * share(17),
                10.0 + 60.0 * share(389),
                14.0 + 60.0 * share(1777),
            );
            let to_box =
                |c: &Point<Ct>| ((in_ct - *c).abs() - 0.5 * spacing).map(|mm: f64| mm.max(0.0)).norm();
            let truth = centres.iter().map(to_box).fold(f64::INFINITY, f64::min);
            let bound = head.at_least_mm(&(base_from_ct * in_ct), f64::INFINITY);
            assert!(bound <= truth + 1e-4, "{n}: {bound} {truth}");
            let is_within = grid.nearest(in_ct).is_some();
            assert!(!is_within || bound >= truth - head.error_mm(), "{n}: {bound} {truth}");
        }
    }
}
