//! One plan of a case, beside what a straight shaft does in the same time.
//!
//! First the references: two controls give the total time, a straight shaft with the least force the levels. Then the lines, the axes
//! that fit the time at the lowest levels, the arm's motion and its speeds. A plan that pushes more than the straight shaft at any
//! judged figure keeps the shaft straight near structures, and if that is of no help everywhere: the straight shaft is always among the
//! candidates.

use bonemill_arm::Arm;
use bonemill_armpath::{ArmMotion, Placed};
use bonemill_case::{Case, ForceTerm, Objective, OrientationMode, Sense, SpeedMode};
use bonemill_geometry::{Base, Rigid, Work};
use bonemill_motion::resolve::Posture;
use bonemill_scene::Scene;
use bonemill_setup::{Setup, Stopwatch};
use bonemill_toolpath::access::ShankObstacles;
use bonemill_toolpath::orientation::TurnTime;
use bonemill_toolpath::path::RasterFrame;
use bonemill_toolpath::space::BurrSpace;

use super::PlanError;
use super::choose::{Choices, Chosen};
use super::compared::Compared;
use super::in_time::Goal;
use super::metrics::{self, Coverage};
use super::move_limits::MoveLimits;
use super::prepared::{Prepared, ShaftFreedom};
use super::raster::{self, ChosenLines, Raster};
use super::reference::{Reference, ReferencePath, Straight, StructureForces};
use super::speeds::{self, Aim, JointMotion, Timing};
use super::tilt;

/// An attempt may leave this share more of what the burr can reach than the one before.
const LEFT_SHARE: f64 = 0.005;

/// The share by which predicted and driven times may differ before the time of turns is corrected.
const AGREES_SHARE: f64 = 0.02;
/// Where turns keep nothing waiting, they count as this share of the time.
const LEAST_WAITS_SHARE: f64 = 0.02;

/// What every attempt at a case starts from.
#[derive(Debug, Clone, Copy)]
pub(super) struct Start<'a> {
    pub case: &'a Case,
    pub arm: &'a Arm,
    pub scene: &'a Scene,
    pub space: &'a BurrSpace<'a>,
    pub solid: &'a ShankObstacles,
    pub base_from_work: Rigid<Base, Work>,
}

/// A path with its axes, its motion and its speeds.
pub(super) struct Attempt<'a> {
    pub prepared: Prepared<'a>,
    pub chosen: Chosen,
    pub motion: ArmMotion,
    pub demand: MoveLimits,
    pub timing: Timing,
    pub coverage: Coverage,
    pub compared: Compared,
    /// How its axes were chosen.
    pub mode: OrientationMode,
    /// Why the shaft is straighter than the first choice of axes, in words; none for that choice.
    pub instead: Option<&'static str>,
}

/// The references of a case, and the time of the plan.
struct References {
    /// Lines along and across; without those that the arm cannot drive.
    controls: Vec<ReferencePath>,
    /// The shortest time of a control at the nominal speed, s.
    nominal_s: Option<f64>,
    /// Time of the plan, s: the case's, else the controls'.
    total_s: Option<f64>,
    /// The time of the first control at the nominal speed, s.
    first_s: Option<f64>,
    /// How long turns take in the posture of a control.
    turn: Option<TurnTime>,
}

impl References {
    /// The plan's time, or without one the controls', s.
    fn time_s(&self) -> Option<f64> {
        self.total_s.or(self.nominal_s)
    }
}

/// How the shaft is turned.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Turning {
    /// By the case's mode.
    Wherever,
    /// The same, but straight near structures.
    AwayFromStructures,
    /// Straight.
    Nowhere,
}

impl Turning {
    fn words(self) -> Option<&'static str> {
        match self {
            Self::Wherever => None,
            Self::AwayFromStructures => Some("the shaft stays straight near structures"),
            Self::Nowhere => Some("the shaft stays straight everywhere"),
        }
    }
}

impl<'a> Start<'a> {
    /// A setup, with its free space and what its shank may not touch.
    pub fn new(setup: &'a Setup, space: &'a BurrSpace<'a>, solid: &'a ShankObstacles) -> Self {
        let Setup { case, arm, scene, .. } = setup;
        Self { case, arm, scene, space, solid, base_from_work: setup.base_from_work() }
    }

