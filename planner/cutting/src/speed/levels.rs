//! Speeds with the least force in a given time: levels that cap the pushes, and the one family of levels that holds every optimum.
//!
//! The bone pushes the burr with F(v) = e + v c. Toward a structure with unit direction û, weighted with w for nearness and
//! priority, the push of cut i is w max(0, (e + v c)·û). Where the edge part pushes more than the whole does, a burr that speeds
//! up passes through the larger push, so a push counts as the largest over all speeds from rest to v:
//!
//! ```text
//! W_i(v) = max_s max(0, w_s e·û_s, w_s (e + v c)·û_s)        P_i(v) = max(|e|, |e + v c|)
//! ```
//!
//! Both never fall with v. Without edge forces they are the pushes at v. Among all profiles within the range of speed, the
//! acceleration limit and a time T0, wanted is the one that makes least, in this order:
//!
//! 1. the largest W_i of all cuts; 2. the largest P_i of all cuts; 3. the largest W_i of the cuts faster than v_min; 4. the
//!    largest P_i of those; 5. the largest speed.
//!
//! **One family.** Levels (λ, P, u) cap cut i at V_i = clamp(max { v ≤ u : W_i(v) ≤ λ, P_i(v) ≤ P }, v_min, v_max). With
//! λ(v) = max_i W_i(v) and P(v) = max_i P_i(v), the levels go from corner to corner, one of them at a time:
//!
//! ```text
//! (λ(v_max), P(v_max), v_max) → (λ(v_min), ·, ·) → (·, P(v_min), ·) → (0, ·, ·) → (·, 0, ·) → (·, ·, v_min)
//! ```
//!
//! No V_i rises along the way, so no speed of the greatest profile under these caps does ([`super::fastest_profile`]), and a time
//! that falls where speeds rise never falls along it. The wanted profile is the greatest profile at the last parameter whose time is at
//! most T0. Proof, leg by leg, for a profile with time at most T0:
//!
//! - Leg 1 caps with λ ≥ λ(v_min): every cut can keep it. The profiles that keep λ are those under the caps, and the greatest of them is
//!   the fastest; so some profile keeps λ within T0 exactly if the greatest does. The least λ is the last one whose time is at most
//!   T0. If it is above λ(v_min), T0 is used up, and since a slower speed anywhere takes longer, no other profile keeps it.
//! - At λ(v_min) goal 1 is at its least, since no cut is slower than v_min. The same argument under these caps gives the least P ≥ P(v_min).
//! - Below, a cut that cannot keep a level goes at v_min and drops out of goals 3 and 4: a profile keeps the level in the cuts faster
//!   than v_min exactly if it is under the clamped caps. The argument holds again, for λ down to 0, then for P, then for u.
//!
//! Where a push falls with the speed, and where two corners agree, V_i jumps or stays: T0 is then met from below. The levels have the
//! unit of the pushes: N, or mm where a compliance C makes them deflections, with C e and C c for e and c.

use nalgebra::{Matrix3, Unit, Vector3};

use super::caps::{linear, within_ball};
use crate::burr::EngagedForce;

/// Less per mm/s than this is rounding: N or mm.
const NOTHING: f64 = 1e-12;

/// What pushes the burr during one cut, as affine functions of the speed: N, or mm of deflection.
#[derive(Debug, Clone, PartialEq)]
pub struct CutPushes {
    /// Per structure the weighted part toward it at rest, and what a mm/s adds.
    toward: Vec<[f64; 2]>,
    edge: Vector3<f64>,
    cut: Vector3<f64>,
}

impl CutPushes {
    /// Of a force, and of a compliance, mm/N, where deflections count. `toward`: the weight and the direction of each structure.
    pub fn new(
        force: &EngagedForce,
        compliance: Option<&Matrix3<f64>>,
        toward: impl Iterator<Item = (f64, Unit<Vector3<f64>>)>,
    ) -> Self {
        let pushed = |force: Vector3<f64>| compliance.map_or(force, |c| c * force);
        let or_none = |per_mm_s: f64| if per_mm_s.abs() < NOTHING { 0.0 } else { per_mm_s };
        let (edge, cut) = (pushed(force.edge_n), pushed(force.cut_n_per_mm_s));
        let cut = if cut.norm() < NOTHING { Vector3::zeros() } else { cut };
        let toward = toward.map(|(weight, direction)| {
            [weight * edge.dot(&direction), or_none(weight * cut.dot(&direction))]
        });
        Self { toward: toward.collect(), edge, cut }
    }

