//! A plan beside its references in the same time: where it pushes more than a simpler plan would.

use bonemill_case::Case;
use bonemill_cutting::importance::Importance;
use bonemill_planfile::toward::{StructureFigures, TowardFigures};

use super::reference::{Reference, StructureForces};

/// Toward a structure, a force up to this counts as none, N: assumed.
pub(super) const NOTHING_N: f64 = 0.01;
/// The same beside a straight shaft with the least force, whose forces are much smaller, N: assumed.
pub(super) const LEAST_N: f64 = 1e-3;
/// Forces toward structures that differ by no more than this share count as the same.
pub(super) const SAME_SHARE: f64 = 0.02;

/// A plan beside its references.
#[derive(Debug, Clone, PartialEq)]
pub struct Compared {
    /// Straight shafts at one speed: lines along, and across; none that the arm cannot drive.
    pub controls: Vec<Reference>,
    /// The straight shaft with the least force; none that the arm cannot drive.
    pub straight: Option<Reference>,
    /// The plan.
    pub plan: StructureForces,
}

/// A figure of the force toward a structure: its name, and where it stands, N.
pub type JudgedFigure = (&'static str, fn(&TowardFigures) -> f64);

/// The figures that a plan is judged by, while the burr's surface is within [`bonemill_planfile::toward::NEAR_MM`] of a structure.
pub const JUDGED: [JudgedFigure; 3] =
    [("mean", |f| f.mean_n), ("mean with zeros", |f| f.mean_with_zeros_n), ("peak", |f| f.peak_n)];

/// A figure in which a plan is worse than the better of its references.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Worse {
    /// Number of the structure in the case.
    pub structure: usize,
    /// Name of the figure.
    pub figure: &'static str,
    /// The reference's, N.
    pub reference_n: f64,
    /// The plan's, N.
    pub plan_n: f64,
}

impl StructureForces {
    /// Where these forces are above those of the better of some references: toward the structures of the case's highest priority, the
    /// worst first; with `nothing_n`, forces up to it count as none.
    fn worse_than(&self, case: &Case, references: &[&Self], nothing_n: f64) -> Vec<Worse> {
        let mut found = Vec::new();
        for n in (0..case.structures.len()).filter(|n| case.rank(*n) <= 1.0) {
            for (figure, value) in JUDGED {
                let of = |forces: &Self| forces.structures.get(n).map_or(0.0, |s| value(&s.near));
                let better = references.iter().map(|r| of(r)).min_by(f64::total_cmp);
                let Some(reference_n) = better else { continue };
                if of(self) > reference_n.max(nothing_n) * (1.0 + SAME_SHARE) {
                    found.push(Worse { structure: n, figure, reference_n, plan_n: of(self) });
                }
            }
        }
        found.sort_by(|a, b| b.ratio(nothing_n).total_cmp(&a.ratio(nothing_n)));
        found
    }

    /// One number to compare drafts of one case by: the mean logarithm of the judged figures toward each structure, by its rank
    /// in the law of importance, and the logarithm of the mean force. So drafts rank by products of forces.
    pub(super) fn score(&self, case: &Case) -> f64 {
        let of = |(n, found): (usize, &StructureFigures)| {
            let logarithms = JUDGED.iter().map(|(_, figure)| figure(&found.near).max(NOTHING_N).ln());
            Importance::by_rank(logarithms.sum::<f64>() / JUDGED.len() as f64, case.rank(n))
        };
        let toward: f64 = self.structures.iter().enumerate().map(of).sum();
        toward + self.mean_n.max(NOTHING_N).ln()
    }
}

impl Compared {
    /// The references, with a name for each: the controls, then the straight shaft with the least force.
    pub fn named(&self) -> impl Iterator<Item = (String, &Reference)> {
        let controls = self.controls.iter().enumerate().map(|(n, c)| (format!("control_{}", n + 1), c));
        controls.chain(self.straight.iter().map(|s| ("straight".to_owned(), s)))
    }

    /// The lower of the controls' figures near a structure, N; none without a control.
    pub fn better_control(&self, structure: usize, figure: fn(&TowardFigures) -> f64) -> Option<f64> {
        let of = |c: &Reference| c.forces.structures.get(structure).map(|s| figure(&s.near));
        self.controls.iter().filter_map(of).min_by(f64::total_cmp)
    }

    /// Where the plan pushes more than the better of its controls toward a structure of the highest priority, the worst first.
    pub fn worse(&self, case: &Case) -> Vec<Worse> {
        let controls: Vec<&StructureForces> = self.controls.iter().map(|c| &c.forces).collect();
        self.plan.worse_than(case, &controls, NOTHING_N)
    }

    /// That a plan that takes `takes_s` pushes more than its controls, in words.
    pub fn warning(&self, case: &Case, takes_s: f64) -> Option<String> {
        let each: Vec<String> = self.worse(case).iter().map(|w| w.text(case)).collect();
        let times = if self.controls.iter().all(|control| control.takes(takes_s)) {
            "the same time".to_owned()
        } else {
            let each: Vec<String> =
                self.controls.iter().map(|c| format!("{:.1} s", c.total_time_s)).collect();
            format!("{} (the plan takes {takes_s:.1} s)", each.join(" or "))
        };
        (!each.is_empty()).then(|| {
            format!(
                "near a structure of the highest priority the plan pushes more than a straight shaft at constant speed would in {times}: \
                 {}; see the forces in the report, speed.total_time_s and path.raster_deg",
                each.join(", ")
            )
        })
    }
}

impl Worse {
    fn text(&self, case: &Case) -> String {
        let name = case.structures.get(self.structure).map_or("", |s| s.name.as_str());
        format!("{} toward {name} {:.4} N instead of {:.4} N", self.figure, self.plan_n, self.reference_n)
    }

    /// The plan's figure over the reference's.
    fn ratio(&self, nothing_n: f64) -> f64 {
        self.plan_n / self.reference_n.max(nothing_n)
    }
}

#[cfg(test)]
mod tests {
    use super::super::laid::Raster;
    use super::*;
    use bonemill_case::Sense;
    use bonemill_planfile::toward::TowardSpan;
    use bonemill_toolpath::path::RasterFrame;

    #[test]
    fn a_control_that_takes_another_time_is_told_with_it() {
        let forces = |force_n: f64| {
            let span = TowardSpan { seconds: 1.0, force_n, peak_n: force_n, row: 0 };
            let structures = vec![StructureFigures::of(None, &[(span, 3.0)], [2.5, 1.0])];
            StructureForces { mean_n: force_n, peak_n: force_n, structures }
        };
        let raster = Raster { frame: RasterFrame::at_angle(0.0), sense: Sense::Both };
        let control = Reference { raster, speed_mm_s: Some(1.0), total_time_s: 1834.0, forces: forces(0.1) };
        let compared = Compared { controls: vec![control], straight: None, plan: forces(0.2) };
        let text = "[images]\nct = \"c\"\nlabels = \"l\"\n[target]\nlabel = 1\n[[structure]]\nname = \"nerve\"\nlabel = 2\n";
        let case = Case::parse(text, std::path::Path::new("case.toml")).unwrap();
        let told = |takes_s| compared.warning(&case, takes_s).unwrap();
        assert!(
            told(1834.02).contains("would in the same time: mean toward nerve 0.2000 N"),
            "{}",
            told(1834.02)
        );
        assert!(told(2333.0).contains("would in 1834.0 s (the plan takes 2333.0 s): "), "{}", told(2333.0));
    }
}
