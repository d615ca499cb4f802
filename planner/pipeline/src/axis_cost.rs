//! What an axis of the shaft costs at a waypoint: Dillon's C, or the time that its cut needs under levels of force.
//!
//! Under levels L_t and L_o, with F(v) the force and w the importance of each structure with unit direction û, a cut needs per mm
//!
//! ```text
//! slowness(a) = max( max_s w_s max(0, F·û_s)/L_t, |F|/L_o, 1/v_max )     forces per mm/s
//! ```
//!
//! To it the sum of the first two is added, so that of axes that take nearly the same time the one with less force is chosen, and a
//! small share of 1 − I_n: inertia decides between axes that the levels leave equal. With `cost.force = "deflection"`
//! the deflection C F takes the place of F.

use bonemill_case::SpeedSpec;
use bonemill_cutting::burr::EngagedSamples;
use bonemill_cutting::cost::Terms;
use bonemill_cutting::metrics::Moments;
use bonemill_cutting::speed::Levels;
use bonemill_geometry::cancel;
use bonemill_toolpath::engagement::SweptPath;
use bonemill_toolpath::orientation::{Directions, FreeSets};
use nalgebra::{Matrix3, Unit, Vector3};
use rayon::prelude::*;

use super::sampled::SampledForce;

/// Below this weight of forces in Dillon's cost they are left out. The choice is then worse by less than this weight; the plan records
/// the largest possible loss ([`super::Modelled::closed_form_error`]).
pub const FORCE_MATTERS: f64 = 1e-2;
/// Share of |F|/L_o + w F/L_t that is added to the time: assumed.
const SUM_SHARE: f64 = 1.0;
/// Time that a cut costs which pushes twice as much as any may at the least speed, s per mm.
const BEYOND_S_MM: f64 = 500.0;
/// Share of 1/v_max by which no inertia at all is dearer than full inertia.
const INERTIA_SHARE: f64 = 0.01;

/// The inputs of every waypoint's cost.
#[derive(Debug)]
pub struct CostField<'a> {
    /// The path, for what is gone.
    pub swept: &'a SweptPath<'a>,
    /// Force of the gathered samples.
    pub sampled: &'a SampledForce,
    /// What is minimised.
    pub objective: AxisObjective<'a>,
    /// Mass ahead and its moments.
    pub moments: &'a [Moments],
    /// Direction of the move that ends at each waypoint.
    pub feeds: &'a [Option<Unit<Vector3<f64>>>],
    /// Deflection per force in work, mm/N, by direction; `None` if the cost uses the force itself.
    pub compliance: Option<Vec<Matrix3<f64>>>,
    /// The same by direction of the finer cap.
    pub finer_compliance: Option<Vec<Matrix3<f64>>>,
}

/// What the choice of axes minimises.
#[derive(Debug, Clone, Copy)]
pub enum AxisObjective<'a> {
    /// Dillon's cost: structures near each waypoint, with their weights.
    Dillon(&'a [Terms]),
    /// The time under levels of force.
    Levels(LevelTimes<'a>),
}

/// Weight of a structure, and the direction to it.
pub type Weighted = (f64, Unit<Vector3<f64>>);

/// What the time of a cut under levels depends on.
#[derive(Debug, Clone, Copy)]
pub struct LevelTimes<'a> {
    /// Weight of each structure near a waypoint, and the direction to it.
    pub weighted: &'a [Vec<Weighted>],
    /// Slowest and fastest cut, mm/s.
    pub range_mm_s: [f64; 2],
    /// Speed of a move that cuts nothing, mm/s.
    pub link_mm_s: f64,
}

impl<'a> LevelTimes<'a> {
    /// In a range of speeds.
    pub fn new(speed: &SpeedSpec, weighted: &'a [Vec<Weighted>]) -> Self {
        let range_mm_s = [speed.min_mm_s, speed.max_mm_s];
        Self { weighted, range_mm_s, link_mm_s: speed.link_mm_s }
    }
}

/// Levels of a sequence.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisLevels {
    /// Of cuts faster than the least speed.
    pub levels: Levels,
    /// That no cut may exceed.
    pub most: Levels,
}