    /// W(v): the largest weighted push toward a structure up to the speed, and which of the structures it is; none where
    /// nothing pushes toward any.
    pub fn toward(&self, speed_mm_s: f64) -> Option<(f64, usize)> {
        let pushes = self.toward.iter().map(|[rest, per_mm_s]| rest.max(rest + per_mm_s * speed_mm_s));
        pushes.zip(0..).filter(|(push, _)| *push > 0.0).max_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// P(v): the largest whole push up to the speed.
    pub fn overall(&self, speed_mm_s: f64) -> f64 {
        self.edge.norm().max((self.edge + speed_mm_s * self.cut).norm())
    }

    /// The largest speed that keeps the levels, mm/s; 0 where no speed does.
    pub fn fastest_mm_s(&self, levels: &Levels) -> f64 {
        let toward = self.toward.iter().map(|[rest, per_mm_s]| linear(*rest, *per_mm_s, levels.toward));
        toward.fold(levels.speed_mm_s, f64::min).min(within_ball(&self.edge, &self.cut, levels.overall))
    }
}

/// What no cut may exceed, unless it is at the least speed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Levels {
    /// λ: weighted push toward any structure, N or mm.
    pub toward: f64,
    /// P: whole push, N or mm.
    pub overall: f64,
    /// u: speed, mm/s.
    pub speed_mm_s: f64,
}

impl Levels {
    /// The largest speed of a cut, mm/s; of one on which nothing pushes, if it has no pushes.
    pub fn fastest_mm_s(&self, pushes: Option<&CutPushes>) -> f64 {
        pushes.map_or(self.speed_mm_s, |pushes| pushes.fastest_mm_s(self))
    }

    /// From these levels to others, at a share of 0 to 1 of the way.
    fn toward_others(&self, others: &Self, share: f64) -> Self {
        let between = |from: f64, to: f64| from + (to - from) * share;
        Self {
            toward: between(self.toward, others.toward),
            overall: between(self.overall, others.overall),
            speed_mm_s: between(self.speed_mm_s, others.speed_mm_s),
        }
    }
}

/// The family of levels: parameter 0 is the fastest, [`Self::slowest`] the slowest, whole numbers are corners.
#[derive(Debug, Clone, PartialEq)]
pub struct LevelFamily(Vec<Levels>);

impl LevelFamily {
    /// Of the pushes of all cuts, within a range of speed, mm/s.
    pub fn new<'a>(
        pushes: impl Iterator<Item = &'a CutPushes> + Clone,
        [min_mm_s, max_mm_s]: [f64; 2],
    ) -> Self {
        let toward = |v: f64| pushes.clone().filter_map(|p| p.toward(v)).map(|(w, _)| w).fold(0.0, f64::max);
        let overall = |v: f64| pushes.clone().map(|p| p.overall(v)).fold(0.0, f64::max);
        let fastest = Levels { toward: toward(max_mm_s), overall: overall(max_mm_s), speed_mm_s: max_mm_s };
        let least_toward = Levels { toward: toward(min_mm_s), ..fastest };
        let least = Levels { overall: overall(min_mm_s), ..least_toward };
        let none_toward = Levels { toward: 0.0, ..least };
        let none = Levels { overall: 0.0, ..none_toward };
        let slowest = Levels { speed_mm_s: min_mm_s, ..none };
        let mut corners = vec![fastest, least_toward, least, none_toward, none, slowest];
        corners.dedup();
        Self(corners)
    }

    /// The largest parameter.
    pub fn slowest(&self) -> f64 {
        (self.0.len() - 1) as f64
    }

    /// The levels at a parameter.
    pub fn at(&self, parameter: f64) -> Levels {
        let from = parameter.clamp(0.0, self.slowest()).floor();
        let (corner, next) = (from as usize, self.0.len().min(from as usize + 2) - 1);
        self.0[corner].toward_others(&self.0[next], (parameter - from).clamp(0.0, 1.0))
    }
}

#[cfg(test)]
mod tests;
