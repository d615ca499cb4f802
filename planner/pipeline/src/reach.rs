//! Waypoints that the shank cannot get to are put off to the end, when more of the bone is gone, and dropped when it cannot
//! get to them there either; the rest is joined anew. Where the shank is free at two waypoints and cannot turn on the way from
//! one to the other, the burr leaves the bone before the second, turns above it and comes back; only where that is of no help
//! is the waypoint put off, and each time that happens twice as many of the pass's waypoints with it: a pass in a narrow place
//! would otherwise be entered at one waypoint after the other.
//!
//! Putting off a waypoint leaves its bone in place, which may close another's way: the loop repeats until every waypoint
//! has a free angle and a sequence of angles leads through all of them, free between waypoints too.

use std::collections::{HashMap, HashSet};

use bonemill_cutting::cutter::Ball;
use bonemill_cutting::metrics::Moments;
use bonemill_geometry::{Point, Work};
use bonemill_robot::resolve::Meeting;
use bonemill_setup::Unreached;
use bonemill_toolpath::access::{Access, Blocked, EighthTimes, ShankCylinder, ShankObstacles, Turn};
use bonemill_toolpath::engagement::{Increments, mass_increments};
use bonemill_toolpath::orientation::refine::best_checked;
use bonemill_toolpath::orientation::sequence::{self, Forbidden, Problem, best_sequence};
use bonemill_toolpath::orientation::{Directions, FreeSets, TurnLimits};
use bonemill_toolpath::path::{
    MillPath, MoveKind, Pass, PathPoint, PathSpacing, STEP_ROUNDING, enter_from_above, join_passes,
    put_off_points,
};
use bonemill_toolpath::scene::Scene;
use bonemill_toolpath::space::BurrSpace;
use nalgebra::{Unit, Vector3};

use super::arm_axes::ArmAxes;
use super::start::Start;

/// Rounds before the planner gives up; each puts off or drops at least one waypoint, few are usual.
const MOST_ROUNDS: usize = 40;
/// After so many rounds in which turning above the bone was of no help, it is not tried any more.
const MOST_IN_VAIN: u32 = 4;
/// Of the axes along which the shank is free and which the arm cannot take, so many are asked which link is in the way.
const MOST_ASKED: usize = 8;
/// Of a pass that the shank cannot turn to, at most 2 to the power of this many waypoints are put off at once.
const MOST_DOUBLED: u32 = 10;

/// A path whose every waypoint the shank can reach.
#[derive(Debug)]
pub struct ReachedPath<'a> {
    /// The path.
    pub path: MillPath,
    /// The access test for it.
    pub access: Access<'a>,
    /// Which directions are free at each waypoint, and within the tilt limit where it binds.
    pub free: FreeSets,
    /// Whether the tilt limit binds at the waypoint.
    pub limited: Vec<bool>,
    /// Length of the move that ends at each waypoint, mm.
    pub length_mm: Vec<f64>,
    /// Mass that each waypoint's ball takes less the sweep of all earlier moves.
    pub moments: Vec<Moments>,
    /// What was dropped.
    pub dropped: Vec<Dropped>,
}

/// A place that the path leaves out.
#[derive(Debug, Clone, PartialEq)]
pub struct Dropped {
    /// Where the burr's centre would have been.
    pub position: Point<Work>,
    /// What stands in the way.
    pub reason: String,
}

impl ReachedPath<'_> {
    /// Whether the path is another than one with so many passes that were put off or are entered from above, for the shank's sake.
    pub fn is_changed(&self, set_apart: usize) -> bool {
        !self.dropped.is_empty() || self::set_apart(&self.path) != set_apart
    }

    /// The move that ends at waypoint i, with the axes at its ends.
    pub fn turn<'b>(&self, i: usize, axes: [&'b Unit<Vector3<f64>>; 2]) -> Turn<'b> {
        Turn::along(&self.path.points, i, axes)
    }

    /// Points of passes that were put off, and then reached.
    pub fn put_off(&self) -> usize {
        self.path.passes.iter().filter(|pass| pass.put_off).map(|pass| pass.points.len()).sum()
    }
}

/// Number of passes that were put off or are entered from above.
pub fn set_apart(path: &MillPath) -> usize {
    path.passes.iter().filter(|pass| pass.put_off || pass.from_above).count()
}

/// What access depends on.
#[derive(Debug, Clone, Copy)]
pub struct ReachSpec<'a, 's> {
    /// What the path is laid for.
    pub start: Start<'s>,
    /// The burr's.
    pub radius_mm: f64,
    /// The shank.
    pub shank: &'a [ShankCylinder],
    /// What it may not touch.
    pub solid: &'s ShankObstacles,
    /// The axes that the arm can take.
    pub arm: &'a ArmAxes,
    /// Directions to choose from.
    pub directions: &'a Directions,
    /// How fast they may change.
    pub turns: TurnLimits,
    /// For joining passes anew.
    pub spacing: PathSpacing,
}

