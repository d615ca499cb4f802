//! The part of the report that a simulation adds.

use std::fmt::Write;

use bonemill_case::Case;
use bonemill_planfile::{PlanRecord, Value};
use bonemill_simulate::{Simulation, SimulationRow, VoxelKind};

use super::chart::{Series, chart};
use super::escape;
use super::structures::structure_table;

/// A simulated force counts as more than a stated one beyond this share and this much, N: the simulation's lattice.
const LATTICE: [f64; 2] = [0.1, 0.05];
/// Largest number of contacts that the page lists.
const LISTED: usize = 10;

/// The section, from its heading on.
pub fn section(simulation: &Simulation, record: &PlanRecord) -> String {
    let case = &record.case;
    let mut out = "<h2>Simulation of the trajectory</h2>".to_owned();
    out.push_str(&verdict(simulation, case.tool.word()));
    let over_time = |value: &dyn Fn(&SimulationRow) -> Option<f64>| -> Vec<(f64, Option<f64>)> {
        simulation.rows.iter().map(|row| (row.time_s, value(row))).collect()
    };
    let one = |name, class, value: &dyn Fn(&SimulationRow) -> Option<f64>| Series {
        name,
        class,
        points: over_time(value),
    };
    out.push_str(&chart(
        "Simulated force",
        "N",
        &[
            one("magnitude", "line-a", &|row| Some(row.force_n.norm())),
            one("toward the nearest structure", "line-b", &|row| Some(row.force_toward_n.unwrap_or(0.0))),
        ],
        &[],
    ));
    if case.job.channel().is_some() {
        let torque = one("torque", "line-a", &|row| Some(row.torque_nmm));
        out.push_str(&chart("Torque", "N mm", &[torque], &[]));
    }
    out.push_str(&chart("Spindle power", "W", &[one("power", "line-a", &|row| Some(row.power_w))], &[]));
    if simulation.compliant {
        out.push_str(&chart(
            "Deflection",
            "µm",
            &[one("deflection", "line-a", &|row| row.deflection_um)],
            &[],
        ));
    }
    let rows: String = figures(simulation, record)
        .into_iter()
        .map(|(name, value)| format!("<tr><th>{}</th><td>{value}</td></tr>", escape(&name)))
        .collect();
    let _ = write!(out, "<div class=\"wide\"><table><tbody>{rows}</tbody></table></div>");
    out.push_str(&structure_table(case, &simulation.structures, ["simulated ", "at time"], |row| {
        format!("{:.2}\u{a0}s", simulation.rows[row].time_s)
    }));
    out
}

fn verdict(simulation: &Simulation, tool: &str) -> String {
    if simulation.stopped == 0 {
        return "<p class=\"verdict good\">The shank touches nothing along the whole trajectory.</p>".into();
    }
    let listed: String = simulation
        .contacts
        .iter()
        .take(LISTED)
        .map(|(time_s, c)| {
            format!(
                "<li>{time_s:.3} s: {:.2} mm deep in {}, {:.1} mm behind the {tool}</li>",
                c.depth_mm,
                c.kind.word(),
                c.along_mm
            )
        })
        .collect();
    format!(
        "<div class=\"verdict bad\">The shank touches bone: {} steps were stopped, the first of them:<ul>{listed}</ul></div>",
        simulation.stopped
    )
}

