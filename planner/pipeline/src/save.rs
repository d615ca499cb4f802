//! A plan's files but for its report, written into a staged directory.

use std::fs::File;
use std::path::Path;

use bonemill_arm::ur::branch_name;
use bonemill_arm::{ArmKind, JointKind};
use bonemill_case::Registration;
use bonemill_export::write_trajectory_csv;
use bonemill_planfile::{
    CASE_COPY, FILES, Metrics, NOTES, PlanFileError, PlanRecord, PlanningGrid, StagedDirectory, Value,
    copy_input, write_forces, write_waypoints,
};

use crate::access_csv::{access_csv, dropped_csv};
use crate::{Control, Felt, Plan, SpeedLevels, Volumes, dropped_by_reason, half_turn};

/// Writes the files of `plan`, but for its report, into the staged directory; `case_path` is where its case was read from.
///
/// # Errors
/// [`PlanFileError`] when a file cannot be written or a figure is not finite; the caller drops the staged directory.
pub fn save(plan: &Plan, case_path: &Path, staged: &StagedDirectory) -> Result<PlanRecord, PlanFileError> {
    let dir = staged.path();
    let [waypoints, forces, trajectory, urdf, _] = FILES;
    let [access, dropped] = NOTES;
    let [waypoints, forces, trajectory] = [waypoints, forces, trajectory].map(|name| dir.join(name));
    let write_law = || -> std::io::Result<()> {
        // written in large portions: a buffer would only copy them
        let mut out = File::create(&trajectory)?;
        let kinds: Vec<JointKind> = plan.arm.joints().iter().map(|joint| joint.kind).collect();
        let rows = plan.law.rows(plan.case.robot.rate_hz).map_err(std::io::Error::other)?;
        write_trajectory_csv(&mut out, &rows, &kinds).map_err(std::io::Error::other)?;
        Ok(())
    };
    let record = record(plan, staged.relative(case_path)?);
    let write_rest = || -> Result<(), PlanFileError> {
        if let Some((case, _)) =
            plan.inputs.iter().find(|(input, _)| record.case_input() == Some(&input.path))
        {
            copy_input(case_path, &dir.join(CASE_COPY), case)?;
        }
        write_waypoints(&waypoints, &plan.waypoints, &plan.case.structures)?;
        write_forces(&forces, &plan.forces, &plan.case.structures)?;
        staged.write(urdf, plan.arm.urdf_text())?;
        staged.write(access, &access_csv(&plan.allowed))?;
        staged.write(dropped, &dropped_csv(&plan.dropped, &plan.scene))
    };
    let (law, rest) = rayon::join(write_law, write_rest);
    law.map_err(PlanFileError::io("write", &trajectory))?;
    rest?;
    record.write(dir)?;
    Ok(record)
}

/// What `plan.toml` says of a plan; `case_file` is its case's file, relative to the plan's directory once it has one.
pub fn record(plan: &Plan, case_file: std::path::PathBuf) -> PlanRecord {
    PlanRecord {
        version: env!("CARGO_PKG_VERSION").into(),
        case: plan.case.clone(),
        case_file,
        inputs: plan.inputs.iter().map(|(input, _)| input.clone()).collect(),
        approach_direction: plan.scene.approach,
        ct_from_approach: plan.scene.ct_from_approach(),
        grid: PlanningGrid { dims: plan.scene.class.grid().dims(), turn_rad: plan.scene.turn_rad },
        base_from_ct: plan.base_from_ct,
        registration_assumed: plan.case.robot.base_from_ct == Registration::Assumed,
        // the case's own angles: those of the arm's rotation lose digits at gimbal lock
        flange_from_burr: plan.case.robot.flange_from_burr.unwrap_or_default(),
        metrics: metrics(plan),
        modelled: modelled(plan),
        warnings: plan.warnings.clone(),
        shortfalls: plan.shortfalls.clone(),
    }
}

