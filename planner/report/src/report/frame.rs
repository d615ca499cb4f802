//! What the page of every plan has: head, verdict, inputs, parameters and the case at the end.

use std::fmt::Write;
use std::path::PathBuf;

use bonemill_case::{Case, Parameter, explained};
use bonemill_planfile::Input;

use super::{STYLE, breakable, columns, escape, with_code};

/// The page up to its first section: title, what the plan falls short of, and its warnings.
pub(crate) fn head(title: &str, shortfalls: &[String], warnings: &[String]) -> String {
    let mut page = format!(
        "<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\">\
         <meta name=\"viewport\" content=\"width=device-width,initial-scale=1\"><title>{title}</title>\
         <style>{STYLE}</style></head><body><main><h1>{title}</h1>\
         <p class=\"note\">bonemill {}. Research software: not a medical device, not for use on patients.</p>",
        env!("CARGO_PKG_VERSION")
    );
    if shortfalls.is_empty() {
        page.push_str("<p class=\"verdict good\">The plan meets its case.</p>");
    } else {
        let reasons: String = shortfalls.iter().map(|r| format!("<li>{}</li>", escape(r))).collect();
        let _ = write!(page, "<div class=\"verdict bad\">The plan falls short:<ul>{reasons}</ul></div>");
    }
    for warning in warnings {
        let _ = write!(page, "<p class=\"verdict warn\">Warning: {}</p>", escape(warning));
    }
    page
}

/// The page's last sections: inputs, the parameters of the case as it was planned, what columns mean, and the case itself.
pub(crate) fn tail(inputs: &[(Input, PathBuf)], as_planned: &Case, case: &Case) -> String {
    format!(
        "<h2>Inputs</h2>{}<h2>Parameters</h2>{}{}<h2>Case file with every default</h2><details><summary>show the file</summary><pre>{}</pre></details></main></body></html>",
        table_of_inputs(inputs),
        parameters(as_planned),
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

/// Every value of a case, with its meaning and its origin.
fn parameters(case: &Case) -> String {
    let row = |p: &Parameter| {
        format!(
            "<tr><th><code>{}</code></th><td><code>{}</code></td><td>{}</td><td>{}</td></tr>",
            breakable(&escape(&p.key)),
            escape(&p.value),
            with_code(&escape(p.meaning)),
            with_code(&escape(&p.origin.to_string()))
        )
    };
    let rows: String = explained(case).iter().map(row).collect();
    format!(
        "<div class=\"wide\"><table class=\"words params\"><thead><tr><th>key</th><th>value</th><th>meaning</th><th>origin (D: Dillon et al. 2016)</th></tr></thead><tbody>{rows}</tbody></table></div>"
    )
}
