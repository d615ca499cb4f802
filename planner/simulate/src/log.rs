//! Replays a force log in the engine and computes the model's force for every row, for a calibration.

use bonemill_cutting::calibrate::Observation;
use bonemill_planfile::ForceLogRow;
use nalgebra::Vector3;

use super::replay::{SimulateError, SimulationSetup};
use super::scene::bone_of;
use super::{Engine, FlutedBurr, Move, Pose, force_per_coefficient};

/// Mills the scene along a log's poses and pairs each row except the first with the model's force per unit of each
/// coefficient, in work.
///
/// A row in which the shank touches bone, or the burr stands still, is left out. With t0 > 0 the edge term depends on the
/// chip thickness as in the case.
///
/// # Errors
/// [`SimulateError::Engine`] for an invalid pose.
pub fn observe(setup: &SimulationSetup, rows: &[ForceLogRow]) -> Result<Vec<Observation>, SimulateError> {
    let work_from_ct = setup.scene.ct_from_work.inverse();
    let pose = |row: &ForceLogRow| Pose::new(work_from_ct * row.position, work_from_ct.rotate(&row.axis));
    let mut spec = setup.spec.clone();
    // an edge coefficient above 0, so that the edge's directions are summed for every case
    let t0_mm = spec.material.t0_mm();
    spec.material = spec.material.with_edge([1.0; 3], t0_mm)?;
    let (tool, model) =
        (spec.tool.clone(), FlutedBurr { tool: spec.tool.clone(), material: spec.material.clone() });
    let Some(first) = rows.first() else { return Ok(Vec::new()) };
    let mut engine = Engine::new(bone_of(&setup.scene, &setup.density_g_cm3)?, spec, model, pose(first)?)?;
    let mut log = Vec::with_capacity(rows.len());
    for pair in rows.windows(2) {
        let to = Move::straight(pose(&pair[1])?, pair[1].time_s - pair[0].time_s);
        let met = engine.meet(&to)?;
        let step = engine.step(to)?;
        let (Some(met), None) = (met, step.contact) else { continue };
        let force_n: Vector3<f64> = work_from_ct.rotate(&pair[1].force_n);
        log.push(Observation { per_coefficient: force_per_coefficient(&met, &tool), force_n });
    }
    Ok(log)
}