/// The figures of a plan, in the order in which a reader asks for them.
fn metrics(plan: &Plan) -> Metrics {
    let (coverage, figures, ratios) = (&plan.coverage, &plan.figures, plan.modelled.limit_ratios);
    let volumes = |v: &Volumes| {
        Value::Table(vec![
            ("all_mm3".into(), v.all_mm3.into()),
            ("material_mm3".into(), v.material_mm3.into()),
            ("bone_mm3".into(), v.bone_mm3.into()),
        ])
    };
    let per_structure = plan.case.structures.iter().zip(&figures.structures);
    let per_structure =
        per_structure.map(|(s, found)| (s.name.clone(), found.value(plan.case.burr.radius_mm, "waypoint")));
    let mut more = vec![
        ("reached_share".into(), coverage.reached_share().into()),
        ("removed_share".into(), coverage.removed_share().into()),
        ("target".into(), volumes(&coverage.target)),
        ("reachable".into(), volumes(&coverage.reachable)),
        ("removed".into(), volumes(&coverage.removed)),
        ("removed_reachable".into(), volumes(&coverage.removed_reachable)),
        (
            "not_removed_mm3".into(),
            Value::Table(
                coverage.rest.iter().map(|(cause, mm3)| (cause.text(&plan.case), (*mm3).into())).collect(),
            ),
        ),
        ("target_outside_mm3".into(), coverage.outside_mm3.into()),
        ("scan_edge_bone_mm2".into(), plan.scene.edge_bone_mm2.total().into()),
        ("untargeted_bone_removed_mm3".into(), coverage.untargeted_bone_removed_mm3.into()),
        ("thin_bone_removed_mm3".into(), coverage.thin_bone_removed_mm3.into()),
        ("deepest_in_obstacle_mm".into(), coverage.deepest_in_obstacle_mm.into()),
        ("band_mm".into(), plan.scene.band_mm.into()),
        ("removed_mass_mg".into(), figures.removed_mass_mg.into()),
        ("path_length_mm".into(), figures.path_length_mm.into()),
        ("time_at_speed_caps_s".into(), plan.modelled.time_at_caps_s.into()),
        (
            "joint_limit_ratios".into(),
            Value::Table(vec![
                ("velocity".into(), ratios.velocity.into()),
                ("acceleration".into(), ratios.acceleration.into()),
                ("jerk".into(), ratios.jerk.into()),
            ]),
        ),
        ("smallest_singular_value_mm_s".into(), plan.modelled.slowest_mm_s.into()),
        ("peak_force_n".into(), figures.peak_force_n.into()),
        ("mean_force_n".into(), figures.mean_force_n.into()),
        (
            "seconds_by_kind".into(),
            Value::Table(
                figures.seconds_by_kind.iter().map(|(k, s)| (k.word().into(), (*s).into())).collect(),
            ),
        ),
        ("structures".into(), Value::Table(per_structure.collect())),
    ];
    if !plan.compared.controls.is_empty() {
        more.push(("compared".into(), Value::Table(compared(plan))));
    }
    if let Some(stiffness) = &plan.modelled.stiffness {
        let mut along = vec![
            ("softest".into(), stiffness.softest_n_mm.into()),
            ("softest_waypoint".into(), stiffness.softest_waypoint.into()),
            ("mean_softest".into(), stiffness.mean_softest_n_mm.into()),
        ];
        along.extend(stiffness.least_toward_n_mm.map(|n_mm| ("least_toward_structure".into(), n_mm.into())));
        more.push(("stiffness_n_mm".into(), Value::Table(along)));
    }
    more.extend(plan.modelled.speed_levels.as_ref().map(|levels| speed_levels(plan, levels)));
    if let Some((fitted, tre_mm)) = &plan.fitted {
        let at = plan.case.structures.iter().zip(tre_mm);
        let at = at.filter_map(|(structure, tre)| Some((structure.name.clone(), (*tre)?.into()))).collect();
        more.push(("fre_mm".into(), fitted.fre_mm.into()));
        let residuals = fitted.residual_mm.iter().enumerate();
        let residuals = residuals.map(|(n, mm)| ((n + 1).to_string(), (*mm).into())).collect();
        more.push(("fiducial_residuals_mm".into(), Value::Table(residuals)));
        more.push(("expected_error_mm".into(), Value::Table(at)));
    }
    Metrics {
        removed_mm3: coverage.removed.all_mm3,
        reachable_mm3: coverage.reachable.all_mm3,
        target_mm3: coverage.target.all_mm3,
        removed_material_mm3: coverage.removed.material_mm3,
        removed_bone_mm3: coverage.removed.bone_mm3,
        total_time_s: plan.law.duration_s(),
        more,
    }
}

