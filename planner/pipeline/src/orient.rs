//! The shaft's axis at every waypoint, by the case's mode.

use bonemill_case::OrientationMode;
use bonemill_cutting::burr::EngagedSamples;
use bonemill_cutting::speed::Levels;
use bonemill_geometry::cancel;
use bonemill_toolpath::orientation::corridor::{Corridor, best_near};
use bonemill_toolpath::orientation::greedy::{self, LoneWaypoint, low_pass, settle};
use bonemill_toolpath::orientation::refine::{Chart, best_checked, refine};
use bonemill_toolpath::orientation::sequence::{BestSequence, Forbidden, Problem, best_sequence};
use bonemill_toolpath::orientation::{Permissible, TiltFamily, TurnLimits, TurnPrice};
use nalgebra::{Matrix3, Unit, Vector3};
use rayon::prelude::*;

use super::axis_cost::{AxisObjective, CostField};
use super::direction_sets::Finer;
use super::free_axes::FreeAxes;
use super::in_time::{Goal, UnderLevels, least_levels};

/// Half-width of the greedy mode's low-pass, waypoints. Assumed: D gives none.
const LOW_PASS_HALF: usize = 6;

/// A move during which the turning shank is not free all the way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BlockedTurn {
    /// Where the move ends.
    pub waypoint: usize,
    /// By how much the thin shank would have to be narrower, mm; infinite where that is of no help.
    pub missing_mm: f64,
}

/// Axes, and how they came about.
#[derive(Debug, Clone, PartialEq)]
pub struct Oriented {
    /// Per waypoint, work.
    pub axes: Vec<Unit<Vector3<f64>>>,
    /// The family's angle per waypoint, rad, for an arm with one tilt.
    pub angles_rad: Option<Vec<f64>>,
    /// Waypoints whose cost needed no force.
    pub closed_form: usize,
    /// Waypoints whose cost needed the force.
    pub with_force: usize,
    /// Waypoints at which the low-pass was held (greedy).
    pub low_pass_held: usize,
    /// Moves during which the turning shank is not free all the way.
    pub blocked_turns: Vec<BlockedTurn>,
    /// What the shank leaves open around each axis.
    pub allowed: Vec<Permissible>,
    /// Angle between neighbouring directions of the finest set that the axes were chosen from, rad.
    pub spacing_rad: f64,
    /// What the choice by levels predicts.
    pub predicted: Option<Predicted>,
}

/// The time of a sequence of axes as the choice of axes sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Predicted {
    /// The levels under which its cuts are as fast as they may be.
    pub levels: Levels,
    /// Time of the moves at their caps, s.
    pub seconds: f64,
    /// The part of it in which turns keep moves waiting, s.
    pub waits_s: f64,
}

impl FreeAxes<'_> {
    /// What is open around each axis; `corridor`: of the finer cap.
    fn allowed(&self, oriented: &Oriented, corridor: Option<&Corridor>) -> Vec<Permissible> {
        let free = &self.reached.free;
        let fine = self.finer.zip(corridor).map(|((directions, _), corridor)| (directions, corridor));
        let at = |(i, axis): (usize, &Unit<Vector3<f64>>)| match oriented.angles_rad.as_ref() {
            Some(angles) => Permissible::in_plane(self.directions, free, i, angles[i]),
            None => Permissible::on_cap(self.directions, free, i, axis, fine),
        };
        oriented.axes.par_iter().enumerate().map(at).collect()
    }

    fn blocked_turns(&self, axes: &[Unit<Vector3<f64>>]) -> Vec<BlockedTurn> {
        let blocked = |i: usize| {
            let turn = self.reached.turn(i, [&axes[i - 1], &axes[i]]);
            let is_free = self.reached.access.is_turn_free(&turn);
            (!is_free).then(|| BlockedTurn { waypoint: i, missing_mm: self.reached.access.missing_mm(&turn) })
        };
        (1..axes.len()).into_par_iter().filter_map(blocked).collect()
    }
}

/// Chooses the axes.
pub fn orient(mode: OrientationMode, room: &FreeAxes, field: &CostField, goal: Option<&Goal>) -> Oriented {
    let count = room.reached.path.points.len();
    let with_force = (0..count).filter(|i| field.needs_force(*i)).count();
    let closed_form = (0..count).filter(|i| field.cuts(*i)).count() - with_force;
    let mut oriented = match mode {
        OrientationMode::Fixed => fixed(room).surveyed(room, None),
        OrientationMode::Greedy => by_waypoint(room, field).surveyed(room, None),
        OrientationMode::Optimal => optimal(room, field, goal),
    };
    (oriented.with_force, oriented.closed_form) = (with_force, closed_form);
    oriented
}

impl Oriented {
    fn new(axes: Vec<Unit<Vector3<f64>>>, family: Option<&TiltFamily>) -> Self {
        let angles_rad = family.map(|family| axes.iter().map(|a| family.angle(a)).collect());
        Self {
            axes,
            angles_rad,
            closed_form: 0,
            with_force: 0,
            low_pass_held: 0,
            blocked_turns: Vec::new(),
            allowed: Vec::new(),
            spacing_rad: 0.0,
            predicted: None,
        }
    }

