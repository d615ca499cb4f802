//! Speed caps per move (D13, force caps or least force), and the time law under them.

use bonemill_case::{Case, SpeedMode, SpeedSpec};
use bonemill_cutter::MoveKind;
use bonemill_cutting::speed::{CutMoves, CutPushes, LevelFamily, Levels, Smoothing, SpeedModel, last_within};
use bonemill_motion::resolve::DensePath;
use bonemill_motion::timelaw::{JointPath, PathLimits, PreparedPath, TimeLaw};

use super::PlanError;

/// Share of a full slot's mass per step at or below which a waypoint counts as air. D13 takes a mean of 1/m: the crumbs of
/// finishing passes would otherwise set the speed of the whole plan.
const AIR_SHARE: f64 = 0.02;
/// Largest number of time laws computed to meet a total time, besides those at the ends of the range.
const TIME_EVALUATIONS: u32 = 38;
/// How exactly a total time is met, s: from below, where it is not an end of the range.
const TIME_TOLERANCE_S: f64 = 1e-3;

/// What speeds depend on; one entry per waypoint each.
#[derive(Debug, Clone, Copy)]
pub struct SpeedInput<'a> {
    /// What each move is for.
    pub kinds: &'a [MoveKind],
    /// Length of the move that ends here, mm.
    pub length_mm: &'a [f64],
    /// Mass ahead, mg.
    pub mass_mg: &'a [f64],
    /// Cost C.
    pub cost: &'a [f64],
    /// The joint path through all waypoints.
    pub dense: &'a DensePath,
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

/// Caps and the law under them.
#[derive(Debug, Clone)]
pub struct Timing {
    /// Speed cap of the move that ends at each waypoint, mm/s.
    pub caps_mm_s: Vec<f64>,
    /// The motion.
    pub law: TimeLaw,
    /// When each waypoint is passed, s.
    pub waypoint_times_s: Vec<f64>,
    /// What the plan would take if every move ran at its speed cap, s.
    pub at_caps_s: f64,
    /// The total time that was to be met, s, and the one that the plan takes instead, s, where it could not be met.
    pub missed: Option<(f64, f64)>,
    /// The levels that the cuts keep, with [`SpeedMode::LeastForce`].
    pub levels: Option<Levels>,
}

/// Caps by the case's mode, scaled to its total time if it has one; with [`SpeedMode::LeastForce`] and no total time, to the time
/// that the plan takes with every cut at the nominal speed.
///
/// # Errors
/// When the mode is not supported, or the arm's limits are not usable.
pub fn timing(input: &SpeedInput, limits: &PathLimits) -> Result<Timing, PlanError> {
    let prepared = PreparedPath::new(
        &JointPath { q: &input.dense.q, burr_mm: &input.dense.burr_mm, pose: &input.dense.pose, stops: &[] },
        limits,
    )?;
    let (spec, cuts) = (input.spec, Cuts::new(input)?);
    let duration_s = |caps: &[f64]| prepared.duration_s(&input.dense.per_place(caps));
    let total_s = match (spec.total_time_s, spec.mode) {
        (None, SpeedMode::LeastForce) => Some(duration_s(&cuts.constant(spec.nominal_mm_s))?),
        (asked_s, _) => asked_s,
    };
    let total = |cutting_s: f64| Ok(duration_s(&cuts.caps(Some(cutting_s))?.mm_s)?);
    let cutting_s = total_s.map(|total_s| cuts.cutting_for(total_s, total)).transpose()?;
    let caps = cuts.caps(cutting_s)?;
    let law = prepared.law(&input.dense.per_place(&caps.mm_s))?;
    let times = law.waypoint_times_s();
    let waypoint_times_s = input.dense.waypoints.iter().map(|place| times[*place]).collect();
    // beyond the tolerance by more than rounding
    let is_missed = |asked_s: &f64| (law.duration_s() - asked_s).abs() > 1.001 * TIME_TOLERANCE_S;
    let missed = total_s.filter(is_missed).map(|asked_s| (asked_s, law.duration_s()));
    let at_caps_s = input.length_mm.iter().zip(&caps.mm_s).map(|(mm, cap)| mm / cap).sum();
    Ok(Timing { law, waypoint_times_s, caps_mm_s: caps.mm_s, at_caps_s, missed, levels: caps.levels })
}

/// Caps by the case's mode alone; cuts take `cutting_s` in all if it is given. With [`SpeedMode::LeastForce`] and no time they take
/// what they take at the nominal speed.
///
/// # Errors
/// As [`timing`].
pub fn caps(input: &SpeedInput, cutting_s: Option<f64>) -> Result<Vec<f64>, PlanError> {
    Ok(Cuts::new(input)?.caps(cutting_s)?.mm_s)
}

