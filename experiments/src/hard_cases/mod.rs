//! Hard cases: small bodies, each difficult in one way, with the expected result.
//!
//! A body is a formula for grey values and one for labels, a grid to store it on and a case. It is written, planned, read back
//! and verified as a user would do. The expected result is a plan that passes every check, a plan or an answer that states why
//! it falls short, or a refusal that states what is wrong. A panic counts as a failure.

mod agree;
mod channels;
mod keys;
mod list;
mod list_tools;
mod random;
mod read_back;
mod run;
mod scene;
mod stability;

use bonemill_planner::Progress;
use rayon::prelude::*;

pub use agree::run as run_agree;
pub use channels::run as run_agree_channels;
pub(crate) use keys::{Choices, Keys};
pub use list::scenes;
pub(crate) use random::draws;
pub use random::{RandomBody, random_scenes};
pub(crate) use run::or_panic;
pub use run::{End, run as run_scene};
pub use scene::{Expect, Scene};
pub use stability::run as run_stability;

use crate::{ExperimentError, Size, Table};

/// Runs every scene and lists the results.
///
/// # Errors
/// None: every result of a scene is a row of the table.
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

/// Runs random scenes, 25 for each seed of `size`.
///
/// # Errors
/// None: every result of a scene is a row of the table.
pub fn run_random(size: Size, progress: &dyn Progress) -> Result<Vec<Table>, ExperimentError> {
    progress.stage("random scenes");
    Ok(vec![random_scenes(25 * size.seeds, progress)])
}

#[cfg(test)]
mod tests;