/// What pushes at a waypoint for an axis, per mm/s: N, or mm of deflection.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct AxisPush {
    /// Toward the structure where its weighted part is largest.
    pub toward: f32,
    /// In any direction.
    pub overall: f32,
    /// 1 − I_n.
    pub inertia_lost: f32,
}

impl AxisPush {
    /// Time of a cut under levels, s per mm, with the shares that decide between equal times; a cut that pushes too much even at the
    /// least speed costs more by how much.
    pub fn cost(&self, levels: &AxisLevels, [min_mm_s, max_mm_s]: [f64; 2]) -> f64 {
        let [toward, overall] = self.shares(&levels.levels);
        let [most_toward, most_overall] = self.shares(&levels.most);
        let beyond = (min_mm_s * most_toward.max(most_overall) - 1.0).max(0.0);
        toward.max(overall).clamp(1.0 / max_mm_s, 1.0 / min_mm_s)
            + SUM_SHARE * (toward + overall)
            + BEYOND_S_MM * (beyond + if beyond > 0.0 { 0.1 } else { 0.0 })
            + INERTIA_SHARE * f64::from(self.inertia_lost) / max_mm_s
    }

    /// Time of a cut under levels, s per mm, at a speed within a range, mm/s.
    pub fn seconds(&self, levels: &Levels, [min_mm_s, max_mm_s]: [f64; 2]) -> f64 {
        let [toward, overall] = self.shares(levels);
        toward.max(overall).max(1.0 / max_mm_s).min(1.0 / min_mm_s)
    }

    fn shares(&self, levels: &Levels) -> [f64; 2] {
        let share = |push: f32, level: f64| if push > 0.0 { f64::from(push) / level } else { 0.0 };
        [share(self.toward, levels.toward), share(self.overall, levels.overall)]
    }
}

