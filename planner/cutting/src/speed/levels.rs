//! Speeds with the least force in a given time: levels that cap the pushes, and how low they can be.
//!
//! The bone pushes the burr with F(v) = e + v c. Toward a structure with unit direction û, weighted with w for nearness and
//! priority, the push of cut i is w max(0, (e + v c)·û). Where the edge part pushes more than the whole does, a burr that speeds
//! up passes through the larger push, so a push counts as the largest over all speeds from rest to v:
//!
//! ```text
//! W_i(v) = max_s max(0, w_s e·û_s, w_s (e + v c)·û_s)        P_i(v) = max(|e|, |e + v c|)
//! ```
//!
//! Both never fall with v. Without edge forces they are the pushes at v. Levels (L_t, L_o, u) cap cut i at
//!
//! ```text
//! V_i = clamp(max { v ≤ u : W_i(v) ≤ L_t, P_i(v) ≤ L_o }, v_min, v_max)
//! ```
//!
//! so a cut that cannot keep a level goes at v_min. No V_i rises where a level falls, hence no speed of the greatest profile under these
//! caps does ([`super::fastest_profile`]), and a time that falls where speeds rise never falls where a level does. A profile whose
//! cuts faster than v_min keep the levels is one under these caps, and the greatest of them is the fastest. So on any way along which
//! no level rises, the last levels whose time is at most T0 are the least that can be kept in T0.
//!
//! **Two levels in one time** ([`least_levels`]). The least L_o with L_t free comes first; L_o may then exceed it by the share x, and the
//! least L_t under it follows; time that is left, since L_t cannot be less than 0, goes to L_o, then to u.
//!
//! **Beside a reference** ([`least_along`]). The levels of another plan, both times one factor: the least factor that fits T0. If it is at most 1,
//! neither level is above the reference's.
//!
//! Where a push falls with the speed, V_i may jump: T0 is then met from below. The levels have the
//! unit of the pushes: N, or mm where a compliance C makes them deflections, with C e and C c for e and c.

use nalgebra::{Matrix3, Unit, Vector3};

use super::caps::{linear, within_ball};
use super::last_within;
use crate::burr::EngagedForce;

/// Less per mm/s than this is rounding: N or mm.
const NOTHING: f64 = 1e-12;

/// What pushes the burr during one cut, as affine functions of the speed: N, or mm of deflection.
#[derive(Debug, Clone, PartialEq)]
pub struct CutPushes {
    /// Per structure the weighted part toward it at rest, and what a mm/s adds, for every place within the cut.
    toward: Vec<[f64; 2]>,
    structures: usize,
    /// At rest, and what a mm/s adds, for every place within the cut.
    whole: Vec<[Vector3<f64>; 2]>,
}

impl CutPushes {
    /// Of the forces at places within the cut, each with the weight and the direction of the same structures there, and of a compliance, mm/N,
    /// where deflections count.
    pub fn new<'a>(
        places: impl Iterator<Item = (&'a EngagedForce, Vec<(f64, Unit<Vector3<f64>>)>)>,
        compliance: Option<&Matrix3<f64>>,
    ) -> Self {
        let pushed = |force: Vector3<f64>| compliance.map_or(force, |c| c * force);
        let or_none = |per_mm_s: f64| if per_mm_s.abs() < NOTHING { 0.0 } else { per_mm_s };
        let whole = |force: &EngagedForce| {
            let cut = pushed(force.cut_n_per_mm_s);
            [pushed(force.edge_n), if cut.norm() < NOTHING { Vector3::zeros() } else { cut }]
        };
        let mut found = Self { toward: Vec::new(), structures: 0, whole: Vec::new() };
        for (force, near) in places {
            let [edge, cut] = whole(force);
            let part = |(weight, direction): &(f64, Unit<Vector3<f64>>)| {
                [weight * edge.dot(direction), or_none(weight * cut.dot(direction))]
            };
            found.toward.extend(near.iter().map(part));
            found.structures = near.len();
            found.whole.push([edge, cut]);
        }
        found
    }