    /// With what is open around each axis and on the way to it; `corridor`: where the axes are of the finer cap.
    fn surveyed(mut self, room: &FreeAxes, corridor: Option<&Corridor>) -> Self {
        let set = room.finer.filter(|_| corridor.is_some()).map_or(room.directions, |(finer, _)| finer);
        self.spacing_rad = set.spacing_rad();
        self.allowed = room.allowed(&self, corridor);
        self.blocked_turns = room.blocked_turns(&self.axes);
        self
    }
}

/// Along the approach, or as near as is free.
fn fixed(room: &FreeAxes) -> Oriented {
    let axis = |i: usize| room.directions.axes()[room.directions.straightest(|n| room.is_in_set(i, n))];
    Oriented::new((0..room.reached.free.len()).map(axis).collect(), room.family)
}

/// The best axis of every waypoint by itself.
fn wishes(room: &FreeAxes, field: &CostField) -> Vec<greedy::BestAxis> {
    (0..room.reached.free.len())
        .into_par_iter()
        .map_init(EngagedSamples::default, |samples, i| {
            cancel::poll();
            if !field.cuts(i) {
                return if room.reached.free.count(i) > 0 {
                    greedy::BestAxis::Any
                } else {
                    greedy::BestAxis::Nothing
                };
            }
            let AxisObjective::Dillon(terms) = field.objective else { return greedy::BestAxis::Any };
            field.gather(i, samples);
            let compliance =
                |axis: &Vector3<f64>| Some(&field.compliance.as_ref()?[room.directions.nearest(axis)]);
            LoneWaypoint {
                directions: room.directions,
                family: room.family,
                in_set: |n: usize| room.is_in_set(i, n),
                is_free: |axis: &Unit<Vector3<f64>>| room.is_free(i, axis),
                cost: |axis: &Unit<Vector3<f64>>| {
                    field.dillon(terms, i, axis, &field.push(samples, axis, compliance(axis)))
                },
            }
            .wish()
        })
        .collect()
}

fn by_waypoint(room: &FreeAxes, field: &CostField) -> Oriented {
    let filtered = filtered(room, &wishes(room, field));
    Oriented { low_pass_held: filtered.held, ..Oriented::new(filtered.axes, room.family) }
}

/// The paper's low-pass over each waypoint's best axis alone.
fn filtered(room: &FreeAxes, wishes: &[greedy::BestAxis]) -> greedy::Greedy {
    let in_set = |i: usize, n: usize| room.is_in_set(i, n);
    let is_free = |i: usize, axis: &Unit<Vector3<f64>>| room.is_free(i, axis);
    let raw = settle(room.directions, wishes, in_set, is_free);
    low_pass((room.directions, room.family), &raw, LOW_PASS_HALF, in_set, is_free)
}

/// A cost of waypoint i for an axis, given what it cuts and the axis's compliance.
type AxisCost<'a> =
    dyn Fn(usize, &EngagedSamples, &Unit<Vector3<f64>>, Option<&Matrix3<f64>>) -> f32 + Sync + 'a;

/// The best sequence on the set; near it on a finer cap, where there is one; then between its directions.
fn optimal(room: &FreeAxes, field: &CostField, goal: Option<&Goal>) -> Oriented {
    let waypoints = room.reached.free.len();
    let kept: Option<Vec<EngagedSamples>> = room.finer.filter(|_| waypoints <= MOST_KEPT).map(|_| {
        let gathered = |i: usize| {
            cancel::poll();
            let mut samples = EngagedSamples::default();
            field.gather(i, &mut samples);
            samples.shrink_to_fit();
            samples
        };
        (0..waypoints).into_par_iter().map(gathered).collect()
    });
    let kept = kept.as_deref();
    // how many times farther apart directions are than the finest
    let coarser = room.finer.map_or(1.0, |(finer, _)| room.directions.spacing_rad() / finer.spacing_rad());
    match (field.objective, goal) {
        (AxisObjective::Levels(times), Some(goal)) => {
            let UnderLevels { levels, cost, found, seconds: [seconds, waits_s] } =
                least_levels(room, field, &times, goal, (coarser, kept));
            let value = |i: usize, samples: &EngagedSamples, axis: &Unit<_>, compliance: Option<&_>| {
                let own = if field.cuts(i) {
                    let push = field.axis_push(&times, i, axis, &field.push(samples, axis, compliance));
                    push.cost(&levels, times.range_mm_s)
                } else {
                    1.0 / times.link_mm_s
                };
                (own + room.leaves_kept(i, axis)) as f32
            };
            let turns = goal.limits(room.turns, 1.0);
            let predicted = Predicted { levels: levels.levels, seconds, waits_s };
            Oriented {
                predicted: Some(predicted),
                ..along_best(room, field, (&cost, found), turns, (&value, kept))
            }
        }
        (AxisObjective::Dillon(terms), _) => {
            let value = |i: usize, samples: &EngagedSamples, axis: &Unit<_>, compliance: Option<&_>| {
                if !field.cuts(i) {
                    return 0.0;
                }
                field.dillon(terms, i, axis, &field.push(samples, axis, compliance)) as f32
            };
            let cost = field.rows(room.directions, &room.reached.free, kept, value);
            let none = Forbidden::default();
            let TurnPrice::Smoothness(weight_mm) = room.turns.price else {
                return fixed(room).surveyed(room, None);
            };
            // where directions are far apart a turn of one spacing stands for a way over several of the finer ones
            let turns = TurnLimits { price: TurnPrice::Smoothness(weight_mm / coarser), ..room.turns };
            let found = best_sequence(&room.problem(&cost, turns, &none));
            along_best(room, field, (&cost, found), room.turns, (&value, kept))
        }
        (AxisObjective::Levels(_), None) => fixed(room).surveyed(room, None),
    }
}

