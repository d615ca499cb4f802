//! What a user could do instead, driven by the same arm in the same total time: straight shafts.
//!
//! A reference mills the same target with the shaft along the approach, along lines in one direction. Its path is laid, followed by the
//! arm and timed as the plan's is, links, approach and retracts included; only its shank is not checked, so it may collide, and is
//! compared all the same. There are three:
//!
//! - two **controls**, the plan of a CNC machine: one speed for every cut, lines along and across;
//! - the **straight shaft with the least force**: the lines, the sense of cut and the speeds that levels of force choose for it.
//!
//! The default total time is that of the faster control at the nominal speed, so that lower forces take no longer than a plain plan.
//!
//! **Source:** Dillon et al. 2016, section III: trial 1, and trial 3 at equal time.

use bonemill_case::{Case, ForceTerm, Structure};
use bonemill_cutting::burr::EngagedForce;
use bonemill_cutting::cutter::Ball;
use bonemill_cutting::speed::{Levels, last_within};
use bonemill_planfile::toward::{NEAR_MM, StructureFigures, TowardSpan};
use bonemill_setup::armpath::{ArmMotion, Compliance};
use bonemill_setup::nearest_structures::{self, NearStructure};
use bonemill_toolpath::engagement::mass_increments;
use bonemill_toolpath::path::{self, MoveKind};
use nalgebra::Vector3;

use super::PlanError;
use super::laid::{Raster, feeds, spacing};
use super::levels;
use super::path_forces::{ForceWithin, ForcedPath, extremes_of_move, mean_of_move};
use super::reach::lengths;
use super::sampled::SampledForce;
use super::speeds::{self, Aim, Driven, JointMotion, PushedMoves};
use super::start::Start;

/// Slowest constant speed of a control, as a share of the nominal speed.
const SLOWEST_SHARE: f64 = 0.02;
/// How exactly a control takes the plan's time, s, and the most time laws computed for it.
const TIME_TOLERANCE_S: f64 = 0.02;
const EVALUATIONS: u32 = 50;

/// A reference whose time is this near to the plan's takes the same time, s.
const SAME_TIME_S: f64 = 0.05;

/// A straight shaft along a path, followed by the arm.
#[derive(Debug)]
pub(super) struct ReferencePath {
    pub raster: Raster,
    length_mm: Vec<f64>,
    kinds: Vec<MoveKind>,
    /// Where moves end that remove something, and at places within moves.
    ends: Vec<Option<EngagedForce>>,
    within: Vec<Vec<ForceWithin>>,
    near: Vec<Vec<NearStructure>>,
    pub motion: ArmMotion,
}

/// Forces of a plan or a reference at the speeds that are driven.
#[derive(Debug, Clone, PartialEq)]
pub struct StructureForces {
    /// Mean force by time, N.
    pub mean_n: f64,
    /// Largest force, N.
    pub peak_n: f64,
    /// Per structure of the case.
    pub structures: Vec<StructureFigures>,
}

/// One reference.
#[derive(Debug, Clone, PartialEq)]
pub struct Reference {
    /// Its lines.
    pub raster: Raster,
    /// Speed of its cuts, mm/s, where all have one.
    pub speed_mm_s: Option<f64>,
    /// How long it takes, s.
    pub total_time_s: f64,
    /// Its forces.
    pub forces: StructureForces,
}

impl Reference {
    /// Whether it takes this time, s: not where its speeds cannot.
    pub fn takes(&self, total_s: f64) -> bool {
        (self.total_time_s - total_s).abs() <= SAME_TIME_S
    }
}

/// The straight shaft with the least force.
#[derive(Debug, Clone)]
pub(super) struct Straight {
    pub reference: Reference,
    /// The levels of its cuts faster than the least speed, and the largest pushes that it drives.
    pub levels: [Levels; 2],
    /// Its time at the caps under its levels, without acceleration, over what it takes.
    pub caps_over_driven: f64,
}

