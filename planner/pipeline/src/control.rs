//! The forces toward the structures without the planner's choices: the control of Dillon's trials, in the plan's time.
//!
//! A control mills the same target with the shaft along the approach and every cut at one speed, along lines in one direction. There
//! are two, with lines in the plan's direction and across. Its shank is not checked: it may collide, and the control is
//! compared all the same. Distances and figures come from the same functions as the plan's, forces from the sums by which axes are chosen;
//! both are timed by their speed caps, without the joints' accelerations.
//!
//! **Source:** Dillon et al. 2016, section III: trial 1, and trial 3 at equal time.

use bonemill_case::{Case, Structure};
use bonemill_cutter::Ball;
use bonemill_cutting::burr::{EngagedForce, EngagedSamples, Feed, OrientationKernel};
use bonemill_planfile::toward::{StructureFigures, TowardFigures, TowardSpan};
use bonemill_scene::Scene;
use bonemill_setup::nearest_structures::{self, NearStructure};
use bonemill_setup::tools;
use bonemill_toolpath::engagement::SweptPath;
use bonemill_toolpath::path::{self, MillPath, MoveKind};
use nalgebra::Vector3;
use rayon::prelude::*;

use super::PlanError;
use super::choose::{CHOICE_MERGED, CHOICE_SAMPLES};
use super::prepared::feeds;
use super::reach::lengths;

/// Toward a structure, a force up to this counts as none, N: assumed.
const NOTHING_N: f64 = 0.01;
/// Figures that differ by no more than this share count as the same: a control's forces are the coarser sums by which axes are chosen, 2 %
/// off at the worst.
const SAME_SHARE: f64 = 0.02;

/// The forces of a path with the shaft along the approach, at any speed.
#[derive(Debug)]
pub(super) struct ControlPath {
    raster_rad: f64,
    length_mm: Vec<f64>,
    forces: Vec<Option<EngagedForce>>,
    near: Vec<Vec<NearStructure>>,
    /// Time of the links, s, and length of the cuts, mm.
    links_s: f64,
    cuts_mm: f64,
}

/// Forces at given speeds.
#[derive(Debug, Clone, PartialEq)]
pub struct StructureForces {
    /// Mean force by time, N.
    pub mean_n: f64,
    /// Largest force, N.
    pub peak_n: f64,
    /// Per structure of the case.
    pub structures: Vec<StructureFigures>,
}

/// One control.
#[derive(Debug, Clone, PartialEq)]
pub struct Control {
    /// Angle of its lines from work x, rad.
    pub raster_rad: f64,
    /// Speed of its cuts, mm/s.
    pub speed_mm_s: f64,
    /// Its forces.
    pub forces: StructureForces,
}

/// A plan beside its controls.
#[derive(Debug, Clone, PartialEq)]
pub struct Compared {
    /// Lines in the plan's direction, and across; none where there is nothing to spare.
    pub controls: Vec<Control>,
    /// The plan.
    pub plan: StructureForces,
}

/// A figure in which a plan is worse than the better of its controls.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Worse {
    /// Number of the structure in the case.
    pub structure: usize,
    /// Name of the figure.
    pub figure: &'static str,
    /// The control's, N.
    pub control_n: f64,
    /// The plan's, N.
    pub plan_n: f64,
}

