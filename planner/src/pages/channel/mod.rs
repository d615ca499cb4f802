//! `report.html` of a drilled channel or a reaming: the corridor in the images, clearances and probabilities, what the tool feels over
//! depth.
//!
//! Pure text from a [`ChannelPlan`]; equal plans give equal pages.

mod corridor;

use std::fmt::Write;

use bonemill_case::Pattern;
use bonemill_channel::{ChannelPlan, deepest_waypoint};
use bonemill_planfile::{PlungeRow, ReportPart};

use crate::pages::report::chart::{Series, chart_over};
use crate::pages::report::{CtSlices, escape, frame, images};
use crate::pages::show::{STRUCTURE_COLOURS, css};

/// The whole page.
pub fn html(plan: &ChannelPlan, ct_slices: CtSlices) -> String {
    let reams = plan.setup.case.job.channel().is_some_and(|channel| channel.pattern == Pattern::Ream);
    let title = if reams { "Reaming plan" } else { "Channel plan" };
    let mut page = frame::head(title, &plan.shortfalls, &plan.warnings);
    page.push_str(&cards(plan));
    page.push_str(&images::section(&plan.setup));
    page.push_str(&ReportPart::Verification.marks().concat());
    let is_shown = ct_slices == CtSlices::Shown;
    page.push_str(if is_shown { "<h2>The corridor in the images</h2>" } else { "<h2>The corridor</h2>" });
    page.push_str(&legend(plan, ct_slices));
    let _ = write!(page, "<div class=\"slices\">{}</div>", corridor::figures(plan, ct_slices));
    page.push_str(ct_slices.note());
    page.push_str("<h2>What the tool feels over depth</h2>");
    page.push_str(&charts(plan));
    page.push_str(&ReportPart::Simulation.marks().concat());
    page.push_str("<h2>Structures</h2>");
    page.push_str(&structures(plan));
    if plan.found.channels.len() > 1 {
        page.push_str("<h2>The safest channels</h2>");
        page.push_str(&runners_up(plan));
    }
    page.push_str(&frame::tail(&plan.setup.inputs, &plan.setup.case, &plan.setup.case));
    page
}

fn cards(plan: &ChannelPlan) -> String {
    let peak = |of: fn(&PlungeRow) -> f64| plan.plunge.iter().map(of).fold(0.0, f64::max);
    let total_s = plan.motion.law.duration_s();
    let mut cards = vec![
        ("depth from the entry".to_owned(), format!("{:.2} mm", plan.record.depth_mm)),
        (
            "from where the tool meets bone".to_owned(),
            format!("{:.2} mm", plan.record.depth_mm - plan.record.contact_depth_mm),
        ),
        (
            "total time".into(),
            format!("{:.0} min {:02.0} s", (total_s / 60.0).floor(), (total_s % 60.0).floor()),
        ),
        ("peak thrust".into(), format!("{:.2} N", peak(|row| row.thrust_n))),
        ("peak torque".into(), format!("{:.1} N mm", peak(|row| row.torque_nmm))),
        ("bone removed".into(), format!("{:.1} mm³", plan.volumes.bone_mm3)),
    ];
    let kept = plan.channel.kept.iter().zip(&plan.setup.case.structures);
    let kept = kept.filter_map(|(kept, s)| Some((kept.as_ref()?, s)));
    if let Some((kept, s)) = kept.min_by(|a, b| a.0.clearance_mm.total_cmp(&b.0.clearance_mm)) {
        cards.push((
            format!("smallest clearance, {} (kept {} mm)", escape(&s.name), s.clearance_mm),
            format!("{:.2} mm", kept.clearance_mm),
        ));
        cards.push((
            format!("probability of touching {}", escape(&s.name)),
            probability(kept.touch_probability),
        ));
    }
    let items: String = cards
        .into_iter()
        .map(|(label, value)| format!("<div><b>{value}</b><span>{label}</span></div>"))
        .collect();
    format!("<div class=\"cards\">{items}</div>")
}

/// A probability with as many digits as it needs.
fn probability(p: f64) -> String {
    if p >= 1e-3 || p == 0.0 { format!("{:.2} %", 100.0 * p) } else { format!("{p:.1e}") }
}

fn legend(plan: &ChannelPlan, ct_slices: CtSlices) -> String {
    let chip = |n: usize, name: &str| {
        let colour = css(STRUCTURE_COLOURS[n % STRUCTURE_COLOURS.len()]);
        format!("<span class=\"chip\"><i style=\"background:{colour}\"></i>{}</span>", escape(name))
    };
    // only where their voxels are tinted
    let tinted = plan.setup.case.structures.iter().enumerate().filter(|_| ct_slices == CtSlices::Shown);
    let structures: String = tinted.map(|(n, s)| chip(n, &s.name)).collect();
    format!(
        "<p class=\"legend\">{structures}Red: what the tool sweeps. Dashed: the margin around it that the registration's error needs at \
         the allowed probability of touching. The entry is at depth 0.</p>"
    )
}

