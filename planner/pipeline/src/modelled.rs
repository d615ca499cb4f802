//! What was modelled where, and what each approximation cost in error: the path, the axes, the arm and the speeds.

use bonemill_case::{OrientationMode, Sense};
use bonemill_cutting::metrics::Moments;
use bonemill_robot::timelaw::LimitRatios;
use bonemill_setup::armpath::{ArmFacts, path_limits};

use super::attempt::Attempt;
use super::force_error::ForceError;
use super::path_error::PathError;
use super::raster::LinesDraft;
use super::{PlanError, SpeedLevels, half_turn, speed_levels};

/// What was modelled where.
#[derive(Debug, Clone, PartialEq)]
pub struct Modelled {
    /// The path.
    pub path: PathFacts,
    /// The drafts that its lines were chosen from; none where the case leaves no choice.
    pub drafts: Vec<LinesDraft>,
    /// The choice of axes.
    pub axes: AxisFacts,
    /// The arm along the path.
    pub arm: ArmFacts,
    /// The speeds.
    pub speeds: SpeedFacts,
}

/// How the path was laid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathFacts {
    /// Waypoints in all.
    pub waypoints: usize,
    /// Waypoints that cut something.
    pub cutting: usize,
    /// Milling layers, finishing passes as one more.
    pub layers: u32,
    /// Angle of the raster lines from work x as plans call it ([`bonemill_geometry::Approach`]), rad in (−π/2, π/2].
    pub raster_rad: f64,
    /// In which sense the passes are cut.
    pub sense: Sense,
    /// How the burr turns: −1 forward, +1 reverse.
    pub spin: i8,
    /// Places that the shank could not get to where they belonged, and that were milled at the end.
    pub put_off: usize,
    /// Passes that no link could join.
    pub unjoined_passes: usize,
    /// How exact the removed volume and the least distances are.
    pub error: PathError,
}

/// How the axes were chosen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisFacts {
    /// The case's mode, or fixed by a fallback.
    pub mode: OrientationMode,
    /// Of the waypoints that cut, those whose orientation cost was computed with the force.
    pub cost_with_force: usize,
    /// Of the waypoints that cut, those whose orientation cost was computed in closed form.
    pub cost_closed_form: usize,
    /// The most by which a choice in closed form is worse than one with the force, in units of C: what the force, evaluated
    /// afterwards, would have added.
    pub closed_form_error: f64,
    /// How exact the forces are.
    pub force_error: ForceError,
    /// Angle between neighbours of the directions that axes were chosen from, rad.
    pub direction_spacing_rad: f64,
    /// Moves during which the shank, turning from one free axis to the next, is not free all the way.
    pub blocked_turns: usize,
    /// Links that graze a cusp beyond the tilt limit, since no axis within it is free there.
    pub links_beyond_limit: usize,
    /// Waypoints at which the low-pass was held at a free angle.
    pub low_pass_held: usize,
}

/// What the speeds keep.
#[derive(Debug, Clone, PartialEq)]
pub struct SpeedFacts {
    /// How near the motion comes to the joints' limits.
    pub limit_ratios: LimitRatios,
    /// The levels of force that the speeds keep, with `speed.mode = "least_force"`.
    pub levels: Option<SpeedLevels>,
}

impl Modelled {
    /// Of an attempt that stands; `least`: per structure the least distance of the burr's centre, mm, and the waypoint.
    ///
    /// # Errors
    /// Where the motion is not the arm's.
    pub(super) fn of(attempt: &Attempt, least: &[Option<(f64, usize)>]) -> Result<Self, PlanError> {
        let prepared = &attempt.prepared;
        let start = &prepared.start;
        let toward = prepared.near.iter().map(|near| near.first().map(|n| &n.proximity.toward));
        let compliances = attempt.chosen.compliances.as_deref();
        Ok(Self {
            path: attempt.path_facts(least),
            drafts: attempt.drafts.clone(),
            axes: attempt.axis_facts(),
            arm: ArmFacts::along(start.arm, start.room, &attempt.motion, compliances, toward)?,
            speeds: attempt.speed_facts()?,
        })
    }
}

impl Attempt<'_> {
    fn path_facts(&self, least: &[Option<(f64, usize)>]) -> PathFacts {
        let (reached, raster) = (&self.prepared.reached, self.prepared.raster());
        PathFacts {
            waypoints: reached.path.points.len(),
            cutting: reached.moments.iter().filter(|m: &&Moments| m.mass_mg() > 0.0).count(),
            layers: reached.path.points.iter().map(|point| point.layer + 1).max().unwrap_or(0),
            raster_rad: half_turn(raster.frame.angle_rad() + self.prepared.start.scene.turn_rad),
            sense: raster.sense,
            spin: self.prepared.start.case.burr.spin,
            put_off: reached.put_off(),
            unjoined_passes: reached.path.unjoined,
            error: PathError::of(
                self.prepared.start.scene,
                &reached.path.removal,
                (&reached.path.points, self.prepared.start.case.burr.radius_mm),
                least.iter().map(|least| least.map(|(mm, _)| mm)),
            ),
        }
    }

    fn axis_facts(&self) -> AxisFacts {
        let oriented = &self.chosen.oriented;
        AxisFacts {
            mode: self.mode,
            cost_with_force: oriented.with_force,
            cost_closed_form: oriented.closed_form,
            closed_form_error: self.chosen.closed_form_error,
            force_error: self.chosen.force_error,
            direction_spacing_rad: oriented.spacing_rad,
            blocked_turns: oriented.blocked_turns.len(),
            links_beyond_limit: self.prepared.beyond_limit,
            low_pass_held: oriented.low_pass_held,
        }
    }

    fn speed_facts(&self) -> Result<SpeedFacts, PlanError> {
        let (timing, near) = (&self.timing, &self.prepared.near);
        let is_deflection = speed_levels::is_deflection(self.prepared.start.case, &self.chosen);
        let levels = timing.levels.as_ref().map(|found| {
            SpeedLevels::of(found, &self.demand.pushes, &timing.driven.driven_mm_s, near, is_deflection)
        });
        Ok(SpeedFacts {
            limit_ratios: timing.driven.law.limit_ratios(&path_limits(self.prepared.start.arm)?),
            levels,
        })
    }
}
