//! The main figures of a plan: mass, length, forces, times and distances, one number each.

use bonemill_case::Case;
use bonemill_cutting::cutter::MoveKind;
use bonemill_planfile::toward::{StructureFigures, TowardSpan};
use bonemill_planfile::{ForceToward, Waypoint};

use super::reference::StructureForces;

/// Sums and extremes over the waypoints.
#[derive(Debug, Clone, PartialEq)]
pub struct Figures {
    /// Mass removed, mg.
    pub removed_mass_mg: f64,
    /// Length of the path, mm.
    pub path_length_mm: f64,
    /// Largest force, N.
    pub peak_force_n: f64,
    /// Mean over the time of moves that remove material, N.
    pub mean_force_n: f64,
    /// Seconds spent on each kind of move.
    pub seconds_by_kind: [(MoveKind, f64); 3],
    /// Per structure of the case.
    pub structures: Vec<StructureFigures>,
}

impl Figures {
    /// Of the waypoints of a case's plan, with the lengths of their moves, mm. `least`: per structure of the case the least distance of the
    /// burr's centre, mm, and its waypoint.
    pub fn of(
        case: &Case,
        waypoints: &[Waypoint],
        forces: &[ForceToward],
        length_mm: &[f64],
        least: &[Option<(f64, usize)>],
    ) -> Self {
        let mut found = Self {
            removed_mass_mg: waypoints.iter().map(|w| w.mass_mg).sum(),
            path_length_mm: length_mm.iter().sum(),
            peak_force_n: 0.0,
            mean_force_n: 0.0,
            seconds_by_kind: MoveKind::ALL.map(|kind| (kind, 0.0)),
            structures: Vec::new(),
        };
        let seconds = seconds(waypoints);
        let mut cutting_s = 0.0;
        for (waypoint, seconds) in waypoints.iter().zip(&seconds) {
            for (_, total) in found.seconds_by_kind.iter_mut().filter(|(kind, _)| *kind == waypoint.kind) {
                *total += seconds;
            }
        }
        for (n, waypoint) in waypoints.iter().enumerate().filter(|(_, w)| w.mass_mg > 0.0) {
            found.mean_force_n += waypoint.mean_force_n * seconds[n];
            cutting_s += seconds[n];
        }
        found.peak_force_n = waypoints.iter().map(|w| w.peak_force_n).fold(0.0, f64::max);
        if cutting_s > 0.0 {
            found.mean_force_n /= cutting_s;
        }
        let mut spans = vec![Vec::new(); least.len()];
        let cuts = |f: &&ForceToward| {
            waypoints[f.waypoint].mass_mg > 0.0 || waypoints[f.waypoint].peak_force_n > 0.0
        };
        for f in forces.iter().filter(cuts) {
            let row = f.waypoint;
            // a move that is planned to remove nothing may cut a skin: its peak counts, its time does not
            let taken = if waypoints[row].mass_mg > 0.0 { seconds[row] } else { 0.0 };
            let span = TowardSpan { seconds: taken, force_n: f.mean_toward_n, peak_n: f.peak_toward_n, row };
            spans[f.structure].push((span, f.distance_mm));
        }
        let sizes_mm = |n: usize| [case.burr.radius_mm, case.structures[n].clearance_mm];
        let of = |n: usize| StructureFigures::of(least[n], &spans[n], sizes_mm(n));
        found.structures = (0..least.len()).map(of).collect();
        found
    }

    /// Its forces, as references have them.
    pub(super) fn forces(&self) -> StructureForces {
        let structures = self.structures.clone();
        StructureForces { mean_n: self.mean_force_n, peak_n: self.peak_force_n, structures }
    }
}

/// How long the move to each waypoint takes, s.
fn seconds(waypoints: &[Waypoint]) -> Vec<f64> {
    let before = std::iter::once(0.0).chain(waypoints.iter().map(|w| w.time_s));
    waypoints.iter().zip(before).map(|(w, before)| w.time_s - before).collect()
}
