//! What a plan needs that does not depend on spin, material, weights or speeds: scene, path, access and engagement; and the
//! choice of axes on it. So several variants of a case can be compared on one path, as D's trials are.

use std::path::Path;

use bonemill_arm::Arm;
use bonemill_arm::ur::Branches;
use bonemill_case::{Case, ForceTerm, OrientationMode, PathSpec, Sense, TowardTerm};
use bonemill_cutting::burr::{EngagedForce, ForceKernel, OrientationKernel};
use bonemill_cutting::cost::{Cost, CostModel, Proximity, Ranked, Terms};
use bonemill_geometry::Progress;
use bonemill_geometry::{Base, Rigid, Work};
use bonemill_motion::resolve::{Posture, Stiffness};
use bonemill_scene::Scene;
use bonemill_setup::nearest_structures::{self, NearStructure};
use bonemill_setup::tools;
use bonemill_toolpath::engagement::SweptPath;
use bonemill_toolpath::orientation::{Directions, RateLimit, TiltFamily};
use bonemill_toolpath::path::{self, MoveKind, PathPoint, PathSpacing, RasterFrame};
use bonemill_toolpath::space::BurrSpace;
use nalgebra::{Matrix3, Unit, Vector3};
use rayon::prelude::*;

use super::arm_axes::{ArmAxes, REFUSED_MM};
use super::attempt::Start;
use super::control::Felt;
use super::direction_sets::{self, Finer};
use super::motion::{Compliance, Motion, Placed};
use super::orient::{CostField, FreeAxes, Oriented, alone, orient};
use super::raster::Raster;
use super::reach::{self, ReachSpec, ReachedPath};
use super::{PlanError, Stopwatch, raster, tilt};

/// Steps of a draft's directions are this many times as long, in a plane and over a cap.
const DRAFT_COARSER: [f64; 2] = [2.0, 3.0];
/// Directions in which the choice of axes looks for bone, and how many make a sample. Forces are then summed over the nodes
/// of D4; with 4096 directions by 8, Σ C Δs + λ ∫ (da/ds)² ds of a mastoidectomy comes out 0.007 % lower.
pub(super) const CHOICE_SAMPLES: usize = 1024;
pub(super) const CHOICE_MERGED: usize = 2;
/// λ of the orientation's rate penalty, mm/rad² per unit of cost.
const RATE_WEIGHT_MM: f64 = 1.0;
/// A push toward a structure counts fully from this share of the force in a straight cut of the path's depth and stepover: with a
/// larger one small pushes are traded for efficiency, with a smaller one all pushes count alike.
const FULL_SHARE: f64 = 0.25;
/// Axes that the arm cannot follow and that are refused one after the other, at most.
const MOST_REFUSED: usize = 12;

/// Scene, path, access and engagement of a case.
#[derive(Debug)]
pub struct Prepared<'a> {
    /// Images as planned on.
    pub scene: &'a Scene,
    pub(super) base_from_work: Rigid<Base, Work>,
    pub(super) arm: &'a Arm,
    pub(super) family: Option<TiltFamily>,
    pub(super) directions: Directions,
    /// A finer cap to choose from near the best of these.
    finer: Option<Finer>,
    pub(super) rate: RateLimit,
    pub(super) reached: ReachedPath<'a>,
    arm_axes: ArmAxes,
    /// The branches of a UR that the case allows.
    branches: Option<Branches>,
    /// Links that graze a cusp where no axis within the tilt limit is free.
    pub(super) beyond_limit: usize,
    /// Per waypoint the nearest structure first, then others within influence.
    pub(super) near: Vec<Vec<NearStructure>>,
    feeds: Vec<Option<Unit<Vector3<f64>>>>,
    radius_mm: f64,
    raster: Raster,
}

/// Axes, and what they lead to at the nominal speed.
#[derive(Debug, Clone)]
pub struct Chosen {
    /// The axes, and how they came about.
    pub oriented: Oriented,
    /// What each move is for: one that removes material is a cut.
    pub kinds: Vec<MoveKind>,
    /// Force at any speed, where something is cut.
    pub forces: Vec<Option<EngagedForce>>,
    /// C with its parts, the force included everywhere.
    pub costs: Vec<Cost>,
    /// mm/N in work, when the stiffness is known.
    pub compliances: Option<Vec<Matrix3<f64>>>,
    /// The most by which a choice without the force is worse than one with it, in units of C.
    pub closed_form_error: f64,
}

