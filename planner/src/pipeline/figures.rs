//! What a reader first asks of a plan, in one number each.

use crate::path::MoveKind;
use crate::plan::Waypoint;

/// One structure's figures.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct StructureFigures {
    /// Least distance from the burr's centre among the waypoints at which it is the structure that matters, mm.
    pub least_distance_mm: Option<f64>,
    /// Largest force toward it, N.
    pub peak_force_toward_n: f64,
}

/// Sums and extremes over the waypoints.
#[derive(Debug, Clone, PartialEq)]
pub struct Figures {
    /// Mass removed, mg.
    pub removed_mass_mg: f64,
    /// Length of the path, mm.
    pub path_length_mm: f64,
    /// Largest force, N.
    pub peak_force_n: f64,
    /// Mean over the time of cutting moves that remove material, N.
    pub mean_force_n: f64,
    /// Seconds spent on each kind of move.
    pub seconds_by_kind: [(MoveKind, f64); 3],
    /// Per structure of the case.
    pub structures: Vec<StructureFigures>,
}

impl Figures {
    /// Of the waypoints, with the lengths of their moves, mm.
    pub fn of(waypoints: &[Waypoint], length_mm: &[f64], structures: usize) -> Self {
        let mut found = Self {
            removed_mass_mg: waypoints.iter().map(|w| w.mass_mg).sum(),
            path_length_mm: length_mm.iter().sum(),
            peak_force_n: 0.0,
            mean_force_n: 0.0,
            seconds_by_kind: MoveKind::ALL.map(|kind| (kind, 0.0)),
            structures: vec![StructureFigures::default(); structures],
        };
        let (mut cutting_s, mut before_s) = (0.0, 0.0);
        for waypoint in waypoints {
            let seconds = waypoint.time_s - before_s;
            before_s = waypoint.time_s;
            for (_, total) in found.seconds_by_kind.iter_mut().filter(|(kind, _)| *kind == waypoint.kind) {
                *total += seconds;
            }
            if let Some(force_n) = waypoint.force_n.map(|f| f.norm()) {
                found.peak_force_n = found.peak_force_n.max(force_n);
                found.mean_force_n += force_n * seconds;
                cutting_s += seconds;
            }
            if let Some(structure) = waypoint.structure.and_then(|n| found.structures.get_mut(n)) {
                let least = [structure.least_distance_mm, waypoint.distance_mm]
                    .into_iter()
                    .flatten()
                    .reduce(f64::min);
                structure.least_distance_mm = least;
                structure.peak_force_toward_n =
                    structure.peak_force_toward_n.max(waypoint.force_toward_n.unwrap_or(0.0));
            }
        }
        if cutting_s > 0.0 {
            found.mean_force_n /= cutting_s;
        }
        found
    }
}
