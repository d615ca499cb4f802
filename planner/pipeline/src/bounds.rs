//! What a plan may push near structures: no more than its references do.
//!
//! Levels bound the largest push of all cuts. The figures that a plan is judged by are means and peaks near each structure, and bounds
//! on them hold in two steps:
//!
//! - a cut that exceeds a bound even at the least speed takes a free axis that keeps the bounds, or misses them least
//!   ([`Prepared::gentlest`]);
//! - the cuts that push toward a structure near it go slower by the share by which a figure is too high ([`Prepared::eased`]): at
//!   r times the speeds the means and the peak are r times as large, and only the few seconds near the structure are longer.

use std::collections::{BTreeMap, HashSet};

use bonemill_case::Case;
use bonemill_cutting::burr::{EngagedForce, EngagedSamples, Feed};
use bonemill_cutting::importance::Importance;
use bonemill_planfile::toward::NEAR_MM;
use bonemill_setup::armpath::ArmMotion;
use bonemill_setup::nearest_structures::NearStructure;
use bonemill_toolpath::orientation::directions::angle_between;
use nalgebra::{Unit, Vector3};
use rayon::prelude::*;

use super::PlanError;
use super::choose::{Choices, Chosen};
use super::compared::{JUDGED, LEAST_N, NOTHING_N, SAME_SHARE};
use super::path_forces::{around_back, turning};
use super::prepared::Prepared;
use super::reference::{Reference, StructureForces};
use super::sampled::SampledForce;

/// Places within a move at which axes are compared, as shares of its way.
const PLACES: [f64; 5] = [0.02, 0.25, 0.5, 0.75, 1.0];
/// Cuts are put off where one of them pushes by more than this at the least speed, N: assumed.
const CLEARLY_N: f64 = 2.0 * NOTHING_N;
/// Figures that are above their bound by no more than this share are left.
const NEARLY: f64 = 0.005;
/// Forces of the same cuts that differ by no more than this share are the same.
const ROUNDING: f64 = 1e-6;

/// What a plan may not exceed, N.
#[derive(Debug)]
pub(super) struct Bounds {
    /// Mean and largest force in any direction.
    mean_n: f64,
    peak_n: f64,
    /// Per structure the judged figures near it, and its rank in the law of importance.
    near_n: Vec<[f64; JUDGED.len()]>,
    ranks: Vec<f64>,
}

impl Bounds {
    /// The whole force of a straight shaft, and the least of its and the controls' figures near structures.
    pub fn of(case: &Case, straight: &StructureForces, controls: &[Reference]) -> Self {
        let least = |n: usize, figure: usize| {
            let of = |forces: &StructureForces| {
                forces.structures.get(n).map_or(0.0, |s| (JUDGED[figure].1)(&s.near))
            };
            controls.iter().map(|c| of(&c.forces)).fold(of(straight), f64::min).max(LEAST_N)
        };
        let near_n =
            (0..straight.structures.len()).map(|n| [0, 1, 2].map(|figure| least(n, figure))).collect();
        let ranks = (0..straight.structures.len()).map(|n| case.rank(n)).collect();
        Self { mean_n: straight.mean_n, peak_n: straight.peak_n, near_n, ranks }
    }

    /// Whether mean and peak of the whole force are within their bounds, or not above those before.
    pub fn keeps_whole(&self, forces: &StructureForces, before: &StructureForces) -> bool {
        let most_n = [self.mean_n.max(before.mean_n), (self.peak_n * (1.0 + SAME_SHARE)).max(before.peak_n)];
        let keeps = |n: f64, most_n: f64| n <= most_n * (1.0 + ROUNDING);
        keeps(forces.mean_n, most_n[0]) && keeps(forces.peak_n, most_n[1])
    }

    /// The largest share of a structure's bounds that forces reach.
    fn share(&self, forces: &StructureForces, n: usize) -> f64 {
        let of =
            |(bound, (_, figure)): (&f64, &(_, fn(&_) -> f64))| figure(&forces.structures[n].near) / bound;
        self.near_n[n].iter().zip(&JUDGED).map(of).fold(0.0, f64::max)
    }

