//! What every page for people has: its opening, a verdict, a table of parameters, and text made safe for HTML.
//!
//! One file that needs no network; nothing in it depends on when or where it was made.

use std::fmt::Write;

use bonemill_case::Parameter;

const STYLE: &str = include_str!("page.css");

/// The page up to its first section; `about`: what stands before the notice, or nothing. Both are HTML.
pub fn opening(title: &str, about: &str) -> String {
    format!(
        "<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\">\
         <meta name=\"viewport\" content=\"width=device-width,initial-scale=1\"><title>{title}</title>\
         <style>{STYLE}</style></head><body><main><h1>{title}</h1>\
         <p class=\"note\">bonemill {}. {about}Research software: not a medical device, not for use on patients.</p>",
        env!("CARGO_PKG_VERSION")
    )
}

/// What a plan falls short of, or else what is `good` about it, as HTML; then its warnings.
pub fn verdict(good: &str, shortfalls: &[String], warnings: &[String]) -> String {
    let mut text = if shortfalls.is_empty() {
        format!("<p class=\"verdict good\">{good}</p>")
    } else {
        let reasons: String = shortfalls.iter().map(|r| format!("<li>{}</li>", escape(r))).collect();
        format!("<div class=\"verdict bad\">The plan falls short:<ul>{reasons}</ul></div>")
    };
    for warning in warnings {
        let _ = write!(text, "<p class=\"verdict warn\">Warning: {}</p>", escape(warning));
    }
    text
}

/// Keys with value, meaning and origin; `paper`: whose letter origins use, as HTML.
pub fn parameters(parameters: &[Parameter], paper: &str) -> String {
    let row = |p: &Parameter| {
        format!(
            "<tr><th><code>{}</code></th><td><code>{}</code></td><td>{}</td><td>{}</td></tr>",
            breakable(&escape(&p.key)),
            escape(&p.value),
            with_code(&escape(p.meaning)),
            with_code(&escape(&p.origin.to_string()))
        )
    };
    let rows: String = parameters.iter().map(row).collect();
    format!(
        "<p class=\"note\">{paper}.</p><div class=\"wide\"><table class=\"words params\"><thead><tr><th>key</th><th>value</th><th>meaning</th>\
         <th>origin</th></tr></thead><tbody>{rows}</tbody></table></div>"
    )
}

/// A dotted key that may be broken after a dot or an underscore.
fn breakable(key: &str) -> String {
    key.replace('.', ".<wbr>").replace('_', "_<wbr>")
}

/// Text with `words` in backticks set as code.
fn with_code(text: &str) -> String {
    let part =
        |(n, part): (usize, &str)| if n % 2 == 1 { format!("<code>{part}</code>") } else { part.into() };
    text.split('`').enumerate().map(part).collect()
}

/// Escapes text for HTML.
pub fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// A picture as PNG, given red, green and blue of every pixel by rows.
pub fn png(width: usize, height: usize, rgb: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width as u32, height as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    // writing to memory cannot fail for a buffer of the right size; if it did, only the picture would be missing
    let written = encoder.write_header().and_then(|mut writer| writer.write_image_data(rgb));
    if written.is_err() {
        bytes.clear();
    }
    bytes
}