impl ReachSpec<'_, '_> {
    /// A move longer than a step by more than rounding is no cut, mm.
    fn longest_cut_mm(&self) -> f64 {
        self.spacing.step_mm * (1.0 + STEP_ROUNDING)
    }
}

/// Puts off what cannot be reached, then drops it.
///
/// # Errors
/// [`Unreached`].
pub fn reached<'a>(
    scene: &'a Scene,
    space: &BurrSpace,
    mut path: MillPath,
    spec: &ReachSpec<'_, 'a>,
) -> Result<ReachedPath<'a>, Unreached> {
    let mut dropped = Vec::new();
    // of the round before; none when the path is another than what was put off made it
    let mut blocked_before: Option<usize> = None;
    let mut waypoints = 0;
    let mut entered_in_vain = 0;
    let ball = Ball { radius_mm: spec.radius_mm };
    for round in 1..=MOST_ROUNDS {
        if path.points.is_empty() {
            return Err(Unreached::Nothing { mostly: most_frequent(&told(dropped)) });
        }
        let eighths = EighthTimes::new(spec.solid, &path.points, ball);
        let access = Access::new(scene, spec.solid, eighths, spec.shank);
        let limited = limited(path.points.len(), |i| path.points[i].kind == MoveKind::Cut);
        let free = free_directions(&access, &path.points, &limited, spec);
        let length_mm = lengths(&path.points);
        let mut blocked = closed_waypoints(&free);
        let mut ahead = 1;
        if blocked.is_empty() {
            // what is left in the last round is a plan that falls short, and says so
            let looked_between = (round < MOST_ROUNDS).then_some(&access);
            let unturned = unturned_waypoints(looked_between, &path.points, &free, &length_mm, spec);
            if unturned.is_empty() {
                let Increments { at_end: moments, on_the_way_mg } =
                    mass_increments(&scene.density_g_cm3, &path.points, ball);
                // less than a voxel of water is a skin between the grid's voxels
                let skin_mg = space.grid().voxel_mm3();
                let removes = |i: usize| moments[i].mass_mg() > 0.0 || on_the_way_mg[i] > skin_mg;
                let is_long_cut = |i: usize| removes(i) && length_mm[i] > spec.longest_cut_mm();
                let long: HashSet<usize> = (0..path.points.len()).filter(|i| is_long_cut(*i)).collect();
                if long.is_empty() || round == MOST_ROUNDS {
                    let dropped = told(dropped);
                    return Ok(ReachedPath { path, access, free, limited, length_mm, moments, dropped });
                }
                // links that graze a cusp are cuts: laid anew in steps, along the same way
                path = path.stepped(space, &long, spec.spacing.step_mm);
                continue;
            }
            waypoints = unturned.len();
            let leads_to: HashSet<_> = unturned.iter().map(|i| path.points[*i].leads_to).collect();
            let (above, below): (HashSet<_>, HashSet<_>) =
                leads_to.into_iter().partition(|point| is_from_above(&path.passes, *point));
            if !below.is_empty() && entered_in_vain < MOST_IN_VAIN {
                let passes = enter_from_above(&path.passes, &below);
                path = join_passes(space, spec.spacing, passes, path.layers);
                blocked_before = None;
                continue;
            }
            let is_to_go =
                |i: &usize| entered_in_vain >= MOST_IN_VAIN || above.contains(&path.points[*i].leads_to);
            blocked = unturned.into_iter().filter(is_to_go).collect();
            ahead = 1 << entered_in_vain;
            entered_in_vain = (entered_in_vain + 1).min(MOST_DOUBLED);
        }
        // a way between two points may be blocked at either end: where going elsewhere was of no help, it does not start there
        let from_too = blocked_before.is_some_and(|before| blocked.len() >= before);
        waypoints = blocked.len();
        blocked_before = Some(waypoints);
        let mut points = HashSet::new();
        for i in blocked {
            let from = from_too.then(|| departure(&path.points, i)).flatten();
            let (pass, first) = path.points[i].leads_to;
            for point in (first..first + ahead).map(|n| (pass, n)).chain(from) {
                let Some(pass) = path.passes.get(point.0 as usize) else { continue };
                let Some(position) = pass.points.get(point.1 as usize) else { continue };
                if points.insert(point) && pass.put_off {
                    let (index, center) = (i as u32, path.points[i].position);
                    let why = if free.count(i) > 0 {
                        WhyDropped::Text("no way to turn the shaft there".into())
                    } else if let Some(why) = arm_blocks(&access, spec, index, center, limited[i]) {
                        why
                    } else {
                        let blocked = access.blocked(index, center, &Vector3::z());
                        WhyDropped::Text(what_blocks(scene, spec.shank, center, blocked))
                    };
                    dropped.push((*position, why));
                }
            }
        }
        let passes = put_off_points(&path.passes, &points, path.layers);
        path = join_passes(space, spec.spacing, passes, path.layers);
    }
    Err(Unreached::Unsettled { waypoints, rounds: MOST_ROUNDS })
}

