//! Chooses the whole sequence of directions at once, by dynamic programming over a layered graph whose edges are not stored.
//!
//! There is one layer per waypoint and one state per free direction. With d_i = ∠(a_{i−1}, a_i), the sequence a_0, a_1, …
//! minimises, by the price of turns ([`TurnPrice`]),
//!
//! ```text
//! smoothness    J = Σ C_i(a_i) Δs_i + λ Σ d_i²/Δs_i
//! time          J = Σ max(C_i(a_i) Δs_i, t(d_i)) + ε d_i²/Δs_i
//! ```
//!
//! subject to: a_i is free at i; d_i is at most the angle that the arm can turn during the move; every direction
//! passed on the way from a_{i−1} to a_i is free before or after the move; and the turn is not in a list of forbidden ones.
//! In the first, λ ∫ (da/ds)² ds does not depend on the step. In the second, C_i is the time of the cut per mm, so that J is the time
//! of the path: a turn costs nothing as long as the cut takes longer, but for ε, which spreads it. Bellman's recursion goes over the
//! layers once and finds the optimum over all sequences; the tests compare it with an enumeration of every sequence. It looks at most
//! at Σ_i |free_i| · |fan| edges.
//!
//! An edge is a slot in a direction's fan ([`Directions`]): its angle and the slot passed before are looked up, not stored
//! per waypoint. One byte per state stores from which slot its best sequence came. Of equal sequences the one with the least
//! motion is taken, so λ is never quite 0; at the first waypoint, the direction nearer to the approach.

use bonemill_geometry::cancel;
use std::collections::HashMap;

use super::directions::{Directions, Fan, tilt_rad};
use super::{FreeSets, TurnLimits, TurnPrice};

/// Shorter moves count as this long, mm, so that the cost of a turn on the spot is high but finite.
const SHORTEST_MM: f64 = 1e-3;
/// λ is at least this, mm/rad² per unit of cost; with λ = 0 the axis would move arbitrarily among directions of equal cost.
const LEAST_WEIGHT_MM: f64 = 1e-6;
/// ε, s mm/rad²: what a turn costs although the cut takes longer. A turn that gains nothing is not made, and one that does is spread
/// over moves, since its corners slow the arm down. Assumed.
const CALM_S_MM: f64 = 2.0;
/// λ by which axes are refined where turns cost time, s mm/rad².
const REFINING_S_MM: f64 = 1.0;
/// Largest number of reached directions for which a cone around all of them is computed.
const MOST_NARROW: usize = 64;
/// A fan's angles, rad, and their squares, rad², are ascending up to this rounding error.
const UNEVEN: f64 = 1e-8;
/// Cost per rad of tilt that decides between first directions of equal cost.
const UPRIGHT: f64 = 1e-9;

/// The best sequence, or the waypoint at which every sequence is blocked.
#[derive(Debug, Clone, PartialEq)]
pub enum BestSequence {
    /// The best sequence.
    Sequence {
        /// Direction of each waypoint.
        directions: Vec<u16>,
        /// J of the sequence.
        total: f64,
        /// Number of edges that were evaluated.
        edges: u64,
    },
    /// No free direction of this waypoint can be reached from the waypoints before it.
    Blocked(usize),
}

/// The input of the dynamic program. Lists have one entry per waypoint; the cost of waypoint i and direction n is at
/// `i * directions.len() + n` and is read only where the direction is free.
#[derive(Debug, Clone, Copy)]
pub struct Problem<'a> {
    /// The directions.
    pub directions: &'a Directions,
    /// Cost C.
    pub cost: &'a [f32],
    /// The free directions.
    pub free: &'a FreeSets,
    /// Length of the move that ends at each waypoint, mm; the first is used only as the weight of C.
    pub length_mm: &'a [f64],
    /// The price of turns, and the largest rate of turning.
    pub turns: TurnLimits,
    /// Turns that must not be used.
    pub forbidden: &'a Forbidden,
}

/// Turns that must not be used, by the waypoint at which they end.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Forbidden(HashMap<u32, Vec<[u16; 2]>>);

impl Forbidden {
    /// Forbids the turn from direction `from` to direction `to` during the move that ends at `waypoint`.
    pub fn insert(&mut self, waypoint: usize, from: u16, to: u16) {
        self.0.entry(waypoint as u32).or_default().push([from, to]);
    }

    /// Number of forbidden turns.
    pub fn len(&self) -> usize {
        self.0.values().map(Vec::len).sum()
    }

    /// Whether no turn is forbidden.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    fn at(&self, waypoint: usize) -> &[[u16; 2]] {
        self.0.get(&(waypoint as u32)).map_or(&[], Vec::as_slice)
    }
}

