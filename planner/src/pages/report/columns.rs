//! Describes the files beside the report, column by column, so that no network is needed to understand the folder.

use bonemill_planfile::columns::{Column, DESCRIBED, Described, FRAMES};

use super::escape;

/// The part of the report, from its heading on.
pub fn section() -> String {
    let frames: String = FRAMES.iter().map(|(name, meaning)| row(&[name, meaning])).collect();
    let files: String = DESCRIBED.iter().map(file).collect();
    format!(
        "<h2>The files of this plan</h2><p>Unit, frame and meaning of every column in the files beside this page. The same text is in \
         docs/columns.md of bonemill and printed by <code>bonemill columns</code>. Distances in the tables (<code>distance_mm</code>) are from the burr's \
         centre, names with <code>surface</code> are from its surface.</p><details><summary>frames</summary><table class=\"words\"><tbody>{frames}</tbody></table></details>{files}"
    )
}

fn file(Described { title, about, columns }: &Described) -> String {
    let rows: String = columns
        .iter()
        .map(|Column { name, unit, frame, meaning }| row(&[name, unit, frame, meaning]))
        .collect();
    format!(
        "<details><summary>{}</summary><p>{}</p><div class=\"wide\"><table class=\"words\"><thead><tr><th>name</th><th>unit</th>\
         <th>frame</th><th>meaning</th></tr></thead><tbody>{rows}</tbody></table></div></details>",
        escape(title),
        escape(about)
    )
}

fn row(cells: &[&str]) -> String {
    let (name, rest) = cells.split_first().unwrap_or((&"", &[]));
    let rest: String = rest.iter().map(|cell| format!("<td>{}</td>", escape(cell))).collect();
    format!("<tr><th><code>{}</code></th>{rest}</tr>", escape(name))
}
