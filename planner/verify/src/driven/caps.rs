//! Compares the driven force with the case's caps on force, deflection and spindle power.

use std::f64::consts::PI;

use nalgebra::{Matrix3, Vector3};

use super::super::check::Check;
use super::super::columns::INFLUENCE_MM;
use super::super::requirements::DRIVEN;
use super::super::{Evidence, VerifyError};
use super::{DrivenForce, FORCE_N, FORCE_SHARE, Instant};

/// The checks of the caps that the case has.
///
/// # Errors
/// [`VerifyError::Robot`] where the stiffness does not fit the arm.
pub fn checks(evidence: &Evidence, force: &DrivenForce) -> Result<Vec<Check>, VerifyError> {
    let case = &evidence.plan.record.case;
    let caps = &case.speed.caps;
    let check = |key: &str, most: f64, unit, slack: f64, found: Option<(f64, &Instant)>| {
        Check::at_most(DRIVEN, found.map_or(0.0, |f| f.0), most * (1.0 + FORCE_SHARE) + slack, unit)
            .of(key)
            .at(found.map(|f| f.1.place(evidence)))
    };
    let mut checks = Vec::new();
    if let Some(most_n) = caps.force_n {
        let found = force.largest(|instant| Some(instant.end_n().norm()));
        checks.push(check("speed.force_n", most_n, "N", FORCE_N, found));
    }
    if caps.force_toward_n.is_some() {
        checks.extend(toward(evidence, force));
    }
    if let Some(most_um) = caps.deflection_um {
        let um = deflections_um(evidence, force)?;
        let found = force.largest(|instant| um.get(instant.index).copied());
        checks.push(check("speed.deflection_um", most_um, "µm", 0.0, found));
    }
    if let Some(most_w) = caps.power_w {
        let omega = 2.0 * PI * case.burr.spindle_rpm / 60.0;
        // N mm/s are mW
        let found =
            force.largest(|instant| Some(1e-3 * omega * instant.end.torque_nmm(instant.step.end_mm_s)));
        checks.push(check("speed.power_w", most_w, "W", 0.0, found));
    }
    Ok(checks)
}

/// The cap on the force toward each structure, which depends on the distance: how much of it the driven force exceeds.
fn toward(evidence: &Evidence, force: &DrivenForce) -> Vec<Check> {
    let case = &evidence.plan.record.case;
    let Some(curve) = &case.speed.caps.force_toward_n else { return Vec::new() };
    let radius_mm = case.burr.radius_mm;
    evidence.of_structures(|kept, boxes| {
        let within_mm = radius_mm + kept.clearance_mm + INFLUENCE_MM;
        let toward = force.toward(evidence, boxes, within_mm);
        let beyond = |instant: &Instant| {
            let toward = toward[instant.index]?;
            let most_n = curve.at(toward.distance_mm - radius_mm);
            Some(instant.end_n().dot(&toward.direction).max(0.0) - most_n * (1.0 + FORCE_SHARE))
        };
        let found = force.largest(beyond);
        let check = Check::at_most(DRIVEN, found.map_or(0.0, |f| f.0.max(0.0)), FORCE_N, "N beyond")
            .of(format!("speed.force_toward_n, {}", kept.name));
        vec![check.at(found.map(|f| f.1.place(evidence)))]
    })
}

/// The deflection of the burr at every instant, µm.
fn deflections_um(evidence: &Evidence, force: &DrivenForce) -> Result<Vec<f64>, VerifyError> {
    let plan = evidence.plan;
    let Some(stiffness) = &plan.record.case.robot.joint_stiffness else { return Ok(Vec::new()) };
    let frames = &plan.record.frames;
    let base_from_grid = frames.base_from_ct * frames.ct_from_grid();
    let turn: &Matrix3<f64> = base_from_grid.rotation.matrix();
    let at = |instant: &Instant| {
        let compliance = plan.arm.compliance(plan.trajectory.q_at(instant.step.row), stiffness)?;
        let deflection_mm: Vector3<f64> = compliance * (turn * instant.end_n());
        Ok(1e3 * deflection_mm.norm())
    };
    force.instants.iter().map(at).collect()
}