impl Problem<'_> {
    /// The largest turn during the move that ends at i, rad. It is at least one spacing, because otherwise the axis could not
    /// turn in short moves; the time law slows such a move.
    pub(super) fn reach_rad(&self, i: usize) -> f64 {
        let spacing = 1.5 * self.directions.spacing_rad();
        (self.turns.most_rad_per_mm * self.length_mm[i]).max(spacing)
    }

    /// λ/Δs_i.
    pub(super) fn turn_weight(&self, i: usize) -> f64 {
        let weight = match self.turns.price {
            TurnPrice::Smoothness(weight_mm) => weight_mm.max(LEAST_WEIGHT_MM),
            TurnPrice::Time(_) => REFINING_S_MM,
        };
        weight / self.length_mm[i].max(SHORTEST_MM)
    }

    /// What the move to waypoint i costs: `own_cost` of its direction, and the turn to it.
    #[inline]
    fn move_cost(&self, i: usize) -> impl Fn(f64, f64, f64) -> f64 + use<> {
        let (price, weight) = (self.turns.price, self.turn_weight(i));
        let length = self.length_mm[i].max(SHORTEST_MM);
        move |own_cost: f64, angle_rad: f64, square: f64| match price {
            TurnPrice::Smoothness(_) => own_cost + weight * square,
            TurnPrice::Time(turn) => {
                let seconds = turn.seconds(angle_rad);
                own_cost.max(seconds) + turn.factor * CALM_S_MM * square / length
            }
        }
    }

    /// C Δs of waypoint i and direction n.
    pub(super) fn own(&self, i: usize, n: usize) -> f64 {
        f64::from(self.cost[i * self.directions.len() + n]) * self.length_mm[i].max(SHORTEST_MM)
    }
}

/// The sequence with the least J.
pub fn best_sequence(problem: &Problem) -> BestSequence {
    let (count, waypoints) = (problem.directions.len(), problem.free.len());
    let mut came_from = vec![0u8; waypoints * count];
    let mut layer = ProgramLayer::new(problem);
    let mut edges = 0;
    for i in 0..waypoints {
        cancel::poll();
        let alive = if i == 0 { layer.start(0) } else { layer.advance(i, &mut came_from, &mut edges) };
        if !alive {
            return BestSequence::Blocked(i);
        }
    }
    let (last, total) = layer.best_end();
    let mut here = last;
    let mut directions = vec![0u16; waypoints];
    for i in (0..waypoints).rev() {
        directions[i] = here as u16;
        here = usize::from(problem.directions.fan(here).node[usize::from(came_from[i * count + here])]);
    }
    BestSequence::Sequence { directions, total, edges }
}

/// The waypoints that cannot be reached from the one before; the search restarts after every such waypoint. The list is empty
/// exactly if there is a sequence through all waypoints.
pub fn blocked_waypoints(problem: &Problem) -> Vec<usize> {
    let waypoints = problem.free.len();
    let mut came_from = vec![0u8; waypoints * problem.directions.len()];
    let mut layer = ProgramLayer::new(problem);
    let mut edges = 0;
    let mut blocked = Vec::new();
    let mut alive = false;
    for i in 0..waypoints {
        cancel::poll();
        alive = if alive { layer.advance(i, &mut came_from, &mut edges) } else { layer.start(i) };
        if !alive {
            blocked.push(i);
        }
    }
    blocked
}

/// The least cost of reaching each direction of one waypoint.
struct ProgramLayer<'a> {
    problem: &'a Problem<'a>,
    best: Vec<f64>,
    next: Vec<f64>,
    /// The directions that are reached, that is, for which `best` is finite, ascending; all values of `next` are infinite.
    alive: Vec<u16>,
    reached: Vec<u16>,
    /// Whether each direction is free before or after the move.
    passable: Vec<bool>,
}

impl<'a> ProgramLayer<'a> {
    fn new(problem: &'a Problem<'a>) -> Self {
        let n = problem.directions.len();
        Self {
            problem,
            best: vec![f64::INFINITY; n],
            next: vec![f64::INFINITY; n],
            alive: Vec::with_capacity(n),
            reached: Vec::with_capacity(n),
            passable: vec![false; n],
        }
    }

    /// Starts at waypoint i; returns whether it has a free direction.
    fn start(&mut self, i: usize) -> bool {
        self.best.fill(f64::INFINITY);
        self.alive.clear();
        for n in self.problem.free.iter(i) {
            let tilt = tilt_rad(&self.problem.directions.axes()[n]);
            self.best[n] = self.problem.own(i, n) + UPRIGHT * tilt;
            self.alive.push(n as u16);
        }
        self.problem.free.count(i) > 0
    }

