//! One plan of a case, beside what a straight shaft does in the same time.
//!
//! First the references: two controls give the total time, a straight shaft with the least force the levels. Then the lines, the axes
//! that fit the time at the lowest levels, the arm's motion and its speeds. Cuts that push toward a structure even at the least speed are
//! put off to the end, when the bone around them is gone. Near structures no figure may be above those of the
//! references ([`super::bounds`]).

use std::collections::BTreeMap;

use bonemill_case::{ForceTerm, Objective, OrientationMode, Sense, SpeedMode};
use bonemill_cutting::speed::Levels;
use bonemill_setup::Stopwatch;
use bonemill_setup::armpath::ArmMotion;
use bonemill_toolpath::orientation::TurnTime;
use bonemill_toolpath::path::RasterFrame;

use super::PlanError;
use super::bounds::Bounds;
use super::choose::{Choices, Chosen};
use super::compared::Compared;
use super::in_time::Goal;
use super::laid::Raster;
use super::metrics::{self, Coverage};
use super::move_limits::MoveLimits;
use super::prepared::{Prepared, ShaftFreedom};
use super::raster::{self, ChosenLines, LinesDraft};
use super::reference::{Reference, ReferencePath, Straight, StructureForces};
use super::speeds::{self, Aim, JointMotion, SpeedInput, Timing};
use super::start::Start;
use super::tilt;

/// An attempt may leave this share more of what the burr can reach than the one before.
const LEFT_SHARE: f64 = 0.005;

/// The share by which the driven time may be above the total time under the reference's levels.
const OVER_SHARE: f64 = 2e-3;
/// The share by which the driven time may be less than predicted before turns are made cheaper.
const AGREES_SHARE: f64 = 0.02;
/// Where turns keep nothing waiting, they count as this share of the time.
const LEAST_WAITS_SHARE: f64 = 0.02;

/// How often axes are chosen at most, with the time of turns corrected and with those kept that push least: once or twice for most bodies; the most where
/// the turns of a small one take far longer than predicted.
const MOST_ROUNDS: usize = 5;
/// How often cuts near structures are put off.
const MOST_PUT_OFF: usize = 2;
/// How often the cuts near structures are slowed, and the least gain for which they are, as a logarithm of figures.
const MOST_EASED: usize = 3;
const GAINS: f64 = 0.01;
/// By how much figures of a plan that meets its time may be above those of one that does not, as a logarithm of figures: twice.
const MORE_IN_TIME: f64 = std::f64::consts::LN_2;

/// A path with its axes, its motion and its speeds.
pub(super) struct Attempt<'a> {
    pub prepared: Prepared<'a>,
    pub chosen: Chosen,
    pub motion: ArmMotion,
    pub demand: MoveLimits,
    pub timing: Timing,
    pub coverage: Coverage,
    pub compared: Compared,
    /// How far figures near structures are above their bounds: [`Bounds::excess`].
    pub excess: f64,
    /// What its lines were chosen from.
    pub drafts: Vec<LinesDraft>,
    /// How its axes were chosen.
    pub mode: OrientationMode,
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

/// What an attempt aims at.
struct Asked {
    /// Time of the plan, s, if it is to be met.
    total_s: Option<f64>,
    straight: Option<Straight>,
    /// See [`Start::most_overall`].
    most_overall: Option<f64>,
    goal: Option<Goal>,
    bounds: Option<Bounds>,
}

/// A path, and its axes and motion where they were chosen already.
struct Begun<'a> {
    prepared: Prepared<'a>,
    first: Option<(Chosen, ArmMotion)>,
}

