//! What limits the speed of each move: mass, cost, and caps on force.

use std::collections::BTreeMap;

use bonemill_case::Case;
use bonemill_cutting::burr::EngagedForce;
use bonemill_cutting::cost::Proximity;
use bonemill_cutting::metrics::Moments;
use bonemill_cutting::speed::{Cap, CappedBurr, CutPushes, ForceCaps};
use bonemill_setup::nearest_structures::NearStructure;
use bonemill_setup::tools;
use nalgebra::Matrix3;

use super::PlanError;
use super::choose::{Choices, Chosen};
use super::levels;
use super::prepared::Prepared;
use super::speeds::{self, Aim, SpeedInput};

/// One entry per waypoint each.
#[derive(Debug, Clone)]
pub struct MoveLimits {
    mass_mg: Vec<f64>,
    slowest_mm_s: Vec<f64>,
    cost: Vec<f64>,
    /// Fastest speed under the case's caps, mm/s; infinite where none binds.
    pub(super) force_cap_mm_s: Vec<f64>,
    /// What pushes the burr; empty unless the mode asks for the least force.
    pub(super) pushes: Vec<Option<CutPushes>>,
}

impl Prepared<'_> {
    pub(super) fn demand(&self, choices: &Choices, chosen: &Chosen) -> Result<MoveLimits, PlanError> {
        let case = &choices.applied_to(self.start.case);
        let pushes = {
            let forces = (&chosen.forces[..], &chosen.within[..]);
            levels::pushes_of_mode(case, &self.near, forces, chosen.compliances.as_deref())?
        };
        Ok(MoveLimits {
            mass_mg: self.reached.moments.iter().map(Moments::mass_mg).collect(),
            slowest_mm_s: (0..chosen.kinds.len()).map(|i| chosen.slowest_mm_s(case, i)).collect(),
            cost: chosen.costs.iter().map(|c| c.cost).collect(),
            force_cap_mm_s: force_caps(case, self, chosen),
            pushes,
        })
    }

    /// Largest speed of every move by the speed mode, mm/s, without the joints' limits; the cuts take `cutting_s` in all
    /// if it is given.
    ///
    /// # Errors
    /// When the speed range is not usable, or the time cannot be had within it.
    pub fn speeds(
        &self,
        choices: &Choices,
        chosen: &Chosen,
        cutting_s: Option<f64>,
    ) -> Result<Vec<f64>, PlanError> {
        let demand = self.demand(choices, chosen)?;
        Ok(speeds::caps(&demand.input(self, choices, chosen), cutting_s, &Aim::default())?.mm_s)
    }
}

impl MoveLimits {
    pub(super) fn input<'a>(
        &'a self,
        prepared: &'a Prepared,
        choices: &'a Choices,
        chosen: &'a Chosen,
    ) -> SpeedInput<'a> {
        SpeedInput {
            kinds: &chosen.kinds,
            length_mm: prepared.length_mm(),
            mass_mg: &self.mass_mg,
            slowest_mm_s: &self.slowest_mm_s,
            cost: &self.cost,
            force_cap_mm_s: &self.force_cap_mm_s,
            pushes: &self.pushes,
            step_mm: prepared.start.case.path.step_mm,
            slot_mass_mg: tools::slot_mass_mg(
                &choices.applied_to(prepared.start.case),
                prepared.start.case.path.step_mm,
            ),
            spec: &choices.speed,
            smoothing: speeds::smoothing(prepared.start.case),
        }
    }

    /// Cuts that break a cap even at the slowest speed allowed, in words for each cap.
    pub(super) fn caps_missed(&self, case: &Case, prepared: &Prepared, chosen: &Chosen) -> Vec<String> {
        let caps = Caps::new(case, prepared, chosen);
        let mut broken: BTreeMap<&str, Broken> = BTreeMap::new();
        for i in 0..self.force_cap_mm_s.len() {
            let slowest_mm_s = self.slowest_mm_s[i];
            if self.force_cap_mm_s[i] >= slowest_mm_s {
                continue;
            }
            caps.for_each(i, |binding| {
                if binding.fastest_mm_s >= slowest_mm_s {
                    return;
                }
                let found =
                    broken.entry(key(binding.cap)).or_insert(Broken { moves: 0, last: i, worst: i, binding });
                if found.moves == 0 || found.last != i {
                    (found.moves, found.last) = (found.moves + 1, i);
                }
                if binding.fastest_mm_s < found.binding.fastest_mm_s {
                    (found.worst, found.binding) = (i, binding);
                }
            });
        }
        broken.iter().map(|(key, broken)| caps.words(key, broken)).collect()
    }
}

/// Moves that break one cap, the worst of them, and its force.
struct Broken {
    moves: usize,
    /// The last that was counted.
    last: usize,
    worst: usize,
    binding: Binding,
}

