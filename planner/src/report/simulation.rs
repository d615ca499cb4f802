//! The part of the report that a simulation adds.

use std::fmt::Write;

use super::chart::{Series, chart};
use super::escape;
use crate::case::Case;
use crate::plan::Value;
use crate::simulate::{Kind, Simulation, SimulationRow};

/// Contacts that the page lists.
const LISTED: usize = 10;

/// The section, from its heading on.
pub fn section(simulation: &Simulation, case: &Case) -> String {
    let mut out = "<h2>Simulation of the trajectory</h2>".to_owned();
    out.push_str(&verdict(simulation));
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
    out.push_str(&chart("Spindle power", "W", &[one("power", "line-a", &|row| Some(row.power_w))], &[]));
    if simulation.compliant {
        out.push_str(&chart(
            "Deflection",
            "µm",
            &[one("deflection", "line-a", &|row| row.deflection_um)],
            &[],
        ));
    }
    let rows: String = figures(simulation)
        .into_iter()
        .map(|(name, value)| format!("<tr><th>{}</th><td>{value}</td></tr>", escape(&name)))
        .collect();
    let _ = write!(out, "<div class=\"wide\"><table><tbody>{rows}</tbody></table></div>");
    let nearest: String = case
        .structures
        .iter()
        .enumerate()
        .filter_map(|(n, structure)| {
            let near = simulation.rows.iter().filter(|row| row.structure == Some(n));
            let distance = near.clone().filter_map(|row| row.distance_mm).reduce(f64::min)?;
            let force = near.filter_map(|row| row.force_toward_n).fold(0.0, f64::max);
            Some(format!(
                "<tr><th>{}</th><td>{:.2}</td><td>{:.2}</td><td>{force:.3}</td></tr>",
                escape(&structure.name),
                structure.clearance_mm,
                distance - case.burr.radius_mm
            ))
        })
        .collect();
    let _ = write!(
        out,
        "<div class=\"wide\"><table><thead><tr><th></th><th>clearance [mm]</th><th>least distance of the burr's surface [mm]</th>\
         <th>peak force toward it [N]</th></tr></thead><tbody>{nearest}</tbody></table></div>"
    );
    out
}

fn verdict(simulation: &Simulation) -> String {
    if simulation.stopped == 0 {
        return "<p class=\"verdict good\">The shank touches nothing on the whole way.</p>".into();
    }
    let listed: String = simulation
        .contacts
        .iter()
        .take(LISTED)
        .map(|(time_s, c)| {
            format!(
                "<li>{time_s:.3} s: {:.2} mm deep in {}, {:.1} mm behind the burr's centre</li>",
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

/// Names and values of a simulation's figures, for people.
pub fn figures(simulation: &Simulation) -> Vec<(String, String)> {
    let largest =
        |value: &dyn Fn(&SimulationRow) -> f64| simulation.rows.iter().map(value).fold(0.0, f64::max);
    let mut out = vec![
        ("poses".to_owned(), simulation.rows.len().to_string()),
        ("peak of the mean force over a turn".into(), format!("{:.2} N", simulation.peak_force_n())),
        ("largest force within a turn".into(), format!("{:.2} N", largest(&|row| row.peak_n))),
        ("mean force while cutting".into(), format!("{:.2} N", simulation.mean_force_n())),
        ("peak spindle power".into(), format!("{:.2} W", largest(&|row| row.power_w))),
        ("spindle energy".into(), format!("{:.1} J", simulation.energy_j())),
    ];
    for kind in Kind::ALL {
        let (volume, mass) =
            (simulation.removed.volume_mm3[kind as usize], simulation.removed.mass_mg[kind as usize]);
        if volume > 0.0 {
            let what = match kind {
                Kind::Sheet => "removed of thin bone beside the target",
                Kind::Material => "removed of the target below bone",
                Kind::Bone => "removed of the target's bone",
                Kind::Obstacle => "removed of bone outside the target",
                Kind::Structure => "removed of structures",
            };
            out.push((what.into(), format!("{volume:.1} mm³, {mass:.0} mg")));
        }
    }
    let by_rate = simulation.removed_by_rate.total_mg();
    if simulation.removed.total_mg() > 0.0 {
        let off = 100.0 * (by_rate / simulation.removed.total_mg() - 1.0);
        out.push(("mass by the surface's rate, against the voxels'".into(), format!("{off:+.2} %")));
    }
    if simulation.compliant {
        out.push((
            "largest deflection".into(),
            format!("{:.0} µm", largest(&|row| row.deflection_um.unwrap_or(0.0))),
        ));
    }
    out
}

/// Names and values of a simulation's figures, for machines; names end in units.
pub fn values(simulation: &Simulation) -> Vec<(String, Value)> {
    let removed = Kind::ALL.into_iter().map(|kind| {
        let (mm3, mg) =
            (simulation.removed.volume_mm3[kind as usize], simulation.removed.mass_mg[kind as usize]);
        let amount = vec![("mm3".into(), mm3.into()), ("mg".into(), mg.into())];
        (kind.word().to_owned(), Value::Table(amount))
    });
    vec![
        ("poses".into(), simulation.rows.len().into()),
        ("peak_force_n".into(), simulation.peak_force_n().into()),
        ("mean_force_n".into(), simulation.mean_force_n().into()),
        ("spindle_energy_j".into(), simulation.energy_j().into()),
        ("removed".into(), Value::Table(removed.collect())),
        ("removed_by_rate_mg".into(), simulation.removed_by_rate.total_mg().into()),
        ("stopped_steps".into(), simulation.stopped.into()),
        ("cell_mm".into(), simulation.cell_mm.into()),
        ("compliant".into(), simulation.compliant.into()),
    ]
}
