//! The whole way: a case to a plan.
//!
//! images → scene → free space → path with its removal times → access → engagement → orientation → forces → speed →
//! joint trajectory. Every stage takes values and hands values on; none keeps state. What a stage cannot do is a
//! result with its reason ([`Plan::shortfalls`]), an error only where nothing sensible can be planned.

mod access_csv;
mod arm_axes;
mod attempt;
mod control;
mod direction_sets;
mod figures;
mod known_directions;
mod levels;
mod metrics;
mod motion;
mod move_limits;
mod orient;
mod percent;
mod prepared;
mod push;
mod raster;
mod reach;
mod refused;
mod rest;
mod save;
mod sense;
mod speeds;
mod tilt;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

use attempt::{Attempt, Start};
use bonemill_arm::Arm;
use bonemill_arm::registration::Fitted;
use bonemill_geometry::{Base, Ct, Rigid, basis, cancel};
use bonemill_imaging::AffineReport;
use bonemill_motion::timelaw::{LimitRatios, TimeLaw};
use bonemill_scene::Scene;
use bonemill_scene::TargetOutside;
use push::Push;

pub use bonemill_setup::PlanError;
use bonemill_setup::{inputs, nearest_structures, registration, tools};
pub use control::{Compared, Control, Felt, JUDGED, Worse};
pub use figures::Figures;
pub use levels::{Exceeded, SpeedLevels};
pub use metrics::{Coverage, Volumes};
pub use orient::{BlockedTurn, Oriented};
pub use percent::percent;
pub use prepared::{Chosen, Prepared, with_prepared};
pub use reach::Dropped;
pub use refused::{Refused, place};
pub use rest::Cause;
pub use save::{record, save};

use bonemill_case::{Burr, Case, OrientationMode, Sense};
use bonemill_geometry::Progress;
use bonemill_planfile::{ForceToward, Input, Waypoint};
use bonemill_toolpath::access::ShankObstacles;
use bonemill_toolpath::orientation::Permissible;
use bonemill_toolpath::path;
use bonemill_toolpath::space::{BurrSpace, TRAJECTORY_TOLERANCE_MM};