impl<'a> Prepared<'a> {
    /// Lays the path, its lines as `raster` says or as the case and the structures decide, and finds what is free on it.
    ///
    /// # Errors
    /// When the arm cannot stand there, or the shank reaches nothing.
    pub(super) fn new(
        start: &Start<'a>,
        raster: Option<Raster>,
        watch: &mut Stopwatch,
    ) -> Result<Self, PlanError> {
        let Start { case, arm, scene, space, solid, base_from_work } = *start;
        let radius = case.burr.radius_mm;
        let spacing = spacing(case);
        let limit_rad = case.orientation.tilt_limit_rad;
        let family = (case.orientation.angles == 1).then(|| tilt::tilt_family(arm, &base_from_work, scene));
        let rate_rad_s = tilt::tilt_rate_rad_s(arm);
        let rate =
            RateLimit { weight_mm: RATE_WEIGHT_MM, most_rad_per_mm: rate_rad_s / case.speed.nominal_mm_s };
        let shank = tools::shank(case);
        let draft =
            direction_sets::one(family.as_ref(), limit_rad, DRAFT_COARSER[usize::from(family.is_none())]);
        let posture = case.robot.branch.map_or(Posture::Any, Posture::Of);
        let placed = Placed { arm, base_from_work: &base_from_work, posture };
        let asked = direction_sets::one(family.as_ref(), limit_rad, 1.0);
        let arm_axes = watch.run("arm", || ArmAxes::new(placed, space, asked));
        let spec = ReachSpec {
            radius_mm: radius,
            shank: &shank,
            solid,
            arm: &arm_axes,
            directions: &draft,
            rate,
            spacing,
        };
        let raster = match raster {
            Some(raster) => raster,
            None => watch.run("raster", || chosen_raster(case, scene, space, &spec, placed))?,
        };
        let lay = || raster.lay(case, scene, space, spacing);
        let path = watch.run("path", lay)?;
        let is_whole = family.is_none() && case.orientation.mode == OrientationMode::Optimal;
        let narrow =
            is_whole.then(|| direction_sets::coarse_and_finer(limit_rad, path.points.len())).flatten();
        let reach = |path, set: &Directions, watch: &mut Stopwatch| {
            watch
                .run("access", || reach::reached(scene, space, path, &ReachSpec { directions: set, ..spec }))
                .map_err(|why| PlanError::NoAccess { why, tilt_limit_deg: limit_rad.to_degrees() })
        };
        let plain = || direction_sets::one(family.as_ref(), limit_rad, 1.0);
        let (directions, finer, mut reached) = match narrow {
            None => {
                let set = plain();
                let reached = reach(path, &set, watch)?;
                (set, None, reached)
            }
            Some((coarse, finer)) => match reach(path, &coarse, watch) {
                Ok(reached) if !reached.is_changed() => (coarse, Some(finer), reached),
                // gaps between coarse directions are no reason to change the path
                _ => {
                    let (set, path) = (plain(), watch.run("path", lay)?);
                    let reached = reach(path, &set, watch)?;
                    (set, None, reached)
                }
            },
        };
        let points = &reached.path.points;
        let near =
            watch.run("engagement", || nearest_structures::along(case, scene, &path::centers(points)))?;
        let feeds = feeds(points);
        let cuts: Vec<bool> = reached.moments.iter().map(|m| m.mass_mg() > 0.0).collect();
        let beyond_limit =
            reach::limit_where_it_cuts(&mut reached, &cuts, &ReachSpec { directions: &directions, ..spec });
        Ok(Self {
            scene,
            arm,
            base_from_work,
            family,
            rate,
            near,
            feeds,
            radius_mm: radius,
            raster,
            beyond_limit,
            reached,
            directions,
            finer,
            arm_axes,
            branches: case.robot.branch,
        })
    }

    /// The waypoints.
    pub fn points(&self) -> &[PathPoint] {
        &self.reached.path.points
    }

    /// Length of the move that ends at each waypoint, mm.
    pub fn length_mm(&self) -> &[f64] {
        &self.reached.length_mm
    }

    /// Direction and order of the lines.
    pub fn raster(&self) -> Raster {
        self.raster
    }

    /// The burr's radius, mm.
    pub fn radius_mm(&self) -> f64 {
        self.radius_mm
    }

    /// The nearest structure of a waypoint.
    pub fn nearest(&self, i: usize) -> Option<&Proximity> {
        self.near[i].first().map(|n| &n.proximity)
    }

    /// What is chosen from.
    pub fn directions(&self) -> &Directions {
        &self.directions
    }

