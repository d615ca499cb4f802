//! The main figures of a plan: mass, length, forces, times and distances, one number each.

use bonemill_cutter::MoveKind;
use bonemill_planfile::toward::{StructureFigures, TowardSpan};
use bonemill_planfile::{ForceToward, Waypoint};

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
    /// Of the waypoints, with the lengths of their moves, mm. `least`: per structure of the case the least distance of the burr's
    /// centre, mm, and its waypoint.
    pub fn of(
        waypoints: &[Waypoint],
        forces: &[ForceToward],
        length_mm: &[f64],
        least: &[Option<(f64, usize)>],
        radius_mm: f64,
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
            if waypoint.mass_mg > 0.0 {
                let force_n = waypoint.force_n.norm();
                found.peak_force_n = found.peak_force_n.max(force_n);
                found.mean_force_n += force_n * seconds;
                cutting_s += seconds;
            }
        }
        if cutting_s > 0.0 {
            found.mean_force_n /= cutting_s;
        }
        let mut spans = vec![Vec::new(); least.len()];
        for f in forces.iter().filter(|f| waypoints[f.waypoint].mass_mg > 0.0) {
            let (row, force_n) = (f.waypoint, f.force_toward_n);
            spans[f.structure].push((TowardSpan { seconds: seconds[row], force_n, row }, f.distance_mm));
        }
        let of = |(least, spans): (&Option<_>, &Vec<_>)| StructureFigures::of(*least, spans, radius_mm);
        found.structures = least.iter().zip(&spans).map(of).collect();
        found
    }
}

/// How long the move to each waypoint takes, s.
fn seconds(waypoints: &[Waypoint]) -> Vec<f64> {
    let before = std::iter::once(0.0).chain(waypoints.iter().map(|w| w.time_s));
    waypoints.iter().zip(before).map(|(w, before)| w.time_s - before).collect()
}
