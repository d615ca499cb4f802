//! Why a plan falls short of its case, and what else the user should know of it.

use bonemill_case::Case;
use bonemill_robot::timelaw::LimitRatios;
use bonemill_setup::Setup;
use bonemill_toolpath::scene::{Scene, TargetOutside};
use bonemill_toolpath::space::TRAJECTORY_TOLERANCE_MM;

use super::attempt::Attempt;
use super::reference::StructureForces;
use super::rest::RestCause;
use super::too_little::too_little;
use super::{BlockedTurn, Coverage, Modelled, PlanError, percent};

/// Share of the reachable volume below which a plan fell short.
const ENOUGH_REACHED: f64 = 0.99;

impl Attempt<'_> {
    /// Why the plan falls short of its case; empty where it does not.
    ///
    /// # Errors
    /// When a distance field cannot be made.
    pub(super) fn shortfalls(&self, setup: &Setup, modelled: &Modelled) -> Result<Vec<String>, PlanError> {
        let (start, coverage, oriented) = (&self.prepared.start, &self.coverage, &self.chosen.oriented);
        let case = start.case;
        let missed = self.timing.missed.filter(|_| case.speed.total_time_s.is_some());
        let mut found: Vec<String> = target_outside(start.scene).into_iter().collect();
        found.extend(setup.registered.shortfalls(case));
        found.extend(too_little(case, start.scene, start.space, coverage)?);
        found.extend(unreached(case, coverage, modelled.path.unjoined_passes));
        if let Some(missed) = missed {
            found.push(time_missed(missed, &self.compared.plan, &self.why_not_in(missed)?));
        }
        found.extend(self.demand.caps_missed(case, &self.prepared, &self.chosen));
        found.extend(turns_missed(&oriented.blocked_turns));
        found.extend(limits_missed(&modelled.speeds.limit_ratios));
        found.extend(errors_missed(case, modelled));
        let times_s = &self.timing.driven.times_s;
        let time_s = |waypoint: usize| times_s.get(waypoint).copied().unwrap_or_default();
        found.extend(modelled.arm.link_distance.as_ref().and_then(|near| near.shortfall(time_s)));
        Ok(found)
    }

    /// What the user should know beside that.
    ///
    /// # Errors
    /// When the arm's limits are not usable.
    pub(super) fn warnings(&self, setup: &Setup, modelled: &Modelled) -> Result<Vec<String>, PlanError> {
        let case = self.prepared.start.case;
        let missed = self.timing.missed.filter(|_| case.speed.total_time_s.is_none());
        let mut found = setup.warnings.clone();
        found.extend(modelled.arm.lowest_link.and_then(|lowest| lowest.warning()));
        if let Some(missed) = missed {
            found.push(nominal_time_missed(missed, &self.compared.plan, &self.why_not_in(missed)?));
        }
        found.extend(self.compared.warning(case, self.timing.driven.law.duration_s()));
        Ok(found)
    }
}

/// A target that lies partly outside the scan.
fn target_outside(scene: &Scene) -> Option<String> {
    (scene.outside.share > TargetOutside::FEW_SHARE).then(|| {
        format!(
            "{} (expected at most {} %): it counts neither as target nor as removed; give a scan that holds the target or crop \
             the target to the scan",
            scene.outside.text(),
            100.0 * TargetOutside::FEW_SHARE
        )
    })
}

/// Less removed than the burr can reach.
fn unreached(case: &Case, coverage: &Coverage, unjoined_passes: usize) -> Option<String> {
    let share = coverage.reached_share();
    let of_path = |cause: &RestCause| matches!(cause, RestCause::Shank(_) | RestCause::Spacing);
    let parts = coverage.rest.iter().filter(|(cause, _)| of_path(cause));
    let mut why: Vec<String> =
        parts.map(|(cause, mm3)| format!("{mm3:.1} mm³ stay for the {}", cause.text(case))).collect();
    if unjoined_passes > 0 {
        why.push(format!("{} passes could not be joined", unjoined_passes));
    }
    (share < ENOUGH_REACHED).then(|| {
        format!(
            "only {} of what the burr can reach is removed (expected {:.0} %): {}",
            percent(share),
            100.0 * ENOUGH_REACHED,
            why.join("; "),
        )
    })
}

