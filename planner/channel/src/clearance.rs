//! The least distance between a straight line and a structure, from the structure's exact distance field.
//!
//! The distance to a structure changes no faster than the point moves (it is 1-Lipschitz). So from a place with distance d
//! nothing within d − best along the line is nearer than the best place found so far, and that much is passed over at once.

use bonemill_geometry::{Ct, Point};
use bonemill_imaging::StructureField;
use nalgebra::{Unit, Vector3};

/// The place on a line that is nearest to a structure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NearestPlace {
    /// Certain least distance of the line from the structure, mm; 0 where it runs through it.
    pub distance_mm: f64,
    /// How far along the line it is, mm.
    pub along_mm: f64,
    /// Unit direction from the line to the structure there; zero where the line runs through it.
    pub toward: Vector3<f64>,
}

/// A line from a point along a direction.
#[derive(Debug, Clone, Copy)]
pub struct Line<'a> {
    /// Where it begins.
    pub from: Point<Ct>,
    /// Where it leads.
    pub along: &'a Unit<Vector3<f64>>,
    /// How long it is, mm.
    pub length_mm: f64,
}

/// The least distance between a line and a structure. What is told is never above the true one, and at most `tolerance_mm`
/// (above 0) below it.
pub fn nearest_place(field: &StructureField, line: &Line<'_>, tolerance_mm: f64) -> NearestPlace {
    let place = |s: f64| line.from + line.along.as_ref() * s;
    let (mut best, mut at) = (f64::INFINITY, 0.0);
    let mut s = 0.0;
    loop {
        // the bound is cheap: most places need no search
        let (lower, _) = field.bounds(place(s));
        let distance = if lower > best { lower } else { field.distance(place(s)) };
        if distance < best {
            (best, at) = (distance, s);
        }
        if best <= 0.0 || s >= line.length_mm {
            break;
        }
        s = (s + (distance - best).max(tolerance_mm)).min(line.length_mm);
    }
    let toward = (field.nearest(place(at)).1 - place(at)).try_normalize(0.0).unwrap_or_else(Vector3::zeros);
    NearestPlace { distance_mm: (best - tolerance_mm).max(0.0), along_mm: at, toward }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bonemill_geometry::{Grid, Volume};

    #[test]
    fn the_distance_of_a_line_is_that_of_a_dense_walk() {
        let grid = Grid::<Ct>::aligned([12, 12, 12], 0.5, Point::new(0.0, 0.0, 0.0)).unwrap();
        let mut labels = Volume::filled(grid, 0u16);
        for voxel in [[2, 2, 2], [3, 2, 2], [6, 7, 5], [9, 1, 10]] {
            let n = labels.grid().index(voxel);
            labels.data_mut()[n] = 4;
        }
        let field = StructureField::new(&labels, 4, None).unwrap().unwrap();
        for seed in 0..200usize {
            let number = |n: usize| ((seed * 97 + n * 53) % 101) as f64 / 101.0;
            let from = Point::new(9.0 * number(1) - 2.0, 9.0 * number(2) - 2.0, 9.0 * number(3) - 2.0);
            let along = Unit::new_normalize(Vector3::new(number(4), number(5), number(6)).add_scalar(-0.5));
            let line = Line { from, along: &along, length_mm: 6.0 * number(7) };
            let found = nearest_place(&field, &line, 1e-3);
            let walk = (0..=6000).map(|n| from + along.as_ref() * (line.length_mm * f64::from(n) / 6000.0));
            let brute = walk.map(|p| field.distance(p)).fold(f64::INFINITY, f64::min);
            let below = brute - found.distance_mm;
            assert!((-1e-9..=2.1e-3).contains(&below), "seed {seed}: {below}");
        }
    }
}
