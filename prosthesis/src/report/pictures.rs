//! The report's pictures: the part in its block, the toolpath by side, the deviation in colours with its histogram.

use std::fmt::Write;

use crate::machining::{Kind, Side, TipMove};

use nalgebra::Vector3;

use crate::ProsthesisPlan;
use crate::picture::{Colour, Picture, View};

const PART: Colour = [214, 196, 160];
const EDGE: Colour = [90, 100, 110];
const ROUGH: Colour = [70, 130, 200];
const FINISH: Colour = [46, 160, 90];
const CONTOUR: Colour = [200, 60, 60];
const GRIP: Colour = [150, 120, 60];
const REPOSITION: Colour = [190, 190, 190];

/// Distance of the lines that hatch the grip, and half of the cross at the zero, mm.
const HATCH_MM: f64 = 2.0;
const ZERO_MM: f64 = 4.0;

/// Deviation at which the colours end, mm: below in blue, above in red.
const COLOUR_RANGE_MM: [f64; 2] = [-0.02, 0.1];
/// Bin of the histogram, mm, and bins on either side of 0.
const HISTOGRAM: (f64, usize) = (0.01, 15);

/// The block's edges and the part, from three sides.
pub(super) fn part_in_block(plan: &ProsthesisPlan) -> String {
    let (low, high) = (&plan.block.low_mm, &plan.block.high_mm);
    let views = [
        (View::side_a(), "Side A, seen along the cutter: x to the right, −z up"),
        (View::side_b(), "Side B, after half a turn: x to the right, z up"),
        (View::oblique(), "From above and aside, z up; the grip is at the lower end"),
    ];
    let figures = views.into_iter().map(|(view, caption)| {
        let mut picture = Picture::of_box(view, low, high);
        picture.surface(&plan.part, |_| PART);
        picture.frame(low, high, EDGE);
        let mut grip = *high;
        grip.z = low.z + plan.block.grip_mm;
        picture.frame(low, &grip, EDGE);
        picture.figure(caption)
    });
    format!("<div class=\"figures\">{}</div>", figures.collect::<String>())
}

/// What the machinist sees at A = 0, along the spindle: the block, its grip and the program's zero.
pub(super) fn set_up(plan: &ProsthesisPlan) -> String {
    let (low, high) = (plan.block.low_mm, plan.block.high_mm);
    let mut picture = Picture::of_box(View::side_a(), &low, &high);
    picture.frame(&low, &high, EDGE);
    // the grip hatched, the zero a cross, both on the side that faces the spindle
    let on_top = |x: f64, z: f64| Vector3::new(x, high.y, z);
    let grip_mm = plan.block.grip_mm;
    let hatches = ((high.x - low.x) / HATCH_MM) as usize;
    for n in 0..=hatches {
        let x = low.x + n as f64 * HATCH_MM;
        picture.line(&on_top(x, low.z), &on_top(x, low.z + grip_mm), GRIP);
    }
    picture.line(&on_top(low.x, low.z + grip_mm), &on_top(high.x, low.z + grip_mm), GRIP);
    picture.line(&on_top(-ZERO_MM, 0.0), &on_top(ZERO_MM, 0.0), CONTOUR);
    picture.line(&on_top(0.0, -ZERO_MM), &on_top(0.0, ZERO_MM), CONTOUR);
    let caption = "Set-up at A = 0, seen along the spindle: X to the right, Y up; the cross is X0 Y0, on the rotary axis; the grip is hatched";
    format!("<div class=\"figures\">{}</div>", picture.figure(caption))
}

/// The moves of each side.
pub(super) fn toolpath(plan: &ProsthesisPlan) -> String {
    let views = [
        (Side::A, View::side_a(), "Side A: x to the right, −z up"),
        (Side::B, View::side_b(), "Side B: x to the right, z up"),
        (Side::C, View::side_b(), "Side C, the outline: x to the right, z up"),
    ];
    let figures = views.into_iter().map(|(side, view, caption)| {
        let mut picture = Picture::of_box(view, &plan.block.low_mm, &plan.block.high_mm);
        for (from, to) in pairs(&plan.machining.moves, side) {
            picture.line(&from.tip_mm, &to.tip_mm, colour(to.kind));
        }
        picture.frame(&plan.block.low_mm, &plan.block.high_mm, EDGE);
        picture.figure(caption)
    });
    let keys =
        [("roughing", ROUGH), ("finishing", FINISH), ("contour", CONTOUR), ("repositioning", REPOSITION)];
    format!("{}<div class=\"figures\">{}</div>", legend(&keys), figures.collect::<String>())
}

/// Moves of a side with where they begin.
fn pairs(moves: &[TipMove], side: Side) -> impl Iterator<Item = (&TipMove, &TipMove)> {
    moves.windows(2).filter_map(move |pair| match pair {
        [from, to] if to.side == side && from.side == side && from.a_rad == to.a_rad => Some((from, to)),
        _ => None,
    })
}

