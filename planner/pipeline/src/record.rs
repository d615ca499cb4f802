//! What `plan.toml` says of a plan: its figures and what was modelled, by name.

use std::path::PathBuf;

use bonemill_arm::ArmKind;
use bonemill_arm::ur::branch_name;
use bonemill_planfile::{Metrics, PlanRecord, Value};

use crate::{
    ForceError, PathError, Plan, Reference, SpeedLevels, StructureForces, Volumes, dropped_by_reason,
    half_turn,
};

/// What `plan.toml` says of a plan; `case_file` is its case's file, relative to the plan's directory once it has one.
pub fn record(plan: &Plan, case_file: PathBuf) -> PlanRecord {
    PlanRecord {
        version: env!("CARGO_PKG_VERSION").into(),
        case: plan.setup.case.clone(),
        case_file,
        inputs: plan.setup.recorded_inputs(),
        frames: plan.setup.frames(),
        metrics: metrics(plan),
        modelled: modelled(plan),
        warnings: plan.warnings.clone(),
        shortfalls: plan.shortfalls.clone(),
    }
}

/// The figures of a plan, the most important first.
fn metrics(plan: &Plan) -> Metrics {
    let (case, scene, arm, speeds) =
        (&plan.setup.case, &plan.setup.scene, &plan.modelled.arm, &plan.modelled.speeds);
    let (coverage, figures, ratios) = (&plan.results.coverage, &plan.results.figures, speeds.limit_ratios);
    let volumes = |v: &Volumes| {
        Value::Table(vec![
            ("all_mm3".into(), v.all_mm3.into()),
            ("material_mm3".into(), v.material_mm3.into()),
            ("bone_mm3".into(), v.bone_mm3.into()),
        ])
    };
    let per_structure = case.structures.iter().zip(&figures.structures);
    let per_structure = per_structure.map(|(s, found)| (s.name.clone(), found.value("waypoint")));
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
                coverage.rest.iter().map(|(cause, mm3)| (cause.text(case), (*mm3).into())).collect(),
            ),
        ),
        ("target_outside_mm3".into(), coverage.outside_mm3.into()),
        ("scan_edge_bone_mm2".into(), scene.edge_bone_mm2.total().into()),
        ("untargeted_bone_by_voxels_mm3".into(), coverage.untargeted_bone_by_voxels_mm3.into()),
        ("thin_bone_by_voxels_mm3".into(), coverage.thin_bone_by_voxels_mm3.into()),
        ("deepest_in_obstacle_mm".into(), coverage.deepest_in_obstacle_mm.into()),
        ("band_mm".into(), scene.band_mm.into()),
        ("removed_mass_mg".into(), figures.removed_mass_mg.into()),
        ("path_length_mm".into(), figures.path_length_mm.into()),
        (
            "joint_limit_ratios".into(),
            Value::Table(vec![
                ("velocity".into(), ratios.velocity.into()),
                ("acceleration".into(), ratios.acceleration.into()),
                ("jerk".into(), ratios.jerk.into()),
            ]),
        ),
        ("smallest_singular_value_mm_s".into(), arm.slowest_mm_s.into()),
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
    if !plan.results.compared.controls.is_empty() {
        more.push(("compared".into(), Value::Table(compared(plan))));
    }
    if let Some(stiffness) = &arm.stiffness {
        let mut along = vec![
            ("softest".into(), stiffness.softest_n_mm.into()),
            ("softest_waypoint".into(), stiffness.softest_waypoint.into()),
            ("mean_softest".into(), stiffness.mean_softest_n_mm.into()),
        ];
        along.extend(stiffness.least_toward_n_mm.map(|n_mm| ("least_toward_structure".into(), n_mm.into())));
        more.push(("stiffness_n_mm".into(), Value::Table(along)));
    }
    more.extend(speeds.levels.as_ref().map(|levels| speed_levels(plan, levels)));
    if let Some((fitted, tre_mm)) = &plan.setup.registered.fitted {
        let at = case.structures.iter().zip(tre_mm);
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
        total_time_s: plan.moves.law.duration_s(),
        more,
    }
}