/// The plan beside its controls.
fn compared(plan: &Plan) -> Vec<(String, Value)> {
    let felt = |felt: &Felt| -> Vec<(String, Value)> {
        let structures = plan.case.structures.iter().zip(&felt.structures);
        let near =
            structures.map(|(s, found)| (s.name.clone(), Value::Table(found.near.entries("waypoint"))));
        vec![
            ("mean_force_n".into(), felt.mean_n.into()),
            ("peak_force_n".into(), felt.peak_n.into()),
            ("near".into(), Value::Table(near.collect())),
        ]
    };
    let control = |(number, control): (usize, &Control)| {
        let mut entries = felt(&control.felt);
        let turned = control.raster_rad + plan.scene.turn_rad;
        entries.insert(0, ("raster_deg".into(), half_turn(turned).to_degrees().into()));
        entries.insert(1, ("speed_mm_s".into(), control.speed_mm_s.into()));
        (format!("control_{}", number + 1), Value::Table(entries))
    };
    let mut entries: Vec<_> = plan.compared.controls.iter().enumerate().map(control).collect();
    entries.push(("plan".into(), Value::Table(felt(&plan.compared.plan))));
    entries
}

/// The levels of force of a plan with the least force in its time.
fn speed_levels(plan: &Plan, levels: &SpeedLevels) -> (String, Value) {
    let (unit, factor) = levels.unit();
    let mut entries = vec![
        (format!("toward_{unit}"), (factor * levels.toward).into()),
        (format!("overall_{unit}"), (factor * levels.overall).into()),
        ("exceeded_cuts".into(), levels.exceeded.into()),
    ];
    if let Some(worst) = levels.worst {
        entries.push(("worst_waypoint".into(), worst.waypoint.into()));
        entries.push((format!("worst_excess_{unit}"), (factor * worst.by).into()));
        let structure = worst.structure.and_then(|n| plan.case.structures.get(n));
        entries.extend(structure.map(|s| ("worst_structure".into(), Value::Text(s.name.clone()))));
    }
    ("speed_levels".into(), Value::Table(entries))
}

fn modelled(plan: &Plan) -> Vec<(String, Value)> {
    let m = &plan.modelled;
    let dropped = dropped_by_reason(&plan.dropped).into_iter();
    let dropped = dropped.map(|(why, n)| (why.to_owned(), n.into())).collect();
    let affine = |n: usize| Value::Text(plan.affines[n].to_string());
    let branch =
        (plan.arm.kind() == ArmKind::Ur).then(|| ("branch_name".into(), Value::Text(branch_name(m.branch))));
    let lowest = m.lowest_link.map(|lowest| ("lowest_link_mm".into(), lowest.height_mm.into()));
    let mut entries = vec![
        ("waypoints".into(), m.waypoints.into()),
        ("cutting_waypoints".into(), m.cutting.into()),
        ("cost_with_force".into(), m.cost_with_force.into()),
        ("cost_closed_form".into(), m.cost_closed_form.into()),
        ("closed_form_error".into(), m.closed_form_error.into()),
        ("direction_spacing_deg".into(), m.direction_spacing_rad.to_degrees().into()),
        ("low_pass_held".into(), m.low_pass_held.into()),
        ("blocked_turns".into(), m.blocked_turns.into()),
        ("links_beyond_limit".into(), m.links_beyond_limit.into()),
        ("put_off_waypoints".into(), m.put_off.into()),
        ("dropped_waypoints".into(), Value::Table(dropped)),
        ("unjoined_passes".into(), m.unjoined_passes.into()),
        ("branch".into(), usize::from(m.branch).into()),
        ("instead".into(), m.instead.unwrap_or("nothing").into()),
        ("raster_deg".into(), m.raster_rad.to_degrees().into()),
        ("sense".into(), m.sense.word().into()),
        ("layers".into(), m.layers.into()),
        ("compliance".into(), plan.case.robot.joint_stiffness.is_some().into()),
        ("ct_affine".into(), affine(0)),
        ("labels_affine".into(), affine(1)),
    ];
    entries.extend(branch.into_iter().chain(lowest));
    entries
}