impl ReferencePath {
    /// Lays a path along `raster` and follows it with the arm; `None` where nothing can be reached or the arm cannot follow.
    ///
    /// # Errors
    /// When the burr's centre lies inside a structure.
    pub fn new(start: &Start, raster: Raster) -> Result<Option<Self>, PlanError> {
        let Start { case, scene, space, .. } = *start;
        let path = raster.lay(case, scene, space, spacing(case))?;
        if path.points.is_empty() {
            return Ok(None);
        }
        let (points, centers) = (&path.points, path::centers(&path.points));
        let near = nearest_structures::along(case, scene, &centers)?;
        let (feeds, length_mm) = (feeds(points), lengths(points));
        let axes = vec![Vector3::z_axis(); points.len()];
        let moments =
            mass_increments(&scene.density_g_cm3, points, Ball { radius_mm: case.burr.radius_mm }).at_end;
        let cuts = |i: usize| moments[i].mass_mg() > 0.0;
        let motion = match start.placed().motion(&centers, &axes, &length_mm, None) {
            Ok(motion) => motion,
            Err(PlanError::OutOfReach { .. }) => return Ok(None),
            Err(error) => return Err(error),
        };
        let forced = ForcedPath { scene, removal: &path.removal, points, feeds: &feeds };
        let (sampled, swept) = (SampledForce::within(case)?, forced.rounded((start, case), &motion)?);
        // figures near structures are small
        let is_near =
            |i: usize| near[i].iter().any(|n| n.proximity.distance_mm - case.burr.radius_mm <= NEAR_MM);
        let fine = forced.finely((case, &swept), &axes, |i| cuts(i) && is_near(i))?;
        let rest = forced.at_ends((&sampled, &swept), &axes, |i| cuts(i) && !is_near(i));
        let ends: Vec<_> = fine.into_iter().zip(rest).map(|(fine, rest)| fine.or(rest)).collect();
        let within = forced.within((&sampled, &swept, &near), &axes, &ends);
        let is_cut = |i: usize| i > 0 && cuts(i) || points[i].kind == MoveKind::Cut;
        let kind = |i: usize| if is_cut(i) { MoveKind::Cut } else { points[i].kind };
        let kinds = (0..points.len()).map(kind).collect();
        Ok(Some(Self { raster, length_mm, kinds, ends, within, near, motion }))
    }

    fn joints(&self, start: &Start) -> Result<JointMotion<'_>, PlanError> {
        JointMotion::new(&self.motion, start.arm)
    }

    /// One cap for every cut, mm/s.
    fn constant(&self, case: &Case, speed_mm_s: f64) -> Vec<f64> {
        let cap = |kind: &MoveKind| if *kind == MoveKind::Cut { speed_mm_s } else { case.speed.link_mm_s };
        self.kinds.iter().map(cap).collect()
    }

    /// How long it takes with every cut at the nominal speed, s.
    ///
    /// # Errors
    /// When the arm's limits are not usable.
    pub fn nominal_s(&self, start: &Start) -> Result<f64, PlanError> {
        self.joints(start)?.duration_s(&self.constant(start.case, start.case.speed.nominal_mm_s))
    }

    /// At the one speed of all cuts with which it takes `total_s`, or at the case's largest where it takes longer with that.
    ///
    /// # Errors
    /// When the arm's limits are not usable.
    pub fn in_time(&self, start: &Start, total_s: f64) -> Result<Reference, PlanError> {
        let (case, joints) = (start.case, self.joints(start)?);
        let [fast, slow] = [1.0 / case.speed.max_mm_s, 1.0 / (SLOWEST_SHARE * case.speed.nominal_mm_s)];
        let time_s = |per_speed: f64| joints.duration_s(&self.constant(case, 1.0 / per_speed));
        let ends_s = [time_s(fast)?, time_s(slow)?];
        let per_speed = if ends_s[0] >= total_s {
            fast
        } else if ends_s[1] <= total_s {
            slow
        } else {
            let bracket = [(fast, ends_s[0]), (slow, ends_s[1])];
            last_within(bracket, total_s, TIME_TOLERANCE_S, EVALUATIONS, time_s)?
        };
        let driven = joints.driven(&self.constant(case, 1.0 / per_speed))?;
        // links keep their speed, and what they graze is no cut
        let of_cut = |(kind, forces): (&MoveKind, &Vec<_>)| {
            if *kind == MoveKind::Cut { forces.clone() } else { Vec::new() }
        };
        let within: Vec<_> = self.kinds.iter().zip(&self.within).map(of_cut).collect();
        Ok(self.reference(case, &driven, Some(1.0 / per_speed), &within))
    }

    fn reference(
        &self,
        case: &Case,
        driven: &Driven,
        speed_mm_s: Option<f64>,
        within: &[Vec<ForceWithin>],
    ) -> Reference {
        Reference {
            raster: self.raster,
            speed_mm_s,
            total_time_s: driven.law.duration_s(),
            forces: StructureForces::of(case, &self.length_mm, driven, (&self.ends, within), &self.near),
        }
    }

    /// With the least force in `total_s`, none of its cuts pushing more than `most_overall` where that is too short.
    ///
    /// # Errors
    /// When the arm's limits are not usable.
    pub fn least_force(
        &self,
        start: &Start,
        total_s: f64,
        most_overall: Option<f64>,
    ) -> Result<Straight, PlanError> {
        let (case, joints) = (start.case, self.joints(start)?);
        let compliances = match case.cost.force {
            ForceTerm::Deflection => Compliance::new(case, start.placed())?.along(&self.motion.resolved.q)?,
            ForceTerm::Cutting => None,
        };
        let pushes = levels::pushes(case, &self.near, (&self.ends, &self.within), compliances.as_deref())?;
        let moves = PushedMoves::new(case, (&self.kinds, &self.ends), &self.length_mm, &pushes);
        let aim = Aim { total_s: Some(total_s), reference: None, most_overall };
        let timing = speeds::timing(&moves.input(), &joints, &aim)?;
        let reached = levels::reached(&pushes, &timing.driven.driven_mm_s);
        let takes_s = timing.driven.law.duration_s();
        let at_caps_s: f64 = self.length_mm.iter().zip(&timing.under_levels_mm_s).map(|(mm, v)| mm / v).sum();
        Ok(Straight {
            reference: self.reference(case, &timing.driven, None, &self.within),
            levels: [timing.levels.unwrap_or(reached), reached],
            caps_over_driven: at_caps_s / takes_s.max(f64::MIN_POSITIVE),
        })
    }
}

