//! Speed caps per move by the case's mode, and the motion under them.

use std::ops::Range;

use bonemill_arm::Arm;
use bonemill_case::{Case, SpeedMode, SpeedSpec};
use bonemill_cutting::cutter::MoveKind;
use bonemill_cutting::speed::{
    CutMoves, CutPushes, Levels, SLOWEST_SKIN, Smoothing, SpeedModel, TimeLimit, last_within, least_along,
    least_levels,
};
use bonemill_robot::resolve::DensePath;
use bonemill_robot::timelaw::{JointPath, PreparedPath, TimeLaw};
use bonemill_setup::armpath::{ArmMotion, path_limits};

use super::PlanError;
use super::in_time::NOTHING_SHARE;

/// Share of a full slot's mass per step at or below which a waypoint counts as air. D13 takes a mean of 1/m: the crumbs of
/// finishing passes would otherwise set the speed of the whole plan.
const AIR_SHARE: f64 = 0.02;
/// Largest number of time laws computed to meet a total time on one way between speeds, besides those that look for a bracket.
const TIME_EVALUATIONS: u32 = 60;
/// How exactly a total time is met, s: from below, where it is not an end of the range.
const TIME_TOLERANCE_S: f64 = 5e-3;
/// A cap is at most this many times the speed that is driven.
const CAP_OVER_DRIVEN: f64 = 1.02;

/// What speeds depend on; one entry per waypoint each.
#[derive(Debug, Clone, Copy)]
pub struct SpeedInput<'a> {
    /// What each move is for.
    pub kinds: &'a [MoveKind],
    /// Length of the move that ends here, mm.
    pub length_mm: &'a [f64],
    /// Mass ahead, mg.
    pub mass_mg: &'a [f64],
    /// Slowest that it may be, mm/s.
    pub slowest_mm_s: &'a [f64],
    /// Cost C.
    pub cost: &'a [f64],
    /// Fastest speed that the case's caps on force, deflection and power allow, mm/s; infinite where none binds.
    pub force_cap_mm_s: &'a [f64],
    /// What pushes the burr where something is cut; empty unless the mode is [`SpeedMode::LeastForce`].
    pub pushes: &'a [Option<CutPushes>],
    /// Nominal distance of cutting waypoints, mm.
    pub step_mm: f64,
    /// Mass that a step takes in a full slot of the reference material, mg.
    pub slot_mass_mg: f64,
    /// Speed range and law.
    pub spec: &'a SpeedSpec,
    /// How D13's speeds are smoothed.
    pub smoothing: Smoothing,
}

/// What speeds with the least force depend on where no mass, cost or cap enters; one entry per waypoint each.
#[derive(Debug)]
pub struct PushedMoves<'a> {
    kinds: &'a [MoveKind],
    length_mm: &'a [f64],
    pushes: &'a [Option<CutPushes>],
    step_mm: f64,
    spec: SpeedSpec,
    smoothing: Smoothing,
    none: Vec<f64>,
    slowest_mm_s: Vec<f64>,
    uncapped_mm_s: Vec<f64>,
}

impl<'a> PushedMoves<'a> {
    /// Of moves of a case; `ends`: what those have that are to remove something.
    pub fn new<T>(
        case: &Case,
        (kinds, ends): (&'a [MoveKind], &[Option<T>]),
        length_mm: &'a [f64],
        pushes: &'a [Option<CutPushes>],
    ) -> Self {
        let moves = kinds.iter().zip(ends);
        Self {
            kinds,
            length_mm,
            pushes,
            step_mm: case.path.step_mm,
            spec: SpeedSpec { mode: SpeedMode::LeastForce, ..case.speed.clone() },
            smoothing: smoothing(case),
            none: vec![0.0; kinds.len()],
            slowest_mm_s: moves.map(|(kind, end)| slowest_mm_s(&case.speed, *kind, end.is_some())).collect(),
            uncapped_mm_s: vec![f64::INFINITY; kinds.len()],
        }
    }

    /// For [`timing`] and [`caps`].
    pub fn input(&self) -> SpeedInput<'_> {
        SpeedInput {
            kinds: self.kinds,
            length_mm: self.length_mm,
            mass_mg: &self.none,
            slowest_mm_s: &self.slowest_mm_s,
            cost: &self.none,
            force_cap_mm_s: &self.uncapped_mm_s,
            pushes: self.pushes,
            step_mm: self.step_mm,
            slot_mass_mg: 0.0,
            spec: &self.spec,
            smoothing: self.smoothing,
        }
    }
}

