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
            "<p class=\"verdict good\">All {count} checks passed, by code that did not make this plan.</p>"
        )
    } else {
        let reasons: String = verification.failed().map(|c| format!("<li>{}</li>", line(c))).collect();
        write!(
            out,
            "<div class=\"verdict bad\">{failed} of {count} checks failed, by code that did not make this plan:<ul>{reasons}</ul></div>"
        )
    };
    out.extend(risk.map(|(model, risk)| under_errors(model, risk)));
    let rows: String = verification.checks.iter().map(row).collect();
    let _ = write!(
        out,
        "<details><summary>every check</summary><div class=\"wide\"><table class=\"checks\"><thead><tr><th>check</th><th>value</th>\
         <th>limit</th><th>margin</th><th>unit</th><th>where, and what else</th></tr></thead><tbody>{rows}</tbody></table></div></details>"
    );
    out
}

/// The risks under drawn errors, for every structure and for the forces.
fn under_errors(model: &ErrorModel, risk: &Risk) -> String {
    let sigmas = model.registration.sigmas();
    let of = |three: &[f64], scale: f64| {
        let all: Vec<String> = three.iter().map(|s| Short(s * scale).to_string()).collect();
        if all.iter().all(|s| *s == all[0]) { all[0].clone() } else { all.join(", ") }
    };
    let mut out = format!(
        "<h3>Under drawn errors</h3><p class=\"note\">The plan was repeated {} times with normal errors of these standard \
         deviations: registration {} mm along and {}° about each axis of ct, boundary of each structure {} mm, density \
         {} %, cutting coefficients {} %. Below 0 mm a structure is cut. Every structure is to be kept with a probability \
         of {} %.</p>",
        model.samples,
        of(&sigmas[..3], 1.0),
        of(&sigmas[3..], 1f64.to_degrees()),
        Short(model.boundary_sigma_mm),
        Short(100.0 * model.density_share),
        Short(100.0 * model.coefficient_share),
        Short(100.0 * model.keep)
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
                Short(100.0 * s.touched.estimate),
                Short(100.0 * s.touched.low),
                Short(100.0 * s.touched.high),
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
        "<div class=\"wide\"><table><thead><tr><th></th><th>touched</th><th>95 % interval</th><th>distance kept in 5 % [mm]</th>\
         <th>50 %</th><th>95 %</th><th>clearance that would keep it [mm]</th></tr></thead><tbody>{structures}</tbody></table></div>\
         <div class=\"wide\"><table><thead><tr><th>force</th><th>as planned [N]</th><th>in 5 % [N]</th><th>50 %</th><th>95 %</th>\
         </tr></thead><tbody>{forces}</tbody></table></div>"
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
        let of = |checks| section(&Verification { checks, files: vec![] }, None);
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
        let page = section(&Verification { checks: vec![], files: vec![] }, Some((&model, &risk)));
        for part in [
            "repeated 400 times",
            "registration 0.30000 mm along and 0.57296, 1.1459, 0.57296° about",
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
