//! Speed caps per move (D13, or force caps), and the time law under them.

use bonemill_robot::resolve::DensePath;
use bonemill_robot::timelaw::{CornerTolerance, JointPath, PathLimits, PreparedPath, TimeLaw};

use super::PlanError;
use crate::case::{SpeedMode, SpeedSpec};
use crate::path::MoveKind;
use crate::space::TRAJECTORY_TOLERANCE_MM;
use crate::speed::{LimitedProfile, Smoothing, SpeedModel, fastest_profile};

/// Share of a full slot's mass per step at or below which a waypoint counts as air. D13 takes a mean of 1/m: the crumbs of
/// finishing passes would otherwise set the speed of the whole plan.
const AIR_SHARE: f64 = 0.02;
/// Bisections of the cutting time until the whole plan takes the time asked for.
const TIME_BISECTIONS: usize = 40;
/// Bisections of the share of the caps until the cuts take the time asked for.
const SHARE_BISECTIONS: usize = 40;
/// How exactly a total time is met, s.
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
    /// Nominal distance of cutting waypoints, mm.
    pub step_mm: f64,
    /// Mass that a step takes in a full slot of the reference material, mg.
    pub slot_mass_mg: f64,
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
    /// A total time that was asked for and could not be met, s.
    pub missed_s: Option<f64>,
}

/// Caps by the case's mode, scaled to its total time if it has one.
///
/// # Errors
/// When the mode is not supported, or the arm's limits are not usable.
pub fn timing(
    input: &SpeedInput,
    spec: &SpeedSpec,
    paper: bool,
    limits: &PathLimits,
) -> Result<Timing, PlanError> {
    let prepared = PreparedPath::new(
        &JointPath { q: &input.dense.q, burr_mm: &input.dense.burr_mm, pose: &input.dense.pose, stops: &[] },
        limits,
    )?;
    let cuts = Cuts::new(input, spec, paper)?;
    let finish = |caps: Vec<f64>, missed_s| -> Result<Timing, PlanError> {
        let law = prepared.law(&input.dense.per_place(&caps))?;
        let times = law.waypoint_times_s();
        let waypoint_times_s = input.dense.waypoints.iter().map(|place| times[*place]).collect();
        Ok(Timing { law, waypoint_times_s, caps_mm_s: caps, missed_s })
    };
    let Some(total_s) = spec.total_time_s else { return finish(cuts.caps(None)?, None) };
    // the total grows with the cutting time: bisection
    let [mut fast, mut slow] = cuts.time_range_s()?;
    let total = |cutting_s: f64| -> Result<f64, PlanError> {
        Ok(prepared.duration_s(&input.dense.per_place(&cuts.caps(Some(cutting_s))?))?)
    };
    for end in [fast, slow] {
        let at_end = total(end)?;
        if (end == fast && at_end > total_s) || (end == slow && at_end < total_s) {
            return finish(cuts.caps(Some(end))?, Some(at_end));
        }
    }
    for _ in 0..TIME_BISECTIONS {
        let middle = 0.5 * (fast + slow);
        let found = total(middle)?;
        if (found - total_s).abs() < TIME_TOLERANCE_S {
            (fast, slow) = (middle, middle);
            break;
        }
        if found < total_s { fast = middle } else { slow = middle }
    }
    finish(cuts.caps(Some(0.5 * (fast + slow)))?, None)
}

/// Caps by the case's mode alone; cuts take `cutting_s` in all if it is given.
///
/// # Errors
/// As [`timing`].
pub fn caps(
    input: &SpeedInput,
    spec: &SpeedSpec,
    paper: bool,
    cutting_s: Option<f64>,
) -> Result<Vec<f64>, PlanError> {
    Cuts::new(input, spec, paper)?.caps(cutting_s)
}

/// The limits of the time law: the corner tolerance leaves room for the arm's bow between waypoints.
pub fn path_limits(arm: &bonemill_robot::Arm) -> Result<PathLimits, PlanError> {
    let corner = CornerTolerance { burr_mm: 0.8 * TRAJECTORY_TOLERANCE_MM, ..CornerTolerance::default() };
    Ok(PathLimits::of_arm(arm, corner)?)
}

/// The cutting moves, in order.
struct Cuts<'a> {
    input: &'a SpeedInput<'a>,
    spec: &'a SpeedSpec,
    model: SpeedModel,
    mass_mg: Vec<f64>,
    cost: Vec<f64>,
    length_mm: Vec<f64>,
}

