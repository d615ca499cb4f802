//! The shaft's angle at every waypoint, by the case's mode.

use nalgebra::{Matrix3, Unit, Vector3};
use rayon::prelude::*;

use super::near::Near;
use super::reach::ReachedPath;
use crate::burr::{EngagedSamples, Material, OrientationKernel};
use crate::case::OrientationMode;
use crate::cost::CostModel;
use crate::engagement::SweptPath;
use crate::metrics::Moments;
use crate::orientation::greedy::{best_angle, low_pass};
use crate::orientation::optimal::{RateLimit, Sequence, best_sequence};
use crate::orientation::{Scan, TiltFamily};
use crate::path::MoveKind;

/// Below this α₁ the force cannot change the choice: the cost is closed form.
pub const FORCE_MATTERS: f64 = 1e-3;
/// Half-width of the greedy mode's low-pass, waypoints.
const LOW_PASS_HALF: usize = 6;
/// Sweeps that round the optimal sequence's grid steps off.
const ROUNDING_SWEEPS: usize = 6;

/// Everything a waypoint's cost is made of.
#[derive(Debug)]
pub struct CostField<'a> {
    /// The path, for what is gone.
    pub swept: &'a SweptPath<'a>,
    /// Force of the gathered samples.
    pub kernel: &'a OrientationKernel,
    /// Density to weight.
    pub material: &'a Material,
    /// α₁, D6, D12.
    pub model: &'a CostModel,
    /// Nearest structures.
    pub near: &'a [Option<Near>],
    /// Mass ahead and its moments.
    pub moments: &'a [Moments],
    /// Direction of the move that ends at each waypoint.
    pub feeds: &'a [Option<Unit<Vector3<f64>>>],
    /// mm/s.
    pub nominal_mm_s: f64,
    /// rpm.
    pub spindle_rpm: f64,
    /// Deflection per force in work, mm/N, as a function of the angle; `None`: the force itself is looked at.
    pub compliance: Option<Vec<Matrix3<f64>>>,
}

/// Angles, and how they came about.
#[derive(Debug, Clone, PartialEq)]
pub struct Oriented {
    /// Per waypoint, rad.
    pub angles_rad: Vec<f64>,
    /// Waypoints whose cost needed no force.
    pub closed_form: usize,
    /// Waypoints whose cost needed the force.
    pub with_force: usize,
    /// Waypoints at which the low-pass was held (greedy).
    pub held: usize,
}

impl CostField<'_> {
    /// Whether the force is looked at for waypoint i.
    fn needs_force(&self, i: usize) -> bool {
        let alpha = |near: &Near| self.model.alpha_1(near.proximity.distance_mm, near.proximity.least_mm);
        self.moments[i].mass_mg() > 0.0
            && self.feeds[i].is_some()
            && self.near[i].as_ref().is_some_and(|near| alpha(near) >= FORCE_MATTERS)
    }

    /// Gathers what waypoint i cuts.
    fn gather(&self, i: usize, samples: &mut EngagedSamples) {
        samples.clear();
        let Some(feed) = self.feeds[i].filter(|_| self.needs_force(i)) else { return };
        let mut bone = self.swept.bone_at(i as u32);
        let radius = self.kernel.tool().radius_mm();
        self.kernel.gather_over(samples, &feed, self.nominal_mm_s, self.spindle_rpm, |n, patch| {
            bone.mean_weight(&(n * radius), |g| patch.sides_mm(g), |density| self.material.weight(density))
        });
    }

    /// C of waypoint i for an axis; `compliance`: of that axis.
    fn cost(
        &self,
        i: usize,
        samples: &EngagedSamples,
        axis: &Unit<Vector3<f64>>,
        compliance: Option<&Matrix3<f64>>,
    ) -> f64 {
        let moments = &self.moments[i];
        if moments.mass_mg() <= 0.0 {
            return 0.0;
        }
        let force = if samples.is_empty() {
            Vector3::zeros()
        } else {
            self.kernel.force_for_axis(samples, axis, self.spindle_rpm).force_n(self.nominal_mm_s)
        };
        let push = compliance.map_or(force, |c| c * force);
        let near = self.near[i].as_ref().map(|n| &n.proximity);
        self.model.cost(&push, near, moments.inertia_normalised(axis), moments.mass_mg()).cost
    }
}