/// A cap with the largest speed that keeps it, and the force that it bounds.
#[derive(Clone, Copy)]
struct Binding {
    cap: Cap,
    fastest_mm_s: f64,
    force: EngagedForce,
    /// Share of the move's way after which it is.
    share: f64,
}

/// The key of a cap in the case.
fn key(cap: Cap) -> &'static str {
    match cap {
        Cap::Toward(_) => "speed.force_toward_n",
        Cap::Total => "speed.force_n",
        Cap::Deflection => "speed.deflection_um",
        Cap::Power => "speed.power_w",
    }
}

/// The caps of a case on the moves of a plan.
struct Caps<'a> {
    case: &'a Case,
    prepared: &'a Prepared<'a>,
    chosen: &'a Chosen,
    caps: ForceCaps,
    burr: CappedBurr,
}

impl<'a> Caps<'a> {
    fn new(case: &'a Case, prepared: &'a Prepared<'a>, chosen: &'a Chosen) -> Self {
        let given = &case.speed.caps;
        let caps = ForceCaps {
            toward_n: given.force_toward_n.clone(),
            total_n: given.force_n,
            deflection_mm: given.deflection_um.map(|um| um * 1e-3),
            power_mw: given.power_w.map(|w| w * 1e3),
        };
        let burr = CappedBurr { radius_mm: case.burr.radius_mm, spindle_rpm: case.burr.spindle_rpm };
        Self { case, prepared, chosen, caps, burr }
    }

    /// The structures near move i as they are seen after a share of its way.
    fn near(&self, i: usize, share: f64) -> Vec<NearStructure> {
        NearStructure::in_both_directions(&self.prepared.near[i], share)
    }

    /// The same, and the arm's compliance there.
    fn around(&self, i: usize, share: f64) -> (Vec<Proximity>, Option<&Matrix3<f64>>) {
        let near = self.near(i, share).iter().map(|n| n.proximity).collect();
        (near, self.chosen.compliances.as_ref().map(|c| &c[i]))
    }

    /// Every cap on move i, for each of its forces.
    fn for_each(&self, i: usize, mut take: impl FnMut(Binding)) {
        for (share, force) in self.chosen.forces_of(i) {
            let (near, compliance) = self.around(i, share);
            self.caps.for_each(self.burr, force, (&near, compliance), |cap, fastest_mm_s| {
                take(Binding { cap, fastest_mm_s, force: *force, share });
            });
        }
    }

    /// A cap with its figure, and by how much the worst move breaks it.
    fn words(&self, key: &str, Broken { moves, worst, binding, .. }: &Broken) -> String {
        let slowest_mm_s = self.chosen.slowest_mm_s(self.case, *worst);
        let (near, compliance) = self.around(*worst, binding.share);
        let around = (&near[..], compliance);
        let taken = self.caps.taken((binding.cap, slowest_mm_s), self.burr, &binding.force, around);
        let (factor, unit) = match binding.cap {
            Cap::Toward(_) | Cap::Total => (1.0, "N"),
            Cap::Deflection => (1e3, "µm"),
            Cap::Power => (1e-3, "W"),
        };
        let [taken, most] = taken.unwrap_or_default().map(|of| factor * of);
        let from = match binding.cap {
            Cap::Toward(n) => {
                let near = self.near(*worst, binding.share)[n];
                let name = self.case.structures.get(near.structure).map_or("", |s| s.name.as_str());
                format!(", {:.2} mm from {name}", near.proximity.distance_mm - self.burr.radius_mm)
            }
            _ => String::new(),
        };
        let needs = match binding.fastest_mm_s {
            v if v >= 0.01 => format!("would need {v:.3} mm/s"),
            v if v > 0.0 => format!("would need {v:.1e} mm/s"),
            // the edges' own force does not fall with the speed
            _ => "no speed keeps it".to_owned(),
        };
        let moves = if *moves == 1 { "1 move breaks".to_owned() } else { format!("{moves} moves break") };
        format!(
            "{moves} {key} even at the least speed; the worst, waypoint {worst}{from}, has {taken:.3} {unit} at {slowest_mm_s} mm/s instead of \
             at most {most:.3} {unit}, and {needs} (see speed.min_mm_s)"
        )
    }
}

fn force_caps(case: &Case, prepared: &Prepared, chosen: &Chosen) -> Vec<f64> {
    let caps = Caps::new(case, prepared, chosen);
    let fastest = |i: usize| {
        let mut fastest = f64::INFINITY;
        if case.speed.mode.keeps_caps() {
            caps.for_each(i, |binding| fastest = fastest.min(binding.fastest_mm_s));
        }
        fastest
    };
    (0..chosen.forces.len()).map(fastest).collect()
}
