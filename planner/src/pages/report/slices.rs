//! The path in three planes through the target, as SVG, over the CT as an inlined PNG or without it.

use bonemill_planfile::page;
use std::fmt::Write;

use base64::Engine;
use bonemill_cutting::cutter::MoveKind;
use bonemill_geometry::{Point, Work};
use bonemill_pipeline::Plan;
use bonemill_toolpath::scene::{Class, Scene};
use nalgebra::Vector3;

use super::CtSlices;
use crate::pages::show::{CUT_COLOUR, LINK_COLOUR, STRUCTURE_COLOURS, TARGET_COLOUR, css};

/// HU shown as black and as white.
const WINDOW_HU: [f32; 2] = [-1000.0, 2000.0];
/// A side of a slice is labelled with a direction of the patient if its share is at least this (sin 20°).
const LETTER_SHARE: f64 = 0.342;

/// A plane of the work grid: the axes shown to the right and upwards, and the one looked along.
struct Plane {
    /// Its caption, without the position of the slice.
    name: &'static str,
    right: usize,
    up: usize,
    along: usize,
}

const PLANES: [Plane; 3] = [
    Plane { name: "Seen along the approach: work x to the right, y up, at z =", right: 0, up: 1, along: 2 },
    Plane { name: "Seen from the side: work x to the right, approach up, at y =", right: 0, up: 2, along: 1 },
    Plane { name: "Seen from the side: work y to the right, approach up, at x =", right: 1, up: 2, along: 0 },
];

/// The three figures.
pub fn slices(plan: &Plan, ct_slices: CtSlices) -> String {
    PLANES.iter().map(|plane| figure(plan, plane, ct_slices)).collect()
}

fn figure(plan: &Plan, plane: &Plane, ct_slices: CtSlices) -> String {
    let scene = &plan.setup.scene;
    let grid = scene.class.grid();
    let h = grid.spacing_mm().x;
    let dims = grid.dims();
    let cut = (scene.target_center.coords[plane.along] / h).round().clamp(0.0, (dims[plane.along] - 1) as f64)
        as usize;
    let (width, height) = (dims[plane.right], dims[plane.up]);
    let mut svg = format!(
        "<figure class=\"slice\"><figcaption>{} {:.1}\u{a0}mm</figcaption>\
         <svg viewBox=\"0 0 {:.2} {:.2}\" role=\"img\" aria-label=\"Path in a plane\">",
        plane.name,
        cut as f64 * h,
        width as f64 * h,
        height as f64 * h,
    );
    if ct_slices == CtSlices::Shown {
        let _ = write!(
            svg,
            "<image width=\"{:.2}\" height=\"{:.2}\" preserveAspectRatio=\"none\" style=\"image-rendering:auto\" href=\"data:image/png;base64,{}\"/>",
            width as f64 * h,
            height as f64 * h,
            base64::engine::general_purpose::STANDARD.encode(png(scene, plane, cut)),
        );
    }
    svg.push_str(&path_near(plan, plane, cut as f64 * h, height as f64 * h));
    svg.push_str(&sides(plan, plane, [width as f64 * h, height as f64 * h]));
    svg + "</svg></figure>"
}

/// A scale bar of 5 mm, and at each side the direction of the patient to which it points.
fn sides(plan: &Plan, plane: &Plane, [width, height]: [f64; 2]) -> String {
    let size = 0.05 * width.max(height);
    let axis = |n: usize| {
        let mut unit = Vector3::zeros();
        unit[n] = 1.0;
        plan.setup.scene.ct_from_work.rotate(&unit)
    };
    let (right, up) = (axis(plane.right), axis(plane.up));
    let (edge, low) = (0.3 * size, 0.36 * size);
    let (x, y) = (0.5 * width, 0.5 * height);
    let mut out = String::new();
    for (direction, x, y, anchor) in [
        (right, width - edge, y + low, "end"),
        (-right, edge, y + low, "start"),
        (up, x, edge + 0.72 * size, "middle"),
        (-up, x, height - edge, "middle"),
    ] {
        let _ = write!(
            out,
            "<text class=\"side\" x=\"{x:.2}\" y=\"{y:.2}\" font-size=\"{size:.2}\" text-anchor=\"{anchor}\">{}</text>",
            letters(&direction)
        );
    }
    let (x, y) = (edge, height - edge);
    let _ = write!(
        out,
        "<rect class=\"scale\" x=\"{x:.2}\" y=\"{:.2}\" width=\"5\" height=\"{:.2}\"/>\
         <text class=\"side\" x=\"{x:.2}\" y=\"{:.2}\" font-size=\"{:.2}\">5 mm</text>",
        y - 0.15 * size,
        0.15 * size,
        y - 0.4 * size,
        0.8 * size
    );
    out
}