    /// How far figures are above their bounds: the logarithms of the structures' largest shares, by the law of importance.
    pub fn excess(&self, forces: &StructureForces) -> f64 {
        let of = |(n, rank): (usize, &f64)| Importance::by_rank(self.share(forces, n).max(1.0).ln(), *rank);
        self.ranks.iter().enumerate().map(of).sum()
    }

    /// By how much the cuts that push toward a structure near it must be slower, at most 1.
    ///
    /// The impulse F Δt = g Δs of a cut does not depend on its speed. So the mean over the pushing cuts and the peak fall with the speed,
    /// and the mean with zeros as the time near the structure grows, of which the pushing cuts take the share of the two means.
    fn slower(&self, forces: &StructureForces, n: usize) -> f64 {
        let near = &forces.structures[n].near;
        let [mean, zeros, peak] = [0, 1, 2].map(|k| (JUDGED[k].1)(near) / self.near_n[n][k]);
        let times = |share: f64, of_time: f64| {
            if share > 1.0 + NEARLY { 1.0 / (1.0 + (share - 1.0) * of_time) } else { 1.0 }
        };
        let of_time = near.mean_n / near.mean_with_zeros_n.max(f64::MIN_POSITIVE);
        times(mean, 1.0).min(times(peak, 1.0)).min(times(zeros, of_time))
    }

    /// The largest share of a bound on peaks that one force reaches, after a share of the move's way.
    fn of_peaks(&self, (at, force_n): (f64, &Vector3<f64>), near: &[&NearStructure]) -> f64 {
        let bound_n = |n: &NearStructure| self.near_n[n.structure][JUDGED.len() - 1];
        let toward = near.iter().map(|n| n.most(force_n, at) / bound_n(n));
        toward.fold(force_n.norm() / self.peak_n.max(LEAST_N), f64::max)
    }
}

/// Points of passes where cuts push toward structures near them, (pass, point), and the sum of these pushes at the least speed, N.
#[derive(Debug, Default)]
pub(super) struct Pushing {
    pub points: HashSet<(u32, u32)>,
    pub sum_n: f64,
}