    /// W(v): the largest weighted push toward a structure up to the speed, and which of the structures it is; none where
    /// nothing pushes toward any.
    pub fn toward(&self, speed_mm_s: f64) -> Option<(f64, usize)> {
        let pushes = self.toward.iter().map(|[rest, per_mm_s]| rest.max(rest + per_mm_s * speed_mm_s));
        let most = pushes.zip(0..).filter(|(push, _)| *push > 0.0).max_by(|a, b| a.0.total_cmp(&b.0));
        most.map(|(push, n)| (push, n % self.structures))
    }

    /// P(v): the largest whole push up to the speed.
    pub fn overall(&self, speed_mm_s: f64) -> f64 {
        let of = |[edge, cut]: &[Vector3<f64>; 2]| edge.norm().max((edge + speed_mm_s * cut).norm());
        self.whole.iter().map(of).fold(0.0, f64::max)
    }

    /// The largest speed that keeps the levels, mm/s; 0 where no speed does.
    pub fn fastest_mm_s(&self, levels: &Levels) -> f64 {
        let toward = self.toward.iter().map(|[rest, per_mm_s]| linear(*rest, *per_mm_s, levels.toward));
        let whole = self.whole.iter().map(|[edge, cut]| within_ball(edge, cut, levels.overall));
        toward.chain(whole).fold(levels.speed_mm_s, f64::min)
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

    /// Levels that bind no cut within the range of speed, mm/s.
    pub fn above_all<'a>(pushes: impl Iterator<Item = &'a CutPushes>, [_, max_mm_s]: [f64; 2]) -> Self {
        pushes.fold(Self { toward: 0.0, overall: 0.0, speed_mm_s: max_mm_s }, |most, p| Self {
            toward: most.toward.max(p.toward(max_mm_s).map_or(0.0, |(push, _)| push)),
            overall: most.overall.max(p.overall(max_mm_s)),
            ..most
        })
    }

    /// From these levels to lower ones; `parameter` 0 to 1. The time of a cut is inverse to its level, so equal steps of the parameter
    /// are nearly equal steps of time.
    fn lowered(&self, to: &Self, parameter: f64) -> Self {
        let share = 1.0 - (1.0 - parameter) / (1.0 + STEEPNESS * parameter);
        let between = |from: f64, to: f64| from + (to - from) * share;
        Self {
            toward: between(self.toward, to.toward),
            overall: between(self.overall, to.overall),
            speed_mm_s: between(self.speed_mm_s, to.speed_mm_s),
        }
    }
}

/// How much of a way to a level of 0 lies in the first steps of its parameter.
const STEEPNESS: f64 = 9.0;

/// Factors of a reference's levels at which the time is looked at first; then those this much larger or smaller, as long as they lie between two,
/// and the ends of the way.
const NEAR_ONE: [f64; 2] = [1.1, 0.9];
const WIDER: f64 = 1.5;
const SMALLEST: f64 = 0.05;
const LARGEST: f64 = 20.0;

/// The time that levels may take.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimeLimit {
    /// T0, s.
    pub total_s: f64,
    /// How far below it a time may stay, s.
    pub tolerance_s: f64,
    /// Largest number of evaluations of the time on each way between levels, besides those that look for a bracket.
    pub evaluations: u32,
}

/// The least levels on the way from `from` to lower levels that keep the time, or `from` where even those take longer.
fn least_on_way<E: Send>(
    [from, to]: [Levels; 2],
    limit: TimeLimit,
    time_s: &(impl Fn(&Levels) -> Result<f64, E> + Sync),
) -> Result<Levels, E> {
    if from == to {
        return Ok(from);
    }
    let (shortest_s, longest_s) = rayon::join(|| time_s(&from), || time_s(&to));
    last_between([from, to], [(0.0, shortest_s?), (1.0, longest_s?)], limit, time_s)
}

