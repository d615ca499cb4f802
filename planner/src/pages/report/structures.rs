//! The table of structures: the distance kept from each, and the force toward it.

use std::fmt::Write;

use bonemill_case::Case;
use bonemill_planfile::toward::{NEAR_MM, StructureFigures, TowardFigures};

use super::escape;

/// The table of a plan's or a simulation's structures. `kind` stands before what the figures are, `place` describes a row's place in
/// words, under the heading `at`.
pub fn structure_table(
    case: &Case,
    found: &[StructureFigures],
    [kind, at]: [&str; 2],
    place: impl Fn(usize) -> String,
) -> String {
    let rows: String = case
        .structures
        .iter()
        .zip(found)
        .map(|(structure, found)| {
            let least = found.least.map_or("<td>–</td><td></td>".into(), |(surface_mm, row)| {
                format!("<td>{surface_mm:.2}</td><td>{}</td>", place(row))
            });
            format!(
                "<tr><th>{}</th><td>{:.2}</td>{least}{}{}</tr>",
                escape(&structure.name),
                structure.clearance_mm,
                cells(&found.near, &place),
                cells(&found.force, &place),
            )
        })
        .collect();
    let mut table = "<div class=\"wide\"><table class=\"structures\"><thead><tr><th rowspan=\"2\"></th><th rowspan=\"2\">clearance [mm]</th>\
         <th colspan=\"2\">"
        .to_owned();
    let tool = case.tool.word();
    let _ = write!(table, "{kind}least distance of the {tool}'s surface</th>");
    let _ = write!(
        table,
        "<th colspan=\"4\">{kind}force toward it [N] while the {tool}'s surface is within {NEAR_MM} mm</th><th colspan=\"4\">{kind}force toward it [N] everywhere</th></tr>\
         <tr><th>[mm]</th><th>{at}</th>{0}{0}</tr></thead><tbody>{rows}</tbody></table></div>",
        format_args!("<th>mean</th><th>75th pct.</th><th>peak</th><th>{at}</th>")
    );
    table.push_str(
        "<p class=\"note\">Mean and 75th percentile are weighted by time, over the time in which material is removed and the force points \
         toward the structure (F<sub>v</sub> &gt; 0). Values in brackets are over all of the time in which material is removed, zeros \
         included. – means no force toward the structure, none in the label map, or one so far away that no distance is measured.</p>",
    );
    table
}

fn cells(figures: &TowardFigures, place: &impl Fn(usize) -> String) -> String {
    let Some(row) = figures.peak_row else { return "<td>–</td><td>–</td><td>–</td><td></td>".into() };
    format!(
        "<td>{:.3} ({:.3})</td><td>{:.3} ({:.3})</td><td>{:.3}</td><td>{}</td>",
        figures.mean_n,
        figures.mean_with_zeros_n,
        figures.p75_n,
        figures.p75_with_zeros_n,
        figures.peak_n,
        place(row)
    )
}
