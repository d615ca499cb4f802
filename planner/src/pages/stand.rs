//! The map of where an arm may stand, as SVG: a panel for each height, a square for each place, shaded by its tolerance.

use std::fmt::Write;

use bonemill_setup::stand::{Standing, Tried};

/// Directions of ct's axes (RAS+).
const AXES: [&str; 3] = ["x, toward the right", "y, toward the front", "z, toward the head"];
/// Largest side of a panel, px.
const PANEL: f64 = 300.0;
/// Left of a panel's squares, above and below them, and between panels, px.
const LEFT: f64 = 58.0;
const TOP: f64 = 40.0;
const BELOW: f64 = 46.0;
const GAP: f64 = 24.0;
/// Panels in a row.
const IN_A_ROW: usize = 3;
/// Colours of the least and the largest tolerance, and of places where the arm does not fit.
const LIGHT: [f64; 3] = [214.0, 230.0, 244.0];
const DARK: [f64; 3] = [8.0, 69.0, 148.0];
const NOT: &str = "#e9e5df";

/// The picture.
pub fn map(standing: &Standing) -> String {
    let (patch, counts) = (&standing.patch, standing.patch.counts());
    // panels are cut along the axis that is most upright, so that one is a floor seen from above
    let up = patch.up.iamax();
    let flat: Vec<usize> = (0..3).filter(|k| *k != up).collect();
    let [a, b] = [flat[0], flat[1]];
    let steps = patch.steps_mm();
    let side_mm = |k: usize| if counts[k] > 1 { steps[k] } else { patch.step_mm };
    let widest_mm = [a, b].map(|k| counts[k] as f64 * side_mm(k));
    let px_per_mm = PANEL / widest_mm[0].max(widest_mm[1]);
    let [width, height] = widest_mm.map(|mm| mm * px_per_mm);
    let most_mm = standing.places.iter().map(|place| place.tolerance_mm).fold(0.0, f64::max);
    let (columns, rows) = (counts[up].min(IN_A_ROW), counts[up].div_ceil(IN_A_ROW));
    let (panel_w, panel_h) = (LEFT + width.max(170.0) + GAP, TOP + height + BELOW);
    let (whole_w, whole_h) = ((columns as f64 * panel_w).max(560.0), rows as f64 * panel_h + 62.0);
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {whole_w:.0} {whole_h:.0}\" width=\"{whole_w:.0}\" height=\"{whole_h:.0}\" \
         font-family=\"sans-serif\" font-size=\"12\"><rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n"
    );
    let best = standing.best.as_ref().map(|best| best.place);
    for layer in 0..counts[up] {
        let (x0, y0) = ((layer % IN_A_ROW) as f64 * panel_w, (layer / IN_A_ROW) as f64 * panel_h);
        let left = |mm: f64| x0 + LEFT + (mm - patch.from_mm[a] + 0.5 * side_mm(a)) * px_per_mm;
        let top = |mm: f64| y0 + TOP + height - (mm - patch.from_mm[b] + 0.5 * side_mm(b)) * px_per_mm;
        let name = ["x", "y", "z"][up];
        let at_mm = patch.from_mm[up] + layer as f64 * steps[up];
        let _ = writeln!(
            out,
            "<text x=\"{:.1}\" y=\"{:.1}\" font-weight=\"bold\">{name} = {at_mm:.0} mm</text>",
            x0 + LEFT,
            y0 + TOP - 12.0
        );
        let places = standing.places.iter().enumerate();
        let here = places.filter(|(n, _)| n / counts[..up].iter().product::<usize>() % counts[up] == layer);
        for (n, place) in here {
            let [w, h] = [a, b].map(|k| side_mm(k) * px_per_mm);
            let (x, y) = (left(place.at_mm[a]) - 0.5 * w, top(place.at_mm[b]) - 0.5 * h);
            let _ = writeln!(
                out,
                "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{w:.2}\" height=\"{h:.2}\" fill=\"{}\" stroke=\"#fff\" stroke-width=\"0.5\"><title>{}</title></rect>",
                fill(place, most_mm),
                told(place)
            );
            if best == Some(n) {
                out.push_str(&ring(x + 0.5 * w, y + 0.5 * h, (0.32 * w.min(h)).max(4.0)));
            }
        }
        let is_within = |k: usize| {
            (-0.5 * side_mm(k)..=0.5 * side_mm(k)).contains(&patch.from_mm[k].max(0.0).min(patch.to_mm[k]))
        };
        if is_within(a) && is_within(b) {
            out.push_str(&cross(left(0.0), top(0.0)));
        }
        for k in [a, b] {
            let ends = [patch.from_mm[k], 0.5 * (patch.from_mm[k] + patch.to_mm[k]), patch.to_mm[k]];
            for mm in ends.iter().take(if counts[k] > 1 { 3 } else { 1 }) {
                let (x, y, anchor) = if k == a {
                    (left(*mm), y0 + TOP + height + 15.0, "middle")
                } else {
                    (x0 + LEFT - 6.0, top(*mm) + 4.0, "end")
                };
                let _ =
                    writeln!(out, "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{mm:.0}</text>");
            }
        }
        let (x, y) = (x0 + LEFT + 0.5 * width, y0 + TOP + height + 32.0);
        let _ =
            writeln!(out, "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"middle\">{} [mm]</text>", AXES[a]);
        let (x, y) = (x0 + 14.0, y0 + TOP + 0.5 * height);
        let _ = writeln!(
            out,
            "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"middle\" transform=\"rotate(-90 {x:.1} {y:.1})\">{} [mm]</text>",
            AXES[b]
        );
    }
    legend(&mut out, rows as f64 * panel_h + 14.0, most_mm, best.is_some());
    out + "</svg>\n"
}