/// Chooses the angles.
///
/// `rate`: as the sequence was found feasible with.
pub fn orient(
    mode: OrientationMode,
    reached: &ReachedPath,
    family: &TiltFamily,
    scan: &Scan,
    field: &CostField,
    rate: RateLimit,
) -> Oriented {
    let points = &reached.path.points;
    let with_force = (0..points.len()).filter(|i| field.needs_force(*i)).count();
    let closed_form = (0..points.len()).filter(|i| field.moments[*i].mass_mg() > 0.0).count() - with_force;
    let is_free = |i: usize, q: f64| {
        let axis = family.axis(q);
        reached.access.is_free(i as u32, points[i].position, &axis)
            && (points[i].kind != MoveKind::Cut || scan.within_limit >> scan.nearest(q) & 1 == 1)
    };
    let (angles_rad, held) = match mode {
        OrientationMode::Fixed => {
            let upright = scan.nearest(0.0);
            let fixed = |free: &u128| scan.nearest_free(*free, scan.angles_rad[upright]).unwrap_or(upright);
            (reached.free.iter().map(|free| scan.angles_rad[fixed(free)]).collect(), 0)
        }
        OrientationMode::Greedy => greedy(reached, family, scan, field, is_free),
        OrientationMode::Optimal => (optimal(reached, scan, field, rate, is_free), 0),
    };
    Oriented { angles_rad, closed_form, with_force, held }
}

fn greedy(
    reached: &ReachedPath,
    family: &TiltFamily,
    scan: &Scan,
    field: &CostField,
    is_free: impl Fn(usize, f64) -> bool + Sync,
) -> (Vec<f64>, usize) {
    let upright = scan.angles_rad[scan.nearest(0.0)];
    let raw: Vec<f64> = (0..reached.free.len())
        .into_par_iter()
        .map_init(EngagedSamples::default, |samples, i| {
            field.gather(i, samples);
            let compliance = |q: f64| field.compliance.as_ref().map(|c| &c[scan.nearest(q)]);
            let cost = |q: f64| field.cost(i, samples, &family.axis(q), compliance(q));
            best_angle(scan, reached.free[i], upright, cost, |q| is_free(i, q)).unwrap_or(upright)
        })
        .collect();
    let filtered = low_pass(scan, &raw, LOW_PASS_HALF, &reached.free, is_free);
    (filtered.angles_rad, filtered.held)
}

fn optimal(
    reached: &ReachedPath,
    scan: &Scan,
    field: &CostField,
    rate: RateLimit,
    is_free: impl Fn(usize, f64) -> bool,
) -> Vec<f64> {
    let angles = scan.len();
    let mut cost = vec![0f32; reached.free.len() * angles];
    cost.par_chunks_mut(angles).enumerate().for_each_init(EngagedSamples::default, |samples, (i, row)| {
        if field.moments[i].mass_mg() <= 0.0 {
            return;
        }
        field.gather(i, samples);
        for (n, c) in row.iter_mut().enumerate().filter(|(n, _)| reached.free[i] >> n & 1 == 1) {
            let compliance = field.compliance.as_ref().map(|c| &c[n]);
            *c = field.cost(i, samples, &scan.axes[n], compliance) as f32;
        }
    });
    let chosen = match best_sequence(scan, &cost, &reached.free, &reached.length_mm, rate) {
        Sequence::Found(sequence) => sequence,
        // not reached: the same constraints were found feasible when waypoints were dropped; each angle is free all the same
        Sequence::Blocked(_) => reached
            .free
            .iter()
            .map(|free| scan.nearest_free(*free, 0.0).unwrap_or(scan.nearest(0.0)))
            .collect(),
    };
    rounded(chosen.into_iter().map(|n| scan.angles_rad[n]).collect(), scan.step_rad, is_free)
}

/// Evens the grid's steps out where the rounded angle is free; never farther than half a step from the optimum.
fn rounded(chosen: Vec<f64>, step_rad: f64, is_free: impl Fn(usize, f64) -> bool) -> Vec<f64> {
    let mut smooth = chosen.clone();
    for _ in 0..ROUNDING_SWEEPS {
        let before = smooth.clone();
        for i in 1..smooth.len().saturating_sub(1) {
            let q = 0.25 * before[i - 1] + 0.5 * before[i] + 0.25 * before[i + 1];
            smooth[i] = q.clamp(chosen[i] - 0.5 * step_rad, chosen[i] + 0.5 * step_rad);
        }
    }
    // free at the end: an angle that was only passed through while rounding need not be
    smooth.iter().zip(&chosen).enumerate().map(|(i, (s, c))| if is_free(i, *s) { *s } else { *c }).collect()
}
