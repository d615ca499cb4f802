//! The structure that matters at a waypoint: the one with the smallest distance less clearance.

use bonemill_geometry::{Ct, Point, Work, cancel};
use bonemill_imaging::StructureField;
use bonemill_toolpath::scene::{Scene, SceneStructure};
use nalgebra::{Unit, Vector3};
use rayon::prelude::*;

use bonemill_case::Case;
use bonemill_cutting::burr::ModelError;
use bonemill_cutting::cost::Proximity;
use bonemill_planfile::toward::INFLUENCE_MM;

/// Between two waypoints the direction to a structure jumps if it changes by more than this, rad, and the points that were and are the nearest
/// lie as far apart as seen from where the move ends: another part of the structure has become the nearest.
const JUMP_RAD: f64 = 0.1;

/// The nearest structure of a waypoint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NearStructure {
    /// Its number in the case.
    pub structure: usize,
    /// Direction, distance and least distance, where the move ends.
    pub proximity: Proximity,
    /// The direction where the move begins, or the same where it jumps within the move.
    pub begins: Unit<Vector3<f64>>,
    /// Where it jumps, that to the part which was the nearest at the waypoint before.
    pub before: Option<Unit<Vector3<f64>>>,
}

impl NearStructure {
    /// Of a place that no move leads to.
    pub fn new(structure: usize, proximity: Proximity) -> Self {
        Self { structure, proximity, begins: proximity.toward, before: None }
    }

    /// The direction to it after a share of the move's way. Along a straight move it is the same up to the squared change, whether the nearest
    /// point stays or moves along with the burr; beyond 0 and 1 are its corners.
    pub fn toward(&self, share: f64) -> Unit<Vector3<f64>> {
        match share {
            ..=0.0 => self.begins,
            1.0.. => self.proximity.toward,
            share => Unit::new_normalize(self.begins.lerp(&self.proximity.toward, share)),
        }
    }

    /// The largest part of a force toward it after a share of the move's way; below 0 if it points away.
    pub fn most(&self, force: &Vector3<f64>, share: f64) -> f64 {
        let toward = force.dot(&self.toward(share));
        self.before.map_or(toward, |before| toward.max(force.dot(&before)))
    }

    /// The structures near a waypoint as they are seen after a share of the move to it, and again those to which the direction jumps, with the
    /// direction before.
    pub fn in_both_directions(near: &[Self], share: f64) -> Vec<Self> {
        let facing = |n: &Self, toward| Self { proximity: Proximity { toward, ..n.proximity }, ..*n };
        let seen = near.iter().map(|n| facing(n, n.toward(share)));
        seen.chain(near.iter().filter_map(|n| Some(facing(n, n.before?)))).collect()
    }
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
        Ok(NearStructure::new(structure, proximity))
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
        near.push(NearStructure::new(number, Proximity::new(to_nearest, radius_mm + clearance)?));
    }
    Ok(near)
}

/// [`structures_within`] of every centre of the burr along a path.
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
    let mut near: Vec<_> = centers.par_iter().map(within).collect::<Result<_, _>>()?;
    find_jumps(&mut near, centers);
    Ok(near)
}

/// Finds how the direction to a structure changes from one waypoint to the next, and where it jumps.
fn find_jumps(near: &mut [Vec<NearStructure>], centers: &[Point<Work>]) {
    for i in 1..near.len() {
        let [before, here] = &mut near[i - 1..=i] else { continue };
        for n in here {
            let same = before.iter().map(|other| (other.structure, &other.proximity));
            let mut same =
                same.filter(|(structure, _)| *structure == n.structure).map(|(_, proximity)| proximity);
            let Some(other) = same.next() else { continue };
            // the nearest point of the waypoint before, seen from here
            let point = centers[i - 1].coords + other.toward.into_inner() * other.distance_mm;
            let seen = Unit::try_new(point - centers[i].coords, 1e-9);
            let is_other = |direction: &Unit<Vector3<f64>>| direction.angle(&n.proximity.toward) > JUMP_RAD;
            n.before = seen.filter(|seen| is_other(&other.toward) && is_other(seen));
            if n.before.is_none() {
                n.begins = other.toward;
            }
        }
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn where_another_part_of_a_structure_becomes_the_nearest_a_push_toward_either_counts() {
        // past a corner of the first structure; the second begins to be near
        let near = |structure, angle: f64| {
            let to_nearest = 4.0 * Vector3::new(angle.cos(), angle.sin(), 0.0);
            NearStructure::new(structure, Proximity::new(to_nearest, 3.5).unwrap())
        };
        let mut path = vec![vec![near(0, 0.0)], vec![near(0, 0.05)], vec![near(1, 1.0), near(0, 0.25)]];
        let centers = [0.0, 0.0, 1.0].map(|y| Point::new(0.0, y, 0.0));
        find_jumps(&mut path, &centers);
        assert!(path[0][0].before.is_none() && path[1][0].before.is_none() && path[2][0].before.is_none());
        // the part that was the nearest, from where the burr is now
        let to_before = Vector3::new(4.0 * 0.05f64.cos(), 4.0 * 0.05f64.sin() - 1.0, 0.0);
        assert!(path[2][1].before.unwrap().angle(&to_before) < 1e-9);
        let both = NearStructure::in_both_directions(&path[2], 0.0);
        assert_eq!(both.iter().map(|n| n.structure).collect::<Vec<_>>(), [1, 0, 0]);
        let force = Vector3::new(1.0, -0.5, 0.0);
        let toward = both.iter().map(|n| force.dot(&n.proximity.toward));
        assert_eq!(path[2][1].most(&force, 0.0), toward.skip(1).fold(f64::MIN, f64::max));
        assert!(path[2][1].most(&force, 1.0) > force.dot(&path[2][1].proximity.toward) + 0.1);
    }

    #[test]
    fn within_a_move_a_structure_is_seen_from_where_the_burr_is() {
        // past a point 3 mm aside, and along a face 3 mm aside
        let centers = [0.0, 0.6].map(|x| Point::new(x, 0.0, 0.0));
        for point in [|_: f64| Vector3::new(0.2, 3.0, 0.0), |x: f64| Vector3::new(x, 3.0, 0.0)] {
            let to_nearest = |x: f64| point(x) - Vector3::x() * x;
            let at = |x: f64| vec![NearStructure::new(0, Proximity::new(to_nearest(x), 2.0).unwrap())];
            let mut path = vec![at(0.0), at(0.6)];
            find_jumps(&mut path, &centers);
            assert_eq!(path[1][0].before, None);
            for share in [0.0, 0.3, 0.7, 1.0] {
                assert!(path[1][0].toward(share).angle(&to_nearest(0.6 * share)) < 1e-3, "{share}");
            }
            assert_eq!(path[1][0].toward(1.5), path[1][0].proximity.toward);
        }
    }
}
