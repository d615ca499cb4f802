//! Hard cases: small bodies, each hard in one way, with what must become of it.
//!
//! A body is a formula for grey values and one for labels, a grid to store it on and a case. It is written, planned,
//! read back and verified as a user's would be. What must happen is known beforehand: a plan that passes every check, a
//! plan or an answer that says why it falls short, or a refusal that says what is wrong. A panic is a failure like any other.

mod list;
mod list_tools;
mod random;
mod run;
mod scene;

use bonemill_planner::Progress;
use rayon::prelude::*;

pub use list::scenes;
pub use random::{RandomBody, random_scenes};
pub use run::{End, run as run_scene};
pub use scene::{Expect, Scene};

use crate::{ExperimentError, Size, Table};

/// Runs every scene and says what became of it.
///
/// # Errors
/// None: whatever a scene ends with is a row of the table.
pub fn run(_: Size, progress: &dyn Progress) -> Result<Vec<Table>, ExperimentError> {
    progress.stage("hard cases");
    let scenes = scenes();
    let ends: Vec<End> = scenes.par_iter().map(run_scene).collect();
    let mut table = Table::new(
        "hard-cases",
        format!("{} hard cases: what must happen, and what did", scenes.len()),
        &["case", "why it is hard", "must", "did", "reason", "as it must"],
    );
    for (scene, end) in scenes.iter().zip(&ends) {
        let kept = if end.keeps(&scene.expect) { "yes" } else { "NO" };
        table.push(vec![
            scene.name.into(),
            scene.why.into(),
            scene.expect.to_string(),
            end.word().into(),
            end.reason().replace('\n', "; ").replace('|', "/"),
            kept.into(),
        ]);
        if kept == "NO" {
            table.shortfalls.push(format!("{}: must {}, did: {end}", scene.name, scene.expect));
        }
    }
    Ok(vec![table])
}

/// Random scenes, 25 for each seed asked for.
///
/// # Errors
/// None: whatever a scene ends with is a row of the table.
pub fn run_random(size: Size, progress: &dyn Progress) -> Result<Vec<Table>, ExperimentError> {
    progress.stage("random scenes");
    Ok(vec![random_scenes(25 * size.seeds, progress)])
}

#[cfg(test)]
mod tests;