/// Names and values of a simulation's figures, for people; beside those that a plan states, what it states.
pub fn figures(simulation: &Simulation, record: &PlanRecord) -> Vec<(String, String)> {
    let (case, metrics) = (&record.case, &record.metrics);
    let beside = |simulated_n: f64, stated_n: Option<f64>| {
        let Some(stated_n) = stated_n else { return String::new() };
        let [share, least_n] = LATTICE;
        let word = if simulated_n > stated_n * (1.0 + share) + least_n { ": more than stated" } else { "" };
        format!(" (the plan states {stated_n:.3} N{word})")
    };
    let (peak_n, mean_n) = (simulation.peak_force_n(), simulation.mean_force_n());
    let largest =
        |value: &dyn Fn(&SimulationRow) -> f64| simulation.rows.iter().map(value).fold(0.0, f64::max);
    let (tool, is_channel) = (case.tool.word(), case.job.channel().is_some());
    let mut out = vec![
        ("poses".to_owned(), simulation.rows.len().to_string()),
        (
            "simulated peak force (mean over a turn)".into(),
            format!("{peak_n:.3} N{}", beside(peak_n, metrics.number("peak_force_n"))),
        ),
        ("largest force within a turn".into(), format!("{:.2} N", largest(&|row| row.peak_n))),
        (
            "simulated mean force while cutting".into(),
            format!("{mean_n:.3} N{}", beside(mean_n, metrics.number("mean_force_n"))),
        ),
        ("peak torque".into(), format!("{:.2} N mm", largest(&|row| row.torque_nmm))),
        ("peak spindle power".into(), format!("{:.2} W", largest(&|row| row.power_w))),
        ("spindle energy".into(), format!("{:.1} J", simulation.energy_j())),
    ];
    for kind in VoxelKind::ALL {
        let (volume, mass) =
            (simulation.removed.volume_mm3[kind as usize], simulation.removed.mass_mg[kind as usize]);
        if volume > 0.0 {
            let what = match kind {
                VoxelKind::Sheet => "removed specks and sheets beside the target",
                VoxelKind::Material => "removed target below the threshold of bone",
                VoxelKind::Bone if is_channel => "removed bone",
                VoxelKind::Bone => "removed bone of the target",
                VoxelKind::Obstacle => "removed bone outside the target but specks and sheets",
                VoxelKind::Structure => "removed from structures",
            };
            out.push((what.into(), format!("{volume:.1} mm³, {mass:.0} mg")));
        }
    }
    if !is_channel {
        out.push((
            "removed bone outside the target, by parts of voxels".into(),
            format!("{:.1} mm³", untargeted_by_parts_mm3(simulation)),
        ));
    }
    let by_rate = simulation.removed_by_rate.total_mg();
    if simulation.removed.total_mg() > 0.0 {
        let off = 100.0 * (by_rate / simulation.removed.total_mg() - 1.0);
        let name = if is_channel {
            format!(
                "removed mass by the {tool}'s front from pose to pose, compared with that on its whole way"
            )
        } else {
            "removed mass by the burr's surface, compared with that by voxels".into()
        };
        out.push((name, format!("{off:+.2} %")));
    }
    for (structure, found) in case.structures.iter().zip(&simulation.structures) {
        if let Some(row) = found.force.peak_row {
            let (peak_n, time_s) = (found.force.peak_n, simulation.rows[row].time_s);
            let name = format!("simulated peak force toward {}", structure.name);
            let stated = |keys: &[&str]| {
                let keys = [&["structures", structure.name.as_str()], keys].concat();
                metrics.number_at(&keys)
            };
            let [far, near, mean] = [
                beside(peak_n, stated(&["peak_force_toward_n"])),
                beside(found.near.peak_n, stated(&["near", "peak_force_toward_n"])),
                beside(found.near.mean_n, stated(&["near", "mean_force_toward_n"])),
            ];
            out.push((
                name,
                format!(
                    "{peak_n:.3} N at {time_s:.2} s{far}; {:.3} N within 2 mm of it{near}, mean {:.3} N{mean}",
                    found.near.peak_n, found.near.mean_n
                ),
            ));
        }
    }
    if simulation.compliant {
        out.push((
            "largest deflection".into(),
            format!("{:.0} µm", largest(&|row| row.deflection_um.unwrap_or(0.0))),
        ));
    }
    out
}

/// Bone outside the target that a simulation removes, specks and sheets included, mm³.
fn untargeted_by_parts_mm3(simulation: &Simulation) -> f64 {
    [VoxelKind::Obstacle, VoxelKind::Sheet]
        .map(|kind| simulation.removed.volume_mm3[kind as usize])
        .iter()
        .sum()
}

/// Names and values of a simulation's figures, for machines; names end in units. A name that a plan's figures have too has the same value:
/// what is simulated anew has a name of its own.
pub fn values(simulation: &Simulation, case: &Case) -> Vec<(String, Value)> {
    let structures = case.structures.iter().zip(&simulation.structures);
    let structures = structures.map(|(s, found)| (s.name.clone(), found.value("row")));
    let removed = VoxelKind::ALL.into_iter().map(|kind| {
        let (mm3, mg) =
            (simulation.removed.volume_mm3[kind as usize], simulation.removed.mass_mg[kind as usize]);
        let amount = vec![("mm3".into(), mm3.into()), ("mg".into(), mg.into())];
        (kind.word().to_owned(), Value::Table(amount))
    });
    let mut found = vec![
        ("poses".into(), simulation.rows.len().into()),
        ("simulated_peak_force_n".into(), simulation.peak_force_n().into()),
        ("simulated_mean_force_n".into(), simulation.mean_force_n().into()),
        ("spindle_energy_j".into(), simulation.energy_j().into()),
        ("simulated_removed".into(), Value::Table(removed.collect())),
        ("removed_by_rate_mg".into(), simulation.removed_by_rate.total_mg().into()),
        ("simulated_structures".into(), Value::Table(structures.collect())),
        ("stopped_steps".into(), simulation.stopped.into()),
        ("cell_mm".into(), simulation.cell_mm.into()),
        ("compliant".into(), simulation.compliant.into()),
    ];
    if case.job.channel().is_none() {
        found.push(("untargeted_bone_by_parts_mm3".into(), untargeted_by_parts_mm3(simulation).into()));
    }
    found
}
