//! Direction and sense of the lines, chosen by the forces toward the structures.
//!
//! They decide which side of the burr meets a structure, and with one tilt how often the shaft must alternate between the two sides
//! of a line. Candidates, lines along the target's longer side and across it, each cut to and fro or away from the structures, are
//! laid as drafts: whole paths, finishing included, with coarse steps and coarse directions. Each draft is judged twice in one and the
//! same time, links included: with the shaft along the approach at the least levels of force, and, where the case chooses axes by
//! levels, with axes under the levels of the best straight draft. The figures of both are mean and peak of the force toward each
//! structure and the mean force. The first candidate stands unless another is clearly better, so that rounding decides nothing.
//!
//! A draft is a comparison, not a plan: waypoints that no axis reaches count as time without a cut, and nothing is
//! dropped or refined; forces count, also where the cost uses the deflection. Bone stands and goes by voxels, not by parts of them,
//! and the joints' accelerations do not count.

use bonemill_case::{Case, Objective, OrientationMode, Sense};
use bonemill_cutting::burr::{EngagedForce, EngagedSamples};
use bonemill_cutting::cutter::Ball;
use bonemill_cutting::metrics::Moments;
use bonemill_cutting::speed::Levels;
use bonemill_setup::nearest_structures::{self, NearStructure};
use bonemill_toolpath::access::Access;
use bonemill_toolpath::engagement::{SweptPath, mass_increments_by_voxels};
use bonemill_toolpath::orientation::{FreeSets, TurnTime};
use bonemill_toolpath::path::{self, MillPath, MoveKind, PathSpacing, RasterFrame};
use bonemill_toolpath::scene::{Class, Scene};
use nalgebra::{Unit, Vector3};
use rayon::prelude::*;

use super::PlanError;
use super::axis_cost::{AxisObjective, CostField, LevelTimes};
use super::in_time::{Goal, best_under};
use super::laid::{Raster, feeds};
use super::levels;
use super::prepared::ShaftFreedom;
use super::reach::{ReachSpec, free_directions, lengths, limited};
use super::reference::StructureForces;
use super::sampled::SampledForce;
use super::speeds::{self, Aim, PushedMoves};
use super::start::Start;

/// An angle from the grid's axes is rounded to this, rad, so that lines along an axis are exactly along it.
const ANGLE_RAD: f64 = 1e-9;
/// A draft's steps are this many times longer.
const COARSER: f64 = 4.0;
/// A later candidate must have a product of figures that is lower by this share: otherwise the first stands.
const CLEARLY: f64 = 0.25;
/// A candidate that leaves this share more of its length out of reach than the best is no candidate.
const MORE_UNREACHED: f64 = 0.01;
/// Nor is one whose largest force is above that of the best straight shaft by this share, where another keeps it.
const MORE_FORCE: f64 = 0.05;

/// The directions of lines that a case leaves open: the one that it gives, or along the target and across.
pub(super) fn frames(case: &Case, scene: &Scene) -> Result<Vec<RasterFrame>, PlanError> {
    if let Some(angle) = case.path.raster_rad {
        return Ok(vec![RasterFrame::at_angle(((angle - scene.turn_rad) / ANGLE_RAD).round() * ANGLE_RAD)]);
    }
    let along =
        RasterFrame::chosen(&scene.target_hull_xy, toward_structure(case, scene)?, mass_center(scene));
    Ok(vec![along, along.across()])
}

/// The lines to choose from.
fn candidates(case: &Case, frames: &[RasterFrame]) -> Vec<Raster> {
    let senses = match case.path.sense {
        Sense::Auto if case.structures.is_empty() => vec![Sense::Both],
        Sense::Auto => vec![Sense::Both, Sense::Away],
        given => vec![given],
    };
    let with = |sense: &Sense| {
        frames.iter().map(|frame| Raster { frame: *frame, sense: *sense }).collect::<Vec<_>>()
    };
    senses.iter().flat_map(with).collect()
}

/// The lines that are chosen for the plan, and for a straight shaft.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ChosenLines {
    pub plan: Raster,
    pub straight: Raster,
    /// What they were chosen from; none where there was no choice.
    pub drafts: Vec<LinesDraft>,
}