/// Share of the reachable volume below which a plan fell short.
const ENOUGH_REACHED: f64 = 0.99;
/// A plan with all that its files and its report say.
#[derive(Debug)]
pub struct Plan {
    /// The case, resolved.
    pub case: Case,
    /// Every input as named in the case, with its file and digest; the case file first, when there is one.
    pub inputs: Vec<(Input, PathBuf)>,
    /// The rows of `waypoints.csv`.
    pub waypoints: Vec<Waypoint>,
    /// The rows of `forces.csv`.
    pub forces: Vec<ForceToward>,
    /// The motion of the joints.
    pub law: TimeLaw,
    /// The arm.
    pub arm: Arm,
    /// Registration used.
    pub base_from_ct: Rigid<Base, Ct>,
    /// The fit of the registration and its expected error at each structure, mm, where the case gives fiducials.
    pub fitted: Option<(Fitted, Vec<Option<f64>>)>,
    /// Images as planned on.
    pub scene: Scene,
    /// Volumes.
    pub coverage: Coverage,
    /// Forces, times and distances in one number each.
    pub figures: Figures,
    /// What the structures feel, beside a straight shaft at constant speed in the same time.
    pub compared: Compared,
    /// What the shank leaves open at each waypoint.
    pub allowed: Vec<Permissible>,
    /// Places that it kept the path from.
    pub dropped: Vec<Dropped>,
    /// What was modelled how.
    pub modelled: Modelled,
    /// Which affine was taken from the CT and from the labels.
    pub affines: [AffineReport; 2],
    /// What the user should know.
    pub warnings: Vec<String>,
    /// Why the plan falls short of its case, if it does.
    pub shortfalls: Vec<String>,
    /// Wall-clock seconds by stage of planning; never written into the plan's files.
    pub seconds: Vec<(&'static str, f64)>,
}

/// What was modelled where.
#[derive(Debug, Clone, PartialEq)]
pub struct Modelled {
    /// Waypoints in all.
    pub waypoints: usize,
    /// Waypoints that cut something.
    pub cutting: usize,
    /// Of these, orientation cost with the force.
    pub cost_with_force: usize,
    /// Of these, orientation cost in closed form.
    pub cost_closed_form: usize,
    /// The most by which a choice in closed form is worse than one with the force, in units of C: what the force, evaluated
    /// afterwards, would have added.
    pub closed_form_error: f64,
    /// Angle between neighbours of the directions that axes were chosen from, rad.
    pub direction_spacing_rad: f64,
    /// Moves during which the shank, turning from one free axis to the next, is not free all the way.
    pub blocked_turns: usize,
    /// Links that graze a cusp beyond the tilt limit, since no axis within it is free there.
    pub links_beyond_limit: usize,
    /// Waypoints at which the low-pass was held at a free angle.
    pub low_pass_held: usize,
    /// Places that the shank could not get to where they belonged, and that were milled at the end.
    pub put_off: usize,
    /// Smallest singular value along the path, mm/s: see [`Arm::slowest_mm_s`].
    pub slowest_mm_s: f64,
    /// How stiff the arm is at the burr, where its joints' stiffness is known.
    pub stiffness: Option<motion::Stiffnesses>,
    /// How near the motion comes to the joints' limits.
    pub limit_ratios: LimitRatios,
    /// What the plan would take if every move ran at its speed cap, s.
    pub time_at_caps_s: f64,
    /// The levels of force that the speeds keep, with `speed.mode = "least_force"`.
    pub speed_levels: Option<SpeedLevels>,
    /// The branch of the arm's inverse that the whole path is on.
    pub branch: u8,
    /// The lowest place of the arm's links over its mounting plane, where that is known.
    pub lowest_link: Option<motion::LowestLink>,
    /// Passes that no link could join.
    pub unjoined_passes: usize,
    /// Angle of the raster lines from work x as plans call it ([`bonemill_geometry::Approach`]), rad in (−π/2, π/2].
    pub raster_rad: f64,
    /// In which sense the passes are cut.
    pub sense: Sense,
    /// Milling layers.
    pub layers: u32,
    /// How the axes were chosen: the case's way, or fixed by a fallback.
    pub mode: OrientationMode,
    /// What was done otherwise than the cost prefers, since a structure of priority 1 would have been worse off than without us.
    pub instead: Option<&'static str>,
}

/// Notes how long each stage took.
struct Stopwatch<'a> {
    progress: &'a dyn Progress,
    seconds: Vec<(&'static str, f64)>,
}

impl Stopwatch<'_> {
    fn run<T>(&mut self, stage: &'static str, work: impl FnOnce() -> T) -> T {
        cancel::poll();
        self.progress.stage(stage);
        let start = Instant::now();
        let result = work();
        let seconds = start.elapsed().as_secs_f64();
        match self.seconds.iter_mut().find(|(name, _)| *name == stage) {
            Some((_, so_far)) => *so_far += seconds,
            None => self.seconds.push((stage, seconds)),
        }
        result
    }
}

/// What the shank of a case may not touch.
fn solid(case: &Case, scene: &Scene) -> ShankObstacles {
    let clearances: Vec<f64> = case.structures.iter().map(|s| s.shank_clearance_mm).collect();
    ShankObstacles::new(scene, &clearances)
}