    /// Chooses axes by the case's mode. The case may differ from the one that was prepared in spin, material, weights,
    /// mode and speeds; what was prepared stays.
    ///
    /// # Errors
    /// When a parameter is out of range, or the deflection is asked for without a stiffness.
    pub fn choose(&self, case: &Case) -> Result<Chosen, PlanError> {
        let with_motion = case.robot.joint_stiffness.is_some();
        let mut watch = Stopwatch { progress: &(), seconds: Vec::new() };
        Ok(self.choose_timed(case, with_motion, &mut watch)?.0)
    }

    /// The axis that every waypoint would take if it were alone and the shaft could turn at once: no sequence has a lower cost.
    ///
    /// # Errors
    /// As [`Self::choose`].
    pub fn choose_alone(&self, case: &Case) -> Result<Chosen, PlanError> {
        let mut watch = Stopwatch { progress: &(), seconds: Vec::new() };
        Ok(self.chosen_by(case, alone, false, &mut watch)?.0)
    }

    /// What is felt along chosen axes at given speeds, mm/s per waypoint.
    pub fn felt(&self, case: &Case, chosen: &Chosen, speed_mm_s: &[f64]) -> Felt {
        Felt::of(case, self.length_mm(), &chosen.forces, &self.near, |i| speed_mm_s[i])
    }

    /// [`Self::choose`] with the motion that leads through these axes. Where the arm cannot follow them, the axis at which it
    /// ends is refused, and axes are chosen anew.
    pub(super) fn choose_with_motion(
        &mut self,
        case: &Case,
        watch: &mut Stopwatch,
    ) -> Result<(Chosen, Motion), PlanError> {
        let mut found = self.choose_timed(case, true, watch);
        for _ in 0..MOST_REFUSED {
            match found {
                Err(PlanError::OutOfReach { waypoint, axis, .. }) if self.refuse(waypoint, axis) => {}
                _ => break,
            }
            found = self.choose_timed(case, true, watch);
        }
        let (chosen, motion) = found?;
        // it was asked for
        let motion = motion.map_or_else(|| self.motion(case, &chosen.oriented.axes), Ok)?;
        Ok((chosen, motion))
    }

    /// Takes an axis that the arm cannot follow to away from the waypoints around; whether each has another left.
    fn refuse(&mut self, waypoint: usize, axis: Unit<Vector3<f64>>) -> bool {
        let at = self.reached.path.points[waypoint].position;
        self.arm_axes.refuse(at, axis);
        let axes = self.directions.axes();
        let is_near = |point: &PathPoint| point.position.distance_mm(&at) <= REFUSED_MM;
        for (i, point) in self.reached.path.points.iter().enumerate().filter(|(_, point)| is_near(point)) {
            self.reached.free.retain(i, |n| self.arm_axes.allows(point.position, &axes[n]));
        }
        (0..self.reached.free.len()).all(|i| self.reached.free.count(i) > 0)
    }

    fn choose_timed(
        &self,
        case: &Case,
        with_motion: bool,
        watch: &mut Stopwatch,
    ) -> Result<(Chosen, Option<Motion>), PlanError> {
        let mode = case.orientation.mode;
        self.chosen_by(case, |room, field| orient(mode, room, field), with_motion, watch)
    }

