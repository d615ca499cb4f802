//! The largest force of a plan: its place and time, and whether it occurs in a single move.

use bonemill_planfile::Waypoint;

/// A peak is in a single move if the largest forces of those before and after are below this share of its own.
const ALONE: f64 = 0.5;

/// The move with the largest force.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Peak {
    /// The waypoint to which it goes.
    pub index: usize,
    /// Its largest force, N.
    pub force_n: f64,
    /// The largest forces of the moves before and after, N.
    pub beside_n: [f64; 2],
    /// Whether the burr comes from a move that removes nothing, and only this move has so large a force.
    pub single_entry: bool,
}

impl Peak {
    /// The largest force, the first of equals, among the moves for which `counts` is true; `None` without a force.
    fn among(waypoints: &[Waypoint], counts: impl Fn(&Peak) -> bool) -> Option<Self> {
        let force_n = |n: Option<usize>| n.and_then(|n| waypoints.get(n)).map_or(0.0, |w| w.peak_force_n);
        let peak = |index: usize| {
            let beside_n = [index.checked_sub(1), index.checked_add(1)].map(force_n);
            let own_n = force_n(Some(index));
            let from_air = index.checked_sub(1).is_none_or(|before| waypoints[before].mass_mg <= 0.0);
            let alone = beside_n.iter().all(|beside| *beside < ALONE * own_n);
            Self { index, force_n: own_n, beside_n, single_entry: from_air && alone }
        };
        let all = (0..waypoints.len()).map(peak).filter(|p| p.force_n > 0.0 && counts(p));
        all.fold(None, |most: Option<Self>, p| most.filter(|most| most.force_n >= p.force_n).or(Some(p)))
    }

    /// The largest force of a plan.
    pub fn of(waypoints: &[Waypoint]) -> Option<Self> {
        Self::among(waypoints, |_| true)
    }

    /// The report's sentences about it.
    pub fn sentence(&self, waypoints: &[Waypoint]) -> String {
        let mut text = format!(
            "The largest force, {:.2} N, is in the move to {}",
            self.force_n,
            place(waypoints, self.index)
        );
        let [before, after] = self.beside_n;
        if !self.single_entry {
            return text + &format!("; those before and after have up to {before:.2} and {after:.2} N.");
        }
        text += &format!(
            ": a single move with which the burr enters material again after one through air (those before and after \
             have up to {before:.2} and {after:.2} N)."
        );
        if let Some(other) = Self::among(waypoints, |p| !p.single_entry) {
            text += &format!(
                " Apart from single moves of re-entry the largest is {:.2} N in the move to {}.",
                other.force_n,
                place(waypoints, other.index)
            );
        }
        text
    }
}

/// A waypoint's number and time, for a narrow column.
pub fn short_place(waypoints: &[Waypoint], index: usize) -> String {
    waypoints.get(index).map_or(String::new(), |w| format!("{index} ({:.1}\u{a0}s)", w.time_s))
}

/// Place and time of a waypoint, in words.
pub fn place(waypoints: &[Waypoint], index: usize) -> String {
    match waypoints.get(index) {
        Some(w) => format!("waypoint {index} ({:.1} s, layer {}, {})", w.time_s, w.layer, w.kind.word()),
        None => format!("waypoint {index}"),
    }
}

#[cfg(test)]
mod tests {
    use bonemill_geometry::Point;
    use nalgebra::Vector3;

    use super::*;
    use bonemill_cutting::cutter::MoveKind;

    fn path(forces_n: &[f64]) -> Vec<Waypoint> {
        let waypoint = |(n, force_n): (usize, &f64)| Waypoint {
            layer: 2,
            kind: if *force_n > 0.0 { MoveKind::Cut } else { MoveKind::Link },
            time_s: n as f64,
            position: Point::new(0.0, 0.0, 0.0),
            axis: Vector3::z(),
            theta_rad: 0.0,
            phi_rad: 0.0,
            speed_mm_s: 1.0,
            driven_mm_s: 1.0,
            mass_mg: *force_n,
            inertia: None,
            force_n: Vector3::x() * 0.5 * *force_n,
            peak_force_n: *force_n,
            mean_force_n: *force_n,
            force_toward_n: None,
            structure: None,
            distance_mm: None,
            alpha1: None,
            cost: None,
            deflection_toward_um: None,
        };
        forces_n.iter().enumerate().map(waypoint).collect()
    }

    #[test]
    fn a_peak_within_a_cut_is_no_re_entry() {
        let path = path(&[0.0, 1.0, 1.5, 1.2, 0.0]);
        let peak = Peak::of(&path).unwrap();
        assert_eq!((peak.index, peak.single_entry), (2, false));
        let text = peak.sentence(&path);
        assert!(
            text.starts_with(
                "The largest force, 1.50 N, is in the move to waypoint 2 (2.0 s, layer 2, cut); "
            ),
            "{text}"
        );
        assert!(text.contains("1.00 and 1.20 N"), "{text}");
    }

    #[test]
    fn a_single_move_of_re_entry_is_said_to_be_one_and_the_next_largest_is_told() {
        let path = path(&[0.0, 1.0, 1.5, 1.2, 0.0, 4.0, 0.3, 0.0]);
        let peak = Peak::of(&path).unwrap();
        assert!(peak.index == 5 && peak.single_entry);
        let text = peak.sentence(&path);
        assert!(text.contains("a single move with which the burr enters material again"), "{text}");
        assert!(
            text.ends_with("the largest is 1.50 N in the move to waypoint 2 (2.0 s, layer 2, cut)."),
            "{text}"
        );
        assert_eq!(Peak::of(&path[..1]), None);
    }
}