fn colour(kind: Kind) -> Colour {
    match kind {
        Kind::Rough => ROUGH,
        Kind::Finish => FINISH,
        Kind::Contour => CONTOUR,
        Kind::Link | Kind::Retract => REPOSITION,
    }
}

/// The surface coloured by what the program leaves, both sides, and how much area has which deviation.
pub(super) fn deviation(plan: &ProsthesisPlan) -> String {
    // the proof's last samples are the mesh's vertices
    let samples = &plan.proof.samples;
    let first = samples.len().saturating_sub(plan.part.vertices.len());
    let at_vertex = |v: usize| samples.get(first + v).map_or(0.0, |s| s.deviation_mm);
    let views =
        [(View::side_a(), "Side A: x to the right, −z up"), (View::side_b(), "Side B: x to the right, z up")];
    let half = plan.placing.chosen.size_mm / 2.0;
    let figures = views.into_iter().map(|(view, caption)| {
        let mut picture = Picture::of_box(view, &-half, &half);
        picture.surface(&plan.part, |v| scale(at_vertex(v)));
        picture.figure(caption)
    });
    let [low, high] = COLOUR_RANGE_MM;
    let keys = [low, 0.0, 0.25 * high, 0.5 * high, high].map(|mm| (format!("{mm:+.3} mm"), scale(mm)));
    let keys: Vec<(&str, Colour)> = keys.iter().map(|(text, colour)| (text.as_str(), *colour)).collect();
    format!(
        "<p>Above 0: stock left on the part; below 0: cut into it. The tab that holds the part to the end stays on purpose.</p>{}<div class=\"figures\">{}\
         {}</div>",
        legend(&keys),
        figures.collect::<String>(),
        histogram(plan)
    )
}

/// Blue below 0, grey at it, through yellow to red above.
pub(crate) fn scale(deviation_mm: f64) -> Colour {
    let [low, high] = COLOUR_RANGE_MM;
    let mix = |a: [f64; 3], b: [f64; 3], t: f64| {
        [0, 1, 2].map(|k| (a[k] + (b[k] - a[k]) * t.clamp(0.0, 1.0)) as u8)
    };
    let (none, half, much) = ([215.0, 222.0, 218.0], [250.0, 205.0, 80.0], [205.0, 40.0, 40.0]);
    match deviation_mm / high {
        _ if deviation_mm < 0.0 => mix(none, [30.0, 70.0, 220.0], deviation_mm / low),
        t if t < 0.5 => mix(none, half, 2.0 * t),
        t => mix(half, much, 2.0 * t - 1.0),
    }
}

fn histogram(plan: &ProsthesisPlan) -> String {
    let (width_mm, bins) = HISTOGRAM;
    let areas = plan.proof.histogram(width_mm, bins);
    let most = areas.iter().copied().fold(1e-9, f64::max);
    let (w, h, left, bottom) = (720.0, 420.0, 60.0, 50.0);
    let step = (w - left) / areas.len() as f64;
    let mut svg = format!(
        "<figure><figcaption>Area of the part by deviation, bins of {width_mm} mm; the first and the last are open</figcaption>\
         <svg class=\"drawn\" viewBox=\"0 0 {w} {h}\" role=\"img\" aria-label=\"Histogram of the deviation\">"
    );
    for (n, area) in areas.iter().enumerate() {
        let (x, height) = (left + n as f64 * step, (h - bottom - 20.0) * area / most);
        let [r, g, b] = scale((n as f64 + 0.5 - bins as f64) * width_mm);
        let _ = write!(
            svg,
            "<rect x=\"{x:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{height:.1}\" fill=\"rgb({r},{g},{b})\" stroke=\"#555\" stroke-width=\"0.5\"/>",
            h - bottom - height,
            step - 1.0
        );
        if n % 5 == 0 {
            let mm = (n as f64 - bins as f64) * width_mm;
            let _ = write!(
                svg,
                "<text x=\"{x:.1}\" y=\"{:.1}\" font-size=\"17\" text-anchor=\"middle\">{mm:.2}</text>",
                h - bottom + 20.0
            );
        }
    }
    let _ = write!(
        svg,
        "<text x=\"{:.1}\" y=\"{:.1}\" font-size=\"17\" text-anchor=\"middle\">deviation, mm</text>\
         <text x=\"8\" y=\"34\" font-size=\"17\">{most:.0} mm²</text><line x1=\"{left}\" y1=\"{:.1}\" x2=\"{w}\" y2=\"{:.1}\" stroke=\"#555\"/></svg></figure>",
        left + (w - left) / 2.0,
        h - 8.0,
        h - bottom,
        h - bottom
    );
    svg
}

fn legend(keys: &[(&str, Colour)]) -> String {
    let chip = |(text, [r, g, b]): &(&str, Colour)| {
        format!("<span class=\"chip\"><i style=\"background:rgb({r},{g},{b})\"></i>{text}</span>")
    };
    format!("<p class=\"legend\">{}</p>", keys.iter().map(chip).collect::<String>())
}