/// The slowest that a move may be, mm/s: one that is to remove nothing is slow only where it meets a skin, or bone between voxels.
pub(super) fn slowest_mm_s(spec: &SpeedSpec, kind: MoveKind, removes: bool) -> f64 {
    spec.min_mm_s * if kind == MoveKind::Cut && removes { 1.0 } else { SLOWEST_SKIN }
}

/// The time and the levels that speeds aim at.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Aim {
    /// Time of the whole plan, s, when it is to be met.
    pub total_s: Option<f64>,
    /// Levels of a reference: with [`SpeedMode::LeastForce`] both are lowered in its ratio; without, L_o comes first.
    pub reference: Option<Levels>,
    /// Push in any direction that no cut exceeds even where the time cannot be met.
    pub most_overall: Option<f64>,
}

/// A path whose joints are known, ready to be timed with any caps.
#[derive(Debug)]
pub struct JointMotion<'a> {
    dense: &'a DensePath,
    prepared: PreparedPath,
}

/// A motion, and when and how fast it passes the waypoints.
#[derive(Debug, Clone)]
pub struct Driven {
    /// The motion.
    pub law: TimeLaw,
    /// When each waypoint is passed, s.
    pub times_s: Vec<f64>,
    /// Greatest speed within the move that ends at each waypoint, mm/s.
    pub driven_mm_s: Vec<f64>,
    /// Each waypoint's place in the law's path, which has places between waypoints too.
    places: Vec<usize>,
}

/// Caps and the law under them.
#[derive(Debug, Clone)]
pub struct Timing {
    /// Speed cap of the move that ends at each waypoint, mm/s: hardly more than what is driven.
    pub caps_mm_s: Vec<f64>,
    /// The caps before those that the arm does not reach were lowered, mm/s.
    pub under_levels_mm_s: Vec<f64>,
    /// The motion.
    pub driven: Driven,
    /// The total time that was to be met, s, and the one that the plan takes instead, s, where it could not be met.
    pub missed: Option<(f64, f64)>,
    /// The levels that the cuts keep, with [`SpeedMode::LeastForce`].
    pub levels: Option<Levels>,
}

impl<'a> JointMotion<'a> {
    /// Of a motion under its arm's limits.
    ///
    /// # Errors
    /// When the arm's limits are not usable.
    pub fn new(motion: &'a ArmMotion, arm: &Arm) -> Result<Self, PlanError> {
        let (dense, limits) = (&motion.dense, path_limits(arm)?);
        let path = JointPath { q: &dense.q, burr_mm: &dense.burr_mm, pose: &dense.pose, stops: &[] };
        Ok(Self { dense, prepared: PreparedPath::new(&path, &limits)? })
    }

    /// The waypoints at whose rounded corner the burr leaves the path by at least `least_mm`, with the joint vectors from where the corner
    /// begins to where it ends, `half` steps to its middle.
    pub fn burr_corners(&self, least_mm: f64, half: usize) -> Vec<(Range<usize>, Vec<Vec<f64>>)> {
        let up_to = |place: usize| self.dense.waypoints.partition_point(|of| *of < place);
        let of_waypoints = |(at, q): (Range<usize>, _)| (up_to(at.start)..up_to(at.end), q);
        let corners = self.prepared.burr_corners(least_mm, half).into_iter().map(of_waypoints);
        corners.filter(|(waypoints, _)| !waypoints.is_empty()).collect()
    }