/// Why a place is left out.
enum WhyDropped {
    Text(String),
    /// A link keeps the arm from an axis along which the shank is free.
    Meets(Meeting),
}

/// The words for an axis that the arm cannot take.
const NO_SUCH_AXIS: &str = "the arm cannot take an axis along which the shank is free";

/// What keeps the arm from the axes along which the shank would be free; `None` where there are none of these.
fn arm_blocks(
    access: &Access,
    spec: &ReachSpec,
    i: u32,
    center: Point<Work>,
    is_limited: bool,
) -> Option<WhyDropped> {
    let set = spec.directions;
    let allowed = set.axes().iter().filter(|axis| !is_limited || set.is_within_limit(axis));
    let mut blocked =
        allowed.filter(|axis| !spec.arm.allows(center, axis) && access.is_free(i, center, axis)).peekable();
    blocked.peek()?;
    let meeting = blocked.take(MOST_ASKED).find_map(|axis| spec.start.placed().meets(center, axis));
    Some(meeting.map_or(WhyDropped::Text(NO_SUCH_AXIS.into()), WhyDropped::Meets))
}

/// The reasons in words. Places at which one link meets one thing have one reason, with the least distance of them all.
fn told(dropped: Vec<(Point<Work>, WhyDropped)>) -> Vec<Dropped> {
    let mut nearest: HashMap<(&'static str, String), Meeting> = HashMap::new();
    for (_, why) in &dropped {
        if let WhyDropped::Meets(meeting) = why {
            let least =
                nearest.entry((meeting.link, meeting.other.clone())).or_insert_with(|| meeting.clone());
            least.distance_mm = least.distance_mm.min(meeting.distance_mm);
        }
    }
    let reason = |why| match why {
        WhyDropped::Text(text) => text,
        WhyDropped::Meets(meeting) => {
            let least = nearest.get(&(meeting.link, meeting.other.clone())).unwrap_or(&meeting);
            format!("{NO_SUCH_AXIS}: {least}")
        }
    };
    dropped.into_iter().map(|(position, why)| Dropped { position, reason: reason(why) }).collect()
}

/// The most frequent reason, the first of equal ones.
fn most_frequent(dropped: &[Dropped]) -> Option<String> {
    let counted = super::dropped_by_reason(dropped);
    let most = counted.values().max().copied()?;
    dropped.iter().map(|place| &place.reason).find(|reason| counted[reason.as_str()] == most).cloned()
}

/// The point of a pass from which the burr is on its way at waypoint i.
fn departure(points: &[PathPoint], i: usize) -> Option<(u32, u32)> {
    let heading = points[i].leads_to;
    points[..i].iter().rev().map(|p| p.leads_to).find(|leads_to| *leads_to != heading)
}

/// Lengths of the moves, the first 0, mm.
pub fn lengths(points: &[PathPoint]) -> Vec<f64> {
    let moves = points.windows(2).map(|w| w[0].position.distance_mm(&w[1].position));
    std::iter::once(0.0).chain(moves).take(points.len()).collect()
}

/// Where the tilt limit binds: at both ends of a cut and, since the motion rounds the corners there, one waypoint beyond.
///
/// A turn between two axes within the limit stays within it, so that no part of a cut is tilted beyond the limit.
pub fn limited(waypoints: usize, is_cut: impl Fn(usize) -> bool) -> Vec<bool> {
    let mut limited = vec![false; waypoints];
    for i in (0..waypoints).filter(|i| is_cut(*i)) {
        limited[i.saturating_sub(2)..(i + 2).min(waypoints)].fill(true);
    }
    limited
}

/// Directions that are free at each waypoint, and within the tilt limit where it binds.
pub fn free_directions(
    access: &Access,
    points: &[PathPoint],
    limited: &[bool],
    spec: &ReachSpec,
) -> FreeSets {
    let axes = spec.directions.axes();
    let within: Vec<bool> = axes.iter().map(|a| spec.directions.is_within_limit(a)).collect();
    FreeSets::fill(points.len(), axes.len(), |i, n| {
        if limited[i] && !within[n] {
            return false;
        }
        spec.arm.allows(points[i].position, &axes[n])
            && access.is_free(i as u32, points[i].position, &axes[n])
    })
}

/// Waypoints without a free direction.
fn closed_waypoints(free: &FreeSets) -> Vec<usize> {
    (0..free.len()).filter(|i| free.count(*i) == 0).collect()
}

/// The waypoints to which the shank cannot turn from the one before, whichever of the free axes it has there; none exactly where
/// some sequence of axes leads through all. `access`: turns are free between waypoints too; without it that is left open.
fn unturned_waypoints(
    access: Option<&Access>,
    points: &[PathPoint],
    free: &FreeSets,
    length_mm: &[f64],
    spec: &ReachSpec,
) -> Vec<usize> {
    let none = Forbidden::default();
    let problem = Problem {
        directions: spec.directions,
        cost: &vec![0.0; free.len() * spec.directions.len()],
        free,
        length_mm,
        turns: spec.turns,
        forbidden: &none,
    };
    let axis = |n: u16| &spec.directions.axes()[usize::from(n)];
    let is_turn_free = |i: usize, from: u16, to: u16| {
        access.is_none_or(|access| access.is_turn_free(&Turn::along(points, i, [axis(from), axis(to)])))
    };
    let checked = best_checked(&problem, best_sequence(&problem), is_turn_free);
    if checked.is_free() {
        return Vec::new();
    }
    let blocked = sequence::blocked_waypoints(&Problem { forbidden: &checked.forbidden, ..problem });
    if blocked.is_empty() { checked.failing } else { blocked }
}

/// Whether a point of a pass is its first, and the pass entered from above.
fn is_from_above(passes: &[Pass], (pass, point): (u32, u32)) -> bool {
    point == 0 && passes.get(pass as usize).is_some_and(|pass| pass.from_above)
}

/// Rounds of exempting grazing links before the limit is left as it was laid.
const MOST_EXEMPTIONS: usize = 200;

/// Makes the tilt limit bind wherever a move `cuts` anything, links that graze a cusp included. Where that leaves no way
/// through, the grazing link keeps its freedom; how many do is returned.
pub fn limit_where_it_cuts(reached: &mut ReachedPath, cuts: &[bool], spec: &ReachSpec) -> usize {
    let count = reached.path.points.len();
    let is_laid = |i: usize| reached.path.points[i].kind == MoveKind::Cut;
    let mut grazing: Vec<bool> = (0..count).map(|i| cuts[i] && !is_laid(i)).collect();
    if !grazing.contains(&true) {
        return 0;
    }
    let axes = spec.directions.axes();
    let within: Vec<bool> = axes.iter().map(|a| spec.directions.is_within_limit(a)).collect();
    let mut exempt = 0;
    for _ in 0..MOST_EXEMPTIONS {
        let bound = limited(count, |i| grazing[i]);
        let mut free = reached.free.clone();
        for i in (0..count).filter(|i| bound[*i] && !reached.limited[*i]) {
            free.retain(i, |n| within[n]);
        }
        let mut blocked = closed_waypoints(&free);
        if blocked.is_empty() {
            let ReachedPath { access, path, length_mm, .. } = &*reached;
            blocked = unturned_waypoints(Some(access), &path.points, &free, length_mm, spec);
        }
        if blocked.is_empty() {
            reached.free = free;
            reached.limited.iter_mut().zip(bound).for_each(|(limited, bound)| *limited |= bound);
            return exempt;
        }
        let before = exempt;
        for i in blocked {
            for near in grazing.iter_mut().take(i + 3).skip(i.saturating_sub(2)) {
                exempt += usize::from(std::mem::take(near));
            }
        }
        if exempt == before {
            break;
        }
    }
    exempt + grazing.iter().filter(|g| **g).count()
}

/// Beyond a shank's radius a structure counts as met within this many voxels: as far as a march may stop before it.
const BESIDE_VOXELS: f64 = 2.0;

/// What the shank would meet along the approach, in words.
fn what_blocks(
    scene: &Scene,
    shank: &[ShankCylinder],
    center: Point<Work>,
    blocked: Option<Blocked>,
) -> String {
    let at_mm = match blocked {
        None => return "tilt limit".into(),
        Some(Blocked::NotYetRemoved { .. }) => return "shank would meet bone that is not yet removed".into(),
        Some(Blocked::Obstacle { at_mm }) => at_mm,
    };
    let at = scene.ct_from_work * (center + Vector3::z() * at_mm);
    let holds = |c: &&ShankCylinder| at_mm <= c.to_mm;
    let radius_mm = shank.iter().find(holds).or(shank.last()).map_or(0.0, |c| c.radius_mm);
    let distances = scene.structures.iter().filter_map(|s| Some((s.field.as_ref()?.distance(at), &s.name)));
    match distances.min_by(|a, b| a.0.total_cmp(&b.0)) {
        Some((distance_mm, name))
            if distance_mm <= radius_mm + BESIDE_VOXELS * scene.class.grid().spacing_mm().x =>
        {
            format!("shank would meet {name} or bone beside it")
        }
        _ => "shank would meet untargeted bone".into(),
    }
}
