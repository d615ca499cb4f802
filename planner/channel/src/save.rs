//! A planned channel's files but for its report, and what `plan.toml` says of it.

use std::path::{Path, PathBuf};

use bonemill_arm::ArmKind;
use bonemill_arm::ur::branch_name;
use bonemill_cutting::cutter::MoveKind;
use bonemill_planfile::{
    Metrics, PLUNGE, PlanContents, PlanFileError, PlanRecord, StagedDirectory, Value, plunge_text,
};
use bonemill_setup::armpath::write_trajectory;

use crate::plan::ChannelPlan;
use crate::risk::KeptClearance;
use crate::safest::SafeChannel;

/// What `plan.toml` says; `case_file` is the path of the case's file from the plan's folder.
pub fn record(plan: &ChannelPlan, case_file: PathBuf) -> PlanRecord {
    let setup = &plan.setup;
    PlanRecord {
        version: env!("CARGO_PKG_VERSION").into(),
        case: setup.case.clone(),
        case_file,
        inputs: setup.recorded_inputs(),
        frames: setup.frames(),
        metrics: metrics(plan),
        modelled: modelled(plan),
        warnings: plan.warnings.clone(),
        shortfalls: plan.shortfalls.clone(),
    }
}

/// Writes the files of `plan`, but for its report, into the staged directory; `case_path` is where its case was read from.
///
/// # Errors
/// [`PlanFileError`] when a file cannot be written or a figure is not finite.
pub fn save(
    plan: &ChannelPlan,
    case_path: &Path,
    staged: &StagedDirectory,
) -> Result<PlanRecord, PlanFileError> {
    let setup = &plan.setup;
    let record = record(plan, staged.relative(case_path)?);
    let contents = PlanContents {
        record: &record,
        waypoints: &plan.waypoints,
        forces: &plan.forces,
        arm: &setup.arm,
        notes: &[(PLUNGE, plunge_text(&plan.plunge)?)],
    };
    let rate_hz = setup.case.robot.rate_hz;
    contents
        .write(case_path, staged, |file| write_trajectory(&plan.motion.law, &setup.arm, rate_hz, file))?;
    Ok(record)
}

fn metrics(plan: &ChannelPlan) -> Metrics {
    let (v, case) = (&plan.volumes, &plan.setup.case);
    let peak = |of: fn(&bonemill_planfile::PlungeRow) -> f64| plan.plunge.iter().map(of).fold(0.0, f64::max);
    let ratios = plan.motion.limit_ratios;
    let kind_s = |kind: MoveKind| {
        let before = std::iter::once(0.0).chain(plan.waypoints.iter().map(|w| w.time_s));
        let all = plan.waypoints.iter().zip(before).filter(|(w, _)| w.kind == kind);
        all.map(|(w, before)| w.time_s - before).sum::<f64>()
    };
    let seconds = MoveKind::ALL.map(|kind| (kind.word().to_owned(), kind_s(kind).into()));
    let kept = plan.channel.kept.iter().zip(&plan.holder_clearance_mm).zip(&case.structures);
    let kept = kept.filter_map(|((kept, holder), s)| {
        let mut entries = kept_entries(kept.as_ref()?);
        entries
            .extend(holder.filter(|mm| mm.is_finite()).map(|mm| ("holder_clearance_mm".into(), mm.into())));
        Some((s.name.clone(), Value::Table(entries)))
    });
    let mut more = vec![
        ("removed_share".into(), 1.0.into()),
        ("reached_share".into(), 1.0.into()),
        plan.record.entry(),
        ("removed_mass_mg".into(), plan.waypoints.iter().map(|w| w.mass_mg).sum::<f64>().into()),
        ("peak_thrust_n".into(), peak(|row| row.thrust_n).into()),
        ("peak_torque_nmm".into(), peak(|row| row.torque_nmm).into()),
        ("peak_lateral_n".into(), peak(|row| row.lateral_n).into()),
        ("largest_contact_mm2".into(), peak(|row| row.contact_mm2).into()),
        (
            "joint_limit_ratios".into(),
            Value::Table(vec![
                ("velocity".into(), ratios.velocity.into()),
                ("acceleration".into(), ratios.acceleration.into()),
                ("jerk".into(), ratios.jerk.into()),
            ]),
        ),
        ("seconds_by_kind".into(), Value::Table(seconds.into())),
        ("kept".into(), Value::Table(kept.collect())),
    ];
    if plan.found.channels.len() > 1 {
        let channel = |channel: &SafeChannel| Value::Table(channel_entries(plan, channel));
        more.push(("channels".into(), Value::List(plan.found.channels.iter().map(channel).collect())));
    }
    Metrics {
        removed_mm3: v.all_mm3,
        reachable_mm3: v.all_mm3,
        target_mm3: v.all_mm3,
        removed_material_mm3: v.material_mm3,
        removed_bone_mm3: v.bone_mm3,
        total_time_s: plan.motion.law.duration_s(),
        more,
    }
}

