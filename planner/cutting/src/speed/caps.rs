//! How fast a move may be under caps on force, deflection and power.
//!
//! At a given engagement the force is F(v) = e + v c: an edge part and a cutting part that is proportional to the speed.
//! So every cap is a bound on v in closed form:
//!
//! ```text
//! toward a structure   max(0, (e + v c)·û) ≤ limit(distance)       linear
//! total                |e + v c| ≤ limit                           the larger root of a quadratic
//! deflection           |C (e + v c)| ≤ limit                       the same with C e, C c
//! spindle power        ω (Q_e + v Q_c) ≤ limit                     linear
//! ```
//!
//! A cap that the edge part alone breaks gives 0: no speed keeps it, and the caller says so. With t0 > 0 the edge part is
//! that of the speed at which the force was evaluated.

use std::f64::consts::PI;

use nalgebra::{Matrix3, Vector3};

use super::DistanceCurve;

use crate::burr::EngagedForce;
use crate::cost::Proximity;

/// Caps on what the bone does to the burr; `None` caps nothing.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ForceCaps {
    /// Force toward a structure, N, by the distance from the burr's surface to it, mm.
    pub toward_n: Option<DistanceCurve>,
    /// Whole force, N.
    pub total_n: Option<f64>,
    /// Deflection of the burr, mm; needs a compliance.
    pub deflection_mm: Option<f64>,
    /// Spindle power, mW (N mm/s).
    pub power_mw: Option<f64>,
}

/// What of a burr the caps depend on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CappedBurr {
    /// Radius, mm.
    pub radius_mm: f64,
    /// Spindle speed, rpm.
    pub spindle_rpm: f64,
}

/// One of the caps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cap {
    /// On the force toward the n-th of the structures nearby.
    Toward(usize),
    /// On the whole force.
    Total,
    /// On the deflection.
    Deflection,
    /// On the spindle's power.
    Power,
}

impl ForceCaps {
    /// The largest speed that keeps every cap, mm/s; infinite where none binds, 0 where no speed does.
    ///
    /// `near`: every structure to be spared; `compliance`: mm/N; both in the frame of the force.
    pub fn fastest_mm_s(
        &self,
        burr: CappedBurr,
        force: &EngagedForce,
        near: &[Proximity],
        compliance: Option<&Matrix3<f64>>,
    ) -> f64 {
        let mut fastest = f64::INFINITY;
        self.for_each(burr, force, (near, compliance), |_, mm_s| fastest = fastest.min(mm_s));
        fastest
    }

    /// Calls `take` with every cap and the largest speed that keeps it, mm/s.
    pub fn for_each(
        &self,
        burr: CappedBurr,
        force: &EngagedForce,
        (near, compliance): (&[Proximity], Option<&Matrix3<f64>>),
        mut take: impl FnMut(Cap, f64),
    ) {
        let (cut, edge) = (force.cut_n_per_mm_s, force.edge_n);
        if let Some(limit) = &self.toward_n {
            for (n, p) in near.iter().enumerate() {
                let most = limit.at(p.distance_mm - burr.radius_mm);
                take(Cap::Toward(n), linear(edge.dot(&p.toward), cut.dot(&p.toward), most));
            }
        }
        if let Some(most) = self.total_n {
            take(Cap::Total, within_ball(&edge, &cut, most));
        }
        if let (Some(most), Some(c)) = (self.deflection_mm, compliance) {
            take(Cap::Deflection, within_ball(&(c * edge), &(c * cut), most));
        }
        if let Some(most) = self.power_mw {
            let omega = 2.0 * PI * burr.spindle_rpm / 60.0;
            let (q_edge, q_cut) = (force.edge_torque_nmm, force.cut_torque_nmm_per_mm_s);
            take(Cap::Power, linear(omega * q_edge, omega * q_cut, most));
        }
    }

    /// What a cap bounds, at a speed in mm/s, and the most that it allows: N, for the deflection mm, for the power mW.
    pub fn taken(
        &self,
        (cap, speed_mm_s): (Cap, f64),
        burr: CappedBurr,
        force: &EngagedForce,
        (near, compliance): (&[Proximity], Option<&Matrix3<f64>>),
    ) -> Option<[f64; 2]> {
        let force_n = force.force_n(speed_mm_s);
        Some(match cap {
            Cap::Toward(n) => {
                let p = near.get(n)?;
                [force_n.dot(&p.toward).max(0.0), self.toward_n.as_ref()?.at(p.distance_mm - burr.radius_mm)]
            }
            Cap::Total => [force_n.norm(), self.total_n?],
            Cap::Deflection => [(compliance? * force_n).norm(), self.deflection_mm?],
            Cap::Power => {
                let torque_nmm = force.edge_torque_nmm + speed_mm_s * force.cut_torque_nmm_per_mm_s;
                [2.0 * PI * burr.spindle_rpm / 60.0 * torque_nmm, self.power_mw?]
            }
        })
    }
}

