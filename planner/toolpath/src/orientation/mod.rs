//! Chooses the shaft's direction at every waypoint (D II-D, II-G).
//!
//! An arm with one tilt moves the axis in a plane ([`TiltFamily`], θ), an arm with two over a cap (θ, φ). [`Directions`] is
//! a finite set of either kind; [`FreeSets`] holds the directions that are free at each waypoint, and each has a cost.
//! [`greedy`] is the paper's method: each waypoint alone, then a low-pass. [`sequence`] chooses the whole sequence at once,
//! and [`refine`] smooths it between the directions of the set without leaving free axes.
//!
//! Invariants: every resulting axis was tested for access itself (free neighbours in the set are not enough); no cut is
//! tilted beyond the limit, which is tested on the axis without rounding.

pub mod corridor;
pub mod directions;
pub mod free;
pub mod greedy;
pub mod permissible;
pub mod refine;
pub mod sequence;

pub use directions::Directions;
pub use free::FreeSets;
pub use permissible::{OpenAround, Permissible};

use nalgebra::{Unit, UnitQuaternion, Vector3};

/// Axes that an arm with one tilt can reach: a(q) = Rot(hinge, q) zero, lower ≤ q ≤ upper; in work.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TiltFamily {
    /// The hinge.
    pub hinge: Unit<Vector3<f64>>,
    /// The axis at q = 0.
    pub zero: Unit<Vector3<f64>>,
    /// Lower limit of q, rad.
    pub lower_rad: f64,
    /// Upper limit of q, rad.
    pub upper_rad: f64,
}

impl TiltFamily {
    /// The axis at `q_rad`.
    pub fn axis(&self, q_rad: f64) -> Unit<Vector3<f64>> {
        UnitQuaternion::from_axis_angle(&self.hinge, q_rad) * self.zero
    }

    /// The angle whose axis is nearest to `axis`, rad, within the limits: the inverse of [`Self::axis`].
    pub fn angle(&self, axis: &Vector3<f64>) -> f64 {
        let across = |v: &Vector3<f64>| v - self.hinge.into_inner() * self.hinge.dot(v);
        let (from, to) = (across(&self.zero), across(axis));
        let q = self.hinge.dot(&from.cross(&to)).atan2(from.dot(&to));
        q.clamp(self.lower_rad, self.upper_rad)
    }
}

/// What turning costs in a sequence, and the largest rate of turning.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TurnLimits {
    /// What a turn costs.
    pub price: TurnPrice,
    /// Largest change of the axis per mm of path, rad/mm.
    pub most_rad_per_mm: f64,
}

/// What a turn costs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TurnPrice {
    /// λ angle²/Δs beside the cost of the waypoint: λ ∫ (da/ds)² ds, whatever the step. λ, mm/rad² per unit of cost.
    Smoothness(f64),
    /// The time that the arm needs for it, s; the waypoint's own cost is a time, and both pass together.
    Time(TurnTime),
}

/// How long an arm needs to turn the shaft about the burr during one move.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TurnTime {
    /// ω: the rate that a joint's velocity limit allows, rad/s.
    pub rate_rad_s: f64,
    /// α: the change of that rate that acceleration limits allow, rad/s².
    pub acceleration_rad_s2: f64,
    /// Driven over predicted time of turns, measured.
    pub factor: f64,
}

impl TurnTime {
    /// The least time of a turn by `angle_rad`: factor · max(angle/ω, √(angle/α)).
    ///
    /// The second term is that of a turn in one move between moves without any, in which the rate rises from 0 and falls to 0 within
    /// the acceleration limit, up to a constant that the factor holds. It never falls with the angle.
    pub fn seconds(&self, angle_rad: f64) -> f64 {
        let by_rate = angle_rad / self.rate_rad_s;
        self.factor * by_rate.max((angle_rad / self.acceleration_rad_s2).sqrt())
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
    fn angle_and_axis_are_inverse_also_in_a_leaning_family() {
        let mut leaning = family(Vector3::new(0.1, 0.9, 0.2));
        leaning.zero = Unit::new_normalize(Vector3::new(0.5, 0.1, 0.8));
        for n in -120..=120 {
            let q = f64::from(n) * 0.01;
            assert!((leaning.angle(&leaning.axis(q)) - q).abs() < 1e-12);
        }
    }

    #[test]
    fn the_average_keeps_a_constant() {
        assert!(moving_average(&[3.5; 9], 2).iter().all(|v| (v - 3.5).abs() < 1e-12));
        assert_eq!(moving_average(&[0.0, 3.0, 0.0], 1), vec![1.5, 1.0, 1.5]);
    }
}
