//! What a user cares for in a plan, to compare plans by.

use bonemill_planner::pipeline::Plan;

/// Figures of a plan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlanFigures {
    /// Share of the target that is removed.
    pub removed_share: f64,
    /// Least distance to a structure, mm; infinite without structures.
    pub least_mm: f64,
    /// Force toward the structures of the first rank within their influence, by time, zeros included, N.
    pub mean_toward_n: f64,
    /// The largest of it, N.
    pub peak_toward_n: f64,
    /// Mean of the force on the burr over cuts, N.
    pub mean_n: f64,
    /// The largest, N.
    pub peak_n: f64,
    /// Total time, s.
    pub total_s: f64,
}

impl PlanFigures {
    /// What [`Self::changes`] tells, in its order.
    pub const HEADS: [&str; 7] =
        ["removed", "distance", "mean toward", "peak toward", "mean |F|", "peak |F|", "time"];

    /// Those of a plan.
    pub fn of(plan: &Plan) -> Self {
        let (case, figures) = (&plan.setup.case, &plan.results.figures);
        let first = || figures.structures.iter().enumerate().filter(|(n, _)| case.rank(*n) <= 1.0);
        let coverage = &plan.results.coverage;
        let distances = figures.structures.iter().filter_map(|s| s.least.map(|(mm, _)| mm));
        Self {
            removed_share: coverage.removed.all_mm3 / coverage.target.all_mm3.max(f64::MIN_POSITIVE),
            least_mm: distances.fold(f64::INFINITY, f64::min),
            mean_toward_n: first().map(|(_, s)| s.force.mean_with_zeros_n).fold(0.0, f64::max),
            peak_toward_n: first().map(|(_, s)| s.force.peak_n).fold(0.0, f64::max),
            mean_n: figures.mean_force_n,
            peak_n: figures.peak_force_n,
            total_s: plan.moves.law.duration_s(),
        }
    }

    /// Changes against another plan, each with the digits that it is told with: of the removed volume, points of %; of the least
    /// distance, mm; of mean and peak toward, of mean and peak |F| and of the total time, %.
    pub fn changes(&self, from: &Self) -> [(f64, usize); 7] {
        let change = |of: fn(&Self) -> f64| {
            let (found, reference) = (of(self), of(from));
            (100.0 * (found - reference) / reference.abs().max(f64::MIN_POSITIVE), 1)
        };
        [
            (100.0 * (self.removed_share - from.removed_share), 2),
            (self.least_mm - from.least_mm, 3),
            change(|f| f.mean_toward_n),
            change(|f| f.peak_toward_n),
            change(|f| f.mean_n),
            change(|f| f.peak_n),
            change(|f| f.total_s),
        ]
    }
}