    /// The arm where it stands, in a posture that the case allows.
    pub fn placed(&self) -> Placed<'_> {
        let posture = self.case.robot.branch.map_or(Posture::Any, Posture::Of);
        Placed { arm: self.arm, base_from_work: &self.base_from_work, posture }
    }

    /// A path along the lines that are chosen, with what is free on it.
    ///
    /// # Errors
    /// [`PlanError`] where nothing can be reached.
    pub fn prepared(&self, watch: &mut Stopwatch) -> Result<Prepared<'a>, PlanError> {
        let freedom = ShaftFreedom::new(self, watch);
        let frames = raster::frames(self.case, self.scene)?;
        let references = self.references(&frames, &freedom, watch)?;
        let lines = self.lines(&frames, &freedom, &references, watch)?;
        Prepared::new(self, &freedom, lines.plan, watch)
    }

    /// The plan with the least force in its time that is nowhere worse than a straight shaft.
    ///
    /// # Errors
    /// [`PlanError`] where nothing can be planned.
    pub fn plan(&self, watch: &mut Stopwatch) -> Result<Attempt<'a>, PlanError> {
        let case = self.case;
        let freedom = ShaftFreedom::new(self, watch);
        let frames = raster::frames(case, self.scene)?;
        let references = self.references(&frames, &freedom, watch)?;
        let lines = self.lines(&frames, &freedom, &references, watch)?;
        let most = watch.run("references", || self.most_overall(&references))?;
        let straight = watch.run("references", || self.straight(&references, lines.straight, most))?;
        let total_s = references.total_s;
        let aim = Aim { total_s, reference: None, most_overall: total_s.and(most) };
        // figures are forces: they do not judge a plan that lowers deflections
        let is_open = case.cost.force == ForceTerm::Cutting
            && case.orientation.mode == OrientationMode::Optimal
            && case.cost.objective == Objective::Levels;
        let attempt = |raster: Raster, turning: Turning, watch: &mut Stopwatch| {
            let goal = self.goal(&references, straight.as_ref(), turning);
            let prepared = Prepared::new(self, &freedom, raster, watch)?;
            self.attempt(prepared, (turning, goal), (aim, straight.as_ref()), watch)
        };
        let mut best = attempt(lines.plan, Turning::Wherever, watch)?;
        if is_open
            && !best.is_nowhere_worse_than_straight()
            && let Ok(fallback) = attempt(lines.straight, Turning::Nowhere, watch)
        {
            best = best.or_straighter(fallback, || attempt(lines.plan, Turning::AwayFromStructures, watch));
        }
        best.compared.controls =
            watch.run("references", || self.controls_in(&references, best.timing.driven.law.duration_s()))?;
        Ok(best)
    }

    /// The controls along each of `frames` and, of one alone, across it, and the times that follow from them.
    fn references(
        &self,
        frames: &[RasterFrame],
        freedom: &ShaftFreedom,
        watch: &mut Stopwatch,
    ) -> Result<References, PlanError> {
        let case = self.case;
        let frames = match *frames {
            [only] => vec![only, only.across()],
            _ => frames.to_vec(),
        };
        let path =
            |frame: &RasterFrame| ReferencePath::new(self, Raster { frame: *frame, sense: Sense::Both });
        let made = watch.run("references", || {
            let (first, second) = rayon::join(|| path(&frames[0]), || path(&frames[1]));
            [first, second]
        });
        let mut controls = Vec::new();
        for made in made {
            controls.extend(made?);
        }
        let nominal: Vec<f64> = controls.iter().map(|c| c.nominal_s(self)).collect::<Result<_, _>>()?;
        let nominal_s = nominal.iter().copied().min_by(f64::total_cmp);
        let of_mode = nominal_s.filter(|_| case.speed.mode == SpeedMode::LeastForce);
        let turn = controls.first().and_then(|control| {
            let (dof, q) = (self.arm.dof(), &control.motion.resolved.q);
            let middle = q.chunks_exact(dof).nth(q.len() / dof / 2)?;
            tilt::turn_time(self.arm, middle, &self.base_from_work, freedom.family.as_ref())
        });
        let (total_s, first_s) = (case.speed.total_time_s.or(of_mode), nominal.first().copied());
        Ok(References { controls, nominal_s, total_s, first_s, turn })
    }

    /// The lines for the plan and for a straight shaft, chosen in drafts.
    fn lines(
        &self,
        frames: &[RasterFrame],
        freedom: &ShaftFreedom,
        references: &References,
        watch: &mut Stopwatch,
    ) -> Result<ChosenLines, PlanError> {
        // drafts are timed without the arm: by how much the plan takes longer or less than the first control
        let times_s = references.time_s().zip(references.first_s);
        let time_share = times_s.map_or(1.0, |(total_s, first_s)| total_s / first_s);
        watch.run("lines", || raster::chosen(self, freedom, frames, (time_share, references.turn)))
    }

    /// The straight shaft with the least force, in the plan's time; `None` where the arm cannot drive it.
    fn straight(
        &self,
        references: &References,
        raster: Raster,
        most: Option<f64>,
    ) -> Result<Option<Straight>, PlanError> {
        let Some(total_s) = references.time_s() else { return Ok(None) };
        let known = references.controls.iter().find(|control| control.raster == raster);
        if let Some(path) = known {
            return path.least_force(self, total_s, most).map(Some);
        }
        ReferencePath::new(self, raster)?.map(|path| path.least_force(self, total_s, most)).transpose()
    }

    /// The largest force of the controls in the plan's time, N: no cut pushes more even in a plan that cannot be driven in the time.
    fn most_overall(&self, references: &References) -> Result<Option<f64>, PlanError> {
        let time_s = references.time_s().filter(|_| self.case.cost.force == ForceTerm::Cutting);
        let Some(time_s) = time_s else { return Ok(None) };
        let controls = self.controls_in(references, time_s)?;
        Ok(controls.iter().map(|control| control.forces.peak_n).max_by(f64::total_cmp))
    }

    fn controls_in(&self, references: &References, total_s: f64) -> Result<Vec<Reference>, PlanError> {
        references.controls.iter().map(|control| control.in_time(self, total_s)).collect()
    }

    /// What axes are chosen for; `None` by Dillon's cost, and where the arm cannot drive a straight shaft.
    fn goal(&self, references: &References, straight: Option<&Straight>, turning: Turning) -> Option<Goal> {
        let (straight, turn) = (straight?, references.turn?);
        (self.case.cost.objective == Objective::Levels).then(|| Goal {
            levels: straight.levels[0],
            most: straight.levels[1],
            seconds: straight.reference.total_time_s * straight.caps_over_driven,
            caps_over_driven: straight.caps_over_driven,
            turn,
            keeps_straight_near: turning == Turning::AwayFromStructures,
        })
    }

    /// A goal with the time of turns corrected by what the arm drives; none where both agree.
    fn corrected(
        &self,
        prepared: &Prepared,
        choices: &Choices,
        chosen: &Chosen,
        motion: &ArmMotion,
    ) -> Result<Option<Goal>, PlanError> {
        let (Some(goal), Some(predicted)) = (choices.goal, chosen.oriented.predicted) else {
            return Ok(None);
        };
        let mut by_levels = choices.clone();
        by_levels.speed.mode = SpeedMode::LeastForce;
        let demand = prepared.demand(&by_levels, chosen)?;
        let joints = JointMotion::new(motion, self.arm)?;
        let driven_s =
            speeds::under_levels_s(&demand.input(prepared, &by_levels, chosen), &joints, &predicted.levels)?;
        // as the straight shaft drives it
        let expected_s = predicted.seconds / goal.caps_over_driven;
        let more_s = (driven_s - expected_s) * goal.caps_over_driven;
        if (driven_s / expected_s - 1.0).abs() <= AGREES_SHARE {
            return Ok(None);
        }
        let least_s = LEAST_WAITS_SHARE * predicted.seconds;
        let factor = goal.turn.factor
            * ((predicted.waits_s + more_s) / predicted.waits_s.max(least_s)).clamp(0.5, 2.5);
        Ok(Some(Goal { turn: TurnTime { factor, ..goal.turn }, ..goal }))
    }

    /// Axes, motion and speeds for a path.
    fn attempt(
        &self,
        mut prepared: Prepared<'a>,
        (turning, goal): (Turning, Option<Goal>),
        (aim, straight): (Aim, Option<&Straight>),
        watch: &mut Stopwatch,
    ) -> Result<Attempt<'a>, PlanError> {
        let case = self.case;
        let mode = if turning == Turning::Nowhere { OrientationMode::Fixed } else { case.orientation.mode };
        let mut choices = Choices { mode, goal, ..Choices::of(case) };
        let is_tilted = mode == OrientationMode::Optimal && goal.is_some();
        let (mut chosen, mut motion) = prepared.choose_with_motion(&choices, watch)?;
        if is_tilted && let Some(corrected) = self.corrected(&prepared, &choices, &chosen, &motion)? {
            choices.goal = Some(corrected);
            (chosen, motion) = prepared.choose_with_motion(&choices, watch)?;
        }
        watch.run("forces", || prepared.look_within(&choices, &mut chosen, &motion))?;
        if is_tilted && let Some(straight) = straight {
            let hot = prepared.hotter(&choices, &chosen, &straight.levels[1])?;
            if !hot.is_empty() {
                choices.straight_at = hot;
                (chosen, motion) = prepared.choose_with_motion(&choices, watch)?;
                watch.run("forces", || prepared.look_within(&choices, &mut chosen, &motion))?;
            }
        }
        let joints = JointMotion::new(&motion, self.arm)?;
        let demand = prepared.demand(&choices, &chosen)?;
        let reference = straight.filter(|_| is_tilted).map(|straight| straight.levels[0]);
        let aim = Aim { reference, ..aim };
        let speed_input = demand.input(&prepared, &choices, &chosen);
        let reached = &prepared.reached;
        let (timing, coverage) = watch.run("time law, coverage", || {
            rayon::join(
                || speeds::timing(&speed_input, &joints, &aim),
                || {
                    let (path, dropped) = (&reached.path, &reached.dropped);
                    metrics::coverage(self.scene, self.space, &path.removal, &path.points, dropped)
                },
            )
        });
        let (timing, coverage) = (timing?, coverage?);
        drop(joints);
        // refused here, before anything is written
        timing.driven.law.rows(case.robot.rate_hz)?;
        let plan = StructureForces::of(
            case,
            prepared.length_mm(),
            &timing.driven,
            (&chosen.forces, &chosen.within),
            &prepared.near,
        );
        let straight = straight.map(|straight| straight.reference.clone());
        let compared = Compared { controls: Vec::new(), straight, plan };
        Ok(Attempt {
            prepared,
            chosen,
            motion,
            demand,
            timing,
            coverage,
            compared,
            mode,
            instead: turning.words(),
        })
    }
}