/// Lines as a draft judges them.
#[derive(Debug, Clone, PartialEq)]
pub struct LinesDraft {
    /// The lines.
    pub raster: Raster,
    /// The forces of the draft; none where no sequence of axes gets through.
    pub forces: Option<StructureForces>,
}

/// Chooses the lines. `time_share`: total time over that of lines along the first frame at the nominal speed; `turn`: how long turns
/// take, where axes are chosen by levels.
///
/// # Errors
/// When the tool, the material or the cost's weights are not usable.
pub(super) fn chosen(
    start: &Start,
    freedom: &ShaftFreedom,
    frames: &[RasterFrame],
    (time_share, turn): (f64, Option<TurnTime>),
) -> Result<ChosenLines, PlanError> {
    let case = start.case;
    let candidates = candidates(case, frames);
    if let [only] = candidates[..] {
        return Ok(ChosenLines { plan: only, straight: only, drafts: Vec::new() });
    }
    let chooses_axes =
        case.orientation.mode == OrientationMode::Optimal && case.cost.objective == Objective::Levels;
    let turn = turn.filter(|_| chooses_axes);
    let drafts = Drafts::new(start, freedom)?;
    let made: Vec<Draft> =
        candidates.par_iter().map(|raster| drafts.draft(raster, turn.is_some())).collect::<Result<_, _>>()?;
    // one time for all of them
    let first = &made[0];
    let total_s = time_share
        * (first.cuts_mm(&first.straight) / case.speed.nominal_mm_s + first.links_s(case, &first.straight));
    let straight: Vec<Judged> = made
        .par_iter()
        .map(|draft| draft.judged(case, &draft.straight, total_s, None))
        .collect::<Result<_, _>>()?;
    let best_straight = first_clearly_best(straight.iter().map(|judged| Some(judged.forces.score(case))));
    let [reference, most] = straight[best_straight].levels;
    let listed = |forces: Vec<Option<StructureForces>>| {
        let drafts = candidates.iter().zip(forces);
        drafts.map(|(raster, forces)| LinesDraft { raster: *raster, forces }).collect::<Vec<_>>()
    };
    let Some(turn) = turn else {
        let best = candidates[best_straight];
        let drafts = listed(straight.into_iter().map(|judged| Some(judged.forces)).collect());
        return Ok(ChosenLines { plan: best, straight: best, drafts });
    };
    let goal = Goal { levels: reference, most, seconds: total_s, caps_over_driven: 1.0, turn };
    let tilted: Vec<Option<StructureForces>> = made
        .par_iter()
        .map(|draft| {
            let Some(forces) = drafts.along_best(draft, &goal)? else { return Ok(None) };
            Ok(Some(draft.judged(case, &forces, total_s, Some(reference))?.forces))
        })
        .collect::<Result<_, PlanError>>()?;
    let least_unreached = made.iter().map(Draft::unreached).fold(f64::INFINITY, f64::min);
    let most_n = (1.0 + MORE_FORCE) * straight[best_straight].forces.peak_n;
    let keeps_peak = |forces: &StructureForces| forces.peak_n <= most_n;
    let does_any = tilted.iter().flatten().any(keeps_peak);
    let scores = tilted.iter().zip(&made).map(|(forces, draft)| {
        let forces = forces.as_ref().filter(|forces| !does_any || keeps_peak(forces))?;
        (draft.unreached() <= least_unreached + MORE_UNREACHED).then(|| forces.score(case))
    });
    let plan = candidates[first_clearly_best(scores)];
    Ok(ChosenLines { plan, straight: candidates[best_straight], drafts: listed(tilted) })
}

/// The first of scores that no other is clearly below.
fn first_clearly_best(scores: impl Iterator<Item = Option<f64>>) -> usize {
    let mut best: Option<(f64, usize)> = None;
    for (n, score) in scores.enumerate().filter_map(|(n, score)| Some((n, score?))) {
        if best.is_none_or(|(least, _)| score < least - CLEARLY) {
            best = Some((score, n));
        }
    }
    best.map_or(0, |(_, n)| n)
}

/// A draft along one candidate.
struct Draft {
    path: MillPath,
    length_mm: Vec<f64>,
    feeds: Vec<Option<Unit<Vector3<f64>>>>,
    near: Vec<Vec<NearStructure>>,
    moments: Vec<Moments>,
    /// With the shaft along the approach.
    straight: Vec<Option<EngagedForce>>,
    /// The directions that are free at each waypoint; none where the shaft stays straight.
    free: Option<FreeSets>,
}

