//! Monte-Carlo simulation of errors of a finished plan: how often it touches each structure, and the spread of its forces.
//!
//! Each sample moves the patient rigidly, moves each structure's boundary, and scales K and density. The burr follows its
//! waypoints as a ball at places at most [`STEP_MM`] apart, whose distance to a structure is exact; the tool of a channel is the balls
//! that fill what it sweeps ([`Cover`]). Balls are tested in the order of their planned distance, until no other can be nearer, so
//! a sample takes a few hundred distance queries.

use bonemill_geometry::Progress;
use bonemill_geometry::{Ct, Point, cancel};
use bonemill_planfile::StoredPlan;
use rayon::prelude::*;

use super::draws::Draws;
use super::rigid_error::PatientShift;
use super::{RigidError, Share, UncertaintyError, clearance_mm, kept, not_negative};
use crate::channel::{Cover, OwnSolid, ToolPlace};
use crate::figures::{mean_n, peak_n};
use crate::{Anatomy, Boxes, VerifyError};

/// Distance between tested places of the burr, mm.
const STEP_MM: f64 = 0.1;
/// Largest number of samples.
const MOST_SAMPLES: usize = 1_000_000;

/// Number of samples between two progress reports.
const AT_ONCE: usize = 1024;

/// The errors and their sizes.
#[derive(Debug, Clone)]
pub struct ErrorModel {
    /// Error of the registration.
    pub registration: RigidError,
    /// Standard deviation of every structure's boundary, mm.
    pub boundary_sigma_mm: f64,
    /// Standard deviation of density, as a share.
    pub density_share: f64,
    /// Standard deviation of the cutting coefficients, as a share.
    pub coefficient_share: f64,
    /// Number of samples.
    pub samples: usize,
    /// Seed of the random numbers.
    pub seed: u64,
    /// The probability with which every structure must stay untouched.
    pub keep: f64,
}

/// The risks of a plan.
#[derive(Debug, Clone, PartialEq)]
pub struct Risk {
    /// Risk for each structure, in the case's order.
    pub structures: Vec<StructureRisk>,
    /// Spread of the forces.
    pub forces: Vec<ForceSpread>,
}

/// The risk for one structure.
#[derive(Debug, Clone, PartialEq)]
pub struct StructureRisk {
    /// Its name.
    pub name: String,
    /// Share of the samples in which the burr touches it.
    pub touched: Share,
    /// The 5 %, 50 % and 95 % quantiles of the least distance over the samples, mm; below 0 the structure is cut.
    pub kept_mm: [f64; 3],
    /// The clearance with which it would stay untouched with the requested probability, mm.
    pub clearance_mm: f64,
}

impl StructureRisk {
    /// Whether it is certainly touched more often than `keep` allows: even the interval's lower end exceeds 1 − `keep`.
    pub fn falls_short(&self, keep: f64) -> bool {
        self.touched.low > 1.0 - keep
    }
}

/// A force and its spread.
#[derive(Debug, Clone, PartialEq)]
pub struct ForceSpread {
    /// Name of the force.
    pub name: String,
    /// The planned value, N: `peak_force_n`, `mean_force_n` or a structure's `peak_force_toward_n`.
    pub planned_n: f64,
    /// The 5 %, 50 % and 95 % quantiles over the samples, N.
    pub spread_n: [f64; 3],
}

/// Standard deviations of the errors, the same along and about every axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sigmas {
    /// Registration along each axis of ct, mm.
    pub registration_mm: f64,
    /// Registration about each axis through the middle of the path, rad.
    pub registration_rad: f64,
    /// Boundary of each structure, mm.
    pub boundary_mm: f64,
    /// Density, as a share.
    pub density_share: f64,
    /// Cutting coefficients, as a share.
    pub coefficient_share: f64,
}

impl ErrorModel {
    /// The error model for rotations about the middle of a plan's path.
    ///
    /// # Errors
    /// [`UncertaintyError`] for a number out of range.
    pub fn about_path(
        plan: &StoredPlan,
        sigmas: &Sigmas,
        samples: usize,
        seed: u64,
        keep: f64,
    ) -> Result<Self, UncertaintyError> {
        let mut middle = Point::new(0.0, 0.0, 0.0);
        for w in &plan.waypoints {
            middle = middle + w.position.coords / plan.waypoints.len() as f64;
        }
        let (along, about) = ([sigmas.registration_mm; 3], [sigmas.registration_rad; 3]);
        let model = Self {
            registration: RigidError::of_sigmas(along, about, middle)?,
            boundary_sigma_mm: sigmas.boundary_mm,
            density_share: sigmas.density_share,
            coefficient_share: sigmas.coefficient_share,
            samples,
            seed,
            keep,
        };
        model.check()?;
        Ok(model)
    }