/// From the best sequence of the set to axes: near it on the finer cap, its turns tested, then between directions.
fn along_best(
    room: &FreeAxes,
    field: &CostField,
    (cost, found): (&[f32], BestSequence),
    turns: TurnLimits,
    (value, kept): (&AxisCost, Option<&[EngagedSamples]>),
) -> Oriented {
    let none = Forbidden::default();
    let problem = room.problem(cost, turns, &none);
    let corridor = room.finer.and_then(|finer| on_finer(room, field, (value, kept), finer, (&found, turns)));
    let checked = |problem: &Problem, first: BestSequence| {
        let axis = |n: u16| &problem.directions.axes()[usize::from(n)];
        best_checked(problem, first, |i, from, to| room.is_turn_free(i, axis(from), axis(to)))
    };
    let near = room.finer.zip(corridor).and_then(|((directions, _), corridor)| {
        let Corridor { free, cost, found, .. } = &corridor;
        let checked = checked(&Problem { directions, cost, free, ..problem }, found.clone());
        checked.is_free().then_some((checked, corridor))
    });
    let (checked, corridor) = match near {
        Some((checked, corridor)) => (checked, Some(corridor)),
        None => {
            let first = if room.finer.is_some() { best_sequence(&problem) } else { found };
            let mut best = checked(&problem, first);
            if !best.is_free() {
                // the one by which the path was found to be passable
                let free_of_cost = Problem { cost: &vec![0.0; cost.len()], ..problem };
                best = checked(&free_of_cost, best_sequence(&free_of_cost));
            }
            (best, None)
        }
    };
    let problem = match (room.finer, &corridor) {
        (Some((directions, _)), Some(Corridor { free, cost, .. })) => {
            Problem { directions, cost, free, ..problem }
        }
        _ => problem,
    };
    let BestSequence::Sequence { directions, .. } = checked.found else {
        // the same constraints were found feasible when waypoints were dropped; each axis is free all the same
        return fixed(room).surveyed(room, None);
    };
    let chart = room.family.map_or(Chart::Sphere, Chart::Plane);
    // a turn that failed on the set may fail refined too: it is counted in the end
    let failing: std::collections::HashSet<usize> = checked.failing.into_iter().collect();
    let is_turn_free = |i: usize, from: &Unit<Vector3<f64>>, to: &Unit<Vector3<f64>>| {
        failing.contains(&i) || room.is_turn_free(i, from, to)
    };
    let refined = refine(&problem, &directions, chart, |i, a| room.is_free(i, a), is_turn_free);
    let oriented = Oriented { angles_rad: refined.angles_rad, ..Oriented::new(refined.axes, None) };
    oriented.surveyed(room, corridor.as_ref())
}

/// Up to so many waypoints what they cut is kept from set to set, about 10 kB each.
const MOST_KEPT: usize = 20_000;

/// The best sequence of the finer cap near one of the set; `None` where none gets through.
fn on_finer(
    room: &FreeAxes,
    field: &CostField,
    (value, kept): (&AxisCost, Option<&[EngagedSamples]>),
    (finer, numbers): &Finer,
    (found, turns): (&BestSequence, TurnLimits),
) -> Option<Corridor> {
    let BestSequence::Sequence { directions, .. } = found else { return None };
    let start: Vec<u16> = directions.iter().map(|n| numbers[usize::from(*n)]).collect();
    let ask = |i: usize, wanted: &[usize]| {
        cancel::poll();
        let axis = |n: usize| &finer.axes()[n];
        let is_free: Vec<bool> = wanted.iter().map(|n| room.is_free(i, axis(*n))).collect();
        let mut own = EngagedSamples::default();
        let samples = field.kept_or_gathered(kept, i, &mut own);
        let compliance = |n: usize| Some(&field.finer_compliance.as_ref()?[n]);
        let cost = |n: usize| value(i, samples, axis(n), compliance(n));
        wanted.iter().zip(is_free).map(|(n, is_free)| is_free.then(|| cost(*n))).collect()
    };
    best_near(finer, &start, &room.reached.length_mm, turns, ask)
}