fn charts(plan: &ChannelPlan) -> String {
    let deeper = || plan.plunge.iter().zip(&plan.felt).filter(|(_, felt)| felt.deeper_mm > 0.0);
    let one = |name, class, of: fn(&PlungeRow) -> f64| Series {
        name,
        class,
        points: deeper().map(|(row, _)| (row.depth_mm, Some(of(row)))).collect(),
    };
    let over = "depth of the tip [mm]";
    [
        chart_over(over, ["Thrust", "N"], &[one("thrust", "line-a", |row| row.thrust_n)], &[]),
        chart_over(over, ["Torque", "N mm"], &[one("torque", "line-a", |row| row.torque_nmm)], &[]),
        chart_over(over, ["Lateral force", "N"], &[one("lateral", "line-a", |row| row.lateral_n)], &[]),
        chart_over(over, ["Contact with bone", "mm²"], &[one("area", "line-a", |row| row.contact_mm2)], &[]),
    ]
    .concat()
}

fn structures(plan: &ChannelPlan) -> String {
    let all = plan.channel.kept.iter().zip(&plan.holder_clearance_mm).zip(&plan.setup.case.structures);
    let row = |((kept, holder), s): ((&Option<_>, &Option<f64>), &bonemill_case::Structure)| {
        let kept: &bonemill_channel::risk::KeptClearance = kept.as_ref()?;
        let holder = holder.filter(|mm| mm.is_finite()).map_or("–".into(), |mm| format!("{mm:.2}"));
        Some(format!(
            "<tr><th>{}</th><td>{:.3}</td><td>{}</td><td>{:.2}</td><td>{:.3}</td><td>{}</td><td>{holder}</td></tr>",
            escape(&s.name),
            kept.clearance_mm,
            s.clearance_mm,
            kept.depth_mm,
            kept.sigma_mm,
            probability(kept.touch_probability),
        ))
    };
    let rows: String = all.filter_map(row).collect();
    format!(
        "<div class=\"wide\"><table><thead><tr><th></th><th>clearance [mm]</th><th>asked for [mm]</th><th>at depth [mm]</th><th>σ of the registration [mm]</th>\
         <th>probability of touching</th><th>holder's clearance [mm]</th></tr></thead><tbody>{rows}</tbody></table></div>\
         <p>Clearances are from the tool's largest radius to the structure's closed voxel boxes, along the whole way. The probability is that of a \
         normal error toward the structure at the nearest place; <code>verify</code> draws whole motions of the patient instead. The holder is \
         judged at waypoint {}, where the tool is deepest.</p>",
        deepest_waypoint(plan)
    )
}

fn runners_up(plan: &ChannelPlan) -> String {
    let row = |(n, channel): (usize, &bonemill_channel::safest::SafeChannel)| {
        let kept = channel.kept.iter().zip(&plan.setup.case.structures);
        let kept = kept.filter_map(|(kept, s)| Some((kept.as_ref()?, s)));
        let limit = kept.min_by(|a, b| a.0.weighted_margin_mm.total_cmp(&b.0.weighted_margin_mm));
        let limit = limit.map_or("<td></td><td></td><td></td>".into(), |(kept, s)| {
            format!(
                "<td>{}</td><td>{:.3}</td><td>{}</td>",
                escape(&s.name),
                kept.clearance_mm,
                probability(kept.touch_probability)
            )
        });
        let d = -channel.axis.out.into_inner();
        let mark = if channel.axis == plan.channel.axis { ", planned" } else { "" };
        format!(
            "<tr><th>{}{mark}</th><td>{:.4}, {:.4}, {:.4}</td><td>{:.2}</td><td>{:.3}</td>{limit}</tr>",
            n + 1,
            d.x,
            d.y,
            d.z,
            channel.axis.depth_mm,
            channel.margin_mm()
        )
    };
    let rows: String = plan.found.channels.iter().enumerate().map(row).collect();
    let search = plan.found.search.as_ref().map_or(String::new(), |search| {
        format!(
            "<p>{} directions were looked at: {} lead outside in the entry's region and cone, with room for the tool; {} of these are longer than the tool can drill. The best were \
             moved to their local maximum; those listed are at least 5° apart.</p>",
            search.sampled, search.in_region, search.too_long
        )
    });
    format!(
        "<div class=\"wide\"><table><thead><tr><th></th><th>direction, ct</th><th>depth [mm]</th><th>least weighted margin [mm]</th><th>limited by</th>\
         <th>its clearance [mm]</th><th>probability of touching it</th></tr></thead><tbody>{rows}</tbody></table></div>{search}"
    )
}
