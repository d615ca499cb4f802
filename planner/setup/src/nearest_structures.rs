//! The structure that matters at a waypoint: the one with the smallest distance less clearance.

use bonemill_geometry::{Ct, Point, Work, cancel};
use bonemill_imaging::StructureField;
use bonemill_toolpath::scene::{Scene, SceneStructure};
use nalgebra::Vector3;
use rayon::prelude::*;

use bonemill_case::Case;
use bonemill_cutting::burr::ModelError;
use bonemill_cutting::cost::Proximity;
use bonemill_planfile::toward::INFLUENCE_MM;

/// The nearest structure of a waypoint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NearStructure {
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
) -> Result<Option<NearStructure>, ModelError> {
    cancel::poll();
    let center_ct = scene.ct_from_work * center;
    let mut best: Option<(f64, usize, Vector3<f64>)> = None;
    for (number, (structure, clearance)) in scene.structures.iter().zip(clearances_mm).enumerate() {
        let Some(field) = &structure.field else { continue };
        // a structure that is certainly farther need not be measured exactly
        if best.as_ref().is_some_and(|(margin, ..)| !field.is_nearer_than(center_ct, margin + clearance)) {
            continue;
        }
        let to_nearest = to_nearest(scene, field, center_ct);
        let margin = to_nearest.norm() - clearance;
        if best.as_ref().is_none_or(|(least, ..)| margin < *least) {
            best = Some((margin, number, to_nearest));
        }
    }
    best.map(|(_, structure, to_nearest)| {
        let proximity = Proximity::new(to_nearest, radius_mm + clearances_mm[structure])?;
        Ok(NearStructure { structure, proximity })
    })
    .transpose()
}

/// From a place to the nearest point of a structure, work, mm.
fn to_nearest(scene: &Scene, field: &StructureField, center: Point<Ct>) -> Vector3<f64> {
    scene.ct_from_work.rotation.inverse() * (field.nearest(center).1 - center)
}

/// The structures that enter a cost or a cap at a burr's centre: the one with the smallest distance less clearance first, then
/// those within [`INFLUENCE_MM`], in the scene's order.
///
/// # Errors
/// As [`nearest_structure`].
pub fn structures_within(
    scene: &Scene,
    clearances_mm: &[f64],
    radius_mm: f64,
    center: Point<Work>,
) -> Result<Vec<NearStructure>, ModelError> {
    let Some(first) = nearest_structure(scene, clearances_mm, radius_mm, center)? else {
        return Ok(Vec::new());
    };
    let center_ct = scene.ct_from_work * center;
    let mut near = vec![first];
    for (number, (structure, clearance)) in scene.structures.iter().zip(clearances_mm).enumerate() {
        let Some(field) = structure.field.as_ref().filter(|_| number != first.structure) else { continue };
        if !field.is_nearer_than(center_ct, radius_mm + clearance + INFLUENCE_MM) {
            continue;
        }
        let to_nearest = to_nearest(scene, field, center_ct);
        near.push(NearStructure {
            structure: number,
            proximity: Proximity::new(to_nearest, radius_mm + clearance)?,
        });
    }
    Ok(near)
}

/// [`structures_within`] of every centre of the burr.
///
/// # Errors
/// As [`nearest_structure`].
pub fn along(
    case: &Case,
    scene: &Scene,
    centers: &[Point<Work>],
) -> Result<Vec<Vec<NearStructure>>, ModelError> {
    let (clearances_mm, radius_mm) = (case.clearances_mm(), case.burr.radius_mm);
    let within = |center: &Point<Work>| structures_within(scene, &clearances_mm, radius_mm, *center);
    centers.par_iter().map(within).collect()
}

/// Per structure of the scene the least distance of the burr's centre over all `centers`, mm, and the first of them where it is; none
/// for a structure farther than distances are exact, which is at least the burr's diameter, the largest clearance and 12 mm.
pub fn least_distances(scene: &Scene, centers: &[Point<Work>]) -> Vec<Option<(f64, usize)>> {
    let least = |structure: &SceneStructure| {
        let field = structure.field.as_ref()?;
        let mut least: Option<(f64, usize)> = None;
        for (index, center) in centers.iter().enumerate() {
            let center = scene.ct_from_work * *center;
            if least.is_none_or(|(mm, _)| field.is_nearer_than(center, mm)) {
                least = Some((to_nearest(scene, field, center).norm(), index));
            }
        }
        least.filter(|(mm, _)| *mm <= field.reach_mm())
    };
    scene.structures.par_iter().map(least).collect()
}
