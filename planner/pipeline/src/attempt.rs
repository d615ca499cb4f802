//! Plans of one case that differ in what the case leaves open, tried until no structure has larger forces than under the controls.
//!
//! The first attempt is what the drafts prefer. Where it pushes more toward a structure of priority 1 than the better of its
//! [controls](super::control), the other sense of cut, then lines across, then a shaft along the approach, then both of these are
//! tried; the first that is nowhere worse stands. If none is, the least bad stands, and the plan says so.

use bonemill_arm::Arm;
use bonemill_armpath::{ArmMotion, Placed, path_limits};
use bonemill_case::{Case, OrientationMode, Sense};
use bonemill_geometry::{Base, Rigid, Work};
use bonemill_motion::resolve::Posture;
use bonemill_scene::Scene;
use bonemill_setup::{Setup, Stopwatch};
use bonemill_toolpath::access::ShankObstacles;
use bonemill_toolpath::path::RasterFrame;
use bonemill_toolpath::space::BurrSpace;

use super::PlanError;
use super::choose::{Choices, Chosen};
use super::control::{Compared, ControlPath, Worse};
use super::metrics::{self, Coverage};
use super::move_limits::MoveLimits;
use super::prepared::{Prepared, spacing};
use super::raster::Raster;
use super::speeds::{self, Timing};

/// An attempt may leave this share more of what the burr can reach than the one before.
const LEFT_SHARE: f64 = 0.005;

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
    /// The fallback that was taken, in words; none for the first attempt.
    pub instead: Option<&'static str>,
}

/// One way to fall back.
#[derive(Clone, Copy)]
struct Fallback {
    /// The other sense of cut of those that were compared.
    is_other_sense: bool,
    is_across: bool,
    is_fixed: bool,
    words: &'static str,
}

const NONE: Fallback = Fallback { is_other_sense: false, is_across: false, is_fixed: false, words: "" };
const FALLBACKS: [Fallback; 4] = [
    Fallback { is_other_sense: true, words: "the sense of cut that drafts did not prefer", ..NONE },
    Fallback { is_across: true, words: "lines across those that drafts preferred", ..NONE },
    Fallback { is_fixed: true, words: "the shaft along the approach", ..NONE },
    Fallback {
        is_across: true,
        is_fixed: true,
        words: "lines across those that drafts preferred, and the shaft along the approach",
        ..NONE
    },
];

impl Fallback {
    /// Whether a case leaves that open.
    fn is_open(&self, case: &Case) -> bool {
        (!self.is_other_sense || case.path.sense == Sense::Auto)
            && (!self.is_across || case.path.raster_rad.is_none())
            && (!self.is_fixed || case.orientation.mode == OrientationMode::Optimal)
    }

    /// The lines that it lays instead.
    fn raster(&self, raster: Raster) -> Raster {
        let sense = match raster.sense {
            Sense::Both => Sense::Away,
            _ => Sense::Both,
        };
        Raster {
            frame: if self.is_across { raster.frame.across() } else { raster.frame },
            sense: if self.is_other_sense { sense } else { raster.sense },
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

    /// The first attempt that is nowhere worse than its controls, or the least bad.
    ///
    /// # Errors
    /// [`PlanError`] of the first attempt; a fallback that cannot be planned is passed over.
    pub fn plan(&self, watch: &mut Stopwatch) -> Result<Attempt<'a>, PlanError> {
        let prepared = Prepared::new(self, None, watch)?;
        let raster = prepared.raster();
        let controls = if self.case.structures.is_empty() {
            Vec::new()
        } else {
            watch.run("control", || self.controls(&raster.frame))?
        };
        let choices = Choices::of(self.case);
        let mut best = self.attempt(prepared, &choices, &controls, watch)?;
        let mut ratio = best.worst_ratio();
        for fallback in FALLBACKS.iter().filter(|fallback| fallback.is_open(self.case)) {
            if ratio.is_none() {
                break;
            }
            let mode = if fallback.is_fixed { OrientationMode::Fixed } else { choices.mode };
            let varied = Choices { mode, ..choices.clone() };
            let tried = Prepared::new(self, Some(fallback.raster(raster)), watch)
                .and_then(|prepared| self.attempt(prepared, &varied, &controls, watch));
            let Ok(tried) = tried else { continue };
            let its_ratio = tried.worst_ratio();
            if tried.keeps_what(&best) && its_ratio.unwrap_or(1.0) < ratio.unwrap_or(1.0) {
                ratio = its_ratio;
                best = Attempt { instead: Some(fallback.words), ..tried };
            }
        }
        Ok(best)
    }

    /// The controls with lines along `frame` and across.
    fn controls(&self, frame: &RasterFrame) -> Result<Vec<ControlPath>, PlanError> {
        let along = |frame: RasterFrame| {
            let raster = Raster { frame, sense: Sense::Both };
            let path = raster.lay(self.case, self.scene, self.space, spacing(self.case))?;
            ControlPath::new(self.case, self.scene, &path, frame.angle_rad())
        };
        let (first, second) = rayon::join(|| along(*frame), || along(frame.across()));
        Ok(vec![first?, second?])
    }

    /// Axes, motion and speeds for a path.
    fn attempt(
        &self,
        mut prepared: Prepared<'a>,
        choices: &Choices,
        controls: &[ControlPath],
        watch: &mut Stopwatch,
    ) -> Result<Attempt<'a>, PlanError> {
        let case = self.case;
        let (chosen, motion) = prepared.choose_with_motion(choices, watch)?;
        let demand = prepared.demand(choices, &chosen)?;
        let limits = path_limits(self.arm)?;
        let speed_input = demand.input(&prepared, choices, &chosen, &motion.dense);
        let reached = &prepared.reached;
        let (timing, coverage) = watch.run("time law, coverage", || {
            rayon::join(
                || speeds::timing(&speed_input, &limits),
                || {
                    let (path, dropped) = (&reached.path, &reached.dropped);
                    metrics::coverage(self.scene, self.space, &path.removal, &path.points, dropped)
                },
            )
        });
        let (timing, coverage) = (timing?, coverage?);
        // refused here, before anything is written
        timing.law.rows(case.robot.rate_hz)?;
        let caps = &timing.caps_mm_s;
        let compared = Compared {
            controls: controls.iter().map(|control| control.in_time(case, timing.at_caps_s)).collect(),
            plan: prepared.structure_forces(&chosen, caps),
        };
        Ok(Attempt {
            prepared,
            chosen,
            motion,
            demand,
            timing,
            coverage,
            compared,
            mode: choices.mode,
            instead: None,
        })
    }
}

impl Attempt<'_> {
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

    /// By how much it is worse than its controls at the worst; none where it is nowhere worse.
    pub fn worst_ratio(&self) -> Option<f64> {
        self.compared.worse(self.prepared.start.case).first().map(Worse::ratio)
    }

    /// Score of the forces toward structures: see [`super::StructureForces::score`].
    pub fn score(&self) -> f64 {
        self.compared.plan.score(self.prepared.start.case)
    }
}