impl Attempt<'_> {
    /// This attempt, unless it pushes more than `fallback`, whose shaft is straight everywhere: then `away`, where that pushes no more,
    /// else the fallback. Neither replaces an attempt that mills or keeps more than it does.
    ///
    /// The shank of the reference is not tested, so what the fallback can do takes its place.
    fn or_straighter(mut self, mut fallback: Self, away: impl FnOnce() -> Result<Self, PlanError>) -> Self {
        let tested = Reference {
            raster: fallback.prepared.raster(),
            speed_mm_s: None,
            total_time_s: fallback.timing.driven.law.duration_s(),
            forces: fallback.compared.plan.clone(),
        };
        self.compared.straight = Some(tested.clone());
        if self.is_nowhere_worse_than_straight() {
            return self;
        }
        if let Ok(mut away) = away() {
            away.compared.straight = Some(tested.clone());
            if away.is_nowhere_worse_than_straight() && away.keeps_what(&self) {
                return away;
            }
        }
        fallback.compared.straight = Some(tested);
        if fallback.keeps_what(&self) { fallback } else { self }
    }

    /// Whether it leaves at most [`LEFT_SHARE`] more than another, and misses no time, cap or turn that the other meets.
    pub fn keeps_what(&self, other: &Self) -> bool {
        let misses = |of: &Self| {
            let caps = of.demand.caps_missed(of.prepared.start.case, &of.prepared, &of.chosen);
            [of.timing.missed.is_some(), caps.is_some()]
        };
        self.coverage.reached_share() >= other.coverage.reached_share() - LEFT_SHARE
            && self.chosen.oriented.blocked_turns.len() <= other.chosen.oriented.blocked_turns.len()
            && misses(self).iter().zip(misses(other)).all(|(ours, theirs)| !ours || theirs)
    }

    /// Whether no judged figure is above the straight shaft's with the least force.
    fn is_nowhere_worse_than_straight(&self) -> bool {
        let case = self.prepared.start.case;
        let straight = self.compared.straight.as_ref();
        straight.is_none_or(|straight| self.compared.plan.is_nowhere_worse(case, &straight.forces))
    }

    /// Whether it pushes more than its controls toward a structure of the highest priority.
    pub fn is_worse_than_controls(&self) -> bool {
        !self.compared.worse(self.prepared.start.case).is_empty()
    }

    /// Score of the forces toward structures: see [`StructureForces::score`].
    pub fn score(&self) -> f64 {
        self.compared.plan.score(self.prepared.start.case)
    }
}
