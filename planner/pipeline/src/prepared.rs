//! What a plan needs that does not depend on [`super::Choices`]: the path, what the shank can reach on it, and its engagement.

use std::collections::HashSet;
use std::path::Path;

use bonemill_case::{Case, OrientationMode};
use bonemill_cutting::cost::Proximity;
use bonemill_cutting::cutter::ShankCylinder;
use bonemill_geometry::Progress;
use bonemill_setup::nearest_structures::{self, NearStructure};
use bonemill_setup::{Setup, Stopwatch, tools};
use bonemill_toolpath::orientation::{Directions, TiltFamily, TurnLimits, TurnPrice};
use bonemill_toolpath::path::{self, PathPoint, join_passes, put_off_points};
use bonemill_toolpath::scene::Scene;
use nalgebra::{Unit, Vector3};

use super::arm_axes::ArmAxes;
use super::direction_sets::{self, Finer};
use super::laid::{Raster, feeds, spacing};
use super::reach::{self, ReachSpec, ReachedPath};
use super::start::Start;
use super::{PlanError, tilt};

/// Steps of a draft's directions are this many times as long, in a plane and over a cap.
const DRAFT_COARSER: [f64; 2] = [2.0, 3.0];
/// λ of the orientation's rate penalty, mm/rad² per unit of cost.
const RATE_WEIGHT_MM: f64 = 1.0;

/// What the shaft of a case may do, before any path is laid.
#[derive(Debug, Clone)]
pub(super) struct ShaftFreedom {
    pub family: Option<TiltFamily>,
    pub turns: TurnLimits,
    pub shank: Vec<ShankCylinder>,
    /// The directions of drafts.
    pub draft: Directions,
    pub arm_axes: ArmAxes,
}

impl ShaftFreedom {
    /// Of a case's arm and tool.
    pub fn new(start: &Start, watch: &mut Stopwatch) -> Self {
        let Start { case, arm, scene, space, base_from_work, .. } = *start;
        let limit_rad = case.orientation.tilt_limit_rad;
        let family = (case.orientation.angles == 1).then(|| tilt::tilt_family(arm, &base_from_work, scene));
        let most_rad_per_mm = tilt::tilt_rate_rad_s(arm) / case.speed.nominal_mm_s;
        let asked = direction_sets::one(family.as_ref(), limit_rad, case.accuracy.axis_spacing_rad);
        Self {
            turns: TurnLimits { price: TurnPrice::Smoothness(RATE_WEIGHT_MM), most_rad_per_mm },
            shank: tools::shank(case),
            draft: direction_sets::one(
                family.as_ref(),
                limit_rad,
                case.accuracy.axis_spacing_rad * DRAFT_COARSER[usize::from(family.is_none())],
            ),
            arm_axes: watch.run("arm", || ArmAxes::new(start.placed(), space, asked)),
            family,
        }
    }

    /// What access depends on, for drafts.
    pub fn reach_spec<'b, 's>(&'b self, start: &Start<'s>) -> ReachSpec<'b, 's> {
        ReachSpec {
            start: *start,
            radius_mm: start.case.burr.radius_mm,
            shank: &self.shank,
            solid: start.solid,
            arm: &self.arm_axes,
            directions: &self.draft,
            turns: self.turns,
            spacing: spacing(start.case),
        }
    }
}

/// Scene, path, access and engagement of a case.
#[derive(Debug)]
pub struct Prepared<'a> {
    /// What it was prepared for; [`super::Choices`] may replace a part of its case.
    pub(super) start: Start<'a>,
    pub(super) family: Option<TiltFamily>,
    pub(super) directions: Directions,
    /// A finer cap to choose from near the best of these.
    pub(super) finer: Option<Finer>,
    pub(super) turns: TurnLimits,
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
    /// Lays the path along `raster` and finds what is free on it. `later`: an earlier path along it, and the points of its passes
    /// that are put off to the end.
    ///
    /// # Errors
    /// When the arm cannot stand there, or the shank reaches nothing.
    pub(super) fn new(
        start: &Start<'a>,
        freedom: &ShaftFreedom,
        raster: Raster,
        later: Option<(&ReachedPath, &HashSet<(u32, u32)>)>,
        watch: &mut Stopwatch,
    ) -> Result<Self, PlanError> {
        let Start { case, scene, space, .. } = *start;
        let (spacing, limit_rad) = (spacing(case), case.orientation.tilt_limit_rad);
        let step_rad = case.accuracy.axis_spacing_rad;
        let ShaftFreedom { family, turns, arm_axes, .. } = freedom;
        let spec = freedom.reach_spec(start);
        let lay = || match later {
            None => raster.lay(case, scene, space, spacing),
            Some((ReachedPath { path, .. }, points)) => {
                let passes = put_off_points(&path.passes, points, path.layers);
                Ok(join_passes(space, spacing, passes, path.layers))
            }
        };
        let path = watch.run("path", lay)?;
        let set_apart = reach::set_apart(&path);
        let is_whole = family.is_none() && case.orientation.mode == OrientationMode::Optimal;
        let narrow = is_whole
            .then(|| direction_sets::coarse_and_finer(limit_rad, step_rad, path.points.len()))
            .flatten();
        let reach = |path, set: &Directions, watch: &mut Stopwatch| {
            watch
                .run("access", || reach::reached(scene, space, path, &ReachSpec { directions: set, ..spec }))
                .map_err(|why| PlanError::NoAccess { why, tilt_limit_deg: limit_rad.to_degrees() })
        };
        let plain = || direction_sets::one(family.as_ref(), limit_rad, case.accuracy.axis_spacing_rad);
        let (directions, finer, mut reached) = match narrow {
            None => {
                let set = plain();
                let reached = reach(path, &set, watch)?;
                (set, None, reached)
            }
            Some((coarse, finer)) => match reach(path, &coarse, watch) {
                Ok(reached) if !reached.is_changed(set_apart) => (coarse, Some(finer), reached),
                // gaps between coarse directions are no reason to change the path
                _ => {
                    let (set, path) = (plain(), watch.run("path", lay)?);
                    let reached = reach(path, &set, watch)?;
                    (set, None, reached)
                }
            },
        };
        if let Some((earlier, _)) = later {
            reached.dropped.splice(0..0, earlier.dropped.iter().cloned());
        }
        let points = &reached.path.points;
        let near =
            watch.run("engagement", || nearest_structures::along(case, scene, &path::centers(points)))?;
        let feeds = feeds(points);
        let cuts: Vec<bool> = reached.moments.iter().map(|m| m.mass_mg() > 0.0).collect();
        let beyond_limit =
            reach::limit_where_it_cuts(&mut reached, &cuts, &ReachSpec { directions: &directions, ..spec });
        Ok(Self {
            start: *start,
            family: *family,
            turns: *turns,
            near,
            feeds,
            raster,
            beyond_limit,
            reached,
            directions,
            finer,
            arm_axes: arm_axes.clone(),
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
    work(&Start::new(&setup, &space, &solid).prepared(&mut watch)?)
}