    /// How long the path takes under caps per waypoint, mm/s.
    ///
    /// # Errors
    /// Where a cap is not positive.
    pub fn duration_s(&self, caps_mm_s: &[f64]) -> Result<f64, PlanError> {
        Ok(self.prepared.duration_s(&self.dense.per_place(caps_mm_s))?)
    }

    /// The motion under caps per waypoint, mm/s.
    ///
    /// # Errors
    /// Where a cap is not positive.
    pub fn driven(&self, caps_mm_s: &[f64]) -> Result<Driven, PlanError> {
        let law = self.prepared.law(&self.dense.per_place(caps_mm_s))?;
        let times = law.waypoint_times_s();
        let times_s = self.dense.waypoints.iter().map(|place| times[*place]).collect();
        let driven_mm_s = self.dense.greatest_per_waypoint(&law.burr_speeds_mm_s());
        Ok(Driven { law, times_s, driven_mm_s, places: self.dense.waypoints.clone() })
    }
}

impl Driven {
    /// The share of its time that the move to waypoint i has taken after a share of its way.
    pub fn passed(&self, i: usize, way: f64) -> f64 {
        let Some(before) = i.checked_sub(1) else { return way };
        let [from_s, to_s] = [before, i].map(|n| self.times_s[n]);
        let at_s = self.law.on_the_way_s([before, i].map(|n| self.places[n]), way);
        if to_s > from_s { ((at_s - from_s) / (to_s - from_s)).clamp(0.0, 1.0) } else { way }
    }

    /// How long the move to each waypoint takes, s.
    pub fn seconds(&self) -> Vec<f64> {
        let before = std::iter::once(0.0).chain(self.times_s.iter().copied());
        self.times_s.iter().zip(before).map(|(time, before)| time - before).collect()
    }
}

/// Caps by the case's mode, so that the plan takes the time aimed at, and the motion under them.
///
/// # Errors
/// When the mode is not supported, or the arm's limits are not usable.
pub fn timing(input: &SpeedInput, motion: &JointMotion, aim: &Aim) -> Result<Timing, PlanError> {
    let cuts = Cuts::new(input)?;
    let duration_s = |caps: &[f64]| motion.duration_s(caps);
    let found = cuts.caps_in_total(aim, duration_s)?;
    let driven = motion.driven(&found.mm_s)?;
    // beyond the tolerance by more than rounding
    let takes_s = driven.law.duration_s();
    let is_missed = |asked_s: &f64| (takes_s - asked_s).abs() > 1.001 * TIME_TOLERANCE_S;
    let missed = aim.total_s.filter(is_missed).map(|asked_s| (asked_s, takes_s));
    let caps_mm_s = cuts.lowered(&found.mm_s, &driven.driven_mm_s);
    Ok(Timing { caps_mm_s, under_levels_mm_s: found.mm_s, driven, missed, levels: found.levels })
}

/// How long the motion takes with every cut as fast as levels and the case's caps on force allow, s.
///
/// # Errors
/// As [`timing`].
pub fn under_levels_s(input: &SpeedInput, motion: &JointMotion, levels: &Levels) -> Result<f64, PlanError> {
    let cuts = Cuts::new(input)?;
    motion.duration_s(&cuts.moves.profile(|i| cuts.cap_under(levels, i))?.move_mm_s)
}

/// Caps by the case's mode alone; cuts take `cutting_s` in all if it is given, or the time nearest to it that the speed range allows.
/// With [`SpeedMode::LeastForce`] and no time they take what they take at the nominal speed.
///
/// # Errors
/// As [`timing`].
pub fn caps(input: &SpeedInput, cutting_s: Option<f64>, aim: &Aim) -> Result<SpeedCaps, PlanError> {
    Cuts::new(input)?.caps_in_cutting(cutting_s, aim)
}

