//! Which way the shaft points at every waypoint (D II-D, II-G).
//!
//! The shaft's axis moves in a plane: a [`TiltFamily`], one angle. Angles are scanned on a grid; [`FreeAngles`] says
//! which of them the shank allows at each waypoint, and a cost says how good they are. [`greedy`] is the paper's way:
//! each waypoint alone, then a low-pass. [`optimal`] chooses the whole sequence at once.
//!
//! Invariant: every angle handed out was found free by the access test itself, not only by its neighbours on the grid.

pub mod directions;
pub mod free;
pub mod greedy;
pub mod optimal;
pub mod refine;
pub mod sequence;

pub use directions::Directions;
pub use free::FreeSets;
pub use optimal::RateLimit;

use nalgebra::{Unit, UnitQuaternion, Vector3};

/// Axes that an arm with one tilt can reach: a(q) = Rot(hinge, q) zero, lower ≤ q ≤ upper; in work.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TiltFamily {
    /// The hinge.
    pub hinge: Unit<Vector3<f64>>,
    /// The axis at q = 0.
    pub zero: Unit<Vector3<f64>>,
    /// Lower limit, rad.
    pub lower_rad: f64,
    /// Upper limit, rad.
    pub upper_rad: f64,
}

impl TiltFamily {
    /// The axis at `q_rad`.
    pub fn axis(&self, q_rad: f64) -> Unit<Vector3<f64>> {
        UnitQuaternion::from_axis_angle(&self.hinge, q_rad) * self.zero
    }
}

/// Most angles of a scan: one bit each.
pub const MOST_ANGLES: usize = 128;

/// The angles of a scan.
#[derive(Debug, Clone, PartialEq)]
pub struct Scan {
    /// Angles, rad, equally spaced, ascending.
    pub angles_rad: Vec<f64>,
    /// Their axes in work.
    pub axes: Vec<Unit<Vector3<f64>>>,
    /// Bit n: angle n is within the tilt limit.
    pub within_limit: u128,
    /// Distance of neighbouring angles, rad.
    pub step_rad: f64,
}

impl Scan {
    /// About `step_rad` apart over the whole family, its ends included; `limit_rad` is the largest angle from +z (the
    /// approach) that a cut may have. The grid holds the angle nearest to the approach.
    pub fn new(family: &TiltFamily, step_rad: f64, limit_rad: f64) -> Self {
        let directions = Directions::in_plane(family, step_rad, limit_rad);
        let axes = directions.axes().to_vec();
        let within = axes.iter().enumerate().filter(|(_, a)| directions.is_within_limit(a));
        Self {
            angles_rad: directions.angles_rad().unwrap_or_default().to_vec(),
            within_limit: within.fold(0, |mask, (n, _)| mask | 1 << n),
            step_rad: directions.spacing_rad(),
            axes,
        }
    }

    /// Number of angles.
    pub fn len(&self) -> usize {
        self.angles_rad.len()
    }

    /// Never: there is at least the angle nearest to the approach.
    pub fn is_empty(&self) -> bool {
        self.angles_rad.is_empty()
    }

    /// The scanned angle nearest to `q_rad`.
    pub fn nearest(&self, q_rad: f64) -> usize {
        let n = ((q_rad - self.angles_rad[0]) / self.step_rad).round().max(0.0) as usize;
        n.min(self.len() - 1)
    }

    /// The free angle nearest to `q_rad`, if any is free; the smaller one of two equally near.
    pub fn nearest_free(&self, free: u128, q_rad: f64) -> Option<usize> {
        (0..self.len()).filter(|n| free >> n & 1 == 1).min_by(|a, b| {
            (self.angles_rad[*a] - q_rad).abs().total_cmp(&(self.angles_rad[*b] - q_rad).abs())
        })
    }
}

/// The angle at which the axis is nearest to +z.
fn nearest_to_z(family: &TiltFamily) -> f64 {
    // a(q)·z = A + B cos q + C sin q has its maximum at atan2(C, B)
    let along = family.hinge.into_inner() * family.hinge.dot(&family.zero);
    let across = family.zero.into_inner() - along;
    let cosine = across.z;
    let sine = family.hinge.cross(&across).z;
    sine.atan2(cosine).clamp(family.lower_rad, family.upper_rad)
}

/// What an orientation is chosen from: per waypoint, bit n says that angle n is free.
pub type FreeAngles = Vec<u128>;

/// Moving average over 2·`half` + 1 waypoints, truncated and renormalised at the ends.
pub(crate) fn moving_average(values: &[f64], half: usize) -> Vec<f64> {
    let mut sums = Vec::with_capacity(values.len() + 1);
    sums.push(0.0);
    for v in values {
        sums.push(sums[sums.len() - 1] + v);
    }
    (0..values.len())
        .map(|n| {
            let (lo, hi) = (n.saturating_sub(half), (n + half + 1).min(values.len()));
            (sums[hi] - sums[lo]) / (hi - lo) as f64
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn family(hinge: Vector3<f64>) -> TiltFamily {
        TiltFamily {
            hinge: Unit::new_normalize(hinge),
            zero: Vector3::z_axis(),
            lower_rad: -1.2,
            upper_rad: 1.2,
        }
    }

    #[test]
    fn a_scan_holds_the_approach_and_knows_the_tilt_limit() {
        let scan = Scan::new(&family(Vector3::x()), 2f64.to_radians(), 60f64.to_radians());
        let middle = scan.nearest(0.0);
        assert_eq!(scan.angles_rad[middle], 0.0);
        for n in 0..scan.len() {
            let within = scan.angles_rad[n].abs() <= 60f64.to_radians() + 1e-9;
            assert_eq!(scan.within_limit >> n & 1 == 1, within);
        }
        assert!(scan.angles_rad[0] >= -1.2 && scan.angles_rad[scan.len() - 1] <= 1.2);
    }

    #[test]
    fn the_nearest_angle_to_the_approach_is_found_in_a_leaning_family() {
        let mut leaning = family(Vector3::new(0.1, 0.9, 0.2));
        leaning.zero = Unit::new_normalize(Vector3::new(0.5, 0.1, 0.8));
        let best = nearest_to_z(&leaning);
        let brute = (-1200..=1200)
            .map(|n| f64::from(n) * 1e-3)
            .max_by(|a, b| leaning.axis(*a).z.total_cmp(&leaning.axis(*b).z));
        assert!((best - brute.unwrap()).abs() < 1e-3);
    }

    #[test]
    fn fine_scans_are_capped_and_the_average_keeps_a_constant() {
        assert!(Scan::new(&family(Vector3::x()), 1e-4, 1.0).len() <= MOST_ANGLES);
        assert!(moving_average(&[3.5; 9], 2).iter().all(|v| (v - 3.5).abs() < 1e-12));
        assert_eq!(moving_average(&[0.0, 3.0, 0.0], 1), vec![1.5, 1.0, 1.5]);
    }

    #[test]
    fn the_nearest_free_angle() {
        let scan = Scan::new(&family(Vector3::x()), 0.1, 1.0);
        let middle = scan.nearest(0.0);
        assert_eq!(scan.nearest_free(1 << (middle + 3) | 1 << (middle - 2), 0.0), Some(middle - 2));
        assert_eq!(scan.nearest_free(0, 0.0), None);
    }
}