impl CostField<'_> {
    /// Whether the force enters the choice at waypoint i.
    pub fn needs_force(&self, i: usize) -> bool {
        self.cuts(i)
            && self.feeds[i].is_some()
            && match self.objective {
                AxisObjective::Dillon(terms) => terms[i].total_alpha() >= FORCE_MATTERS,
                AxisObjective::Levels(_) => true,
            }
    }

    /// Whether waypoint i removes anything.
    pub fn cuts(&self, i: usize) -> bool {
        self.moments[i].mass_mg() > 0.0
    }

    /// Gathers what waypoint i cuts.
    pub fn gather(&self, i: usize, samples: &mut EngagedSamples) {
        samples.clear();
        let Some(feed) = self.feeds[i].filter(|_| self.needs_force(i)) else { return };
        let weight = |density| self.sampled.weight(density);
        let bone = self.swept.bone_at(i as u32, self.sampled.radius_mm(), weight);
        self.sampled.gather(samples, &self.sampled.nominal(&feed), bone);
    }

    /// What waypoint i cuts, gathered into `own` unless it was kept.
    pub fn kept_or_gathered<'a>(
        &self,
        kept: Option<&'a [EngagedSamples]>,
        i: usize,
        own: &'a mut EngagedSamples,
    ) -> &'a EngagedSamples {
        if let Some(kept) = kept {
            return &kept[i];
        }
        self.gather(i, own);
        own
    }

    /// Force of what was gathered, for an axis; the deflection under it with `compliance`.
    pub fn push(
        &self,
        samples: &EngagedSamples,
        axis: &Unit<Vector3<f64>>,
        compliance: Option<&Matrix3<f64>>,
    ) -> Vector3<f64> {
        if samples.is_empty() {
            return Vector3::zeros();
        }
        let force_n = self.sampled.of(samples, axis).force_n(self.sampled.nominal_mm_s);
        compliance.map_or(force_n, |c| c * force_n)
    }

    /// Dillon's C of waypoint i for an axis, with its [`push`](Self::push).
    pub fn dillon(&self, terms: &[Terms], i: usize, axis: &Unit<Vector3<f64>>, push: &Vector3<f64>) -> f64 {
        let moments = &self.moments[i];
        terms[i].cost(push, moments.inertia_normalised(axis), moments.mass_mg()).cost
    }

    /// What pushes at waypoint i for an axis, with its [`push`](Self::push).
    pub fn axis_push(
        &self,
        times: &LevelTimes,
        i: usize,
        axis: &Unit<Vector3<f64>>,
        push: &Vector3<f64>,
    ) -> AxisPush {
        let push = push / self.sampled.nominal_mm_s;
        let toward = times.weighted[i].iter().map(|(weight, u)| weight * push.dot(u));
        AxisPush {
            toward: toward.fold(0.0, f64::max) as f32,
            overall: push.norm() as f32,
            inertia_lost: (1.0 - self.moments[i].inertia_normalised(axis)) as f32,
        }
    }

    /// What pushes at every waypoint that cuts, for each of its free directions, one row per waypoint. `kept`: what was gathered, where
    /// it was.
    pub fn axis_pushes(
        &self,
        times: &LevelTimes,
        directions: &Directions,
        free: &FreeSets,
        kept: Option<&[EngagedSamples]>,
    ) -> Vec<AxisPush> {
        self.rows(directions, free, kept, |i, samples, axis, compliance| {
            self.axis_push(times, i, axis, &self.push(samples, axis, compliance))
        })
    }

    /// A value of every waypoint that cuts and of its free directions, one row per waypoint. `kept`: what was gathered, where it was.
    pub fn rows<T: Copy + Default + Send + Sync>(
        &self,
        directions: &Directions,
        free: &FreeSets,
        kept: Option<&[EngagedSamples]>,
        value: impl Fn(usize, &EngagedSamples, &Unit<Vector3<f64>>, Option<&Matrix3<f64>>) -> T + Sync,
    ) -> Vec<T> {
        let axes = directions.axes();
        let mut rows = vec![T::default(); free.len() * axes.len()];
        rows.par_chunks_mut(axes.len()).enumerate().for_each_init(
            EngagedSamples::default,
            |own, (i, row)| {
                cancel::poll();
                if !self.cuts(i) {
                    return;
                }
                let samples = self.kept_or_gathered(kept, i, own);
                for n in free.iter(i) {
                    let compliance = self.compliance.as_ref().map(|c| &c[n]);
                    row[n] = value(i, samples, &axes[n], compliance);
                }
            },
        );
        rows
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cut_takes_the_time_of_the_level_that_it_meets_first() {
        let push = AxisPush { toward: 0.1, overall: 0.3, inertia_lost: 0.5 };
        let levels = |toward: f64, overall: f64| Levels { toward, overall, speed_mm_s: 4.0 };
        let time = |toward, overall| push.seconds(&levels(toward, overall), [0.5, 4.0]);
        assert!((time(0.1, 0.6) - 1.0).abs() < 1e-6 && (time(1.0, 0.6) - 0.5).abs() < 1e-6);
        assert_eq!([time(9.0, 9.0), time(0.0, 9.0)], [0.25, 2.0]);
        // nothing pushes: a level of 0 binds nothing
        assert_eq!(AxisPush::default().seconds(&levels(0.0, 0.0), [0.5, 4.0]), 0.25);
    }

    #[test]
    fn of_axes_with_equal_time_less_force_and_more_inertia_win_and_no_cut_pushes_beyond_the_most() {
        let of = |toward: f64, overall: f64| Levels { toward, overall, speed_mm_s: 4.0 };
        let levels = AxisLevels { levels: of(1.0, 0.6), most: of(1.0, 0.6) };
        let cost = |push: AxisPush| push.cost(&levels, [0.5, 4.0]);
        let push = AxisPush { toward: 0.1, overall: 0.3, inertia_lost: 0.5 };
        assert!(cost(AxisPush { toward: 0.05, ..push }) < cost(push));
        assert!(cost(AxisPush { inertia_lost: 0.2, ..push }) < cost(push));
        // at the least speed 0.6 N is kept up to 1.2 N per mm/s
        let beyond = AxisPush { overall: 1.21, ..push };
        assert!(cost(beyond) > cost(AxisPush { overall: 1.19, ..push }) + 50.0);
    }
}