/// A total time that cannot be met, and why.
fn time_missed((asked_s, got_s): (f64, f64), forces: &StructureForces, why: &str) -> String {
    let end = if got_s > asked_s { "shortest" } else { "longest" };
    format!(
        "speed.total_time_s = {asked_s} s cannot be met: the {end} time is {got_s:.1} s, with a mean force of {:.2} N and a largest of \
         {:.2} N; {why}",
        forces.mean_n, forces.peak_n
    )
}

/// The same for a case without `speed.total_time_s`.
fn nominal_time_missed((asked_s, got_s): (f64, f64), forces: &StructureForces, why: &str) -> String {
    format!(
        "the time with every cut at speed.nominal_mm_s, {asked_s:.1} s, cannot be met with the least force: the plan takes \
         {got_s:.1} s, with a mean force of {:.2} N and a largest of {:.2} N (give speed.total_time_s for another time); {why}",
        forces.mean_n, forces.peak_n
    )
}

/// Turns on which the shank is not free: in every mode the plan guarantees that there are none.
fn turns_missed(blocked: &[BlockedTurn]) -> Option<String> {
    let worst = blocked.iter().max_by(|a, b| a.missing_mm.total_cmp(&b.missing_mm))?;
    let missing = if worst.missing_mm.is_finite() {
        format!(
            "the room that it needs, {TRAJECTORY_TOLERANCE_MM} mm for the arm's tolerance included, is missed by up to {:.3} mm",
            worst.missing_mm
        )
    } else {
        "the handpiece is in the way".to_owned()
    };
    Some(format!(
        "the shank cannot turn as it must on {} (the worst to waypoint {}): {missing}; thinner layers or another shank may help",
        if blocked.len() == 1 { "1 move".to_owned() } else { format!("{} moves", blocked.len()) },
        worst.waypoint,
    ))
}

/// Errors that are larger than the case asks for.
fn errors_missed(case: &Case, modelled: &Modelled) -> Vec<String> {
    let (asked, force, path) = (&case.accuracy.asked, &modelled.axes.force_error, &modelled.path.error);
    let missed_force = asked.force.filter(|share| force.exceeds(*share)).map(|share| {
        format!(
            "accuracy.force = {share} is missed: over {} cuts the force errs by {:.5} of it in the mean, the push toward structures by \
             {:.5}; a smaller path.step_mm helps",
            force.cuts, force.of_cuts_share, force.toward_share,
        )
    });
    let missed_removed = asked.removed.filter(|share| path.removed_share.abs() > *share).map(|share| {
        format!(
            "accuracy.removed = {share} is missed: the removed volume errs by {:.5} of the target; a smaller grid.spacing_mm helps",
            path.removed_share
        )
    });
    let missed_distance = asked.distance_mm.filter(|mm| path.distance_mm > *mm).map(|mm| {
        format!(
            "accuracy.distance_mm = {mm} is missed: between two waypoints a structure is nearer by {:.5} mm than at any; a smaller \
             path.step_mm helps",
            path.distance_mm
        )
    });
    [missed_force, missed_removed, missed_distance].into_iter().flatten().collect()
}

/// Joint limits that the time law exceeds; it should never do so.
fn limits_missed(ratios: &LimitRatios) -> Option<String> {
    let LimitRatios { velocity, acceleration, jerk } = *ratios;
    let passed = [velocity, acceleration, jerk].into_iter().any(|ratio| ratio.is_nan() || ratio > 1.0 + 1e-6);
    passed.then(|| {
        format!(
            "joint limits are passed: velocity {velocity:.6}, acceleration {acceleration:.6}, jerk {jerk:.6} of what is allowed"
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_motion_beyond_a_limit_is_a_shortfall() {
        let ratios = |acceleration: f64| LimitRatios { velocity: 0.2, acceleration, jerk: 1.0 };
        assert_eq!(limits_missed(&ratios(1.0 + 1e-9)), None);
        assert!(limits_missed(&ratios(1.0003)).unwrap().contains("acceleration 1.000300"));
        assert!(limits_missed(&ratios(f64::NAN)).is_some());
    }
}