    fn check(&self) -> Result<(), UncertaintyError> {
        not_negative("boundary sigma, mm", self.boundary_sigma_mm)?;
        not_negative("density's standard deviation", self.density_share)?;
        not_negative("coefficients' standard deviation", self.coefficient_share)?;
        kept(self.keep)?;
        if (1..=MOST_SAMPLES).contains(&self.samples) {
            return Ok(());
        }
        let expected = "a whole number from 1 to 1000000";
        Err(UncertaintyError::Value { what: "samples", value: self.samples as f64, expected })
    }
}

/// Draws errors and evaluates the plan under each; `progress` receives the number of samples, over all structures.
///
/// # Errors
/// [`UncertaintyError`] for numbers out of range and images that cannot be read.
pub fn simulate_errors(
    plan: &StoredPlan,
    model: &ErrorModel,
    progress: &dyn Progress,
) -> Result<Risk, UncertaintyError> {
    model.check()?;
    progress.stage("draw errors");
    let anatomy = Anatomy::read(plan)?;
    let balls = balls(plan)?;
    let structures = anatomy
        .kept
        .iter()
        .enumerate()
        .filter_map(|(n, kept)| Some((n, kept, Boxes::new(&anatomy.labels, kept.label)?)))
        .map(|(n, kept, boxes)| {
            let near = SampledDistances::new(&balls, &boxes, &model.registration);
            let distance_mm = |sample: u64| {
                cancel::poll();
                let mut draws = Draws::of_sample(model.seed, sample);
                let motion = model.registration.draw(&mut draws);
                // every structure has its own boundary offset: the n-th number after the motion
                let offset = (0..=n).map(|_| draws.normal()).last().unwrap_or(0.0);
                near.least_mm(&boxes, &motion) - model.boundary_sigma_mm * offset
            };
            let mut kept_mm: Vec<f64> = Vec::with_capacity(model.samples);
            while kept_mm.len() < model.samples {
                let from = kept_mm.len();
                progress.advance(n * model.samples + from, anatomy.kept.len() * model.samples);
                let to = model.samples.min(from + AT_ONCE);
                kept_mm.par_extend((from as u64..to as u64).into_par_iter().map(distance_mm));
            }
            let touched = kept_mm.iter().filter(|d| **d <= 0.0).count();
            let clearance = clearance_mm(
                &model.registration,
                model.boundary_sigma_mm,
                near_surface(&boxes, &balls),
                model.keep,
            )?;
            Ok(StructureRisk {
                name: kept.name.clone(),
                touched: Share::of(touched, model.samples),
                kept_mm: quantiles(&mut kept_mm),
                clearance_mm: clearance,
            })
        })
        .collect::<Result<_, UncertaintyError>>()?;
    Ok(Risk { structures, forces: forces(plan, model) })
}

/// What the cutter sweeps, as balls: centres, ct, and radii, mm. Of a channel, whose strokes repeat one line, the tool's solid along that
/// line once.
fn balls(plan: &StoredPlan) -> Result<Vec<(Point<Ct>, f64)>, VerifyError> {
    if let (Some(channel), Some(first)) = (plan.record.channel(), plan.waypoints.first()) {
        let solid = OwnSolid::new(&plan.record.case.tool, |file| plan.input_path(file))?;
        let tool = ToolPlace { tip: channel.end(), out: -channel.direction.into_inner() };
        let way_mm = (channel.end() - first.position).dot(&channel.direction);
        if let Some(cover) = Cover::new(&solid) {
            let balls = cover.balls(way_mm);
            return Ok(balls.iter().map(|ball| (tool.place(&ball.at), ball.radius_mm)).collect());
        }
    }
    let radius_mm = plan.record.cutter_radius_mm();
    let corners: Vec<_> = plan.waypoints.iter().map(|w| w.position).collect();
    let mut places: Vec<_> = corners.first().copied().into_iter().collect();
    for pair in corners.windows(2) {
        let way = pair[1] - pair[0];
        let parts = (way.norm() / STEP_MM).ceil().clamp(1.0, 1e5);
        places.extend((1..=parts as usize).map(|n| pair[0] + way * (n as f64 / parts)));
    }
    Ok(places.into_iter().map(|p| (p, radius_mm)).collect())
}

