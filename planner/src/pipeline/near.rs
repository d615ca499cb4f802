//! The structure that matters at a waypoint: the one with the smallest distance less clearance.

use bonemill_geometry::{Point, Work, cancel};
use bonemill_imaging::Scene;
use rayon::prelude::*;

use crate::burr::ModelError;
use crate::cost::Proximity;
use crate::path::PathPoint;

/// The nearest structure of a waypoint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Near {
    /// Its number in the case.
    pub structure: usize,
    /// Direction, distance and least distance.
    pub proximity: Proximity,
}

/// The structure with the smallest distance less clearance from the burr's centre, in work.
///
/// # Errors
/// When the burr's centre lies inside a structure: there is no direction toward it.
pub fn nearest_structure(
    scene: &Scene,
    clearances_mm: &[f64],
    radius_mm: f64,
    center: Point<Work>,
) -> Result<Option<Near>, ModelError> {
    cancel::poll();
    let center_ct = scene.ct_from_work * center;
    let mut best: Option<(f64, usize, Point<bonemill_geometry::Ct>)> = None;
    for (number, (structure, clearance)) in scene.structures.iter().zip(clearances_mm).enumerate() {
        let Some(field) = &structure.field else { continue };
        // a structure that is certainly farther need not be measured exactly
        if best.as_ref().is_some_and(|(margin, ..)| !field.is_nearer_than(center_ct, margin + clearance)) {
            continue;
        }
        let (distance_mm, nearest) = field.nearest(center_ct);
        let margin = distance_mm - clearance;
        if best.as_ref().is_none_or(|(least, ..)| margin < *least) {
            best = Some((margin, number, nearest));
        }
    }
    best.map(|(_, structure, nearest)| {
        let to_nearest = scene.ct_from_work.rotation.inverse() * (nearest - center_ct);
        let proximity = Proximity::new(to_nearest, radius_mm + clearances_mm[structure])?;
        Ok(Near { structure, proximity })
    })
    .transpose()
}

/// [`nearest_structure`] of every waypoint.
///
/// # Errors
/// As [`nearest_structure`].
pub fn nearest_structures(
    scene: &Scene,
    clearances_mm: &[f64],
    radius_mm: f64,
    points: &[PathPoint],
) -> Result<Vec<Option<Near>>, ModelError> {
    points.par_iter().map(|p| nearest_structure(scene, clearances_mm, radius_mm, p.position)).collect()
}

/// The structures of every waypoint that the cost or a cap looks at: the nearest one first, then those whose distance less
/// clearance is below `influence_mm` beyond the burr's radius.
///
/// # Errors
/// As [`nearest_structure`].
pub fn structures_in_reach(
    scene: &Scene,
    clearances_mm: &[f64],
    radius_mm: f64,
    influence_mm: f64,
    points: &[PathPoint],
    nearest: &[Option<Near>],
) -> Result<Vec<Vec<Near>>, ModelError> {
    let others = |(point, first): (&PathPoint, &Option<Near>)| -> Result<Vec<Near>, ModelError> {
        let mut near: Vec<Near> = first.iter().copied().collect();
        let Some(first) = first else { return Ok(near) };
        let center_ct = scene.ct_from_work * point.position;
        for (number, (structure, clearance)) in scene.structures.iter().zip(clearances_mm).enumerate() {
            let Some(field) = structure.field.as_ref().filter(|_| number != first.structure) else {
                continue;
            };
            if !field.is_nearer_than(center_ct, radius_mm + clearance + influence_mm) {
                continue;
            }
            let (_, place) = field.nearest(center_ct);
            let to_nearest = scene.ct_from_work.rotation.inverse() * (place - center_ct);
            near.push(Near {
                structure: number,
                proximity: Proximity::new(to_nearest, radius_mm + clearance)?,
            });
        }
        Ok(near)
    };
    points.par_iter().zip(nearest).map(others).collect()
}