impl<'a> Start<'a> {
    /// A path along the lines that are chosen, with what is free on it.
    ///
    /// # Errors
    /// [`PlanError`] where nothing can be reached.
    pub fn prepared(&self, watch: &mut Stopwatch) -> Result<Prepared<'a>, PlanError> {
        let freedom = ShaftFreedom::new(self, watch);
        let frames = raster::frames(self.case, self.scene)?;
        let references = self.references(&frames, &freedom, watch)?;
        let lines = self.lines(&frames, &freedom, &references, watch)?;
        Prepared::new(self, &freedom, lines.plan, None, watch)
    }

    /// The plan with the least force in its time.
    ///
    /// # Errors
    /// [`PlanError`] where nothing can be planned.
    pub fn plan(&self, watch: &mut Stopwatch) -> Result<Attempt<'a>, PlanError> {
        let freedom = ShaftFreedom::new(self, watch);
        let frames = raster::frames(self.case, self.scene)?;
        let references = self.references(&frames, &freedom, watch)?;
        let lines = self.lines(&frames, &freedom, &references, watch)?;
        let (controls, straight) = watch.run("references", || {
            let controls = references.time_s().map(|time_s| self.controls_in(&references, time_s));
            let controls = controls.transpose()?.unwrap_or_default();
            let straight = self.straight(&references, lines.straight, self.most_overall(&controls))?;
            Ok::<_, PlanError>((controls, straight))
        })?;
        let asked = self.asked(&references, straight, &controls);
        let prepared = Prepared::new(self, &freedom, lines.plan, None, watch)?;
        let (begun, plain) = self.put_off(prepared, &freedom, &asked, watch)?;
        let mut attempt = self.attempt(begun, &asked, watch)?;
        // many cuts along a whole wall push less where they stand, and the way back to them may take too long
        let is_short = attempt.timing.missed.is_some() || attempt.excess > GAINS;
        if let Some(plain) = plain.filter(|_| is_short) {
            match self.attempt(plain, &asked, watch) {
                Ok(plain) if plain.is_better_than_put_off(&attempt) => attempt = plain,
                Err(error) if !error.is_infeasible() => return Err(error),
                _ => {}
            }
        }
        let takes_s = attempt.timing.driven.law.duration_s();
        attempt.drafts = lines.drafts;
        attempt.compared.controls = if controls.iter().all(|control| control.takes(takes_s)) {
            controls
        } else {
            watch.run("references", || self.controls_in(&references, takes_s))?
        };
        Ok(attempt)
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

    /// The largest force of the better control in the plan's time, N: no cut pushes more even in a plan that cannot be driven in the time.
    fn most_overall(&self, controls: &[Reference]) -> Option<f64> {
        let peaks = controls.iter().map(|control| control.forces.peak_n);
        peaks.filter(|_| self.case.cost.force == ForceTerm::Cutting).min_by(f64::total_cmp)
    }

    fn controls_in(&self, references: &References, total_s: f64) -> Result<Vec<Reference>, PlanError> {
        references.controls.iter().map(|control| control.in_time(self, total_s)).collect()
    }

    /// What axes are chosen for; `None` by Dillon's cost, and where the arm cannot drive a straight shaft.
    fn goal(&self, references: &References, straight: Option<&Straight>) -> Option<Goal> {
        let (straight, turn) = (straight?, references.turn?);
        (self.case.cost.objective == Objective::Levels).then(|| Goal {
            levels: straight.levels[0],
            most: straight.levels[1],
            seconds: straight.reference.total_time_s * straight.caps_over_driven,
            caps_over_driven: straight.caps_over_driven,
            turn,
        })
    }

    /// How long the arm needs under the reference's levels, s, and the goal with the time of turns corrected: turns are dearer where that is
    /// more than the total time, and cheaper where the arm needs less than predicted under the levels that were found; none elsewhere.
    fn corrected(
        &self,
        prepared: &Prepared,
        choices: &Choices,
        chosen: &Chosen,
        motion: &ArmMotion,
    ) -> Result<(f64, Option<Goal>), PlanError> {
        let (Some(goal), Some(predicted)) = (choices.goal, chosen.oriented.predicted) else {
            return Ok((0.0, None));
        };
        let mut by_levels = choices.clone();
        by_levels.speed.mode = SpeedMode::LeastForce;
        let demand = prepared.demand(&by_levels, chosen)?;
        let input = demand.input(prepared, &by_levels, chosen);
        let joints = JointMotion::new(motion, self.arm)?;
        let driven_s = |levels: &Levels| speeds::under_levels_s(&input, &joints, levels);
        // as the straight shaft drives it
        let [expected_s, total_s] = [predicted.seconds, goal.seconds].map(|s| s / goal.caps_over_driven);
        let reference_s = driven_s(&goal.levels(1.0).levels)?;
        let more_s = if reference_s > total_s * (1.0 + OVER_SHARE) {
            reference_s - total_s
        } else {
            (driven_s(&predicted.levels)? - expected_s).min(0.0)
        };
        if more_s > -AGREES_SHARE * expected_s && more_s <= 0.0 {
            return Ok((reference_s, None));
        }
        let waits_s = predicted.waits_s + more_s * goal.caps_over_driven;
        let least_s = LEAST_WAITS_SHARE * predicted.seconds;
        let factor = goal.turn.factor * (waits_s / predicted.waits_s.max(least_s)).clamp(0.5, 2.5);
        Ok((reference_s, Some(Goal { turn: TurnTime { factor, ..goal.turn }, ..goal })))
    }

    /// What attempts aim at, beside the references in the plan's time.
    fn asked(&self, references: &References, straight: Option<Straight>, controls: &[Reference]) -> Asked {
        let is_optimal = self.case.orientation.mode == OrientationMode::Optimal;
        let goal = self.goal(references, straight.as_ref()).filter(|_| is_optimal);
        // figures are forces: they bound no plan that lowers deflections
        let bounds =
            straight.as_ref().filter(|_| goal.is_some() && self.case.cost.force == ForceTerm::Cutting);
        Asked {
            total_s: references.total_s,
            bounds: bounds.map(|straight| Bounds::of(self.case, &straight.reference.forces, controls)),
            most_overall: self.most_overall(controls),
            straight,
            goal,
        }
    }

    /// Axes, motion and speeds for a path.
    fn attempt(
        &self,
        begun: Begun<'a>,
        asked: &Asked,
        watch: &mut Stopwatch,
    ) -> Result<Attempt<'a>, PlanError> {
        let (case, mode, bounds) = (self.case, self.case.orientation.mode, asked.bounds.as_ref());
        let Begun { mut prepared, first } = begun;
        let (choices, chosen, motion) = self.axes((&mut prepared, first), asked, watch)?;
        let demand = prepared.demand(&choices, &chosen)?;
        let straight = asked.straight.as_ref().filter(|_| asked.goal.is_some());
        let aim = Aim {
            total_s: asked.total_s,
            reference: straight.map(|straight| straight.levels[0]),
            most_overall: asked.total_s.and(asked.most_overall),
        };
        let speed_input = demand.input(&prepared, &choices, &chosen);
        let (reached, joints) = (&prepared.reached, JointMotion::new(&motion, self.arm)?);
        let (timing, coverage) = watch.run("time law, coverage", || {
            rayon::join(
                || self.timed(&prepared, &chosen, (&speed_input, &joints, &aim), bounds),
                || {
                    let (path, dropped) = (&reached.path, &reached.dropped);
                    metrics::coverage(self.scene, self.space, &path.removal, &path.points, dropped)
                },
            )
        });
        let ((timing, plan), coverage) = (timing?, coverage?);
        drop(joints);
        // refused here, before anything is written
        timing.driven.law.rows(case.robot.rate_hz)?;
        let excess = bounds.map_or(0.0, |bounds| bounds.excess(&plan));
        let straight = asked.straight.as_ref().map(|straight| straight.reference.clone());
        let compared = Compared { controls: Vec::new(), straight, plan };
        let drafts = Vec::new();
        Ok(Attempt { prepared, chosen, motion, demand, timing, coverage, compared, excess, drafts, mode })
    }

    /// Puts cuts that push toward a structure off to the end, when the bone around them is gone, as long as that lowers what they push;
    /// gives the path with them put off, and the plain one where that is another.
    fn put_off(
        &self,
        prepared: Prepared<'a>,
        freedom: &ShaftFreedom,
        asked: &Asked,
        watch: &mut Stopwatch,
    ) -> Result<(Begun<'a>, Option<Begun<'a>>), PlanError> {
        if asked.bounds.is_none() || self.case.speed.mode != SpeedMode::LeastForce {
            return Ok((Begun { prepared, first: None }, None));
        }
        let choices = Choices { goal: asked.goal, ..Choices::of(self.case) };
        let begin = |mut prepared: Prepared<'a>, watch: &mut Stopwatch| {
            let first = prepared.choose_driven(&choices, watch)?;
            let pushing = prepared.pushing(&first.0);
            Ok::<_, PlanError>((Begun { prepared, first: Some(first) }, pushing))
        };
        let (mut begun, mut pushing) = begin(prepared, watch)?;
        let mut plain = None;
        for _ in 0..MOST_PUT_OFF {
            if pushing.points.is_empty() {
                break;
            }
            let before = &begun.prepared;
            let later = Some((&before.reached, &pushing.points));
            let later = Prepared::new(self, freedom, before.raster(), later, watch)
                .and_then(|later| begin(later, watch));
            let (later, still) = match later {
                Err(error) if error.is_infeasible() => break,
                later => later?,
            };
            let leaves_more = later.prepared.reached.dropped.len() > before.reached.dropped.len();
            if leaves_more || still.sum_n >= pushing.sum_n {
                break;
            }
            pushing = still;
            let before = std::mem::replace(&mut begun, later);
            plain.get_or_insert(before);
        }
        Ok((begun, plain))
    }

    /// Axes for a goal, and the motion through them; with the time of turns as the arm drives them, and within bounds as far as axes are of
    /// help. `first`: those that were chosen already.
    fn axes(
        &self,
        (prepared, mut first): (&mut Prepared<'a>, Option<(Chosen, ArmMotion)>),
        asked: &Asked,
        watch: &mut Stopwatch,
    ) -> Result<(Choices, Chosen, ArmMotion), PlanError> {
        let bounds = asked.bounds.as_ref();
        let mut choices = Choices { goal: asked.goal, ..Choices::of(self.case) };
        // of the rounds with the most kept axes, the one that needs the least time under the reference's levels
        let mut best: Option<(usize, f64, Chosen, ArmMotion)> = None;
        for round in 1..=MOST_ROUNDS {
            let (chosen, motion) = match first.take() {
                Some(found) => found,
                None => prepared.choose_driven(&choices, watch)?,
            };
            let (needs_s, corrected) = self.corrected(prepared, &choices, &chosen, &motion)?;
            // after the last round nothing is chosen again
            let kept = match bounds.filter(|_| round < MOST_ROUNDS) {
                Some(bounds) => {
                    watch.run("forces", || prepared.gentlest(&choices, &chosen, &motion, bounds))?
                }
                None => BTreeMap::new(),
            };
            let before = choices.kept.len();
            for (i, axis) in kept {
                choices.kept.entry(i).or_insert(axis);
            }
            if best.as_ref().is_none_or(|(kept, least_s, ..)| before > *kept || needs_s < *least_s) {
                best = Some((before, needs_s, chosen, motion));
            }
            if corrected.is_none() && choices.kept.len() == before {
                break;
            }
            choices.goal = corrected.or(choices.goal);
        }
        // the loop runs at least once
        let (mut chosen, motion) = match best {
            Some((.., chosen, motion)) => (chosen, motion),
            None => prepared.choose_driven(&choices, watch)?,
        };
        watch.run("forces", || prepared.look_exactly(&mut choices, &mut chosen, &motion))?;
        Ok((choices, chosen, motion))
    }

    /// Speeds for an aim, and the forces at them; within bounds as far as slower cuts near structures are of help.
    fn timed(
        &self,
        prepared: &Prepared,
        chosen: &Chosen,
        (input, joints, aim): (&SpeedInput, &JointMotion, &Aim),
        bounds: Option<&Bounds>,
    ) -> Result<(Timing, StructureForces), PlanError> {
        let timed = |input: &SpeedInput| {
            let timing = speeds::timing(input, joints, aim)?;
            let moves = (&chosen.forces[..], &chosen.within[..]);
            let forces =
                StructureForces::of(self.case, prepared.length_mm(), &timing.driven, moves, &prepared.near);
            Ok::<_, PlanError>((timing, forces))
        };
        let (mut timing, mut forces) = timed(input)?;
        let bounds = bounds.filter(|_| self.case.speed.mode == SpeedMode::LeastForce);
        let mut caps_mm_s = input.force_cap_mm_s.to_vec();
        for bounds in std::iter::repeat_n(bounds, MOST_EASED).flatten() {
            let speeds = (&timing.driven.driven_mm_s[..], &caps_mm_s[..]);
            let Some(eased) = prepared.eased(chosen, &forces, bounds, speeds) else { break };
            let (slower, found) = timed(&SpeedInput { force_cap_mm_s: &eased, ..*input })?;
            let is_gain = bounds.excess(&found) < bounds.excess(&forces) - GAINS;
            if !is_gain
                || !bounds.keeps_whole(&found, &forces)
                || slower.missed.is_some() && timing.missed.is_none()
            {
                break;
            }
            (timing, forces, caps_mm_s) = (slower, found, eased);
        }
        Ok((timing, forces))
    }
}

impl Attempt<'_> {
    /// Whether it leaves at most [`LEFT_SHARE`] more than another, and misses no time, cap or turn that the other meets.
    pub fn keeps_what(&self, other: &Self) -> bool {
        let misses = |of: &Self| {
            let caps = of.demand.caps_missed(of.prepared.start.case, &of.prepared, &of.chosen);
            [of.timing.missed.is_some(), !caps.is_empty()]
        };
        self.coverage.reached_share() >= other.coverage.reached_share() - LEFT_SHARE
            && self.chosen.oriented.blocked_turns.len() <= other.chosen.oriented.blocked_turns.len()
            && misses(self).iter().zip(misses(other)).all(|(ours, theirs)| !ours || theirs)
    }

    /// Whether it stands in place of another whose cuts are put off: it pushes less, or it alone meets the time and pushes hardly more.
    fn is_better_than_put_off(&self, other: &Self) -> bool {
        let is_in_time = self.timing.missed.is_none() && other.timing.missed.is_some();
        let room = if is_in_time { MORE_IN_TIME } else { 0.0 };
        self.excess < other.excess + room && self.keeps_what(other)
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