    fn chosen_by(
        &self,
        case: &Case,
        orient: impl FnOnce(&FreeAxes, &CostField) -> Oriented + Send,
        with_motion: bool,
        watch: &mut Stopwatch,
    ) -> Result<(Chosen, Option<Motion>), PlanError> {
        let points = self.points();
        let tool = tools::tool(&case.burr)?;
        let (material, measure) = tools::material(&case.material)?;
        let kernel = OrientationKernel::new(&tool, &material, measure, CHOICE_SAMPLES, CHOICE_MERGED);
        let swept = SweptPath::new(self.scene, &self.reached.path.removal, points, case.burr.radius_mm);
        let terms = terms(case, &self.near)?;
        let compliance = Compliance::new(case, self.placed())?;
        let center = self.scene.target_center;
        let allows = |axis: &Vector3<f64>| self.arm_axes.allows(center, axis);
        let of_cost = |set: &Directions| compliance.of_cost(case, center, set.axes(), allows);
        let coarse = of_cost(&self.directions)?;
        let field = CostField {
            swept: &swept,
            kernel: &kernel,
            material: &material,
            terms: &terms,
            moments: &self.reached.moments,
            feeds: &self.feeds,
            nominal_mm_s: case.speed.nominal_mm_s,
            spindle_rpm: case.burr.spindle_rpm,
            scale: scale(case, coarse.as_deref())?,
            compliance: coarse,
            finer_compliance: self.finer.as_ref().map_or(Ok(None), |(finer, _)| of_cost(finer))?,
        };
        let room = FreeAxes {
            reached: &self.reached,
            directions: &self.directions,
            finer: self.finer.as_ref(),
            family: self.family.as_ref(),
            rate: self.rate,
            arm: &self.arm_axes,
        };
        let oriented = watch.run("orientation", || orient(&room, &field));
        let force_kernel = ForceKernel::new(&tool, &material, &tools::discretisation(&tool, measure)?);
        let force = |i: usize| {
            let feed = self.feeds[i].filter(|_| self.reached.moments[i].mass_mg() > 0.0)?;
            let (speed, rpm) = (case.speed.nominal_mm_s, case.burr.spindle_rpm);
            let weight = |density| material.weight(density);
            let mut bone = swept.bone_at(i as u32, force_kernel.sample_radius_mm(), weight);
            Some(force_kernel.engaged_force(&oriented.axes[i], &feed, speed, rpm, &mut bone))
        };
        let (forces, motion): (Vec<_>, _) = watch.run("forces, inverse kinematics", || {
            rayon::join(
                || (0..points.len()).into_par_iter().map(force).collect(),
                || with_motion.then(|| self.motion(case, &oriented.axes)).transpose(),
            )
        });
        let motion = motion?;
        let compliances = motion.as_ref().map_or(Ok(None), |motion| compliance.along(&motion.resolved.q))?;
        // D13 takes C at the nominal speed
        let push = |i: usize| {
            let force =
                forces[i].map_or(Vector3::zeros(), |f: EngagedForce| f.force_n(case.speed.nominal_mm_s));
            match (case.cost.force, &compliances) {
                (ForceTerm::Deflection, Some(c)) => c[i] * force,
                _ => force,
            }
        };
        let cost_of = |i: usize, terms: &Terms| {
            let moments = &self.reached.moments[i];
            terms.cost(&push(i), moments.inertia_normalised(&oriented.axes[i]), moments.mass_mg())
        };
        let costs: Vec<Cost> = (0..points.len()).map(|i| cost_of(i, &terms[i])).collect();
        // what was left out is never negative: no choice with the force can be better by more than it
        let left_out = |i: usize| costs[i].cost - cost_of(i, &terms[i].without_force()).cost;
        let closed_form_error =
            (0..points.len()).filter(|i| !field.needs_force(*i)).map(left_out).fold(0.0, f64::max);
        let kinds = (0..points.len()).map(|i| self.kind(i, &oriented.axes[i])).collect();
        Ok((Chosen { oriented, kinds, forces, costs, compliances, closed_form_error }, motion))
    }

    /// The arm where it stands.
    fn placed(&self) -> Placed<'_> {
        let posture = self.branches.map_or(Posture::Any, Posture::Of);
        Placed { arm: self.arm, base_from_work: &self.base_from_work, posture }
    }

    /// Joint positions along the path with the shaft along `axes`; stiff toward structures where the case looks at the
    /// deflection.
    pub(super) fn motion(&self, case: &Case, axes: &[Unit<Vector3<f64>>]) -> Result<Motion, PlanError> {
        let positions = path::centers(self.points());
        let toward: Vec<_> = (0..positions.len()).map(|i| self.nearest(i).map(|near| near.toward)).collect();
        let stiff = case.robot.joint_stiffness.as_deref();
        let stiff = stiff.filter(|_| case.cost.force == ForceTerm::Deflection);
        let stiffness = stiff.map(|joint| Stiffness { joint, toward: &toward });
        let start = positions.first().zip(axes.first()).and_then(|(at, axis)| self.arm_axes.start(*at, axis));
        let placed = self.placed();
        let posture = start.map_or(placed.posture, Posture::From);
        Placed { posture, ..placed }.motion(&positions, axes, self.length_mm(), stiffness)
    }

    /// A link that grazes a cusp by a part of a voxel removes it: it is a cut, and as slow as one. The first waypoint is no
    /// move: its ball may touch a voxel's corner to rounding.
    fn kind(&self, i: usize, axis: &Vector3<f64>) -> MoveKind {
        let removes =
            i > 0 && self.reached.moments[i].mass_mg() > 0.0 && self.directions.is_within_limit(axis);
        if removes { MoveKind::Cut } else { self.points()[i].kind }
    }
}

