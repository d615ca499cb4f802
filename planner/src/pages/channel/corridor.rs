//! The corridor of a channel as SVG, over sections of the images as inlined PNG or without them.

use bonemill_planfile::page;
use std::fmt::Write;

use base64::Engine;
use bonemill_channel::ChannelPlan;
use bonemill_channel::section::Section;

use crate::pages::report::CtSlices;
use crate::pages::show::{CUT_COLOUR, STRUCTURE_COLOURS, css};

/// HU shown as black and as white.
const WINDOW_HU: [f32; 2] = [-1000.0, 2000.0];
/// Pieces of the front's outline.
const PIECES: usize = 40;
/// Share of a structure's colour in its pixels.
const TINT: f32 = 0.65;

/// One figure per section.
pub fn figures(plan: &ChannelPlan, ct_slices: CtSlices) -> String {
    plan.sections.iter().enumerate().map(|(n, section)| figure(plan, section, n, ct_slices)).collect()
}

fn figure(plan: &ChannelPlan, section: &Section, number: usize, ct_slices: CtSlices) -> String {
    let caption = match section.across_at_mm {
        Some(mm) => format!("Across the channel at a depth of {mm:.1}\u{a0}mm, seen from outside"),
        None if number == 0 => {
            "Along the channel, toward the structure that limits it; out of the bone is up".into()
        }
        None => "Along the channel, at a right angle to that".into(),
    };
    let [width, height] = section.size.map(|n| n as f64 * section.pixel_mm);
    let half = 0.5 * section.pixel_mm;
    let (left, top) = (section.left_mm - half, section.top_mm - half);
    let mut svg = format!(
        "<figure class=\"slice\"><figcaption>{caption}</figcaption>\
         <svg viewBox=\"{left:.2} {top:.2} {width:.2} {height:.2}\" role=\"img\" aria-label=\"{caption}\">",
    );
    if ct_slices == CtSlices::Shown {
        let _ = write!(
            svg,
            "<image x=\"{left:.2}\" y=\"{top:.2}\" width=\"{width:.2}\" height=\"{height:.2}\" preserveAspectRatio=\"none\" href=\"data:image/png;base64,{}\"/>",
            base64::engine::general_purpose::STANDARD.encode(png(section)),
        );
    }
    let colour = css(CUT_COLOUR);
    let r = plan.record.radius_mm;
    let margin = r + needed_mm(plan);
    let line = |dash: &str| format!("fill=\"none\" stroke=\"{colour}\" stroke-width=\"0.2\"{dash}");
    let dashed = line(" stroke-dasharray=\"0.8 0.5\"");
    if section.across_at_mm.is_some() {
        let _ = write!(svg, "<circle r=\"{r:.3}\" {}/><circle r=\"{margin:.3}\" {dashed}/>", line(""));
    } else {
        let path = |beside_mm: f64| swept(plan, section.top_mm, beside_mm);
        let _ = write!(
            svg,
            "<path d=\"{}\" {}/><path d=\"{}\" {dashed}/>",
            path(0.0),
            line(""),
            path(margin - r)
        );
        let _ = write!(
            svg,
            "<path d=\"M{left:.2} 0H{:.2}\" stroke=\"white\" stroke-width=\"0.12\" stroke-dasharray=\"0.4 0.4\"/>",
            left + width
        );
    }
    svg.push_str(&scale(left, top + height, width.max(height)));
    svg + "</svg></figure>"
}

/// What the tool sweeps down to its depth and what is within `beside_mm` of it, from a height on, as an SVG path.
fn swept(plan: &ChannelPlan, top_mm: f64, beside_mm: f64) -> String {
    let (r, to_mm) = (plan.record.radius_mm, plan.record.depth_mm);
    let pieces = |n: usize| n as f64 / PIECES as f64;
    // the front as points near each other, and the lower edge of discs about them
    let front: Vec<[f64; 2]> = plan
        .front
        .windows(2)
        .flat_map(|w| (0..=PIECES).map(move |n| [0, 1].map(|a| w[0][a] + pieces(n) * (w[1][a] - w[0][a]))))
        .collect();
    let low_mm = |aside_mm: f64| {
        let below =
            front.iter().filter(|[_, radius]| (aside_mm - radius).abs() <= beside_mm + r / PIECES as f64);
        let edge =
            below.map(|[z, radius]| z - (beside_mm.powi(2) - (aside_mm - radius).powi(2)).max(0.0).sqrt());
        edge.fold(f64::INFINITY, f64::min)
    };
    let half: Vec<[f64; 2]> = (0..=PIECES)
        .map(|n| pieces(n) * (r + beside_mm))
        .map(|aside_mm| [aside_mm, to_mm - low_mm(aside_mm)])
        .filter(|[_, depth_mm]| depth_mm.is_finite())
        .collect();
    let mut path = format!("M{:.3} {top_mm:.2}", -r - beside_mm);
    for [x, depth_mm] in half.iter().rev().map(|[x, depth_mm]| [-x, *depth_mm]).chain(half.iter().copied()) {
        let _ = write!(path, "L{x:.3} {depth_mm:.3}");
    }
    let _ = write!(path, "L{:.3} {top_mm:.2}", r + beside_mm);
    path
}

/// What the registration's error needs at the allowed probability beside the structure that limits the channel, mm.
fn needed_mm(plan: &ChannelPlan) -> f64 {
    let kept = plan.channel.kept.iter().flatten();
    let limiting = kept.min_by(|a, b| a.weighted_margin_mm.total_cmp(&b.weighted_margin_mm));
    limiting.map_or(0.0, |kept| kept.needed_mm)
}

/// A scale bar of 5 mm in the lower left corner.
fn scale(left: f64, bottom: f64, size: f64) -> String {
    let (x, y, text) = (left + 0.02 * size, bottom - 0.02 * size, 0.035 * size);
    format!(
        "<rect class=\"scale\" x=\"{x:.2}\" y=\"{:.2}\" width=\"5\" height=\"{:.2}\"/>\
         <text class=\"side\" x=\"{x:.2}\" y=\"{:.2}\" font-size=\"{text:.2}\">5 mm</text>",
        y - 0.2 * text,
        0.2 * text,
        y - 0.5 * text
    )
}

/// The section in grey, structures tinted.
fn png(section: &Section) -> Vec<u8> {
    let mut pixels = Vec::with_capacity(section.hu.len() * 3);
    for (hu, structure) in section.hu.iter().zip(&section.structure) {
        let share = (hu - WINDOW_HU[0]) / (WINDOW_HU[1] - WINDOW_HU[0]);
        let grey = (share.clamp(0.0, 1.0) * 255.0) as u8;
        pixels.extend(match structure {
            None => [grey; 3],
            Some(n) => STRUCTURE_COLOURS[n % STRUCTURE_COLOURS.len()]
                .map(|c| (f32::from(grey) * (1.0 - TINT) + f32::from(c) * TINT) as u8),
        });
    }
    let [width, height] = section.size;
    page::png(width, height, &pixels)
}
