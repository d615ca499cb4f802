//! The part of the report that a verification adds: the verdict, what failed, and every check.

use std::fmt::Write;

use super::escape;
use crate::verify::{Check, Sense, Short, Verification};

/// The section, from its heading on.
pub fn section(verification: &Verification) -> String {
    let mut out = "<h2>Second opinion</h2>".to_owned();
    let (count, failed) = (verification.checks.len(), verification.failed().count());
    let _ = if failed == 0 {
        write!(
            out,
            "<p class=\"verdict good\">All {count} checks passed, by code that did not make this plan.</p>"
        )
    } else {
        let reasons: String = verification.failed().map(|c| format!("<li>{}</li>", line(c))).collect();
        write!(
            out,
            "<div class=\"verdict bad\">{failed} of {count} checks failed, by code that did not make this plan:<ul>{reasons}</ul></div>"
        )
    };
    let rows: String = verification.checks.iter().map(row).collect();
    let _ = write!(
        out,
        "<details><summary>every check</summary><div class=\"wide\"><table class=\"checks\"><thead><tr><th>check</th><th>value</th>\
         <th>limit</th><th>margin</th><th>unit</th><th>where, and what else</th></tr></thead><tbody>{rows}</tbody></table></div></details>"
    );
    out
}

fn line(check: &Check) -> String {
    escape(&check.to_string().replace("<=", "≤").replace(">=", "≥"))
}

fn row(check: &Check) -> String {
    let name = match &check.subject {
        Some(subject) => format!("{}: {}", escape(check.name), escape(subject)),
        None => escape(check.name),
    };
    let sign = if check.sense == Sense::AtMost { "≤" } else { "≥" };
    let place = check.place.as_ref().map(ToString::to_string);
    let said: Vec<&str> =
        place.as_deref().into_iter().chain([check.note.as_str()]).filter(|t| !t.is_empty()).collect();
    format!(
        "<tr{}><th>{name}</th><td>{}</td><td>{sign} {}</td><td>{}</td><td>{}</td><td>{}</td></tr>",
        if check.passed() { "" } else { " class=\"bad\"" },
        Short(check.value),
        Short(check.limit),
        Short(check.margin()),
        escape(check.unit),
        escape(&said.join("; "))
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::verify::Place;

    #[test]
    fn the_verdict_says_what_failed_and_where() {
        let good = Check::at_least("clearance of moves", 1.02, 1.0, "mm").of("a <nerve>");
        let bad = Check::at_most("joint jerk", 8.0, 7.5, "mm/s³").at(Place::Waypoint(7)).noting("why & how");
        let of = |checks| section(&Verification { checks, files: vec![] });
        let sound = of(vec![good.clone()]);
        assert!(sound.contains("All 1 checks passed") && !sound.contains("bad"), "{sound}");
        let page = of(vec![good, bad]);
        assert!(
            page.contains("<li>joint jerk: 8 ≤ 7.5000 mm/s³, at waypoint 7; why &amp; how</li>"),
            "{page}"
        );
        assert!(page.contains("1 of 2 checks failed") && page.contains("a &lt;nerve&gt;"), "{page}");
        let row = page.split("<tr class=\"bad\">").nth(1).unwrap();
        assert!(row.contains("≤ 7.5") && row.contains("waypoint 7; why &amp; how"), "{row}");
    }
}
