//! The whole way: a case to a plan.
//!
//! images → scene → free space → path with its removal times → access → engagement → orientation → forces → speed →
//! joint trajectory. Every stage takes values and hands values on; none keeps state. What a stage cannot do is a
//! result with its reason ([`Plan::shortfalls`]), an error only where nothing sensible can be planned.

mod error;
mod figures;
mod inputs;
mod known;
mod metrics;
mod near;
mod orient;
mod reach;
mod setup;
mod speeds;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

use bonemill_geometry::{Base, Ct, Point, Rigid, Work, basis};
use bonemill_imaging::{AffineReport, Scene};
use bonemill_robot::Arm;
use bonemill_robot::arm::bone_attached;
use bonemill_robot::timelaw::TimeLaw;
use nalgebra::{Matrix3, Unit, Vector3};
use rayon::prelude::*;

pub use error::PlanError;
pub use figures::{Figures, StructureFigures};
pub use metrics::{Coverage, Volumes};

use crate::Progress;
use crate::burr::{ForceKernel, OrientationKernel};
use crate::case::{Case, ForceTerm};
use crate::cost::CostModel;
use crate::engagement::{SweptPath, mass_increments};
use crate::metrics::Moments;
use crate::orientation::Scan;
use crate::orientation::optimal::RateLimit;
use crate::path::{MoveKind, PathPoint, PathSpacing, RasterFrame, lay_path};
use crate::plan::{Sha256, Waypoint};
use crate::space::BurrSpace;

/// Step of the orientation scan, rad.
const SCAN_STEP_RAD: f64 = 2.0 * std::f64::consts::PI / 180.0;
/// λ of the orientation's rate penalty, mm/rad² per unit of cost.
const RATE_WEIGHT_MM: f64 = 1.0;
/// Share of the reachable volume below which a plan fell short.
const ENOUGH_REACHED: f64 = 0.99;
/// A plan with all that its files and its report say.
#[derive(Debug)]
pub struct Plan {
    /// The case, resolved.
    pub case: Case,
    /// Every input as named in the case, with its file and digest; the case file first, when there is one.
    pub inputs: Vec<(String, PathBuf, Sha256)>,
    /// The rows of `waypoints.csv`.
    pub waypoints: Vec<Waypoint>,
    /// The motion of the joints.
    pub law: TimeLaw,
    /// The arm.
    pub arm: Arm,
    /// Registration used.
    pub base_from_ct: Rigid<Base, Ct>,
    /// Images as planned on.
    pub scene: Scene,
    /// Volumes.
    pub coverage: Coverage,
    /// Forces, times and distances in one number each.
    pub figures: Figures,
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
    /// Waypoints at which the low-pass was held at a free angle.
    pub low_pass_held: usize,
    /// Waypoints dropped, by reason.
    pub dropped: BTreeMap<&'static str, usize>,
    /// Passes that no link could join.
    pub unjoined_passes: usize,
    /// Angle of the raster lines from work x as plans call it ([`bonemill_geometry::Approach`]), rad in (−π/2, π/2].
    pub raster_rad: f64,
    /// Milling layers.
    pub layers: u32,
}

/// Notes how long each stage took.
struct Stopwatch<'a> {
    progress: &'a dyn Progress,
    seconds: Vec<(&'static str, f64)>,
}

impl Stopwatch<'_> {
    fn run<T>(&mut self, stage: &'static str, work: impl FnOnce() -> T) -> T {
        self.progress.stage(stage);
        let start = Instant::now();
        let result = work();
        self.seconds.push((stage, start.elapsed().as_secs_f64()));
        result
    }
}

