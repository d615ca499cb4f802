//! What a plan needs that does not depend on [`super::Choices`]: the path, what the shank can reach on it, and its engagement.

use std::path::Path;

use bonemill_armpath::{Compliance, Placed};
use bonemill_case::{Case, OrientationMode, PathSpec, Sense};
use bonemill_cutting::cost::Proximity;
use bonemill_geometry::Progress;
use bonemill_scene::Scene;
use bonemill_setup::nearest_structures::{self, NearStructure};
use bonemill_setup::{Setup, Stopwatch, tools};
use bonemill_toolpath::orientation::{Directions, RateLimit, TiltFamily};
use bonemill_toolpath::path::{self, PathPoint, PathSpacing, RasterFrame};
use bonemill_toolpath::space::BurrSpace;
use nalgebra::{Unit, Vector3};

use super::arm_axes::ArmAxes;
use super::attempt::Start;
use super::direction_sets::{self, Finer};
use super::raster::Raster;
use super::reach::{self, ReachSpec, ReachedPath};
use super::{PlanError, raster, tilt};

/// Steps of a draft's directions are this many times as long, in a plane and over a cap.
const DRAFT_COARSER: [f64; 2] = [2.0, 3.0];
/// λ of the orientation's rate penalty, mm/rad² per unit of cost.
const RATE_WEIGHT_MM: f64 = 1.0;

/// Scene, path, access and engagement of a case.
#[derive(Debug)]
pub struct Prepared<'a> {
    /// What it was prepared for; [`super::Choices`] may replace a part of its case.
    pub(super) start: Start<'a>,
    pub(super) family: Option<TiltFamily>,
    pub(super) directions: Directions,
    /// A finer cap to choose from near the best of these.
    pub(super) finer: Option<Finer>,
    pub(super) rate: RateLimit,
    pub(super) reached: ReachedPath<'a>,
    pub(super) arm_axes: ArmAxes,
    /// Links that graze a cusp where no axis within the tilt limit is free.
    pub(super) beyond_limit: usize,
    /// Per waypoint the nearest structure first, then others within influence.
    pub(super) near: Vec<Vec<NearStructure>>,
    pub(super) feeds: Vec<Option<Unit<Vector3<f64>>>>,
    raster: Raster,
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
        let spacing = spacing(case);
        let limit_rad = case.orientation.tilt_limit_rad;
        let family = (case.orientation.angles == 1).then(|| tilt::tilt_family(arm, &base_from_work, scene));
        let rate_rad_s = tilt::tilt_rate_rad_s(arm);
        let rate =
            RateLimit { weight_mm: RATE_WEIGHT_MM, most_rad_per_mm: rate_rad_s / case.speed.nominal_mm_s };
        let shank = tools::shank(case);
        let draft =
            direction_sets::one(family.as_ref(), limit_rad, DRAFT_COARSER[usize::from(family.is_none())]);
        let placed = start.placed();
        let asked = direction_sets::one(family.as_ref(), limit_rad, 1.0);
        let arm_axes = watch.run("arm", || ArmAxes::new(placed, space, asked));
        let spec = ReachSpec {
            radius_mm: case.burr.radius_mm,
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
            start: *start,
            family,
            rate,
            near,
            feeds,
            raster,
            beyond_limit,
            reached,
            directions,
            finer,
            arm_axes,
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

    /// Images as planned on.
    pub fn scene(&self) -> &'a Scene {
        self.start.scene
    }

    /// The burr's radius, mm.
    pub fn radius_mm(&self) -> f64 {
        self.start.case.burr.radius_mm
    }

    /// The nearest structure of a waypoint.
    pub fn nearest(&self, i: usize) -> Option<&Proximity> {
        self.near[i].first().map(|n| &n.proximity)
    }

    /// What is chosen from.
    pub fn directions(&self) -> &Directions {
        &self.directions
    }
}

/// The lines that the case gives; what it leaves open is chosen by the least force toward the structures in drafts.
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
    raster::Drafts { case, scene, space, spec, compliance: compliance.as_deref() }.least_felt(&candidates)
}

/// How close the path's layers, lines and waypoints are.
pub(super) fn spacing(case: &Case) -> PathSpacing {
    let PathSpec { layer_mm, stepover_mm, step_mm, .. } = case.path;
    PathSpacing { layer_mm, stepover_mm, step_mm }
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
    let mut watch = Stopwatch::new(progress);
    let setup = Setup::read(case, case_path, &mut watch)?;
    let space = super::free_space(&setup.case, &setup.scene)?;
    let solid = super::shank_obstacles(&setup.case, &setup.scene);
    work(&Prepared::new(&Start::new(&setup, &space, &solid), None, &mut watch)?)
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