impl<'a> Cuts<'a> {
    fn new(input: &'a SpeedInput<'a>, spec: &'a SpeedSpec, paper: bool) -> Result<Self, PlanError> {
        let smoothing = if paper { Smoothing::Average } else { Smoothing::MinimumThenAverage };
        let model = SpeedModel::new(spec.min_mm_s, spec.max_mm_s, AIR_SHARE * input.slot_mass_mg, smoothing)?;
        let cuts = || (0..input.kinds.len()).filter(|i| input.kinds[*i] == MoveKind::Cut);
        // a short last step to a wall takes little bone only because it is short: mass per length decides
        let mass = |i: usize| input.mass_mg[i] * input.step_mm / input.length_mm[i].max(1e-3 * input.step_mm);
        Ok(Self {
            mass_mg: cuts().map(mass).collect(),
            cost: cuts().map(|i| input.cost[i]).collect(),
            length_mm: cuts().map(|i| input.length_mm[i]).collect(),
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
        Ok(match self.spec.mode {
            SpeedMode::Constant => [self.spec.max_mm_s, self.spec.min_mm_s].map(|v| self.length_mm() / v),
            SpeedMode::ForceLimited => [self.cutting_s(1.0)?, self.cutting_s(0.0)?],
            _ => self.model.time_range_s(&self.mass_mg, &self.cost, &self.length_mm)?,
        })
    }

    /// Caps of all moves; cuts take `cutting_s` in all if it is given.
    fn caps(&self, cutting_s: Option<f64>) -> Result<Vec<f64>, PlanError> {
        if self.spec.mode == SpeedMode::ForceLimited {
            let share = cutting_s.map_or(Ok(1.0), |s| self.share_for(s))?;
            return Ok(self.under_force_caps(share)?.move_mm_s);
        }
        let speeds = match (self.spec.mode, cutting_s) {
            (SpeedMode::Constant, None) => vec![self.spec.nominal_mm_s; self.mass_mg.len()],
            (SpeedMode::Constant, Some(s)) => {
                vec![(self.length_mm() / s).clamp(self.spec.min_mm_s, self.spec.max_mm_s); self.mass_mg.len()]
            }
            (_, None) => self.model.centred(&self.mass_mg, &self.cost)?.speed_mm_s,
            (_, Some(s)) => self.model.in_time(&self.mass_mg, &self.cost, &self.length_mm, s)?.speed_mm_s,
        };
        let mut speeds = speeds.into_iter();
        let cap = |kind: &MoveKind| match kind {
            MoveKind::Cut => speeds.next().unwrap_or(self.spec.min_mm_s),
            MoveKind::Link | MoveKind::Retract => self.spec.link_mm_s,
        };
        Ok(self.input.kinds.iter().map(cap).collect())
    }

    /// The fastest profile over the whole path, links included, with cuts at `share` of their caps.
    fn under_force_caps(&self, share: f64) -> Result<LimitedProfile, PlanError> {
        let SpeedSpec { min_mm_s, max_mm_s, link_mm_s, .. } = *self.spec;
        let cap = |(kind, force): (&MoveKind, &f64)| match kind {
            MoveKind::Cut => (share * force.min(max_mm_s)).max(min_mm_s),
            MoveKind::Link | MoveKind::Retract => link_mm_s,
        };
        let caps: Vec<f64> = self.input.kinds.iter().zip(self.input.force_cap_mm_s).map(cap).collect();
        let floor = min_mm_s.min(link_mm_s);
        Ok(fastest_profile(&caps, self.input.length_mm, floor, self.spec.caps.acceleration_mm_s2)?)
    }

    /// Time of the cuts at that share, s; it falls as the share grows.
    fn cutting_s(&self, share: f64) -> Result<f64, PlanError> {
        let speeds = self.under_force_caps(share)?.move_mm_s;
        let moves = self.input.kinds.iter().zip(self.input.length_mm).zip(speeds);
        Ok(moves.filter(|((kind, _), _)| **kind == MoveKind::Cut).map(|((_, ds), v)| ds / v).sum())
    }

    /// The share of the caps at which the cuts take `cutting_s`.
    fn share_for(&self, cutting_s: f64) -> Result<f64, PlanError> {
        let (mut slow, mut fast) = (0.0, 1.0);
        for _ in 0..SHARE_BISECTIONS {
            let middle = 0.5 * (slow + fast);
            if self.cutting_s(middle)? > cutting_s { slow = middle } else { fast = middle }
        }
        Ok(fast)
    }
}
