//! The comparison of two plans as a separate page.

use std::fmt::Write;

use bonemill_planfile::StoredPlan;
use bonemill_planfile::page::opening;
use bonemill_verify::Short;

use super::escape;
use crate::pages::compare::{Comparison, Figure, Group, Pair};

/// The page; `names`: names of the plans.
pub fn page(comparison: &Comparison, names: [&str; 2], plans: [&StoredPlan; 2]) -> String {
    let [a, b] = names.map(escape);
    let mut page = opening("Two milling plans", &format!("First: {a}. Second: {b}. "));
    if !comparison.inputs.is_empty() {
        page += "<p class=\"verdict warn\">The plans were made from different images or arms: places and volumes compare only \
                 where these share one frame.</p>";
    }
    page += "<h2>Where the cases differ</h2>";
    page += &texts(&comparison.case, "The cases say the same.");
    page += "<h2>Between the paths</h2><p class=\"note\">Places every 0.25 mm along the cuts of each plan, against the nearest place \
             on the other's. Swept: voxels of the common planning grid whose centres the burr comes to, air included.</p>";
    let between = comparison.between.entries().into_iter();
    let between: String =
        between.map(|(name, v)| format!("<tr><th>{name}</th><td>{}</td></tr>", Short(v))).collect();
    let _ = write!(page, "<table><tbody>{between}</tbody></table>");
    page += &overlay(plans);
    for Group { title, figures } in &comparison.groups {
        let rows: String = figures.iter().map(row).collect();
        let _ = write!(
            page,
            "<h2>{}</h2><div class=\"wide\"><table><thead><tr><th></th><th>{a}</th><th>{b}</th><th>second − first</th><th>%</th></tr>\
             </thead><tbody>{rows}</tbody></table></div>",
            escape(title)
        );
    }
    page += "<h2>Inputs that differ</h2>";
    page += &texts(&comparison.inputs, "Both plans were made from the same images and arms.");
    page + "</main></body></html>"
}

fn row(figure: &Figure) -> String {
    let text = |v: Option<f64>| v.map_or(String::new(), |v| Short(v).to_string());
    let [a, b] = figure.values;
    let percent = figure.difference().zip(a.filter(|a| *a != 0.0)).map(|(d, a)| 100.0 * d / a.abs());
    format!(
        "<tr><th>{}</th><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>",
        escape(&figure.name),
        text(a),
        text(b),
        text(figure.difference()),
        percent.map_or(String::new(), |p| format!("{p:+.1}"))
    )
}

fn texts(rows: &[(String, Pair<String>)], none: &str) -> String {
    if rows.is_empty() {
        return format!("<p>{none}</p>");
    }
    let cell = |v: &Option<String>| v.as_deref().map_or(String::new(), escape);
    let row = |(key, [a, b]): &(String, Pair<String>)| {
        format!("<tr><th><code>{}</code></th><td>{}</td><td>{}</td></tr>", escape(key), cell(a), cell(b))
    };
    let rows: String = rows.iter().map(row).collect();
    format!(
        "<div class=\"wide\"><table class=\"words\"><thead><tr><th></th><th>first</th><th>second</th></tr></thead>\
         <tbody>{rows}</tbody></table></div>"
    )
}

/// Both paths, seen along the first plan's approach.
fn overlay(plans: [&StoredPlan; 2]) -> String {
    let work_from_ct = plans[0].record.frames.ct_from_approach.inverse();
    let seen = plans.map(|plan| -> Vec<[f64; 2]> {
        let places = plan.waypoints.iter().map(|w| (work_from_ct * w.position).coords);
        places.map(|p| [p.x, -p.y]).collect()
    });
    let edge = |axis: usize, pick: fn(f64, f64) -> f64, start: f64| {
        seen.iter().flatten().map(|p| p[axis]).fold(start, pick)
    };
    let [x, y] = [0, 1].map(|axis| edge(axis, f64::min, f64::INFINITY) - 1.0);
    let [right, low] = [0, 1].map(|axis| edge(axis, f64::max, f64::NEG_INFINITY) + 1.0);
    if !(right > x && low > y) {
        return String::new();
    }
    let line = |points: &[[f64; 2]], class: &str| {
        let points: String = points.iter().map(|[x, y]| format!("{x:.2},{y:.2} ")).collect();
        format!(
            "<polyline points=\"{points}\" class=\"{class}\" style=\"fill:none;stroke-width:.15;opacity:.7\"/>"
        )
    };
    format!(
        "<figure style=\"max-width:640px\"><svg viewBox=\"{x:.2} {y:.2} {:.2} {:.2}\">{}{}</svg><figcaption>Both ways of the burr, links \
         included, seen along the first plan's approach: <span class=\"line-a key\">first</span> <span class=\"line-b key\">second</span>\
         </figcaption></figure>",
        right - x,
        low - y,
        line(&seen[0], "line-a"),
        line(&seen[1], "line-b")
    )
}
