//! The levels of push that a plan's speeds keep, and the cuts that are beyond them.

use bonemill_case::{Case, ForceTerm};
use bonemill_cutting::speed::{CutPushes, Levels};
use bonemill_setup::nearest_structures::NearStructure;

use super::choose::Chosen;

/// Beyond a level by more than this share of it is no rounding.
const ROUNDING: f64 = 1e-6;

/// The levels of push that the speeds keep, as far as they can: mm where [`Self::is_deflection`], else N.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpeedLevels {
    /// Whether the levels are of the burr's deflection.
    pub is_deflection: bool,
    /// Largest weighted push toward a structure of every cut faster than the least speed.
    pub toward: f64,
    /// Largest push in any direction of the same.
    pub overall: f64,
    /// Cuts that push more although they go at the least speed.
    pub exceeded: usize,
    /// The one of them that is farthest beyond a level.
    pub worst: Option<Exceeded>,
}

/// A cut whose push is beyond a level at the least speed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Exceeded {
    /// Where it ends.
    pub waypoint: usize,
    /// By how much, in the unit of the level.
    pub by: f64,
    /// The structure toward which it pushes too much, by its number in the case; none where the push in any direction is too much.
    pub structure: Option<usize>,
}

/// Whether pushes are deflections.
pub(super) fn is_deflection(case: &Case, chosen: &Chosen) -> bool {
    case.cost.force == ForceTerm::Deflection && chosen.compliances.is_some()
}

impl SpeedLevels {
    /// Of the levels by which `speed_mm_s` were chosen. `near`: per waypoint the structures in the order of its pushes.
    pub(super) fn of(
        levels: &Levels,
        pushes: &[Option<CutPushes>],
        speed_mm_s: &[f64],
        near: &[Vec<NearStructure>],
        is_deflection: bool,
    ) -> Self {
        let mut found = Self { is_deflection, toward: 0.0, overall: 0.0, exceeded: 0, worst: None };
        for (waypoint, (pushes, speed)) in pushes.iter().zip(speed_mm_s).enumerate() {
            let Some(pushes) = pushes else { continue };
            let toward = pushes.toward(*speed);
            let (toward_n, overall) = (toward.map_or(0.0, |(push, _)| push), pushes.overall(*speed));
            found.toward = found.toward.max(toward_n.min(levels.toward));
            found.overall = found.overall.max(overall.min(levels.overall));
            let both = || NearStructure::in_both_directions(&near[waypoint], 1.0);
            let structure = toward.map(|(_, n)| both()[n].structure);
            let beyond = |push: f64, level: f64| (push > level * (1.0 + ROUNDING)).then_some(push - level);
            let toward = beyond(toward_n, levels.toward).map(|by| Exceeded { waypoint, by, structure });
            let overall =
                beyond(overall, levels.overall).map(|by| Exceeded { waypoint, by, structure: None });
            // a structure comes first, as it does in the choice of speeds
            let Some(worse) = toward.or(overall) else { continue };
            found.exceeded += 1;
            let is_worse =
                |w: &Exceeded| (worse.structure.is_some(), worse.by) > (w.structure.is_some(), w.by);
            if found.worst.as_ref().is_none_or(is_worse) {
                found.worst = Some(worse);
            }
        }
        found
    }

    /// The levels' unit in files, and what a level is multiplied by to be in it.
    pub fn unit(&self) -> (&'static str, f64) {
        if self.is_deflection { ("um", 1e3) } else { ("n", 1.0) }
    }

    /// The levels and what is beyond them, as a sentence.
    pub fn sentence(&self, case: &Case) -> String {
        let (unit, factor) = if self.is_deflection { ("µm", 1e3) } else { ("N", 1.0) };
        let value = |level: f64| format!("{:.3} {unit}", factor * level);
        let kept = format!(
            "at most {} toward a structure (weighted by nearness and rank) and {} in all",
            value(self.toward),
            value(self.overall)
        );
        let Some(worst) = self.worst else { return kept };
        let to = worst.structure.and_then(|n| case.structures.get(n));
        let to = to.map_or(String::new(), |structure| format!(" toward {}", structure.name));
        format!(
            "{kept}, except in {} at the least speed; the worst, waypoint {}, is {}{to} beyond",
            if self.exceeded == 1 { "1 cut".to_owned() } else { format!("{} cuts", self.exceeded) },
            worst.waypoint,
            value(worst.by),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bonemill_cutting::burr::EngagedForce;
    use bonemill_cutting::cost::Proximity;
    use nalgebra::Vector3;

    #[test]
    fn cuts_beyond_the_levels_are_counted_and_the_worst_toward_a_structure_is_named() {
        let near =
            |structure| NearStructure::new(structure, Proximity::new(Vector3::x() * 4.0, 3.5).unwrap());
        let push = |x: f64, y: f64| {
            let force = EngagedForce { cut_n_per_mm_s: Vector3::new(x, y, 0.0), ..EngagedForce::ZERO };
            Some(CutPushes::new(std::iter::once((&force, vec![(1.0, Vector3::x_axis())])), None))
        };
        let pushes = [push(0.1, 0.0), None, push(0.4, 0.0), push(-0.1, 6.0), push(0.5, 0.0)];
        let near: Vec<Vec<NearStructure>> = (0..5).map(|n| vec![near(n)]).collect();
        let levels = Levels { toward: 0.15, overall: 2.0, speed_mm_s: 4.0 };
        let found = SpeedLevels::of(&levels, &pushes, &[1.5, 4.0, 0.5, 0.5, 0.5], &near, false);
        assert_eq!((found.toward, found.overall, found.exceeded), (0.15, 2.0, 3));
        let worst = found.worst.unwrap();
        assert_eq!((worst.waypoint, worst.structure), (4, Some(4)));
        assert!((worst.by - 0.1).abs() < 1e-12);
        // levels that bind nothing: the largest pushes are reported
        let free = Levels { toward: 9.0, overall: 9.0, speed_mm_s: 4.0 };
        let found = SpeedLevels::of(&free, &pushes, &[1.5, 4.0, 0.5, 0.5, 0.5], &near, true);
        assert_eq!((found.toward, found.exceeded, found.unit()), (0.25, 0, ("um", 1e3)));
        // a push in the direction before is one toward the structure to which the direction jumped
        let jumped = NearStructure { before: Some(Vector3::y_axis()), ..near[3][0] };
        let both = vec![jumped, near[4][0]];
        let toward = vec![(1.0, -Vector3::x_axis()), (1.0, -Vector3::x_axis()), (1.0, Vector3::y_axis())];
        let force = EngagedForce { cut_n_per_mm_s: Vector3::y() * 6.0, ..EngagedForce::ZERO };
        let pushes = [Some(CutPushes::new(std::iter::once((&force, toward)), None))];
        let found = SpeedLevels::of(&levels, &pushes, &[0.5], &[both], false);
        assert_eq!(found.worst.unwrap().structure, Some(3));
    }
}