/// Plans a case; paths in it are relative to the folder of `case_path`.
///
/// # Errors
/// [`PlanError`] for images that cannot be read or trusted, targets that cannot be planned for, and features that the
/// case asks for and this version does not have.
pub fn plan(case: &Case, case_path: &Path, progress: &dyn Progress) -> Result<Plan, PlanError> {
    let mut watch = Stopwatch { progress, seconds: Vec::new() };
    let arm = setup::arm(case)?;
    let inputs = watch.run("read images", || inputs::read_inputs(case, case_path))?;
    let scene = watch.run("scene", || inputs::make_scene(case, &inputs))?;
    let inputs::Inputs { ct, labels, files, mut warnings, .. } = inputs;
    let affines = [ct.affine, labels.affine];
    drop((ct, labels)); // the scene holds what is needed of them
    warnings.extend(scene.warnings.iter().cloned());

    let clearances: Vec<f64> = case.structures.iter().map(|s| s.clearance_mm).collect();
    let shank_clearances: Vec<f64> = case.structures.iter().map(|s| s.shank_clearance_mm).collect();
    let radius = case.burr.radius_mm;
    let space = watch.run("free space", || BurrSpace::new(&scene, radius, &clearances))?;
    if !space.reachable().contains(&true) {
        return Err(PlanError::NothingReachable { radius_mm: radius, reason: why_nothing(&scene, radius)? });
    }
    let spacing = PathSpacing {
        layer_mm: case.path.layer_mm,
        stepover_mm: case.path.stepover_mm,
        step_mm: case.path.step_mm,
    };
    let frame = match case.path.raster_rad {
        Some(angle) => RasterFrame::at_angle(angle - scene.turn_rad),
        None => RasterFrame::chosen(&scene.target_hull_xy, toward_structure(&scene, &clearances, radius)?),
    };
    let path = watch.run("path", || lay_path(&space, spacing, &frame));

    let base_from_ct = setup::base_from_ct(&case.robot.base_from_ct, &scene);
    let base_from_work = base_from_ct * scene.ct_from_work;
    let family = setup::tilt_family(&arm, &base_from_work);
    let scan = Scan::new(&family, SCAN_STEP_RAD, case.orientation.tilt_limit_rad);
    let rate = RateLimit {
        weight_mm: RATE_WEIGHT_MM,
        most_rad_per_mm: arm.joints()[3].velocity_limit / case.speed.nominal_mm_s,
    };
    let shank = setup::shank(case);
    let spec = reach::ReachSpec {
        shank: &shank,
        shank_clearances_mm: &shank_clearances,
        scan: &scan,
        rate,
        spacing,
    };
    let reached = watch
        .run("access", || reach::reached(&scene, &space, path, &spec))
        .ok_or(PlanError::NoAccess { tilt_limit_deg: case.orientation.tilt_limit_rad.to_degrees() })?;
    let points = &reached.path.points;

    let (near, moments) = watch.run("engagement", || {
        rayon::join(
            || near::nearest_structures(&scene, &clearances, radius, points),
            || mass_increments(&scene.density_g_cm3, points, radius),
        )
    });
    let near = near?;
    let feeds = feeds(points);
    let tool = setup::tool(&case.burr)?;
    let (material, measure) = setup::material(&case.material)?;
    let model = CostModel::new(case.cost.kappa_per_mm, case.cost.alpha_max)?;
    let swept = SweptPath::new(&scene, &reached.path.removal, points, radius);
    let (samples, merged) = (OrientationKernel::DEFAULT_SAMPLES, OrientationKernel::DEFAULT_MERGED);
    let kernel = OrientationKernel::new(&tool, &material, measure, samples, merged);
    let compliance = Compliance::new(case, &arm, &base_from_work)?;
    let field = orient::CostField {
        swept: &swept,
        kernel: &kernel,
        material: &material,
        model: &model,
        near: &near,
        moments: &moments,
        feeds: &feeds,
        nominal_mm_s: case.speed.nominal_mm_s,
        spindle_rpm: case.burr.spindle_rpm,
        compliance: match case.cost.force {
            ForceTerm::Deflection => compliance.at_angles(&scan.angles_rad)?,
            ForceTerm::Cutting => None,
        },
    };
    let oriented = watch
        .run("orientation", || orient::orient(case.orientation.mode, &reached, &family, &scan, &field, rate));

    let force_kernel = ForceKernel::new(&tool, &material, &setup::discretisation(&tool, measure)?);
    let forces = watch.run("forces", || {
        (0..points.len())
            .into_par_iter()
            .map(|i| {
                let feed = feeds[i].filter(|_| moments[i].mass_mg() > 0.0)?;
                let (mut bone, axis) = (swept.bone_at(i as u32), family.axis(oriented.angles_rad[i]));
                let at = force_kernel.sample_radius_mm();
                let weight = |density| material.weight(density);
                Some(force_kernel.engaged_force_over(
                    &axis,
                    &feed,
                    case.speed.nominal_mm_s,
                    case.burr.spindle_rpm,
                    |n, patch| bone.mean_weight(&(n * at), |g| patch.sides_mm(g), weight),
                ))
            })
            .collect::<Vec<_>>()
    });

    let q =
        watch.run("inverse kinematics", || joints(&arm, &base_from_work, points, &oriented.angles_rad))?;
    let compliances: Vec<Option<Matrix3<f64>>> = compliance
        .at_angles(&oriented.angles_rad)?
        .map_or_else(|| vec![None; points.len()], |all| all.into_iter().map(Some).collect());
    // D13 takes C at the nominal speed
    let costs: Vec<_> = (0..points.len())
        .map(|i| {
            let nominal = forces[i].map_or(Vector3::zeros(), |f| f.force_n(case.speed.nominal_mm_s));
            let push = match (case.cost.force, &compliances[i]) {
                (ForceTerm::Deflection, Some(c)) => c * nominal,
                _ => nominal,
            };
            let axis = family.axis(oriented.angles_rad[i]);
            let proximity = near[i].as_ref().map(|n| &n.proximity);
            model.cost(&push, proximity, moments[i].inertia_normalised(&axis), moments[i].mass_mg())
        })
        .collect();
    // a link that grazes a cusp by a part of a voxel removes it: it is a cut, and as slow as one
    let within_limit = |i: usize| scan.within_limit >> scan.nearest(oriented.angles_rad[i]) & 1 == 1;
    let removes = |i: usize| moments[i].mass_mg() > 0.0 && within_limit(i);
    let kinds: Vec<_> =
        points.iter().enumerate().map(|(i, p)| if removes(i) { MoveKind::Cut } else { p.kind }).collect();
    let mass_mg: Vec<_> = moments.iter().map(Moments::mass_mg).collect();
    let cost: Vec<_> = costs.iter().map(|c| c.cost).collect();
    let speed_input = speeds::SpeedInput {
        kinds: &kinds,
        length_mm: &reached.length_mm,
        mass_mg: &mass_mg,
        cost: &cost,
        dense: &q,
        step_mm: case.path.step_mm,
        slot_mass_mg: std::f64::consts::PI
            * radius
            * radius
            * case.path.step_mm
            * case.material.rho_ref_g_cm3,
    };
    let limits = speeds::path_limits(&arm)?;
    let timing = watch.run("time law", || speeds::timing(&speed_input, &case.speed, case.paper, &limits))?;
    let coverage =
        watch.run("coverage", || metrics::coverage(&scene, &space, &reached.path.removal, points))?;

    let approach_from_ct = scene.ct_from_approach().inverse();
    let waypoints: Vec<Waypoint> = (0..points.len())
        .map(|i| {
            let axis = scene.ct_from_work.rotate(&family.axis(oriented.angles_rad[i]));
            let (theta_rad, phi_rad) = basis::angles_from_axis(&approach_from_ct.rotate(&axis));
            let cuts = moments[i].mass_mg() > 0.0;
            let speed_mm_s = timing.caps_mm_s[i];
            let force = forces[i].map(|f| f.force_n(speed_mm_s));
            let toward = near[i].as_ref().map(|n| n.proximity.toward);
            let towards = |push: Vector3<f64>| toward.map(|u| push.dot(&u).max(0.0));
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
                inertia: cuts.then(|| moments[i].inertia_normalised(&family.axis(oriented.angles_rad[i]))),
                force_n: force.map(|f| scene.ct_from_work.rotate(&f)),
                force_toward_n: force.and_then(towards),
                structure: near[i].as_ref().map(|n| n.structure),
                distance_mm: near[i].as_ref().map(|n| n.proximity.distance_mm),
                alpha1: near[i].as_ref().map(|_| costs[i].alpha_1),
                cost: cuts.then_some(costs[i].cost),
                deflection_toward_um: force
                    .zip(compliances[i])
                    .and_then(|(f, c)| towards(c * f))
                    .map(|mm| mm * 1e3),
            }
        })
        .collect();
    let modelled = Modelled {
        waypoints: points.len(),
        cutting: mass_mg.iter().filter(|m| **m > 0.0).count(),
        cost_with_force: oriented.with_force,
        cost_closed_form: oriented.closed_form,
        low_pass_held: oriented.held,
        dropped: reached.dropped.clone(),
        unjoined_passes: reached.path.unjoined,
        raster_rad: half_turn(frame.angle_rad() + scene.turn_rad),
        layers: reached.path.layers,
    };
    let figures = Figures::of(&waypoints, &reached.length_mm, case.structures.len());
    let shortfalls = shortfalls(&coverage, &modelled, case.speed.total_time_s.zip(timing.missed_s));
    let seconds = watch.seconds;
    let law = timing.law;
    Ok(Plan {
        case: case.clone(),
        inputs: files,
        waypoints,
        law,
        arm,
        base_from_ct,
        coverage,
        figures,
        modelled,
        affines,
        warnings,
        shortfalls,
        seconds,
        scene,
    })
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