/// The least levels on a way that keep the time, between two of its places, each with its time, s; where it is met nowhere between them,
/// an end of the way.
fn last_between<E: Send>(
    [from, to]: [Levels; 2],
    [higher, lower]: [(f64, f64); 2],
    limit: TimeLimit,
    time_s: &(impl Fn(&Levels) -> Result<f64, E> + Sync),
) -> Result<Levels, E> {
    let TimeLimit { total_s, tolerance_s, evaluations } = limit;
    if lower.1 <= total_s {
        return Ok(to);
    }
    if higher.1 > total_s {
        return Ok(from);
    }
    let at = |parameter: f64| from.lowered(&to, parameter);
    Ok(at(last_within([higher, lower], total_s, tolerance_s, evaluations, |parameter| {
        time_s(&at(parameter))
    })?))
}

/// The least levels in a time, from `top` down to the least speed, mm/s: first L_o, which may then rise by the share `room`, then L_t.
///
/// # Errors
/// Those of `time_s`.
pub fn least_levels<E: Send>(
    top: Levels,
    min_mm_s: f64,
    room: f64,
    limit: TimeLimit,
    time_s: impl Fn(&Levels) -> Result<f64, E> + Sync,
) -> Result<Levels, E> {
    let least = least_on_way([top, Levels { overall: 0.0, ..top }], limit, &time_s)?;
    let with_room = Levels { overall: top.overall.min((1.0 + room) * least.overall), ..top };
    let spared = Levels { toward: 0.0, ..with_room };
    let mut found = least_on_way([with_room, spared], limit, &time_s)?;
    for slower in [Levels { overall: 0.0, ..spared }, Levels { overall: 0.0, speed_mm_s: min_mm_s, ..spared }]
    {
        if found.toward == 0.0 {
            found = least_on_way([found, slower], limit, &time_s)?;
        }
    }
    Ok(found)
}

/// Levels in the ratio of `reference`, below `top`: the least that keep the time. A push toward structures that the reference does not
/// have at all counts from `nothing` on.
///
/// # Errors
/// Those of `time_s`.
pub fn least_along<E: Send>(
    reference: Levels,
    top: Levels,
    nothing: f64,
    limit: TimeLimit,
    time_s: impl Fn(&Levels) -> Result<f64, E> + Sync,
) -> Result<Levels, E> {
    let total_s = limit.total_s;
    let (toward, overall) = (reference.toward.max(nothing), reference.overall.max(nothing));
    let times = (top.toward / toward).max(top.overall / overall).max(1.0);
    let from = Levels { toward: times * toward, overall: times * overall, ..top };
    let to = Levels { toward: 0.0, overall: 0.0, ..top };
    let at = |parameter: f64| from.lowered(&to, parameter);
    let at_factor = |factor: f64| {
        if factor > LARGEST {
            0.0
        } else if factor < SMALLEST {
            1.0
        } else {
            ((times - factor) / (times + STEEPNESS * factor)).clamp(0.0, 1.0)
        }
    };
    let timed = |parameter: f64| Ok((parameter, time_s(&at(parameter))?));
    // a plan that is like the reference has a factor near 1
    let (higher, lower) = rayon::join(|| timed(at_factor(NEAR_ONE[0])), || timed(at_factor(NEAR_ONE[1])));
    let (mut higher, mut lower) = (higher?, lower?);
    let [mut most, mut least] = NEAR_ONE;
    while higher.1 > total_s && higher.0 > 0.0 {
        most *= WIDER;
        (lower, higher) = (higher, timed(at_factor(most))?);
    }
    while lower.1 <= total_s && lower.0 < 1.0 {
        least /= WIDER;
        (higher, lower) = (lower, timed(at_factor(least))?);
    }
    last_between([from, to], [higher, lower], limit, &time_s)
}

#[cfg(test)]
mod tests;
