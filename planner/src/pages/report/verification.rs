//! The part of the report that a verification adds: the result, the failed checks, the risks under drawn errors, and every
//! check.

use std::fmt::Write;

use bonemill_verify::uncertainty::{ErrorModel, Risk};
use bonemill_verify::{Check, LimitSide, Short, Verification};

use super::escape;

/// The section, from its heading on; `risk`: the drawn errors, and the risks under them.
pub fn section(verification: &Verification, risk: Option<(&ErrorModel, &Risk)>) -> String {
    let mut out = "<h2>Second opinion</h2>".to_owned();
    let (count, failed) = (verification.checks.len(), verification.failed().count());
    let _ = if failed == 0 {
        write!(
            out,
            "<p class=\"verdict good\">All {count} checks passed. The code of these checks did not make the plan.</p>"
        )
    } else {
        let reasons: String = verification.failed().map(|c| format!("<li>{}</li>", line(c))).collect();
        write!(
            out,
            "<div class=\"verdict bad\">{failed} of {count} checks failed. The code of these checks did not make the plan.<ul>{reasons}</ul></div>"
        )
    };
    out.extend(
        verification
            .shared_readers
            .iter()
            .map(|r| format!("<p class=\"note\">{}.</p>", escape(&r.to_string()))),
    );
    out.extend(risk.map(|(model, risk)| under_errors(model, risk)));
    let rows: String = verification.checks.iter().map(row).collect();
    let _ = write!(
        out,
        "<details><summary>all checks</summary><div class=\"wide\"><table class=\"checks\"><thead><tr><th>check</th><th>value</th>\
         <th>limit</th><th>margin</th><th>unit</th><th>place of the worst value, and remarks</th></tr></thead><tbody>{rows}</tbody></table></div></details>"
    );
    out
}

/// The risks under drawn errors, for every structure and for the forces.
fn under_errors(model: &ErrorModel, risk: &Risk) -> String {
    let sigmas = model.registration.sigmas();
    let of = |three: &[f64], scale: f64| {
        let all: Vec<String> = three.iter().map(|s| rounded(s * scale, 2)).collect();
        if all.iter().all(|s| *s == all[0]) { all[0].clone() } else { all.join(", ") }
    };
    let mut out = format!(
        "<h3>Under random errors</h3><p class=\"note\">The plan was evaluated {} times with normally distributed errors of these standard \
         deviations: registration {} mm along and {}° about each axis of ct, boundary of each structure {} mm, density \
         {} %, cutting coefficients {} %. The tables show quantiles over these samples. A distance below 0 means that the structure \
         is cut. Every structure must stay untouched with a probability of {} %.</p>",
        model.samples,
        of(&sigmas[..3], 1.0),
        of(&sigmas[3..], 1f64.to_degrees()),
        rounded(model.boundary_sigma_mm, 2),
        rounded(100.0 * model.density_share, 1),
        rounded(100.0 * model.coefficient_share, 1),
        rounded(100.0 * model.keep, 2)
    );
    let structures: String = risk
        .structures
        .iter()
        .map(|s| {
            let (bad, [low, middle, high]) = (s.falls_short(model.keep), s.kept_mm);
            format!(
                "<tr{}><th>{}</th><td>{} %</td><td>{} to {} %</td><td>{low:.2}</td><td>{middle:.2}</td><td>{high:.2}</td>\
                 <td>{:.2}</td></tr>",
                if bad { " class=\"bad\"" } else { "" },
                escape(&s.name),
                rounded(100.0 * s.touched.estimate, 1),
                rounded(100.0 * s.touched.low, 1),
                rounded(100.0 * s.touched.high, 1),
                s.clearance_mm
            )
        })
        .collect();
    let forces: String = risk
        .forces
        .iter()
        .map(|f| {
            let [low, middle, high] = f.spread_n;
            format!(
                "<tr><th>{}</th><td>{:.3}</td><td>{low:.3}</td><td>{middle:.3}</td><td>{high:.3}</td></tr>",
                escape(&f.name),
                f.planned_n
            )
        })
        .collect();
    let _ = write!(
        out,
        "<div class=\"wide\"><table><thead><tr><th rowspan=\"2\">structure</th><th colspan=\"2\">touched in</th>\
         <th colspan=\"3\">least distance of the burr's surface [mm]</th><th rowspan=\"2\">clearance that would suffice [mm]</th></tr>\
         <tr><th>samples</th><th>95 % interval</th><th>5 %</th><th>50 %</th><th>95 %</th></tr></thead><tbody>{structures}</tbody></table></div>\
         <div class=\"wide\"><table><thead><tr><th rowspan=\"2\">force [N]</th><th rowspan=\"2\">planned</th><th colspan=\"3\">quantiles</th></tr>\
         <tr><th>5 %</th><th>50 %</th><th>95 %</th></tr></thead><tbody>{forces}</tbody></table></div>"
    );
    out
}