/// The letters of the patient's directions (right, left, anterior, posterior, superior, inferior) toward which a unit direction
/// in ct points, the largest component first.
fn letters(direction: &Vector3<f64>) -> String {
    let mut parts: Vec<(f64, char)> = [('R', 'L'), ('A', 'P'), ('S', 'I')]
        .into_iter()
        .zip(direction.iter())
        .map(|((plus, minus), part)| (part.abs(), if *part > 0.0 { plus } else { minus }))
        .filter(|(share, _)| *share >= LETTER_SHARE)
        .collect();
    parts.sort_by(|a, b| b.0.total_cmp(&a.0));
    parts.into_iter().map(|(_, letter)| letter).collect()
}

/// The moves of which both ends lie within half a layer of the slice.
fn path_near(plan: &Plan, plane: &Plane, at_mm: f64, height_mm: f64) -> String {
    let work_from_ct = plan.setup.scene.ct_from_work.inverse();
    let near = 0.5 * plan.setup.case.path.layer_mm;
    let half = 0.5 * plan.setup.scene.class.grid().spacing_mm().x;
    let mut lines: [String; 2] = Default::default();
    let mut before: Option<Point<Work>> = None;
    for waypoint in &plan.moves.waypoints {
        let p = work_from_ct * waypoint.position;
        let inside = |p: &Point<Work>| (p.coords[plane.along] - at_mm).abs() <= near;
        let place = |p: &Point<Work>| (p.coords[plane.right] + half, height_mm - p.coords[plane.up] - half);
        if let Some(from) = before.filter(|from| inside(from) && inside(&p)) {
            let ((x0, y0), (x1, y1)) = (place(&from), place(&p));
            let line = &mut lines[usize::from(waypoint.kind != MoveKind::Cut)];
            let _ = write!(line, "M{x0:.2} {y0:.2}L{x1:.2} {y1:.2}");
        }
        before = Some(p);
    }
    let [cuts, links] = lines;
    let id = format!("links{}", plane.along);
    format!(
        "<path class=\"cutpath\" stroke=\"{}\" d=\"{cuts}\"/><defs><path id=\"{id}\" d=\"{links}\"/></defs>\
         <use class=\"linkedge\" href=\"#{id}\"/><use class=\"linkpath\" stroke=\"{}\" href=\"#{id}\"/>",
        css(CUT_COLOUR),
        css(LINK_COLOUR)
    )
}

/// The slice in grey, target and structures tinted.
fn png(scene: &Scene, plane: &Plane, cut: usize) -> Vec<u8> {
    let grid = scene.class.grid();
    let (width, height) = (grid.dims()[plane.right], grid.dims()[plane.up]);
    let mut pixels = Vec::with_capacity(width * height * 3);
    for row in 0..height {
        for column in 0..width {
            let mut voxel = [0; 3];
            (voxel[plane.right], voxel[plane.up], voxel[plane.along]) = (column, height - 1 - row, cut);
            let n = grid.index(voxel);
            let share = (scene.hu.data()[n] - WINDOW_HU[0]) / (WINDOW_HU[1] - WINDOW_HU[0]);
            let grey = (share.clamp(0.0, 1.0) * 255.0) as u8;
            let class = scene.class.data()[n];
            let tint = if class.is(Class::STRUCTURE) {
                structure_at(scene, grid.center(voxel))
                    .map(|s| (STRUCTURE_COLOURS[s % STRUCTURE_COLOURS.len()], 0.65))
            } else if class.is(Class::TARGET) {
                Some((TARGET_COLOUR, 0.22))
            } else {
                None
            };
            pixels.extend(match tint {
                None => [grey; 3],
                Some((colour, share)) => {
                    colour.map(|c| (f32::from(grey) * (1.0 - share) + f32::from(c) * share) as u8)
                }
            });
        }
    }
    page::png(width, height, &pixels)
}

/// The structure that holds a point.
fn structure_at(scene: &Scene, p: Point<Work>) -> Option<usize> {
    let p_ct = scene.ct_from_work * p;
    scene.structures.iter().position(|s| s.field.as_ref().is_some_and(|f| f.distance(p_ct) <= 0.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_side_is_named_by_where_it_points_in_the_patient() {
        let named = |x: f64, y: f64, z: f64| letters(&Vector3::new(x, y, z).normalize());
        assert_eq!([named(1.0, 0.0, 0.0), named(-1.0, 0.1, 0.0)], ["R", "L"]);
        assert_eq!([named(0.0, 1.0, 0.0), named(0.0, -1.0, 0.2)], ["A", "P"]);
        assert_eq!([named(0.0, 0.0, 1.0), named(0.0, 0.0, -1.0)], ["S", "I"]);
        assert_eq!([named(-1.0, 0.0, 0.6), named(1.0, -2.0, 1.5)], ["LS", "PSR"]);
    }
}