/// Direction in the layer from the target's centre to the structure that is nearest less its clearance.
fn toward_structure(
    scene: &Scene,
    clearances_mm: &[f64],
    radius_mm: f64,
) -> Result<Option<[f64; 2]>, PlanError> {
    let near = near::nearest_structure(scene, clearances_mm, radius_mm, scene.target_center)?;
    Ok(near.map(|n| [n.proximity.toward.x, n.proximity.toward.y]))
}

/// The direction of a line as an angle in (−π/2, π/2], rad.
fn half_turn(angle_rad: f64) -> f64 {
    let turned = angle_rad.rem_euclid(std::f64::consts::PI);
    if turned > std::f64::consts::FRAC_PI_2 { turned - std::f64::consts::PI } else { turned }
}

/// Unit direction of the move that ends at each waypoint; that of the last real move where the burr only turns.
fn feeds(points: &[PathPoint]) -> Vec<Option<Unit<Vector3<f64>>>> {
    let mut last = None;
    let mut feeds = vec![None; points.len().min(1)];
    for pair in points.windows(2) {
        last = Unit::try_new(pair[1].position - pair[0].position, 1e-9).or(last);
        feeds.push(last);
    }
    feeds
}

/// Largest change of tilt in one piece of the joint path, rad: the arm swings about a pivot, and between two joint positions
/// the burr bows out of its line by L Δq²/8, 0.006 mm at 50 mm.
const TILT_PIECE_RAD: f64 = 0.03;