/// The paper takes a plain average; it raises speed where the burr enters bone, so it is not the default.
pub fn smoothing(case: &Case) -> Smoothing {
    if case.paper { Smoothing::Average } else { Smoothing::MinimumThenAverage }
}

/// Caps of all moves.
#[derive(Debug, Clone)]
pub struct SpeedCaps {
    /// Per waypoint, mm/s.
    pub mm_s: Vec<f64>,
    /// With [`SpeedMode::LeastForce`].
    pub levels: Option<Levels>,
}

impl From<Vec<f64>> for SpeedCaps {
    fn from(mm_s: Vec<f64>) -> Self {
        Self { mm_s, levels: None }
    }
}

/// The cutting moves, in order.
struct Cuts<'a> {
    input: &'a SpeedInput<'a>,
    spec: &'a SpeedSpec,
    model: SpeedModel,
    moves: CutMoves<'a>,
    mass_mg: Vec<f64>,
    cost: Vec<f64>,
    length_mm: Vec<f64>,
}

impl<'a> Cuts<'a> {
    fn new(input: &'a SpeedInput<'a>) -> Result<Self, PlanError> {
        let SpeedInput { spec, smoothing, .. } = *input;
        let model = SpeedModel::new(spec.min_mm_s, spec.max_mm_s, AIR_SHARE * input.slot_mass_mg, smoothing)?;
        let is_cut: Vec<bool> = input.kinds.iter().map(|kind| *kind == MoveKind::Cut).collect();
        let cuts = || (0..is_cut.len()).filter(|i| is_cut[*i]);
        // a short last step to a wall takes little bone only because it is short: mass per length decides
        let mass = |i: usize| input.mass_mg[i] * input.step_mm / input.length_mm[i].max(1e-3 * input.step_mm);
        Ok(Self {
            mass_mg: cuts().map(mass).collect(),
            cost: cuts().map(|i| input.cost[i]).collect(),
            length_mm: cuts().map(|i| input.length_mm[i]).collect(),
            moves: CutMoves {
                length_mm: input.length_mm,
                slowest_mm_s: input.slowest_mm_s,
                max_mm_s: spec.max_mm_s,
                link_mm_s: spec.link_mm_s,
                acceleration_mm_s2: spec.caps.acceleration_mm_s2,
                is_cut,
            },
            model,
            input,
            spec,
        })
    }

    fn length_mm(&self) -> f64 {
        self.length_mm.iter().sum()
    }

    /// Caps for a time of the whole path; `duration_s` returns that time for caps.
    fn caps_in_total(
        &self,
        aim: &Aim,
        duration_s: impl Fn(&[f64]) -> Result<f64, PlanError> + Sync,
    ) -> Result<SpeedCaps, PlanError> {
        if self.spec.mode == SpeedMode::LeastForce {
            let total_s =
                aim.total_s.map_or_else(|| duration_s(&self.constant(self.spec.nominal_mm_s)), Ok)?;
            let limit = TimeLimit { total_s, tolerance_s: TIME_TOLERANCE_S, evaluations: TIME_EVALUATIONS };
            return self.least_force(aim, limit, |caps| duration_s(caps));
        }
        let total = |cutting_s: f64| duration_s(&self.caps_of_mode(Some(cutting_s))?.mm_s);
        let cutting_s = aim.total_s.map(|total_s| self.cutting_for(total_s, total)).transpose()?;
        self.caps_of_mode(cutting_s)
    }