/// A number with at most so many decimals, without trailing zeros.
fn rounded(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

fn line(check: &Check) -> String {
    escape(&check.to_string().replace("<=", "≤").replace(">=", "≥"))
}

fn row(check: &Check) -> String {
    let name = match &check.subject {
        Some(subject) => format!("{}: {}", escape(check.name), escape(subject)),
        None => escape(check.name),
    };
    let sign = if check.sense == LimitSide::AtMost { "≤" } else { "≥" };
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
    use bonemill_verify::Place;
    use bonemill_verify::uncertainty::{ForceSpread, RigidError, Share, StructureRisk};

    #[test]
    fn the_verdict_says_what_failed_and_where() {
        let good = Check::at_least("clearance of moves", 1.02, 1.0, "mm").of("a <nerve>");
        let bad = Check::at_most("joint jerk", 8.0, 7.5, "mm/s³").at(Place::Waypoint(7)).noting("why & how");
        let of = |checks| section(&Verification { checks, files: vec![], shared_readers: vec![] }, None);
        let sound = of(vec![good.clone()]);
        assert!(sound.contains("All 1 checks passed") && !sound.contains("bad"), "{sound}");
        let page = of(vec![good, bad]);
        assert!(
            page.contains("<li>joint jerk: 8 &gt; 7.5000 mm/s³, at waypoint 7; why &amp; how</li>"),
            "{page}"
        );
        assert!(page.contains("1 of 2 checks failed") && page.contains("a &lt;nerve&gt;"), "{page}");
        let row = page.split("<tr class=\"bad\">").nth(1).unwrap();
        assert!(row.contains("≤ 7.5") && row.contains("waypoint 7; why &amp; how"), "{row}");
    }

    #[test]
    fn drawn_errors_stand_in_the_report_with_what_was_drawn() {
        let about = bonemill_geometry::Point::new(0.0, 0.0, 0.0);
        let registration = RigidError::of_sigmas([0.3; 3], [0.01, 0.02, 0.01], about).unwrap();
        let model = ErrorModel {
            registration,
            boundary_sigma_mm: 0.15,
            density_share: 0.1,
            coefficient_share: 0.25,
            samples: 400,
            seed: 1,
            keep: 0.95,
        };
        let structure = |name: &str, hits| StructureRisk {
            name: name.into(),
            touched: Share::of(hits, 400),
            kept_mm: [-0.1, 0.5, 1.25],
            clearance_mm: 1.5,
        };
        let force = ForceSpread { name: "peak".into(), planned_n: 2.0, spread_n: [1.0, 2.0, 3.5] };
        let risk =
            Risk { structures: vec![structure("a <nerve>", 80), structure("dura", 0)], forces: vec![force] };
        let page = section(
            &Verification { checks: vec![], files: vec![], shared_readers: vec![] },
            Some((&model, &risk)),
        );
        for part in [
            "evaluated 400 times",
            "registration 0.3 mm along and 0.57, 1.15, 0.57° about",
            "density 10 %, cutting coefficients 25 %",
            "probability of 95 %",
            "<tr class=\"bad\"><th>a &lt;nerve&gt;</th><td>20 %</td>",
            "<td>-0.10</td><td>0.50</td><td>1.25</td><td>1.50</td>",
            "<tr><th>dura</th><td>0 %</td>",
            "<tr><th>peak</th><td>2.000</td><td>1.000</td><td>2.000</td><td>3.500</td></tr>",
        ] {
            assert!(page.contains(part), "{part} is not in {page}");
        }
    }
}