/// Plans a case; paths in it are relative to the folder of `case_path`.
///
/// # Errors
/// [`PlanError`] for images that cannot be read or trusted, targets that cannot be planned for, and features that the
/// case asks for and this version does not have.
pub fn plan(case: &Case, case_path: &Path, progress: &dyn Progress) -> Result<Plan, PlanError> {
    let mut watch = Stopwatch { progress, seconds: Vec::new() };
    let arm = tools::arm(case, case_path.parent().unwrap_or(Path::new("")))?;
    let (images, files) = watch.run("read images", || inputs::read_inputs(case, case_path))?;
    registration::fiducials_in_scan(&case.robot, images.ct.volume.grid())?;
    let scene = watch.run("scene", || inputs::make_scene(case, &images))?;
    progress.memory_mb(inputs::memory_mb(&scene, &images));
    let inputs::Images { ct, labels, mut warnings, .. } = images;
    let affines = [ct.affine, labels.affine];
    drop((ct, labels)); // the scene holds what is needed of them
    warnings.extend(scene.warnings.iter().cloned());
    warnings.extend(tools::arm_warning(case, &arm));

    let space = watch.run("free space", || free_space(case, &scene))?;
    let registered = registration::registration(&case.robot, &scene)?;
    warnings.extend(registered.warnings(case));
    let base_from_ct = registered.base_from_ct;
    let base_from_work = base_from_ct * scene.ct_from_work;
    let solid = watch.run("solid", || solid(case, &scene));
    let reversed = with_other_spin(case);
    let mut plan_case = |case| {
        let start = Start { case, arm: &arm, scene: &scene, space: &space, solid: &solid, base_from_work };
        start.plan(&mut watch).map_err(|error| registered.blame(case, error))
    };
    let mut attempt = plan_case(case)?;
    let mut case = case;
    if let Some(reversed) = &reversed {
        // the other way is an offer: where it cannot be planned, the first stands
        if let Ok(other) = plan_case(reversed) {
            let is_gentler = other.compared.plan.score(reversed) < attempt.compared.plan.score(case);
            let is_worse = other.worst_ratio(reversed).is_some() && attempt.worst_ratio(case).is_none();
            if is_gentler && !is_worse && other.keeps_what(&attempt, case) {
                (case, attempt) = (reversed, other);
            }
        }
    }
    let Attempt { prepared, chosen, motion, demand, timing, coverage, compared, mode, instead } = attempt;
    let limits = speeds::path_limits(&arm)?;
    let Chosen { oriented, kinds, forces, costs, compliances, .. } = &chosen;
    let (points, near, moments) = (prepared.points(), &prepared.near, &prepared.reached.moments);

    let approach_from_ct = scene.ct_from_approach().inverse();
    let push =
        |i: usize| Push::new(forces[i].as_ref(), timing.caps_mm_s[i], compliances.as_ref().map(|c| &c[i]));
    let waypoints: Vec<Waypoint> = (0..points.len())
        .map(|i| {
            let axis = scene.ct_from_work.rotate(&oriented.axes[i]);
            let (theta_rad, phi_rad) = basis::angles_from_axis(&approach_from_ct.rotate(&axis));
            let cuts = moments[i].mass_mg() > 0.0;
            let speed_mm_s = timing.caps_mm_s[i];
            let push = push(i);
            let nearest = near[i].first();
            let toward = nearest.map(|n| push.toward(&n.proximity.toward));
            Waypoint {
                layer: points[i].layer,
                kind: kinds[i],
                time_s: timing.waypoint_times_s[i],
                position: scene.ct_from_work * points[i].position,
                axis,
                theta_rad,
                phi_rad,
                speed_mm_s,
                mass_mg: moments[i].mass_mg(),
                inertia: cuts.then(|| moments[i].inertia_normalised(&oriented.axes[i])),
                force_n: scene.ct_from_work.rotate(&push.force_n),
                force_toward_n: toward.map(|t| t.force_n),
                structure: nearest.map(|n| n.structure),
                distance_mm: nearest.map(|n| n.proximity.distance_mm),
                alpha1: nearest.map(|_| costs[i].alpha_1),
                cost: cuts.then_some(costs[i].cost),
                deflection_toward_um: toward.and_then(|t| t.deflection_um),
            }
        })
        .collect();
    let forces_toward = push::rows(near, &push, &scene.ct_from_work);
    let modelled = Modelled {
        waypoints: points.len(),
        cutting: moments.iter().filter(|m| m.mass_mg() > 0.0).count(),
        cost_with_force: oriented.with_force,
        cost_closed_form: oriented.closed_form,
        closed_form_error: chosen.closed_form_error,
        direction_spacing_rad: oriented.spacing_rad,
        low_pass_held: oriented.low_pass_held,
        blocked_turns: oriented.blocked_turns.len(),
        links_beyond_limit: prepared.beyond_limit,
        put_off: prepared.reached.put_off(),
        unjoined_passes: prepared.reached.path.unjoined,
        slowest_mm_s: motion::slowest_mm_s(&arm, &motion.resolved.q)?,
        stiffness: compliances.as_ref().and_then(|c| {
            motion::Stiffnesses::along(c, near.iter().map(|n| n.first().map(|n| &n.proximity.toward)))
        }),
        limit_ratios: timing.law.limit_ratios(&limits),
        time_at_caps_s: timing.at_caps_s,
        speed_levels: timing.levels.as_ref().map(|found| {
            let is_deflection = levels::is_deflection(case, &chosen);
            SpeedLevels::of(found, &demand.pushes, &timing.caps_mm_s, near, is_deflection)
        }),
        branch: motion.resolved.branch,
        lowest_link: motion::LowestLink::along(&arm, &motion.dense)?,
        raster_rad: half_turn(prepared.raster().frame.angle_rad() + scene.turn_rad),
        sense: prepared.raster().sense,
        layers: prepared.reached.path.layers,
        mode,
        instead,
    };
    warnings.extend(modelled.lowest_link.and_then(|lowest| lowest.warning()));
    let least = nearest_structures::least_distances(&scene, &path::centers(points));
    let radius_mm = case.burr.radius_mm;
    let figures = Figures::of(&waypoints, &forces_toward, prepared.length_mm(), &least, radius_mm);
    let dropped = prepared.reached.dropped.clone();
    let allowed = oriented.allowed.clone();
    let mut shortfalls: Vec<String> = target_outside(&scene).into_iter().collect();
    shortfalls.extend(registered.shortfalls(case));
    shortfalls.extend(rest::too_little(case, &scene, &space, &coverage)?);
    shortfalls.extend(unreached(case, &coverage, &modelled));
    match case.speed.total_time_s {
        Some(_) => shortfalls.extend(timing.missed.map(time_missed)),
        None => warnings.extend(timing.missed.map(nominal_time_missed)),
    }
    shortfalls.extend(demand.caps_missed(case, &prepared, &chosen));
    shortfalls.extend(turns_missed(mode, &oriented.blocked_turns));
    shortfalls.extend(limits_missed(&modelled.limit_ratios));
    warnings.extend(compared.warning(case));
    drop(prepared);
    let seconds = watch.seconds;
    let law = timing.law;
    Ok(Plan {
        case: case.clone(),
        inputs: files,
        waypoints,
        forces: forces_toward,
        law,
        arm,
        base_from_ct,
        fitted: registered.fitted,
        coverage,
        figures,
        compared,
        allowed,
        dropped,
        modelled,
        affines,
        warnings,
        shortfalls,
        seconds,
        scene,
    })
}