fn kept_entries(kept: &KeptClearance) -> Vec<(String, Value)> {
    vec![
        ("clearance_mm".into(), kept.clearance_mm.into()),
        ("at_depth_mm".into(), kept.depth_mm.into()),
        ("sigma_mm".into(), kept.sigma_mm.into()),
        ("touch_probability".into(), kept.touch_probability.into()),
        ("weighted_margin_mm".into(), kept.weighted_margin_mm.into()),
    ]
}

/// A channel that was found, with the structure that limits it.
fn channel_entries(plan: &ChannelPlan, channel: &SafeChannel) -> Vec<(String, Value)> {
    let direction = -channel.axis.out.into_inner();
    let vector = |v: &nalgebra::Vector3<f64>| Value::List(v.iter().map(|v| (*v).into()).collect());
    let mut entries = vec![
        ("direction".into(), vector(&direction)),
        ("entry_mm".into(), vector(&channel.axis.entry.coords)),
        ("depth_mm".into(), channel.axis.depth_mm.into()),
    ];
    let kept = channel.kept.iter().zip(&plan.setup.case.structures);
    let kept = kept.filter_map(|(kept, s)| Some((kept.as_ref()?, s)));
    let limiting = kept.min_by(|a, b| a.0.weighted_margin_mm.total_cmp(&b.0.weighted_margin_mm));
    if let Some((kept, structure)) = limiting {
        entries.push(("limited_by".into(), Value::Text(structure.name.clone())));
        entries.extend(kept_entries(kept));
    }
    entries
}

fn modelled(plan: &ChannelPlan) -> Vec<(String, Value)> {
    let affine = |n: usize| Value::Text(plan.setup.placements[n].to_string());
    let cutting = plan.felt.iter().filter(|felt| felt.mass_mg > 0.0).count();
    let mut entries = vec![
        ("waypoints".into(), plan.waypoints.len().into()),
        ("cutting_waypoints".into(), cutting.into()),
        ("unreachable_channels".into(), plan.unreachable.into()),
        ("elements_per_edge".into(), crate::forces::ELEMENTS.into()),
        ("branch".into(), usize::from(plan.arm.branch).into()),
        ("compliance".into(), plan.setup.case.robot.joint_stiffness.is_some().into()),
        ("ct_affine".into(), affine(0)),
        ("labels_affine".into(), affine(1)),
    ];
    if let Some(search) = &plan.found.search {
        entries.push(("sampled_directions".into(), search.sampled.into()));
        entries.push(("directions_in_region".into(), search.in_region.into()));
        entries.push(("directions_too_long".into(), search.too_long.into()));
    }
    if plan.setup.arm.kind() == ArmKind::Ur {
        entries.push(("branch_name".into(), Value::Text(branch_name(plan.arm.branch))));
    }
    entries.extend(plan.arm.lowest_link.map(|lowest| ("lowest_link_mm".into(), lowest.height_mm.into())));
    let time_s = |waypoint: usize| plan.motion.waypoint_times_s.get(waypoint).copied().unwrap_or_default();
    let near = plan.arm.link_distance.as_ref();
    entries.extend(near.map(|near| near.entry(&plan.setup.case, time_s(near.waypoint))));
    entries
}