impl StructureForces {
    /// Of moves as they are driven; one entry per waypoint each.
    pub(super) fn of(
        case: &Case,
        length_mm: &[f64],
        driven: &Driven,
        forces: (&[Option<EngagedForce>], &[Vec<ForceWithin>]),
        near: &[Vec<NearStructure>],
    ) -> Self {
        let moves = (length_mm, &driven.seconds()[..], &driven.driven_mm_s[..]);
        Self::at(case, moves, |row, way| driven.passed(row, way), forces, near)
    }

    /// Of moves with their lengths, mm, times, s, and greatest speeds, mm/s: the mean is that at the mean speed of each move, the
    /// peak that at the greatest. `passed`: the share of a move's time that has passed after a share of its way.
    pub(super) fn at(
        case: &Case,
        (length_mm, seconds, speed_mm_s): (&[f64], &[f64], &[f64]),
        passed: impl Fn(usize, f64) -> f64,
        (ends, within): (&[Option<EngagedForce>], &[Vec<ForceWithin>]),
        near: &[Vec<NearStructure>],
    ) -> Self {
        let mut spans = vec![Vec::new(); case.structures.len()];
        let (mut cutting_s, mut impulse, mut peak_n) = (0.0, 0.0, 0f64);
        for (row, end) in ends.iter().enumerate() {
            let within = within.get(row).map_or(&[][..], Vec::as_slice);
            let peaks: Vec<_> = extremes_of_move(end.as_ref(), within, speed_mm_s[row]).collect();
            let largest_n = peaks.iter().map(|(_, force)| force.norm()).fold(0.0, f64::max);
            peak_n = peak_n.max(largest_n);
            let taken = if end.is_some() { seconds[row] } else { 0.0 };
            let driven = [length_mm[row], taken, speed_mm_s[row]];
            let passed = |way: f64| passed(row, way);
            let mean_of = |of: &dyn Fn(&Vector3<f64>, f64) -> f64| {
                mean_of_move(end.as_ref(), within, driven, passed, of)
            };
            cutting_s += taken;
            impulse += taken * mean_of(&|force, _| force.norm());
            for n in near[row].iter().filter(|_| !peaks.is_empty()) {
                let toward = |force: &Vector3<f64>, at: f64| force.dot(&n.toward(at)).max(0.0);
                let peak_n = peaks.iter().map(|(at, force)| n.most(force, *at)).fold(0.0, f64::max);
                let span = TowardSpan { seconds: taken, force_n: mean_of(&toward), peak_n, row };
                spans[n.structure].push((span, n.proximity.distance_mm));
            }
        }
        let of = |(structure, spans): (&Structure, &Vec<_>)| {
            StructureFigures::of(None, spans, [case.burr.radius_mm, structure.clearance_mm])
        };
        Self {
            mean_n: if cutting_s > 0.0 { impulse / cutting_s } else { 0.0 },
            peak_n,
            structures: case.structures.iter().zip(&spans).map(of).collect(),
        }
    }
}