/// The largest v ≥ 0 with a + b v ≤ most, for a limit that 0 keeps too.
pub(super) fn linear(a: f64, b: f64, most: f64) -> f64 {
    let room = most - a;
    if b > 0.0 {
        (room / b).max(0.0)
    } else if room >= 0.0 {
        f64::INFINITY
    } else {
        // too much at rest, and less the faster: no speed up to here is safe
        0.0
    }
}

/// The largest v ≥ 0 with |a + b v| ≤ most, from 0 on.
pub(super) fn within_ball(a: &Vector3<f64>, b: &Vector3<f64>, most: f64) -> f64 {
    let room = most * most - a.norm_squared();
    if room < 0.0 {
        return 0.0;
    }
    let (half, square) = (a.dot(b), b.norm_squared());
    if square <= 0.0 {
        return f64::INFINITY;
    }
    // b² v² + 2 (a·b) v − room = 0
    (-half + (half * half + square * room).sqrt()) / square
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const BURR: CappedBurr = CappedBurr { radius_mm: 2.5, spindle_rpm: 6e4 };

    fn vector(size: f64) -> impl Strategy<Value = Vector3<f64>> {
        prop::array::uniform3(-size..size).prop_map(Vector3::from)
    }

    proptest! {
        #![proptest_config(bonemill_geometry::fixed!(256))]

        /// At the speed found every cap holds, and a little faster one does not.
        #[test]
        fn the_bound_is_tight(
            cut in vector(0.6), edge in vector(0.2), torque in 0.0f64..1.0, to in prop::collection::vec(vector(6.0), 1..4),
            toward in 0.0f64..1.0, total in 0.1f64..1.5, um in 1.0f64..50.0, watts in 0.05f64..3.0,
        ) {
            let force = EngagedForce {
                cut_n_per_mm_s: cut, edge_n: edge, cut_torque_nmm_per_mm_s: torque, edge_torque_nmm: 0.1 * torque,
                ..EngagedForce::ZERO
            };
            let near: Vec<_> = to.iter().filter_map(|p| Proximity::new(*p, 3.5).ok()).collect();
            let caps = ForceCaps {
                toward_n: Some(DistanceCurve::new(&[[0.5, toward], [4.0, 2.0 + toward]]).unwrap()),
                total_n: Some(total), deflection_mm: Some(um * 1e-3), power_mw: Some(watts * 1e3),
            };
            let c = Matrix3::new(0.02, 0.001, 0.0, 0.001, 0.05, 0.002, 0.0, 0.002, 0.01);
            let v = caps.fastest_mm_s(BURR, &force, &near, Some(&c));
            let worst = |v: f64| {
                let f = edge + cut * v;
                let power = 2.0 * PI * 1e3 * (0.1 * torque + v * torque) - watts * 1e3;
                let mut over = (f.norm() - total).max((c * f).norm() - um * 1e-3).max(power);
                for p in &near {
                    over = over.max(f.dot(&p.toward).max(0.0) - caps.toward_n.as_ref().unwrap().at(p.distance_mm - 2.5));
                }
                over
            };
            prop_assert!(v.is_finite());
            if v > 0.0 {
                prop_assert!(worst(v) < 1e-9 && worst(0.5 * v) < 1e-9);
            }
            prop_assert!(worst(v * (1.0 + 1e-6) + 1e-9) > -1e-9);
            // each cap is used up at its own speed, and kept at the least of them
            caps.for_each(BURR, &force, (&near, Some(&c)), |cap, own| {
                let used = |v: f64| {
                    let [taken, most] = caps.taken((cap, v), BURR, &force, (&near, Some(&c))).unwrap();
                    (taken - most) / most.max(1e-6)
                };
                assert!(own >= v && (v == 0.0 || used(v) < 1e-6), "{cap:?}: {}", used(v));
                assert!(own == 0.0 || own.is_infinite() || used(own).abs() < 1e-6, "{cap:?}: {}", used(own));
            });
        }
    }

    #[test]
    fn without_caps_or_force_nothing_binds() {
        let near = [Proximity::new(Vector3::x() * 4.0, 3.5).unwrap()];
        let caps =
            ForceCaps { toward_n: Some(DistanceCurve::new(&[[1.0, 0.3]]).unwrap()), ..ForceCaps::default() };
        assert_eq!(caps.fastest_mm_s(BURR, &EngagedForce::ZERO, &near, None), f64::INFINITY);
        let pushes = EngagedForce { cut_n_per_mm_s: Vector3::new(0.6, 0.0, 0.0), ..EngagedForce::ZERO };
        assert_eq!(ForceCaps::default().fastest_mm_s(BURR, &pushes, &near, None), f64::INFINITY);
        assert!((caps.fastest_mm_s(BURR, &pushes, &near, None) - 0.5).abs() < 1e-12);
        // away from it nothing binds; between two, the nearer limit does
        let away = EngagedForce { cut_n_per_mm_s: -Vector3::x(), ..EngagedForce::ZERO };
        assert_eq!(caps.fastest_mm_s(BURR, &away, &near, None), f64::INFINITY);
        let both = [near[0], Proximity::new(-Vector3::x() * 4.0, 3.5).unwrap()];
        assert!((caps.fastest_mm_s(BURR, &away, &both, None) - 0.3).abs() < 1e-12);
    }
}