    /// Caps for a time of the cuts.
    fn caps_in_cutting(&self, cutting_s: Option<f64>, aim: &Aim) -> Result<SpeedCaps, PlanError> {
        if self.spec.mode == SpeedMode::LeastForce {
            let total_s = cutting_s.unwrap_or_else(|| self.length_mm() / self.spec.nominal_mm_s);
            let limit = TimeLimit { total_s, tolerance_s: 1e-6 * total_s, evaluations: 2 * TIME_EVALUATIONS };
            return self.least_force(aim, limit, |caps| Ok(self.cutting_s(caps)));
        }
        let within = |asked_s: f64| -> Result<f64, PlanError> {
            let [fast, slow] = self.time_range_s()?;
            Ok(asked_s.max(fast).min(slow))
        };
        self.caps_of_mode(cutting_s.map(within).transpose()?)
    }

    /// The lowest levels of force in a time, and the caps under them.
    fn least_force(
        &self,
        aim: &Aim,
        limit: TimeLimit,
        duration_s: impl Fn(&[f64]) -> Result<f64, PlanError> + Sync,
    ) -> Result<SpeedCaps, PlanError> {
        let pushes = self.input.pushes.iter().flatten();
        let mut top = Levels::above_all(pushes, [self.spec.min_mm_s, self.spec.max_mm_s]);
        top.overall = aim.most_overall.map_or(top.overall, |most| top.overall.min(most));
        // a way along which both levels fall in one ratio may begin above the top
        let within = |levels: &Levels| Levels { overall: levels.overall.min(top.overall), ..*levels };
        let caps = |levels: &Levels| -> Result<Vec<f64>, PlanError> {
            let levels = within(levels);
            Ok(self.moves.profile(|i| self.cap_under(&levels, i))?.move_mm_s)
        };
        let time_s = |levels: &Levels| duration_s(&caps(levels)?);
        // a reference that fits the time at the least speed has no levels
        let levels = match aim.reference.filter(|reference| reference.overall > 0.0) {
            Some(reference) => {
                let nothing = NOTHING_SHARE * reference.overall;
                least_along(reference, top, nothing, limit, time_s)?
            }
            None => least_levels(top, self.spec.min_mm_s, self.spec.force_room, limit, time_s)?,
        };
        Ok(SpeedCaps { mm_s: caps(&levels)?, levels: Some(within(&levels)) })
    }

    /// Time of the cuts at their caps, s.
    fn cutting_s(&self, caps_mm_s: &[f64]) -> f64 {
        let moves = self.moves.is_cut.iter().zip(self.moves.length_mm).zip(caps_mm_s);
        moves.filter(|((is_cut, _), _)| **is_cut).map(|((_, ds), v)| ds / v).sum()
    }

    /// Shortest and longest time of all cuts within the speed range, s.
    fn time_range_s(&self) -> Result<[f64; 2], PlanError> {
        let of_family = |slowness: f64| -> Result<f64, PlanError> {
            Ok(self.moves.cutting_s(&self.moves.profile(|i| self.share_of_cap(slowness, i))?))
        };
        Ok(match self.spec.mode {
            SpeedMode::Constant | SpeedMode::LeastForce => {
                [self.spec.max_mm_s, self.spec.min_mm_s].map(|v| self.length_mm() / v)
            }
            SpeedMode::ForceLimited => [of_family(0.0)?, of_family(1.0)?],
            SpeedMode::Mass => self.model.time_range_s(&self.mass_mg, &self.cost, &self.length_mm)?,
        })
    }

    /// The time of the cuts for which the whole plan takes `total_s`, or the nearest possible; `total` returns the plan's time for
    /// a time of the cuts.
    fn cutting_for(
        &self,
        total_s: f64,
        total: impl Fn(f64) -> Result<f64, PlanError> + Sync,
    ) -> Result<f64, PlanError> {
        let [fast, slow] = self.time_range_s()?;
        let at_fast = total(fast)?;
        if at_fast >= total_s {
            return Ok(fast);
        }
        let at_slow = total(slow)?;
        if at_slow <= total_s {
            return Ok(slow);
        }
        last_within([(fast, at_fast), (slow, at_slow)], total_s, TIME_TOLERANCE_S, TIME_EVALUATIONS, total)
    }

