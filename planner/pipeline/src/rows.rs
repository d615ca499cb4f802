//! The rows of `waypoints.csv` and `forces.csv`: what is known of each waypoint, turned into ct.

use bonemill_geometry::basis;
use bonemill_planfile::{ForceToward, Waypoint};
use bonemill_setup::nearest_structures::NearStructure;
use nalgebra::Vector3;

use super::attempt::Attempt;
use super::path_forces::{extremes_of_move, mean_of_move};
use super::push::Push;

impl Attempt<'_> {
    /// The rows of `waypoints.csv`.
    pub(super) fn waypoint_rows(&self) -> Vec<Waypoint> {
        (0..self.prepared.points().len()).map(|i| self.waypoint_row(i)).collect()
    }

    fn waypoint_row(&self, i: usize) -> Waypoint {
        let (scene, point, moments) =
            (self.prepared.start.scene, &self.prepared.points()[i], &self.prepared.reached.moments[i]);
        let axis_work = &self.chosen.oriented.axes[i];
        let axis = scene.ct_from_work.rotate(axis_work);
        let (theta_rad, phi_rad) = basis::angles_from_axis(&scene.ct_from_approach().inverse().rotate(&axis));
        let cuts = moments.mass_mg() > 0.0;
        let push = self.push(i);
        let nearest = self.prepared.near[i].first();
        let toward = nearest.map(|n| push.toward(&n.proximity.toward));
        Waypoint {
            layer: point.layer,
            kind: self.chosen.kinds[i],
            time_s: self.timing.driven.times_s[i],
            position: scene.ct_from_work * point.position,
            axis,
            theta_rad,
            phi_rad,
            speed_mm_s: self.timing.caps_mm_s[i],
            driven_mm_s: self.timing.driven.driven_mm_s[i],
            mass_mg: moments.mass_mg(),
            inertia: cuts.then(|| moments.inertia_normalised(axis_work)),
            force_n: scene.ct_from_work.rotate(&push.force_n),
            peak_force_n: self.peaks(i).map(|(_, force)| force.norm()).fold(0.0, f64::max),
            mean_force_n: self.mean(i, |force, _| force.norm()),
            force_toward_n: toward.map(|t| t.force_n),
            structure: nearest.map(|n| n.structure),
            distance_mm: nearest.map(|n| n.proximity.distance_mm),
            alpha1: nearest.map(|_| self.chosen.costs[i].alpha_1),
            cost: cuts.then_some(self.chosen.costs[i].cost),
            deflection_toward_um: toward.and_then(|t| t.deflection_um),
        }
    }

    /// The rows of `forces.csv`: by waypoint, then in the case's order of structures.
    pub(super) fn force_rows(&self) -> Vec<ForceToward> {
        let near = &self.prepared.near;
        let mut rows = Vec::with_capacity(near.iter().map(Vec::len).sum());
        for (waypoint, near) in near.iter().enumerate() {
            let push = self.push(waypoint);
            let from = rows.len();
            rows.extend(near.iter().map(|near| self.force_row(waypoint, &push, near)));
            rows[from..].sort_by_key(|row| row.structure);
        }
        rows
    }

    fn force_row(&self, waypoint: usize, push: &Push, near: &NearStructure) -> ForceToward {
        let toward = push.toward(&near.proximity.toward);
        ForceToward {
            waypoint,
            structure: near.structure,
            distance_mm: near.proximity.distance_mm,
            toward: self.prepared.start.scene.ct_from_work.rotate(&near.proximity.toward),
            force_toward_n: toward.force_n,
            peak_toward_n: self.peaks(waypoint).map(|(at, force)| near.most(&force, at)).fold(0.0, f64::max),
            mean_toward_n: self.mean(waypoint, |force, at| force.dot(&near.toward(at)).max(0.0)),
            deflection_toward_um: toward.deflection_um,
        }
    }

    /// Forces that bound those of the move to waypoint i as it is driven, work, N, each with the share of the move's way.
    fn peaks(&self, i: usize) -> impl Iterator<Item = (f64, Vector3<f64>)> {
        let driven_mm_s = self.timing.driven.driven_mm_s[i];
        extremes_of_move(self.chosen.forces[i].as_ref(), &self.chosen.within[i], driven_mm_s)
    }

    /// The mean over the move to waypoint i of what is asked of the force, work, and the share of the move's way.
    fn mean(&self, i: usize, of: impl Fn(&Vector3<f64>, f64) -> f64) -> f64 {
        let driven = &self.timing.driven;
        let seconds = driven.times_s[i] - i.checked_sub(1).map_or(0.0, |before| driven.times_s[before]);
        let figures = [self.prepared.length_mm()[i], seconds, driven.driven_mm_s[i]];
        let passed = |way: f64| driven.passed(i, way);
        mean_of_move(self.chosen.forces[i].as_ref(), &self.chosen.within[i], figures, passed, of)
    }

    /// What pushes the burr at waypoint i.
    fn push(&self, i: usize) -> Push {
        let compliance = self.chosen.compliances.as_ref().map(|c| &c[i]);
        Push::new(self.chosen.forces[i].as_ref(), self.timing.driven.driven_mm_s[i], compliance)
    }
}