/// A draft's forces in a time, the levels of its cuts faster than the least speed, and the largest pushes.
struct Judged {
    forces: StructureForces,
    levels: [Levels; 2],
}

/// What every draft of a case is made with.
struct Drafts<'a> {
    start: &'a Start<'a>,
    spec: ReachSpec<'a, 'a>,
    sampled: SampledForce,
}

impl<'a> Drafts<'a> {
    fn new(start: &'a Start<'a>, freedom: &'a ShaftFreedom) -> Result<Self, PlanError> {
        let (case, spec) = (start.case, freedom.reach_spec(start));
        Ok(Self { start, spec, sampled: SampledForce::new(case, SampledForce::LINES)? })
    }

    /// A draft along `raster`.
    fn draft(&self, raster: &Raster, tilts: bool) -> Result<Draft, PlanError> {
        let Start { case, scene, space, .. } = *self.start;
        let radius_mm = case.burr.radius_mm;
        let step_mm = (COARSER * self.spec.spacing.step_mm).min(radius_mm);
        let path = raster.lay(case, scene, space, PathSpacing { step_mm, ..self.spec.spacing })?;
        let points = &path.points;
        let free = tilts.then(|| {
            let access = Access::draft(scene, self.spec.solid, path.removal.time(), self.spec.shank);
            let limited = limited(points.len(), |i| points[i].kind == MoveKind::Cut);
            free_directions(&access, points, &limited, &self.spec)
        });
        let near = nearest_structures::along(case, scene, &path::centers(points))?;
        let moments =
            mass_increments_by_voxels(&scene.density_g_cm3, &path.removal, points, Ball { radius_mm });
        let (feeds, length_mm) = (feeds(points), lengths(points));
        let mut draft = Draft { length_mm, feeds, near, moments, straight: Vec::new(), free, path };
        draft.straight = self.forces(&draft, |_| Some(Vector3::z_axis()));
        Ok(draft)
    }

    /// Force of every waypoint that cuts, for its axis.
    fn forces(
        &self,
        draft: &Draft,
        axis: impl Fn(usize) -> Option<Unit<Vector3<f64>>> + Sync,
    ) -> Vec<Option<EngagedForce>> {
        let (sampled, swept) = (&self.sampled, self.swept(draft));
        let force = |samples: &mut EngagedSamples, i: usize| {
            let (feed, axis) = (draft.feeds[i].filter(|_| draft.moments[i].mass_mg() > 0.0)?, axis(i)?);
            let bone = swept.bone_at(i as u32, sampled.radius_mm(), |density| sampled.weight(density));
            sampled.gather(samples, &sampled.nominal(&feed), bone);
            Some(sampled.of(samples, &axis))
        };
        (0..draft.feeds.len()).into_par_iter().map_init(EngagedSamples::default, force).collect()
    }

    fn swept<'b>(&self, draft: &'b Draft) -> SweptPath<'b>
    where
        'a: 'b,
    {
        let ball = Ball { radius_mm: self.start.case.burr.radius_mm };
        SweptPath::new(self.start.scene, &draft.path.removal, &draft.path.points, ball)
    }

    /// The forces along the sequence of axes that takes the least time under the reference's levels; none where no sequence gets
    /// through.
    fn along_best(&self, draft: &Draft, goal: &Goal) -> Result<Option<Vec<Option<EngagedForce>>>, PlanError> {
        let Some(free) = &draft.free else { return Ok(None) };
        let case = self.start.case;
        let weighted = levels::weighted_at_ends(case, &draft.near)?;
        let times = LevelTimes::new(&case.speed, &weighted);
        let field = CostField {
            swept: &self.swept(draft),
            sampled: &self.sampled,
            objective: AxisObjective::Levels(times),
            moments: &draft.moments,
            feeds: &draft.feeds,
            compliance: None,
            finer_compliance: None,
        };
        // what no axis reaches is left out of the sequence
        let reached: Vec<usize> = (0..free.len()).filter(|i| free.count(*i) > 0).collect();
        let set = self.spec.directions;
        let Some(found) = best_under(&field, &times, goal, (set, free, &draft.length_mm), &reached) else {
            return Ok(None);
        };
        let mut axes = vec![None; free.len()];
        reached.iter().zip(found).for_each(|(i, n)| axes[*i] = Some(set.axes()[usize::from(n)]));
        Ok(Some(self.forces(draft, |i| axes[i])))
    }
}

