//! The path over the CT in three planes through the target, as SVG with the image inlined as PNG.

use std::fmt::Write;

use base64::Engine;
use bonemill_geometry::{Point, Work};
use bonemill_imaging::{Class, Scene};

use crate::path::MoveKind;
use crate::pipeline::Plan;
use crate::show::STRUCTURE_COLOURS;

/// HU shown as black and as white.
const WINDOW_HU: [f32; 2] = [-1000.0, 2000.0];
/// Colour of the target.
const TARGET: [u8; 3] = [80, 255, 140];

/// A plane of the work grid: the axes shown to the right and upwards, and the one looked along.
struct Plane {
    /// What it shows, up to the place of the slice.
    name: &'static str,
    right: usize,
    up: usize,
    along: usize,
}

const PLANES: [Plane; 3] = [
    Plane { name: "from above, along the approach: x to the right, y up; z =", right: 0, up: 1, along: 2 },
    Plane { name: "from the side: x to the right, approach z up; y =", right: 0, up: 2, along: 1 },
    Plane { name: "from the side: y to the right, approach z up; x =", right: 1, up: 2, along: 0 },
];

/// Three figures.
pub fn slices(plan: &Plan) -> String {
    PLANES.iter().map(|plane| figure(plan, plane)).collect()
}

fn figure(plan: &Plan, plane: &Plane) -> String {
    let scene = &plan.scene;
    let grid = scene.class.grid();
    let h = grid.spacing_mm().x;
    let dims = grid.dims();
    let cut = (scene.target_center.coords[plane.along] / h).round().clamp(0.0, (dims[plane.along] - 1) as f64)
        as usize;
    let (width, height) = (dims[plane.right], dims[plane.up]);
    let mut svg = format!(
        "<figure class=\"slice\"><figcaption>{} {:.1}\u{a0}mm</figcaption>\
         <svg viewBox=\"0 0 {:.2} {:.2}\" role=\"img\" aria-label=\"CT slice with path\">\
         <image width=\"{:.2}\" height=\"{:.2}\" preserveAspectRatio=\"none\" style=\"image-rendering:auto\" href=\"data:image/png;base64,{}\"/>",
        plane.name,
        cut as f64 * h,
        width as f64 * h,
        height as f64 * h,
        width as f64 * h,
        height as f64 * h,
        base64::engine::general_purpose::STANDARD.encode(png(scene, plane, cut)),
    );
    svg.push_str(&path_near(plan, plane, cut as f64 * h, height as f64 * h));
    // a scale bar of 5 mm
    let (x, y) = (1.0, height as f64 * h - 1.2);
    let _ = write!(
        svg,
        "<rect x=\"{x}\" y=\"{y:.2}\" width=\"5\" height=\"0.25\" fill=\"#fff\"/>\
         <text x=\"{x}\" y=\"{:.2}\" font-size=\"1.3\" fill=\"#fff\">5 mm</text></svg></figure>",
        y - 0.4
    );
    svg
}

/// Moves whose both ends lie within half a layer of the slice.
fn path_near(plan: &Plan, plane: &Plane, at_mm: f64, height_mm: f64) -> String {
    let work_from_ct = plan.scene.ct_from_work.inverse();
    let near = 0.5 * plan.case.path.layer_mm;
    let half = 0.5 * plan.scene.class.grid().spacing_mm().x;
    let mut lines: [String; 2] = Default::default();
    let mut before: Option<Point<Work>> = None;
    for waypoint in &plan.waypoints {
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
    format!("<path class=\"cutpath\" d=\"{cuts}\"/><path class=\"linkpath\" d=\"{links}\"/>")
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
                Some((TARGET, 0.22))
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
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width as u32, height as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    // writing to memory cannot fail for a buffer of the right size; a picture less is no reason to lose a plan
    let written = encoder.write_header().and_then(|mut writer| writer.write_image_data(&pixels));
    if written.is_err() {
        bytes.clear();
    }
    bytes
}

/// The structure that holds a point.
fn structure_at(scene: &Scene, p: Point<Work>) -> Option<usize> {
    let p_ct = scene.ct_from_work * p;
    scene.structures.iter().position(|s| s.field.as_ref().is_some_and(|f| f.distance(p_ct) <= 0.0))
}