/// The structure's points nearest to the cutter where it comes near; their displacements determine the clearance.
fn near_surface(boxes: &Boxes<'_>, balls: &[(Point<Ct>, f64)]) -> Vec<Point<Ct>> {
    const FACING_MM: f64 = 10.0;
    let every = balls.len().div_ceil(2000).max(1);
    let facing = |(p, radius_mm): &(Point<Ct>, f64)| {
        let (d, q) = boxes.nearest(*p);
        (d - radius_mm < FACING_MM).then_some(q)
    };
    balls.par_iter().step_by(every).filter_map(facing).collect()
}

/// A ball of the cutter.
struct SampledBall {
    /// Its planned distance from one structure, mm.
    planned_mm: f64,
    center: Point<Ct>,
    radius_mm: f64,
}

/// Balls in the order of their planned distance to one structure.
struct SampledDistances {
    balls: Vec<SampledBall>,
    /// Largest distance of a centre from the centre of rotation, mm.
    reach_mm: f64,
}

impl SampledDistances {
    fn new(balls: &[(Point<Ct>, f64)], boxes: &Boxes<'_>, registration: &RigidError) -> Self {
        let ball = |&(center, radius_mm): &(Point<Ct>, f64)| SampledBall {
            planned_mm: boxes.distance_mm(center) - radius_mm,
            center,
            radius_mm,
        };
        let mut balls: Vec<_> = balls.par_iter().map(ball).collect();
        balls.sort_by(|a, b| a.planned_mm.total_cmp(&b.planned_mm));
        let about = *registration.draw(&mut Draws::of_sample(0, 0)).about();
        let reach_mm = balls.iter().map(|ball| (ball.center.coords - about).norm()).fold(0.0, f64::max);
        Self { balls, reach_mm }
    }

    /// Least distance of the cutter's surface under a motion, mm.
    fn least_mm(&self, boxes: &Boxes<'_>, motion: &PatientShift) -> f64 {
        let most = motion.most_mm(self.reach_mm);
        let mut least = f64::INFINITY;
        for SampledBall { planned_mm, center, radius_mm } in &self.balls {
            if planned_mm - most >= least {
                break;
            }
            let moved = motion.in_images(*center);
            if planned_mm - moved.distance_mm(center) >= least {
                continue;
            }
            // nothing is looked for that is farther than the nearest so far
            let at_most_mm = (least + radius_mm).max(0.0);
            if let Some((distance_mm, _)) = boxes.nearest_within(moved, at_most_mm) {
                least = least.min(distance_mm - radius_mm);
            }
        }
        least
    }
}

/// Peak and mean force, and the peak toward each structure, scaled by drawn K and density.
fn forces(plan: &StoredPlan, model: &ErrorModel) -> Vec<ForceSpread> {
    let exponent = plan.record.case.material.exponent;
    let scales: Vec<f64> = (0..model.samples as u64)
        .map(|sample| {
            // a separate stream, so that these numbers do not change those of the registration
            let mut draws = Draws::of_sample(model.seed ^ u64::MAX, sample);
            let k = (1.0 + model.coefficient_share * draws.normal()).max(0.0);
            let density = (1.0 + model.density_share * draws.normal()).max(0.0);
            k * density.powf(exponent)
        })
        .collect();
    let spread = |name: String, planned_n: f64| {
        let mut all: Vec<f64> = scales.iter().map(|s| s * planned_n).collect();
        ForceSpread { name, planned_n, spread_n: quantiles(&mut all) }
    };
    let mut found = vec![spread("peak".into(), peak_n(plan)), spread("mean".into(), mean_n(plan))];
    for (n, structure) in plan.record.case.structures.iter().enumerate() {
        let toward = plan.forces.iter().filter(|f| f.structure == n).map(|f| f.peak_toward_n);
        found.push(spread(format!("peak toward {}", structure.name), toward.fold(0.0, f64::max)));
    }
    found
}

/// The 5 %, 50 % and 95 % quantiles.
fn quantiles(values: &mut [f64]) -> [f64; 3] {
    values.sort_by(f64::total_cmp);
    [0.05, 0.5, 0.95].map(|share| {
        let at = (share * (values.len().max(1) - 1) as f64).round() as usize;
        values.get(at).copied().unwrap_or(0.0)
    })
}