impl Draft {
    /// Length of the moves on which there is a force, mm.
    fn cuts_mm(&self, forces: &[Option<EngagedForce>]) -> f64 {
        forces.iter().zip(&self.length_mm).filter(|(f, _)| f.is_some()).map(|(_, mm)| mm).sum()
    }

    /// Time of the other moves, s.
    fn links_s(&self, case: &Case, forces: &[Option<EngagedForce>]) -> f64 {
        (self.length_mm.iter().sum::<f64>() - self.cuts_mm(forces)) / case.speed.link_mm_s
    }

    /// Share of its length that no axis reaches.
    fn unreached(&self) -> f64 {
        let Some(free) = &self.free else { return 0.0 };
        let unreached: f64 = (0..free.len()).filter(|i| free.count(*i) == 0).map(|i| self.length_mm[i]).sum();
        unreached / self.length_mm.iter().sum::<f64>().max(f64::MIN_POSITIVE)
    }

    /// With the least levels of force, the whole in `total_s` or as near to it as it can; in the ratio of a reference's, if one is given.
    fn judged(
        &self,
        case: &Case,
        forces: &[Option<EngagedForce>],
        total_s: f64,
        reference: Option<Levels>,
    ) -> Result<Judged, PlanError> {
        let kind =
            |force: &Option<EngagedForce>| if force.is_some() { MoveKind::Cut } else { MoveKind::Link };
        let kinds: Vec<MoveKind> = forces.iter().map(kind).collect();
        let pushes = levels::pushes(case, &self.near, (forces, &[]), None)?;
        let moves = PushedMoves::new(case, (&kinds, &pushes), &self.length_mm, &pushes);
        let aim = Aim { total_s: None, reference, most_overall: None };
        let cutting_s = (total_s - self.links_s(case, forces)).max(1e-3);
        let found = speeds::caps(&moves.input(), Some(cutting_s), &aim)?;
        let caps = found.mm_s;
        let reached = levels::reached(&pushes, &caps);
        let seconds: Vec<f64> = self.length_mm.iter().zip(&caps).map(|(mm, v)| mm / v).collect();
        Ok(Judged {
            forces: StructureForces::at(
                case,
                (&self.length_mm, &seconds, &caps),
                |_, way| way,
                (forces, &[]),
                &self.near,
            ),
            levels: [found.levels.unwrap_or(reached), reached],
        })
    }
}

/// The centre of mass of the target's bone in the layers' plane; the target's centre where there is none.
fn mass_center(scene: &Scene) -> [f64; 2] {
    let grid = scene.class.grid();
    let [nx, ny, _] = grid.dims();
    let (mut mass, mut moment) = (0.0, [0.0; 2]);
    for (row, classes) in scene.class.data().chunks_exact(nx).enumerate() {
        if !classes.iter().any(|class| class.is(Class::TARGET_BONE)) {
            continue;
        }
        let start = grid.center([0, row % ny, row / ny]);
        for (i, _) in classes.iter().enumerate().filter(|(_, class)| class.is(Class::TARGET_BONE)) {
            let density = f64::from(scene.density_g_cm3.data()[row * nx + i]);
            mass += density;
            moment[0] += density * (start.x() + i as f64 * grid.spacing_mm().x);
            moment[1] += density * start.y();
        }
    }
    if mass > 0.0 { moment.map(|m| m / mass) } else { [scene.target_center.x(), scene.target_center.y()] }
}

/// Direction in the layer from the target's centre to the structure that is nearest less its clearance.
fn toward_structure(case: &Case, scene: &Scene) -> Result<Option<[f64; 2]>, PlanError> {
    let (clearances_mm, radius_mm) = (case.clearances_mm(), case.burr.radius_mm);
    let near = nearest_structures::nearest_structure(scene, &clearances_mm, radius_mm, scene.target_center)?;
    let toward: Option<Vector3<f64>> = near.map(|n| n.proximity.toward.into_inner());
    Ok(toward.map(|u| [u.x, u.y]))
}
