//! What the page of every plan has: head, verdict, inputs, parameters and the case at the end.

use std::path::PathBuf;

use bonemill_case::{Case, explained};
use bonemill_planfile::{Input, page};

use super::{columns, escape};

/// The page up to its first section: title, what the plan falls short of, and its warnings.
pub(crate) fn head(title: &str, shortfalls: &[String], warnings: &[String]) -> String {
    page::opening(title, "") + &page::verdict("The plan meets its case.", shortfalls, warnings)
}

/// The page's last sections: inputs, the parameters of the case as it was planned, what columns mean, and the case itself.
pub(crate) fn tail(inputs: &[(Input, PathBuf)], as_planned: &Case, case: &Case) -> String {
    format!(
        "<h2>Inputs</h2>{}<h2>Parameters</h2>{}{}<h2>Case file with every default</h2><details><summary>show the file</summary><pre>{}</pre></details></main></body></html>",
        table_of_inputs(inputs),
        page::parameters(&explained(as_planned), "D: Dillon et al. 2016"),
        columns::section(),
        escape(&case.to_toml())
    )
}

fn table_of_inputs(inputs: &[(Input, PathBuf)]) -> String {
    let row = |(input, _): &(Input, PathBuf)| {
        let name = escape(&input.path.to_string_lossy());
        format!("<tr><th>{name}</th><td><code>{}</code></td></tr>", input.sha256)
    };
    let rows: String = inputs.iter().map(row).collect();
    format!(
        "<div class=\"wide\"><table class=\"words\"><thead><tr><th>file</th><th>SHA-256</th></tr></thead><tbody>{rows}</tbody></table></div>"
    )
}
