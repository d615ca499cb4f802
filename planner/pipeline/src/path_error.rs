//! How exact the removed volume and the least distances of a plan are, measured on the plan itself.
//!
//! Volumes are counted by the centres of the planning grid's voxels. Those of the target that the surface of what is removed may cut are
//! divided, and their parts counted. Distances to structures are exact, but stated at waypoints; where one may be less on the way, it is computed
//! between them too.

use bonemill_cutting::stock::removal::RemovalTime;
use bonemill_geometry::capsule::segment_distance_squared;
use bonemill_geometry::{Point, Work, cancel};
use bonemill_toolpath::neighbours::joined;
use bonemill_toolpath::path::PathPoint;
use bonemill_toolpath::scene::{Class, Scene};
use nalgebra::Vector3;
use rayon::prelude::*;

/// Voxels that are divided at most, evenly over those that may be cut.
const MOST_VOXELS: usize = 2048;
/// Parts of a voxel along each axis.
const PARTS: usize = 6;
/// Places between two waypoints.
const PLACES: usize = 16;

/// Errors of what is stated of a path.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PathError {
    /// Error of the target's removed volume, as a share of the target; positive where more is removed than stated.
    pub removed_share: f64,
    /// By how much the distance to a structure is less between two waypoints than its least at one, mm.
    pub distance_mm: f64,
}

impl PathError {
    /// Of a path through `points` with a ball of `radius_mm`; `least_mm`: the stated least distance of the burr's centre to each structure.
    pub(super) fn of(
        scene: &Scene,
        removal: &RemovalTime,
        (points, radius_mm): (&[PathPoint], f64),
        least_mm: impl Iterator<Item = Option<f64>>,
    ) -> Self {
        let removed_share = removed_error(scene, removal, points, radius_mm);
        let distance_mm = scene.structures.iter().zip(least_mm).filter_map(|(structure, least_mm)| {
            let (field, least_mm) = (structure.field.as_ref()?, least_mm?);
            let is_nearer = |p: Point<Work>, mm: f64| field.is_nearer_than(scene.ct_from_work * p, mm);
            let distance_mm = |p: Point<Work>| field.distance(scene.ct_from_work * p);
            Some(least_mm - least_between(points, least_mm, is_nearer, distance_mm))
        });
        Self { removed_share, distance_mm: distance_mm.fold(0.0, f64::max) }
    }
}

/// The volume that is removed beyond the stated one, as a share of the target.
fn removed_error(scene: &Scene, removal: &RemovalTime, points: &[PathPoint], radius_mm: f64) -> f64 {
    let grid = scene.class.grid();
    let target: Vec<usize> = (0..grid.len()).filter(|n| scene.class.data()[*n].is(Class::TARGET)).collect();
    // both where the surface may pass
    let (standing, removed) = (1, 2);
    let is: Vec<u8> =
        (0..grid.len()).map(|n| if removal.is_removed(n) { removed } else { standing }).collect();
    let around = joined(&is, grid.dims(), |a, b| a | b);
    let cut: Vec<usize> = target.iter().copied().filter(|n| around[*n] == standing | removed).collect();
    let sample: Vec<usize> = cut.iter().copied().step_by(cut.len().div_ceil(MOST_VOXELS).max(1)).collect();
    if sample.is_empty() {
        return 0.0;
    }
    let moves: Vec<[Vector3<f64>; 2]> =
        points.windows(2).map(|pair| [pair[0].position.coords, pair[1].position.coords]).collect();
    let half = 0.5 * grid.spacing_mm();
    let beyond = |n: usize| {
        cancel::poll();
        let center = grid.center(grid.voxel(n)).coords;
        let reach_mm = radius_mm + half.norm();
        let near: Vec<_> = moves
            .iter()
            .filter(|[a, b]| segment_distance_squared(&center, a, b) <= reach_mm.powi(2))
            .collect();
        let is_within = |part: usize| {
            let at = [part % PARTS, part / PARTS % PARTS, part / (PARTS * PARTS)];
            let share = Vector3::from(at.map(|n| (2 * n + 1) as f64 / PARTS as f64 - 1.0));
            let p = center + share.component_mul(&half);
            near.iter().any(|[a, b]| segment_distance_squared(&p, a, b) <= radius_mm.powi(2))
        };
        let parts = PARTS.pow(3);
        let within = (0..parts).filter(|part| is_within(*part)).count() as f64 / parts as f64;
        within - f64::from(u8::from(removal.is_removed(n)))
    };
    let found: Vec<f64> = sample.par_iter().map(|n| beyond(*n)).collect();
    let mean = found.iter().sum::<f64>() / sample.len() as f64;
    mean * cut.len() as f64 / target.len() as f64
}

/// The least distance on the way, where that may be less than at any waypoint, mm.
fn least_between(
    points: &[PathPoint],
    least_mm: f64,
    is_nearer: impl Fn(Point<Work>, f64) -> bool + Sync,
    distance_mm: impl Fn(Point<Work>) -> f64 + Sync,
) -> f64 {
    let on_the_way = |i: usize| {
        let (a, b) = (points[i - 1].position, points[i].position);
        // a distance changes by no more than the way
        if !is_nearer(b, least_mm + (b - a).norm()) {
            return least_mm;
        }
        let places = (1..PLACES).map(|n| distance_mm(a + (b - a) * (n as f64 / PLACES as f64)));
        places.fold(least_mm, f64::min)
    };
    let least: Vec<f64> = (1..points.len()).into_par_iter().map(on_the_way).collect();
    least.into_iter().fold(least_mm, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use bonemill_toolpath::path::MoveKind;

    fn at(x: f64, y: f64) -> PathPoint {
        PathPoint { position: Point::new(x, y, 0.0), kind: MoveKind::Cut, layer: 0, leads_to: (0, 0) }
    }

    #[test]
    fn the_least_distance_between_waypoints_is_found() {
        // a point 3 mm aside from the middle of a move of 4 mm
        let points = [at(-10.0, 0.0), at(-2.0, 0.0), at(2.0, 0.0), at(2.0, -9.0)];
        let distance_mm = |p: Point<Work>| (p - Point::new(0.0, 3.0, 0.0)).norm();
        let is_nearer = |p: Point<Work>, mm: f64| distance_mm(p) < mm;
        let stated = 13f64.sqrt();
        assert!((least_between(&points, stated, is_nearer, distance_mm) - 3.0).abs() < 1e-12);
        // where waypoints lie everywhere, nothing is less
        assert!(
            (least_between(&[at(-2.0, 0.0), at(0.0, 0.0), at(2.0, 0.0)], 3.0, is_nearer, distance_mm) - 3.0)
                .abs()
                < 1e-12
        );
    }
}