/// Joint positions along the path: every waypoint, and as many places between two as the tilt needs.
fn joints(
    arm: &Arm,
    base_from_work: &Rigid<Base, Work>,
    points: &[PathPoint],
    angles_rad: &[f64],
) -> Result<speeds::DensePath, PlanError> {
    let mut dense = speeds::DensePath::default();
    for (i, (point, angle)) in points.iter().zip(angles_rad).enumerate() {
        let before = i.saturating_sub(1);
        let (from, from_angle) = (points[before].position, angles_rad[before]);
        let pieces = ((angle - from_angle).abs() / TILT_PIECE_RAD).ceil().max(1.0) as usize;
        let first = if i == 0 { pieces } else { 1 };
        for n in first..=pieces {
            let t = n as f64 / pieces as f64;
            let position = from + (point.position - from) * t;
            let q = bone_attached::ik(*base_from_work * position, from_angle + (angle - from_angle) * t);
            if let Some(excess) = bone_attached::beyond_limits(arm, &q) {
                return Err(PlanError::OutOfReach { waypoint: i, excess: excess.to_string() });
            }
            dense.push(&q, from.distance_mm(&point.position) / pieces as f64);
        }
        dense.end_waypoint();
    }
    Ok(dense)
}

/// The arm's compliance, when its stiffness is known.
struct Compliance<'a> {
    arm: &'a Arm,
    stiffness: Option<&'a [f64]>,
    base_from_work: &'a Rigid<Base, Work>,
}

impl<'a> Compliance<'a> {
    fn new(case: &'a Case, arm: &'a Arm, base_from_work: &'a Rigid<Base, Work>) -> Result<Self, PlanError> {
        let stiffness = case.robot.joint_stiffness.as_deref();
        if stiffness.is_none() && case.cost.force == ForceTerm::Deflection {
            return Err(PlanError::StiffnessMissing);
        }
        Ok(Self { arm, stiffness, base_from_work })
    }

    /// mm/N in work per angle. The linear joints only shift the arm: its compliance depends on the tilt alone.
    fn at_angles(&self, angles_rad: &[f64]) -> Result<Option<Vec<Matrix3<f64>>>, PlanError> {
        let Some(stiffness) = self.stiffness else { return Ok(None) };
        let turn = self.base_from_work.rotation.into_inner();
        let one = |angle: &f64| -> Result<_, PlanError> {
            let q = bone_attached::ik(Point::new(0.0, 0.0, 0.0), *angle);
            Ok(turn.transpose() * self.arm.compliance(&q, stiffness)? * turn)
        };
        angles_rad.iter().map(one).collect::<Result<Vec<_>, _>>().map(Some)
    }
}

fn shortfalls(coverage: &Coverage, modelled: &Modelled, time: Option<(f64, f64)>) -> Vec<String> {
    let mut reasons = Vec::new();
    let share = coverage.reached_share();
    if share < ENOUGH_REACHED {
        let mut why: Vec<String> =
            modelled.dropped.iter().map(|(why, n)| format!("{n} waypoints: {why}")).collect();
        if modelled.unjoined_passes > 0 {
            why.push(format!("{} passes could not be joined", modelled.unjoined_passes));
        }
        reasons.push(format!(
            "only {:.1} % of what the burr can reach is removed (expected {:.0} %): {}",
            100.0 * share,
            100.0 * ENOUGH_REACHED,
            if why.is_empty() { "the path's spacing is too wide".into() } else { why.join("; ") },
        ));
    }
    if let Some((asked_s, got_s)) = time {
        reasons.push(format!(
            "speed.total_time_s = {asked_s} s cannot be met within the speed range: the nearest is {got_s:.1} s"
        ));
    }
    reasons
}