/// The lines that the case asks for; of what it leaves open, those under which the structures feel least in a draft.
fn chosen_raster(
    case: &Case,
    scene: &Scene,
    space: &BurrSpace,
    spec: &ReachSpec,
    placed: Placed,
) -> Result<Raster, PlanError> {
    let frames = match case.path.raster_rad {
        Some(angle) => vec![RasterFrame::at_angle(angle - scene.turn_rad)],
        None => {
            let toward = raster::toward_structure(case, scene)?;
            let along = RasterFrame::chosen(&scene.target_hull_xy, toward, raster::mass_center(scene));
            vec![along, along.across()]
        }
    };
    let senses = match case.path.sense {
        Sense::Auto if case.structures.is_empty() => vec![Sense::Both],
        Sense::Auto => vec![Sense::Both, Sense::Away],
        given => vec![given],
    };
    let candidates: Vec<Raster> = senses
        .iter()
        .flat_map(|sense| frames.iter().map(|frame| Raster { frame: *frame, sense: *sense }))
        .collect();
    if candidates.len() == 1 {
        return Ok(candidates[0]);
    }
    let axes = spec.directions.axes();
    let (compliance, center) = (Compliance::new(case, placed)?, scene.target_center);
    let compliance = compliance.of_cost(case, center, axes, |axis| spec.arm.allows(center, axis))?;
    raster::least_felt(case, scene, space, spec, compliance.as_deref(), &candidates)
}

/// How close the path's layers, lines and waypoints are.
pub(super) fn spacing(case: &Case) -> PathSpacing {
    let PathSpec { layer_mm, stepover_mm, step_mm, .. } = case.path;
    PathSpacing { layer_mm, stepover_mm, step_mm }
}

/// The push that counts fully in the choice of axes: [`FULL_SHARE`] of that in a cut beside its neighbour, N; where the cost looks at
/// the deflection what that push bends the arm, mm, in the mean over directions. None where its share of the whole push counts.
pub(super) fn scale(case: &Case, compliance: Option<&[Matrix3<f64>]>) -> Result<Option<f64>, PlanError> {
    if case.cost.toward == TowardTerm::Share {
        return Ok(None);
    }
    let force_n = FULL_SHARE * tools::side_cut_n(case)?;
    let mean = |c: &[Matrix3<f64>]| c.iter().map(|c| c.trace() / 3.0).sum::<f64>() / c.len() as f64;
    Ok(Some(force_n * compliance.map_or(1.0, mean)))
}

/// What the cost of each waypoint looks at.
pub(super) fn terms(case: &Case, near: &[Vec<NearStructure>]) -> Result<Vec<Terms>, PlanError> {
    let model = CostModel::new(case.cost.kappa_per_mm, case.cost.alpha_max)?;
    let ranked = |n: &NearStructure| {
        let priority = case.structures.get(n.structure).map_or(u32::MAX, |s| s.priority);
        Ranked { proximity: n.proximity, priority }
    };
    let of = |near: &Vec<NearStructure>| {
        model.terms(&near.iter().map(ranked).collect::<Vec<_>>(), case.cost.structures)
    };
    Ok(near.par_iter().map(of).collect())
}

/// Prepares a case whose images are read from files beside `case_path`, and hands it to `work`.
///
/// # Errors
/// As [`super::plan`], and what `work` returns.
pub fn with_prepared<R>(
    case: &Case,
    case_path: &Path,
    progress: &dyn Progress,
    work: impl FnOnce(&Prepared) -> Result<R, PlanError>,
) -> Result<R, PlanError> {
    let mut watch = Stopwatch { progress, seconds: Vec::new() };
    let arm = tools::arm(case, case_path.parent().unwrap_or(Path::new("")))?;
    let (images, _) = bonemill_setup::inputs::read_inputs(case, case_path)?;
    bonemill_setup::registration::fiducials_in_scan(&case.robot, images.ct.volume.grid())?;
    let scene = bonemill_setup::inputs::make_scene(case, &images)?;
    let space = super::free_space(case, &scene)?;
    let base_from_work =
        bonemill_setup::registration::registration(&case.robot, &scene)?.base_from_ct * scene.ct_from_work;
    let solid = super::solid(case, &scene);
    let (arm, scene, space, solid) = (&arm, &scene, &space, &solid);
    work(&Prepared::new(&Start { case, arm, scene, space, solid, base_from_work }, None, &mut watch)?)
}

/// Unit direction of the move that ends at each waypoint; that of the last real move where the burr only turns.
pub(super) fn feeds(points: &[PathPoint]) -> Vec<Option<Unit<Vector3<f64>>>> {
    let mut last = None;
    let mut feeds = vec![None; points.len().min(1)];
    for pair in points.windows(2) {
        last = Unit::try_new(pair[1].position - pair[0].position, 1e-9).or(last);
        feeds.push(last);
    }
    feeds
}
