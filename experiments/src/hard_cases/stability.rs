//! How far a plan moves where its input moves a little.
//!
//! The body is a bowl with air cells under a dome, which has no face along any grid, and a nerve beside it. It is given by formulas, so a
//! turned or shifted body is not a resampled image. Each row holds the largest change over some variants of one input.

use std::sync::Arc;

use bonemill_planner::Progress;
use bonemill_planner::case::Case;
use bonemill_planner::plan as planned;

use super::random::draws;
use super::run::Quiet;
use super::scene::{AIR, Scene, TARGET, V, bowl, dome};
use crate::figures::PlanFigures;
use crate::{ExperimentError, Size, Table};

/// Side of an air cell, mm.
const CELL_MM: f64 = 1.1;
/// A change of total time or mean |F| above this, %, is another choice and not the same plan moved.
const OTHER_CHOICE: f64 = 5.0;

/// HU of the body.
fn cells(p: &V) -> f32 {
    let wave = |v: f64| (v * std::f64::consts::TAU / CELL_MM).sin();
    if bowl(p) == TARGET && wave(p.x) * wave(p.y + 0.3) * wave(p.z + 0.7) > 0.35 { AIR } else { dome(p) }
}

fn body() -> Scene {
    Scene::plain("stability", "small changes of the input").body(cells, bowl)
}

/// The body's mirror image, milled by a burr that turns the other way.
fn mirrored() -> Scene {
    let mirror = |p: &V| V::new(-p.x, p.y, p.z);
    let scene = body().body(move |p| cells(&mirror(p)), move |p| bowl(&mirror(p)));
    scene.with("[burr]", "[burr]\nspin = 1")
}

/// HU with noise between -`most` and `most`.
fn noisy(most: i16) -> Scene {
    let mut scene = body();
    scene.hu = Arc::new(move |p| {
        let at = [p.x, p.y, p.z].map(|mm| (mm * 1e3).round() as i64 as u64);
        let mixed = at.iter().fold(0, |mixed: u64, v| mixed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ v);
        let span = 2 * u64::from(most.unsigned_abs()) + 1;
        cells(p) + f32::from(draws(mixed)(span)) - f32::from(most)
    });
    scene
}

/// What is changed, and its variants.
fn inputs() -> Vec<(&'static str, Vec<Scene>)> {
    let turned = |turn_rad| Scene { turn_rad, ..body() };
    let at = |origin_mm| Scene { origin_mm, ..body() };
    let voxels = |mm| Scene { spacing_mm: [mm; 3], ..body() };
    let with = |from, to: &str| body().with(from, to);
    vec![
        (
            "case turned by a random rotation",
            vec![turned([0.7, -1.1, 0.4]), turned([-0.3, 0.2, 2.1]), turned([1.9, 0.8, -0.5])],
        ),
        (
            "case shifted by part of a voxel",
            vec![at([0.07, 0.0, 0.0]), at([0.11, -0.05, 0.13]), at([0.25, 0.25, 0.25])],
        ),
        ("origin 10⁵ mm away", vec![at([1e5, -1e5, 1e5])]),
        (
            "stored backwards, other axes first",
            vec![Scene { mirrored: [true, false, true], order: [2, 0, 1], ..body() }],
        ),
        ("mirrored body and burr", vec![mirrored()]),
        ("HU ± 1", vec![noisy(1)]),
        ("HU ± 10", vec![noisy(10)]),
        (
            "clearance by 10⁻⁶ mm",
            vec![
                with("clearance_mm = 0.8", "clearance_mm = 0.800001"),
                with("clearance_mm = 0.8", "clearance_mm = 0.799999"),
            ],
        ),
        (
            "burr's radius by 10⁻⁶ mm",
            vec![
                with("radius_mm = 1.5", "radius_mm = 1.500001"),
                with("radius_mm = 1.5", "radius_mm = 1.499999"),
            ],
        ),
        ("priority 10⁶ for 1", vec![with("clearance_mm = 0.8", "clearance_mm = 0.8\npriority = 1000000")]),
        ("CT voxel 0.4, 0.3 mm for 0.5", vec![voxels(0.4), voxels(0.3)]),
        ("grid.spacing_mm 0.4", vec![with("spacing_mm = 0.25", "spacing_mm = 0.4")]),
        ("grid.spacing_mm 0.3", vec![with("spacing_mm = 0.25", "spacing_mm = 0.3")]),
        ("grid.spacing_mm 0.2", vec![with("spacing_mm = 0.25", "spacing_mm = 0.2")]),
        ("grid.spacing_mm 0.1", vec![with("spacing_mm = 0.25", "spacing_mm = 0.1")]),
        ("path.step_mm 0.1", vec![with("step_mm = 0.25", "step_mm = 0.1")]),
        ("path.step_mm 0.01", vec![with("step_mm = 0.25", "step_mm = 0.01")]),
    ]
}

/// The figures of a scene's plan.
fn figures(scene: &Scene) -> Result<PlanFigures, ExperimentError> {
    let folder = tempfile::tempdir().map_err(ExperimentError::Folder)?;
    let (text, case_path) = scene.write(folder.path())?;
    let case = Case::parse(&text, &case_path)?;
    Ok(PlanFigures::of(&planned(&case, &case_path, &Quiet)?))
}

/// Plans all.
///
/// # Errors
/// When a body cannot be written or planned.
pub fn run(_size: Size, progress: &dyn Progress) -> Result<Vec<Table>, ExperimentError> {
    let title = "How far a plan moves where its input moves a little: the largest change over some variants. Removed volume, points of %; least distance, \
                 mm; forces toward the nerve, |F| and total time, %. \"Choice\": another where mean |F| or time change by more than 5 %.";
    let head = [&["changed"][..], &PlanFigures::HEADS, &["choice"]].concat();
    let mut table = Table::new("stability", title, &head);
    let plain = figures(&body())?;
    for (name, variants) in inputs() {
        progress.stage(name);
        let mut largest = [(0.0f64, 1); 7];
        for scene in &variants {
            for (largest, (change, digits)) in largest.iter_mut().zip(figures(scene)?.changes(&plain)) {
                *largest = (if change.abs() > largest.0.abs() { change } else { largest.0 }, digits);
            }
        }
        let other = largest[4].0.abs().max(largest[6].0.abs()) > OTHER_CHOICE;
        let cells = largest.map(|(change, digits)| format!("{change:+.digits$}"));
        let choice = if other { "another" } else { "the same" };
        table.push([name.to_owned()].into_iter().chain(cells).chain([choice.to_owned()]).collect());
    }
    Ok(vec![table])
}
