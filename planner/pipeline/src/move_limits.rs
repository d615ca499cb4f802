//! What limits the speed of each move: mass, cost, and caps on force.

use bonemill_case::Case;
use bonemill_cutting::cost::Proximity;
use bonemill_cutting::metrics::Moments;
use bonemill_cutting::speed::{CappedBurr, CutPushes, ForceCaps};
use bonemill_setup::tools;

use super::PlanError;
use super::choose::{Choices, Chosen};
use super::levels;
use super::prepared::Prepared;
use super::speeds::{self, Aim, SpeedInput};

/// One entry per waypoint each.
#[derive(Debug, Clone)]
pub struct MoveLimits {
    mass_mg: Vec<f64>,
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

    /// Cuts that break a cap even at the slowest speed allowed, in words.
    pub(super) fn caps_missed(&self, case: &Case, prepared: &Prepared, chosen: &Chosen) -> Option<String> {
        let caps = &self.force_cap_mm_s;
        let missed: Vec<usize> =
            (0..caps.len()).filter(|i| caps[*i] < chosen.slowest_mm_s(case, *i)).collect();
        let worst = missed.iter().copied().min_by(|a, b| caps[*a].total_cmp(&caps[*b]))?;
        let slowest = chosen.slowest_mm_s(case, worst);
        let force = chosen.forces[worst].map(|f| f.force_n(slowest)).unwrap_or_default();
        let toward_n = prepared.nearest(worst).map_or(0.0, |near| force.dot(&near.toward).max(0.0));
        Some(format!(
            "{} cuts break a cap on force, deflection or power even at speed.min_mm_s = {slowest} mm/s; the worst, waypoint \
             {worst}, would need {:.3} mm/s (force there {:.2} N, toward the nearest structure {toward_n:.2} N)",
            missed.len(),
            caps[worst],
            force.norm(),
        ))
    }
}

fn force_caps(case: &Case, prepared: &Prepared, chosen: &Chosen) -> Vec<f64> {
    if !case.speed.mode.keeps_caps() {
        return vec![f64::INFINITY; chosen.forces.len()];
    }
    let caps = ForceCaps {
        toward_n: case.speed.caps.force_toward_n.clone(),
        total_n: case.speed.caps.force_n,
        deflection_mm: case.speed.caps.deflection_um.map(|um| um * 1e-3),
        power_mw: case.speed.caps.power_w.map(|w| w * 1e3),
    };
    let burr = CappedBurr { radius_mm: case.burr.radius_mm, spindle_rpm: case.burr.spindle_rpm };
    let fastest = |i: usize| {
        let near: Vec<Proximity> = prepared.near[i].iter().map(|n| n.proximity).collect();
        let compliance = chosen.compliances.as_ref().map(|c| &c[i]);
        let forces = chosen.forces_of(i);
        forces.map(|force| caps.fastest_mm_s(burr, force, &near, compliance)).fold(f64::INFINITY, f64::min)
    };
    (0..chosen.forces.len()).map(fastest).collect()
}