/// The same with the cuts in `cutting_s`, or in the time nearest to it that the speed range allows.
///
/// # Errors
/// As [`timing`].
pub fn caps_near(input: &SpeedInput, cutting_s: f64) -> Result<Vec<f64>, PlanError> {
    let cuts = Cuts::new(input)?;
    let [fast, slow] = cuts.time_range_s()?;
    Ok(cuts.caps(Some(cutting_s.max(fast).min(slow)))?.mm_s)
}

/// The paper takes a plain average; it raises speed where the burr enters bone, so it is not the default.
pub fn smoothing(case: &Case) -> Smoothing {
    if case.paper { Smoothing::Average } else { Smoothing::MinimumThenAverage }
}

/// Caps of all moves.
struct Caps {
    mm_s: Vec<f64>,
    levels: Option<Levels>,
}

impl From<Vec<f64>> for Caps {
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
    levels: LevelFamily,
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
        let range_mm_s = [spec.min_mm_s, spec.max_mm_s];
        let pushes = input.pushes.iter().zip(&is_cut).filter(|(_, is_cut)| **is_cut);
        Ok(Self {
            mass_mg: cuts().map(mass).collect(),
            cost: cuts().map(|i| input.cost[i]).collect(),
            length_mm: cuts().map(|i| input.length_mm[i]).collect(),
            levels: LevelFamily::new(pushes.filter_map(|(pushes, _)| pushes.as_ref()), range_mm_s),
            moves: CutMoves {
                length_mm: input.length_mm,
                range_mm_s,
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

    /// Shortest and longest time of all cuts within the speed range, s.
    fn time_range_s(&self) -> Result<[f64; 2], PlanError> {
        let of_family = |slowness: f64| -> Result<f64, PlanError> {
            Ok(self.moves.cutting_s(&self.moves.profile(|i| self.force_cap_mm_s(slowness, i))?))
        };
        Ok(match self.spec.mode {
            SpeedMode::Constant => [self.spec.max_mm_s, self.spec.min_mm_s].map(|v| self.length_mm() / v),
            SpeedMode::ForceLimited | SpeedMode::LeastForce => [of_family(0.0)?, of_family(self.slowest())?],
            SpeedMode::Mass => self.model.time_range_s(&self.mass_mg, &self.cost, &self.length_mm)?,
        })
    }

    /// The time of the cuts for which the whole plan takes `total_s`, or the nearest possible; `total` returns the plan's time for
    /// a time of the cuts.
    fn cutting_for(
        &self,
        total_s: f64,
        total: impl Fn(f64) -> Result<f64, PlanError>,
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

    /// Caps of all moves; cuts take `cutting_s` in all if it is given.
    fn caps(&self, cutting_s: Option<f64>) -> Result<Caps, PlanError> {
        let speeds = match (self.spec.mode, cutting_s) {
            (SpeedMode::ForceLimited, None) => {
                return Ok(self.moves.profile(|i| self.force_cap_mm_s(0.0, i))?.move_mm_s.into());
            }
            (SpeedMode::ForceLimited | SpeedMode::LeastForce, _) => {
                let cutting_s = cutting_s.unwrap_or_else(|| self.length_mm() / self.spec.nominal_mm_s);
                let cap = |slowness: f64, i: usize| self.force_cap_mm_s(slowness, i);
                let (slowness, profile) = self.moves.in_time(self.slowest(), cap, cutting_s)?;
                let levels = (self.spec.mode == SpeedMode::LeastForce).then(|| self.levels.at(slowness));
                return Ok(Caps { mm_s: profile.move_mm_s, levels });
            }
            (SpeedMode::Constant, None) => return Ok(self.constant(self.spec.nominal_mm_s).into()),
            (SpeedMode::Constant, Some(s)) => {
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

    /// The last parameter of the family of caps that the mode follows; 0 is the first.
    fn slowest(&self) -> f64 {
        if self.spec.mode == SpeedMode::LeastForce { self.levels.slowest() } else { 1.0 }
    }

    /// Cap of a cut at a parameter of that family, mm/s: a share of its force cap, or what the levels and the force cap allow.
    fn force_cap_mm_s(&self, slowness: f64, i: usize) -> f64 {
        let most_mm_s = self.input.force_cap_mm_s[i].min(self.spec.max_mm_s);
        if self.spec.mode == SpeedMode::LeastForce {
            let pushes = self.input.pushes.get(i).and_then(Option::as_ref);
            self.levels.at(slowness).fastest_mm_s(pushes).min(most_mm_s)
        } else {
            (1.0 - slowness) * most_mm_s
        }
    }
}
