//! A run beside its plan, as a page of its own.

use std::fmt::Write;

use bonemill_planfile::Value;
use bonemill_planfile::page::opening;
use bonemill_verify::Short;

use super::chart::{Series, chart};
use super::escape;
use crate::pages::run::{ExecutedStep, RunComparison};

/// Events that the page lists.
const LISTED: usize = 200;

/// The page; `name`: what the plan is called.
pub fn page(run: &RunComparison, name: &str) -> String {
    let mut page = opening("Executed plan", &format!("Plan: {}. ", escape(name)));
    page += &verdict(run);
    page += &cards(run);
    page += "<h2>Over the run</h2>";
    page += &charts(run);
    page += "<h2>Figures</h2><p class=\"note\">Off: of the tool from its planned path, at the log's entries by the arm's joints, and the farthest at any step as the run saw it. Behind: along the path, from the newest \
             target. Late: a step of the program after its time. Room: between burr and nearest structure as planned, less what the burr \
             was off.</p>";
    let rows: String = run.figures().iter().map(|(name, value)| row(name, value)).collect();
    let _ = write!(
        page,
        "<div class=\"wide\"><table><thead><tr><th></th><th>value or median</th><th>99th percentile</th><th>largest</th></tr></thead>\
         <tbody>{rows}</tbody></table></div>"
    );
    page += "<h2>What happened</h2>";
    let skipped = run.events.len().saturating_sub(LISTED);
    let events: String = run.events[skipped..]
        .iter()
        .map(|(time_s, said)| format!("<tr><th>{time_s:.3} s</th><td>{}</td></tr>", escape(said)))
        .collect();
    if skipped > 0 {
        let _ = write!(page, "<p class=\"note\">The first {skipped} are left out.</p>");
    }
    let _ = write!(page, "<table class=\"words\"><tbody>{events}</tbody></table>");
    page + "</main></body></html>"
}

fn verdict(run: &RunComparison) -> String {
    let last = run.rows.saturating_sub(1) as f64;
    let ended = run.events.iter().rev().find_map(|(_, said)| said.strip_prefix("ended: "));
    let ended = ended.unwrap_or("the log ends without a word: the program was killed, or still runs");
    let class = if run.reached_row >= last - 1.0 { "good" } else { "warn" };
    format!(
        "<p class=\"verdict {class}\">Reached row {:.0} of {last:.0}. {}</p>",
        run.reached_row,
        escape(ended)
    )
}

fn cards(run: &RunComparison) -> String {
    let largest = |value: &dyn Fn(&ExecutedStep) -> f64| run.steps.iter().map(value).fold(0.0, f64::max);
    let mut cards = vec![
        (
            "farthest of the tool from its path at the log's entries, by its joints".to_owned(),
            format!("{:.3} mm", largest(&|s| s.off_mm)),
        ),
        ("farthest behind its target, along the path".into(), format!("{:.3} mm", largest(&|s| s.behind_mm))),
        ("largest turn of the shaft".into(), format!("{:.2} mrad", largest(&|s| 1e3 * s.axis_rad))),
        ("executed".into(), format!("{:.1} s", run.executed_s)),
        ("planned for as far".into(), format!("{:.1} s", run.planned_s)),
        ("latest step of the program".into(), format!("{:.1} ms", largest(&|s| 1e3 * s.late_s))),
    ];
    if let Some(mm) = run.farthest_off_mm {
        cards.insert(
            0,
            (
                "farthest of the tool from its path at any step, as the run saw it".to_owned(),
                format!("{mm:.3} mm"),
            ),
        );
    }
    if let Some((room_mm, structure)) = &run.least_room {
        cards.push((format!("least room, to {}", escape(structure)), format!("{room_mm:.2} mm")));
    }
    if run.steps.iter().any(|s| s.force_n.is_some()) {
        let peak_n = largest(&|s| s.force_n.unwrap_or(0.0));
        cards.push(("peak of the measured force".into(), format!("{peak_n:.2} N")));
    }
    let items: String = cards
        .into_iter()
        .map(|(label, value)| format!("<div><b>{value}</b><span>{label}</span></div>"))
        .collect();
    format!("<div class=\"cards\">{items}</div>")
}

fn charts(run: &RunComparison) -> String {
    let one = |name, class, value: &dyn Fn(&ExecutedStep) -> Option<f64>| Series {
        name,
        class,
        points: run.steps.iter().map(|s| (s.time_s, value(s))).collect(),
    };
    let mut charts = vec![
        chart("Burr off its path", "mm", &[one("off", "line-a", &|s| Some(s.off_mm))], &[]),
        chart(
            "Burr behind its target, along the path",
            "mm",
            &[one("behind", "line-a", &|s| Some(s.behind_mm))],
            &[],
        ),
        chart(
            "Turn of the shaft from its planned axis",
            "mrad",
            &[one("turn", "line-a", &|s| Some(1e3 * s.axis_rad))],
            &[],
        ),
        chart("Row of the plan", "1", &[one("newest target", "line-a", &|s| Some(s.row))], &[]),
        chart(
            "Timing of the program",
            "ms",
            &[
                one("latest step", "line-a", &|s| Some(1e3 * s.late_s)),
                one("age of the arm's state", "line-b", &|s| s.age_s.map(|age_s| 1e3 * age_s)),
            ],
            &[],
        ),
    ];
    if run.least_room.is_some() {
        charts.push(chart(
            "Room between tool and the nearest structure",
            "mm",
            &[one("room", "line-a", &|s| s.room_mm)],
            &[],
        ));
    }
    if run.steps.iter().any(|s| s.force_n.is_some()) {
        let series =
            [one("measured", "line-a", &|s| s.force_n), one("predicted", "line-b", &|s| Some(s.predicted_n))];
        charts.push(chart("Force on the tool", "N", &series, &[]));
    }
    charts.concat()
}

fn row(name: &str, value: &Value) -> String {
    let cell = |value: &Value| match value {
        Value::Number(v) => Short(*v).to_string(),
        Value::Integer(v) => v.to_string(),
        Value::Text(v) => escape(v),
        _ => String::new(),
    };
    let cells: Vec<String> = match value {
        Value::Table(entries) => entries.iter().map(|(_, v)| cell(v)).collect(),
        value => vec![cell(value)],
    };
    let cells: String =
        (0..3).map(|n| format!("<td>{}</td>", cells.get(n).map_or("", String::as_str))).collect();
    format!("<tr><th><code>{name}</code></th>{cells}</tr>")
}