impl Prepared<'_> {
    /// The structures that the burr's surface is near at a waypoint.
    fn close_by(&self, i: usize) -> Vec<&NearStructure> {
        self.near[i].iter().filter(|n| n.proximity.distance_mm - self.radius_mm() <= NEAR_MM).collect()
    }

    /// Points of passes where a cut near a structure pushes toward it by more than next to nothing even at the least speed, where one of them
    /// does clearly; none that were put off already.
    pub(super) fn pushing(&self, chosen: &Chosen) -> Pushing {
        let (case, path) = (self.start.case, &self.reached.path);
        let toward_n = |i: usize| {
            let slowest_mm_s = chosen.slowest_mm_s(case, i);
            let toward = |n: &NearStructure| {
                chosen.forces_of(i).map(|(at, f)| n.most(&f.force_n(slowest_mm_s), at)).fold(0.0, f64::max)
            };
            self.close_by(i).into_iter().map(toward).fold(0.0, f64::max)
        };
        let is_new = |i: &usize| !path.passes[path.points[*i].leads_to.0 as usize].put_off;
        let pushing = (0..path.points.len()).filter(is_new).map(|i| (i, toward_n(i)));
        let pushing: Vec<(usize, f64)> = pushing.filter(|(_, n)| *n > NOTHING_N).collect();
        if pushing.iter().all(|(_, n)| *n < CLEARLY_N) {
            return Pushing::default();
        }
        Pushing {
            points: pushing.iter().map(|(i, _)| path.points[*i].leads_to).collect(),
            sum_n: pushing.iter().map(|(_, n)| n).sum(),
        }
    }

    /// Cuts that push more at the least speed than any of the references does, each with a free axis that keeps the bounds, or misses them
    /// least.
    ///
    /// # Errors
    /// When the tool, the material or the arm's limits are not usable.
    pub(super) fn gentlest(
        &self,
        choices: &Choices,
        chosen: &Chosen,
        motion: &ArmMotion,
        bounds: &Bounds,
    ) -> Result<BTreeMap<usize, Unit<Vector3<f64>>>, PlanError> {
        let case = &choices.applied_to(self.start.case);
        let near: Vec<_> = (0..self.near.len()).map(|i| self.close_by(i)).collect();
        let slowest = |i: usize| chosen.slowest_mm_s(case, i);
        let share = |i: usize, (at, force): (f64, &EngagedForce)| {
            bounds.of_peaks((at, &force.force_n(slowest(i))), &near[i])
        };
        let exceeds = |i: usize| chosen.forces_of(i).any(|force| share(i, force) > 1.0 + SAME_SHARE);
        // the shaft turns during a move: both axes make its forces
        let exceeds: Vec<bool> = (0..near.len()).map(exceeds).collect();
        let is_hot = |i: &usize| exceeds[*i] || exceeds.get(i + 1).is_some_and(|next| *next);
        let hot: Vec<usize> = (0..near.len()).filter(is_hot).collect();
        if hot.is_empty() {
            return Ok(BTreeMap::new());
        }
        let sampled = SampledForce::within(case)?;
        let forced = self.forced();
        let swept = &forced.rounded((&self.start, case), motion)?;
        let axes = self.directions.axes();
        // the free axis at waypoint i that keeps the bounds, or misses them least, and is nearest to `wanted`
        let best = |i: usize, wanted: &Unit<Vector3<f64>>| {
            let gathered = |(of, place): (usize, f64)| {
                let weight = |density| sampled.weight(density);
                let (feed, bone) = swept.bone_within((of as u32, place), sampled.radius_mm(), weight)?;
                let mut samples = EngagedSamples::default();
                // edges push otherwise where a cut is slow
                let feed = Feed { speed_mm_s: slowest(of), ..sampled.nominal(&feed) };
                sampled.gather(&mut samples, &feed, bone);
                Some(((of, place), samples))
            };
            let in_corners = |of: usize| turning(swept, of, sampled.has_edges);
            let places = |of: usize| around_back(swept, of).into_iter().chain(PLACES).chain(in_corners(of));
            // its axis counts in the second half of the move to it and in the first of the one from it
            let to = places(i).filter(|place| *place >= 0.5).map(|place| (i, place));
            let next = Some(i + 1).filter(|of| *of < near.len());
            let from = next.into_iter().flat_map(|of| places(of).map(move |place| (of, place)));
            let from = from.filter(|(_, place)| *place < 0.5);
            let gathered: Vec<_> = to.chain(from).filter_map(gathered).collect();
            let share = |axis: &Unit<Vector3<f64>>| {
                let forces = gathered.iter().map(|(at, samples)| (*at, sampled.of(samples, axis)));
                forces.map(|((of, place), force)| share(of, (place, &force))).fold(0.0, f64::max)
            };
            let free = self.reached.free.iter(i);
            let all = free.map(|n| (share(&axes[n]).max(1.0), angle_between(&axes[n], wanted), axes[n]));
            all.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1))).map(|(.., axis)| axis)
        };
        let gentlest = |i: &usize| Some((*i, best(*i, &chosen.oriented.axes[*i])?));
        Ok(hot.par_iter().filter_map(gentlest).collect())
    }

    /// Caps with which the figures near structures come down to their bounds, mm/s; none where no figure is above its bound or no
    /// cut can be slower. `speed_mm_s`: the speeds of these forces.
    pub(super) fn eased(
        &self,
        chosen: &Chosen,
        forces: &StructureForces,
        bounds: &Bounds,
        (speed_mm_s, caps_mm_s): (&[f64], &[f64]),
    ) -> Option<Vec<f64>> {
        let slower: Vec<f64> = (0..bounds.near_n.len()).map(|n| bounds.slower(forces, n)).collect();
        let cap = |i: usize| {
            let pushed = |n: &&NearStructure| {
                chosen.forces_of(i).any(|(at, force)| n.most(&force.force_n(speed_mm_s[i]), at) > 0.0)
            };
            let near = self.close_by(i);
            let times = near.iter().filter(|n| pushed(n)).map(|n| slower[n.structure]).fold(1.0, f64::min);
            if times < 1.0 {
                caps_mm_s[i].min((times * speed_mm_s[i]).max(chosen.slowest_mm_s(self.start.case, i)))
            } else {
                caps_mm_s[i]
            }
        };
        let eased: Vec<f64> = (0..caps_mm_s.len()).map(cap).collect();
        let is_slower = (0..eased.len()).any(|i| eased[i] < caps_mm_s[i].min(speed_mm_s[i]) * (1.0 - NEARLY));
        is_slower.then_some(eased)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bonemill_planfile::toward::{StructureFigures, TowardSpan};

    fn case() -> Case {
        let text = "[images]\nct = \"c\"\nlabels = \"l\"\n[target]\nlabel = 1\n[[structure]]\nname = \"nerve\"\nlabel = 2\n";
        Case::parse(text, std::path::Path::new("case.toml")).unwrap()
    }

    /// Cuts of lengths and pushes per speed, N per mm/s, at speeds; beside 8 s that do not push.
    fn forces(cuts: &[[f64; 3]]) -> StructureForces {
        let span = |(row, [mm, per_mm_s, speed]): (usize, &[f64; 3])| {
            let force_n = per_mm_s * speed;
            (TowardSpan { seconds: mm / speed, force_n, peak_n: force_n, row }, 3.0)
        };
        let mut spans: Vec<_> = cuts.iter().enumerate().map(span).collect();
        spans.push((TowardSpan { seconds: 8.0, force_n: 0.0, peak_n: 0.0, row: 9 }, 3.0));
        StructureForces {
            mean_n: 1.0,
            peak_n: 2.0,
            structures: vec![StructureFigures::of(None, &spans, [2.5, 1.0])],
        }
    }

    #[test]
    fn slower_by_what_is_asked_a_figure_is_at_its_bound() {
        let at = |times: f64| forces(&[[2.0, 0.1, times], [4.0, 0.3, times]]);
        let plan = at(1.0);
        // bounds above which one figure is at a time: mean, mean with zeros, peak
        for figure in 0..3 {
            let bounds =
                |n: usize| (JUDGED[n].1)(&plan.structures[0].near) * if n == figure { 0.8 } else { 9.0 };
            let near_n = vec![[0, 1, 2].map(bounds)];
            let bounds = Bounds { mean_n: 1.0, peak_n: 2.0, near_n, ranks: vec![1.0] };
            let times = bounds.slower(&plan, 0);
            assert!(times < 1.0 && bounds.excess(&plan) > 0.2);
            let reached = bounds.share(&at(times), 0);
            assert!((reached - 1.0).abs() < 1e-12, "figure {figure}: {reached} at {times}");
        }
        let none = Bounds::of(&case(), &plan, &[]);
        assert_eq!((none.slower(&plan, 0), none.excess(&plan)), (1.0, 0.0));
    }

    #[test]
    fn a_control_lowers_a_bound_and_next_to_nothing_counts_as_a_millinewton() {
        let (straight, plan) = (forces(&[[2.0, 0.1, 1.0]]), forces(&[[2.0, 1e-5, 1.0]]));
        let control = |forces: &StructureForces| Reference {
            raster: super::super::laid::Raster {
                frame: bonemill_toolpath::path::RasterFrame::at_angle(0.0),
                sense: bonemill_case::Sense::Both,
            },
            speed_mm_s: None,
            total_time_s: 1.0,
            forces: forces.clone(),
        };
        let bounds = Bounds::of(&case(), &straight, &[control(&plan)]);
        assert_eq!(bounds.near_n, vec![[LEAST_N; 3]]);
        let excess = (0.1f64 / LEAST_N).ln();
        assert!((bounds.excess(&straight) - excess).abs() < 1e-12);
        // toward a structure of a fourth of the rank half as much
        let minor = Bounds { ranks: vec![4.0], ..Bounds::of(&case(), &straight, &[control(&plan)]) };
        assert!((minor.excess(&straight) - 0.5 * excess).abs() < 1e-12);
        let with = |mean_n: f64, peak_n: f64| StructureForces { mean_n, peak_n, ..straight.clone() };
        let keeps = |forces: &StructureForces| bounds.keeps_whole(forces, &with(1.0, 2.0));
        assert!(keeps(&with(1.0, 2.03)) && !keeps(&with(1.1, 2.0)) && !keeps(&with(1.0, 2.1)));
        // what was there before is no reason
        assert!(bounds.keeps_whole(&with(1.1, 2.1), &with(1.1, 2.1)));
    }
}