/// The plan beside its references.
fn compared(plan: &Plan) -> Vec<(String, Value)> {
    let forces = |forces: &StructureForces| -> Vec<(String, Value)> {
        let structures = plan.setup.case.structures.iter().zip(&forces.structures);
        let near =
            structures.map(|(s, found)| (s.name.clone(), Value::Table(found.near.entries("waypoint"))));
        vec![
            ("mean_force_n".into(), forces.mean_n.into()),
            ("peak_force_n".into(), forces.peak_n.into()),
            ("near".into(), Value::Table(near.collect())),
        ]
    };
    let reference = |(name, reference): (String, &Reference)| {
        let turned = reference.raster.frame.angle_rad() + plan.setup.scene.turn_rad;
        let mut entries = vec![
            ("raster_deg".into(), half_turn(turned).to_degrees().into()),
            ("sense".into(), reference.raster.sense.word().into()),
            ("total_time_s".into(), reference.total_time_s.into()),
        ];
        entries.extend(reference.speed_mm_s.map(|v| ("speed_mm_s".into(), v.into())));
        entries.extend(forces(&reference.forces));
        (name, Value::Table(entries))
    };
    let mut entries: Vec<_> = plan.results.compared.named().map(reference).collect();
    let mut of_plan = vec![("total_time_s".into(), plan.moves.law.duration_s().into())];
    of_plan.extend(forces(&plan.results.compared.plan));
    entries.push(("plan".into(), Value::Table(of_plan)));
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
        let structure = worst.structure.and_then(|n| plan.setup.case.structures.get(n));
        entries.extend(structure.map(|s| ("worst_structure".into(), Value::Text(s.name.clone()))));
    }
    ("speed_levels".into(), Value::Table(entries))
}

/// Errors of the forces, as shares of them.
fn force_error(error: &ForceError) -> Value {
    let shares = [
        ("mean", error.mean_share),
        ("of_cuts", error.of_cuts_share),
        ("toward", error.toward_share),
        ("beyond", error.beyond_share),
    ];
    let shares = shares.into_iter().map(|(key, share)| (key.to_owned(), share.into()));
    let elements = ("elements".to_owned(), Value::Integer(error.elements.into()));
    Value::Table([elements, ("cuts".to_owned(), error.cuts.into())].into_iter().chain(shares).collect())
}

/// Errors of the removed volume and of the least distances.
fn path_error(error: &PathError) -> Value {
    Value::Table(vec![
        ("removed".into(), error.removed_share.into()),
        ("distance_mm".into(), error.distance_mm.into()),
    ])
}

fn modelled(plan: &Plan) -> Vec<(String, Value)> {
    let (path, axes, arm) = (&plan.modelled.path, &plan.modelled.axes, &plan.modelled.arm);
    let dropped = dropped_by_reason(&plan.access.dropped).into_iter();
    let dropped = dropped.map(|(why, n)| (why.to_owned(), n.into())).collect();
    let affine = |n: usize| Value::Text(plan.setup.placements[n].to_string());
    let branch = (plan.setup.arm.kind() == ArmKind::Ur)
        .then(|| ("branch_name".into(), Value::Text(branch_name(arm.branch))));
    let lowest = arm.lowest_link.map(|lowest| ("lowest_link_mm".into(), lowest.height_mm.into()));
    let mut entries = vec![
        ("waypoints".into(), path.waypoints.into()),
        ("cutting_waypoints".into(), path.cutting.into()),
        ("cost_with_force".into(), axes.cost_with_force.into()),
        ("cost_closed_form".into(), axes.cost_closed_form.into()),
        ("closed_form_error".into(), axes.closed_form_error.into()),
        ("force_error".into(), force_error(&axes.force_error)),
        ("path_error".into(), path_error(&path.error)),
        ("direction_spacing_deg".into(), axes.direction_spacing_rad.to_degrees().into()),
        ("low_pass_held".into(), axes.low_pass_held.into()),
        ("blocked_turns".into(), axes.blocked_turns.into()),
        ("links_beyond_limit".into(), axes.links_beyond_limit.into()),
        ("put_off_waypoints".into(), path.put_off.into()),
        ("dropped_waypoints".into(), Value::Table(dropped)),
        ("unjoined_passes".into(), path.unjoined_passes.into()),
        ("branch".into(), usize::from(arm.branch).into()),
        ("raster_deg".into(), path.raster_rad.to_degrees().into()),
        ("sense".into(), path.sense.word().into()),
        ("spin".into(), Value::Integer(path.spin.into())),
        ("layers".into(), path.layers.into()),
        ("compliance".into(), plan.setup.case.robot.joint_stiffness.is_some().into()),
        ("ct_affine".into(), affine(0)),
        ("labels_affine".into(), affine(1)),
    ];
    entries.extend(branch.into_iter().chain(lowest));
    let time_s = |waypoint: usize| plan.moves.waypoints.get(waypoint).map_or(0.0, |row| row.time_s);
    let near = arm.link_distance.as_ref();
    entries.extend(near.map(|near| near.entry(&plan.setup.case, time_s(near.waypoint))));
    entries
}