/// A figure of the force toward a structure: its name, and where it stands, N.
pub type JudgedFigure = (&'static str, fn(&TowardFigures) -> f64);

/// The figures that a plan is judged by, while the burr's surface is within [`bonemill_planfile::toward::NEAR_MM`] of a structure.
pub const JUDGED: [JudgedFigure; 3] =
    [("mean", |f| f.mean_n), ("mean with zeros", |f| f.mean_with_zeros_n), ("peak", |f| f.peak_n)];

impl ControlPath {
    /// Of a path that was laid for the case, its lines at `raster_rad`.
    ///
    /// # Errors
    /// When the burr's centre lies inside a structure, or the tool or the material is not usable.
    pub fn new(case: &Case, scene: &Scene, path: &MillPath, raster_rad: f64) -> Result<Self, PlanError> {
        let (points, radius_mm) = (&path.points, case.burr.radius_mm);
        let near = nearest_structures::along(case, scene, &path::centers(points))?;
        let (feeds, length_mm) = (feeds(points), lengths(points));
        let tool = tools::tool(&case.burr)?;
        let (material, measure) = tools::material(&case.material)?;
        let kernel = OrientationKernel::new(&tool, &material, measure, CHOICE_SAMPLES, CHOICE_MERGED);
        let swept = SweptPath::new(scene, &path.removal, points, Ball { radius_mm });
        let approach = Vector3::z_axis();
        let force = |samples: &mut EngagedSamples, i: usize| {
            let feed = feeds[i]?;
            let mut bone = swept.bone_at(i as u32, radius_mm, |density| material.weight(density));
            let (speed, rpm) = (case.speed.nominal_mm_s, case.burr.spindle_rpm);
            kernel.gather(samples, &Feed::new(&feed, speed, rpm), &mut bone);
            (!samples.is_empty()).then(|| kernel.force_for_axis(samples, &approach, rpm))
        };
        let forces: Vec<_> =
            (0..points.len()).into_par_iter().map_init(EngagedSamples::default, force).collect();
        let is_cut = |i: usize| forces[i].is_some() || points[i].kind == MoveKind::Cut;
        let sum = |of_cuts: bool| -> f64 {
            (0..points.len()).filter(|i| is_cut(*i) == of_cuts).map(|i| length_mm[i]).sum()
        };
        let (cuts_mm, links_s) = (sum(true), sum(false) / case.speed.link_mm_s);
        Ok(Self { raster_rad, forces, near, links_s, cuts_mm, length_mm })
    }

    /// At the constant speed with which all moves take `total_s`, or at the case's largest where they cannot: then the control takes
    /// longer and its forces are smaller, which makes the comparison stricter.
    pub fn in_time(&self, case: &Case, total_s: f64) -> Control {
        let cutting_s = total_s - self.links_s;
        let speed_mm_s = if cutting_s > 0.0 { self.cuts_mm / cutting_s } else { f64::INFINITY };
        let speed_mm_s = speed_mm_s.min(case.speed.max_mm_s);
        Control {
            raster_rad: self.raster_rad,
            speed_mm_s,
            forces: StructureForces::of(case, &self.length_mm, &self.forces, &self.near, |_| speed_mm_s),
        }
    }
}

impl StructureForces {
    /// Of moves at their speeds, mm/s; one entry per waypoint each.
    pub(super) fn of(
        case: &Case,
        length_mm: &[f64],
        forces: &[Option<EngagedForce>],
        near: &[Vec<NearStructure>],
        speed_mm_s: impl Fn(usize) -> f64,
    ) -> Self {
        let mut spans = vec![Vec::new(); case.structures.len()];
        let (mut seconds, mut impulse, mut peak_n) = (0.0, 0.0, 0f64);
        for (row, force) in forces.iter().enumerate() {
            let Some(force) = force else { continue };
            let taken = length_mm[row] / speed_mm_s(row);
            let force = force.force_n(speed_mm_s(row));
            seconds += taken;
            impulse += taken * force.norm();
            peak_n = peak_n.max(force.norm());
            for n in &near[row] {
                let force_n = force.dot(&n.proximity.toward).max(0.0);
                spans[n.structure]
                    .push((TowardSpan { seconds: taken, force_n, row }, n.proximity.distance_mm));
            }
        }
        let radius_mm = case.burr.radius_mm;
        Self {
            mean_n: if seconds > 0.0 { impulse / seconds } else { 0.0 },
            peak_n,
            structures: spans.iter().map(|s| StructureFigures::of(None, s, radius_mm)).collect(),
        }
    }

    /// One number to compare plans of one case by: per structure the mean logarithm of the judged figures, over its priority. So plans
    /// rank by products of forces, and half the force toward one structure makes up for twice that toward another of its priority.
    pub(super) fn score(&self, case: &Case) -> f64 {
        let of = |(found, structure): (&StructureFigures, &Structure)| {
            let logarithms = JUDGED.iter().map(|(_, figure)| figure(&found.near).max(NOTHING_N).ln());
            logarithms.sum::<f64>() / JUDGED.len() as f64 / f64::from(structure.priority)
        };
        self.structures.iter().zip(&case.structures).map(of).sum()
    }
}

impl Compared {
    /// The lower of the controls' figures near a structure, N; none without a control.
    pub fn better_control(&self, structure: usize, figure: fn(&TowardFigures) -> f64) -> Option<f64> {
        let of = |c: &Control| c.forces.structures.get(structure).map(|s| figure(&s.near));
        self.controls.iter().filter_map(of).min_by(f64::total_cmp)
    }

    /// Where the plan pushes more than the better of its controls toward a structure of priority 1, the worst first.
    pub fn worse(&self, case: &Case) -> Vec<Worse> {
        let mut found: Vec<Worse> = Vec::new();
        let first = case.structures.iter().enumerate().filter(|(_, s)| s.priority == 1);
        for (structure, _) in first {
            for (name, figure) in JUDGED {
                let Some(control_n) = self.better_control(structure, figure) else { continue };
                let plan_n = self.plan.structures.get(structure).map_or(0.0, |s| figure(&s.near));
                if plan_n > control_n.max(NOTHING_N) * (1.0 + SAME_SHARE) {
                    found.push(Worse { structure, figure: name, control_n, plan_n });
                }
            }
        }
        found.sort_by(|a, b| b.ratio().total_cmp(&a.ratio()));
        found
    }

    /// That a plan pushes more than its controls, in words.
    pub fn warning(&self, case: &Case) -> Option<String> {
        let worse = self.worse(case);
        let each: Vec<String> = worse.iter().map(|w| w.text(case)).collect();
        (!each.is_empty()).then(|| {
            format!(
                "near a structure of priority 1 the plan pushes more than a straight shaft at constant speed would in the same \
                 time: {}; see the forces in the report, speed.total_time_s and path.raster_deg",
                each.join(", ")
            )
        })
    }
}

impl Worse {
    fn text(&self, case: &Case) -> String {
        let name = case.structures.get(self.structure).map_or("", |s| s.name.as_str());
        format!("{} toward {name} {:.3} N instead of {:.3} N", self.figure, self.plan_n, self.control_n)
    }

    /// The plan's figure over the control's.
    pub fn ratio(&self) -> f64 {
        self.plan_n / self.control_n.max(NOTHING_N)
    }
}