/// The case with its burr turning the other way, where it may and there is something to spare.
fn with_other_spin(case: &Case) -> Option<Case> {
    let may = case.burr.turns_both_ways && !case.structures.is_empty();
    may.then(|| Case { burr: Burr { spin: -case.burr.spin, ..case.burr }, ..case.clone() })
}

/// Turns that the whole sequence could not avoid. Greedy and fixed angles do not look ahead: theirs are only counted.
fn turns_missed(mode: OrientationMode, blocked: &[BlockedTurn]) -> Option<String> {
    let worst = blocked.iter().max_by(|a, b| a.missing_mm.total_cmp(&b.missing_mm))?;
    if mode != OrientationMode::Optimal {
        return None;
    }
    let missing = if worst.missing_mm.is_finite() {
        format!(
            "the room that it needs, {TRAJECTORY_TOLERANCE_MM} mm for the arm's tolerance included, is missed by up to {:.3} mm",
            worst.missing_mm
        )
    } else {
        "the handpiece is in the way".to_owned()
    };
    Some(format!(
        "the shank cannot turn as it must on {} (the worst to waypoint {}): {missing}; thinner layers or another shank may help",
        if blocked.len() == 1 { "1 move".to_owned() } else { format!("{} moves", blocked.len()) },
        worst.waypoint,
    ))
}

/// Why no target voxel can be reached.
fn why_nothing(scene: &Scene, radius_mm: f64) -> Result<&'static str, PlanError> {
    let without_structures = BurrSpace::new(scene, radius_mm, &[])?;
    Ok(if without_structures.reachable().contains(&true) {
        "the clearances of the structures leave no room for it: see structure.clearance_mm and the burr's radius"
    } else {
        "bone outside the target leaves no room for it, or closes every way in: see approach.direction, target and the \
         burr's radius"
    })
}

