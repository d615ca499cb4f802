//! How near every move of a plan comes to each structure, from the distances at its waypoints.
//!
//! A distance changes by no more than the burr travels, so that a move of length L between places at distances a and b comes no
//! nearer than (a + b − L)/2; nor nearer than the clearance where both ends keep it, since the planner keeps it all the way.
//! Distances are those of `forces.csv`; a structure without a row at a waypoint is beyond its influence there, and counts as at
//! its edge.

use super::toward::INFLUENCE_MM;
use super::{ForceToward, StoredPlan, Waypoint};

/// The room between the burr's surface and the nearest structure during a move.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gap {
    /// Place of the structure in the case.
    pub structure: usize,
    /// From the burr's surface to it, at least; below 0 where a plan touches it, mm.
    pub gap_mm: f64,
}

/// The smallest gap of every move, by the waypoint where it ends; empty in a case without structures.
pub fn least_gaps(plan: &StoredPlan) -> Vec<Gap> {
    let mut least: Vec<Gap> = Vec::new();
    for structure in 0..plan.record.case.structures.len() {
        let near = Nearness::of(plan, structure);
        let gaps = (0..plan.waypoints.len()).map(|n| Gap { structure, gap_mm: near.gap_mm(n) });
        if least.is_empty() {
            least = gaps.collect();
        } else {
            let nearer = |(least, gap): (&mut Gap, Gap)| {
                if gap.gap_mm < least.gap_mm {
                    *least = gap;
                }
            };
            least.iter_mut().zip(gaps).for_each(nearer);
        }
    }
    least
}

/// How near each move comes to one structure.
pub(super) struct Nearness<'a> {
    pub(super) waypoints: &'a [Waypoint],
    /// From the burr's centre, a waypoint each, mm.
    pub(super) distances_mm: Vec<f64>,
    pub(super) radius_mm: f64,
    pub(super) clearance_mm: f64,
}

impl<'a> Nearness<'a> {
    pub(super) fn of(plan: &'a StoredPlan, structure: usize) -> Self {
        let case = &plan.record.case;
        let radius_mm = plan.record.cutter_radius_mm();
        let clearance_mm = case.structures.get(structure).map_or(0.0, |s| s.clearance_mm);
        let mut distances_mm = vec![radius_mm + clearance_mm + INFLUENCE_MM; plan.waypoints.len()];
        for ForceToward { waypoint, distance_mm, .. } in
            plan.forces.iter().filter(|f| f.structure == structure)
        {
            if let Some(here) = distances_mm.get_mut(*waypoint) {
                *here = *distance_mm;
            }
        }
        Self { waypoints: &plan.waypoints, distances_mm, radius_mm, clearance_mm }
    }

    /// The least gap of the move that ends at a waypoint, mm; at the first waypoint, where the motion begins, the gap there.
    pub(super) fn gap_mm(&self, waypoint: usize) -> f64 {
        let b = self.distances_mm.get(waypoint).copied().unwrap_or(f64::INFINITY);
        let ends = waypoint.checked_sub(1).and_then(|start| {
            Some((self.distances_mm.get(start)?, self.waypoints.get(start)?, self.waypoints.get(waypoint)?))
        });
        let nearest_mm = ends.map_or(b, |(a, from, to)| {
            let length_mm = from.position.distance_mm(&to.position);
            let ends_mm = a.min(b);
            // a distance of the edge of influence is only a bound, so that the ends count, too
            ends_mm.min((0.5 * (a + b - length_mm)).max(self.radius_mm + self.clearance_mm))
        });
        nearest_mm - self.radius_mm
    }

    /// The first move that may come nearer than so many mm from the burr's surface.
    pub(super) fn first_move_within(&self, gap_mm: f64) -> Option<usize> {
        (0..self.waypoints.len()).find(|n| self.gap_mm(*n) < gap_mm)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bonemill_cutting::cutter::MoveKind;
    use bonemill_geometry::Point;
    use nalgebra::Vector3;
    use proptest::prelude::*;

    fn waypoint(x_mm: f64) -> Waypoint {
        Waypoint {
            layer: 0,
            kind: MoveKind::Cut,
            time_s: 0.0,
            position: Point::new(x_mm, 0.0, 0.0),
            axis: Vector3::z(),
            theta_rad: 0.0,
            phi_rad: 0.0,
            speed_mm_s: 1.0,
            driven_mm_s: 1.0,
            mass_mg: 0.0,
            inertia: None,
            force_n: Vector3::zeros(),
            peak_force_n: 0.0,
            mean_force_n: 0.0,
            force_toward_n: None,
            structure: None,
            distance_mm: None,
            alpha1: None,
            cost: None,
            deflection_toward_um: None,
        }
    }

    proptest! {
        /// A structure at the origin, a walk along x through and past it: no place of a move is nearer than its gap, and no
        /// place before the hold is nearer than the hold's distance.
        #[test]
        fn no_place_of_a_move_is_nearer_than_its_gap(
            steps in prop::collection::vec(-9.0..4.0f64, 1..40),
            hold_mm in 0.0..8.0f64,
        ) {
            let radius_mm = 2.0;
            let mut x_mm = 15.0;
            let places: Vec<f64> = steps.iter().map(|step| { x_mm += step; x_mm }).collect();
            let waypoints: Vec<Waypoint> = places.iter().map(|x| waypoint(*x)).collect();
            let distances_mm: Vec<f64> = places.iter().map(|x| x.abs()).collect();
            let near = Nearness { waypoints: &waypoints, distances_mm, radius_mm, clearance_mm: -radius_mm };
            let first = near.first_move_within(hold_mm).unwrap_or(places.len());
            for (n, pair) in places.windows(2).enumerate() {
                for share in 0..=20 {
                    let x_mm = pair[0] + (pair[1] - pair[0]) * f64::from(share) / 20.0;
                    prop_assert!(x_mm.abs() - radius_mm >= near.gap_mm(n + 1) - 1e-9);
                    prop_assert!(n + 1 >= first || x_mm.abs() - radius_mm >= hold_mm - 1e-9);
                }
            }
            // nor is the hold later than the first waypoint that is nearer
            let nearer = places.iter().position(|x| x.abs() - radius_mm < hold_mm);
            prop_assert!(nearer.is_none_or(|n| first <= n));
        }
    }
}