    /// Advances from waypoint i − 1 to i; returns whether any direction is reached.
    fn advance(&mut self, i: usize, came_from: &mut [u8], edges: &mut u64) -> bool {
        let p = self.problem;
        let count = p.directions.len();
        let (move_cost, forbidden, reach_rad) = (p.move_cost(i), p.forbidden.at(i), p.reach_rad(i));
        // no direction lies between neighbours, so none can be blocked
        let only_neighbours = reach_rad <= 1.5 * p.directions.spacing_rad() && forbidden.is_empty();
        let beside = || p.free.iter(i).chain(p.free.iter(i - 1)).filter(|_| !only_neighbours);
        beside().for_each(|n| self.passable[n] = true);
        let alive_within = if only_neighbours { None } else { self.alive_within() };
        let least_alive = self.alive.iter().map(|n| self.best[usize::from(*n)]).fold(f64::INFINITY, f64::min);
        self.reached.clear();
        for n in p.free.iter(i) {
            let fan = p.directions.fan(n);
            let most_rad = alive_within.map_or(reach_rad, |(middle, radius_rad)| {
                reach_rad.min(p.directions.angle_at_most(middle, n) + radius_rad)
            });
            let most_rad = most_rad + 1e-6;
            let own_cost = p.own(i, n);
            let edge = |angle_rad: f64, square: f64| move_cost(own_cost, angle_rad, square);
            let (slot, least, looked_at) = if only_neighbours {
                self.among_neighbours(fan, most_rad, edge)
            } else if forbidden.is_empty() {
                self.among_allowed(fan, most_rad, edge, least_alive, |_| false)
            } else {
                let is_forbidden = |from| forbidden.contains(&[from, n as u16]);
                self.among_allowed(fan, most_rad, edge, least_alive, is_forbidden)
            };
            *edges += looked_at as u64;
            if least.is_finite() {
                self.next[n] = least;
                came_from[i * count + n] = slot as u8;
                self.reached.push(n as u16);
            }
        }
        beside().for_each(|n| self.passable[n] = false);
        self.alive.iter().for_each(|n| self.best[usize::from(*n)] = f64::INFINITY);
        std::mem::swap(&mut self.best, &mut self.next);
        std::mem::swap(&mut self.alive, &mut self.reached);
        !self.alive.is_empty()
    }

    /// A direction and an angle such that every reached direction lies within this angle of it; `None` where many are reached,
    /// because computing it would cost more than it saves.
    fn alive_within(&self) -> Option<(usize, f64)> {
        let middle =
            usize::from(*self.alive.get(self.alive.len() / 2).filter(|_| self.alive.len() <= MOST_NARROW)?);
        let angle = |n: &u16| self.problem.directions.angle_at_most(middle, usize::from(*n));
        Some((middle, self.alive.iter().map(angle).fold(0.0, f64::max)))
    }

    /// The best slot to come from among neighbours, the total cost with it, and the number of slots tested.
    #[inline]
    fn among_neighbours(
        &self,
        fan: &Fan,
        most_rad: f64,
        edge: impl Fn(f64, f64) -> f64,
    ) -> (usize, f64, usize) {
        let (mut from, mut least, mut slots) = (0, f64::INFINITY, 0);
        for ((node, square), angle_rad) in fan.node.iter().zip(&fan.square).zip(&fan.angle_rad) {
            if f64::from(*angle_rad) > most_rad {
                break;
            }
            let total = self.best[usize::from(*node)] + edge(f64::from(*angle_rad), *square);
            if total < least {
                (from, least) = (slots, total);
            }
            slots += 1;
        }
        (from, least, slots)
    }

    /// The same over slots that can be reached without passing a blocked direction. No cost is less than `least_alive`, and no edge
    /// cheaper than one of a smaller angle, so the search ends at the slot from which on every farther slot is worse.
    #[inline]
    #[expect(
        clippy::too_many_arguments,
        reason = "the innermost step, inlined into the loop over directions"
    )]
    fn among_allowed(
        &self,
        fan: &Fan,
        most_rad: f64,
        edge: impl Fn(f64, f64) -> f64,
        least_alive: f64,
        is_forbidden: impl Fn(u16) -> bool,
    ) -> (usize, f64, usize) {
        // one bit per slot: no direction on the way is blocked, including the slot's own
        let mut open = [1u64, 0, 0, 0];
        let (mut from, mut least) = (0, f64::INFINITY);
        for (slot, angle_rad) in fan.angle_rad.iter().enumerate() {
            let (angle_rad, square) = (f64::from(*angle_rad), fan.square[slot]);
            // angles ascend but for rounding
            let at_least = edge((angle_rad - UNEVEN).max(0.0), (square - UNEVEN).max(0.0));
            if angle_rad > most_rad || least_alive + at_least >= least {
                return (from, least, slot);
            }
            let by_turn = edge(angle_rad, square);
            let node = fan.node[slot];
            let parent = usize::from(fan.parent[slot]);
            let on_way = open[parent / 64 % 4] >> (parent % 64) & 1 == 1;
            // slot 0 is the direction itself, which is free
            let passes = on_way && self.passable[usize::from(node)];
            open[slot / 64 % 4] |= u64::from(passes) << (slot % 64);
            let total = self.best[usize::from(node)] + by_turn;
            if on_way && total < least && !is_forbidden(node) {
                (from, least) = (slot, total);
            }
        }
        (from, least, fan.angle_rad.len())
    }

    fn best_end(&self) -> (usize, f64) {
        let mut end = (0, f64::INFINITY);
        for (n, total) in self.best.iter().enumerate() {
            if *total < end.1 {
                end = (n, *total);
            }
        }
        if end.1.is_finite() { end } else { (0, 0.0) }
    }
}

#[cfg(test)]
mod tests;