/// The direction of a line as an angle in (−π/2, π/2], rad.
pub fn half_turn(angle_rad: f64) -> f64 {
    let turned = angle_rad.rem_euclid(std::f64::consts::PI);
    if turned > std::f64::consts::FRAC_PI_2 { turned - std::f64::consts::PI } else { turned }
}

/// Where the burr's centre may be.
fn free_space<'a>(case: &Case, scene: &'a Scene) -> Result<BurrSpace<'a>, PlanError> {
    let radius_mm = case.burr.radius_mm;
    let space = BurrSpace::new(scene, radius_mm, &case.clearances_mm())?;
    if space.reachable().contains(&true) {
        Ok(space)
    } else {
        Err(PlanError::NothingReachable { radius_mm, reason: why_nothing(scene, radius_mm)? })
    }
}

/// A target that the scan does not hold.
fn target_outside(scene: &Scene) -> Option<String> {
    (scene.outside.share > TargetOutside::FEW_SHARE).then(|| {
        format!(
            "{} (expected at most {} %): it counts neither as target nor as removed; give a scan that holds the target or crop \
             the target to the scan",
            scene.outside.text(),
            100.0 * TargetOutside::FEW_SHARE
        )
    })
}

/// The time law's own promise, looked at on what it gave.
fn limits_missed(ratios: &LimitRatios) -> Option<String> {
    let LimitRatios { velocity, acceleration, jerk } = *ratios;
    let passed = [velocity, acceleration, jerk].into_iter().any(|ratio| ratio.is_nan() || ratio > 1.0 + 1e-6);
    passed.then(|| {
        format!(
            "joint limits are passed: velocity {velocity:.6}, acceleration {acceleration:.6}, jerk {jerk:.6} of what is allowed"
        )
    })
}

/// How many places were dropped for each reason.
pub fn dropped_by_reason(dropped: &[Dropped]) -> BTreeMap<&str, usize> {
    let mut counts = BTreeMap::new();
    for place in dropped {
        *counts.entry(place.reason.as_str()).or_insert(0) += 1;
    }
    counts
}

/// Less removed than the burr can reach.
fn unreached(case: &Case, coverage: &Coverage, modelled: &Modelled) -> Option<String> {
    let share = coverage.reached_share();
    let of_path = |cause: &Cause| matches!(cause, Cause::Shank(_) | Cause::Spacing);
    let parts = coverage.rest.iter().filter(|(cause, _)| of_path(cause));
    let mut why: Vec<String> =
        parts.map(|(cause, mm3)| format!("{mm3:.1} mm³ stay for the {}", cause.text(case))).collect();
    if modelled.unjoined_passes > 0 {
        why.push(format!("{} passes could not be joined", modelled.unjoined_passes));
    }
    (share < ENOUGH_REACHED).then(|| {
        format!(
            "only {} of what the burr can reach is removed (expected {:.0} %): {}",
            percent(share),
            100.0 * ENOUGH_REACHED,
            why.join("; "),
        )
    })
}

/// A time that the speeds do not allow.
fn time_missed((asked_s, got_s): (f64, f64)) -> String {
    format!(
        "speed.total_time_s = {asked_s} s cannot be met within the speed range: the nearest is {got_s:.1} s"
    )
}

/// The same where the case asks for none.
fn nominal_time_missed((asked_s, got_s): (f64, f64)) -> String {
    format!(
        "the time with every cut at speed.nominal_mm_s, {asked_s:.1} s, cannot be met with the least force: the plan takes \
         {got_s:.1} s (give speed.total_time_s for another time)"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_motion_beyond_a_limit_is_a_shortfall() {
        let ratios = |acceleration: f64| LimitRatios { velocity: 0.2, acceleration, jerk: 1.0 };
        assert_eq!(limits_missed(&ratios(1.0 + 1e-9)), None);
        assert!(limits_missed(&ratios(1.0003)).unwrap().contains("acceleration 1.000300"));
        assert!(limits_missed(&ratios(f64::NAN)).is_some());
    }
}