    /// Caps of all moves by any mode but the least force; cuts take `cutting_s` in all if it is given.
    fn caps_of_mode(&self, cutting_s: Option<f64>) -> Result<SpeedCaps, PlanError> {
        let speeds = match (self.spec.mode, cutting_s) {
            (SpeedMode::ForceLimited, None) => {
                return Ok(self.moves.profile(|i| self.share_of_cap(0.0, i))?.move_mm_s.into());
            }
            (SpeedMode::ForceLimited, Some(s)) => {
                let (_, profile) =
                    self.moves.in_time(1.0, |slowness, i| self.share_of_cap(slowness, i), s)?;
                return Ok(profile.move_mm_s.into());
            }
            (SpeedMode::Constant | SpeedMode::LeastForce, None) => {
                return Ok(self.constant(self.spec.nominal_mm_s).into());
            }
            (SpeedMode::Constant | SpeedMode::LeastForce, Some(s)) => {
                let even_mm_s = (self.length_mm() / s).clamp(self.spec.min_mm_s, self.spec.max_mm_s);
                return Ok(self.constant(even_mm_s).into());
            }
            (SpeedMode::Mass, None) => self.model.centred(&self.mass_mg, &self.cost)?.speed_mm_s,
            (SpeedMode::Mass, Some(s)) => {
                self.model.in_time(&self.mass_mg, &self.cost, &self.length_mm, s)?.speed_mm_s
            }
        };
        Ok(self.with_links(speeds.into_iter()).into())
    }

    /// Every cut at that speed, mm/s.
    fn constant(&self, cut_mm_s: f64) -> Vec<f64> {
        self.with_links(std::iter::repeat(cut_mm_s))
    }

    /// The cuts' speeds in order, between the links'.
    fn with_links(&self, mut cuts_mm_s: impl Iterator<Item = f64>) -> Vec<f64> {
        let cap = |is_cut: &bool| {
            if *is_cut { cuts_mm_s.next().unwrap_or(self.spec.min_mm_s) } else { self.spec.link_mm_s }
        };
        self.moves.is_cut.iter().map(cap).collect()
    }

    /// Cap of a cut under levels and the case's caps on force, mm/s.
    fn cap_under(&self, levels: &Levels, i: usize) -> f64 {
        let pushes = self.input.pushes.get(i).and_then(Option::as_ref);
        // a link is capped only where it meets a skin, or bone between voxels
        let levels_mm_s = match pushes {
            None if !self.moves.is_cut[i] => f64::INFINITY,
            _ => levels.fastest_mm_s(pushes),
        };
        levels_mm_s.min(self.input.force_cap_mm_s[i])
    }

    /// Cap of a cut as a share of that under the case's caps on force, mm/s.
    fn share_of_cap(&self, slowness: f64, i: usize) -> f64 {
        let cap_mm_s = self.input.force_cap_mm_s[i];
        if !self.moves.is_cut[i] {
            return cap_mm_s;
        }
        // a cut is slower than the slowest only where something pushes
        let share_mm_s = (1.0 - slowness) * cap_mm_s.min(self.spec.max_mm_s);
        share_mm_s.max(self.spec.min_mm_s.min(cap_mm_s))
    }

    /// Caps that the arm does not reach, lowered to hardly more than what it drives; a cut's within the range of speeds.
    fn lowered(&self, caps_mm_s: &[f64], driven_mm_s: &[f64]) -> Vec<f64> {
        let lower = |i: usize| {
            let least = if self.moves.is_cut[i] { self.moves.slowest_mm_s[i] } else { 0.0 };
            let driven = driven_mm_s[i];
            if driven > 0.0 { caps_mm_s[i].min((CAP_OVER_DRIVEN * driven).max(least)) } else { caps_mm_s[i] }
        };
        (0..caps_mm_s.len()).map(lower).collect()
    }
}

#[cfg(test)]
mod tests;