/// What the shades and marks mean, below the panels.
fn legend(out: &mut String, y: f64, most_mm: f64, has_best: bool) {
    let _ = writeln!(
        out,
        "<text x=\"{LEFT}\" y=\"{:.1}\">The base from the target's centre; how far it may be displaced and everything still fits:</text>",
        y + 4.0
    );
    let y = y + 16.0;
    for n in 0..10 {
        let (x, colour) = (LEFT + 16.0 * f64::from(n), shade(f64::from(n) / 9.0));
        let _ = writeln!(out, "<rect x=\"{x}\" y=\"{y}\" width=\"16\" height=\"12\" fill=\"{colour}\"/>");
    }
    let middle = y + 6.0;
    let mut text = |x: f64, said: &str| {
        let _ = writeln!(out, "<text x=\"{:.1}\" y=\"{:.1}\">{said}</text>", LEFT + x, middle + 4.5);
    };
    text(166.0, &format!("0 to {most_mm:.0} mm"));
    text(286.0, "does not fit");
    text(386.0, "target");
    if has_best {
        text(450.0, "best");
    }
    let _ =
        writeln!(out, "<rect x=\"{}\" y=\"{y}\" width=\"12\" height=\"12\" fill=\"{NOT}\"/>", LEFT + 270.0);
    out.push_str(&cross(LEFT + 376.0, middle));
    if has_best {
        out.push_str(&ring(LEFT + 440.0, middle, 5.0));
    }
}

/// The target's mark.
fn cross(x: f64, y: f64) -> String {
    let (left, top) = (x - 6.0, y - 6.0);
    format!("<path d=\"M{left:.1},{y:.1}h12M{x:.1},{top:.1}v12\" stroke=\"#c22\" stroke-width=\"2\"/>\n")
}

/// The best place's mark.
fn ring(x: f64, y: f64, radius: f64) -> String {
    format!(
        "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius:.1}\" fill=\"none\" stroke=\"#d1731f\" stroke-width=\"2.5\"/>\n"
    )
}

/// A tolerance's colour, by its share of the largest.
fn shade(share: f64) -> String {
    let [r, g, b] = std::array::from_fn(|k| (LIGHT[k] + share * (DARK[k] - LIGHT[k])).round() as u8);
    format!("#{r:02x}{g:02x}{b:02x}")
}

fn fill(place: &Tried, most_mm: f64) -> String {
    if place.fault.is_some() {
        NOT.into()
    } else {
        shade(place.tolerance_mm / most_mm.max(f64::MIN_POSITIVE))
    }
}

fn told(place: &Tried) -> String {
    let at = place.at_mm;
    let said = match &place.fault {
        Some(fault) => fault.why.replace('&', "&amp;").replace('<', "&lt;"),
        None => format!("fits, within {:.0} mm", place.tolerance_mm),
    };
    format!("{:.0}, {:.0}, {:.0} mm: {said}", at.x, at.y, at.z)
}
